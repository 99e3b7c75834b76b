//! What a model leaves of a record, and by how much that widens deviations.
//!
//! Deviations grow with what is found: by the distance that the parameters move with the significant candidates in the model, and by the
//! ratio of the power of the innovations at the harmonics of the motion to their power elsewhere (`DESIGN.md`, "How is a deviation widened
//! and why?").

use crate::output_error::candidates::{Candidate, CandidateKind};
use crate::output_error::chain::Chain;
use crate::output_error::error::OutputErrorFault;
use crate::output_error::explanation::{Chosen, Explanation};
use crate::output_error::noise::Noise;
use crate::output_error::problem::{Place, Problem};
use crate::output_error::signals::Signals;
use crate::output_error::smoother::Smoothed;
use crate::output_error::solution::Solution;
use crate::output_error::state::{Active, State};
use std::f64::consts::PI;
use tpm_numerics::DMatrix;

/// What a model leaves of a record.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Misfit {
    /// Variance of the innovations, in units of what the noise model states.
    pub scale: f64,
    /// Correlation of neighbouring innovations.
    pub correlation: f64,
    /// Mean power of the innovations at the harmonics of the motion, in units of their power elsewhere.
    pub periodic: f64,
    /// Whether that power is beyond chance.
    pub repeats: bool,
    /// Significant candidates, the strongest first.
    pub terms: Vec<Candidate>,
    /// Whether the first of them is a limit of an input that is part of the fit: without it the record makes no sense.
    pub limited: bool,
    /// How far every free parameter moves when these terms are part of the model.
    pub shift: Vec<f64>,
    /// Half of the range over which every free parameter drifts during the record.
    pub range: Vec<f64>,
    /// Frequency of a vibration that the model does not have, Hz.
    pub vibration: Option<f64>,
    /// How far every free parameter moves with the static part of such a vibration.
    pub bent: Vec<f64>,
    /// Factor on variances for what no candidate explains.
    pub inflation: f64,
    /// How far every free parameter moves from the first half of the record to the second; empty where the halves do not show them.
    pub halves: Vec<Half>,
}

/// How far a parameter moves from the first half of a record to the second.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Half {
    /// Second half less first half, unit of the parameter.
    pub moved: f64,
    /// Variance of that difference by the stated noise.
    pub variance: f64,
}

/// What a fitted model leaves, and the covariance of its parameters for noise alone.
pub(super) struct Examined {
    pub(super) misfit: Misfit,
    pub(super) covariance: DMatrix<f64>,
    /// Readings less the motion, sample by sample.
    pub(super) errors: Vec<f64>,
    /// Whether the terms, where there are any, settle together with the parameters.
    pub(super) settles: bool,
    /// Twice the negative logarithm of the likelihood, but for a constant.
    pub(super) cost: f64,
}

