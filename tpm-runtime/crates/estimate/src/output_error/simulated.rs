//! The motion of a record simulated from its inputs with given parameters: one sample ahead, and freely.
//!
//! Nothing is fitted but what any simulation of a record needs: the noise of sensors and inputs with which the record is most likely,
//! and the motion smoothed with it. The free run of a stretch begins with the smoothed state at its first sample and sees the recorded
//! inputs alone, whatever loop made them.

use crate::output_error::chain::Chain;
use crate::output_error::error::OutputErrorFault;
use crate::output_error::predictor::{Predictions, advance, predict};
use crate::output_error::problem::{Differentiable, Problem};
use crate::output_error::signals::Signals;
use crate::output_error::state::State;
use tpm_motion::{Plant, PlantError};

/// A free run that is farther from the record than so many of its standard deviations has left it.
const FARTHEST_DEVIATIONS: f64 = 10.0;
/// Samples at the beginning of a stretch that are not counted one step ahead, in units of the highest order of a coordinate: they
/// determine the state.
const UNCOUNTED_PER_ORDER: usize = 2;

/// Deviation of a predicted reading, in units of the median, above which the filter has not forgotten a start or a stop.
const MOST_OVER_MEDIAN: f64 = 1.1;

/// Where a free run leaves the record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Divergence {
    /// Number of the stretch, from 0.
    pub stretch: usize,
    /// Time since its first sample, s.
    pub time: f64,
    /// Whether the record is unstable from its inputs alone: an error of the starting state as small as the readings can make it grows to
    /// the size of the motion. Otherwise the simulated motion with these parameters leaves the measured one.
    pub unstable: bool,
}

/// The motion of a record simulated from its inputs.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Simulated {
    /// Readings predicted one sample ahead, by coordinate.
    pub one_step: Vec<Vec<f64>>,
    /// Readings less predicted ones, in units of their deviations, by coordinate.
    pub normalised: Vec<Vec<f64>>,
    /// Whether a sample counts one step ahead: those that determine the state of a stretch do not.
    pub counts: Vec<bool>,
    /// Whether a prediction error is one of those that are white where the model is right. Around stops of a machine with dry friction,
    /// whose force is anything between its two, the filter takes more noise than there is.
    pub regular: Vec<bool>,
    /// Readings of the free run, by coordinate; not a number from where it leaves all bounds.
    pub free_run: Vec<Vec<f64>>,
    /// Where the free run leaves the record first; nothing where it does not.
    pub divergence: Option<Divergence>,
    /// Standard deviation of every sensor's noise as it was found, unit of the coordinate.
    pub sensor_noise: Vec<f64>,
    /// Standard deviation of the noise of every input as it was found, unit of the input; zero where the record is taken as exact.
    pub input_noise: Vec<f64>,
}

impl Simulated {
    /// Simulates a record with one value per parameter of the model.
    ///
    /// # Errors
    /// [`OutputErrorFault`].
    pub fn of(
        machine: Differentiable<'_>,
        constants: &[f64],
        signals: &Signals<'_>,
        parameters: &[f64],
    ) -> Result<Self, OutputErrorFault> {
        let signals = &Signals { rates: Vec::new(), ..signals.clone() };
        let noise = signals.noise();
        let mut problem = Problem::new(machine, constants, signals, &noise, &[], &[])?;
        let mut state = State::begun(&problem, signals, noise, parameters);
        problem.steps = problem.needed_steps(&state.trajectory, parameters)?;
        state.settle(&problem, signals, true)?;
        let chain = problem.linearise_at(&state.trajectory, parameters, &[], &[])?;
        let mut plant = Plant::new(machine.model, parameters, constants)?;
        let predictions = predict(&problem, &state, &chain, &mut plant)?;
        let highest = problem.states.iter().map(|(_, derivative)| derivative + 1).max().unwrap_or(1);
        let samples = problem.samples();
        let mut counts = vec![true; samples];
        for start in starts(&problem.breaks) {
            counts[start..samples.min(start + UNCOUNTED_PER_ORDER * highest)].fill(false);
        }
        let outputs = problem.coordinates.len();
        let by_coordinate = |values: &[f64]| -> Vec<Vec<f64>> {
            (0..outputs).map(|c| values.iter().skip(c).step_by(outputs).copied().collect()).collect()
        };
        let one_step = by_coordinate(&predictions.readings);
        let normalised: Vec<Vec<f64>> = (one_step
            .iter()
            .zip(&problem.coordinates)
            .zip(by_coordinate(&predictions.deviations)))
        .map(|((predicted, measured), deviations)| {
            let errors = measured.iter().zip(predicted).zip(&deviations);
            errors.map(|((y, predicted), deviation)| (y - predicted) / deviation.max(f64::MIN_POSITIVE)).collect()
        })
        .collect();
        let counted = || normalised.iter().flat_map(|errors| errors.iter().zip(&counts).filter(|(_, counts)| **counts));
        let scale = counted().map(|(e, _)| e * e).sum::<f64>() / counted().count().max(1) as f64;
        let regular = regular(&chain, &predictions.deviations, &counts);
        let FreeRun { readings, away, left } = free_run(&problem, &state, &mut plant)?;
        // A run that stays near the record is compared with it, however errors may grow.
        let divergence = match away.filter(|_| grows(&problem, &chain, &predictions)) {
            Some(away) => Some(Divergence { unstable: true, ..away }),
            None => left,
        };
        Ok(Simulated {
            one_step,
            normalised,
            counts,
            regular,
            free_run: readings,
            divergence,
            sensor_noise: signals.sensor_noise(&problem.scale, scale),
            input_noise: state.noise.inputs.iter().map(|sigma| sigma * scale.sqrt()).collect(),
        })
    }
}

