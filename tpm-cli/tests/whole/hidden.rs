//! Results of data that do not show every parameter: what can be computed from them is right, and what cannot is refused by name.

use crate::support::{printed_in, root, skipped, tpm_in};
use serde_json::Value;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

/// An arm whose inertia is written with one term too many: a + b sin^2 + c cos^2 has two parameters.
const TWO_OF_THREE: &str = "model Bent {
    coordinate q [rad]; input tau [N*m];
    parameter a [kg*m^2], b [kg*m^2], c [kg*m^2], d [N*m*s/rad];
    (a + b*sin(q)^2 + c*cos(q)^2)*ddot(q) + d*dot(q) + (b - c)*sin(q)*cos(q)*dot(q)^2 = tau;
}";
const BENT: [f64; 4] = [0.3, 0.2, 0.5, 0.1];

/// An arm on a table whose tilt is known; lying flat it does not show its gravity.
const TILTED: &str = "model Tilted {
    coordinate q [rad]; input tau [N*m];
    parameter J [kg*m^2], d [N*m*s/rad], mgl [N*m];
    constant tilt [rad];
    J*ddot(q) + d*dot(q) + mgl*sin(tilt)*sin(q) = tau;
}";
const FLAT: [f64; 3] = [0.8, 0.3, 16.7];

/// A pendulum whose mass, length and inertia show in two combinations.
const PENDULUM: &str = "model Pendulum {
    coordinate q [rad]; input tau [N*m];
    parameter J [kg*m^2], m [kg], l [m], d [N*m*s/rad];
    constant g = 9.81 [m/s^2];
    (J + m*l^2)*ddot(q) + d*dot(q) + m*g*l*sin(q) = tau;
    pattern { amplitude A [rad]; frequency w [rad/s]; q = A*(cos(w*t) - 1/9*cos(3*w*t)); }
}";

fn bent([q, v, a]: [f64; 3], theta: [f64; 4]) -> f64 {
    let (s, c) = q.sin_cos();
    (theta[0] + theta[1] * s * s + theta[2] * c * c) * a + theta[3] * v + (theta[1] - theta[2]) * s * c * v * v
}

fn tilted([q, v, a]: [f64; 3], tilt: f64) -> f64 {
    FLAT[0] * a + FLAT[1] * v + FLAT[2] * tilt.sin() * q.sin()
}

/// A log of four periods of 2 s about 0.4 rad, with a little noise.
fn log(folder: &Path, name: &str, torque: &dyn Fn([f64; 3]) -> f64) {
    let mut text = String::from("t_s,q,tau\n");
    let scatter = |n: usize, of: f64| (((n as f64 * 12.9898 + of).sin() * 43758.5453).fract()) * 0.5;
    for n in 0..8000 {
        let (t, w) = (n as f64 * 1e-3, PI);
        let (first, third) = ((w * t).sin_cos(), (3.0 * w * t).sin_cos());
        let motion = [
            0.4 + 0.8 * (first.1 - third.1 / 9.0),
            0.8 * w * (third.0 / 3.0 - first.0),
            0.8 * w * w * (third.1 - first.1),
        ];
        let (q, tau) = (motion[0] + 1e-5 * scatter(n, 1.0), torque(motion) + 1e-4 * scatter(n, 2.0));
        let _ = writeln!(text, "{t:.3},{q:.9},{tau:.9}");
    }
    std::fs::write(folder.join(name), text).expect("writable");
}

fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).expect("writable");
}

fn json(folder: &Path, name: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join(name)).expect("written")).expect("JSON")
}

/// The entry of a parameter in a result.
fn parameter<'a>(result: &'a Value, name: &str) -> &'a Value {
    let all = result["parameters"].as_array().expect("a list");
    all.iter().find(|entry| entry["name"] == name).expect("a parameter of the model")
}

/// The command fails in a folder with this exit code and says all of this.
fn fails(folder: &Path, arguments: &[&str], code: i32, said: &[&str]) {
    let output = tpm_in(folder, arguments);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
    for part in said {
        assert!(text.contains(part), "{arguments:?}: `{part}` is not in: {text}");
    }
}

