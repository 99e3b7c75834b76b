//! Experiment design before any motion: the information that candidate trials would give, and whether they keep within
//! the limits.
//!
//! Invariant: a prediction is the Cramer-Rao bound of the steady state for the noise of the simulated sensors. One function
//! ([`run_information`]) predicts candidates and the runs of a study. Candidates are compared by the
//! determinant of the scaled information matrix (D-optimality). Among candidates of equal rank, those with a harmonic
//! near a natural mode of the estimated model are placed after the others (Feng, 3.2.1). A candidate that passes a
//! limit is ranked last, with the sample at which it does.

use crate::by_name::by_name;
use num_integer::gcd;
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::PI;
use tpm_campaign::{
    LEAST_NOISE, LEAST_PERIODS, NearMode, RunReport, Setup, Stage, combined_multiples, near_mode, run_information,
    sensor_deviations, strayed,
};
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model;
use tpm_experiment::{Experiment, ExperimentError};
use tpm_motion::trajectory::{HarmonicSeries, ReferencePattern, Trajectory};
use tpm_motion::{Record, RunEnding, Trial, TrialError, TrialSettings};
use tpm_numerics::DMatrix;
use tpm_numerics::fourier::analyse;
use tpm_numerics::singular::{Singular, unit_columns};
use tpm_numerics::tolerance;
use tpm_plant::simulated::{Rig, Sensor, simulate};

/// Factors on the last stage's amplitudes, and on its frequency, from which candidates are formed.
const SHARES: [f64; 4] = [0.4, 0.6, 0.8, 1.0];
/// Highest harmonic up to which the derivatives of the motion are computed, as a multiple of the motion's highest
/// harmonic.
const REACH: usize = 2;

/// The predicted standard deviation of one parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Predicted {
    /// Name of the parameter.
    pub name: String,
    /// Standard deviation; nothing when the candidate's motion does not determine the parameter.
    pub std: Option<f64>,
}

/// Where a candidate passes a limit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Passed {
    /// The input.
    pub input: String,
    /// Sample of the period.
    pub sample: usize,
    /// Demand on the input at this sample, as a share of the limit.
    pub share: f64,
}

/// Candidates, with the estimates and the noise for which they were predicted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Design {
    /// Values of the parameters: the prior, and the simulated machine's value where the prior is zero.
    #[serde(serialize_with = "by_name")]
    pub estimates: Vec<(String, f64)>,
    /// Standard deviation of the position noise of one sample at the last stage, unit of the coordinate; a millionth of
    /// the amplitude for sensors without noise. An encoder's error that repeats in every period is replaced by the
    /// white noise that has the same variance after averaging over the periods.
    #[serde(serialize_with = "by_name")]
    pub noise: Vec<(String, f64)>,
    /// Candidates, best first; those that pass a limit come last.
    pub candidates: Vec<Candidate>,
}

/// One candidate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Candidate {
    /// Names and values of the amplitudes.
    #[serde(serialize_with = "by_name")]
    pub amplitudes: Vec<(String, f64)>,
    /// Fundamental frequency, rad/s.
    pub frequency: f64,
    /// Multiple of the frequency by coordinate.
    #[serde(serialize_with = "by_name")]
    pub multiples: Vec<(String, u32)>,
    /// Rank of the scaled equations: the number of parameter combinations that the candidate determines.
    pub rank: usize,
    /// Condition number of the scaled equations over the directions that the candidate determines.
    pub condition: f64,
    /// Natural logarithm of the determinant of the information matrix, every parameter scaled by its estimate.
    pub determinant: f64,
    /// Predicted standard deviations of the parameters.
    pub parameters: Vec<Predicted>,
    /// Largest share of its limit that an input uses; nothing without limits.
    pub effort_share: Option<f64>,
    /// Highest harmonic of an input's feed-forward above a thousandth of that input's largest harmonic.
    pub input_harmonics: usize,
    /// A harmonic near a natural mode of the estimated model; nothing where there is none.
    pub near_mode: Option<NearMode>,
    /// The sample at which a limit is exceeded by the largest share; nothing when all inputs keep within the permitted
    /// share.
    pub passed: Option<Passed>,
    /// The motion.
    #[serde(skip)]
    pub trajectory: Trajectory,
}

