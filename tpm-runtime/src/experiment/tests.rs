use super::{Experiment, ExperimentError, identify_simulated};
use crate::test_models::MassSpringDrag;
use crate::trajectory::tests::rest_to_rest_3;
use std::string::ToString;

const FILE: &str = include_str!("../../../models/mass_spring_drag.toml");

fn experiment() -> Experiment {
    Experiment::parse(FILE).expect("the shipped file is right")
}

#[test]
fn the_shipped_experiment_identifies_the_plant() {
    let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment(), &mut |_| true).expect("runs");
    assert!(result.is_complete(), "{:?} {:?}", result.outcome, result.warnings);
    assert!(result.runs.len() <= 8 && result.rank == 3);
    for (parameter, truth) in result.parameters.iter().zip([2.0, 40.0, 1.5]) {
        let value = parameter.value.expect("identified");
        assert!((value / truth - 1.0).abs() < 5e-3, "{parameter:?}");
    }
    let json = serde_json::to_value(&result).expect("serialises");
    assert_eq!(json["schema"], "tpm.identification/1");
    assert_eq!(json["parameters"][0]["status"], "identified");
    assert_eq!(json["runs"][0]["amplitudes"][0][0], "lambda");
    let again = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment(), &mut |_| true).expect("runs");
    assert_eq!(result, again, "the same seed gives the same result");
}

#[test]
fn limits_end_a_campaign() {
    let run = |sets: &[(&str, &str)]| {
        let mut experiment = experiment();
        for (key, value) in sets {
            experiment.apply_override(key, value).expect("known");
        }
        identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true).expect("runs")
    };
    let share = run(&[("plant.sensors.x.noise", "0"), ("counts", "0"), ("limits.inputs.u", "60")]);
    assert_eq!(share.outcome.expect("ended"), crate::procedure::Outcome::EffortShare);
    assert!(share.is_complete() && share.runs.len() < 8);
    // A force of 5 N cannot move this machine so far: the first run is stopped, a smaller one is not.
    let tight =
        [("plant.sensors.x.noise", "0"), ("counts", "0"), ("limits.inputs.u", "5"), ("limits.tracking.x", "0.01")];
    let backed = run(&tight);
    assert_eq!(backed.runs[0].ending, "tracking_bound");
    assert!(backed.is_complete() && backed.runs[1].amplitudes[0].1 < 0.2, "{:?}", backed.warnings);
    let weak = run(&[&tight[..], &[("max_aborts", "0")]].concat());
    assert_eq!(weak.outcome.expect("ended"), crate::procedure::Outcome::Aborted);
    assert!(!weak.is_complete() && weak.parameters[0].value.is_none());
    assert!(weak.warnings.iter().any(|w| w.contains("tracking")), "{:?}", weak.warnings);
}

#[test]
fn overrides_reach_every_value_and_say_what_was_meant() {
    let mut experiment = experiment();
    experiment.apply_override("seed", "7").expect("known");
    experiment.apply_override("plant.parameters.m", "3").expect("known");
    experiment.apply_override("schedule.stages.0.lambda", "0.25").expect("known");
    experiment.apply_override("estimator", "error").expect("known");
    experiment.apply_override("kp", "1500").expect("occurs once");
    experiment.apply_override("harmonics", "12").expect("optional");
    assert_eq!((experiment.seed, experiment.plant.parameters["m"]), (7, 3.0));
    assert_eq!(experiment.schedule.stages[0]["lambda"], 0.25);
    assert_eq!((experiment.control.feedback[0].kp, experiment.harmonics), (1500.0, Some(12)));
    let before = experiment.clone();
    for (key, value, expected) in [
        ("control.sample_tme", "1e-3", "control.sample_time"),
        ("sede", "1", "seed"),
        ("lambda", "0.3", "schedule.stages.1.lambda"),
        ("schedule.stages.9.lambda", "0.3", "schedule.stages.0.lambda"),
        ("estimator", "eror", "measured-motion"),
        ("seed", "many", "invalid type"),
    ] {
        let error = experiment.apply_override(key, value).expect_err(key).to_string();
        assert!(error.contains(key) && error.contains(expected), "{error}");
    }
    assert_eq!(experiment, before);
}

#[test]
fn unknown_fields_and_names_are_refused() {
    let unknown = FILE.replace("sub_steps", "substeps");
    let error = Experiment::parse(&unknown).expect_err("unknown field").to_string();
    assert!(error.contains("substeps") && error.contains("line"), "{error}");
    let mut misnamed = experiment();
    misnamed.plant.parameters.insert("k3".to_string(), 1.0);
    assert!(matches!(misnamed.bench(&MassSpringDrag), Err(ExperimentError::UnknownName { kind: "parameter", .. })));
    let mut missing = experiment();
    missing.plant.parameters.remove("m");
    assert!(matches!(missing.bench(&MassSpringDrag), Err(ExperimentError::Missing { .. })));
    let mut still = experiment();
    still.schedule.stages[0].insert("w".to_string(), 0.0);
    let hold = crate::harmonics::Hold::Zoh;
    assert!(matches!(still.setup(&MassSpringDrag, &rest_to_rest_3(), hold), Err(ExperimentError::Invalid { .. })));
    let mut share = experiment();
    share.limits.effort_share = 1.5;
    let error = share.setup(&MassSpringDrag, &rest_to_rest_3(), hold).expect_err("share above one").to_string();
    assert!(error.contains("limits.effort_share"), "{error}");
}
