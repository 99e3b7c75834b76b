//! Square-root information: what data say about the parameters, ready to be pooled.
//!
//! Invariant: `factor` R (upper triangular) and `right` z hold `|R theta - z|^2 + remainder`, the weighted sum of squares
//! of all equations taken in so far. Pooling stacks the factors and triangularises again (Householder), so that the
//! condition number is never squared as it would be in the normal equations.

use nalgebra::{DMatrix, DVector};
use std::vec;
use std::vec::Vec;

/// Singular values of the column-scaled factor below this share of the largest are taken for zero: they are what rounding
/// leaves of an exact dependence once the columns come out of sums over a record.
const RANK_TOLERANCE: f64 = 1e-10;

/// Square-root information of a set of parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Information {
    factor: DMatrix<f64>,
    right: DVector<f64>,
    remainder: f64,
    equations: usize,
}

/// Parameters solved from information.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Values; along unobservable directions those of the prior.
    pub values: Vec<f64>,
    /// Covariance over the observable directions.
    pub covariance: DMatrix<f64>,
    /// Independent combinations that the equations show.
    pub rank: usize,
    /// Directions that they do not show, the largest component of each being one.
    pub unobservable: Vec<Vec<f64>>,
    /// Ratio of the largest to the smallest singular value that counts, after column scaling.
    pub condition: f64,
    /// Weighted sum of squares that remains at the solution.
    pub remainder: f64,
}

impl Information {
    /// No information on so many parameters.
    #[must_use]
    pub fn empty(parameters: usize) -> Self {
        Information {
            factor: DMatrix::zeros(parameters, parameters),
            right: DVector::zeros(parameters),
            remainder: 0.0,
            equations: 0,
        }
    }

    /// Condenses real equations `matrix theta = right` of unit variance.
    #[must_use]
    pub fn of(matrix: DMatrix<f64>, right: &DVector<f64>) -> Self {
        let (equations, parameters) = matrix.shape();
        let mut stacked = matrix.resize(equations.max(parameters + 1), parameters + 1, 0.0);
        stacked.view_mut((0, parameters), (right.len(), 1)).copy_from(right);
        let triangle = stacked.qr().unpack_r();
        let corner = triangle[(parameters, parameters)];
        Information {
            factor: triangle.view((0, 0), (parameters, parameters)).into_owned(),
            right: triangle.column(parameters).rows(0, parameters).into_owned(),
            remainder: corner * corner,
            equations,
        }
    }

    /// Adds what other data say about the same parameters.
    #[must_use]
    pub fn pool(&self, other: &Self) -> Self {
        let n = self.factor.ncols();
        let mut matrix = DMatrix::zeros(2 * n, n);
        matrix.view_mut((0, 0), (n, n)).copy_from(&self.factor);
        matrix.view_mut((n, 0), (n, n)).copy_from(&other.factor);
        let mut right = DVector::zeros(2 * n);
        right.rows_mut(0, n).copy_from(&self.right);
        right.rows_mut(n, n).copy_from(&other.right);
        let mut pooled = Information::of(matrix, &right);
        pooled.remainder += self.remainder + other.remainder;
        pooled.equations = self.equations + other.equations;
        pooled
    }

    /// The same data when their age makes them count less: every weight times `factor` in (0, 1].
    #[must_use]
    pub fn forget(mut self, factor: f64) -> Self {
        self.factor *= factor.sqrt();
        self.right *= factor.sqrt();
        self.remainder *= factor;
        self
    }

    /// Upper triangular factor R.
    #[must_use]
    pub const fn factor(&self) -> &DMatrix<f64> {
        &self.factor
    }

    /// Right-hand side z of `R theta = z`.
    #[must_use]
    pub const fn right(&self) -> &DVector<f64> {
        &self.right
    }

    /// Real equations taken in.
    #[must_use]
    pub const fn equations(&self) -> usize {
        self.equations
    }

