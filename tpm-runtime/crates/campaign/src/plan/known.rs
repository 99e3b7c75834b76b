//! What is known of the parameters, and what a run would add to it.

use crate::plan::{Candidate, Scene};
use tpm_estimate::Estimate;
use tpm_numerics::{DMatrix, DVector};

/// Information that counts for nothing, as a share of the most that one run gives about a parameter.
pub(super) const NOTHING: f64 = 1e-9;

/// Covariance of the free parameters.
pub(super) fn covariance(estimate: &Estimate, free: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(free.len(), free.len(), |r, c| estimate.covariance.get(free[r], free[c]).unwrap_or(0.0))
}

/// Information in scaled parameters.
pub(super) struct Known {
    pub(super) information: DMatrix<f64>,
    pub(super) scale: DVector<f64>,
}

impl Known {
    /// The information with `runs` runs of a candidate.
    pub(super) fn with(&self, candidate: &Candidate, runs: f64) -> DMatrix<f64> {
        let mut root = candidate.root.clone();
        for (mut column, scale) in root.column_iter_mut().zip(self.scale.iter()) {
            column /= *scale;
        }
        &self.information + root.transpose() * root * runs
    }

    /// Standard deviation of the free parameter `at`, with `runs` runs of a candidate where there is one.
    pub(super) fn deviation(&self, at: usize, candidate: Option<&Candidate>, runs: f64) -> f64 {
        let information = candidate.map_or_else(|| self.information.clone(), |one| self.with(one, runs));
        let unit = DVector::from_fn(self.scale.len(), |j, _| f64::from(u8::from(j == at)));
        let solved = information.cholesky().map(|factor| factor.solve(&unit)[at]);
        solved.map_or(f64::INFINITY, |variance| variance.max(0.0).sqrt() / self.scale[at])
    }

    /// What runs of a candidate are worth.
    pub(super) fn gain(&self, scene: &Scene<'_>, candidate: &Candidate, runs: f64) -> f64 {
        let free = scene.free();
        if let Some(unmet) = scene.unmet() {
            let lost = |j: &usize| {
                let Some(at) = free.iter().position(|own| own == j) else { return 0.0 };
                let goal = scene.plan.goals[*j].unwrap_or(1.0) * scene.estimate.values[*j].abs();
                let missed = |std: f64| (std / goal.max(f64::MIN_POSITIVE)).ln().max(0.0);
                missed(self.deviation(at, None, 0.0)) - missed(self.deviation(at, Some(candidate), runs))
            };
            return unmet.iter().map(lost).sum();
        }
        let logarithm = |matrix: DMatrix<f64>| {
            matrix
                .cholesky()
                .map_or(f64::NEG_INFINITY, |factor| 2.0 * factor.l().diagonal().iter().map(|x| x.ln()).sum::<f64>())
        };
        logarithm(self.with(candidate, runs)) - logarithm(self.information.clone())
    }
}