/// What a program in C prints that includes the header of `module`, one number per line; nothing without a compiler.
fn numbers_of(folder: &Path, module: &str, program: &str) -> Option<Vec<f64>> {
    let runs = |name: &&str| Command::new(name).arg("--version").output().is_ok();
    let Some(compiler) = ["cc", "gcc", "clang"].into_iter().find(runs) else {
        skipped("there is no C compiler");
        return None;
    };
    write(
        folder,
        "main.c",
        &format!("#include <stdio.h>\n#include \"{module}.h\"\nint main(void) {{ {program} return 0; }}\n"),
    );
    let source = format!("{module}.c");
    let built = Command::new(compiler)
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "main.c", &source, "-lm", "-o", "run"])
        .current_dir(folder)
        .output()
        .expect("the compiler runs");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let output = Command::new(folder.join("run")).output().expect("the program runs");
    let text = String::from_utf8(output.stdout).expect("text");
    Some(text.lines().map(|line| line.parse().expect("a number")).collect())
}

/// Where no equation needs more than the combinations that the data show, everything works from them.
#[test]
fn combinations_are_enough_where_no_equation_needs_more() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    write(at, "bent.tpm", TWO_OF_THREE);
    log(at, "log.csv", &|motion| bent(motion, BENT));
    assert_eq!(
        tpm_in(at, &["identify", "bent.tpm", "--log", "log.csv", "--json", "-o", "r.json"]).status.code(),
        Some(1)
    );
    let result = json(at, "r.json");
    for name in ["a", "b", "c"] {
        let entry = parameter(&result, name);
        assert!(entry["value"].is_null() && entry["prior"].is_null() && entry.get("with_prior").is_none(), "{entry}");
    }
    printed_in(at, &["generate", "bent.tpm", "--lang", "c", "--params", "r.json", "-o", "."], 0);
    let header = std::fs::read_to_string(at.join("bent.h")).expect("written").replace("\n * ", " ");
    for said in ["Open, not identified: `a`, `b`, `c`", "| `a + c` | 0.7", "| `b - c` | -0.2"] {
        assert!(header.contains(said), "`{said}` is not in\n{header}");
    }
    let motions = [[0.3, 1.0, -2.0], [-2.0, 3.0, 5.0], [1.5, -4.0, 0.7], [3.0, 0.0, 1.0]];
    let mut program = String::from("bent_inputs u;");
    for [q, v, a] in motions {
        let _ = write!(
            program,
            "{{ bent_motion m; m.q.value = {q}; m.q.dot = {v}; m.q.ddot = {a}; bent_feed_forward(&m, &bent_identified, &u); printf(\"%.17g\\n\", u.tau); }}"
        );
    }
    if let Some(found) = numbers_of(at, "bent", &program) {
        for (motion, found) in motions.into_iter().zip(found) {
            let truth = bent(motion, BENT);
            assert!((found - truth).abs() < 1e-4 * (1.0 + truth.abs()), "{motion:?}: {found} {truth}");
        }
    }
    let validated = printed_in(at, &["validate", "bent.tpm", "--params", "r.json", "--log", "log.csv", "--json"], 0);
    let validated: Value = serde_json::from_str(&validated).expect("JSON");
    assert!(validated["prediction_error"].as_f64().expect("predicted") < 1e-3, "{validated}");
    let linear = printed_in(at, &["linearize", "bent.tpm", "--params", "r.json", "--at", "q=1", "--json"], 0);
    let linear: Value = serde_json::from_str(&linear).expect("JSON");
    let gain = linear["numbers"]["b"][1][0].as_f64().expect("a number");
    let truth = 1.0 / bent([1.0, 0.0, 1.0], BENT);
    assert!((gain - truth).abs() < 1e-4 * truth, "{gain} {truth}");
    // One value more settles the others, by what the data show.
    let set = printed_in(at, &["linearize", "bent.tpm", "--params", "r.json", "--value", "b=7", "--json"], 0);
    let set: Value = serde_json::from_str(&set).expect("JSON");
    let gain = set["numbers"]["b"][1][0].as_f64().expect("a number");
    assert!((gain - 1.25).abs() < 1e-4, "a + c = 0.8: {gain}");
}

