//! Models for MuJoCo through `import`: torques of a model with every spelling that is read, and faults at their places.
//!
//! The expected torques were computed once by MuJoCo 3's inverse dynamics, its constraints left out and dry friction added
//! (`benches/arms/descriptions.py` does so for any file).

use crate::support::root;
use serde_json::Value;
use std::collections::BTreeMap;
use tpm_codegen::import::{Angles, Described, Imported, Options, import_description, mjcf};
use tpm_codegen::parse_model;
use tpm_codegen::source::Source;
use tpm_runtime::interpret::Interpreted;
use tpm_runtime::model::Model as _;
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::prepare;

fn read(text: &str, options: &Options) -> Result<Imported, String> {
    let source = Source::new("robot.xml", text);
    import_description(&source, options).map_err(|faults| faults.render(&source))
}

/// The torques of an imported model with the values of its prior.
pub(crate) fn torques(imported: &Imported, states: &[[Vec<f64>; 3]]) -> Vec<Vec<f64>> {
    let source = Source::new("imported", imported.model.clone());
    let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let prepared = prepare(parsed.model).expect("linear in the parameters");
    let model = Interpreted::new(&prepared.model, &prepared.form);
    let prior: BTreeMap<String, f64> = crate::robots::values(&imported.prior);
    let map = ParameterMap::new(&prepared);
    let parameters = map.evaluate(|symbol| prior.get(map.name(symbol)).copied().unwrap_or(0.0));
    let mut workspace = vec![0.0; model.inverse_workspace_len()];
    let of = |[q, v, a]: &[Vec<f64>; 3]| {
        let motion = [q.as_slice(), v, a].concat();
        let mut out = vec![0.0; q.len()];
        model.inverse_dynamics(&motion, &parameters, &[], &mut workspace, &mut out).expect("fits");
        out
    };
    states.iter().map(of).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|number| number.as_f64().expect("a number")).collect()
}

