//! Logs of an arm of two joints whose sensors are off: what the log would not show is said, and what is stated of them enters the deviations.

use crate::arm_log;
use crate::error::SessionError;
use crate::identification::Identification;
use crate::log::{LogRequest, from_log, from_logs};
use crate::log_fault::LogFault;
use crate::model::DeclaredModel;
use crate::warning::Warning;
use tpm_controller::harmonics::Hold;
use tpm_estimate::Refine;
use tpm_estimate::named::ParameterReport;

/// An arm in its base parameters: a link that is not symmetric about its axis has first moments in two directions (c and s, g and h).
const ARM: &str = "model Arm {
    coordinate q1 [rad], q2 [rad]; input u1 [N*m], u2 [N*m];
    parameter J1 [kg*m^2], J2 [kg*m^2], c [kg*m^2], s [kg*m^2], g1 [N*m], h1 [N*m], g2 [N*m], h2 [N*m], d1 [N*m*s/rad], d2 [N*m*s/rad];
    J1*ddot(q1) + J2*(ddot(q1) + ddot(q2)) + g1*cos(q1) + h1*sin(q1) + g2*cos(q1 + q2) + h2*sin(q1 + q2) + d1*dot(q1)
        + c*(cos(q2)*(2*ddot(q1) + ddot(q2)) - sin(q2)*(dot(q2)^2 + 2*dot(q1)*dot(q2)))
        + s*(sin(q2)*(2*ddot(q1) + ddot(q2)) + cos(q2)*(dot(q2)^2 + 2*dot(q1)*dot(q2))) = u1;
    J2*(ddot(q1) + ddot(q2)) + g2*cos(q1 + q2) + h2*sin(q1 + q2) + d2*dot(q2)
        + c*(cos(q2)*ddot(q1) + sin(q2)*dot(q1)^2) + s*(sin(q2)*ddot(q1) - cos(q2)*dot(q1)^2) = u2;
}";
/// A model of the first joint alone.
const ONE: &str = "model One { coordinate q1; input u1; parameter J, g; J*ddot(q1) + g*q1 = u1; }";
const TRUTH: [f64; 10] = [0.9, 0.15, 0.3, 0.02, 20.0, 1.0, 6.0, 0.4, 0.8, 0.5];

fn arm() -> DeclaredModel {
    DeclaredModel::parse("Arm", ARM).expect("a model")
}

/// A log in which the second joint reads so much more, rad, and the second torque so many times what it is.
fn log(zero: f64, gain: f64) -> tempfile::NamedTempFile {
    arm_log::log(&arm(), &TRUTH, zero, [1.0, gain])
}

fn request(file: &tempfile::NamedTempFile, stated: &[(&str, f64)]) -> LogRequest {
    let mut request = LogRequest::new(file.path()).hold(Hold::None);
    // What is tested is what the lines of the rows say.
    request.estimation.refine = Refine::None;
    request.estimation.calibration = stated.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    request
}

/// Errors of all parameters in their deviations.
fn scores(found: &Identification) -> Vec<f64> {
    let of = |(own, truth): (&ParameterReport, f64)| {
        (own.value.unwrap_or(f64::NAN) - truth).abs() / own.std.unwrap_or(f64::NAN)
    };
    found.parameters.iter().zip(TRUTH).map(of).collect()
}

/// The sensors of which a fault would not show.
fn unseen(found: &Identification) -> Vec<&str> {
    let faults = found.warnings.iter().filter_map(|warning| match warning {
        Warning::UnseenFaults { faults } => Some(faults),
        _ => None,
    });
    faults.flatten().map(|fault| fault.signal.as_str()).collect()
}

