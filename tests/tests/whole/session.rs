//! Identification in three lines: the same from a model file and from a compiled model, on whatever plays the runs.

use std::fmt::Write as _;
use tpm_runtime::estimate::Status;
use tpm_runtime::experiment::Experiment;
use tpm_runtime::report::Remedy;
use tpm_runtime::session::{
    self, DeclaredModel, Identification, LogRequest, Session, SessionError, SimulatedMachine, Source, Warning,
};

tpm_runtime::model! {
    model Pendulum {
        coordinate q [rad];
        input tau [N*m];
        parameter m [kg], L [m], b [N*m*s];
        constant g = 9.81 [m/s^2];

        m*L^2*ddot(q) + b*dot(q) + m*g*L*sin(q) = tau;
    }
}

const PENDULUM: &str = "model Pendulum { coordinate q [rad]; input tau [N*m]; parameter m [kg], L [m], b [N*m*s];
    constant g = 9.81 [m/s^2]; m*L^2*ddot(q) + b*dot(q) + m*g*L*sin(q) = tau; }";

/// Five periods of a pendulum of 0.8 kg, 0.5 m and 0.02 N m s that swings on two harmonics.
fn swinging() -> String {
    let mut text = String::from("t_s,q,tau\n");
    let (m, l, b) = (0.8, 0.5, 0.02);
    for n in 0..5000 {
        let t = f64::from(n) * 2e-3;
        let w = std::f64::consts::PI;
        let (mut q, mut v, mut a) = (0.0, 0.0, 0.0);
        for (k, size) in [(1.0, 0.9), (2.0, 0.3)] {
            let (sin, cos) = (k * w * t).sin_cos();
            (q, v, a) = (q + size * sin, v + size * k * w * cos, a - size * k * k * w * w * sin);
        }
        writeln!(text, "{t},{q},{}", m * l * l * a + b * v + m * 9.81 * l * q.sin()).expect("a string");
    }
    text
}

fn values(result: &Identification) -> Vec<(&str, f64)> {
    let known = result.parameters.iter().chain(&result.physical);
    known.map(|p| (p.name.as_str(), p.value.expect("identified"))).collect()
}

#[test]
fn a_log_gives_the_same_from_a_file_and_from_a_compiled_model_with_its_physical_parameters() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, log) = (folder.path().join("pendulum.tpm"), folder.path().join("run.csv"));
    std::fs::write(&file, PENDULUM).expect("written");
    std::fs::write(&log, swinging()).expect("written");
    let read = session::from_log(&DeclaredModel::open(&file).expect("a model"), log.as_path()).expect("identifies");
    let compiled = session::from_log(&Pendulum, log.as_path()).expect("identifies");
    for result in [&read, &compiled] {
        assert_eq!((result.source, result.physical.len()), (Source::Log, 3));
        for (parameter, truth) in result.physical.iter().zip([0.8, 0.5, 0.02]) {
            let value = parameter.value.expect("identified");
            assert!(parameter.status == Status::Identified && (value / truth - 1.0).abs() < 1e-6, "{parameter:?}");
        }
        assert_eq!(result.shortfall(), None);
        let text = result.to_string();
        assert!(text.contains("physical parameters\n") && !text.contains("--"), "{text}");
    }
    for ((name, a), (other, b)) in values(&read).iter().zip(values(&compiled)) {
        assert!(*name == other && (a - b).abs() <= 1e-12 * a.abs(), "{name}: {a} {b}");
    }
    let provenance = &read.provenance;
    assert!(provenance.model.is_some() && provenance.logs.len() == 1 && provenance.logs[0].hash.len() == 16);
    assert_ne!(provenance.model, compiled.provenance.model, "the texts differ in their line breaks");
    let json = serde_json::to_value(&read).expect("plain values");
    assert_eq!((&json["schema"], &json["source"]), (&"tpm.identification/2".into(), &"log".into()));
    assert_eq!(json["warnings"].as_array().map(Vec::len), json["findings"].as_array().map(Vec::len));
}

#[test]
fn what_is_wrong_is_said_with_its_remedy_as_data() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("run.csv");
    std::fs::write(&log, swinging().replace("t_s,q,tau", "t_s,angle,tau")).expect("written");
    let error = session::from_log(&Pendulum, log.as_path()).expect_err("no such column");
    let guess = vec![("q".to_owned(), "angle".to_owned())];
    assert_eq!(error.remedy(), Some(Remedy::Columns { columns: guess, timeless: false }));
    assert!(!error.to_string().contains("--"), "{error}");
    let mapped = session::from_log(&Pendulum, LogRequest::new(&log).map("q", "angle")).expect("identifies");
    assert!(!mapped.warnings.iter().any(|warning| matches!(warning, Warning::Unexplained { .. })));
    let mut request = LogRequest::new(&log).map("q", "angle");
    request.estimation.prior.insert("mass".to_owned(), 1.0);
    let error = session::from_log(&Pendulum, request).expect_err("no such parameter");
    assert!(matches!(&error, SessionError::UnknownName { name, .. } if name == "mass"), "{error}");
}

fn experiment() -> Experiment {
    let mut experiment = Experiment::parse(include_str!("../../../models/mass_spring_drag.toml")).expect("shipped");
    experiment.schedule.max_runs = 3;
    experiment.schedule.measure_time = 6.0;
    experiment
}