    /// Solves for the parameters: rank first, then values.
    ///
    /// `prior` (one value per parameter) fills the unobservable directions; `gradient`, when given, is added to the right
    /// of the normal equations (a correction for noise in the regressors).
    #[must_use]
    pub fn solve(&self, prior: &[f64], gradient: Option<&[f64]>) -> Solution {
        self.solve_beside(prior, gradient, &[])
    }

    /// The same without a step along directions that are known not to be shown.
    #[must_use]
    pub fn solve_beside(&self, prior: &[f64], gradient: Option<&[f64]>, hidden: &[Vec<f64>]) -> Solution {
        let n = self.factor.ncols();
        let scale: Vec<f64> = self
            .factor
            .column_iter()
            .map(|column| {
                let norm = column.norm();
                if norm > 0.0 { norm } else { 1.0 }
            })
            .collect();
        let mut scaled = self.factor.clone();
        for (mut column, s) in scaled.column_iter_mut().zip(&scale) {
            column /= *s;
        }
        let start = DVector::from_fn(n, |i, _| prior.get(i).copied().unwrap_or(0.0) * scale[i]);
        let mut target = self.right.clone();
        target.gemv(-1.0, &scaled, &start, 1.0);
        let shown = beside(hidden, &scale);
        let svd = match &shown {
            Some(basis) => (&scaled * basis).svd(true, true),
            None => scaled.clone().svd(true, true),
        };
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
            // Both factors were asked for.
            return Solution {
                values: prior.to_vec(),
                covariance: DMatrix::zeros(n, n),
                rank: 0,
                unobservable: Vec::new(),
                condition: f64::INFINITY,
                remainder: self.remainder,
            };
        };
        let largest = svd.singular_values.iter().copied().fold(0.0, f64::max);
        let smallest_counted = largest * RANK_TOLERANCE;
        let mut step = DVector::zeros(n);
        let mut covariance = DMatrix::zeros(n, n);
        let mut rank = 0;
        let mut smallest = largest;
        let mut unobservable: Vec<Vec<f64>> = if shown.is_some() { hidden.to_vec() } else { Vec::new() };
        let extra = gradient.map(|g| DVector::from_fn(n, |i, _| g[i] / scale[i]));
        let directions = match &shown {
            Some(basis) => basis * v_t.transpose(),
            None => v_t.transpose(),
        };
        for (i, &value) in svd.singular_values.iter().enumerate() {
            let direction = directions.column(i);
            if value > smallest_counted {
                rank += 1;
                smallest = smallest.min(value);
                let mut share = u.column(i).dot(&target) / value;
                if let Some(extra) = &extra {
                    share += direction.dot(extra) / (value * value);
                }
                step.axpy(share, &direction, 1.0);
                covariance.ger(1.0 / (value * value), &direction, &direction, 1.0);
            } else {
                let raw: Vec<f64> = direction.iter().zip(&scale).map(|(d, s)| d / s).collect();
                let peak = raw.iter().copied().fold(0.0, |p: f64, d| if d.abs() > p.abs() { d } else { p });
                unobservable.push(raw.iter().map(|d| d / peak).collect());
            }
        }
        let total = start + step;
        for r in 0..n {
            for c in 0..n {
                covariance[(r, c)] /= scale[r] * scale[c];
            }
        }
        let mut misfit = self.right.clone();
        misfit.gemv(-1.0, &scaled, &total, 1.0);
        Solution {
            values: total.iter().zip(&scale).map(|(t, s)| t / s).collect(),
            covariance,
            rank,
            unobservable,
            condition: if rank > 0 { largest / smallest } else { f64::INFINITY },
            remainder: self.remainder + misfit.norm_squared(),
        }
    }

    /// Which parameters have a part in an unobservable direction.
    #[must_use]
    pub(crate) fn touched(unobservable: &[Vec<f64>], covariance_scale: &[f64]) -> Vec<bool> {
        let mut touched = vec![false; covariance_scale.len()];
        for direction in unobservable {
            let weighed: Vec<f64> = direction.iter().zip(covariance_scale).map(|(d, s)| (d * s).abs()).collect();
            let peak = weighed.iter().copied().fold(0.0, f64::max);
            for (flag, part) in touched.iter_mut().zip(&weighed) {
                *flag |= *part > 1e-6 * peak;
            }
        }
        touched
    }

    /// Norm of each column: how strongly the equations feel each parameter.
    #[must_use]
    pub fn column_norms(&self) -> Vec<f64> {
        self.factor.column_iter().map(|c| c.norm()).collect()
    }
}

