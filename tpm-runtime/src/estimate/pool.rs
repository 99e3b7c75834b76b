//! What linearised runs have taught, pooled.
//!
//! Invariant: what an estimator has learnt from earlier runs is kept and pooled by information; a later run, which tracks
//! better and therefore shows less, never replaces it. Two things reduce what a linearised run counts: residuals beyond its
//! noise (its covariance is inflated by them), and a start farther from the truth than that of a later run, since the error
//! of a linearisation grows with the distance.

use crate::estimate::equations::Equations;
use crate::estimate::error::EstimateError;
use crate::estimate::information::Information;
use crate::estimate::result::Estimate;
use crate::estimate::settings::Settings;
use crate::estimate::verdict::Verdict;
use crate::numerics::{DMatrix, Matrix};
use std::vec;
use std::vec::Vec;

/// A change of so many standard deviations or less is taken for noise.
const INSIGNIFICANT: f64 = 3.0;

/// The information of linearised runs.
#[derive(Clone)]
pub(super) struct Pool {
    information: Information,
    /// Relative distance from the parameters of the last run's feed-forward to its estimate.
    distance: f64,
}

/// The information of all runs but the last one, and of all.
#[derive(Default)]
pub(super) struct Pools {
    pub(super) before: Option<Pool>,
    pub(super) after: Option<Pool>,
}

impl Pools {
    /// Takes the last run into `before`, since another run follows.
    pub(super) fn close(&mut self) {
        if let Some(after) = self.after.take() {
            self.before = Some(after);
        }
    }
}

/// Distance between the start of a run and its estimate relative to the values: the size of what was linearised. It is
/// never taken below the distance that noise alone makes, so that converged runs count alike.
fn distance(start: &[f64], found: &[f64], covariance: &DMatrix<f64>, inflation: f64) -> f64 {
    start
        .iter()
        .zip(found)
        .enumerate()
        .map(|(j, (before, now))| {
            let noise = INSIGNIFICANT * (inflation * covariance[(j, j)]).max(0.0).sqrt();
            (now - before).abs().max(noise) / now.abs().max(f64::MIN_POSITIVE)
        })
        .fold(0.0, f64::max)
}

/// Adds a run's equations to the pool and solves it; `current` has the parameters of the run's feed-forward.
///
/// # Errors
/// [`EstimateError::Frozen`] and [`EstimateError::AllFrozen`] when parameters are held that do not exist, or all.
pub(super) fn pool_run(
    pool: Option<&Pool>,
    equations: &Equations,
    settings: &Settings,
    current: &[f64],
) -> Result<(Estimate, Pool), EstimateError> {
    let p = equations.parameters;
    let free = settings.free(p)?;
    let mut prior = if settings.prior.len() == p { settings.prior.clone() } else { current.to_vec() };
    settings.hold(&mut prior);
    let information = Information::of(equations.weighted(&free.indices, &settings.frozen));
    let start = free.of(&prior);
    let hidden: Vec<Vec<f64>> = settings.hidden.iter().map(|direction| free.of(direction)).collect();
    let alone = information.scaled().solve(&start, None, &hidden);
    let freedom = equations.real_len().saturating_sub(alone.rank);
    let chi_squared = if freedom > 0 { alone.remainder / freedom as f64 } else { 0.0 };
    let inflation = chi_squared.max(1.0);
    let own = information.forget(1.0 / inflation);
    let distance = distance(&free.of(current), &alone.values, &alone.covariance, inflation);
    let pooled = match pool {
        Some(before) => {
            let trust = (distance / before.distance).powi(2);
            let trust = if trust.is_finite() { trust.min(1.0) } else { 1.0 };
            before.information.clone().forget(trust * settings.memory(1)).pool(&own)
        }
        None => own,
    };
    let scaled = pooled.scaled();
    let solution = scaled.solve(&start, None, &hidden);
    let mut values = prior;
    free.put(&solution.values, &mut values);
    let covariance = free.spread_square(&solution.covariance);
    let touched = scaled.touched(&solution.unobservable);
    let Verdict { std, status } = Verdict::new(&free, &touched, &values, &covariance, |_, _| f64::INFINITY);
    let unobservable = solution.unobservable.iter().map(|direction| free.spread(direction)).collect();
    let (left, whole) = (0..equations.len()).fold((0.0, 0.0), |(left, whole), e| {
        (left + equations.residual(e, &values).norm_sqr(), whole + equations.right[e].norm_sqr())
    });
    let estimate = Estimate {
        values,
        std,
        covariance: Matrix::of(covariance),
        status,
        rank: solution.rank,
        unobservable,
        condition: scaled.condition(&hidden),
        residual: if whole > 0.0 { (left / whole).sqrt() } else { 0.0 },
        chi_squared,
        model_error: vec![0.0; equations.row.iter().max().map_or(0, |r| r + 1)],
    };
    Ok((estimate, Pool { information: pooled, distance }))
}