/// Candidates around the last stage of an experiment's schedule: factors on its amplitudes and frequency, and multiples
/// of the frequency when a few coordinates move. Each candidate is measured for the experiment's `measure_time`.
///
/// # Errors
/// [`ExperimentError`] when the experiment does not fit the model, has no stage, or no candidate's motion can be
/// predicted.
pub fn design(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    experiment: &Experiment,
) -> Result<Design, ExperimentError> {
    let setup = experiment.setup(model, pattern, Hold::Zoh)?;
    let bench = experiment.bench(model)?;
    let theta = estimates(&setup, &bench);
    let last = setup.procedure.stages.last().ok_or(ExperimentError::NoStage)?;
    let pattern = last.pattern(pattern);
    let moves: Vec<bool> = pattern.coordinates.iter().map(|parts| !parts.is_empty()).collect();
    // Combinations of multiples of the frequency, without those that have a common divisor.
    let mut multiples = combined_multiples(&moves);
    multiples.retain(|list| list.iter().copied().reduce(gcd) == Some(1));
    if multiples.is_empty() {
        multiples.push(last.multiples.clone());
    }
    let fastest = f64::from(last.multiples.iter().copied().max().unwrap_or(1)) * last.frequency;
    let machine = Rig { parameters: theta.clone(), constants: setup.constants.clone(), ..bench };
    let candidate = |(share, speed, list): (f64, f64, &Vec<u32>)| {
        // The frequency is lowered so that the fastest coordinate has at most the velocity that it has in the schedule.
        let frequency = speed * fastest / f64::from(list.iter().copied().max().unwrap_or(1));
        let amplitudes: Vec<f64> = last.amplitudes.iter().map(|a| a * share).collect();
        let stage = Stage { amplitudes, frequency, multiples: list.clone(), ..last.clone() };
        let periods = periods(&setup, stage.trajectory(pattern, 1.0).frequency);
        let settled = setup.procedure.settle_periods;
        // A stage for which no trial can be computed gives no candidate.
        let Ok(trial) = trial(model, pattern, &setup, &stage, settled + LEAST_PERIODS, &theta) else { return Ok(None) };
        let reach = 4 * trial.trajectory.highest_harmonic() as usize;
        let stray = strayed(model, &machine, &trial, &trial.trajectory, settled)?;
        let size = (trial.samples_per_period, periods);
        let root = run_information(model, &machine, &trial.trajectory, size, &stray, reach)?;
        Ok(root.map(|root| judge(model, pattern, &stage, &trial, &theta, root.dense(), setup.procedure.effort_share)))
    };
    // Every combination of a factor on the amplitudes, a factor on the frequency, and multiples is predicted.
    let mut asked: Vec<(f64, f64, &Vec<u32>)> = Vec::new();
    for share in SHARES {
        for speed in SHARES {
            asked.extend(multiples.iter().map(|list| (share, speed, list)));
        }
    }
    let found: Vec<Option<Candidate>> = asked.into_par_iter().map(candidate).collect::<Result<_, ExperimentError>>()?;
    let mut candidates: Vec<Candidate> = found.into_iter().flatten().collect();
    let estimates = (0..theta.len()).map(|j| (model.parameter(j).name.to_string(), theta[j]));
    if candidates.is_empty() {
        let estimates = estimates.map(|(name, value)| format!("{name} = {value}")).collect();
        return Err(ExperimentError::Unpredictable { estimates });
    }
    // The best candidates come first.
    candidates.sort_by(|a: &Candidate, b: &Candidate| {
        let key = |c: &Candidate| (c.passed.is_some(), std::cmp::Reverse(c.rank), c.near_mode.is_some());
        key(a).cmp(&key(b)).then(b.determinant.total_cmp(&a.determinant))
    });
    let reference = last.trajectory(pattern, 1.0);
    let noise = sensor_deviations(&machine, &reference, periods(&setup, reference.frequency));
    let noise = noise.into_iter().enumerate().map(|(c, value)| (model.coordinate(c).name.to_string(), value));
    Ok(Design { estimates: estimates.collect(), noise: noise.collect(), candidates })
}

