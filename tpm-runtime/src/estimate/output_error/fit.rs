//! The fit of a record: noise, parameters and motion first, then what is left.

use crate::estimate::output_error::clipping::{self, Clipping};
use crate::estimate::output_error::error::OutputErrorFault;
use crate::estimate::output_error::misfit::{self, Misfit};
use crate::estimate::output_error::problem::{Differentiable, Problem, Trajectory};
use crate::estimate::output_error::signals::Signals;
use crate::estimate::output_error::state::State;
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
        let outputs = signals.coordinates.len();
        let noise = signals.noise();
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
            shortest_passage: (signals.samples_per_period * SHORTEST_PASSAGE) as usize,
            scale: (0..outputs).map(|c| noise.typical(c, outputs)).collect(),
            hidden: hidden.to_vec(),
        };
        let mut clipped = clipping::find(&problem, signals, start)?;
        let begun = State {
            trajectory: Trajectory {
                states: signals.motion(&problem.states),
                disturbed: vec![0.0; samples * signals.inputs.len()],
            },
            theta: clipped.as_ref().map_or(start, |clipped| &clipped.theta).to_vec(),
            terms: Vec::new(),
            noise,
            own: Vec::new(),
        };
        problem.steps = problem.needed_steps(&begun.trajectory, &begun.theta)?;
        let mut state = begun.clone();
        let settled = settle_with_limit(&mut state, &mut problem, signals, clipped.as_mut());
        if settled.is_err() {
            // Terms that are missing may be what keeps the parameters from settling; they are looked for where the fit began.
            state = State { noise: state.noise, own: state.own, ..begun };
        }
        let examined = misfit::examine(&problem, signals, &state, clipped.as_ref())?;
        let iterations = match settled {
            Ok(iterations) => Some(iterations),
            Err(_) if examined.settles => None,
            Err(fault) => return Err(fault),
        };
        let residual: Vec<f64> =
            (0..outputs).map(|c| rms(examined.errors.iter().skip(c).step_by(outputs), 0.0)).collect();
        let by_motion = residual.iter().zip(&signals.coordinates).map(|(left, signal)| left / spread(signal));
        let inputs = signals.inputs.len();
        let by_input = signals.inputs.iter().enumerate().map(|(i, input)| {
            let taken: Vec<f64> = state.trajectory.disturbed.iter().skip(i).step_by(inputs).copied().collect();
            spread(&taken) / spread(input)
        });
        let share = by_motion.chain(by_input).filter(|share| share.is_finite()).fold(0.0, f64::max);
        let scale = examined.misfit.scale;
        Ok(OutputError {
            share,
            values: state.theta,
            covariance: examined.covariance,
            free: free.to_vec(),
            iterations,
            sensor_noise: signals.sensor_noise(&problem.scale, scale),
            input_noise: state.noise.inputs.iter().map(|sigma| sigma * scale.sqrt()).collect(),
            colour: state.noise.colour,
            residual,
            misfit: examined.misfit,
        })
    }
}

/// Settles a state; where the input leaves its limit depends on the limit, which is moved until it stays.
fn settle_with_limit<'a>(
    state: &mut State,
    problem: &mut Problem<'a>,
    signals: &Signals<'a>,
    mut clipped: Option<&mut Clipping>,
) -> Result<usize, OutputErrorFault> {
    let mut settled = Err(OutputErrorFault::NotConverged { steps: 0 });
    for _ in 0..MOST_MOVES {
        state.own.clear();
        if let Some(clipped) = &clipped {
            problem.inputs[clipped.input] = Cow::Owned(clipped.applied.clone());
            state.own.push((clipped.edge.clone(), 0.0));
        }
        settled = state.settle(problem, signals, true);
        let (Some(clipping), Some((_, moved)), Ok(_)) = (&mut clipped, state.own.first(), &settled) else { break };
        if moved.abs() <= STAYS * clipping.limit {
            break;
        }
        let limit = (clipping.limit + moved).clamp(0.5 * clipping.limit, 2.0 * clipping.limit);
        clipping.move_to(limit, signals.inputs[clipping.input]);
    }
    settled
}

/// Root mean square of values beside a centre.
fn rms<'v>(values: impl Iterator<Item = &'v f64>, centre: f64) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), x| (sum + (x - centre).powi(2), count + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}

/// Standard deviation of a signal.
fn spread(signal: &[f64]) -> f64 {
    rms(signal.iter(), signal.iter().sum::<f64>() / signal.len().max(1) as f64)
}
