//! A Gauss-Newton step from the information about the columns.

use crate::estimate::output_error::error::OutputErrorFault;
use crate::estimate::output_error::smoother::Smoothed;
use crate::numerics::DMatrix;
use std::vec::Vec;

/// Least size of a column of unit length, beside those before it, that is told from them.
const SINGULAR: f64 = 1e-9;

/// A step of the columns, and their covariance for noise of the stated size.
pub(super) struct Solution {
    pub(super) step: Vec<f64>,
    pub(super) covariance: DMatrix<f64>,
    /// Upper triangle of the information about the columns.
    pub(super) root: DMatrix<f64>,
}

impl Solution {
    /// The solution for the first `p` columns, without the others.
    pub(super) fn of_columns(smoothed: &Smoothed, p: usize, hidden: &[Vec<f64>]) -> Result<Self, OutputErrorFault> {
        let width = (smoothed.root.len() as f64).sqrt().round() as usize;
        let mut rows = DMatrix::from_fn(p + hidden.len(), p + 1, |r, c| {
            if r >= p {
                return hidden[r - p].get(c).copied().unwrap_or(0.0);
            }
            let column = if c == p { width - 1 } else { c };
            if c >= r { smoothed.root[r * width + column] } else { 0.0 }
        });
        // Columns of unit size, so that units do not decide what is singular.
        let sizes: Vec<f64> = (0..p).map(|c| rows.view((0, c), (p, 1)).norm().max(f64::MIN_POSITIVE)).collect();
        for (c, size) in sizes.iter().enumerate() {
            rows.column_mut(c).rows_mut(0, p).scale_mut(1.0 / size);
        }
        // Nothing moves along a direction that the data do not show.
        for r in p..p + hidden.len() {
            for (c, size) in sizes.iter().enumerate() {
                rows[(r, c)] /= *size;
            }
            let norm = rows.row(r).norm().max(f64::MIN_POSITIVE);
            rows.row_mut(r).scale_mut(1e3 / norm);
        }
        let right = rows.column(p).into_owned();
        let matrix = rows.columns(0, p).into_owned();
        let qr = matrix.qr();
        let (q, r) = qr.unpack();
        let shown = |i: usize| r[(i, i)].abs() > SINGULAR;
        if !(0..p).all(shown) {
            return Err(OutputErrorFault::Singular);
        }
        let solved = r.solve_upper_triangular(&q.tr_mul(&right)).ok_or(OutputErrorFault::Singular)?;
        let inverse = r.solve_upper_triangular(&DMatrix::identity(p, p)).ok_or(OutputErrorFault::Singular)?;
        let mut covariance = &inverse * inverse.transpose();
        for a in 0..p {
            for b in 0..p {
                covariance[(a, b)] /= sizes[a] * sizes[b];
            }
        }
        let step: Vec<f64> = solved.iter().zip(&sizes).map(|(value, size)| value / size).collect();
        let root = DMatrix::from_fn(p, p, |i, j| if j >= i { r[(i, j)] * sizes[j] } else { 0.0 });
        if step.iter().all(|value| value.is_finite()) {
            Ok(Solution { step, covariance, root })
        } else {
            Err(OutputErrorFault::Singular)
        }
    }

    pub(super) fn deviation(&self, at: usize) -> f64 {
        self.covariance[(at, at)].max(0.0).sqrt()
    }
}
