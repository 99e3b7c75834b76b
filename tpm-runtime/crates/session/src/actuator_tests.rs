//! Known and unknown dynamics of actuators, motors and their limits, in experiments and logs.

use crate::identify_log;
use crate::{Identification, identify_simulated};
use crate::{LogOptions, RecordSettings};
use tpm_campaign::{Campaign, Outcome};
use tpm_controller::harmonics::Hold;
use tpm_experiment::{Experiment, ExperimentError};
use tpm_log::Log;
use tpm_motion::{Dynamics, LowPass};
use tpm_plant::simulated::simulate;
use tpm_test_support::models::MassSpringDrag;
use tpm_test_support::rest_to_rest_3;

const FILE: &str = include_str!("../../../../models/mass_spring_drag.toml");
const MOTOR: &str = "[motors.u]\ntorque_constant = 0.115\nresistance = 4\ninductance = 7.7e-3\npinion_radius = 0.02\n";
const TRUTH: [f64; 3] = [2.0, 40.0, 1.5];

/// The shipped experiment without noise.
fn experiment(sets: &[(&str, &str)]) -> Experiment {
    let mut experiment = Experiment::parse(FILE).expect("the shipped file is right");
    for (key, value) in [("plant.sensors.x.noise", "0"), ("plant.sensors.x.step", "0")].iter().chain(sets) {
        experiment.apply_override(key, value).expect("known");
    }
    experiment
}

fn identified(experiment: &Experiment) -> Identification {
    identify_simulated(&MassSpringDrag, &rest_to_rest_3(), experiment, &mut |_| true).expect("runs")
}

fn worst(values: impl Iterator<Item = f64>) -> f64 {
    values.zip(TRUTH).map(|(value, truth)| (value / truth - 1.0).abs()).fold(0.0, f64::max)
}

const AMPLIFIER: &str = "{ delay = 0.0035, natural_frequency = 250.0, quality = 0.8 }";

#[test]
fn known_dynamics_are_corrected_and_unknown_ones_are_seen() {
    for (method, sharp) in [("measured-motion", 1e-6), ("error", 1e-4), ("hill", 1e-4), ("effort", 1e-4)] {
        let run = |sets: &[(&str, &str)]| {
            let all = [&[("estimator", method), ("updates_per_stage", "8"), ("max_runs", "40")], sets].concat();
            let found = identified(&experiment(&all));
            worst(found.current.iter().copied())
        };
        let ideal = run(&[]);
        let known = run(&[("actuators.u", AMPLIFIER)]);
        let unknown = run(&[("plant.actuators.u", AMPLIFIER)]);
        eprintln!("{method}: ideal {ideal:.2e}, corrected {known:.2e}, not corrected {unknown:.2e}");
        assert!(ideal < sharp && known < sharp, "{method}: {ideal:e} {known:e}");
        assert!(unknown > 1e-3, "{method}: {unknown:e}");
    }
}

#[test]
fn a_log_takes_the_same_correction() {
    let experiment = experiment(&[("actuators.u", AMPLIFIER)]);
    let model = &MassSpringDrag;
    let setup = experiment.setup(model, &rest_to_rest_3(), Hold::Zoh).expect("fits");
    let bench = experiment.bench(model).expect("fits");
    let campaign = Campaign::new(model, setup).expect("playable");
    let trial = campaign.next().expect("first");
    let record = simulate(model, &bench, trial).expect("regular");
    let channels = [record.coordinates, record.inputs].concat();
    let log = Log::from_samples("memory", record.sample_time, channels).expect("long enough");
    let error = |actuators: &[Dynamics], hold: Hold| {
        let options = LogOptions {
            reading: RecordSettings { hold, ..RecordSettings::default() },
            actuators: actuators.to_vec(),
            ..LogOptions::default()
        };
        let found = identify_log(model, &log, &options).expect("periodic");
        (worst(found.current.iter().copied()), found.residual, found.log.map_or(0, |log| log.actuators.len()))
    };
    let filter = Some(LowPass { natural_frequency: 250.0, quality: 0.8 });
    let known = Dynamics { delay: 0.0035, filter, bandwidth: None };
    let (corrected, left, reported) = error(&[known], Hold::Zoh);
    assert!(corrected < 1e-5 && left < 1e-5 && reported == 1, "{corrected:e} {left:e}");
    let (plain, residual, reported) = error(&[], Hold::Zoh);
    assert!(plain > 1e-3 && residual > 1e-2 && reported == 0, "{plain:e} {residual:e}");
    // A hold acts nearly like half a sample more of delay.
    let (instead, ..) = error(&[Dynamics { delay: 0.004, ..known }], Hold::None);
    assert!(instead > corrected && instead < 1e-3, "{instead:e}");
    eprintln!("log: corrected {corrected:.2e}, not corrected {plain:.2e}, hold as a delay {instead:.2e}");
}

