//! Logs of machines with nonlinear parameters.

use crate::log_fault::LogFault;
use crate::{
    DeclaredModel, Finding, Identification, LogRequest, SessionError, Warning, from_log, inspect_for,
    on_simulated_plant, validate,
};
use std::f64::consts::PI;
use std::fmt::Write as _;
use tpm_codegen::identified::Identified;
use tpm_estimate::{Domain, Refine, Status};
use tpm_experiment::{Experiment, ExperimentError};

/// Samples of a period of 4 s, and periods.
const SAMPLES: usize = 800;
const PERIODS: usize = 3;

/// A log of the motion `sin(wt)/2 + sin(3wt + 1)/10 + 1/10` without noise.
fn log(force: impl Fn([f64; 3]) -> f64) -> tempfile::NamedTempFile {
    let mut text = String::from("t_s,q,u\n");
    for i in 0..SAMPLES * PERIODS {
        let (t, w) = (4.0 * i as f64 / SAMPLES as f64, PI / 2.0);
        let [(s, c), (s3, c3)] = [(w * t).sin_cos(), (3.0 * w * t + 1.0).sin_cos()];
        let q = 0.5 * s + 0.1 * s3 + 0.1;
        let v = w * (0.5 * c + 0.3 * c3);
        let a = -w * w * (0.5 * s + 0.9 * s3);
        writeln!(text, "{t:.6},{q:.15e},{:.15e}", force([q, v, a])).expect("a string takes everything");
    }
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("written");
    file
}

fn model(declarations: &str, row: &str) -> DeclaredModel {
    let text = format!("model M {{ coordinate q; input u; {declarations} J*ddot(q) + {row} = u; }}");
    DeclaredModel::parse("M", &text).expect("a model")
}

fn identify(model: &DeclaredModel, domain: Option<Domain>, force: impl Fn([f64; 3]) -> f64) -> Identification {
    let file = log(force);
    let mut request = LogRequest::new(file.path());
    request.estimation.refine = Refine::None;
    request.estimation.domain = domain;
    from_log(model, request).expect("identifies")
}

fn values(result: &Identification) -> Vec<f64> {
    result.parameters.iter().map(|parameter| parameter.value.unwrap_or(f64::NAN)).collect()
}

/// The torque of a motion: position, velocity, acceleration.
type Force = dyn Fn([f64; 3]) -> f64;

#[test]
fn exact_logs_give_exact_values() {
    let offset = model("parameter J, d, mgl; nonlinear parameter q0 from -0.5 to 0.5;", "d*dot(q) + mgl*sin(q - q0)");
    let smooth = model("parameter J, d, fc; nonlinear parameter vs from 0.05 to 5;", "d*dot(q) + fc*tanh(dot(q)/vs)");
    let soft = model(
        "parameter J, d, k; nonlinear parameter b from 0.1 to 3, q0 from -0.3 to 0.3;",
        "d*dot(q) + k*(q - q0)/(b + (q - q0)^2)",
    );
    let cases: [(&DeclaredModel, &Force, &[f64]); 3] = [
        (&offset, &|[q, v, a]| 0.1 * a + 0.05 * v + 0.8 * (q - 0.07_f64).sin(), &[0.1, 0.05, 0.8, 0.07]),
        (&smooth, &|[_, v, a]| 0.1 * a + 0.05 * v + 0.3 * (v / 0.6).tanh(), &[0.1, 0.05, 0.3, 0.6]),
        (
            &soft,
            &|[q, v, a]| 0.1 * a + 0.05 * v + 0.4 * (q + 0.1) / (0.7 + (q + 0.1) * (q + 0.1)),
            &[0.1, 0.05, 0.4, 0.7, -0.1],
        ),
    ];
    for (model, force, truth) in cases {
        let result = identify(model, Some(Domain::Harmonics), force);
        for (found, truth) in values(&result).iter().zip(truth) {
            assert!((found - truth).abs() < 1e-6 * truth.abs(), "{found} {truth}: {result}");
        }
        assert!(result.is_complete(), "{result}");
        let file = log(force);
        let json = serde_json::to_string(&result).expect("serialises");
        assert!(json.contains("\"interval\""), "{json}");
        let known = Identified::from_json(&json).expect("reads back");
        let validation = validate(model, file.path(), known).expect("validates");
        assert!(validation.prediction_error.is_some_and(|error| error < 1e-4), "{validation:?}");
    }
}

#[test]
fn an_interval_without_the_truth_is_said() {
    let model = model("parameter J, mgl; nonlinear parameter q0 from 0.1 to 0.5;", "mgl*sin(q - q0)");
    let result = identify(&model, None, |[q, _, a]| 0.1 * a + 0.8 * (q - 0.05).sin());
    let ended = |warning: &Warning| matches!(warning, Warning::EndOfInterval { end, .. } if (end - 0.1).abs() < 1e-12);
    assert!(result.warnings.iter().any(ended), "{result}");
    assert!(!result.is_complete() && result.parameters.iter().all(|own| own.status != Status::Identified), "{result}");
}

