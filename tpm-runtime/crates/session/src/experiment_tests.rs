//! Experiments from their file to the result.

use crate::{SessionError, identify_simulated};
use tpm_experiment::{Experiment, ExperimentError, Value};
use tpm_motion::RunEnding;
use tpm_test_support::models::MassSpringDrag;
use tpm_test_support::rest_to_rest_3;

const FILE: &str = include_str!("../../../../models/mass_spring_drag.toml");

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
    assert_eq!(json["schema"], "tpm.identification/2");
    assert_eq!(json["parameters"][0]["status"], "identified");
    assert_eq!(json["runs"][0]["amplitudes"][0][0], "lambda");
    let again = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment(), &mut |_| true).expect("runs");
    assert_eq!(result, again, "the same seed gives the same result");
}

#[test]
fn a_line_of_noise_far_above_the_motion_is_no_motion() {
    // In its second run harmonic 988 of the encoder has 25 times the power of its noise.
    let mut unlucky = experiment();
    unlucky.seed = 20389;
    let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &unlucky, &mut |_| true).expect("runs");
    assert!(result.is_complete(), "{:?}", result.warnings);
    for (parameter, truth) in result.parameters.iter().zip([2.0, 40.0, 1.5]) {
        let value = parameter.value.expect("identified");
        assert!((value / truth - 1.0).abs() < 1e-3, "{parameter:?}");
    }
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
    let share = run(&[("plant.sensors.x.noise", "0"), ("plant.sensors.x.step", "0"), ("limits.inputs.u", "60")]);
    assert_eq!(share.outcome.expect("ended"), tpm_campaign::Outcome::EffortShare);
    assert!(share.is_complete() && share.runs.len() < 8);
    // A force of 5 N cannot move this machine so far: the first run is aborted, a run with smaller amplitudes is not.
    let tight = [
        ("plant.sensors.x.noise", "0"),
        ("plant.sensors.x.step", "0"),
        ("limits.inputs.u", "5"),
        ("limits.tracking.x", "0.01"),
    ];
    let backed = run(&tight);
    assert_eq!(backed.runs[0].ending, RunEnding::TrackingBound);
    assert!(backed.is_complete() && backed.runs[1].amplitudes[0].1 < 0.2, "{:?}", backed.warnings);
    let weak = run(&[&tight[..], &[("max_aborts", "0")]].concat());
    assert_eq!(weak.outcome.expect("ended"), tpm_campaign::Outcome::Aborted);
    assert!(!weak.is_complete() && weak.parameters[0].value.is_none());
    assert!(weak.warnings.iter().any(|w| w.to_string().contains("tracking")), "{:?}", weak.warnings);
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
    assert_eq!(experiment.schedule.stages[0].values["lambda"], 0.25);
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
fn values_are_set_as_they_are() {
    let mut experiment = experiment();
    let third = 1.0 / 3.0;
    experiment.set_value("plant.parameters.m", Value::Float(third)).expect("known");
    experiment.set_value("schedule.avoid_modes", Value::Boolean(true)).expect("known");
    assert!(experiment.plant.parameters["m"].to_bits() == third.to_bits() && experiment.schedule.avoid_modes);
    let error = experiment.set_value("seed", Value::Float(third)).expect_err("no whole number").to_string();
    assert!(error.contains("seed") && error.contains("invalid type"), "{error}");
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
    // The simulated machine does not obey the model and has values of its own: overrides of the model's true values
    // would change nothing.
    let mut arm = Experiment::parse(include_str!("../../../../models/closed_loop_arm.toml")).expect("the shipped file");
    arm.plant.sensors.clear();
    for key in ["plant.parameters.m3", "plant.drift.a10"] {
        arm.apply_override(key, "-1").expect("a table of values");
        let refused = arm.bench(&MassSpringDrag).expect_err("not the arm's");
        assert!(matches!(&refused, ExperimentError::NotOfMachine { key: named } if named == key), "{refused}");
        arm.plant.parameters.clear();
    }
    let mut still = experiment();
    still.schedule.stages[0].values.insert("w".to_string(), 0.0);
    let hold = tpm_controller::harmonics::Hold::Zoh;
    assert!(matches!(still.setup(&MassSpringDrag, &rest_to_rest_3(), hold), Err(ExperimentError::Invalid { .. })));
    let mut share = experiment();
    share.limits.effort_share = 1.5;
    let error = share.setup(&MassSpringDrag, &rest_to_rest_3(), hold).expect_err("share above one").to_string();
    assert!(error.contains("limits.effort_share"), "{error}");
}