#[test]
fn a_zero_that_nothing_shows_is_said_and_enters_the_deviations_once_it_is_stated() {
    let file = log(0.02, 1.0);
    let silent = from_log(&arm(), request(&file, &[])).expect("identifies");
    assert!(unseen(&silent).contains(&"q2"), "{silent}");
    assert!(scores(&silent).iter().any(|score| *score > 5.0), "{:?}", scores(&silent));
    let stated = from_log(&arm(), request(&file, &[("q2", 0.02)])).expect("identifies");
    assert!(!unseen(&stated).contains(&"q2"), "{stated}");
    assert!(scores(&stated).iter().all(|score| *score < 3.5), "{:?}", scores(&stated));
    // Values do not change, and no deviation becomes smaller.
    for (own, other) in stated.parameters.iter().zip(&silent.parameters) {
        assert!(own.value == other.value && own.std >= other.std, "{own:?} {other:?}");
    }
}

#[test]
fn a_stated_gain_enters_the_deviations() {
    let file = log(0.0, 1.0);
    let [plain, stated] =
        [&[][..], &[("u2", 0.05)]].map(|stated| from_log(&arm(), request(&file, stated)).expect("identifies"));
    assert!(scores(&plain).iter().chain(&scores(&stated)).all(|score| *score < 4.0), "{plain}{stated}");
    let wider = |name: &str| {
        let of = |found: &Identification| found.parameters.iter().find(|own| own.name == name).and_then(|own| own.std);
        of(&stated).expect("a deviation") / of(&plain).expect("a deviation")
    };
    // Damping of the second joint stands in its row alone.
    assert!(wider("d2") > 2.0 && wider("d1") >= 1.0, "{} {}", wider("d2"), wider("d1"));
    assert!(!unseen(&stated).contains(&"u2"), "{stated}");
}

#[test]
fn calibrations_that_make_no_sense_are_refused() {
    let file = log(0.0, 1.0);
    let error = |stated: &[(&str, f64)]| from_log(&arm(), request(&file, stated)).expect_err("refused");
    assert!(matches!(error(&[("q3", 0.1)]), SessionError::UnknownName { name, .. } if name == "q3"));
    for value in [-0.1, f64::NAN, f64::INFINITY] {
        assert!(matches!(error(&[("q2", value)]), SessionError::Deviation { name, .. } if name == "q2"));
    }
    let two = from_logs(&arm(), [request(&file, &[("q2", 0.1)]), request(&file, &[])]);
    assert!(matches!(two, Err(SessionError::CalibrationOfLogs)));
    // Of a zero of a single coordinate nothing is told.
    let one = DeclaredModel::parse("One", ONE).expect("a model");
    let error = from_log(&one, request(&file, &[("q1", 0.1)])).expect_err("refused");
    assert!(matches!(&error, SessionError::Log(LogFault::Calibration { signal, .. }) if signal == "q1"), "{error}");
}

#[test]
fn the_gain_of_the_only_input_is_said_and_enters_all_deviations_once_it_is_stated() {
    let file = log(0.0, 1.0);
    let one = DeclaredModel::parse("One", ONE).expect("a model");
    let [plain, stated] =
        [&[][..], &[("u1", 0.1)]].map(|stated| from_log(&one, request(&file, stated)).expect("identifies"));
    let unseen = |found: &Identification| found.log.as_ref().and_then(|log| log.unseen_gain.clone());
    assert!(unseen(&stated).is_none(), "{stated}");
    for (own, other) in plain.parameters.iter().zip(&stated.parameters) {
        let [value, std, wider] = [own.value, own.std, other.std].map(|own| own.expect("identified"));
        assert!((wider / (0.1 * value).hypot(std) - 1.0).abs() < 1e-9, "{own:?} {other:?}");
    }
    let most = plain.parameters.iter().map(|own| own.value.unwrap_or(0.0).abs() / own.std.unwrap_or(1.0));
    let most = most.fold(0.0, f64::max);
    let said = unseen(&plain).map(|own| own.deviations);
    assert!(if 0.05 * most > 2.0 { said == Some(0.05 * most) } else { said.is_none() }, "{said:?} {most}");
}