#[test]
fn what_a_log_does_not_show_has_no_value() {
    // An offset of the position and one of the force are the same.
    let offsets = model("parameter J, k, c; nonlinear parameter q0 from -0.5 to 0.5;", "k*(q - q0) + c");
    let result = identify(&offsets, None, |[q, _, a]| 0.1 * a + 0.8 * (q - 0.05) + 0.3);
    let status = |j: usize| result.parameters[j].status;
    assert_eq!([2, 3].map(status), [Status::Unobservable; 2], "{result}");
    assert_eq!([0, 1].map(status), [Status::Identified; 2], "{result}");
    // Without friction nothing depends on the velocity over which it rises.
    let smooth = model("parameter J, k, fc; nonlinear parameter vs from 0.05 to 2;", "k*q + fc*tanh(dot(q)/vs)");
    // Noise looks like a little friction in one record of four, which then shows the velocity poorly.
    let rough = |q: f64| 1e-3 * (1e5 * q).sin();
    let shown = |k: u32| {
        let result = identify(&smooth, None, |[q, v, a]| 0.1 * a + 0.8 * q + rough(q + v + f64::from(k)));
        let own = &result.parameters[3];
        assert!(matches!(own.status, Status::Unobservable | Status::PoorlyDetermined), "{result}");
        assert!(own.status != Status::Unobservable || own.value.is_none(), "{result}");
        own.status != Status::Unobservable
    };
    let shown = (0..8).filter(|&k| shown(k)).count();
    assert!(shown <= 4, "{shown}");
}

#[test]
fn harmonics_of_a_log_that_hardly_repeats_are_refused() {
    let (fall, lines) = (0.15, [(0.5, 0.05, 0.0), (0.2, 0.153, 1.0), (0.08, 0.61, 2.0)]);
    let mut text = String::from("t_s,q,u\n");
    for i in 0..4000 {
        let t = 0.01 * f64::from(i);
        let (mut q, mut v, mut a) = (0.0, 0.0, 0.0);
        for (amplitude, frequency, phase) in lines {
            let w = 2.0 * PI * frequency;
            let (s, c) = (w * t + phase).sin_cos();
            (q, v, a) = (q + amplitude * s, v + amplitude * w * c, a - amplitude * w * w * s);
        }
        let force = 0.1 * a + 0.05 * v + (0.3 + 0.2 * (-(v / fall).powi(2)).exp()) * v.signum();
        writeln!(text, "{t},{q:.12e},{force:.12e}").expect("a string takes everything");
    }
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("written");
    let stribeck = model(
        "parameter J, d, fc, fs; nonlinear parameter vs from 0.02 to 2;",
        "d*dot(q) + (fc + fs*exp(-(dot(q)/vs)^2))*sign(dot(q))",
    );
    let mut request = LogRequest::new(file.path());
    request.estimation.refine = Refine::None;
    let found = from_log(&stribeck, request.clone()).expect("identifies");
    assert!((found.parameters[4].value.unwrap_or(0.0) - fall).abs() < 0.05 * fall, "{found}");
    request.estimation.domain = Some(Domain::Harmonics);
    let error = from_log(&stribeck, request).expect_err("runs away");
    assert!(matches!(error, SessionError::Log(LogFault::RunsAway { .. })), "{error}");
}

#[test]
fn settings_of_a_nonlinear_parameter_that_make_no_sense_are_refused() {
    let smooth = model("parameter J, fc; nonlinear parameter vs from 0.05 to 2;", "fc*tanh(dot(q)/vs)");
    let mut beyond = LogRequest::new("never opened");
    beyond.estimation.frozen.insert("vs".into(), 5.0);
    let error = from_log(&smooth, beyond).expect_err("outside");
    assert!(matches!(error, SessionError::OutsideInterval { value: 5.0, .. }), "{error}");
    let error = from_log(&smooth, LogRequest::new("never opened").constant("vs", 1.0)).expect_err("no constant");
    assert!(matches!(error, SessionError::ParameterAsConstant { .. }), "{error}");
}

#[test]
fn inspection_finds_nonlinear_parameters_as_identification_does() {
    let smooth = model("parameter J, d, fc; nonlinear parameter vs from 0.05 to 5;", "d*dot(q) + fc*tanh(dot(q)/vs)");
    let file = log(|[_, v, a]| 0.1 * a + 0.05 * v + 0.3 * (v / 0.6).tanh());
    let inspection = inspect_for(&smooth, file.path()).expect("inspects");
    assert!(inspection.identification.is_some(), "{inspection}");
    let doubt = |finding: &Finding| matches!(finding, Finding::Refused { .. } | Finding::Identification { .. });
    assert!(!inspection.findings.iter().any(doubt), "{inspection}");
}

#[test]
fn campaigns_take_a_nonlinear_parameter_as_known() {
    let text = include_str!("../../../../models/stribeck_pendulum.tpm");
    let stribeck = DeclaredModel::parse("stribeck_pendulum", text).expect("the shipped model is right");
    let mut experiment = Experiment::parse(include_str!("../../../../models/stribeck_pendulum.toml"))
        .expect("the shipped file is right");
    experiment.schedule.stages.remove(0);
    experiment.schedule.measure_time = 5.0;
    experiment.refine = Refine::None;
    let result = on_simulated_plant(&stribeck, experiment.clone()).expect("identifies");
    let last = result.parameters.last().expect("there are parameters");
    assert_eq!((last.name.as_str(), last.value, last.std, last.status), ("vs", Some(0.15), Some(0.0), Status::Frozen));
    assert!(result.covariance.len() == 6 && result.covariance.iter().all(|row| row.len() == 6), "{result}");
    let known = |warning: &Warning| matches!(warning, Warning::TakenAsKnown { parameter, .. } if parameter == "vs");
    assert!(result.warnings.iter().any(known), "{result}");
    experiment.constants.insert("vs".into(), 5.0);
    let error = on_simulated_plant(&stribeck, experiment).expect_err("outside");
    assert!(matches!(error, SessionError::Experiment(ExperimentError::OutsideInterval { .. })), "{error}");
}