/// The prior, and the simulated machine's value where the prior is zero.
pub(crate) fn estimates(setup: &Setup, bench: &Rig) -> Vec<f64> {
    // A machine that does not obey the model has no values of its parameters.
    let truths = bench.parameters.iter().copied().chain(std::iter::repeat(0.0));
    setup.prior.iter().zip(truths).map(|(&prior, truth)| if prior == 0.0 { truth } else { prior }).collect()
}

/// Whole periods in the measured time of a run.
fn periods(setup: &Setup, frequency: f64) -> usize {
    ((setup.procedure.measure_time * frequency / (2.0 * PI)).ceil() as usize).max(LEAST_PERIODS)
}

/// Rank, condition and covariance of the parameters from equations whose residuals have unit variance.
struct Shown {
    /// Euclidean norm of every column.
    scale: Vec<f64>,
    rank: usize,
    /// Condition number of the scaled columns over the determined directions.
    condition: f64,
    /// Natural logarithm of the determinant of the scaled information matrix over the determined directions.
    determinant: f64,
    /// Standard deviation of every parameter; nothing when an undetermined direction contains the parameter.
    deviations: Vec<Option<f64>>,
}

fn shown(root: &DMatrix<f64>) -> Shown {
    let p = root.ncols();
    let (scaled, scale) = unit_columns(root.clone());
    let singular = Singular::new(&scaled, tolerance::JACOBIAN_RANK);
    let mut variance = vec![0.0; p];
    for (value, direction) in singular.values.iter().zip(singular.right.column_iter()) {
        for j in 0..p {
            variance[j] += (direction[j] / value / scale[j]).powi(2);
        }
    }
    let null = singular.null();
    let hidden = |j: usize| null.row(j).iter().any(|part| part.abs() > 1e-6);
    Shown {
        rank: singular.rank(),
        condition: singular.condition(),
        determinant: singular.values.iter().map(|value| 2.0 * value.ln()).sum(),
        deviations: (0..p).map(|j| (!hidden(j)).then(|| variance[j].sqrt())).collect(),
        scale,
    }
}

/// The Cramer-Rao bounds of the standard deviations after these runs of the simulated machine. Every complete run
/// counts with all its measured periods, along its motion without noise: a run from wrong estimates departs from its
/// reference, and its motion may carry much more information. `None` where there is no run, or a run cannot be
/// predicted.
pub(super) fn bounds(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    experiment: &Experiment,
    runs: &[RunReport],
) -> Result<Option<Vec<Option<f64>>>, ExperimentError> {
    let setup = experiment.setup(model, pattern, Hold::Zoh)?;
    let noisy = experiment.bench(model)?;
    if noisy.parameters.len() != model.dims().parameters {
        // The simulated machine does not obey the model, so no bound can be predicted.
        return Ok(None);
    }
    let mut bench = noisy.clone();
    bench.sensors.fill(Sensor::default());
    let mut rows: Vec<DMatrix<f64>> = Vec::new();
    for run in runs.iter().filter(|run| run.ending == RunEnding::Complete && run.periods > 0) {
        let Some(asked) = setup.procedure.stages.get(run.stage.wrapping_sub(1)) else { return Ok(None) };
        let frequency = if asked.strokes.is_empty() { run.frequency } else { asked.frequency };
        let amplitudes = run.amplitudes.iter().map(|(_, value)| *value).collect();
        let stage = Stage { amplitudes, frequency, ..asked.clone() };
        let settled = run.settled_after.unwrap_or(setup.procedure.settle_periods);
        let played = trial(model, pattern, &setup, &stage, settled + run.periods, &run.played);
        let Ok(trial) = played else { return Ok(None) };
        let record = simulate(model, &bench, &trial)?;
        if record.len() < trial.samples() {
            return Ok(None);
        }
        let motion = motion(&trial, &record);
        let reach = REACH * motion.highest_harmonic() as usize;
        let stray = strayed(model, &noisy, &trial, &motion, settled)?;
        let predicted =
            run_information(model, &noisy, &motion, (trial.samples_per_period, run.periods), &stray, reach)?;
        let Some(root) = predicted else { return Ok(None) };
        rows.push(root.dense().clone());
    }
    let Some(first) = rows.first() else { return Ok(None) };
    let mut whole = DMatrix::zeros(rows.iter().map(DMatrix::nrows).sum(), first.ncols());
    let mut at = 0;
    for root in &rows {
        whole.rows_mut(at, root.nrows()).copy_from(root);
        at += root.nrows();
    }
    Ok(Some(shown(&whole).deviations))
}

