//! Monte-Carlo study: one campaign for every seed, and the spread of the estimates about the truth.
//!
//! Invariant: the result depends on the experiment and the seeds alone, not on the number of threads or on the order in
//! which campaigns end. Campaigns that did not identify a parameter are counted, never replaced.

use crate::campaign::RunReport;
use crate::estimate::{ParameterReport, Status};
use crate::experiment::Experiment;
use crate::run::trajectory::ReferencePattern;
use crate::session::{Identification, Session, SessionError, identify_simulated};
use crate::study::design::bounds;
use rayon::prelude::*;
use serde::Serialize;
use std::boxed::Box;
use std::string::{String, ToString};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::vec::Vec;
use tpm_core::model::Model;

/// Half the width of the interval that holds 95 % of a normal variable, in standard deviations.
const NORMAL_95: f64 = 1.959_963_984_540_054;
/// Most seeds that a warning lists.
const SHOWN_SEEDS: usize = 8;

/// One parameter over all campaigns. The statistics are over the campaigns that identified the parameter; an estimate
/// that the campaign itself reports as poorly determined does not count.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterStudy {
    /// Name in the model.
    pub name: String,
    /// Unit in the model.
    pub unit: Option<String>,
    /// Value of the parameter in the simulated machine.
    pub truth: f64,
    /// Number of campaigns that identified the parameter.
    pub values: usize,
    /// Mean of the estimates; nothing when there are none.
    pub mean: Option<f64>,
    /// Mean minus truth.
    pub bias: Option<f64>,
    /// Standard deviation of the mean estimate: a bias below twice as much may be chance.
    pub bias_std: Option<f64>,
    /// Standard deviation of the estimates.
    pub spread: Option<f64>,
    /// Root mean square of the standard deviations that the campaigns state.
    pub stated: Option<f64>,
    /// Cramer-Rao bound of the standard deviation after the runs of the first campaign, along their motion without
    /// noise; nothing when the bound cannot be predicted.
    pub bound: Option<f64>,
    /// Share of the stated 95 % intervals that hold the truth.
    pub coverage: Option<f64>,
}

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

/// Runs an experiment for `campaigns` successive seeds from its own on, on all cores. `progress` gets the number of
/// campaigns that have ended, from any thread, and says whether to go on. After a stop, only the campaigns before the
/// first unfinished seed are used.
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

/// Repeats the experiment of a session for `campaigns` successive seeds from its own on.
///
/// # Errors
/// [`SessionError`] of the first seed whose campaign fails.
pub fn study_session(
    session: &Session,
    campaigns: usize,
    progress: &(dyn Fn(usize) -> bool + Sync),
) -> Result<Study, SessionError> {
    let machine = session.machine();
    let identify = |own: &Experiment, go_on: &mut dyn FnMut(&RunReport) -> bool| {
        session.identify_seeded(own.seed, &mut |_, _, run| go_on(run))
    };
    study_campaigns(machine.plant(), machine.pattern(), session.experiment(), campaigns, &identify, progress)
}

/// Repeats a campaign that the caller runs. The caller gets the experiment with its seed, and a function that says
/// after every run whether to go on.
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
    let (ended, go_on) = (AtomicUsize::new(0), AtomicBool::new(true));
    let parameters: Vec<&str> = (0..model.dims().parameters).map(|j| model.parameter(j).name).collect();
    let one = |index: usize| {
        if !go_on.load(Ordering::Relaxed) {
            return None;
        }
        let mut own = experiment.clone();
        own.seed = experiment.seed.wrapping_add(index as u64);
        let result = identify(&own, &mut |_| go_on.load(Ordering::Relaxed));
        // A campaign that was stopped half way does not count.
        let whole = go_on.load(Ordering::Relaxed);
        if !progress(ended.fetch_add(1, Ordering::Relaxed) + 1) {
            go_on.store(false, Ordering::Relaxed);
        }
        // The Cramer-Rao bound is computed from the runs of the first campaign.
        whole.then(|| result.map(|result| Outcome::of(result, &parameters, index == 0)))
    };
    let results: Vec<Option<Result<Outcome, SessionError>>> = (0..campaigns).into_par_iter().map(one).collect();
    let results: Vec<Outcome> = results.into_iter().map_while(|result| result).collect::<Result<_, _>>()?;
    let bounds = match results.first() {
        Some(first) => bounds(model, pattern, experiment, &first.runs)?.unwrap_or_default(),
        None => Vec::new(),
    };
    Ok(summarise(model, experiment, campaigns, &results, &bounds))
}

/// What a study keeps of a campaign: studies have very many.
struct Outcome {
    seed: Option<u64>,
    complete: bool,
    /// Value and standard deviation of every parameter of the plant that the campaign identified.
    estimates: Box<[Option<(f64, f64)>]>,
    /// The campaign's runs, of the first campaign alone.
    runs: Vec<RunReport>,
}

