//! Models with the forces that they lacked, against a truth that is known.

use crate::arm_log;
use crate::completed::completed;
use crate::identification::Identification;
use crate::log::{LogRequest, from_log};
use crate::model::{DeclaredModel, Identifiable as _};
use crate::validate::{Validation, validate};
use tpm_codegen::identified::Identified;

/// A machine of two joints, of which the second has its input on the left.
fn machine(first: &str, second: &str, declared: &str) -> DeclaredModel {
    let text = format!(
        "model Machine {{
    coordinate q1 [rad], q2 [rad];
    input u1 [N*m], u2 [N*m];
    parameter J1 [kg*m^2], g1 [N*m], fv1 [N*m*s/rad], fc1 [N*m], J2 [kg*m^2], fv2 [N*m*s/rad], fc2 [N*m]{declared};

    // The first joint lifts a load.
    J1*ddot(q1) + g1*sin(q1) + fv1*dot(q1) + fc1*sign(dot(q1)){first} = u1;
    u2 = J2*ddot(q2) + fv2*dot(q2) + fc2*sign(dot(q2)){second};
}}
"
    );
    DeclaredModel::parse("machine.tpm", &text).expect("a sound model")
}

const TRUTH: [f64; 7] = [2.0, 8.0, 3.0, 1.5, 1.2, 2.0, 1.0];

fn value(result: &Identification, name: &str) -> (f64, f64) {
    let own = result.parameters.iter().find(|own| own.name == name).expect("a parameter of this name");
    (own.value.expect("identified"), own.std.expect("a deviation"))
}

/// What is lacking stands in the text of the completed model, on the side of the model's own forces, with values that are right; the rest of
/// the text is the author's. With it nothing is left but noise.
#[test]
fn what_a_model_lacks_becomes_a_part_of_it() {
    let whole = machine(" + drag*dot(q1)*abs(dot(q1))", " + k*q2^3", ", drag [N*m*s^2/rad^2], k [N*m/rad^3]");
    let truth = [TRUTH.as_slice(), &[3.0, 9.0]].concat();
    let log = arm_log::log(&whole, &truth, 0.0, [1.0, 1.0]);
    let stated = machine("", "", "");
    let request = LogRequest::new(log.path());
    let result = from_log(&stated, request.clone()).expect("identifies");
    let prediction = result.log.as_ref().and_then(|log| log.prediction()).expect("something is lacking");
    let with = prediction.completed.as_ref().expect("terms make it better");
    for row in 0..2 {
        assert!(with.forces.held_out[row] < 0.3 * prediction.stated.held_out[row], "{prediction:?}");
    }
    let (model, found) = completed(&stated, vec![request], &result).expect("identifies").expect("terms");
    let text = model.text().text();
    assert!(text.contains("// The first joint lifts a load."), "{text}");
    assert!(text.contains("fc1*sign(dot(q1)) + drag_q1*dot(q1)*abs(dot(q1)) = u1;"), "{text}");
    assert!(text.contains("fc2*sign(dot(q2)) + k3_q2*q2^3;"), "{text}");
    let names = ["J1", "g1", "fv1", "fc1", "J2", "fv2", "fc2", "drag_q1", "k3_q2"];
    for (name, truth) in names.into_iter().zip(truth) {
        let (value, std) = value(&found, name);
        assert!(
            (value - truth).abs() < 4.0 * std && std < 0.05 * truth,
            "{name}: {value} +- {std} of {truth}\n{found}"
        );
    }
    assert!(
        found.log.as_ref().is_some_and(|log| log.prediction().is_none_or(|own| own.completed.is_none())),
        "{found}"
    );
}

/// A right model gets no term.
#[test]
fn a_model_that_lacks_nothing_stays_as_it_is() {
    let stated = machine("", "", "");
    let log = arm_log::log(&stated, &TRUTH, 0.0, [1.0, 1.0]);
    let request = LogRequest::new(log.path());
    let result = from_log(&stated, request.clone()).expect("identifies");
    assert!(completed(&stated, vec![request], &result).expect("identifies").is_none());
}

