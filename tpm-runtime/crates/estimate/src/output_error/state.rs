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
use tpm_numerics::Iteration;

/// The numbers of the Gauss-Newton iteration. Moves of parameters are in standard deviations of the parameter.
struct GaussNewton {
    /// Converged when no parameter moves by more than `settled`.
    steps: Iteration,
    /// Steps after which signs that turn and limits that are reached make whole steps go to and fro: half steps are made from there on.
    whole_steps: usize,
    /// Converged, in half steps, when no parameter moves by more than this.
    settled_in_half_steps: f64,
    /// A longer step leaves the motion from which the noise was found.
    longest_near_step: f64,
    /// Most searches for the noise after the steps have become small.
    most_searches: usize,
    /// Longest step of a limit, as a share of it: what is cut off depends on it.
    longest_step_of_limit: f64,
    /// Largest variance of the first innovations, as a multiple of that of the sensors' white noise, that this noise alone explains.
    most_white_variance: f64,
}

const GAUSS_NEWTON: GaussNewton = GaussNewton {
    steps: Iteration { most: 25, settled: 1e-2 },
    whole_steps: 6,
    settled_in_half_steps: 0.5,
    longest_near_step: 1.0,
    most_searches: 2,
    longest_step_of_limit: 0.2,
    most_white_variance: 10.0,
};

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
        for iteration in 0..GAUSS_NEWTON.steps.most {
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
            if tuned && iteration == 0 && smoothed.scale() > GAUSS_NEWTON.most_white_variance {
                self.noise = tune(&chain, &self.noise, signals, false);
                smoothed = Smoothed::new(&chain, &self.noise, chain.columns, true);
            }
            let solution = Solution::of_columns(&smoothed, chain.columns, &problem.hidden)?;
            let (states, inputs) =
                smoothed.corrections(&chain, &self.noise, &solution.step).ok_or(OutputErrorFault::Singular)?;
            // Signs that turn, and limits that are reached, a sample earlier or later make whole steps go to and fro.
            let corners = problem.machine.derivatives.switches() > 0 || self.limit.is_some();
            let turning = iteration >= GAUSS_NEWTON.whole_steps && corners;
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
                let longest = GAUSS_NEWTON.longest_step_of_limit * limit.size;
                limit.size += step.clamp(-longest, longest);
                self.trajectory.applied = Some(limit.applied(&problem.inputs));
            }
            let first = problem.free.len() + self.base();
            for ((at, active), step) in self.terms.iter_mut().enumerate().zip(&mut steps) {
                active.value += step;
                active.std = solution.deviation(first + at);
            }
            let small = if turning { GAUSS_NEWTON.settled_in_half_steps } else { GAUSS_NEWTON.steps.settled };
            let within =
                |most: f64| (0..chain.columns).all(|at| solution.step[at].abs() <= most * solution.deviation(at));
            stale |= !within(GAUSS_NEWTON.longest_near_step);
            if share >= whole && within(small) && (iteration > 3 || iteration > 1 && self.noise.is_plain() || !tuned) {
                due = tuned && stale && !self.noise.is_plain() && again < GAUSS_NEWTON.most_searches;
                if !due {
                    return Ok(iteration + 1);
                }
                again += 1;
            }
        }
        Err(OutputErrorFault::NotConverged { steps: GAUSS_NEWTON.steps.most })
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
