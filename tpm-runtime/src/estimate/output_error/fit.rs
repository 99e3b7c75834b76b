//! The fit of a record: noise, parameters and motion first, then what is left.

use crate::estimate::output_error::chain::Chain;
use crate::estimate::output_error::clipping;
use crate::estimate::output_error::error::OutputErrorFault;
use crate::estimate::output_error::misfit::{self, Candidate, CandidateKind, Half, Misfit};
use crate::estimate::output_error::problem::{Column, Differentiable, Place, Problem};
use crate::estimate::output_error::signals::Signals;
use crate::estimate::output_error::smoother::{Noise, Smoothed};
use crate::estimate::output_error::solution::Solution;
use crate::estimate::output_error::state::{Active, State};
use crate::numerics::DMatrix;
use std::borrow::Cow;
use std::vec;
use std::vec::Vec;

/// Shortest time between two stops of a machine, as a share of the period.
const SHORTEST_PASSAGE: f64 = 0.02;
/// Most limits of an input that are tried one after the other.
const MOST_MOVES: usize = 8;
/// A limit stays where it is when it moves by less than this share.
const STAYS: f64 = 1e-3;

/// Parameters that explain every sample of a record.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OutputError {
    /// Value of every parameter, in the model's units.
    pub values: Vec<f64>,
    /// Covariance of the free parameters from noise alone, in the order of `free`.
    covariance: DMatrix<f64>,
    /// Indices of the parameters that were estimated.
    pub free: Vec<usize>,
    /// Gauss-Newton steps that were made; nothing where they did not settle on parameters with the model as it is, so that the values
    /// are those from which they began.
    pub iterations: Option<usize>,
    /// Standard deviation of every sensor's noise as it was found, unit of the coordinate.
    pub sensor_noise: Vec<f64>,
    /// Standard deviation of the noise of every recorded input, unit of the input; zero where the record is taken as exact.
    pub input_noise: Vec<f64>,
    /// Correlation of each sensor's noise from one sample to the next.
    pub colour: Vec<f64>,
    /// Root mean square of measured less simulated motion, unit of the coordinate.
    pub residual: Vec<f64>,
    /// What is not explained, as a share: the largest of that residual beside the motion, and of what the inputs are taken to have
    /// been beside what was recorded.
    pub share: f64,
    /// What the model leaves unexplained.
    pub misfit: Misfit,
}

impl OutputError {
    /// Covariance of two free parameters, by their places in `free`, from noise alone; nothing beyond them.
    #[must_use]
    pub fn covariance(&self, one: usize, other: usize) -> Option<f64> {
        self.covariance.get((one, other)).copied()
    }