/// Weights that count all alike give the values of least squares over the samples, which no others undercut.
#[test]
fn equal_weights_leave_least_of_the_forces() {
    let whole = machine(" + drag*dot(q1)*abs(dot(q1))", "", ", drag [N*m*s^2/rad^2]");
    let log = arm_log::log(&whole, &[TRUTH.as_slice(), &[0.6]].concat(), 0.0, [1.0, 1.0]);
    let stated = machine("", "", "");
    let mut request = LogRequest::new(log.path());
    let by_noise = from_log(&stated, request.clone()).expect("identifies");
    request.estimation.weights = tpm_estimate::Weights::Equal;
    let nearest = from_log(&stated, request).expect("identifies");
    assert!(nearest.residual < 0.8 * by_noise.residual, "{} {}", nearest.residual, by_noise.residual);
    assert!(value(&nearest, "fv1").0 > value(&by_noise, "fv1").0 + 0.1, "drag counts as damping");
    assert_eq!(stated.evaluated().dims().parameters, TRUTH.len());
}

/// What predicts a log are the values nearest to the forces: those that hold beside what is missing leave more without it.
#[test]
fn a_model_that_lacks_something_predicts_with_the_values_nearest_to_the_forces() {
    let whole = machine(" + drag*dot(q1)*abs(dot(q1))", "", ", drag [N*m*s^2/rad^2]");
    let log = arm_log::log(&whole, &[TRUTH.as_slice(), &[0.6]].concat(), 0.0, [1.0, 1.0]);
    let stated = machine("", "", "");
    let result = from_log(&stated, LogRequest::new(log.path())).expect("identifies");
    let found = validate(&stated, LogRequest::new(log.path()), &result).expect("predicts");
    assert!(found.nearest_values);
    let text = serde_json::to_string(&result).expect("a result is JSON");
    let stored = Identified::from_json(&text).expect("reads what it wrote");
    let again = validate(&stated, LogRequest::new(log.path()), &stored).expect("predicts");
    assert!((again.rows[0].share - found.rows[0].share).abs() < 1e-9 * found.rows[0].share);
    let beside = validate(&stated, LogRequest::new(log.path()), Identified { nearest: Vec::new(), ..stored });
    let beside = beside.expect("predicts");
    assert!(!beside.nearest_values);
    let left = |found: &Validation| found.rows[0].share;
    assert!(left(&found) < 0.8 * left(&beside), "{} {}", left(&found), left(&beside));
    let whole = from_log(&whole, LogRequest::new(log.path())).expect("identifies");
    assert!(Identified::from(&whole).nearest_to_forces().is_none(), "a right model lacks nothing");
}

/// An input that acts later than it is recorded does so on the next log too: a prediction waits for it.
#[test]
fn a_prediction_takes_the_delay_of_an_input_that_was_found() {
    let stated = machine("", "", "");
    let log = arm_log::log(&stated, &TRUTH, 0.0, [1.0, 1.0]);
    let text = std::fs::read_to_string(log.path()).expect("a log");
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    // What acts on the first joint was commanded five samples, 20 ms, before.
    let early = |(k, row): (usize, &Vec<&str>)| -> Option<String> {
        let command = if k == 0 { row[3] } else { rows.get(k + 5)?[3] };
        Some([row[0], row[1], row[2], command, row[4]].join(","))
    };
    let commanded: Vec<String> = rows.iter().enumerate().map_while(early).collect();
    std::fs::write(log.path(), commanded.join("\n")).expect("written");
    let result = from_log(&stated, LogRequest::new(log.path())).expect("identifies");
    let found = validate(&stated, LogRequest::new(log.path()), &result).expect("predicts");
    assert!((found.delays["u1"] - 0.02).abs() < 1e-3 && found.delays.len() == 1, "{:?}", found.delays);
    let at_once = Identified { nearest: Vec::new(), ..Identified::from(&result) };
    let at_once = validate(&stated, LogRequest::new(log.path()), at_once).expect("predicts");
    assert!(found.rows[0].share < 0.3 * at_once.rows[0].share, "{} {}", found.rows[0].share, at_once.rows[0].share);
    let mut request = LogRequest::new(log.path());
    request.estimation.actuators.insert("u1".into(), tpm_motion::Dynamics::default());
    let told = validate(&stated, request, &result).expect("predicts");
    assert!(told.delays.is_empty(), "what is stated goes before what was found: {:?}", told.delays);
}

