//! The lines of a response that a model is fitted to, and the least-squares tools of both fits.
//!
//! Invariant: a residual is `(H - G)/std` with the standard deviation of H as a complex number, so that its real and
//! imaginary parts have variance 1/2 each when the model is right and the errors are noise.

use crate::response::{FrequencyResponse, ResponseEstimator};
use num_complex::Complex;
use tpm_numerics::singular::{Singular, unit_columns};
use tpm_numerics::{DMatrix, DVector, DVectorView, tolerance};

/// Lower bound on the standard deviation of a line, as a share of |H|: a coherence of exactly one is rounding.
const LEAST_RELATIVE_DEVIATION: f64 = 1e-7;

/// Points to fit.
#[derive(Clone, Debug)]
pub(super) struct Points {
    /// Angular frequencies, rad/s.
    pub(super) frequency: Vec<f64>,
    pub(super) response: Vec<Complex<f64>>,
    /// Weights 1/std; `sqrt((n - 1) coherence/(1 - coherence))/|H|` for n averages.
    pub(super) weight: Vec<f64>,
    /// Expected sum of the squared residuals per point when only noise is left; above 1 because the weights are estimates too:
    /// the mean of an F distribution with 2 and 2 n - 2 degrees of freedom.
    pub(super) expected: f64,
    /// Sum of the squared correlations of a line's error with those of all lines.
    pub(super) correlation: f64,
}

impl Points {
    /// The usable lines of a band.
    pub(super) fn new(response: &FrequencyResponse, estimator: ResponseEstimator, low: f64, high: f64) -> Self {
        let mut points = Points {
            frequency: Vec::new(),
            response: Vec::new(),
            weight: Vec::new(),
            expected: if response.averages > 3.0 { (response.averages - 1.0) / (response.averages - 2.0) } else { 2.0 },
            correlation: response.welch.line_correlation(),
        };
        for line in response.band(low, high).filter(|line| line.usable) {
            let h = match estimator {
                ResponseEstimator::H1 => line.h1,
                ResponseEstimator::H2 => line.h2,
            };
            points.frequency.push(line.frequency);
            points.response.push(h);
            points.weight.push(1.0 / line.std.max(LEAST_RELATIVE_DEVIATION * h.norm()));
        }
        points
    }

    pub(super) fn len(&self) -> usize {
        self.frequency.len()
    }

    /// Residuals of a model with this response at every point: real parts, then imaginary parts; nothing where one is
    /// not finite.
    pub(super) fn residuals(&self, model: impl IntoIterator<Item = Complex<f64>>) -> Option<DVector<f64>> {
        let n = self.len();
        let mut residuals = DVector::zeros(2 * n);
        for (k, value) in model.into_iter().enumerate() {
            let error = (self.response[k] - value) * self.weight[k];
            residuals[k] = error.re;
            residuals[n + k] = error.im;
        }
        residuals.iter().all(|r| r.is_finite()).then_some(residuals)
    }

    /// Variance of one residual in the covariance of estimates: enlarged by the correlation of lines, and by a misfit
    /// above 1.
    pub(super) fn variance(&self, misfit: f64) -> f64 {
        0.5 * misfit.max(1.0) * self.correlation
    }

    /// Sum of the squared residuals per point, relative to its expectation under noise alone after `free` real numbers
    /// were fitted.
    pub(super) fn misfit(&self, squares: f64, free: usize) -> f64 {
        squares / (self.expected * (self.len() as f64 - 0.5 * free as f64).max(0.5))
    }

    /// Median and largest |G/H - 1| of a model with this response at every point.
    pub(super) fn relative_errors(&self, model: impl IntoIterator<Item = Complex<f64>>) -> (f64, f64) {
        let mut errors: Vec<f64> = model.into_iter().zip(&self.response).map(|(g, h)| (g / h - 1.0).norm()).collect();
        errors.sort_by(f64::total_cmp);
        (errors.get(errors.len() / 2).copied().unwrap_or(0.0), errors.last().copied().unwrap_or(0.0))
    }
}

/// Covariance and rank of parameters, from the Jacobian of their residuals.
#[derive(Clone, Debug)]
pub(super) struct Information {
    /// Covariance; the part along unobservable directions is left out.
    pub(super) covariance: DMatrix<f64>,
    /// Number of parameters that the data determine.
    pub(super) rank: usize,
    /// Ratio of the largest to the smallest singular value of the column-scaled Jacobian; infinite when singular.
    pub(super) condition: f64,
    /// Unit vectors, in the parameters' own units, along which the residuals do not change.
    pub(super) null: Vec<DVector<f64>>,
}

/// The covariance of least-squares estimates whose residuals have this variance each.
pub(super) fn information(jacobian: &DMatrix<f64>, variance: f64, tolerance: f64) -> Information {
    let size = jacobian.ncols();
    let (scaled, norms) = unit_columns(jacobian.clone());
    let singular = Singular::new(&scaled, tolerance);
    let raw = |direction: DVectorView<'_, f64>| DVector::from_fn(size, |j, _| direction[j] / norms[j]);
    let mut covariance = DMatrix::zeros(size, size);
    for (value, direction) in singular.values.iter().zip(singular.right.column_iter()) {
        let direction = raw(direction);
        covariance += &direction * direction.transpose() * (variance / (value * value));
    }
    let null: Vec<DVector<f64>> = singular.null().column_iter().map(|direction| raw(direction).normalize()).collect();
    let rank = singular.rank();
    let condition = if rank == size { singular.condition() } else { f64::INFINITY };
    Information { covariance, rank, condition, null }
}

/// Least squares with column scaling; where columns depend on each other, the minimum-norm solution of the scaled
/// columns.
pub(super) fn least_squares(matrix: DMatrix<f64>, right: &DVector<f64>) -> DVector<f64> {
    let (matrix, norms) = unit_columns(matrix);
    let singular = Singular::new(&matrix, tolerance::RANK);
    let shares = singular.left.tr_mul(right).component_div(&singular.values);
    let mut solution = singular.right * shares;
    for (value, norm) in solution.iter_mut().zip(&norms) {
        *value /= norm;
    }
    solution
}
