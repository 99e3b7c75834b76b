//! Number of updates that every estimator needs on an exact machine: the convergence of the method itself.
//!
//! Invariant: the only error of an update is that of its linearisation. Sensors and drives are exact, rates are
//! measured, the loop acts in continuous time, a period has the requested number of integration steps, and every run is
//! played until it has settled.

use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::PI;
use std::vec;
use tpm_campaign::{Campaign, CampaignError, Setup};
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model;
use tpm_estimate::Method;
use tpm_experiment::{Experiment, ExperimentError};
use tpm_motion::HoldCompensation;
use tpm_motion::trajectory::ReferencePattern;
use tpm_numerics::singular::complement;
use tpm_numerics::{DMatrix, DVector};
use tpm_plant::simulated::simulate_continuous;

/// Largest relative errors of the parameters at which an estimator counts as converged.
pub const LIMITS: [f64; 3] = [1e-3, 1e-6, 1e-9];
/// Number of samples in a period, and of integration steps.
const STEPS: usize = 8192;

/// The updates of one estimator at one setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Convergence {
    /// The estimator.
    pub estimator: &'static str,
    /// Names and values of the amplitudes.
    pub amplitudes: Vec<(String, f64)>,
    /// Fundamental frequency, rad/s.
    pub frequency: f64,
    /// Runs in one update.
    pub runs_per_update: usize,
    /// Largest relative error of the parameters after every update.
    pub errors: Vec<f64>,
    /// Number of updates to each of [`LIMITS`]; nothing when the limit was not reached.
    pub updates: [Option<usize>; 3],
    /// Why the estimator does not apply to the model, or why its updates ended early.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// Convergence of every estimator at every stage; serialises as `tpm.updates/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Updates {
    /// `tpm.updates/1`.
    pub schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// Largest relative errors at which an estimator counts as converged.
    pub limits: [f64; 3],
    /// Convergence of every estimator at every stage; the stages of one estimator follow each other.
    pub estimators: Vec<Convergence>,
}

/// Plays `most` updates of every estimator at every stage of an experiment, from its prior, without noise.
///
/// # Errors
/// [`ExperimentError`] when the experiment does not fit the model.
pub fn updates(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    experiment: &Experiment,
    most: usize,
) -> Result<Updates, ExperimentError> {
    let stages = 0..experiment.schedule.stages.len();
    let cases: Vec<(Method, usize)> =
        Method::ALL.into_iter().flat_map(|method| stages.clone().map(move |stage| (method, stage))).collect();
    let estimators = cases
        .into_par_iter()
        .map(|(method, stage)| convergence(model, pattern, experiment, method, stage, most, STEPS))
        .collect::<Result<_, _>>()?;
    Ok(Updates { schema: "tpm.updates/1", model: model.name().into(), limits: LIMITS, estimators })
}

/// The experiment at one stage, with exact sensors and drives, measured rates, and no limits on inputs and tracking
/// error.
fn exact(experiment: &Experiment, method: Method, stage: usize, most: usize) -> Experiment {
    let mut exact = experiment.clone();
    exact.estimator = method;
    for sensor in exact.plant.sensors.values_mut() {
        *sensor = tpm_experiment::SensorSection::default();
    }
    exact.plant.input_steps.clear();
    exact.plant.actuators.clear();
    exact.actuators.clear();
    exact.motors = None;
    exact.limits.inputs.clear();
    exact.limits.tracking.clear();
    exact.control.derivative_filter = None;
    exact.control.position_filter = None;
    exact.control.smoothing = None;
    exact.control.compensation = HoldCompensation::None;
    let schedule = &mut exact.schedule;
    // Each update has its own stage, so that the campaign does not end early when the estimates no longer change.
    schedule.stages = schedule.stages.get(stage).map_or_else(Vec::new, |stage| vec![stage.clone(); most]);
    let gain = schedule.gains.get(stage).copied().unwrap_or(1.0);
    schedule.gains = vec![gain; schedule.stages.len()];
    schedule.measure_time = 0.0;
    schedule.updates_per_stage = 1;
    schedule.error.clear();
    exact
}

