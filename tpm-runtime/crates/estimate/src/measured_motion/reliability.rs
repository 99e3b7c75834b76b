//! What the equations of a record would not notice (Baarda 1968: external reliability).
//!
//! With equations `A theta = b` of unit variance, the estimate `C A' b` (C is the inverse of A' A) and the residual `R b`,
//! `R = I - A C A'`, a force that the model lacks at one harmonic adds `f e` to b. It changes the estimate by `f C A' e`, and shows in
//! the residual as far as `f^2 e' R e` stands out of the noise. Where the equations of a harmonic are needed to determine the parameters
//! at all, `e' R e` is zero: whatever acts there is taken for parameters, and the residual stays as small as it was.

use crate::error::EstimateError;
use crate::information::Information;
use crate::measured_motion::record::MeasuredMotion;
use crate::result::Estimate;
use crate::settings::Settings;
use tpm_numerics::DMatrix;
use tpm_numerics::alarm;

/// Size of the force that is asked about, root mean square, as a share of the force of its row.
pub const ASKED_ABOUT: f64 = 0.01;

/// A parameter that a force of the size [`ASKED_ABOUT`] would change beyond its stated deviation, without being noticed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Untested {
    /// The parameter.
    pub parameter: usize,
    /// Row of the model on which the force acts.
    pub row: usize,
    /// Harmonic at which it acts.
    pub harmonic: usize,
    /// How far it changes the parameter, without a sign.
    pub change: f64,
}

impl MeasuredMotion {
    /// The parameters that the record does not test, each with the harmonic at which a force changes it most. `estimate` is the record's own:
    /// what its equations would notice and what they state come from the same noise.
    ///
    /// # Errors
    /// [`EstimateError::Frozen`] and [`EstimateError::AllFrozen`] where the settings hold parameters that do not exist, or all.
    pub fn untested(&self, estimate: &Estimate, settings: &Settings) -> Result<Vec<Untested>, EstimateError> {
        let free = settings.free(self.dims.parameters)?;
        let theta = &estimate.values;
        let mut equations = self.equations(|_| 1.0);
        equations.variance = self.row_noise(theta).into_iter().flatten().collect();
        let rows = equations.weighted(&free.indices, &settings.frozen);
        let count = free.indices.len();
        let prior = vec![0.0; count];
        let covariance = Information::of(rows.clone()).scaled().solve(&prior, None, &[]).covariance;
        let regressors = rows.columns(0, count);
        let mut largest: Vec<Option<Untested>> = vec![None; count];
        let mut first = 0;
        for e in 0..equations.len() {
            let (row, harmonic) = (equations.row[e], equations.harmonic[e]);
            let real = if harmonic == 0 { 1 } else { 2 };
            let own = regressors.rows(first, real);
            first += real;
            let (_, force) = self.row_power(row, theta);
            let amplitude = if harmonic == 0 { ASKED_ABOUT * force } else { ASKED_ABOUT * force * 2f64.sqrt() };
            let size = amplitude * equations.weight(e).sqrt();
            let gain = &covariance * own.transpose();
            let (left, phase) = least(&(DMatrix::identity(real, real) - own * &gain));
            if size * left.max(0.0).sqrt() > alarm::FORCE_NOTICED {
                continue;
            }
            for ((k, change), slot) in (gain * phase * size).iter().enumerate().zip(&mut largest) {
                let parameter = free.indices[k];
                let change = change.abs();
                let beyond = change > alarm::BIAS_LEAVES_INTERVAL * estimate.std[parameter];
                if beyond && slot.is_none_or(|before| before.change < change) {
                    *slot = Some(Untested { parameter, row, harmonic, change });
                }
            }
        }
        Ok(largest.into_iter().flatten().collect())
    }
}

/// Smallest eigenvalue of a symmetric matrix of one or two rows, and its direction as a column of length one.
fn least(matrix: &DMatrix<f64>) -> (f64, DMatrix<f64>) {
    if matrix.nrows() == 1 {
        return (matrix[(0, 0)], DMatrix::identity(1, 1));
    }
    let (a, b, c) = (matrix[(0, 0)], matrix[(0, 1)], matrix[(1, 1)]);
    let (mean, half) = (0.5 * (a + c), 0.5 * (a - c));
    // The direction of the largest eigenvalue, turned by a right angle.
    let angle = 0.5 * b.atan2(half);
    (mean - half.hypot(b), DMatrix::from_column_slice(2, 1, &[-angle.sin(), angle.cos()]))
}
