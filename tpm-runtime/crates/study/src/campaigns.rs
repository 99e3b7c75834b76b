//! Monte-Carlo study: one campaign for every seed, and the spread of the estimates about the truth.
//!
//! Invariant: the result depends on the experiment and the seeds alone, not on the number of threads or the order in
//! which campaigns end. Campaigns that did not identify a parameter are counted, never replaced. The stored result does
//! not grow with the number of campaigns, except for the list of seeds of incomplete campaigns.

use crate::design::bounds;
use crate::tally::{Outcome, ParameterStudy, Tally};
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use tpm_campaign::RunReport;
use tpm_controller::model::Model;
use tpm_experiment::Experiment;
use tpm_motion::trajectory::ReferencePattern;
use tpm_session::{Identification, Session, SessionError, identify_simulated};

/// Most seeds that a warning lists.
const SHOWN_SEEDS: usize = 8;

/// A Monte-Carlo study; serialises as `tpm.study/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Study {
    /// `tpm.study/1`.
    pub schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// The estimator.
    pub estimator: &'static str,
    /// The first seed.
    pub first_seed: u64,
    /// Number of campaigns, which have successive seeds.
    pub campaigns: usize,
    /// Seeds of the campaigns that did not identify every parameter.
    pub incomplete_seeds: Vec<u64>,
    /// The parameters.
    pub parameters: Vec<ParameterStudy>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// One campaign of a study.
pub type Identify<'a> =
    dyn Fn(&Experiment, &mut dyn FnMut(&RunReport) -> bool) -> Result<Identification, SessionError> + Sync + 'a;

/// Runs an experiment for `campaigns` successive seeds, beginning with its own, on all cores. `progress` receives the
/// number of finished campaigns, from any thread, and returns whether to continue. After a stop, only the campaigns
/// before the first unfinished seed are used.
///
/// # Errors
/// [`SessionError`] of the first seed whose campaign fails.
pub fn study(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    experiment: &Experiment,
    campaigns: usize,
    progress: &(dyn Fn(usize) -> bool + Sync),
) -> Result<Study, SessionError> {
    let identify =
        |own: &Experiment, go_on: &mut dyn FnMut(&RunReport) -> bool| identify_simulated(model, pattern, own, go_on);
    study_campaigns(model, pattern, experiment, campaigns, &identify, progress)
}

/// Repeats the experiment of a session for `campaigns` successive seeds, beginning with its own.
///
/// # Errors
/// [`SessionError`] of the first seed whose campaign fails.
pub fn study_session(
    session: &Session,
    campaigns: usize,
    progress: &(dyn Fn(usize) -> bool + Sync),
) -> Result<Study, SessionError> {
    study_from(session, None, campaigns, progress, &mut |_, _| Ok(()))
}

/// Continues the study of a session after the campaigns of a tally. `keep` receives the tally whenever it has grown,
/// and at the end.
pub(super) fn study_from(
    session: &Session,
    begun: Option<Tally>,
    campaigns: usize,
    progress: &(dyn Fn(usize) -> bool + Sync),
    keep: &mut Keep<'_>,
) -> Result<Study, SessionError> {
    let machine = session.machine();
    let identify = |own: &Experiment, go_on: &mut dyn FnMut(&RunReport) -> bool| {
        session.identify_seeded(own.seed, &mut |_, _, run| go_on(run))
    };
    let (plant, pattern, experiment) = (machine.plant(), machine.pattern(), session.experiment());
    let begun = begun.unwrap_or_else(|| Tally::new(plant, experiment));
    let tally = tallied(plant, pattern, experiment, begun, campaigns, &identify, progress, keep)?;
    Ok(summarise(plant, experiment, campaigns, tally))
}

/// Repeats a campaign that the caller runs. The caller receives the experiment with its seed, and a function that
/// returns after every run whether to continue.
///
/// # Errors
/// [`SessionError`] of the first seed whose campaign fails.
pub fn study_campaigns(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    experiment: &Experiment,
    campaigns: usize,
    identify: &Identify<'_>,
    progress: &(dyn Fn(usize) -> bool + Sync),
) -> Result<Study, SessionError> {
    let begun = Tally::new(model, experiment);
    let tally = tallied(model, pattern, experiment, begun, campaigns, identify, progress, &mut |_, _| Ok(()))?;
    Ok(summarise(model, experiment, campaigns, tally))
}