/// Examines a fitted state.
pub(super) fn examine(
    problem: &Problem<'_>,
    signals: &Signals<'_>,
    state: &State,
) -> Result<Examined, OutputErrorFault> {
    let p = problem.free.len();
    let (usual, better, chain) = Explanation::all(problem, signals, state)?;
    let best = better.as_ref().unwrap_or(&usual);
    let innovations = best.innovations(chain.outputs.len());
    let counted = signals.counted();
    let correlation = innovations.neighbours();
    let periodic = innovations.at_harmonics(signals.samples_per_period());
    let repeats = periodic.beyond_chance && !counted;
    let mut inflation: f64 = if repeats { periodic.value.max(1.0) } else { 1.0 };
    if correlation.beyond_chance && !counted {
        inflation = inflation.max((1.0 + correlation.value) / (1.0 - correlation.value).max(0.01));
    }
    // What noise of inputs does at a mode of the model looks like a vibration where its level is not known well.
    let plain = better.is_some() || state.noise.is_plain();
    let vibration = if counted || repeats || !plain { None } else { innovations.vibration(signals) };
    let mut bent = vec![0.0; p];
    if let Some(frequency) = vibration {
        // Below its resonance a flexible machine moves as a stiff one under an input that leads by its second rate over the square
        // of the resonance.
        let size = (2.0 * PI * frequency).powi(-2);
        for moved in best.moved_by(size, |kind| matches!(kind, CandidateKind::Flexible { .. })) {
            bent.iter_mut().zip(&moved).for_each(|(bent, moved)| *bent += moved.abs());
        }
    }
    let richer = with_terms(problem, signals, state, best);
    // Where the terms and the parameters do not settle together, the linear answer counts.
    let terms: Vec<Active> = match &richer {
        Some(richer) => richer.terms.clone(),
        None => best.terms.iter().map(|chosen| chosen.active).collect(),
    };
    let shift = match &richer {
        Some(richer) => problem.free.iter().map(|&j| richer.theta[j] - state.theta[j]).collect(),
        None if terms.is_empty() => vec![0.0; p],
        None => best.step[..p].to_vec(),
    };
    let mut range = vec![0.0; p];
    for active in &terms {
        if let CandidateKind::Drift { parameter } = active.term.kind
            && let Some(at) = problem.free.iter().position(|&j| j == parameter)
        {
            range[at] = active.value.abs();
        }
    }
    let candidate = |(active, gain): (&Active, f64)| Candidate {
        term: active.term.kind,
        row: row(active.term.place),
        value: active.value,
        std: active.std,
        gain,
    };
    let mut named: Vec<Candidate> =
        terms.iter().zip(best.terms.iter().map(|chosen| chosen.gain)).map(candidate).collect();
    if let Some(limit) = &state.limit {
        let std = usual.bare.deviation(p) * usual.scale.sqrt();
        let term = CandidateKind::Limit { input: limit.input, limit: limit.size };
        named.insert(0, Candidate { term, row: Some(limit.row), value: 1.0, std, gain: 1.0 });
    }
    let misfit = Misfit {
        scale: usual.scale,
        correlation: correlation.value,
        periodic: periodic.value,
        repeats,
        terms: named,
        limited: state.limit.is_some(),
        shift,
        range,
        vibration,
        bent,
        inflation,
        halves: halves(&chain, &state.noise, p + state.base(), &problem.hidden),
    };
    Ok(Examined {
        misfit,
        covariance: &usual.bare.covariance * usual.scale,
        errors: chain.errors,
        settles: richer.is_some(),
        cost: best.cost,
    })
}

/// The state with the terms of an explanation in the model, from where it was made: the parameters may be far away with them, where
/// the linear answer is not exact. Nothing where there are none, or where they do not settle.
fn with_terms(problem: &Problem<'_>, signals: &Signals<'_>, state: &State, best: &Explanation) -> Option<State> {
    let start = |chosen: &Chosen| Active { value: 0.0, std: 0.0, ..chosen.active };
    let mut richer = State {
        terms: best.terms.iter().map(start).collect(),
        noise: best.noise.clone(),
        trajectory: best.trajectory.clone(),
        ..state.clone()
    };
    if richer.terms.is_empty() {
        return None;
    }
    richer.settle(problem, signals, false).ok()?;
    richer.terms.iter_mut().for_each(|active| active.std *= best.scale.sqrt());
    Some(richer)
}

const fn row(place: Place) -> Option<usize> {
    match place {
        Place::Row(row) => Some(row),
        Place::Reading(_) => None,
    }
}

/// The steps of the first `p` columns that either half of a record asks for, with their variances; nothing where a half does not show
/// them.
fn halves(chain: &Chain, noise: &Noise, p: usize, hidden: &[Vec<f64>]) -> Vec<Half> {
    let middle = chain.samples / 2;
    let outputs = chain.outputs.len();
    let of = |from: usize, samples: usize| -> Option<Vec<(f64, f64)>> {
        let part = chain.stretch(from, samples);
        let smoothed = Smoothed::new(&part, &noise.part(from..from + samples, outputs), p, false);
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