/// A gravity that the data did not show is no number anywhere; where it is not needed all verbs work, where it is they name it.
#[test]
fn gravity_that_was_not_shown_is_no_number() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    write(at, "tilted.tpm", TILTED);
    log(at, "flat.csv", &|motion| tilted(motion, 0.0));
    log(at, "steep.csv", &|motion| tilted(motion, 0.5));
    let identify = ["identify", "tilted.tpm", "--log", "flat.csv", "--constant", "tilt=0", "--json", "-o", "r.json"];
    // The prior of another parameter states nothing of this one.
    assert_eq!(tpm_in(at, &[&identify[..], &["--prior", "J=1"]].concat()).status.code(), Some(1));
    let result = json(at, "r.json");
    let entry = parameter(&result, "mgl");
    assert!(entry["value"].is_null() && entry["std"].is_null() && entry["prior"].is_null(), "{entry}");
    assert!(entry.get("with_prior").is_none() && parameter(&result, "J")["prior"] == 1.0, "{result}");
    let generate = ["generate", "tilted.tpm", "--lang", "c", "--params", "r.json", "-o", "."];
    let named = ["the direction mgl", "tau needs it", "sin(q)", "a prior of mgl", "--prior", "--freeze"];
    fails(at, &generate, 2, &named);
    assert!(!at.join("tilted.c").exists());
    // An older result has a zero that nobody stated.
    let text = std::fs::read_to_string(at.join("r.json")).expect("written");
    let mut older: Value = serde_json::from_str(&text).expect("JSON");
    older["parameters"].as_array_mut().expect("a list").iter_mut().for_each(|entry| {
        if entry["prior"].is_null() {
            entry["prior"] = 0.0.into();
        }
    });
    write(at, "older.json", &older.to_string());
    fails(at, &["generate", "tilted.tpm", "--lang", "rust", "--params", "older.json"], 2, &named);
    // Flat, nothing needs it; tilted, the row is named.
    let linearize = ["linearize", "tilted.tpm", "--params", "r.json"];
    printed_in(at, &[&linearize[..], &["--value", "tilt=0"]].concat(), 0);
    fails(
        at,
        &[&linearize[..], &["--value", "tilt=0.5"]].concat(),
        2,
        &["mgl", "the entry of q in d/dt dot(q)", "--value mgl=VALUE"],
    );
    printed_in(at, &[&linearize[..], &["--value", "tilt=0.5", "--value", "mgl=16.7"]].concat(), 0);
    let validate = ["validate", "tilted.tpm", "--params", "r.json", "--log"];
    printed_in(at, &[&validate[..], &["flat.csv", "--constant", "tilt=0"]].concat(), 0);
    let steep = [&validate[..], &["steep.csv", "--constant", "tilt=0.5"]].concat();
    fails(at, &steep, 1, &["does not determine mgl", "tau", "a prior of mgl"]);
    let said = printed_in(at, &[&steep[..], &["--json"]].concat(), 1);
    let said: Value = serde_json::from_str(&said).expect("JSON");
    assert!(said["rows"].as_array().is_some_and(Vec::is_empty) && said["prediction_error"].is_null(), "{said}");
    assert_eq!((&said["unpredicted"][0]["name"], &said["unpredicted"][0]["direction"]), (&"tau".into(), &"mgl".into()));
    // A prior that was stated is used, and said to be one.
    assert_eq!(tpm_in(at, &[&identify[..], &["--prior", "mgl=16.7"]].concat()).status.code(), Some(1));
    let result = json(at, "r.json");
    let entry = parameter(&result, "mgl").clone();
    assert!(entry["value"].is_null() && entry["prior"] == 16.7 && entry["with_prior"] == 16.7, "{entry}");
    // A file of priors says the same; a value that is given singly stands above it.
    write(at, "prior.toml", "# of a drawing\nmgl = 16.7\n");
    for more in [&["--prior", "prior.toml"][..], &["--prior", "mgl=16.7", "--prior", "prior.toml"]] {
        assert_eq!(tpm_in(at, &[&identify[..], more].concat()).status.code(), Some(1));
        assert_eq!(*parameter(&json(at, "r.json"), "mgl"), entry);
    }
    for (text, named) in [
        ("mgl = \"heavy\"\n", "`mgl` is no finite number"),
        ("mgl = 16.7\nmgl = 3\n", "prior.toml"),
        ("mgl = nan\n", "`mgl` is no finite number"),
        ("# nothing\n", "no prior values"),
        ("mlg = 16.7\n", "mlg"),
    ] {
        write(at, "prior.toml", text);
        fails(at, &[&identify[..], &["--prior", "prior.toml"]].concat(), 2, &[named]);
    }
    fails(at, &[&identify[..], &["--prior", "mgl"]].concat(), 2, &["NAME=VALUE"]);
    fails(at, &[&identify[..], &["--prior", "none.toml"]].concat(), 2, &["none.toml"]);
    assert_eq!(tpm_in(at, &[&identify[..], &["--prior", "mgl=16.7"]].concat()).status.code(), Some(1));
    printed_in(at, &generate, 0);
    let header = std::fs::read_to_string(at.join("tilted.h")).expect("written").replace("\n * ", " ");
    assert!(header.contains("Prior, not identified: `mgl`"), "{header}");
    let program = "tilted_inputs u; tilted_motion m; tilted_constants c; m.q.value = 1.5; m.q.dot = 2; m.q.ddot = -3; \
                   c.tilt = 0.5; tilted_feed_forward(&m, &tilted_identified, &c, &u); printf(\"%.17g\\n\", u.tau);";
    if let Some(found) = numbers_of(at, "tilted", program) {
        let truth = tilted([1.5, 2.0, -3.0], 0.5);
        assert!((found[0] - truth).abs() < 1e-3, "{found:?} {truth}");
    }
    let output = tpm_in(at, &[&linearize[..], &["--value", "tilt=0.5"]].concat());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && said.contains("`mgl`; its value 16.7 is that of a stated prior"), "{said}");
    printed_in(at, &steep, 0);
}

