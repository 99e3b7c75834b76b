//! Gauss-Newton steps over motion, parameters and the terms that are part of the model.

use crate::output_error::candidates::{Along, Term};
use crate::output_error::clipping::Limit;
use crate::output_error::error::OutputErrorFault;
use crate::output_error::noise::Noise;
use crate::output_error::problem::{Column, Problem, Trajectory};
use crate::output_error::signals::Signals;
use crate::output_error::smoother::Smoothed;
use crate::output_error::solution::Solution;
use crate::output_error::tuning::tune;
use std::ops::Range;

/// Most Gauss-Newton steps.
const MOST_STEPS: usize = 25;
/// The iteration has converged when no parameter moves by more than this share of its deviation.
const CONVERGED: f64 = 1e-2;
/// After this many steps a parameter may still move by [`SETTLED`].
const PATIENT: usize = 6;
/// Share of its deviation by which a parameter may move when the steps no longer become smaller.
const SETTLED: f64 = 0.5;
/// A step of more deviations than this leaves the motion from which the noise was told.
const FAR: f64 = 1.0;
/// Most searches for the noise after the steps have become small.
const MOST_SEARCHES: usize = 2;
/// Share of itself by which a limit moves at most in one step.
const FARTHEST: f64 = 0.2;
/// Variance of the first innovations, in units of the sensors' white noise, above which there is more than that.
const NOISY: f64 = 10.0;

/// A candidate term that is part of the model.
#[derive(Clone, Copy, Debug)]
pub(super) struct Active {
    pub(super) term: Term,
    pub(super) value: f64,
    pub(super) std: f64,
}

/// What Gauss-Newton steps change.
#[derive(Clone)]
pub(super) struct State {
    pub(super) trajectory: Trajectory,
    pub(super) theta: Vec<f64>,
    pub(super) terms: Vec<Active>,
    pub(super) noise: Noise,
    /// A limit of an input, which is estimated like a parameter.
    pub(super) limit: Option<Limit>,
}

impl State {
    /// The motion that a record shows beforehand, with given parameters and noise.
    pub(super) fn begun(problem: &Problem<'_>, signals: &Signals<'_>, noise: Noise, theta: &[f64]) -> Self {
        State {
            trajectory: Trajectory {
                states: signals.motion(&problem.states),
                disturbed: vec![0.0; problem.samples() * signals.inputs.len()],
                applied: None,
            },
            theta: theta.to_vec(),
            terms: Vec::new(),
            noise,
            limit: None,
        }
    }

    /// The state of some samples of a problem, without a limit.
    pub(super) fn part(&self, problem: &Problem<'_>, samples: Range<usize>) -> Self {
        let of = |values: &[f64], each: usize| values[samples.start * each..samples.end * each].to_vec();
        State {
            trajectory: Trajectory {
                states: of(&self.trajectory.states, problem.states.len()),
                disturbed: of(&self.trajectory.disturbed, problem.inputs.len()),
                applied: None,
            },
            theta: self.theta.clone(),
            terms: self.terms.clone(),
            noise: self.noise.part(samples.clone(), problem.sensors.len()),
            limit: None,
        }
    }