/// The motion in the last period of a run, as the Fourier series of every harmonic above rounding and above the
/// remainder of the initial transient.
fn motion(trial: &Trial, record: &Record) -> Trajectory {
    let samples = trial.samples_per_period;
    let most = 8 * trial.trajectory.highest_harmonic().max(1) as usize;
    let series = |channel: &Vec<f64>| {
        let last = &channel[record.len() - samples..];
        let lines = analyse(last, 0, 1, most.min(samples / 2));
        let largest = lines.iter().skip(1).map(|line| line.norm()).fold(0.0, f64::max);
        HarmonicSeries::from_phasors(&lines, |_, line| line.norm() > LEAST_NOISE * largest)
    };
    let coordinates = record.coordinates.iter().map(series).collect();
    Trajectory { frequency: trial.trajectory.frequency, coordinates }
}

/// The trial of one run of a stage.
fn trial(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    setup: &Setup,
    stage: &Stage,
    periods: usize,
    parameters: &[f64],
) -> Result<Trial, TrialError> {
    Trial::new(
        model,
        TrialSettings {
            run: 0,
            trajectory: stage.trajectory(pattern, 1.0),
            open: &stage.pattern(pattern).open(),
            pattern: None,
            amplitudes: stage.amplitudes.clone(),
            periods,
            control: &setup.control.scaled(stage.gain),
            parameters,
            constants: &setup.constants,
            tracking_bounds: &setup.procedure.tracking_bounds,
            input_limits: &setup.procedure.input_limits,
            position_bounds: &setup.procedure.position_bounds,
            velocity_bounds: &setup.procedure.velocity_bounds,
        },
    )
}

fn judge(
    model: &dyn Model<f64>,
    pattern: &ReferencePattern,
    stage: &Stage,
    trial: &Trial,
    theta: &[f64],
    root: &DMatrix<f64>,
    share: f64,
) -> Candidate {
    let Shown { scale, rank, condition, mut determinant, deviations } = shown(root);
    for (s, value) in scale.iter().zip(theta) {
        determinant += 2.0 * (s * if *value == 0.0 { 1.0 } else { value.abs() }).ln();
    }
    let (most, input, sample) = trial.feed_forward_share();
    let limited = trial.input_limits.iter().any(|limit| limit.is_finite());
    let passed = Passed { input: model.input(input).name.to_string(), sample, share: most };
    Candidate {
        amplitudes: pattern.amplitudes.iter().cloned().zip(stage.amplitudes.iter().copied()).collect(),
        frequency: trial.trajectory.frequency,
        multiples: (0..stage.multiples.len())
            .map(|c| (model.coordinate(c).name.to_string(), stage.multiples[c]))
            .collect(),
        rank,
        condition,
        determinant,
        parameters: deviations
            .into_iter()
            .enumerate()
            .map(|(j, std)| Predicted { name: model.parameter(j).name.to_string(), std })
            .collect(),
        effort_share: limited.then_some(most),
        input_harmonics: input_harmonics(trial, model.dims().inputs),
        near_mode: near_mode(model, trial),
        passed: (limited && most >= share).then_some(passed),
        trajectory: trial.trajectory.clone(),
    }
}

