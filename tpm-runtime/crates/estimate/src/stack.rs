//! The equations of several runs, solved together.
//!
//! Invariant: every run is weighed by its own variances, so that a run with little information never replaces one with more. The variances
//! of a run are multiplied by its chi-squared over its degrees of freedom, where that is above one; the covariance of all runs together is
//! multiplied likewise.

use crate::equations::Equations;
use crate::error::EstimateError;
use crate::information::Information;
use crate::result::Estimate;
use crate::settings::Settings;
use crate::verdict::{ResidualOf, Verdict};
use tpm_numerics::{Iteration, Matrix};

/// The equations are weighed anew at their own solution until no parameter moves by more than a share of its standard deviation.
const REWEIGHTING: Iteration = Iteration { most: 8, settled: 0.01 };

/// Solves equations whose weights depend on the parameters about which they are used, at their own solution. `equations` gives those
/// of all runs at given parameters, the latest last; `current` has the parameters of the latest run's feed-forward.
///
/// # Errors
/// Those of [`solve`].
pub(super) fn solve_reweighted(
    settings: &Settings,
    current: &[f64],
    equations: impl Fn(&[f64]) -> Vec<Equations>,
) -> Result<Estimate, EstimateError> {
    let mut estimate = solve(&equations(current), settings, current)?;
    for _ in 0..REWEIGHTING.most {
        let next = solve(&equations(&estimate.values), settings, current)?;
        let moves = |((now, before), std): ((&f64, &f64), &f64)| (now - before).abs() > REWEIGHTING.settled * std;
        let settled = !next.values.iter().zip(&estimate.values).zip(&next.std).any(moves);
        estimate = next;
        if settled {
            break;
        }
    }
    Ok(estimate)
}

/// Solves the equations of all runs, the latest last; `current` has the parameters of the latest run's feed-forward.
///
/// # Errors
/// [`EstimateError::Frozen`] and [`EstimateError::AllFrozen`] when parameters are held that do not exist, or all;
/// [`EstimateError::NoSignal`] when there is no run.
pub(super) fn solve(runs: &[Equations], settings: &Settings, current: &[f64]) -> Result<Estimate, EstimateError> {
    let latest = runs.last().ok_or(EstimateError::NoSignal)?;
    let p = latest.parameters;
    let free = settings.free(p)?;
    let mut prior = if settings.prior.len() == p { settings.prior.clone() } else { current.to_vec() };
    settings.hold(&mut prior);
    let start = free.of(&prior);
    let hidden: Vec<Vec<f64>> = settings.hidden.iter().map(|direction| free.of(direction)).collect();
    let mut whole = Information::empty(free.indices.len());
    let (mut chi_squared, mut equations) = (0.0, 0);
    for (run, own) in runs.iter().enumerate() {
        let information = Information::of(own.weighted(&free.indices, &settings.frozen));
        let alone = information.scaled().solve(&start, None, &hidden);
        chi_squared = over(alone.remainder, own.real_len(), alone.rank);
        equations += own.real_len();
        let weight = settings.memory(runs.len() - 1 - run) / f64::max(chi_squared, 1.0);
        whole = whole.pool(&information.forget(weight));
    }
    let scaled = whole.scaled();
    let solution = scaled.solve(&start, None, &hidden);
    let inflation = f64::max(over(solution.remainder, equations, solution.rank), 1.0);
    let mut values = prior;
    free.put(&solution.values, &mut values);
    let covariance = free.spread_square(&(solution.covariance * inflation));
    let touched = scaled.touched(&solution.unobservable);
    let Verdict { std, status } = Verdict::new(&free, &touched, &values, &covariance, |_, _| f64::INFINITY);
    // Equations count by their noise: what noise makes of high harmonics, the squares of their frequencies times as much, is no force that
    // the model lacks.
    let (left, force) = (0..latest.len()).fold((0.0, 0.0), |(left, force), e| {
        let weight = latest.weight(e);
        (left + weight * latest.residual(e, &values).norm_sqr(), force + weight * latest.right[e].norm_sqr())
    });
    Ok(Estimate {
        values,
        std,
        covariance: Matrix::of(covariance),
        status,
        rank: solution.rank,
        unobservable: solution.unobservable.iter().map(|direction| free.spread(direction)).collect(),
        scales: Vec::new(),
        condition: scaled.condition(&hidden),
        residual: if force > 0.0 { (left / force).sqrt() } else { 0.0 },
        residual_of: ResidualOf::Force,
        chi_squared,
        model_error: vec![0.0; latest.row.iter().max().map_or(0, |row| row + 1)],
    })
}

/// Weighted sum of squares per degree of freedom; zero where there is none.
fn over(remainder: f64, equations: usize, rank: usize) -> f64 {
    let freedom = equations.saturating_sub(rank);
    if freedom > 0 { remainder / freedom as f64 } else { 0.0 }
}