#[test]
fn parameters_that_drift_are_followed() {
    let run = |forgetting: &str| {
        let mut experiment = experiment();
        let sets = [
            ("plant.drift.k1", "0.01"),
            ("schedule.forgetting", forgetting),
            ("schedule.measure_time", "8"),
            ("schedule.max_runs", "12"),
            ("schedule.stages", "[{ lambda = 0.3, w = 3.2 }]"),
            ("schedule.tolerance", "1e-9"),
            ("schedule.updates_per_stage", "12"),
        ];
        for (key, value) in sets {
            experiment.apply_override(key, value).expect("known");
        }
        identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true).expect("runs")
    };
    let error = |result: &crate::Identification| {
        let truth = 40.0 * 1.01_f64.powi(result.runs.len() as i32 - 1);
        (result.parameters[1].value.expect("identified") / truth - 1.0).abs()
    };
    let (following, remembering) = (run("0.3"), run("1"));
    assert_eq!(following.outcome, Some(tpm_campaign::Outcome::Followed));
    assert_eq!(following.runs.len(), 12);
    // With forgetting, an old run has little weight: the remaining error is about half the drift of one run.
    assert!(error(&following) < 0.008, "{:e}", error(&following));
    assert!(error(&remembering) > 2.0 * error(&following), "{:e} {:e}", error(&remembering), error(&following));
}

#[test]
fn lower_gains_show_more_and_are_checked() {
    let mut experiment = experiment();
    for (key, value) in [("schedule.gains", "[1.0, 0.25, 0.25, 0.25]"), ("schedule.updates_per_stage", "1")] {
        experiment.apply_override(key, value).expect("known");
    }
    let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true).expect("runs");
    assert!(result.is_complete(), "{:?}", result.warnings);
    assert!(result.parameters.iter().all(|p| p.std.is_some()));
    // The first run starts from estimates of zero: a quarter of the gains lets the tracking error grow.
    experiment.schedule.gains = vec![0.25];
    let weak = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| false).expect("runs");
    let (error, larger) = (result.runs[0].tracking_rms[0], weak.runs[0].tracking_rms[0]);
    assert!(larger > 2.0 * error, "{larger} {error}");
    // A negative spring constant, and a factor on the gains with which the loop is unstable.
    experiment.apply_override("prior", "{ m = 2.0, k1 = -900.0, k2 = 1.5 }").expect("known");
    experiment.schedule.gains.clear();
    assert!(identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| false).is_ok());
    experiment.schedule.gains = vec![1.0, 0.25];
    let refused = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| false);
    assert!(matches!(refused, Err(SessionError::Experiment(ExperimentError::Stability(_)))), "{refused:?}");
    experiment.schedule.gains = vec![1.0; 9];
    let refused = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| false);
    assert!(matches!(refused, Err(SessionError::Experiment(ExperimentError::Invalid { .. }))), "{refused:?}");
}

#[test]
fn a_sensor_that_drops_out_ends_the_campaign_and_what_was_known_stays() {
    let mut experiment = experiment();
    experiment.apply_override("plant.sensors.x.dropout", "{ run = 2, time = 7.5 }").expect("known");
    let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true).expect("runs");
    assert_eq!(result.outcome, Some(tpm_campaign::Outcome::SensorLost));
    assert_eq!((result.runs.len(), result.runs[1].ending), (2, RunEnding::SensorLost));
    for (parameter, truth) in result.parameters.iter().zip([2.0, 40.0, 1.5]) {
        assert!((parameter.value.expect("of the first run") / truth - 1.0).abs() < 2e-2, "{parameter:?}");
    }
    assert!(
        !result.is_complete() && result.warnings.iter().any(|w| w.to_string().contains("sensor")),
        "{:?}",
        result.warnings
    );
}