/// Plays `most` updates of one estimator at one stage (counted from 0), with the given number of samples and steps in a
/// period.
///
/// # Errors
/// [`ExperimentError`] when the experiment does not fit the model.
pub fn convergence(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    experiment: &Experiment,
    method: Method,
    stage: usize,
    most: usize,
    samples: usize,
) -> Result<Convergence, ExperimentError> {
    let mut exact = exact(experiment, method, stage, most);
    // The estimator `numerical` builds its whole matrix anew for every update: one run at the estimates, and one per
    // perturbed parameter. Other estimators need a single run.
    let runs_per_update = if method == Method::Numerical { model.dims().parameters + 1 } else { 1 };
    exact.schedule.max_runs = most * runs_per_update;
    let asked = exact.setup(model, pattern, Hold::None)?;
    let stage = asked.procedure.stages.first().ok_or(ExperimentError::NoStage)?;
    exact.control.sample_time = 2.0 * PI / stage.frequency / samples as f64;
    let names = &stage.pattern(&asked.pattern).amplitudes;
    let mut found = Convergence {
        estimator: method.name(),
        amplitudes: names.iter().cloned().zip(stage.amplitudes.iter().copied()).collect(),
        frequency: stage.frequency,
        runs_per_update,
        errors: Vec::with_capacity(most),
        updates: [None; 3],
        reason: None,
    };
    let truth = exact.bench(model)?.parameters;
    let setup = exact.setup(model, pattern, Hold::None)?;
    // A fault of one estimator is part of its result, and does not end the study.
    if let Err(reason) = play(model, setup, &truth, &mut found) {
        found.reason = Some(reason.to_string());
    }
    found.updates = LIMITS.map(|limit| found.errors.iter().position(|error| *error <= limit).map(|at| at + 1));
    Ok(found)
}

/// Plays a campaign in continuous time, and notes after every update the largest relative error of the observable
/// parameters.
fn play(model: &dyn Model<f64>, setup: Setup, truth: &[f64], found: &mut Convergence) -> Result<(), CampaignError> {
    let mut campaign = Campaign::new(model, setup)?;
    while let Some(trial) = campaign.next().cloned() {
        let run = trial.run + 1;
        let record =
            simulate_continuous(model, truth, &trial).map_err(|source| CampaignError::Trial { run, source })?;
        if campaign.submit(&record)?.updated {
            if found.errors.is_empty() {
                found.runs_per_update = run;
            }
            let hidden = campaign.estimate().map_or(&[][..], |estimate| &estimate.unobservable);
            let error = shown_error(campaign.current(), truth, hidden);
            found.errors.push(error);
            if LIMITS.iter().all(|limit| error <= *limit) {
                break;
            }
        }
    }
    Ok(())
}

/// Largest relative error of estimates, without the error along directions that the runs do not show.
fn shown_error(values: &[f64], truth: &[f64], hidden: &[Vec<f64>]) -> f64 {
    let size = |j: usize| if truth[j] == 0.0 { 1.0 } else { truth[j].abs() };
    let relative = DVector::from_fn(truth.len(), |j, _| (values[j] - truth[j]) / size(j));
    if hidden.is_empty() {
        return relative.amax();
    }
    let directions = DMatrix::from_fn(truth.len(), hidden.len(), |j, c| hidden[c][j] / size(j));
    let shown = complement(&directions);
    (&shown * shown.tr_mul(&relative)).amax()
}

#[cfg(test)]
mod tests {
    use super::{STEPS, convergence, updates};
    use std::f64::consts::PI;
    use std::vec;
    use tpm_estimate::Method;
    use tpm_experiment::{Experiment, StageSection};
    use tpm_test_support::models::MassSpringDrag;
    use tpm_test_support::{LATEST_ALONE, rest_to_rest_3};

    fn experiment() -> Experiment {
        let file = include_str!("../../../../models/mass_spring_drag.toml");
        Experiment::parse(file).expect("the shipped file is right")
    }

    fn stage(lambda: f64, w: f64) -> StageSection {
        let values = [("lambda", lambda), ("w", w)].into_iter().map(|(name, value)| (name.into(), value)).collect();
        StageSection { values, ..StageSection::default() }
    }