/// Physical parameters that the data do not tell apart are not needed one by one.
#[test]
fn products_that_are_known_stand_for_their_factors() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    write(at, "pendulum.tpm", PENDULUM);
    log(at, "log.csv", &|[q, v, a]| 0.82 * a + 0.3 * v + 0.8 * 9.81 * q.sin());
    assert_eq!(
        tpm_in(at, &["identify", "pendulum.tpm", "--log", "log.csv", "--json", "-o", "r.json"]).status.code(),
        Some(0)
    );
    let result = json(at, "r.json");
    let physical = result["physical"].as_array().expect("a list");
    assert!(physical.iter().filter(|entry| entry["value"].is_null()).count() == 3, "{result}");
    let linear = |more: &[&str]| -> Vec<f64> {
        let text = printed_in(at, &[&["linearize", "pendulum.tpm", "--params", "r.json", "--json"], more].concat(), 0);
        let linear: Value = serde_json::from_str(&text).expect("JSON");
        let (a, b) = (&linear["numbers"]["a"][1], &linear["numbers"]["b"][1][0]);
        [&a[0], &a[1], b].iter().map(|entry| entry.as_f64().expect("a number")).collect()
    };
    for found in [linear(&[]), linear(&["--value", "m=4"])] {
        for (found, truth) in found.iter().zip([-0.8 * 9.81 / 0.82, -0.3 / 0.82, 1.0 / 0.82]) {
            assert!((found - truth).abs() < 1e-3 * truth.abs(), "{found} {truth}");
        }
    }
    let motion = ["--value", "A=0.5", "--value", "w=3"];
    let split = printed_in(at, &[&["split", "pendulum.tpm", "--params", "r.json"], &motion[..]].concat(), 0);
    assert!(split.contains("tau_independent"), "{split}");
    write(at, "motors.toml", "[motors.tau]\ntorque_constant = 0.5\nresistance = 1.0\ninductance = 1e-3\ngear = 20\n");
    let actuator = ["actuator", "pendulum.tpm", "--params", "r.json", "--motor", "motors.toml"];
    printed_in(at, &[&actuator[..], &motion[..]].concat(), 0);
    let feedback = "feedback_filtered = false\n[[feedback]]\ninput = \"tau\"\ncoordinate = \"q\"\nkp = 200\nkd = 20\n\
                    [filter]\nnatural_frequency = 300\nquality = 0.7\n";
    write(at, "loop.toml", feedback);
    let feed_forward = ["feedforward", "pendulum.tpm", "--params", "r.json", "--loop", "loop.toml"];
    printed_in(at, &[&feed_forward[..], &motion[..]].concat(), 0);
}

