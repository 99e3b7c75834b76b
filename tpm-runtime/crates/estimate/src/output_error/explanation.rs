//! Which terms explain a record best beside a given noise.
//!
//! Every candidate term is one more column of the linearised record. One pass gives, for each, its value, by how much it lowers the sum
//! of squares, and how far it moves the parameters. Under a right model a candidate's gain, over the variance that is left, follows
//! chi-squared with one degree of freedom, so that the rate of false alarms is known. Candidates are taken in one after the other while
//! the best one is significant.
//!
//! Noise of the inputs takes up what a model lacks. A record that seems to have such noise is therefore explained with exact inputs too,
//! and with inputs that are exact except where a coordinate turns; the most likely explanation counts (`DESIGN.md`, "How is a term that
//! the model lacks told from noise?").

use crate::output_error::candidates::{Along, CandidateKind, Term, candidates};
use crate::output_error::chain::Chain;
use crate::output_error::error::OutputErrorFault;
use crate::output_error::noise::Noise;
use crate::output_error::problem::{Column, Problem, Trajectory};
use crate::output_error::residuals::Innovations;
use crate::output_error::signals::Signals;
use crate::output_error::smoother::Smoothed;
use crate::output_error::solution::Solution;
use crate::output_error::state::{Active, State};
use tpm_numerics::{DMatrix, DVector, alarm, tolerance};

/// Most candidates that are taken in.
const MOST_TERMS: usize = 3;
/// Share of the power of the column of dry friction that the parameters must leave, in a model that has dry friction, for the
/// candidate to say something of its own.
const LEAST_OWN_POWER_OF_FRICTION: f64 = 0.1;
/// Share of the power of the column of a further candidate that the parameters and the candidates before it must leave.
const LEAST_OWN_POWER_OF_FURTHER: f64 = 1e-4;

/// A term that is taken in.
pub(super) struct Chosen {
    /// Its number among the candidates.
    candidate: usize,
    pub(super) active: Active,
    /// Share of the unexplained squares that it took.
    pub(super) gain: f64,
}

/// A record explained by parameters, noise and as many terms as are significant.
pub(super) struct Explanation {
    pub(super) noise: Noise,
    pub(super) trajectory: Trajectory,
    pub(super) terms: Vec<Chosen>,
    /// Steps of the parameters, and of the columns that are part of the model, when the terms are part of it too.
    pub(super) step: Vec<f64>,
    /// The solution without the terms.
    pub(super) bare: Solution,
    /// Variance of the innovations with the terms, in units of what the noise states.
    pub(super) scale: f64,
    /// Twice the negative logarithm of the likelihood, but for a constant.
    pub(super) cost: f64,
    smoothed: Smoothed,
    candidates: Vec<Term>,
}

impl Explanation {
    /// The explanation of a record beside the noise of `state`, the explanation by terms beside less noise where that is more likely, and the
    /// linearised record of the first.
    pub(super) fn all(
        problem: &Problem<'_>,
        signals: &Signals<'_>,
        state: &State,
    ) -> Result<(Self, Option<Self>, Chain), OutputErrorFault> {
        let (columns, chain) = widened(problem, signals, state, &state.trajectory)?;
        let usual =
            || Explanation::of(problem, signals, &chain, columns, state.noise.clone(), state.trajectory.clone());
        if state.noise.is_plain() {
            return Ok((usual()?, None, chain));
        }
        let recorded =
            Trajectory { disturbed: vec![0.0; state.trajectory.disturbed.len()], ..state.trajectory.clone() };
        let white = signals.noise();
        let at_turns = Noise { inputs: state.noise.inputs.clone(), only_at_turns: true, ..white.clone() };
        // Every explanation is a pass over the whole record with dozens of columns.
        let (usual, others) = rayon::join(usual, || {
            let (columns, exact) = widened(problem, signals, state, &recorded)?;
            let beside =
                |noise: Noise| Explanation::of(problem, signals, &exact, columns.clone(), noise, recorded.clone()).ok();
            let (white, at_turns) = rayon::join(|| beside(white), || beside(at_turns));
            Ok::<_, OutputErrorFault>([white, at_turns])
        });
        let usual = usual?;
        let mut best: Option<Explanation> = None;
        for other in others?.into_iter().flatten() {
            let least = best.as_ref().map_or(usual.cost - alarm::LIKELIHOOD_GAIN, |best| best.cost);
            if !other.terms.is_empty() && other.cost < least {
                best = Some(other);
            }
        }
        Ok((usual, best, chain))
    }