    /// Fits the free parameters of a model to a record, from given values on.
    ///
    /// # Errors
    /// [`OutputErrorFault`].
    pub fn fit(
        machine: Differentiable<'_>,
        constants: &[f64],
        signals: &Signals<'_>,
        start: &[f64],
        free: &[usize],
        hidden: &[Vec<f64>],
    ) -> Result<Self, OutputErrorFault> {
        let states = Problem::states(machine.model).ok_or(OutputErrorFault::NotSimulable)?;
        let samples = signals.coordinates.first().map_or(0, |c| c.len());
        let mut problem = Problem {
            machine,
            constants,
            hold: signals.hold,
            sample_time: signals.sample_time,
            coordinates: signals.coordinates.clone(),
            inputs: signals.inputs.iter().map(|input| Cow::Borrowed(*input)).collect(),
            free: free.to_vec(),
            states,
            breaks: vec![false; samples.saturating_sub(1)],
            steps: 1,
            disturbed: vec![0.0; samples * signals.inputs.len()],
            shortest_passage: (signals.samples_per_period * SHORTEST_PASSAGE) as usize,
        };
        let outputs = signals.coordinates.len();
        let mut clipped = clipping::find(&problem, signals, start)?;
        let mut state = State {
            motion: signals.motion(&problem.states),
            theta: clipped.as_ref().map_or(start, |clipped| &clipped.theta).to_vec(),
            terms: Vec::new(),
            noise: signals.noise(),
            own: Vec::new(),
        };
        let scale: Vec<f64> = (0..outputs).map(|c| state.noise.typical(c, outputs)).collect();
        problem.steps = problem.needed_steps(&state.motion, &state.theta)?;
        let begun = state.clone();
        let mut settled = Err(OutputErrorFault::NotConverged { steps: 0 });
        // Where the input leaves its limit depends on the limit, which is moved until it stays.
        for _ in 0..MOST_MOVES {
            state.own.clear();
            if let Some(clipped) = &clipped {
                problem.inputs[clipped.input] = Cow::Owned(clipped.applied.clone());
                state.own.push((clipped.edge.clone(), 0.0));
            }
            settled = state.settle(&mut problem, signals, &scale, hidden, true);
            let (Some(clipping), Some((_, moved)), Ok(_)) = (&mut clipped, state.own.first(), &settled) else { break };
            if moved.abs() <= STAYS * clipping.limit {
                break;
            }
            let limit = (clipping.limit + moved).clamp(0.5 * clipping.limit, 2.0 * clipping.limit);
            clipping.move_to(limit, signals.inputs[clipping.input]);
        }
        if settled.is_err() {
            // Terms that are missing may be what keeps the parameters from settling; they are looked for where the fit began.
            state = State { noise: state.noise, ..begun };
            problem.disturbed.fill(0.0);
        }
        let columns = misfit::columns(&problem, signals, &state.motion, &state.theta)?;
        let own = state.own.iter().map(|(column, _)| column.clone());
        let acting: Vec<Column> = own.chain(columns.iter().map(|candidate| candidate.column.clone())).collect();
        let mut values: Vec<f64> = state.own.iter().map(|(_, value)| *value).collect();
        values.resize(acting.len(), 0.0);
        let chain = problem.linearise_at(&state.motion, &state.theta, &acting, &values, &scale)?;
        let smoothed = Smoothed::new(&chain, &state.noise, false);
        let p = free.len() + state.own.len();
        let bare = Solution::of_columns(&smoothed, p, hidden)?;
        let mut found = misfit::judge(&smoothed, (free, p), &columns, &bare, signals, state.noise.is_plain());
        found.halves = halves(&chain, &state.noise, p, hidden);
        let mut explained = false;
        if !found.terms.is_empty() {
            // With the terms in the model the parameters may be far away, where the linear answer is not exact.
            let mut richer = State {
                terms: found
                    .terms
                    .iter()
                    .map(|term| Active { term: term.term, row: term.row, value: 0.0, std: 0.0 })
                    .collect(),
                ..state.clone()
            };
            let kept = problem.disturbed.clone();
            if richer.settle(&mut problem, signals, &scale, hidden, settled.is_err()).is_ok() {
                explained = true;
                for (term, active) in found.terms.iter_mut().zip(&richer.terms) {
                    (term.term, term.value) = (active.term, active.value);
                    term.std = active.std * found.scale.sqrt();
                }
                for (shift, &j) in found.shift.iter_mut().zip(free) {
                    *shift = richer.theta[j] - state.theta[j];
                }
            }
            problem.disturbed = kept;
        }
        if let (Some(clipped), Some((_, moved))) = (&clipped, state.own.first()) {
            let at = free.len();
            found.terms.insert(
                0,
                Candidate {
                    term: CandidateKind::Limit { input: clipped.input, limit: clipped.limit + moved },
                    row: match clipped.edge.place {
                        Place::Row(row) => Some(row),
                        Place::Reading(_) => None,
                    },
                    value: 1.0,
                    std: (bare.covariance[(at, at)] * found.scale).sqrt(),
                    gain: 1.0,
                },
            );
            found.limited = true;
        }
        let iterations = match settled {
            Ok(iterations) => Some(iterations),
            Err(_) if explained => None,
            Err(fault) => return Err(fault),
        };
        let residual = (0..outputs)
            .map(|c| {
                let of = chain.errors.iter().skip(c).step_by(outputs);
                (of.map(|e| e * e).sum::<f64>() / samples.max(1) as f64).sqrt()
            })
            .collect();
        let spread = |signal: &[f64]| -> f64 {
            let mean = signal.iter().sum::<f64>() / signal.len().max(1) as f64;
            (signal.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / signal.len().max(1) as f64).sqrt()
        };
        let residual: Vec<f64> = residual;
        let by_motion = residual.iter().zip(&signals.coordinates).map(|(left, signal)| left / spread(signal));
        let inputs = signals.inputs.len();
        let by_input = signals.inputs.iter().enumerate().map(|(i, input)| {
            let taken: Vec<f64> = problem.disturbed.iter().skip(i).step_by(inputs.max(1)).copied().collect();
            spread(&taken) / spread(input)
        });
        let share = by_motion.chain(by_input).filter(|share| share.is_finite()).fold(0.0, f64::max);
        Ok(OutputError {
            share,
            values: state.theta,
            covariance: &bare.covariance * found.scale,
            free: free.to_vec(),
            iterations,
            sensor_noise: signals.sensor_noise(&scale, found.scale),
            input_noise: state.noise.inputs.iter().map(|sigma| sigma * found.scale.sqrt()).collect(),
            colour: state.noise.colour,
            residual,
            misfit: found,
        })
    }
}

/// The steps of the first `p` columns that either half of a record asks for, with their variances; nothing where a half does not show
/// them.
fn halves(chain: &Chain, noise: &Noise, p: usize, hidden: &[Vec<f64>]) -> Vec<Half> {
    let middle = chain.samples / 2;
    let outputs = chain.outputs.len();
    let of = |from: usize, samples: usize| -> Option<Vec<(f64, f64)>> {
        let part = chain.stretch(from, samples);
        let readings = noise.readings[from * outputs..(from + samples) * outputs].to_vec();
        let smoothed = Smoothed::new(&part, &Noise { readings, ..noise.clone() }, false);
        let solution = Solution::of_columns(&smoothed, p, hidden).ok()?;
        Some((0..p).map(|j| (solution.step[j], solution.covariance[(j, j)])).collect())
    };
    let (Some(first), Some(second)) = (of(0, middle), of(middle, chain.samples - middle)) else { return Vec::new() };
    let pair = |((first, own), (second, other)): ((f64, f64), (f64, f64))| Half {
        moved: second - first,
        variance: own + other,
    };
    first.into_iter().zip(second).map(pair).collect()
}