/// Stores a tally; the second argument states whether it is the last one.
pub(super) type Keep<'a> = dyn FnMut(&Tally, bool) -> Result<(), SessionError> + Send + 'a;

/// Adds finished campaigns to the tally in the order of their seeds, whatever the order in which they end.
struct InOrder<'k> {
    tally: Tally,
    /// Campaigns that ended before one of an earlier seed; nothing for a campaign that was stopped during its runs.
    waiting: BTreeMap<usize, Option<Result<Outcome, SessionError>>>,
    fault: Option<SessionError>,
    keep: &'k mut Keep<'k>,
}

impl InOrder<'_> {
    /// Receives a finished campaign, and adds to the tally every campaign whose turn has come. Returns whether to
    /// continue.
    fn take(&mut self, index: usize, outcome: Option<Result<Outcome, SessionError>>) -> bool {
        self.waiting.insert(index, outcome);
        let before = self.tally.campaigns();
        // A campaign that was stopped or has failed stays in the queue, and none after it is added to the tally.
        while self.fault.is_none()
            && let Some(Some(_)) = self.waiting.get(&self.tally.campaigns())
            && let Some(Some(next)) = self.waiting.remove(&self.tally.campaigns())
        {
            match next {
                Ok(outcome) => self.tally.add(outcome),
                Err(fault) => self.fault = Some(fault),
            }
        }
        if self.fault.is_none() && self.tally.campaigns() > before {
            self.fault = (self.keep)(&self.tally, false).err();
        }
        self.fault.is_none()
    }
}

/// The tally after `campaigns` campaigns, or after the last campaign before a stop.
#[expect(clippy::too_many_arguments, reason = "what a campaign needs, what was begun, and three ways to the caller")]
fn tallied(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    experiment: &Experiment,
    begun: Tally,
    campaigns: usize,
    identify: &Identify<'_>,
    progress: &(dyn Fn(usize) -> bool + Sync),
    keep: &mut Keep<'_>,
) -> Result<Tally, SessionError> {
    let first = begun.campaigns();
    let (next, ended, go_on) = (AtomicUsize::new(first), AtomicUsize::new(first), AtomicBool::new(true));
    let parameters: Vec<&str> = (0..model.dims().parameters).map(|j| model.parameter(j).name).collect();
    let one = |index: usize| -> Result<Outcome, SessionError> {
        let mut own = experiment.clone();
        own.seed = experiment.seed.wrapping_add(index as u64);
        let result = identify(&own, &mut |_| go_on.load(Ordering::Relaxed))?;
        // The Cramer-Rao bound is computed from the runs of the first campaign.
        let bounds = if index == 0 { bounds(model, pattern, experiment, &result.runs)? } else { None };
        Ok(Outcome::of(&result, &parameters, bounds))
    };
    let in_order = Mutex::new(InOrder { tally: begun, waiting: BTreeMap::new(), fault: None, keep });
    let work = || {
        while go_on.load(Ordering::Relaxed) {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= campaigns {
                return;
            }
            let outcome = one(index);
            // A campaign that was stopped during its runs does not count.
            let whole = go_on.load(Ordering::Relaxed).then_some(outcome);
            if !in_order.lock().unwrap_or_else(PoisonError::into_inner).take(index, whole)
                || !progress(ended.fetch_add(1, Ordering::Relaxed) + 1)
            {
                go_on.store(false, Ordering::Relaxed);
            }
        }
    };
    // Plain threads take seed after seed. A thread pool would give each thread a range of seeds, so that the results of
    // all ranges but the first would have to wait in memory.
    std::thread::scope(|scope| {
        for _ in 0..rayon::current_num_threads().min(campaigns.saturating_sub(first)) {
            scope.spawn(work);
        }
    });
    let InOrder { tally, fault, keep, .. } = in_order.into_inner().unwrap_or_else(PoisonError::into_inner);
    // Campaigns before a fault are kept; the reported fault is the first one in the order of the seeds.
    let kept = keep(&tally, true);
    fault.map_or(kept, Err).map(|()| tally)
}