#[test]
fn harmonics_near_a_natural_mode_are_said() {
    let mut experiment = experiment();
    // sqrt(k1/m) = 4.472 rad/s.
    experiment.apply_override("schedule.stages", "[{ lambda = 0.2, w = 4.4 }]").expect("known");
    let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true).expect("runs");
    // With estimates of zero no mode can be computed; with those of the first run it can.
    assert!(result.runs[0].near_mode.is_none());
    let near = result.runs[1].near_mode.as_ref().expect("seen");
    assert_eq!((near.signal.as_str(), near.harmonic), ("x", 1));
    assert!((near.frequency - 20.0_f64.sqrt()).abs() < 0.1);
    assert!(result.warnings.iter().any(|w| w.to_string().contains("natural mode")), "{:?}", result.warnings);
    // The second harmonic is only in the force, from the square of the velocity.
    experiment.apply_override("schedule.stages", "[{ lambda = 0.2, w = 2.25 }]").expect("known");
    let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true).expect("runs");
    let near = result.runs[1].near_mode.as_ref().expect("seen");
    assert_eq!((near.signal.as_str(), near.harmonic), ("u", 2));
}

#[test]
fn a_run_goes_around_a_natural_mode_where_it_is_asked_to() {
    let mut experiment = experiment();
    experiment.apply_override("schedule.stages", "[{ lambda = 0.2, w = 4.4 }]").expect("known");
    experiment.apply_override("schedule.avoid_modes", "true").expect("known");
    let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true).expect("runs");
    // The first run is played as it is asked for, since estimates of zero have no mode; sqrt(k1/m) = 4.472 rad/s.
    assert!((result.runs[0].frequency / 4.4 - 1.0).abs() < 1e-3);
    assert!(result.runs[1..].iter().all(|run| (run.frequency / (0.95 * 4.4) - 1.0).abs() < 1e-3));
    assert!(result.runs.iter().all(|run| run.near_mode.is_none()) && result.is_complete(), "{:?}", result.warnings);
}

#[test]
fn strokes_with_rests_give_the_parameters_that_the_periodic_motion_gives() {
    let periodic = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment(), &mut |_| true).expect("runs");
    let mut rests = experiment();
    for stage in &mut rests.schedule.stages {
        stage.dwell = Some(0.25);
    }
    let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &rests, &mut |_| true).expect("runs");
    assert!(result.is_complete() && result.rank == 3, "{:?} {:?}", result.outcome, result.warnings);
    // Two strokes of a second and two rests in the first stage.
    assert!((result.runs[0].frequency - 2.0 * std::f64::consts::PI / 2.5).abs() < 1e-12);
    for ((found, other), truth) in result.parameters.iter().zip(&periodic.parameters).zip([2.0, 40.0, 1.5]) {
        let (value, std) = (found.value.expect("identified"), found.std.expect("identified"));
        let (before, own) = (other.value.expect("identified"), other.std.expect("identified"));
        assert!((value - truth).abs() < 4.0 * std && std < 3e-3 * truth, "{}: {value} +- {std}", found.name);
        assert!((value - before).abs() < 4.0 * std.hypot(own), "{}: {value} {before}", found.name);
    }
    for estimator in ["error", "effort", "hill"] {
        rests.apply_override("estimator", estimator).expect("known");
        let first_order = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &rests, &mut |_| true).expect("runs");
        assert!(first_order.is_complete(), "{estimator}: {:?}", first_order.warnings);
        for (parameter, truth) in first_order.parameters.iter().zip([2.0, 40.0, 1.5]) {
            let (value, std) = (parameter.value.expect("identified"), parameter.std.expect("identified"));
            assert!((value - truth).abs() < 4.0 * std, "{estimator}: {} {value} +- {std}", parameter.name);
        }
    }
    rests.apply_override("estimator", "measured-motion").expect("known");
    // The same strokes in a list, the second with a longer rest.
    rests.schedule.stages.truncate(1);
    rests.apply_override("schedule.stages.0.strokes", "[{}, { start = 1, end = 2, dwell = 0.5 }]").expect("known");
    let listed = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &rests, &mut |_| true).expect("runs");
    assert!((listed.runs[0].frequency - 2.0 * std::f64::consts::PI / 2.75).abs() < 1e-12);
    assert!(listed.parameters.iter().all(|parameter| parameter.value.is_some()), "{:?}", listed.warnings);
}