/// An orthonormal basis, in scaled parameters, of what is orthogonal to the hidden directions; nothing when there are none.
fn beside(hidden: &[Vec<f64>], scale: &[f64]) -> Option<DMatrix<f64>> {
    if hidden.is_empty() {
        return None;
    }
    let n = scale.len();
    let columns = DMatrix::from_fn(n, hidden.len(), |r, c| hidden[c][r] * scale[r]);
    Some(complement(&columns)).filter(|basis| basis.ncols() > 0)
}

/// An orthonormal basis, by columns, of what is orthogonal to the columns given.
pub(crate) fn complement(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let n = columns.nrows();
    let mut basis: Vec<DVector<f64>> = Vec::with_capacity(n);
    let mut given = 0;
    let unit = |i: usize| DVector::from_fn(n, |r, _| if r == i { 1.0 } else { 0.0 });
    let all = columns.column_iter().map(|column| column.normalize()).chain((0..n).map(unit));
    for (index, column) in all.enumerate() {
        let mut rest = column;
        // Twice is enough (Gram and Schmidt, repeated).
        for _ in 0..2 {
            for known in &basis {
                rest -= known * known.dot(&rest);
            }
        }
        let size = rest.norm();
        if size > 1e-6 && basis.len() < n {
            basis.push(rest / size);
        }
        if index + 1 == columns.ncols() {
            given = basis.len();
        }
    }
    let kept = &basis[given..];
    if kept.is_empty() { DMatrix::zeros(n, 0) } else { DMatrix::from_columns(kept) }
}

#[cfg(test)]
mod tests {
    use super::Information;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn pooling_equals_solving_everything_at_once() {
        let a = DMatrix::from_fn(7, 3, |r, c| ((r * r * 5 + c * 3 + r * c * c) as f64 * 0.7).sin());
        let b = DVector::from_fn(7, |r, _| (r as f64).cos());
        let whole = Information::of(a.clone(), &b).solve(&[0.0; 3], None);
        let pooled = Information::of(a.rows(0, 2).into_owned(), &b.rows(0, 2).into_owned())
            .pool(&Information::of(a.rows(2, 5).into_owned(), &b.rows(2, 5).into_owned()))
            .solve(&[0.0; 3], None);
        for (x, y) in whole.values.iter().zip(&pooled.values) {
            assert!((x - y).abs() < 1e-13);
        }
        assert!((whole.remainder - pooled.remainder).abs() < 1e-13);
        assert_eq!(pooled.rank, 3);
    }

    #[test]
    fn an_unobservable_combination_keeps_its_prior() {
        // Only x + 1000 y is seen, and z; units differ widely.
        let a = DMatrix::from_row_slice(3, 3, &[1.0, 1e3, 0.0, 2.0, 2e3, 0.0, 0.0, 0.0, 1e-6]);
        let b = DVector::from_row_slice(&[5.0, 10.0, 3e-6]);
        let solved = Information::of(a, &b).solve(&[4.0, 0.0, 0.0], None);
        assert_eq!(solved.rank, 2);
        assert!((solved.values[0] + 1e3 * solved.values[1] - 5.0).abs() < 1e-12);
        assert!((solved.values[2] - 3.0).abs() < 1e-12);
        // The step is along the observable direction only: the scaled parts share it evenly.
        assert!((solved.values[0] - 4.5).abs() < 1e-12);
        assert_eq!(solved.unobservable.len(), 1);
        let direction = &solved.unobservable[0];
        assert!((direction[0] - 1.0).abs() < 1e-12 && (direction[1] + 1e-3).abs() < 1e-12);
        assert!(direction[2].abs() < 1e-9);
    }
}