#[test]
fn limits_of_a_motor_end_a_campaign_by_name() {
    for (limit, name, unit) in
        [("current = 8", "current", "A"), ("voltage = 40", "voltage", "V"), ("power = 200", "power", "W")]
    {
        let mut experiment = experiment(&[]);
        experiment.set_motors(&format!("{MOTOR}[motors.u.limits]\n{limit}\n")).expect("a motor file");
        let found = identified(&experiment);
        assert_eq!(found.outcome, Some(Outcome::EffortShare), "{:?}", found.warnings);
        let stop = found.stop.clone().expect("named");
        assert_eq!((stop.limit, stop.unit.as_deref(), stop.input.as_str()), (name, Some(unit), "u"));
        assert!(stop.share >= 0.7 && (limit.starts_with("power") || stop.harmonic.is_some()), "{stop}");
        assert!(found.is_complete() && found.runs.len() < 8);
        let text = stop.to_string();
        assert!(text.contains("sample") && text.contains(unit), "{text}");
        // Only the last stage is played, so that the run itself passes the limit.
        experiment.schedule.stages.drain(..3);
        let passed = identified(&experiment);
        let stop = passed.stop.clone().expect("named");
        assert!(stop.limit == name && stop.share >= 0.7, "{stop}");
        eprintln!("{limit}: {text}; at once: {:?} {stop}", passed.outcome);
    }
}

#[test]
fn limits_of_any_actuator_end_a_campaign_by_name() {
    for (limit, name) in [("{ force = 60.0 }", "force"), ("{ speed = 1.5 }", "speed"), ("{ power = 60.0 }", "power")] {
        let mut experiment = experiment(&[("actuators.u", limit)]);
        let found = identified(&experiment);
        assert_eq!(found.outcome, Some(Outcome::EffortShare), "{limit} {:?}", found.warnings);
        let stop = found.stop.clone().expect("named");
        assert_eq!((stop.limit, stop.input.as_str()), (name, "u"));
        assert!(stop.share >= 0.7 && stop.to_string().contains("lower the"), "{stop}");
        assert!(found.is_complete() && found.runs.len() < 8);
        // Only the last stage is played: the reference that is too fast is refused, and the run itself passes the other limits.
        experiment.schedule.stages.drain(..3);
        let setup = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::Zoh).expect("fits");
        match Campaign::new(&MassSpringDrag, setup) {
            Err(refused) => {
                let text = refused.to_string();
                assert!(text.contains(&format!("the {name} of u")) && text.contains("lower the"), "{text}");
            }
            Ok(_) => {
                let stop = identified(&experiment).stop.expect("named");
                assert!(stop.limit == name && stop.share >= 0.7, "{stop}");
            }
        }
    }
}

#[test]
fn the_simulated_actuator_keeps_its_power() {
    let weak = experiment(&[("plant.actuators.u", "{ power = 60.0 }")]);
    let found = identified(&weak);
    assert_eq!(found.outcome, Some(Outcome::InputLimit), "{:?}", found.warnings);
    let strong = experiment(&[("plant.actuators.u", "{ power = 4e4, force = 1e4, speed = 1e3 }")]);
    assert!(identified(&strong).is_complete());
}

#[test]
fn faults_name_their_place() {
    let fault = |sets: &[(&str, &str)]| {
        let experiment = experiment(sets);
        let found = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::Zoh);
        found.map(|_| ()).and_then(|()| experiment.bench(&MassSpringDrag).map(|_| ())).expect_err("a fault").to_string()
    };
    assert!(fault(&[("actuators.v", "{ delay = 1e-3 }")]).contains("actuators: the model has no input `v`"));
    assert!(fault(&[("actuators.u", "{ delay = -1e-3 }")]).starts_with("actuators.u.delay = -0.001"));
    assert!(fault(&[("plant.actuators.u", "{ quality = 2.0 }")]).contains("natural_frequency"));
    assert!(fault(&[("plant.actuators.u", "{ bandwidth = 0.0 }")]).starts_with("plant.actuators.u.bandwidth"));
    assert!(fault(&[("actuators.u", "{ power = -3.0 }")]).starts_with("actuators.u.power = -3"));
    assert!(fault(&[("motors", "none.toml")]).contains("none.toml was not read"));
    assert!(fault(&[("motors", "{ u = { resistance = 4.0 } }")]).contains("[motors.u] lacks `torque_constant`"));
    assert!(fault(&[("motion", "{ u = \"y\" }"), ("motors", "{ u = {} }")]).contains("no coordinate `y`"));
    let mut ambiguous = experiment(&[]);
    ambiguous.set_motors(MOTOR).expect("a motor file");
    ambiguous.control.feedback.clear();
    let found = ambiguous.mounted(&MassSpringDrag).expect_err("nothing is fed back");
    assert!(matches!(found, ExperimentError::Motors { .. }) && found.to_string().contains("motion = { u"), "{found}");
    ambiguous.motion.insert("u".into(), "x".into());
    assert_eq!(ambiguous.mounted(&MassSpringDrag).expect("stated").len(), 1);
    let missing = Experiment::parse("seed = 1\n").expect_err("no control").to_string();
    assert!(missing.contains("add [control] with sample_time"), "{missing}");
}