    /// Explains a linearised record, whose last columns are those of the candidates.
    fn of(
        problem: &Problem<'_>,
        signals: &Signals<'_>,
        chain: &Chain,
        candidates: Vec<Term>,
        noise: Noise,
        trajectory: Trajectory,
    ) -> Result<Self, OutputErrorFault> {
        let smoothed = Smoothed::new(chain, &noise, chain.columns, false);
        let m = candidates.len();
        let p = chain.columns - m;
        let bare = Solution::of_columns(&smoothed, p, &problem.hidden)?;
        let freedom = (smoothed.places.len() as f64 - p as f64).max(1.0);
        let rest = smoothed.least_squares();
        let target = DVector::from_fn(m, |i, _| smoothed.entry(p + i, p + m));
        let columns = DMatrix::from_fn(m, m, |i, j| smoothed.entry(p + i, p + j));
        // With quantised readings the noise is stated, and never less than that.
        let least = if signals.counted() { 1.0 } else { 0.0 };
        let significant = 2.0 * alarm::exponential(alarm::MISSING_TERM_RATE, m.max(1));
        let mut left = target.clone();
        let mut basis: Vec<DVector<f64>> = Vec::new();
        let mut chosen: Vec<(usize, f64)> = Vec::new();
        // A friction that the model has differs from its candidate in how sharply it turns.
        let frictions = problem.machine.derivatives.switches() > 0;
        let same = |j: usize| frictions && matches!(candidates[j].kind, CandidateKind::Friction { .. });
        let own = |j: usize, basis: &[DVector<f64>]| -> Option<DVector<f64>> {
            let mut column = columns.column(j).into_owned();
            for direction in basis {
                let share = direction.dot(&column);
                column -= direction * share;
            }
            // One term may be all but explained by the parameters, as a cubic spring is where the motion has few harmonics. A
            // further one that is would only trade with the first.
            let least = if same(j) {
                LEAST_OWN_POWER_OF_FRICTION
            } else if basis.is_empty() {
                tolerance::GRAM
            } else {
                LEAST_OWN_POWER_OF_FURTHER
            };
            let whole: f64 = (0..p + m).map(|r| smoothed.entry(r, p + j).powi(2)).sum();
            (column.norm_squared() > least * whole.max(f64::MIN_POSITIVE)).then_some(column)
        };
        while chosen.len() < MOST_TERMS {
            let gain = |j: usize| own(j, &basis).map(|own| (j, own.dot(&left).powi(2) / own.norm_squared()));
            let best = (0..m)
                .filter(|j| chosen.iter().all(|(i, _)| i != j))
                .filter_map(gain)
                .max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((j, gain)) = best else { break };
            let after = ((rest + left.norm_squared() - gain) / freedom).max(least);
            if gain <= significant * after {
                break;
            }
            let Some(own) = own(j, &basis) else { break };
            let direction = own.normalize();
            let share = direction.dot(&left);
            left -= &direction * share;
            basis.push(direction);
            chosen.push((j, gain));
        }
        let remaining = rest + left.norm_squared();
        let scale = (remaining / freedom).max(least);
        let excess = (rest + target.norm_squared() - remaining).max(f64::MIN_POSITIVE);
        let taken = DMatrix::from_fn(m, chosen.len(), |i, c| columns[(i, chosen[c].0)]);
        let (values, covariance) = match taken.tr_mul(&taken).cholesky() {
            Some(cholesky) => (cholesky.solve(&taken.tr_mul(&target)), cholesky.inverse()),
            None => (DVector::zeros(chosen.len()), DMatrix::zeros(chosen.len(), chosen.len())),
        };
        let terms = chosen.iter().enumerate().map(|(c, &(j, gain))| Chosen {
            candidate: j,
            active: Active { term: candidates[j], value: values[c], std: (scale * covariance[(c, c)]).sqrt() },
            gain: (gain / excess).min(1.0),
        });
        let terms: Vec<Chosen> = terms.collect();
        let taken: Vec<(usize, f64)> = terms.iter().map(|term| (term.candidate, term.active.value)).collect();
        Ok(Explanation {
            step: bare.step_beside(&smoothed, &taken),
            cost: smoothed.cost(remaining, least),
            noise,
            trajectory,
            terms,
            bare,
            scale,
            smoothed,
            candidates,
        })
    }

    /// What the terms leave of the readings.
    pub(super) fn innovations(&self, sensors: usize) -> Innovations {
        let mut values = self.step.clone();
        values.resize(self.smoothed.width() - 1, 0.0);
        for term in &self.terms {
            values[self.step.len() + term.candidate] = term.active.value;
        }
        Innovations::new(&self.smoothed.remaining(&values), &self.smoothed.places, sensors)
    }

    /// How far a term of some value would move the parameters, for every candidate of a kind.
    pub(super) fn moved_by(&self, value: f64, of: impl Fn(&CandidateKind) -> bool) -> Vec<Vec<f64>> {
        let moved = |j: usize| -> Vec<f64> {
            let step = self.bare.step_beside(&self.smoothed, &[(j, value)]);
            step.iter().zip(&self.bare.step).map(|(with, without)| with - without).collect()
        };
        (self.candidates.iter().enumerate()).filter(|(_, term)| of(&term.kind)).map(|(j, _)| moved(j)).collect()
    }
}

/// The record linearised about a trajectory, with the candidates' columns behind those of the model.
fn widened(
    problem: &Problem<'_>,
    signals: &Signals<'_>,
    state: &State,
    trajectory: &Trajectory,
) -> Result<(Vec<Term>, Chain), OutputErrorFault> {
    let along = Along::new(problem, signals, trajectory, &state.theta)?;
    let terms = candidates(&along);
    let mut columns: Vec<Column> = state.own(problem);
    columns.extend(terms.iter().map(|term| along.column(*term)));
    let values = vec![0.0; columns.len()];
    let chain = problem.linearise_at(trajectory, &state.theta, &columns, &values)?;
    Ok((terms, chain))
}