/// Highest harmonic of an input's feed-forward above a thousandth of that input's largest harmonic.
fn input_harmonics(trial: &Trial, inputs: usize) -> usize {
    let reach = (8 * trial.trajectory.highest_harmonic() as usize).min(trial.samples_per_period / 2);
    let size = |input: usize, k: usize| {
        let (mut re, mut im) = (0.0, 0.0);
        for (n, sample) in trial.feed_forward.iter().skip(input).step_by(inputs.max(1)).enumerate() {
            let phase = 2.0 * PI * ((k * n) % trial.samples_per_period) as f64 / trial.samples_per_period as f64;
            re += sample * phase.cos();
            im += sample * phase.sin();
        }
        f64::hypot(re, im)
    };
    (0..inputs)
        .map(|input| {
            let sizes: Vec<f64> = (1..=reach).map(|k| size(input, k)).collect();
            let largest = sizes.iter().copied().fold(0.0, f64::max);
            sizes.iter().rposition(|s| *s > 1e-3 * largest).map_or(0, |k| k + 1)
        })
        .max()
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::design;
    use std::f64::consts::PI;
    use tpm_experiment::Experiment;
    use tpm_test_support::models::MassSpringDrag;
    use tpm_test_support::rest_to_rest_3;

    fn experiment() -> Experiment {
        let mut experiment = Experiment::parse(include_str!("../../../../models/mass_spring_drag.toml"))
            .expect("the shipped file is right");
        for (name, value) in [("m", 2.0), ("k1", 40.0), ("k2", 1.5)] {
            experiment.prior.insert(name.to_string(), value);
        }
        experiment.plant.sensors.entry("x".to_string()).or_default().step = 0.0;
        experiment
    }

    #[test]
    fn predictions_are_the_bounds_that_were_found_by_sensitivities_in_time() {
        // Feng 3.24, sigma = 1e-3, 20 s at 1 kHz: relative bounds at (lambda, w) = (0.3, pi) and (0.6, 2 pi).
        for (lambda, w, bounds) in [(0.3, 1.0, [2.6e-4, 1.3e-4, 2.8e-4]), (0.6, 2.0, [1.6e-4, 3.1e-4, 4.9e-5])] {
            let mut experiment = experiment();
            experiment.schedule.stages.truncate(1);
            experiment.schedule.stages[0].values.insert("lambda".to_string(), lambda);
            experiment.schedule.stages[0].values.insert("w".to_string(), w * PI);
            let found = design(&MassSpringDrag, &rest_to_rest_3(), &experiment).expect("candidates").candidates;
            let full = found
                .iter()
                .find(|c| (c.amplitudes[0].1 - lambda).abs() < 1e-9 && (c.frequency / (w * PI) - 1.0).abs() < 1e-3)
                .expect("the stage itself");
            for ((predicted, truth), bound) in full.parameters.iter().zip([2.0, 40.0, 1.5]).zip(bounds) {
                let relative = predicted.std.expect("shown") / truth;
                assert!((relative / bound - 1.0).abs() < 0.05, "{}: {relative:e} {bound:e}", predicted.name);
            }
        }
    }

    #[test]
    fn candidates_away_from_the_natural_mode_come_first() {
        // The natural mode at sqrt(k1/m) = 4.472 rad/s is near the last stage itself, and near the second harmonic of
        // the force at half its frequency.
        let mut experiment = experiment();
        experiment.schedule.stages.truncate(1);
        experiment.schedule.stages[0].values.insert("w".to_string(), 4.4);
        let found = design(&MassSpringDrag, &rest_to_rest_3(), &experiment).expect("candidates").candidates;
        let near = |w: f64| found.iter().filter(move |c| (c.frequency / w - 1.0).abs() < 1e-2);
        assert!(near(4.4).count() == 4 && near(4.4).all(|c| c.near_mode.is_some()));
        assert!(near(0.8 * 4.4).count() == 4 && near(0.8 * 4.4).all(|c| c.near_mode.is_none()));
        let first = found.iter().position(|c| c.near_mode.is_some()).expect("some");
        assert!(found[first..].iter().all(|c| c.near_mode.is_some()), "they come last");
    }

    #[test]
    fn limits_are_kept_and_the_sample_that_passes_one_is_named() {
        let mut experiment = experiment();
        experiment.limits.inputs.insert("u".to_string(), 40.0);
        let found = design(&MassSpringDrag, &rest_to_rest_3(), &experiment).expect("candidates").candidates;
        assert_eq!(found.len(), 16);
        let within = found.iter().take_while(|c| c.passed.is_none()).count();
        assert!(within > 0 && within < 16);
        for pair in found[..within].windows(2) {
            assert!(pair[0].determinant >= pair[1].determinant);
        }
        let beyond = found[15].passed.as_ref().expect("the largest passes it");
        assert!(beyond.share >= 0.7 && beyond.input == "u");
        assert!(found[0].effort_share.expect("limited") < 0.7);
    }
}
