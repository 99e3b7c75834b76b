//! The estimates of a campaign refined by simulating the model along the ends of all its runs.
//!
//! Harmonics contain what repeats. The sign of a velocity that is known from few harmonics changes at the wrong instant, by an error that is
//! in no noise model; and the motion that noise makes round the loop, between the harmonics, holds information too. The simulation uses
//! both. Invariant: it takes the samples themselves and not their mean over the periods, since the mean of a sign, or of a square, of a
//! velocity with noise is not that of the mean.
//!
//! Smooth forces whose readings are counts without dither are left to the harmonics: the error of rounding repeats with the motion and falls
//! with no number of samples (`DESIGN.md`, "Why is output error a refinement and not the estimator?", "When is the refinement left out?").

use crate::excerpt::Excerpt;
use crate::machine::Machine;
use crate::refine::{By, Conditions, Refined, Start, refined};
use crate::refinement_report::RefinementReport;
use std::sync::OnceLock;
use tpm_campaign::{Campaign, Refinement, Setup, SteadyRun};
use tpm_estimate::{Course, Differentiable, Estimate, Method, Refine, Weights, reach_in};
use tpm_interpret::InterpretedDerivatives;

/// Most samples of all runs together where a force jumps, whose instant is looked for between two samples.
const MOST_SAMPLES_WITH_JUMPS: usize = 16_000;
/// Most samples of all runs together, times the square of the number of coordinates, where forces are smooth: some seconds of work.
const MOST_WORK: usize = 640_000;
/// Least share of all samples, as one over this, whose simulation says more than the harmonics of all of them. Their errors are 1.4 to 6.5
/// times the Cramer-Rao bound.
const LEAST_SHARE_DIVISOR: usize = 3;
/// Samples of all runs together above which the model must follow a part of them first.
const MOST_SAMPLES_AT_ONCE: usize = 50_000;
/// Most samples of a run that are simulated to judge it, for every run anew.
const JUDGED_SAMPLES: usize = 4_000;

/// The simulation of a model along the runs of a campaign.
pub(super) struct RunSimulation<'a> {
    machine: &'a Machine,
    /// Whether a force of the model jumps.
    jumps: bool,
    setup: Setup,
    /// Derivatives of the rows, made when they are first needed.
    derivatives: OnceLock<InterpretedDerivatives>,
}

impl<'a> RunSimulation<'a> {
    /// The simulation of a machine, some force of which jumps or not; nothing where the estimator is another than that of the measured
    /// motion, and where equations are weighed alike or forgotten.
    pub(super) fn new(machine: &'a Machine, jumps: bool, setup: &Setup) -> Option<Self> {
        let settings = &setup.estimation;
        let other = setup.method != Method::MeasuredMotion || settings.weights == Weights::Equal || settings.forgets();
        (!other).then(|| RunSimulation { machine, jumps, setup: setup.clone(), derivatives: OnceLock::new() })
    }

    /// The estimate of a campaign, refined by all its pooled runs; nothing before the first estimate. Smooth forces are left to the
    /// harmonics where the noise of readings is rounding to counts, and where only a small part of the samples can be simulated.
    pub(super) fn of_campaign(&self, campaign: &Campaign<'_>) -> Option<Refined> {
        let runs: Vec<&SteadyRun> = campaign.steady().collect();
        let most = if self.jumps {
            MOST_SAMPLES_WITH_JUMPS
        } else {
            let coordinates = runs.first()?.highest.len().max(1);
            let most = SteadyRun::MOST_SAMPLES.min(MOST_WORK / (coordinates * coordinates));
            let all: usize = runs.iter().map(|run| run.of).sum();
            if LEAST_SHARE_DIVISOR * most < all || runs.iter().any(|run| run.counted) {
                return None;
            }
            most
        };
        let estimate = campaign.estimate()?;
        // A model that cannot follow the ends of the runs cannot follow more of them, and would take minutes to say so. Ends that are too
        // short to show the parameters say nothing.
        let part = JUDGED_SAMPLES * runs.len();
        let long = runs.iter().map(|run| run.samples()).sum::<usize>().min(most) > MOST_SAMPLES_AT_ONCE.max(part);
        let judged = if long { self.of_runs(&runs, estimate, part) } else { None };
        let refused = judged.filter(|judged| judged.report.as_ref().is_some_and(RefinementReport::is_unsettled));
        let mut refined = match refused {
            Some(refused) => refused,
            None => self.of_runs(&runs, estimate, most)?,
        };
        if let Some(report) = &mut refined.report {
            report.runs = runs.len();
        }
        Some(refined)
    }