#[test]
fn every_spelling_gives_the_torques_of_mujoco() {
    let folder = root().join("tests/fixtures/robots");
    let text = std::fs::read_to_string(folder.join("mujoco.xml")).expect("a model");
    let known = std::fs::read_to_string(folder.join("mujoco.json")).expect("a fixture");
    let known: Vec<Value> = serde_json::from_str(&known).expect("JSON");
    for angles in [Angles::Recognised, Angles::Written] {
        let imported = read(&text, &Options { angles, ..Options::default() }).expect("a description");
        let states: Vec<[Vec<f64>; 3]> =
            known.iter().map(|state| ["q", "v", "a"].map(|name| numbers(&state[name]))).collect();
        for (found, state) in torques(&imported, &states).iter().zip(&known) {
            for (found, expected) in found.iter().zip(numbers(&state["torque"])) {
                assert!((found - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{found} {expected}");
            }
        }
        // Limits in radians, and those of forces: of a joint through the gear of its motor, of one through the range of its force.
        for limit in ["tau_pan = 100.0, tau_lift = 80.0", "pan = [-2.96705972839", "joint_2 = [-0.1, 0.4]"] {
            assert!(imported.experiment.contains(limit), "{limit}:\n{}", imported.experiment);
        }
        assert!(imported.model.contains("gravity (0.3, -0.2, -9.7);"));
        let geared = "motors turn 50 times as far as their joints `pan`";
        assert!(imported.warnings.iter().any(|warning| warning.message.contains(geared)), "{:#?}", imported.warnings);
    }
}

/// A model with one joint, and other lines beside it.
fn one_joint(compiler: &str, joint: &str, inertial: &str, rest: &str) -> String {
    format!(
        "<mujoco model=\"m\">\n<compiler {compiler}/>\n<worldbody><body name=\"b\">\n{joint}\n{inertial}\n</body></worldbody>\n{rest}\n</mujoco>"
    )
}

const JOINT: &str = "<joint name=\"j\" axis=\"0 1 0\"/>";
const INERTIAL: &str = "<inertial pos=\"0.1 0 0\" mass=\"2\" diaginertia=\"0.1 0.1 0.1\"/>";

#[test]
fn one_pendulum_in_other_words() {
    let state = [[vec![0.4], vec![1.5], vec![-2.0]]];
    let of =
        |text: &str| torques(&read(text, &Options::default()).unwrap_or_else(|fault| panic!("{fault}")), &state)[0][0];
    // I q'' - m g x cos q, with I = 0.1 + 2 * 0.1^2 and the weight along -z about the y axis.
    let weight = 2.0 * 9.81 * 0.1 * 0.4_f64.cos();
    assert!((of(&one_joint("", JOINT, INERTIAL, "")) - (0.12 * -2.0 - weight)).abs() < 1e-12);
    let armature = JOINT.replace("/>", " armature=\"0.5\" damping=\"0.2\" frictionloss=\"0.1\"/>");
    let expected = 0.62 * -2.0 - weight + 0.2 * 1.5 + 0.1;
    assert!((of(&one_joint("", &armature, INERTIAL, "")) - expected).abs() < 1e-12);
    let weightless = "<option><flag gravity=\"disable\"/></option>";
    assert!((of(&one_joint("", JOINT, INERTIAL, weightless)) + 0.24).abs() < 1e-12);
    // At the coordinate `ref` the body is as it is written: 30 degrees, and the same in radians.
    let turned = weight_at(0.4 - std::f64::consts::PI / 6.0);
    for (compiler, start) in [("", "30"), ("angle=\"radian\"", "0.5235987755982988")] {
        let joint = JOINT.replace("/>", &format!(" ref=\"{start}\"/>"));
        assert!((of(&one_joint(compiler, &joint, INERTIAL, "")) - (0.12 * -2.0 - turned)).abs() < 1e-12);
    }
    // A spring without force at 45 degrees: its stiffness is a parameter.
    let spring = JOINT.replace("/>", " stiffness=\"3\" springref=\"45\"/>");
    let drawn = 3.0 * (0.4 - std::f64::consts::FRAC_PI_4);
    assert!((of(&one_joint("", &spring, INERTIAL, "")) - (0.12 * -2.0 - weight + drawn)).abs() < 1e-12);
    let mesh = format!("{INERTIAL}<geom type=\"mesh\" mesh=\"hull\"/>");
    assert!((of(&one_joint("", JOINT, &mesh, "")) - (0.12 * -2.0 - weight)).abs() < 1e-12);
    // A shape without mass says nothing; with an inertial its mass does not count either.
    let shape = format!("{INERTIAL}<geom size=\"1\"/>");
    assert!((of(&one_joint("", JOINT, &shape, "")) - (0.12 * -2.0 - weight)).abs() < 1e-12);
}

fn weight_at(angle: f64) -> f64 {
    2.0 * 9.81 * 0.1 * angle.cos()
}

/// Two pendulums on the world, of which the second one turns half as far back, with its losses.
fn two_pendulums(joints: &str, equality: &str) -> String {
    let body = |name: &str, joint: &str| format!("<body name=\"{name}\">\n{joint}\n{INERTIAL}\n</body>\n");
    let [first, second] = ["j", "k"].map(|name| JOINT.replace("\"j\"", &format!("\"{name}\"")));
    let second = second.replace("/>", &format!(" {joints}/>"));
    let bodies = body("b", &first) + &body("c", &second);
    format!("<mujoco model=\"m\">\n<worldbody>\n{bodies}</worldbody>\n<equality>\n{equality}\n</equality>\n</mujoco>")
}

#[test]
fn a_joint_that_an_equality_couples_follows_the_other_one() {
    let text = two_pendulums(
        "damping=\"0.4\" armature=\"0.08\" frictionloss=\"0.2\" range=\"-20 40\" stiffness=\"3\" springref=\"9\"",
        "<joint joint1=\"k\" joint2=\"j\" polycoef=\"0 -0.5 0 0 0\"/>",
    );
    let imported = read(&text, &Options::default()).unwrap_or_else(|fault| panic!("{fault}"));
    let [q, v, a] = [0.4, 1.5, -2.0];
    let found = torques(&imported, &[[vec![q], vec![v], vec![a]]])[0][0];
    // Of the second pendulum the position, the rate and the acceleration are halved and against it, and so is its part of the torque.
    let own = 0.12 * a - weight_at(q);
    let drawn = 3.0 * (-0.5 * q - 9.0 * std::f64::consts::PI / 180.0);
    let other = 0.2 * -0.5 * a - weight_at(-0.5 * q) + 0.4 * -0.5 * v - 0.2 + drawn;
    assert!((found - (own - 0.5 * other)).abs() < 1e-12, "{found}");
    // Its limits, -20 to 40 degrees, are those of the first one at -80 to 40.
    assert!(imported.model.contains("revolute -1/2*j about y"), "{}", imported.model);
    assert!(imported.experiment.contains("j = [-1.39626340159"), "{}", imported.experiment);
    assert!(imported.model.contains("coordinate j [rad];\n    input tau_j [N*m];"), "{}", imported.model);
    // What is written for MuJoCo says the same.
    let source = Source::new("robot.xml", text.as_str());
    let described =
        Described::read(&source, &Options::default()).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let written = mjcf(&described, &BTreeMap::new(), &BTreeMap::new()).expect("possible inertias");
    let again = read(&written, &Options::default()).unwrap_or_else(|fault| panic!("{fault}\n{written}"));
    assert!((torques(&again, &[[vec![q], vec![v], vec![a]]])[0][0] - found).abs() < 1e-12, "{written}");
}

#[test]
fn an_equality_with_an_offset_turns_the_follower() {
    // The second pendulum stands at -0.5 q + 0.3, in a pose that is written at 20 degrees of it and 10 degrees of the first one.
    let degree = std::f64::consts::PI / 180.0;
    let text = two_pendulums("ref=\"20\"", "<joint joint1=\"k\" joint2=\"j\" polycoef=\"0.1 -0.5 0 0 0\"/>");
    let text = text.replace("name=\"j\"", "name=\"j\" ref=\"10\"");
    let imported = read(&text, &Options::default()).unwrap_or_else(|fault| panic!("{fault}"));
    let [q, v, a] = [0.4, 1.5, -2.0];
    let found = torques(&imported, &[[vec![q], vec![v], vec![a]]])[0][0];
    // Distances from `ref` obey the equality, and are the turns from the pose in the file.
    let own = 0.12 * a - weight_at(q - 10.0 * degree);
    let other = 0.12 * -0.5 * a - weight_at(0.1 - 0.5 * (q - 10.0 * degree));
    assert!((found - (own - 0.5 * other)).abs() < 1e-12, "{found} {}", own - 0.5 * other);
}

/// Masses, centres and moments of shapes by formulas of their own: integrals over slices of the shape.
#[test]
fn shapes_have_the_mass_and_the_moments_of_their_volume() {
    let inertia = |geoms: &str, compiler: &str| {
        // Gravity across the axis, so that first moments count.
        let gravity = "<option gravity=\"-3 -4 0\"/>";
        let text = one_joint(compiler, "<joint name=\"j\" axis=\"0 0 1\" pos=\"0.1 0.2 0\"/>", geoms, gravity);
        crate::robots::values(&read(&text, &Options::default()).unwrap_or_else(|fault| panic!("{fault}")).prior)
    };
    let pi = std::f64::consts::PI;
    // A slice at the height z is an ellipse or a rectangle of the half widths a, b: of area A, and of A a^2 s about the other axis.
    let sliced = |half: f64, slice: &dyn Fn(f64) -> (f64, f64, f64), share: f64, area: f64| {
        let steps = 200_000;
        let mut sums = [0.0_f64; 4];
        for step in 0..steps {
            let z = half * (2.0 * (f64::from(step) + 0.5) / f64::from(steps) - 1.0);
            let (a, b, _) = slice(z);
            let part = area * a * b * 2.0 * half / f64::from(steps);
            for (sum, value) in sums.iter_mut().zip([1.0, a * a * share, b * b * share, z * z]) {
                *sum += part * value;
            }
        }
        let [volume, x, y, z] = sums;
        [volume, y + z, x + z, x + y]
    };
    let round = |rest: f64| rest.max(0.0).sqrt();
    let capsule = |r: f64, h: f64| {
        move |z: f64| {
            let out = (z.abs() - h).max(0.0);
            (round(r * r - out * out), round(r * r - out * out), 0.0)
        }
    };
    let ball =
        |a: f64, b: f64, c: f64| move |z: f64| (a * round(1.0 - z * z / c / c), b * round(1.0 - z * z / c / c), 0.0);
    for (geom, [volume, xx, yy, zz]) in [
        ("type='box' size='0.1 0.2 0.3'", sliced(0.3, &|_| (0.1, 0.2, 0.0), 1.0 / 3.0, 4.0)),
        ("type='cylinder' size='0.1 0.3'", sliced(0.3, &|_| (0.1, 0.1, 0.0), 0.25, pi)),
        ("type='ellipsoid' size='0.1 0.2 0.3'", sliced(0.3, &ball(0.1, 0.2, 0.3), 0.25, pi)),
        ("size='0.2'", sliced(0.2, &ball(0.2, 0.2, 0.2), 0.25, pi)),
        ("type='capsule' size='0.1 0.3'", sliced(0.4, &capsule(0.1, 0.3), 0.25, pi)),
        ("type='capsule' fromto='0.1 0.2 -0.3 0.1 0.2 0.3' size='0.1'", sliced(0.4, &capsule(0.1, 0.3), 0.25, pi)),
    ] {
        let (place, at) = if geom.contains("fromto") { ("", [0.0, 0.0]) } else { (" pos='0.3 0.2 0.1'", [0.2, 0.1]) };
        let found = inertia(&format!("<geom {geom}{place} density='500'/>"), "");
        // Of all that a turn about z shows: the moment about it, and the first moments across.
        let mass = 500.0 * volume;
        let near = |name: &str, value: f64| {
            let found = found.get(name).copied().unwrap_or(0.0);
            assert!((found - value).abs() < 1e-6 * (1.0 + mass), "{geom}: {name} {found} {value}");
        };
        near("Izz_b", 500.0 * zz + mass * at[0] * at[0]);
        near("mx_b", mass * at[0]);
        near("my_b", 0.0);
        // The other moments, by turning the shape.
        for (turn, moment) in [("0 90 0", xx), ("90 0 0", yy)] {
            let turned = inertia(
                &format!("<geom {geom} euler='{turn}' mass='3'/>")
                    .replace(" fromto='0.1 0.2 -0.3 0.1 0.2 0.3' size='0.1'", " size='0.1 0.3'"),
                "",
            );
            let centre = 3.0 * (0.1_f64.powi(2) + 0.2_f64.powi(2));
            let value = 3.0 * moment / volume + centre;
            assert!((turned["Izz_b"] - value).abs() < 1e-6, "{geom} {turn}: {} {value}", turned["Izz_b"]);
        }
    }
    // Several shapes count together, those of other groups and of no mass do not; all are scaled to a stated sum.
    let two = "<geom size='0.1' mass='1' pos='0.1 0.2 0'/><geom size='0.1' mass='3' pos='0.3 0.2 0'/><geom size='1' group='3'/><geom size='1' mass='0'/>";
    let found = inertia(two, "inertiagrouprange='0 2'");
    assert!((found["mx_b"] - 0.6).abs() < 1e-12 && (found["Izz_b"] - (4.0 * 0.4 * 0.01 + 3.0 * 0.04)).abs() < 1e-12);
    let scaled = inertia(two, "inertiagrouprange='0 2' settotalmass='8'");
    assert!((scaled["mx_b"] - 1.2).abs() < 1e-12, "{scaled:?}");
    // An `inertial` goes before the shapes, unless the compiler says otherwise.
    let both = format!("{INERTIAL}<geom size='0.1' mass='1' pos='0.4 0.2 0'/>");
    assert!((inertia(&both, "")["mx_b"] - 0.0).abs() < 1e-12);
    assert!((inertia(&both, "inertiafromgeom='true'")["mx_b"] - 0.3).abs() < 1e-12);
}

#[test]
fn what_is_coupled_otherwise_is_named() {
    let fault = |joints: &str, equality: &str| {
        read(&two_pendulums(joints, equality), &Options::default())
            .err()
            .unwrap_or_else(|| panic!("no fault: {equality}"))
    };
    let says =
        |said: &str, words: &[&str]| words.iter().for_each(|word| assert!(said.contains(word), "`{word}`:\n{said}"));
    says(&fault("", "<joint joint1=\"k\" joint2=\"j\" polycoef=\"0 1 2 0 0\"/>"), &["`k` is coupled", "lock"]);
    says(&fault("", "<joint joint1=\"k\" joint2=\"l\"/>"), &["`k` follows `l`, which does not move here", "lock it"]);
    says(&fault("", "<joint joint1=\"l\" joint2=\"j\"/>"), &["`l` follows `j` and is no joint"]);
    let both = "<joint joint1=\"k\" joint2=\"j\"/><joint joint1=\"j\" joint2=\"k\"/>";
    says(&fault("", both), &["the joint `k` follows itself over other joints"]);
}

#[test]
fn a_free_body_is_held_as_the_base() {
    let text = "<mujoco><worldbody><body name=\"ground\"/><body name=\"torso\"><freejoint/>\n\
                <inertial pos=\"0 0 0\" mass=\"9\" diaginertia=\"1 1 1\"/>\n<body name=\"b\">\
                <joint axis=\"0 1 0\"/><inertial pos=\"0.1 0 0\" mass=\"2\" diaginertia=\"0.1 0.1 0.1\"/></body>\
                </body></worldbody></mujoco>";
    // The world carries nothing that moves, so that the base need not be named.
    for base in [None, Some("torso".to_owned())] {
        let held = read(text, &Options { base, ..Options::default() }).expect("one arm");
        let found = torques(&held, &[[vec![0.4], vec![1.5], vec![-2.0]]])[0][0];
        assert!((found - (0.12 * -2.0 - weight_at(0.4))).abs() < 1e-12, "{found}");
        assert!(held.warnings.iter().any(|warning| warning.message.contains("`torso` is free to move")));
    }
    let moving = text.replace("<body name=\"ground\"/>", "<body name=\"ground\"><joint axis=\"0 1 0\"/></body>");
    let said = read(&moving, &Options::default()).expect_err("two roots");
    assert!(said.contains("2 roots: `world`, `torso`") && said.contains("name the base"), "{said}");
}

#[test]
fn what_has_no_model_is_named_at_its_line() {
    let check = |text: &str, line: usize, words: &[&str]| {
        let said = read(text, &Options::default()).err().unwrap_or_else(|| panic!("no fault: {words:?}"));
        assert!(said.contains(&format!("robot.xml:{line}:")), "line {line}:\n{said}");
        words.iter().for_each(|word| assert!(said.contains(word), "`{word}`:\n{said}"));
    };
    let joint = |attributes: &str| one_joint("", &JOINT.replace("/>", &format!(" {attributes}/>")), INERTIAL, "");
    check(&joint("type=\"ball\""), 4, &["of the type `ball`", "hinge"]);
    check(&joint("stiffness=\"-3\""), 4, &["pushes away"]);
    check(&joint("pos=\"0 0\""), 4, &["`pos` is `0 0`, which is not 3 numbers"]);
    check(&joint("class=\"c\" damping=\"much\""), 4, &["`damping` is `much`, which is not 1 number"]);
    let with = |inertial: &str, rest: &str| one_joint("", JOINT, inertial, rest);
    check(&with("<geom type=\"mesh\" mesh=\"hull\"/>", ""), 5, &["mesh `hull`", "`inertial`", "mass=\"0\""]);
    check(&with("<geom type=\"box\" size=\"0.1 0.1\"/>", ""), 5, &["no volume"]);
    check(&with("<geom size=\"0.1\" shellinertia=\"true\"/>", ""), 5, &["surface"]);
    check(&with("<inertial pos=\"0 0 0\" mass=\"1\"/>", ""), 5, &["no moments", "fullinertia"]);
    check(&with("<inertial pos=\"0 0 0\" diaginertia=\"1 1 1\"/>", ""), 5, &["no `mass`"]);
    check(
        &with("<inertial pos=\"0 0 0\" mass=\"1\" diaginertia=\"1 1 1\" quat=\"0 0 0 0\"/>", ""),
        5,
        &["no orientation"],
    );
    check(
        &with(INERTIAL, "<equality><connect body1=\"b\" anchor=\"0 0 0\"/></equality>"),
        7,
        &["closes a loop", "tree"],
    );
    check(&with(INERTIAL, "<equality><joint joint1=\"j\"/></equality>"), 7, &["`j` is coupled", "lock"]);
    check(&with(INERTIAL, "<tendon><fixed stiffness=\"2\"/></tendon>"), 7, &["`stiffness`", "tendons"]);
    check(&with(INERTIAL, "<option density=\"1.2\"/>"), 7, &["fluid"]);
    check(&with(INERTIAL, "<include file=\"more.xml\"/>"), 7, &["`include`", "mj_saveLastXML"]);
    check(&with("<frame/>", ""), 5, &["`frame`"]);
    for (compiler, word) in [
        ("angle=\"grad\"", "`angle` is `grad`"),
        ("eulerseq=\"xyq\"", "three letters"),
        ("boundmass=\"4\"", "changes masses"),
        ("inertiagrouprange=\"1\"", "`inertiagrouprange` is `1`"),
        ("balanceinertia=\"true\"", "`balanceinertia`"),
    ] {
        check(&one_joint(compiler, JOINT, INERTIAL, ""), 2, &[word]);
    }
    check(&with(INERTIAL, "").replace("<body name", "<body gravcomp=\"1\" name"), 3, &["compensated", "remove"]);
    check(&with(INERTIAL, "").replace("<body name", "<body childclass=\"x\" name"), 3, &["no class `x`"]);
    let deep = format!("<mujoco><worldbody>\n{}{}</worldbody></mujoco>", "<body>".repeat(5000), "</body>".repeat(5000));
    check(&deep, 2, &["more than 300 deep"]);
    // What is coupled or has a spring may be locked.
    let held = Options { locked: vec![("j".into(), "0.2".into())], ..Options::default() };
    let more = "<body name=\"c\"><joint name=\"k\"/><inertial pos=\"0 1 0\" mass=\"1\" diaginertia=\"1 1 1\"/></body>";
    let text = with(&format!("{INERTIAL}{more}"), "<equality><joint joint1=\"j\"/></equality>");
    assert!(read(&text, &held).is_ok());
}