/// The arm of Feng, chapter 5, on one pattern: with priors the code is right along the pattern, without them it is refused.
#[test]
fn an_arm_on_one_pattern_keeps_its_combinations() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let models = root().join("models");
    let path = |name: &str| models.join(name).to_str().expect("plain").to_owned();
    let model = path("closed_loop_arm.tpm");
    let identify = |experiment: &str, out: &str| {
        // The simulation does not settle along this motion, which it takes a quarter of a minute to find out.
        let arguments = ["identify", &model, "--experiment", experiment, "--set", "refine=none", "--json", "-o", out];
        let output = tpm_in(at, &arguments);
        assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    };
    identify(&path("closed_loop_arm_thesis.toml"), "with.json");
    let text = std::fs::read_to_string(models.join("closed_loop_arm_thesis.toml")).expect("a shipped experiment");
    let is_prior = |line: &str| line.starts_with("[prior]") || line.starts_with('a') && line.contains(" = ");
    let text: Vec<&str> = text.lines().filter(|line| !is_prior(line)).collect();
    write(at, "without.toml", &text.join("\n"));
    identify("without.toml", "without.json");
    let without = json(at, "without.json");
    assert!(
        without["parameters"].as_array().expect("a list").iter().all(|entry| entry["prior"].is_null()),
        "{without}"
    );
    let generate = ["generate", model.as_str(), "--lang", "c", "--prefix", "arm", "-o", "."];
    fails(
        at,
        &[&generate[..], &["--params", "without.json"]].concat(),
        2,
        &["the direction 0.406472 a10 + 0.615048 a20 + a30", "tau1 needs it", "a prior of a10, a20, a30"],
    );
    printed_in(at, &[&generate[..], &["--params", "with.json"]].concat(), 0);
    let with = json(at, "with.json");
    let value = |name: &str| parameter(&with, name)["with_prior"].as_f64().expect("a prior was stated");
    for shown in with["combinations"].as_array().expect("a list") {
        let terms = shown["terms"].as_object().expect("weights");
        let weight = |text: &Value| text.as_str().and_then(|text| text.parse::<f64>().ok()).expect("a weight");
        let sum: f64 = terms.iter().map(|(name, text)| weight(text) * value(name)).sum();
        let expected = shown["value"].as_f64().expect("a number");
        assert!((sum - expected).abs() < 1e-6 * expected.abs().max(1.0), "{shown}: {sum}");
    }
    // The torque along the pattern is that of the combinations, whatever the prior: here those of the true machine's series differ by
    // other priors, which move along the hidden directions alone.
    let program = |shift: f64| {
        format!(
            "arm_parameters p = arm_identified; arm_inputs u; arm_motion m; arm_constants c; arm_pattern s; int n; \
             p.a10 += {shift} * 0.4064722604; p.a20 += {shift} * 0.615048121; p.a30 += {shift}; \
             s.lambda1 = -0.245393293; s.lambda2 = 0.199491133; s.w = 3.3; c.th10 = 0.2; c.th20 = 0.1; \
             for (n = 0; n < 7; n++) {{ arm_reference(&s, &c, (double)n, &m); arm_feed_forward(&m, &p, &c, &u); \
             printf(\"%.17g\\n%.17g\\n\", u.tau1, u.tau2); }}"
        )
    };
    let header = std::fs::read_to_string(at.join("arm.h")).expect("written");
    assert!(header.contains("Prior, not identified: `a10`"), "{header}");
    let Some(own) = numbers_of(at, "arm", &program(0.0)) else { return };
    let moved = numbers_of(at, "arm", &program(500.0)).expect("compiled before");
    let largest = own.iter().fold(0.0, |largest: f64, u| largest.max(u.abs()));
    assert!(
        largest > 100.0 && own.iter().zip(&moved).all(|(a, b)| (a - b).abs() < 1e-6 * largest),
        "{own:?} {moved:?}"
    );
}