#[test]
fn deviations_hold_where_an_encoder_rests_on_a_count() {
    let mut rests = experiment();
    for stage in &mut rests.schedule.stages {
        stage.dwell = Some(0.25);
    }
    let (seeds, mut held) = (8, 0);
    for seed in 1..=seeds {
        rests.apply_override("seed", &seed.to_string()).expect("known");
        let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &rests, &mut |_| true).expect("runs");
        for (parameter, truth) in result.parameters.iter().zip([2.0, 40.0, 1.5]) {
            let (value, std) = (parameter.value.expect("identified"), parameter.std.expect("identified"));
            held += usize::from((value - truth).abs() < 1.96 * std);
        }
    }
    // Of 24 independent intervals of 95 % fewer than 20 hold in one case of 170.
    assert!(held >= 20, "{held} of {}", 3 * seeds);
}

#[test]
fn strokes_that_do_not_go_on_are_refused_at_their_place() {
    let refused = |strokes: &str| {
        let mut experiment = experiment();
        experiment.apply_override("schedule.stages.1.strokes", strokes).expect("known");
        identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true)
            .expect_err("refused")
            .to_string()
    };
    let moving = refused("[{ end = 0.75, dwell = 0.5 }, { start = 0.75, end = 2 }]");
    for part in
        ["schedule.stages.1.strokes.0", "`x` ends with the velocity -", "a rest follows", "where the pattern rests"]
    {
        assert!(moving.contains(part), "{part}: {moving}");
    }
    let last = refused("[{ end = 0.75 }]");
    assert!(last.contains("`x` ends with the position") && last.contains("the first follows the last"), "{last}");
    let back = refused("[{ start = 1, end = 0.5 }]");
    assert!(back.contains("schedule.stages.1.strokes.0.end") && back.contains("behind its start"), "{back}");
    let negative = refused("[{ dwell = -1 }]");
    assert!(negative.contains("zero or longer"), "{negative}");
    let unknown = refused("[{ pattern = \"far\" }]");
    assert!(unknown.contains("no pattern `far`"), "{unknown}");
}

#[test]
fn a_plant_that_diverges_leaves_what_was_known() {
    let mut experiment = experiment();
    experiment.limits.tracking.clear();
    // From the second run on the spring constant is negative, far beyond what the feedback holds.
    experiment.apply_override("plant.drift.k1", "-1e4").expect("known");
    let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true).expect("runs");
    assert_eq!(result.outcome, Some(tpm_campaign::Outcome::Aborted));
    let (first, later) = result.runs.split_first().expect("runs");
    assert_eq!((first.ending, later.len()), (RunEnding::Complete, experiment.limits.max_aborts + 1));
    assert!(later.iter().all(|run| run.ending == RunEnding::Diverged && !run.updated), "{later:?}");
    for ((parameter, kept), truth) in result.parameters.iter().zip(&first.parameters).zip([2.0, 40.0, 1.5]) {
        assert_eq!(parameter.value, kept.value);
        assert!((parameter.value.expect("of the first run") / truth - 1.0).abs() < 2e-2, "{parameter:?}");
    }
    assert!(
        !result.is_complete() && result.warnings.iter().any(|w| w.to_string().contains("diverged")),
        "{:?}",
        result.warnings
    );
}