impl Outcome {
    fn of(result: Identification, parameters: &[&str], first: bool) -> Self {
        let identified = |name: &&str| {
            let parameter = named(&result, name).filter(|parameter| parameter.status == Status::Identified)?;
            Some((parameter.value?, parameter.std?))
        };
        let estimates = parameters.iter().map(identified).collect();
        let (seed, complete) = (result.seed, result.is_complete());
        Self { seed, complete, estimates, runs: if first { result.runs } else { Vec::new() } }
    }
}

fn summarise(
    model: &dyn Model<f64>,
    experiment: &Experiment,
    asked: usize,
    results: &[Outcome],
    bounds: &[Option<f64>],
) -> Study {
    let incomplete = results.iter().filter(|result| !result.complete);
    let incomplete_seeds: Vec<u64> = incomplete.filter_map(|result| result.seed).collect();
    let parameters: Vec<ParameterStudy> = (0..model.dims().parameters)
        .filter_map(|j| {
            let label = model.parameter(j);
            // A machine without a true value cannot be simulated, so no parameter is left out here.
            let truth = *experiment.plant.parameters.get(label.name)?;
            let pairs: Vec<(f64, f64)> =
                results.iter().filter_map(|result| result.estimates.get(j).copied().flatten()).collect();
            let bound = bounds.get(j).copied().flatten();
            Some(ParameterStudy { bound, ..one_parameter(label.name, label.unit, truth, &pairs) })
        })
        .collect();
    let mut warnings = Vec::new();
    if results.len() < asked {
        warnings.push(std::format!("{} of {asked} campaigns were run before the study was stopped", results.len()));
    }
    if !incomplete_seeds.is_empty() {
        let shown: Vec<String> = incomplete_seeds.iter().take(SHOWN_SEEDS).map(ToString::to_string).collect();
        warnings.push(std::format!(
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
            warnings.push(std::format!(
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
        campaigns: results.len(),
        incomplete_seeds,
        parameters,
        warnings,
    }
}

/// A parameter of the plant in a result: one that the estimator gives, or a physical one behind lumped ones.
fn named<'r>(result: &'r Identification, name: &str) -> Option<&'r ParameterReport> {
    result.parameters.iter().chain(&result.physical).find(|parameter| parameter.name == name)
}

fn one_parameter(name: &str, unit: Option<&str>, truth: f64, pairs: &[(f64, f64)]) -> ParameterStudy {
    let count = pairs.len() as f64;
    let mean_of = |term: &dyn Fn(f64, f64) -> f64| {
        (!pairs.is_empty()).then(|| pairs.iter().map(|&(value, std)| term(value, std)).sum::<f64>() / count)
    };
    let mean = mean_of(&|value, _| value);
    // The spread is computed from deviations from the mean, so that no digits cancel.
    let spread = mean.filter(|_| pairs.len() > 1).and_then(|mean| {
        mean_of(&|value, _| (value - mean).powi(2)).map(|square| (square * count / (count - 1.0)).sqrt())
    });
    ParameterStudy {
        name: name.to_string(),
        unit: unit.map(ToString::to_string),
        truth,
        values: pairs.len(),
        mean,
        bias: mean.map(|mean| mean - truth),
        bias_std: spread.map(|spread| spread / count.sqrt()),
        spread,
        stated: mean_of(&|_, std| std * std).map(f64::sqrt),
        bound: None,
        coverage: mean_of(&|value, std| f64::from(u8::from((value - truth).abs() <= NORMAL_95 * std))),
    }
}

#[cfg(test)]
mod tests {
    use super::{ParameterStudy, one_parameter, study, study_session};
    use crate::experiment::Experiment;
    use crate::run::trajectory::tests::rest_to_rest_3;
    use crate::session::{DeclaredModel, Session};
    use crate::test_models::MassSpringDrag;
    use std::collections::BTreeMap;

    fn short() -> Experiment {
        let mut experiment = Experiment::parse(include_str!("../../../models/mass_spring_drag.toml"))
            .expect("the shipped file is right");
        experiment.schedule.max_runs = 2;
        experiment.schedule.measure_time = 8.0;
        experiment.seed = 11;
        experiment
    }

    #[test]
    fn statistics_are_those_of_the_definition() {
        let found = one_parameter("m", Some("kg"), 2.0, &[(1.0, 0.6), (2.0, 0.6), (6.0, 0.6)]);
        assert_eq!((found.values, found.mean, found.bias), (3, Some(3.0), Some(1.0)));
        assert!((found.spread.expect("three") - 7.0_f64.sqrt()).abs() < 1e-15);
        assert!((found.stated.expect("three") - 0.6).abs() < 1e-15);
        assert!((found.coverage.expect("three") - 2.0 / 3.0).abs() < 1e-15);
        let none = one_parameter("m", None, 2.0, &[]);
        assert_eq!((none.values, none.mean, none.coverage), (0, None, None));
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
        let model = include_str!("../../../models/rotary_pendulum_down.tpm");
        let experiment = Experiment::parse(include_str!("../../../models/rotary_pendulum_down.toml")).expect("right");
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
        // The bound is that of white noise alone. The estimates start at the truth, so that all runs weigh alike.
        experiment.plant.sensors.entry("x".into()).or_default().counts = 0.0;
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