    /// The numbers of updates agree with those of an independent computation, from the latest run alone where an estimator needs no more.
    /// With all runs `error`, `hill` and `effort` need two: earlier ones count along the motion that they measured.
    #[test]
    fn every_estimator_needs_the_updates_that_it_should() {
        let mut experiment = experiment();
        experiment.schedule.stages = vec![stage(0.3, PI), stage(0.6, 2.0 * PI)];
        // The initial transient of the loop decays within a thirtieth of a second.
        experiment.schedule.settle_periods = 1;
        // Updates to each of the limits. A missing number of `effort` means ten or more.
        let table = [
            (Method::MeasuredMotion, 2, [[1, 1, 1], [1, 1, 1]]),
            (Method::Hill, 5, [[2, 3, 3], [3, 3, 4]]),
            (Method::Error, 8, [[3, 4, 5], [3, 5, 7]]),
            (Method::Numerical, 4, [[1, 2, 2], [2, 2, 3]]),
            (Method::Effort, 12, [[3, 5, 7], [4, 7, 10]]),
        ];
        for (method, most, settings) in table {
            let is_linearised = matches!(method, Method::Hill | Method::Error | Method::Effort);
            for (stage, expected) in settings.into_iter().enumerate() {
                let pattern = rest_to_rest_3();
                let found = |experiment: &Experiment| {
                    convergence(&MassSpringDrag, &pattern, experiment, method, stage, most, STEPS).expect("runs")
                };
                let pooled = found(&experiment).updates[1];
                assert!(pooled.is_some_and(|pooled| !is_linearised || pooled <= 2), "{method:?}: {pooled:?}");
                let mut alone = experiment.clone();
                alone.schedule.forgetting = if is_linearised { LATEST_ALONE } else { 1.0 };
                let own = found(&alone);
                for (found, expected) in own.updates.iter().zip(expected) {
                    let near = found.is_some_and(|found| found.abs_diff(expected) <= 1);
                    assert!(near, "{own:?}, expected {expected}");
                }
            }
        }
    }

    #[test]
    fn every_estimator_is_tried_at_every_stage() {
        let mut experiment = experiment();
        experiment.schedule.settle_periods = 1;
        experiment.schedule.stages = vec![stage(0.3, PI)];
        let found = updates(&MassSpringDrag, &rest_to_rest_3(), &experiment, 1).expect("runs");
        let names: vec::Vec<&str> = found.estimators.iter().map(|c| c.estimator).collect();
        assert_eq!(names, ["measured-motion", "error", "hill", "effort", "numerical"]);
        assert!(found.estimators.iter().all(|c| c.errors.len() == 1), "{found:?}");
    }

    /// With ordinary gains and every prior 30 % off, Hill's matrix with coupled harmonics squares the error at every
    /// update from the latest run alone; the matrix without coupling reduces it by a factor.
    #[test]
    fn coupled_harmonics_converge_quadratically() {
        let mut experiment = experiment();
        for (name, value) in [("m", 2.0), ("k1", 5.0), ("k2", 0.7)] {
            experiment.plant.parameters.insert(name.into(), value);
            experiment.prior.insert(name.into(), 1.3 * value);
        }
        experiment.control.feedback[0].kp = 60.0;
        experiment.control.feedback[0].kd = 15.0;
        experiment.harmonics = Some(6);
        experiment.schedule.settle_periods = 6;
        experiment.schedule.stages = vec![stage(0.5, 2.0)];
        experiment.schedule.forgetting = LATEST_ALONE;
        let errors = |method| {
            let found = convergence(&MassSpringDrag, &rest_to_rest_3(), &experiment, method, 0, 4, STEPS);
            found.expect("runs").errors
        };
        let hill = errors(Method::Hill);
        assert!(hill[0] <= 1.8e-2 && hill[1] <= 1e-4 && hill[2] <= 1e-10, "{hill:?}");
        let error = errors(Method::Error);
        for (found, expected) in error.iter().zip([1.1e-2, 3.4e-4, 2.5e-6, 8e-8]) {
            assert!(*found < 1.5 * expected && *found > expected / 1.5, "{error:?}");
        }
    }
}
