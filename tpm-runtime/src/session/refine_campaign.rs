//! The estimates of a campaign refined by simulating the model along the ends of all its runs.
//!
//! The harmonics of a smooth force fall off quickly, and those that noise drowns are missed by nobody. A force that jumps has many, and
//! where the velocity is known from a few harmonics its sign changes at the wrong time, by an error that no noise model tells. Between its
//! samples the simulation solves the equations of motion as they are. It takes the samples themselves and not their mean over the periods:
//! the mean of a sign of a velocity with noise is not the sign of the mean.

use crate::campaign::{Campaign, SteadyRun};
use crate::estimate::{Course, Differentiable, Method, Weights, reach_in};
use crate::interpret::InterpretedDerivatives;
use crate::log::Refine;
use crate::session::excerpt::Excerpt;
use crate::session::refine::{Conditions, Refined, Start, refined};
use std::vec::Vec;

/// Refines the estimate of a campaign; nothing where its estimator is another than that of the measured motion, where coordinates were
/// eliminated, where equations are weighed alike or forgotten, and before the first estimate. `derivatives` makes those of the rows.
pub(super) fn refined_campaign(
    campaign: &Campaign<'_>,
    derivatives: impl FnOnce() -> InterpretedDerivatives,
    refine: Refine,
) -> Option<Refined> {
    let setup = campaign.setup();
    let settings = &setup.estimation;
    let eliminated = campaign.estimator().lumped().is_some();
    let other = setup.method != Method::MeasuredMotion || settings.weights == Weights::Equal || settings.forgets();
    if eliminated || other || refine == Refine::None {
        return None;
    }
    let estimate = campaign.estimate()?;
    let runs: Vec<&SteadyRun> = campaign.steady().collect();
    let sample_time = setup.control.sample_time;
    let coordinates = campaign.model().dims().coordinates;
    let excerpt = Excerpt::of_runs(&runs);
    let period = runs.iter().map(|run| run.period).min()?;
    let most = |of: &dyn Fn(&SteadyRun) -> f64| runs.iter().map(|run| of(run)).fold(0.0, f64::max);
    let periods: usize = runs.iter().map(|run| run.period).sum();
    let start = Start {
        estimate,
        course: Course::Any {
            typical_period: period as f64,
            reach: reach_in(period as f64),
            highest: (0..coordinates).map(|c| most(&|run| run.highest[c])).collect(),
            copies: excerpt.samples() as f64 / periods.max(1) as f64,
        },
        steps: (0..coordinates).map(|c| most(&|run| run.steps[c])).collect(),
        samples: excerpt.samples(),
        sample_time,
        excerpt,
    };
    let conditions = Conditions {
        constants: &setup.constants,
        hold: setup.procedure.hold,
        actuators: &setup.control.actuators,
        refine,
    };
    let restate = |values, covariance| estimate.refined(values, covariance, settings);
    let derivatives = derivatives();
    let machine = Differentiable { model: campaign.model(), derivatives: &derivatives };
    let mut refined = refined(Some(machine), start, conditions, settings, &restate);
    if let Some(report) = &mut refined.report {
        report.runs = runs.len();
    }
    Some(refined)
}

#[cfg(test)]
mod tests {
    use crate::experiment::Experiment;
    use crate::session::{DeclaredModel, Identification, Session};
    use std::collections::BTreeMap;

    const MODEL: &str = "model Sled { coordinate x [m]; input u [N]; parameter m [kg], k [N/m], fc [N];
        m*ddot(x) + k*x + fc*sign(dot(x)) = u;
        pattern { amplitude l [m]; frequency w [rad/s]; x = l*cos(w*t); } }";
    const EXPERIMENT: &str = "seed = 3
        harmonics = 5
        [plant]
        parameters = { m = 2.0, k = 40.0, fc = 6.0 }
        [plant.sensors.x]
        noise = 1e-4
        [control]
        sample_time = 1e-3
        derivative_filter = 2e-3
        feedback = [{ input = \"u\", coordinate = \"x\", kp = 2000.0, kd = 120.0 }]
        [limits]
        inputs = { u = 800.0 }
        [schedule]
        settle_periods = 3
        measure_time = 6.0
        updates_per_stage = 1
        stages = [{ l = 0.2, w = 6.0 }, { l = 0.3, w = 8.0 }]";

    fn identified(changes: &[(&str, &str)]) -> Identification {
        let model = DeclaredModel::parse("Sled", MODEL).expect("a model");
        let mut experiment = Experiment::parse(EXPERIMENT).expect("an experiment");
        changes.iter().for_each(|(key, value)| experiment.apply_override(key, value).expect("known"));
        let session = Session::new(model, experiment, None, BTreeMap::new()).expect("a session");
        session.identify(None, &mut |_, _, _| true).expect("runs")
    }

    #[test]
    fn few_harmonics_of_a_force_that_jumps_give_right_parameters_with_the_simulation() {
        let refined = identified(&[]);
        let report = refined.refinement.as_ref().expect("refined");
        assert!(report.used && report.runs == refined.runs.len(), "{report:?}");
        for parameter in &refined.parameters {
            let (value, std) = (parameter.value.expect("shown"), parameter.std.expect("shown"));
            let truth = parameter.truth.expect("simulated");
            assert!((value - truth).abs() < 4.0 * std, "{} {value} +- {std}", parameter.name);
            assert!(std < 2e-3 * truth, "{} {value} +- {std}", parameter.name);
        }
        let plain = identified(&[("refine", "none")]);
        assert!(plain.refinement.is_none());
        let before = plain.parameters.iter().map(|parameter| parameter.value.expect("shown"));
        assert_eq!(before.collect::<std::vec::Vec<_>>(), report.before);
    }
}