    /// Makes Gauss-Newton steps until they are small; with `tuned`, the noise is found on the way. Returns how many.
    pub(super) fn settle(
        &mut self,
        problem: &Problem<'_>,
        signals: &Signals<'_>,
        tuned: bool,
    ) -> Result<usize, OutputErrorFault> {
        // Whether a step since the noise was told was so long that the motion is another one.
        let mut stale = false;
        // Whether the steps became small after such a step, so that the noise is told once more in the next one.
        let mut due = false;
        // How often the noise was told once more; never without end, since every time may move the motion.
        let mut again = 0;
        for iteration in 0..MOST_STEPS {
            let columns = self.columns(problem, signals)?;
            let mut values = vec![0.0; self.base()];
            values.extend(self.terms.iter().map(|active| active.value));
            let mut chain = problem.linearise_at(&self.trajectory, &self.theta, &columns, &values)?;
            // The noise is told from the motion once the motion obeys the model, and again where there is more than white noise of
            // the sensors. Noise that was found while the motion was far off is looked for once more where it ends.
            if tuned && (iteration == 1 || iteration == 3 && !self.noise.is_plain() || due) {
                (stale, due) = (false, false);
                self.noise = tune(&chain, &self.noise, signals, true);
                if self.noise.inputs.iter().all(|sigma| *sigma <= 0.0) {
                    self.trajectory.disturbed.fill(0.0);
                    chain = chain.undisturbed();
                }
            }
            let mut smoothed = Smoothed::new(&chain, &self.noise, chain.columns, true);
            if tuned && iteration == 0 && smoothed.scale() > NOISY {
                self.noise = tune(&chain, &self.noise, signals, false);
                smoothed = Smoothed::new(&chain, &self.noise, chain.columns, true);
            }
            let solution = Solution::of_columns(&smoothed, chain.columns, &problem.hidden)?;
            let (states, inputs) =
                smoothed.corrections(&chain, &self.noise, &solution.step).ok_or(OutputErrorFault::Singular)?;
            // Signs that turn, and limits that are reached, a sample earlier or later make whole steps go to and fro.
            let corners = problem.machine.derivatives.switches() > 0 || self.limit.is_some();
            let turning = iteration >= PATIENT && corners;
            let whole = if turning { 0.5 } else { 1.0 };
            let mut share: f64 = whole;
            for (at, &j) in problem.free.iter().enumerate() {
                // A parameter moves by half of itself at most in one step, unless it is nothing.
                let size = (0.5 * self.theta[j].abs()).max(3.0 * solution.deviation(at));
                share = share.min(size / solution.step[at].abs().max(f64::MIN_POSITIVE));
            }
            let move_by = |values: &mut [f64], steps: &[f64]| {
                values.iter_mut().zip(steps).for_each(|(value, step)| *value += share * step);
            };
            move_by(&mut self.trajectory.states, &states);
            move_by(&mut self.trajectory.disturbed, &inputs);
            let mut steps = solution.step.iter().map(|step| share * step);
            for (&j, step) in problem.free.iter().zip(&mut steps) {
                self.theta[j] += step;
            }
            if let Some(limit) = &mut self.limit {
                // What is cut off depends on the limit, which therefore moves by a part of itself only.
                let step: f64 = (&mut steps).take(1).sum();
                limit.size += step.clamp(-FARTHEST * limit.size, FARTHEST * limit.size);
                self.trajectory.applied = Some(limit.applied(&problem.inputs));
            }
            let first = problem.free.len() + self.base();
            for ((at, active), step) in self.terms.iter_mut().enumerate().zip(&mut steps) {
                active.value += step;
                active.std = solution.deviation(first + at);
            }
            let small = if turning { SETTLED } else { CONVERGED };
            let within =
                |most: f64| (0..chain.columns).all(|at| solution.step[at].abs() <= most * solution.deviation(at));
            stale |= !within(FAR);
            if share >= whole && within(small) && (iteration > 3 || iteration > 1 && self.noise.is_plain() || !tuned) {
                due = tuned && stale && !self.noise.is_plain() && again < MOST_SEARCHES;
                if !due {
                    return Ok(iteration + 1);
                }
                again += 1;
            }
        }
        Err(OutputErrorFault::NotConverged { steps: MOST_STEPS })
    }

    /// Number of columns that are part of the model beside its parameters.
    pub(super) fn base(&self) -> usize {
        usize::from(self.limit.is_some())
    }

    /// The columns that are part of the model beside its parameters.
    pub(super) fn own(&self, problem: &Problem<'_>) -> Vec<Column> {
        self.limit.iter().map(|limit| limit.edge(&problem.inputs, problem.hold)).collect()
    }

    /// Those columns, and behind them those of the terms.
    fn columns(&self, problem: &Problem<'_>, signals: &Signals<'_>) -> Result<Vec<Column>, OutputErrorFault> {
        let mut columns = self.own(problem);
        if !self.terms.is_empty() {
            let along = Along::new(problem, signals, &self.trajectory, &self.theta)?;
            columns.extend(self.terms.iter().map(|active| along.column(active.term)));
        }
        Ok(columns)
    }
}