#[test]
fn a_measured_rate_adds_what_its_noise_allows() {
    // One update for each seed. A measured rate adds equations of its own.
    let errors = |rate_noise: Option<&str>, seed: u64| {
        let mut experiment = experiment();
        let sets = [
            ("estimator", "error"),
            ("plant.sensors.x.step", "0"),
            ("control.derivative_filter", "2e-3"),
            ("prior", "{ m = 2.0, k1 = 40.0, k2 = 1.5 }"),
            ("schedule.stages", "[{ lambda = 0.3, w = 3.14159265 }]"),
            ("schedule.updates_per_stage", "1"),
        ];
        for (key, value) in sets {
            experiment.apply_override(key, value).expect("known");
        }
        experiment.seed = seed;
        if let Some(noise) = rate_noise {
            experiment.apply_override("plant.sensors.x.rate_noise", noise).expect("known");
        }
        let result = identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true).expect("runs");
        let off = |(p, truth): (&tpm_estimate::ParameterReport, f64)| {
            (p.value.expect("identified") - truth, p.std.expect("identified"))
        };
        result.parameters.iter().zip([2.0, 40.0, 1.5]).map(off).collect::<Vec<_>>()
    };
    let seeds = 12;
    // Parameter by parameter: mean squares of the errors, of the stated deviations, and of their ratios.
    let spread = |rate_noise: Option<&str>| {
        let mut sums = [[0.0; 3]; 3];
        for seed in 1..=seeds {
            for (sum, (error, std)) in sums.iter_mut().zip(errors(rate_noise, seed)) {
                let n = seeds as f64;
                sum[0] += error * error / n;
                sum[1] += std * std / n;
                sum[2] += (error / std).powi(2) / n;
            }
        }
        sums
    };
    let (without, with) = (spread(None), spread(Some("1e-3")));
    // Only m and k1 gain: k2 depends on the mean of the squared rate, to which noise adds whatever measures the rate.
    for (without, with) in without.iter().zip(&with).take(2) {
        assert!(with[1] < 0.25 * without[1] && with[0] < 0.5 * without[0], "{without:?} {with:?}");
    }
    // The contribution of noise to the mean of the squared rate is computed, so the errors of all three parameters
    // agree with the stated deviations.
    for of_parameter in without.iter().chain(&with) {
        assert!(of_parameter[2] < 2.0, "{without:?} {with:?}");
    }
}

#[test]
fn smoothing_is_a_part_of_the_loop_and_its_settings_are_checked() {
    let with = |smoothing: &str| {
        let mut experiment = experiment();
        experiment.control.derivative_filter = None;
        experiment.apply_override("control.smoothing", smoothing).expect("known");
        // With a mass the loop has poles to check.
        experiment.apply_override("prior", "{ m = 3.0, k1 = 20.0, k2 = 1.0 }").expect("known");
        identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &experiment, &mut |_| true)
    };
    let result = with("{ samples = 15, degree = 2 }").expect("runs");
    for (parameter, truth) in result.parameters.iter().zip([2.0, 40.0, 1.5]) {
        assert!((parameter.value.expect("identified") / truth - 1.0).abs() < 5e-3, "{parameter:?}");
    }
    let refused = |smoothing: &str| with(smoothing).expect_err("refused").to_string();
    // The slope of a straight line fitted over a tenth of a second lags by half of that time.
    assert!(refused("{ samples = 100, degree = 1 }").contains("not with samples"));
    for (smoothing, place) in [
        ("{ samples = 15, degree = 0 }", "control.smoothing.degree"),
        ("{ samples = 15, degree = 6 }", "control.smoothing.degree"),
        ("{ samples = 2, degree = 2 }", "control.smoothing.samples"),
        ("{ samples = 101, degree = 2 }", "control.smoothing.samples"),
    ] {
        let text = refused(smoothing);
        assert!(text.contains(place), "{text}");
    }
    let mut both = experiment();
    both.apply_override("control.smoothing", "{ samples = 15, degree = 2 }").expect("known");
    let text =
        identify_simulated(&MassSpringDrag, &rest_to_rest_3(), &both, &mut |_| true).expect_err("refused").to_string();
    assert!(text.contains("exclude each other"), "{text}");
}