#[test]
fn the_simulated_machine_is_one_more_bench() {
    let model = tpm_models::MassSpringDrag;
    assert!(
        tpm_runtime::Model::<f64>::source(&model)
            .is_some_and(|text| text.contains("m*ddot(x) + k1*x + k2*dot(x)^2 = u"))
    );
    let simulated = session::on_simulated_plant(&model, experiment()).expect("runs");
    let declared =
        DeclaredModel::parse("model", include_str!("../../../models/mass_spring_drag.tpm")).expect("shipped");
    let own = Session::new(declared.clone(), experiment(), None, Default::default()).expect("a session");
    let played = session::on_machine(&declared, experiment(), &mut SimulatedMachine::new(&own)).expect("runs");
    assert_eq!((simulated.source, played.source), (Source::SimulatedPlant, Source::Machine));
    // Only who simulated a machine knows its true values.
    let mut parameters = simulated.parameters.clone();
    for (parameter, truth) in parameters.iter_mut().zip([2.0, 40.0, 1.5]) {
        assert_eq!(parameter.truth.take(), Some(truth));
    }
    assert_eq!((&parameters, &simulated.runs), (&played.parameters, &played.runs));
    assert_eq!((simulated.provenance.seed, played.provenance.seed), (Some(1), None));
}

#[test]
fn a_machine_that_fails_ends_the_campaign_with_its_own_words() {
    struct Broken;
    impl tpm_runtime::motion::Bench for Broken {
        fn play(
            &mut self,
            _: &tpm_runtime::motion::Trial,
        ) -> Result<tpm_runtime::motion::Record, tpm_runtime::motion::BenchError> {
            Err("the drive does not answer".into())
        }
    }
    let error = session::on_machine(&tpm_models::MassSpringDrag, experiment(), &mut Broken).expect_err("broken");
    assert_eq!(error.to_string(), "the machine: the drive does not answer");
}

#[test]
fn a_reference_beyond_a_limit_of_position_or_velocity_is_refused_before_anything_moves() {
    let stage = experiment().schedule.stages[0].values["lambda"];
    let mut wide = experiment();
    wide.limits.positions.insert("x".to_owned(), [-2.0 * stage, 0.5 * stage]);
    let error = session::on_simulated_plant(&tpm_models::MassSpringDrag, wide).expect_err("beyond");
    assert!(
        error.to_string().contains("schedule.stages.0") && error.to_string().contains("limits.positions.x"),
        "{error}"
    );
    let mut fast = experiment();
    fast.limits.velocities.insert("x".to_owned(), 0.01);
    let error = session::on_simulated_plant(&tpm_models::MassSpringDrag, fast).expect_err("beyond");
    assert!(error.to_string().contains("limits.velocities.x"), "{error}");
    // A machine that overshoots its reference by the tracking error is stopped at the limit, and the campaign backs off.
    let mut tight = experiment();
    let peak = stage * 8.0 / 9.0;
    tight.limits.positions.insert("x".to_owned(), [-1.0, peak + 1e-4]);
    tight.schedule.stages.truncate(1);
    let backed = session::on_simulated_plant(&tpm_models::MassSpringDrag, tight).expect("runs");
    assert_eq!(backed.runs[0].ending, tpm_runtime::motion::RunEnding::PositionBound);
    assert!(backed.runs[1].amplitudes[0].1 < backed.runs[0].amplitudes[0].1, "{:?}", backed.runs);
}

mod joint {
    tpm_runtime::model! {
        model Joint {
            coordinate q [rad];
            presliding z of q over 0.01;
            input tau [N*m];
            parameter J [kg*m^2], fv [N*m*s/rad], fp [N*m];

            J*ddot(q) + fv*dot(q) + fp*z = tau;
        }
    }
}

/// Friction that builds up after reversals has no column, whichever way the model comes: it is followed along the angle, here with Dahl's
/// equation solved by Euler's rule in fine steps.
#[test]
fn friction_that_builds_up_is_followed_in_compiled_models_too() {
    use tpm_runtime::model::Model as _;
    let compiled = joint::Joint;
    let own = compiled.presliding(1).expect("the second coordinate follows");
    assert_eq!(
        (own.of, own.travel, <joint::Joint as tpm_runtime::Model<f64>>::presliding(&compiled, 0)),
        (0, 0.01, None)
    );
    let (mut text, mut built, steps, h) = (String::from("t_s,q,tau\n"), 0.0, 100, 2e-3);
    let joint = |t: f64| {
        let (mut q, mut v, mut a) = (0.0, 0.0, 0.0);
        for (w, size) in [(2.0, 0.6), (5.3, 0.2)] {
            let (sin, cos) = (w * t).sin_cos();
            (q, v, a) = (q + size * sin, v + size * w * cos, a - size * w * w * sin);
        }
        (q, v, a)
    };
    for n in 0..10_000 {
        let t = f64::from(n) * h;
        let (q, v, a) = joint(t);
        writeln!(text, "{t},{q:.7},{:.7}", 0.5 * a + 0.2 * v + 1.5 * built).expect("a string");
        for step in 0..steps {
            let moved = h / f64::from(steps) * joint(t + h * (f64::from(step) + 0.5) / f64::from(steps)).1;
            built += (moved - moved.abs() * built) / 0.01;
        }
    }
    let log = LogRequest::of_bytes("joint.csv", std::sync::Arc::new(text.into_bytes()));
    let found = session::from_log(&compiled, log.clone()).expect("identifies");
    let looked = session::inspect_for(&compiled, log.clone()).expect("has all columns");
    assert_eq!(looked.channels.iter().map(|own| own.name.as_str()).collect::<Vec<_>>(), ["q", "tau"]);
    let predicted = session::validate(&compiled, log, &found).expect("predicts");
    assert!(predicted.rows[0].share < 0.01 && predicted.simulation.is_none(), "{predicted:?}");
    for (own, truth) in found.parameters.iter().zip([0.5, 0.2, 1.5]) {
        let value = own.value.expect("shown");
        assert!((value - truth).abs() < 0.01 * truth, "{} {value} of {truth}\n{found}", own.name);
    }
}