fn summarise(model: &dyn Model<f64>, experiment: &Experiment, asked: usize, tally: Tally) -> Study {
    let campaigns = tally.campaigns();
    let parameters = tally.parameters(model, experiment);
    let incomplete_seeds = tally.incomplete_seeds;
    let mut warnings = Vec::new();
    if campaigns < asked {
        warnings.push(format!("{campaigns} of {asked} campaigns were run before the study was stopped"));
    }
    if !incomplete_seeds.is_empty() {
        let shown: Vec<String> = incomplete_seeds.iter().take(SHOWN_SEEDS).map(ToString::to_string).collect();
        warnings.push(format!(
            "{} campaigns did not identify everything: seed {}{}",
            incomplete_seeds.len(),
            shown.join(", "),
            if incomplete_seeds.len() > SHOWN_SEEDS { ", ..." } else { "" }
        ));
    }
    for parameter in &parameters {
        if let (Some(bias), Some(error)) = (parameter.bias, parameter.bias_std)
            && parameter.values > 9
            && bias.abs() > 4.0 * error
        {
            warnings.push(format!(
                "{} is biased by {:.3e}, {:.1} times what chance explains",
                parameter.name,
                bias,
                bias.abs() / error
            ));
        }
    }
    Study {
        schema: "tpm.study/1",
        model: model.name().into(),
        estimator: experiment.estimator.name(),
        first_seed: experiment.seed,
        campaigns,
        incomplete_seeds,
        parameters,
        warnings,
    }
}

#[cfg(test)]
mod tests {
    use super::{ParameterStudy, study, study_session};
    use std::collections::BTreeMap;
    use tpm_experiment::Experiment;
    use tpm_session::{DeclaredModel, Session};
    use tpm_test_support::models::MassSpringDrag;
    use tpm_test_support::rest_to_rest_3;

    fn short() -> Experiment {
        let mut experiment = Experiment::parse(include_str!("../../../../models/mass_spring_drag.toml"))
            .expect("the shipped file is right");
        experiment.schedule.max_runs = 2;
        experiment.schedule.measure_time = 8.0;
        experiment.seed = 11;
        experiment
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| study(&MassSpringDrag, &rest_to_rest_3(), &short(), 6, &|_| true)).expect("runs")
        };
        let one = run(1);
        assert_eq!(one, run(3));
        assert_eq!((one.campaigns, one.parameters.len()), (6, 3));
        assert!(
            one.parameters.iter().all(|p| p.values == 6 && (p.bias.expect("six") / p.truth).abs() < 1e-2),
            "{one:?}"
        );
    }

    #[test]
    fn parameters_of_a_lumped_model_stand_beside_their_own_truth() {
        let model = include_str!("../../../../models/rotary_pendulum_down.tpm");
        let experiment =
            Experiment::parse(include_str!("../../../../models/rotary_pendulum_down.toml")).expect("right");
        let declared = DeclaredModel::parse("rotary_pendulum_down", model).expect("right");
        let session = Session::new(declared, experiment, None, BTreeMap::new()).expect("a session");
        let found = study_session(&session, 1, &|_| true).expect("runs");
        let beside = |p: &ParameterStudy| p.mean.is_none_or(|mean| (mean - p.truth).abs() < 0.2 * p.truth.abs());
        assert!(found.parameters.iter().any(|p| p.name.contains("_plus_")), "{found:?}");
        assert!(found.parameters.iter().all(beside), "{found:?}");
    }

    #[test]
    fn the_spread_is_near_the_bound() {
        let mut experiment = short();
        // The bound is that of white noise alone. The priors are the truth, so that all runs have the same weights.
        experiment.plant.sensors.entry("x".into()).or_default().step = 0.0;
        for (name, value) in [("m", 2.0), ("k1", 40.0), ("k2", 1.5)] {
            experiment.prior.insert(name.into(), value);
        }
        let found = study(&MassSpringDrag, &rest_to_rest_3(), &experiment, 60, &|_| true).expect("runs");
        for parameter in &found.parameters {
            let ratio = parameter.spread.expect("sixty") / parameter.bound.expect("predicted");
            // The standard deviation over sixty campaigns is itself uncertain by 9 %.
            assert!((0.75..1.6).contains(&ratio), "{}: {ratio}", parameter.name);
        }
    }

    #[test]
    fn a_stopped_study_uses_whole_campaigns_only() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
        let found =
            pool.install(|| study(&MassSpringDrag, &rest_to_rest_3(), &short(), 50, &|ended| ended < 2)).expect("runs");
        assert!(found.campaigns < 50 && found.warnings.iter().any(|w| w.contains("stopped")), "{found:?}");
    }

    #[test]
    fn a_machine_without_values_is_an_error() {
        let mut experiment = short();
        experiment.plant.parameters.clear();
        assert!(study(&MassSpringDrag, &rest_to_rest_3(), &experiment, 3, &|_| true).is_err());
    }
}