/// Samples that count, at which no force of friction is loose and all readings are predicted with their usual deviation.
fn regular(chain: &Chain, deviations: &[f64], counts: &[bool]) -> Vec<bool> {
    let (samples, outputs) = (chain.samples, chain.outputs.len());
    let is_loose = |transition: usize| {
        let loose = chain.loose.get(transition * chain.switches..(transition + 1) * chain.switches);
        loose.is_some_and(|loose| loose.iter().any(|size| *size > 0.0))
    };
    let mut regular: Vec<bool> = (0..samples).map(|k| counts[k] && !(k > 0 && is_loose(k - 1))).collect();
    for c in 0..outputs {
        let own = |k: usize| deviations[k * outputs + c];
        let mut usual: Vec<f64> = (0..samples).filter(|&k| regular[k]).map(own).collect();
        if usual.is_empty() {
            break;
        }
        let middle = usual.len() / 2;
        let median = *usual.select_nth_unstable_by(middle, f64::total_cmp).1;
        (0..samples).for_each(|k| regular[k] &= own(k) <= MOST_OVER_MEDIAN * median);
    }
    regular
}

/// First samples of the stretches.
fn starts(breaks: &[bool]) -> impl Iterator<Item = usize> + '_ {
    let later = breaks.iter().enumerate().filter(|(_, breaks)| **breaks).map(|(k, _)| k + 1);
    [0].into_iter().chain(later)
}

/// Standard deviation of a coordinate's record.
fn spread(signal: &[f64]) -> f64 {
    let count = signal.len().max(1) as f64;
    let mean = signal.iter().sum::<f64>() / count;
    (signal.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// The free run of every stretch.
struct FreeRun {
    /// By coordinate.
    readings: Vec<Vec<f64>>,
    /// Where it is first farther from the record than the record's own standard deviation.
    away: Option<Divergence>,
    /// Where it is so first and then leaves the record by [`FARTHEST_DEVIATIONS`] of it.
    left: Option<Divergence>,
}

/// Simulates every stretch freely.
fn free_run(problem: &Problem<'_>, state: &State, plant: &mut Plant<'_>) -> Result<FreeRun, OutputErrorFault> {
    let (n, samples) = (problem.states.len(), problem.samples());
    let mut run = vec![vec![f64::NAN; samples]; problem.coordinates.len()];
    let spreads: Vec<f64> = problem.coordinates.iter().map(|signal| spread(signal)).collect();
    let (mut first, mut left) = (None, None);
    let begins: Vec<usize> = starts(&problem.breaks).collect();
    for (stretch, &start) in begins.iter().enumerate() {
        let end = begins.get(stretch + 1).copied().unwrap_or(samples);
        let mut motion = vec![0.0; problem.machine.model.dims().motion_len()];
        for (&of, value) in problem.states.iter().zip(&state.trajectory.states[start * n..(start + 1) * n]) {
            motion[problem.place(of)] = *value;
        }
        plant.reset(&motion)?;
        // The first sample at which the run is farther away than the record's own deviation, until it comes back.
        let mut away: Option<usize> = None;
        for k in start..end {
            let mut farthest: f64 = 0.0;
            let positions = plant.motion().iter().zip(&problem.coordinates);
            for (((&value, signal), run), spread) in positions.zip(&mut run).zip(&spreads) {
                run[k] = value;
                farthest = farthest.max((value - signal[k]).abs() / spread.max(f64::MIN_POSITIVE));
            }
            away = if farthest > 1.0 { away.or(Some(k)) } else { None };
            let at = |k: usize| {
                let time = (k - start) as f64 * problem.sample_time;
                Divergence { stretch, time, unstable: false }
            };
            first = first.or(away.map(at));
            let advanced = if k + 1 < end { advance(problem, k, plant) } else { Ok(()) };
            let diverged = match advanced {
                Ok(()) => farthest > FARTHEST_DEVIATIONS,
                Err(PlantError::Evaluation(fault)) => return Err(fault.into()),
                Err(PlantError::Diverged { .. }) => true,
            };
            if diverged {
                left = left.or(Some(at(away.unwrap_or(k))));
            }
            if advanced.is_err() {
                break;
            }
        }
    }
    Ok(FreeRun { readings: run, away: first.or(left), left })
}

/// Whether an error of the state at the beginning of a stretch, as large as the least deviation of a filtered state, grows to the standard
/// deviation of a coordinate, along the smoothed motion.
fn grows(problem: &Problem<'_>, chain: &Chain, predictions: &Predictions) -> bool {
    let n = chain.order;
    let spreads: Vec<f64> = problem.coordinates.iter().map(|signal| spread(signal)).collect();
    let begins: Vec<usize> = starts(&problem.breaks).collect();
    for (stretch, &start) in begins.iter().enumerate() {
        let end = begins.get(stretch + 1).copied().unwrap_or(chain.samples);
        // Column j: what the deviation of state j has become.
        let mut errors = vec![0.0; n * n];
        for (s, deviation) in predictions.states.iter().enumerate() {
            errors[s * (n + 1)] = *deviation;
        }
        for k in start..end.saturating_sub(1) {
            let mut next = vec![0.0; n * n];
            for i in 0..n {
                for (s, factor) in chain.transition(k, i).iter().enumerate() {
                    for j in 0..n {
                        next[i * n + j] += factor * errors[s * n + j];
                    }
                }
            }
            errors = next;
            let over = chain.outputs.iter().zip(&spreads).any(|(&at, spread)| {
                let size: f64 = errors[at * n..(at + 1) * n].iter().map(|e| e * e).sum();
                *spread > 0.0 && size.sqrt() > *spread
            });
            if over {
                return true;
            }
        }
    }
    false
}