    /// An estimate, refined by simulating the machine along the last samples of runs, at most so many together; nothing without a run.
    fn of_runs(&self, runs: &[&SteadyRun], estimate: &Estimate, most: usize) -> Option<Refined> {
        let setup = &self.setup;
        let settings = &setup.estimation;
        let sample_time = setup.control.sample_time;
        let coordinates = runs.first()?.highest.len();
        let excerpt = Excerpt::of_runs(runs, most);
        let period = runs.iter().map(|run| run.period).min()?;
        let largest = |of: &dyn Fn(&SteadyRun) -> f64| runs.iter().map(|run| of(run)).fold(0.0, f64::max);
        let periods: usize = runs.iter().map(|run| run.period).sum();
        let start = Start {
            estimate,
            course: Course::Any {
                typical_period: period as f64,
                reach: reach_in(period as f64),
                highest: (0..coordinates).map(|c| largest(&|run| run.highest[c])).collect(),
                copies: excerpt.samples() as f64 / periods.max(1) as f64,
            },
            steps: (0..coordinates).map(|c| largest(&|run| run.steps[c])).collect(),
            samples: excerpt.samples(),
            sample_time,
            excerpt,
        };
        let conditions = Conditions {
            constants: &setup.constants,
            hold: setup.procedure.hold,
            actuators: &setup.control.actuators,
            refine: Refine::OutputError,
            by: By::OutputError,
        };
        let restate = |values, covariance| estimate.refined(values, covariance, settings);
        let derivatives = self.derivatives.get_or_init(|| self.machine.derivatives());
        let machine = Differentiable { model: self.machine.plant(), derivatives };
        Some(refined(Some(machine), start, conditions, settings, &restate))
    }
}

impl Refinement for RunSimulation<'_> {
    fn refined(&self, runs: &[&SteadyRun], estimate: &Estimate) -> Option<Estimate> {
        let refined = self.of_runs(runs, estimate, JUDGED_SAMPLES * runs.len())?;
        refined.report.filter(|report| report.used).map(|_| refined.estimate)
    }
}

#[cfg(test)]
mod tests {
    use crate::{DeclaredModel, Identification, Session};
    use std::collections::BTreeMap;
    use tpm_experiment::Experiment;

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

    const TWO_CARTS: [&str; 2] =
        [include_str!("../../../../models/two_carts.tpm"), include_str!("../../../../models/two_carts.toml")];

    fn identified(changes: &[(&str, &str)]) -> Identification {
        identified_of(MODEL, EXPERIMENT, changes)
    }

    fn identified_of(model: &str, experiment: &str, changes: &[(&str, &str)]) -> Identification {
        let model = DeclaredModel::parse("model", model).expect("a model");
        let mut experiment = Experiment::parse(experiment).expect("an experiment");
        changes.iter().for_each(|(key, value)| experiment.apply_override(key, value).expect("known"));
        let session = Session::new(model, experiment, None, BTreeMap::new()).expect("a session");
        session.identify(None, &mut |_, _, _| true).expect("runs")
    }

    #[test]
    fn physical_parameters_behind_an_elimination_are_refined_with_all_sensors() {
        let identify = |changes: &[(&str, &str)]| {
            identified_of(TWO_CARTS[0], TWO_CARTS[1], &[&[("schedule.measure_time", "10")], changes].concat())
        };
        let refined = identify(&[]);
        let plain = identify(&[("refine", "none")]);
        assert!(refined.refinement.as_ref().is_some_and(|report| report.used), "{:?}", refined.refinement);
        assert!(plain.refinement.is_none());
        for (parameter, before) in refined.physical.iter().zip(&plain.physical) {
            let (value, std) = (parameter.value.expect("shown"), parameter.std.expect("shown"));
            let truth = parameter.truth.expect("simulated");
            assert!((value - truth).abs() < 4.0 * std, "{} {value} +- {std}", parameter.name);
            assert!(std < 0.8 * before.std.expect("shown"), "{} {std} beside {:?}", parameter.name, before.std);
        }
        // The lumped parameters are those of the far cart's equation alone.
        assert_eq!(refined.parameters, plain.parameters);
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
        assert_eq!(before.collect::<Vec<_>>(), report.before);
    }
}
