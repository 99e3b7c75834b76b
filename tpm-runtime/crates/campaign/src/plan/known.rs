//! What is known of the parameters, and what a run would add to it.

use tpm_estimate::Estimate;
use tpm_numerics::{DMatrix, DVector};

/// Information that counts for nothing, as a share of the most that one run gives about a parameter.
const NOTHING: f64 = 1e-9;

/// Covariance of the free parameters.
pub(super) fn covariance(estimate: &Estimate, free: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(free.len(), free.len(), |r, c| estimate.covariance.get(free[r], free[c]).unwrap_or(0.0))
}

/// Information about the free parameters, in units in which the most that one run shows of every parameter is one.
pub(super) struct Known {
    information: DMatrix<f64>,
    scale: DVector<f64>,
}

impl Known {
    /// What an estimate knows, beside runs whose roots of information are given.
    pub(super) fn by_estimate<'a>(
        estimate: &Estimate,
        free: &[usize],
        roots: impl Iterator<Item = &'a DMatrix<f64>>,
    ) -> Self {
        let covariance = covariance(estimate, free);
        let mut scale = DVector::from_element(free.len(), 0.0);
        for root in roots {
            for (most, column) in scale.iter_mut().zip(root.column_iter()) {
                *most = f64::max(*most, column.norm());
            }
        }
        scale.iter_mut().filter(|own| **own == 0.0).for_each(|own| *own = 1.0);
        // Information is the inverse of the covariance over the directions that are shown; the others have none.
        let scaled = DMatrix::from_fn(free.len(), free.len(), |r, c| covariance[(r, c)] * scale[r] * scale[c]);
        let eigen = scaled.symmetric_eigen();
        let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
        let mut information = DMatrix::from_diagonal_element(free.len(), free.len(), NOTHING);
        for (value, direction) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > f64::EPSILON * free.len() as f64 * largest {
                information += direction * direction.transpose() / *value;
            }
        }
        Known { information, scale }
    }

    /// What runs show together.
    pub(super) fn by_runs(parameters: usize, roots: impl Iterator<Item = DMatrix<f64>>) -> Self {
        let mut whole = DMatrix::zeros(parameters, parameters);
        for root in roots {
            whole += root.transpose() * root;
        }
        let scale = whole.diagonal().map(|own: f64| if own > 0.0 { own.sqrt() } else { 1.0 });
        let scaled = DMatrix::from_fn(parameters, parameters, |r, c| whole[(r, c)] / (scale[r] * scale[c]));
        Known { information: scaled + DMatrix::identity(parameters, parameters) * NOTHING, scale }
    }

    /// The information with so many runs of a kind besides.
    fn with(&self, root: &DMatrix<f64>, runs: f64) -> DMatrix<f64> {
        let mut root = root.clone();
        for (mut column, scale) in root.column_iter_mut().zip(self.scale.iter()) {
            column /= *scale;
        }
        &self.information + root.transpose() * root * runs
    }

    /// Standard deviation of the free parameter `at`.
    pub(super) fn deviation(&self, at: usize) -> f64 {
        self.deviation_in(&self.information, at)
    }

    /// The same with so many runs of a kind besides.
    pub(super) fn deviation_with(&self, at: usize, root: &DMatrix<f64>, runs: f64) -> f64 {
        self.deviation_in(&self.with(root, runs), at)
    }

    fn deviation_in(&self, information: &DMatrix<f64>, at: usize) -> f64 {
        let unit = DVector::from_fn(self.scale.len(), |j, _| f64::from(u8::from(j == at)));
        let solved = information.clone().cholesky().map(|factor| factor.solve(&unit)[at]);
        solved.map_or(f64::INFINITY, |variance| variance.max(0.0).sqrt() / self.scale[at])
    }

    /// By how much a run of a kind raises the logarithm of the determinant of the information.
    pub(super) fn gain(&self, root: &DMatrix<f64>) -> f64 {
        let logarithm = |matrix: DMatrix<f64>| {
            let factor = matrix.cholesky();
            factor.map_or(f64::NEG_INFINITY, |factor| 2.0 * factor.l().diagonal().iter().map(|x| x.ln()).sum::<f64>())
        };
        logarithm(self.with(root, 1.0)) - logarithm(self.information.clone())
    }
}
