//! The estimator `numerical` in campaigns on an exact machine.

use crate::Experiment;
use tpm_campaign::Campaign;
use tpm_controller::harmonics::Hold;
use tpm_plant::simulated::simulate;
use tpm_test_support::models::MassSpringDrag;
use tpm_test_support::rest_to_rest_3;

/// Number of runs played and largest relative error of the parameters after every update, on an exact machine.
fn errors(settings: &str) -> Vec<(usize, f64)> {
    let mut experiment = Experiment::parse(include_str!("../../../../models/mass_spring_drag.toml")).expect("shipped");
    for (key, value) in [("noise", "0"), ("plant.sensors.x.step", "0"), ("measure_time", "0"), ("max_runs", "14")] {
        experiment.apply_override(key, value).expect("known");
    }
    experiment.apply_override("estimator", "numerical").expect("known");
    experiment.apply_override("numerical", settings).expect("known");
    experiment.schedule.stages.truncate(1);
    experiment.schedule.updates_per_stage = 14;
    experiment.schedule.tolerance = 0.0;
    experiment.limits.inputs.clear();
    experiment.limits.tracking.clear();
    experiment.control.sample_time = 2.0 / 8192.0;
    experiment.control.derivative_filter = None;
    let setup = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::Zoh).expect("fits");
    let bench = experiment.bench(&MassSpringDrag).expect("fits");
    let mut campaign = Campaign::new(&MassSpringDrag, setup).expect("playable");
    let mut errors = Vec::new();
    while let Some(trial) = campaign.next().cloned() {
        let record = simulate(&MassSpringDrag, &bench, &trial).expect("regular");
        if campaign.submit(&record).expect("accepted").updated {
            let relative = campaign.current().iter().zip([2.0, 40.0, 1.5]).map(|(v, t)| (v / t - 1.0).abs());
            errors.push((campaign.runs().len(), relative.fold(0.0, f64::max)));
        }
    }
    errors
}

#[test]
fn the_matrix_is_used_as_it_is_asked_for() {
    let runs_to = |errors: &[(usize, f64)], limit: f64| errors.iter().find(|e| e.1 <= limit).map(|e| e.0);
    let plain = errors("{}");
    assert_eq!((plain[0].0, plain[1].0), (4, 8), "four runs to an update");
    let secant = errors("{ secant = true }");
    assert_eq!((secant[0].0, secant[1].0), (4, 5), "one run to an update after the first");
    // Updates with a full matrix converge quadratically and take four runs each; those with the secant matrix converge
    // superlinearly and take one.
    let (plain, secant) = (runs_to(&plain, 1e-6), runs_to(&secant, 1e-6));
    assert!(secant.is_some() && secant <= plain, "{secant:?} {plain:?}");
    for settings in ["{ cleared = true }", "{ reduced = true }", "{ cleared = true, reduced = true, secant = true }"] {
        let errors = errors(settings);
        assert!(errors.iter().any(|e| e.1 <= 1e-3), "{settings}: {errors:?}");
    }
}