/// Friction that builds up after reversals is found where a model lacks something, and becomes a part of it: what it leaves at reversals is no
/// noise, and the completed model predicts another record.
#[test]
fn friction_that_builds_up_after_reversals_becomes_a_part_of_the_model() {
    let whole = machine(
        " + drag*dot(q1)*abs(dot(q1)) + fp*z1",
        " + fp*z2",
        ", drag [N*m*s^2/rad^2], fp [N*m]; presliding z1 of q1 over 0.004; presliding z2 of q2 over 0.004",
    );
    let log = arm_log::log(&whole, &[TRUTH.as_slice(), &[3.0, 2.0]].concat(), 0.0, [1.0, 1.0]);
    let stated = machine("", "", "");
    let request = LogRequest::new(log.path());
    let result = from_log(&stated, request.clone()).expect("identifies");
    let (model, found) = completed(&stated, vec![request.clone()], &result).expect("identifies").expect("terms");
    let text = model.text().text();
    for q in ["q1", "q2"] {
        assert!(text.contains(&format!("presliding built_up_{q} of {q} over ")), "{text}");
        assert!(text.contains(&format!(" + fp_{q}*built_up_{q}")), "{text}");
    }
    let left = |model: &DeclaredModel, found: &Identification| {
        let found = validate(model, request.clone(), found).expect("predicts");
        [found.rows[0].share, found.rows[1].share]
    };
    let (with, without) = (left(&model, &found), left(&stated, &result));
    assert!((0..2).all(|row| with[row] < 0.5 * without[row] && with[row] < 0.02), "{with:?} {without:?}\n{text}");
}

/// An arm of two links in a vertical plane; `near` is what is said of their inertias, and `loss` another loss of both drives.
fn arm(near: [&str; 2], loss: &str) -> DeclaredModel {
    let text = format!(
        "model Arm {{
    coordinate q1 [rad], q2 [rad];
    input u1 [N*m], u2 [N*m];

    mechanism {{
        gravity (0, 0, -9.81);
        body upper {{
            revolute q1 about y at (0, 0, 0.3);
            inertia parameters{};
        }}
        body fore on upper {{
            revolute q2 about y at (0.4, 0, 0);
            inertia parameters{};
        }}
        drive q1 by u1 with viscous, coulomb{loss};
        drive q2 by u2 with viscous, coulomb{loss};
    }}
}}
",
        near[0], near[1]
    );
    DeclaredModel::parse("arm.tpm", &text).expect("a sound model")
}

/// Gears rub the more the more they carry: the loss is told by the load that the arm's own inertias make, never by the recorded torque, which
/// explains itself.
#[test]
fn friction_that_grows_with_the_load_becomes_a_loss_of_the_drive() {
    let near = [" near (0, 1.5, 0, 0.1, 0, 0, 0, 0.5, 0, 0)", " near (2, 0.6, 0, 0.05, 0, 0, 0, 0.25, 0, 0)"];
    let whole = arm(near, ", load");
    let truth = |name: &str| match name {
        "fv_q1" | "fv_q2" => 2.0,
        "fc_q1" | "fc_q2" => 1.0,
        "fl_q1" | "fl_q2" => 0.08,
        "mx_fore" => 0.6,
        "mz_fore" => 0.05,
        "Iyy_fore" => 0.25,
        "mz_upper" => 0.1,
        "m_fore" => 2.0,
        "mx_upper" => 1.5,
        "Iyy_upper" => 0.5,
        other => panic!("{other}"),
    };
    let parameters = |model: &DeclaredModel| -> Vec<String> {
        let model = model.evaluated();
        (0..model.dims().parameters).map(|j| model.parameter(j).name.to_string()).collect()
    };
    let values: Vec<f64> = parameters(&whole).iter().map(|name| truth(name)).collect();
    let log = arm_log::log(&whole, &values, 0.0, [1.0, 1.0]);
    let request = LogRequest::new(log.path());
    let stated = arm(["", ""], "");
    let result = from_log(&stated, request.clone()).expect("identifies");
    let (model, found) = completed(&stated, vec![request], &result).expect("identifies").expect("a loss");
    let text = model.text().text();
    assert!(
        text.contains("drive q1 by u1 with viscous, coulomb, load;") && text.contains("inertia parameters near"),
        "{text}"
    );
    // What is seen together with others only has no value of its own.
    let alone = |name: &String| !["m_fore", "mx_upper", "Iyy_upper"].contains(&name.as_str());
    for name in parameters(&model).into_iter().filter(alone) {
        let (value, std) = value(&found, &name);
        let truth = truth(&name);
        assert!((value - truth).abs() < (4.0 * std).max(0.02 * truth), "{name}: {value} +- {std} of {truth}\n{found}");
    }
}
