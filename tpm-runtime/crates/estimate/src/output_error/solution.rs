//! A Gauss-Newton step from the information about the columns.

use crate::output_error::error::OutputErrorFault;
use crate::output_error::smoother::Smoothed;
use tpm_numerics::{DMatrix, DVector, tolerance};

/// A step of the first columns, and their covariance for noise of the stated size.
pub(super) struct Solution {
    pub(super) step: Vec<f64>,
    pub(super) covariance: DMatrix<f64>,
    /// The step that a right-hand side of the triangle of information asks for, per entry of it.
    response: DMatrix<f64>,
}

impl Solution {
    /// The solution for the first `p` columns, without the others.
    pub(super) fn of_columns(smoothed: &Smoothed, p: usize, hidden: &[Vec<f64>]) -> Result<Self, OutputErrorFault> {
        let last = smoothed.width() - 1;
        let mut rows = DMatrix::from_fn(p + hidden.len(), p, |r, c| {
            if r < p { smoothed.entry(r, c) } else { hidden[r - p].get(c).copied().unwrap_or(0.0) }
        });
        // Columns of unit size, so that units do not decide what is singular.
        let sizes: Vec<f64> = (0..p).map(|c| rows.view((0, c), (p, 1)).norm().max(f64::MIN_POSITIVE)).collect();
        for (mut column, size) in rows.column_iter_mut().zip(&sizes) {
            column.scale_mut(1.0 / size);
        }
        // Nothing moves along a direction that the data do not show.
        for mut row in rows.row_iter_mut().skip(p) {
            let norm = row.norm().max(f64::MIN_POSITIVE);
            row.scale_mut(1e3 / norm);
        }
        let (q, r) = rows.qr().unpack();
        if !(0..p).all(|i| r[(i, i)].abs() > tolerance::COLUMN) {
            return Err(OutputErrorFault::Singular);
        }
        let mut inverse = r.solve_upper_triangular(&DMatrix::identity(p, p)).ok_or(OutputErrorFault::Singular)?;
        for (mut row, size) in inverse.row_iter_mut().zip(&sizes) {
            row.scale_mut(1.0 / size);
        }
        let covariance = &inverse * inverse.transpose();
        let response = inverse * q.rows(0, p).transpose();
        let right = DVector::from_fn(p, |r, _| smoothed.entry(r, last));
        let step: Vec<f64> = (&response * right).iter().copied().collect();
        if step.iter().all(|value| value.is_finite()) {
            Ok(Solution { step, covariance, response })
        } else {
            Err(OutputErrorFault::Singular)
        }
    }

    /// The step when further columns, by their number behind those of the solution, have given values.
    pub(super) fn step_beside(&self, smoothed: &Smoothed, further: &[(usize, f64)]) -> Vec<f64> {
        let p = self.step.len();
        let felt = |r: usize| further.iter().map(|&(j, value)| smoothed.entry(r, p + j) * value).sum::<f64>();
        let moved = &self.response * DVector::from_fn(p, |r, _| felt(r));
        self.step.iter().zip(moved.iter()).map(|(step, moved)| step - moved).collect()
    }

    pub(super) fn deviation(&self, at: usize) -> f64 {
        self.covariance[(at, at)].max(0.0).sqrt()
    }
}
