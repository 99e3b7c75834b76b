//! Models with the forces that they lacked, against a truth that is known.

use crate::arm_log;
use crate::completed::completed;
use crate::identification::Identification;
use crate::log::{LogRequest, from_log};
use crate::model::{DeclaredModel, Identifiable as _};

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
    let whole = machine(
        " + drag*dot(q1)*abs(dot(q1))",
        " + k*q2^3",
        ", drag [N*m*s^2/rad^2], k [N*m/rad^3]",
    );
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
        assert!((value - truth).abs() < 4.0 * std && std < 0.05 * truth, "{name}: {value} +- {std} of {truth}\n{found}");
    }
    assert!(found.log.as_ref().is_some_and(|log| log.prediction().is_none_or(|own| own.completed.is_none())), "{found}");
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
