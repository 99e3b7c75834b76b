//! Square-root information: what data say about the parameters, ready to be pooled.
//!
//! Invariant: the triangle `[R z; 0 r]` holds `|R theta - z|^2 + r^2`, the weighted sum of squares of all equations taken in
//! so far. Pooling stacks the triangles and triangularises again (Householder), so that the condition number is never
//! squared as it would be in the normal equations.

use std::borrow::Cow;
use tpm_numerics::singular::{Singular, complement, condition, largest_one, unit_columns};
use tpm_numerics::{Cholesky, Const, DMatrix, DMatrixView, DVector, DVectorView, Dyn, tolerance};

/// Square-root information of a set of parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Information {
    /// `[R z; 0 r]`, a row and a column more than there are parameters.
    triangle: DMatrix<f64>,
}

/// The factor R with columns of length one.
pub(super) struct Scaled<'a> {
    of: &'a Information,
    factor: DMatrix<f64>,
    /// What the columns were divided by: their lengths, and one for a column of zeros.
    scale: Vec<f64>,
}

/// Parameters solved from information.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Values; along unobservable directions those of the prior.
    pub values: Vec<f64>,
    /// Covariance over the observable directions.
    pub(super) covariance: DMatrix<f64>,
    /// Independent combinations that the equations show.
    pub(super) rank: usize,
    /// Directions that the equations do not show, the largest component of each being one.
    pub(super) unobservable: Vec<Vec<f64>>,
    /// Weighted sum of squares that remains at the solution.
    pub(super) remainder: f64,
}

impl Information {
    /// No information on so many parameters.
    #[must_use]
    pub(super) fn empty(parameters: usize) -> Self {
        Information { triangle: DMatrix::zeros(parameters + 1, parameters + 1) }
    }

    /// Condenses real equations `[A b]`, `A theta = b`, of unit variance.
    #[must_use]
    pub(super) fn of(rows: DMatrix<f64>) -> Self {
        let (equations, columns) = rows.shape();
        let rows = if equations < columns { rows.resize_vertically(columns, 0.0) } else { rows };
        Information { triangle: rows.qr().unpack_r() }
    }

    /// Adds what other data say about the same parameters.
    #[must_use]
    pub(super) fn pool(&self, other: &Self) -> Self {
        let columns = self.triangle.ncols();
        let mut rows = DMatrix::zeros(2 * columns, columns);
        rows.rows_mut(0, columns).copy_from(&self.triangle);
        rows.rows_mut(columns, columns).copy_from(&other.triangle);
        Information::of(rows)
    }

    /// Multiplies every weight by a factor in (0, 1], since older data count less.
    #[must_use]
    pub(super) fn forget(mut self, factor: f64) -> Self {
        self.triangle *= factor.sqrt();
        self
    }

    /// Number of parameters.
    fn parameters(&self) -> usize {
        self.triangle.ncols() - 1
    }

    /// Upper triangular factor R.
    #[must_use]
    pub fn factor(&self) -> DMatrixView<'_, f64> {
        let n = self.parameters();
        self.triangle.view((0, 0), (n, n))
    }

    /// Right-hand side z of `R theta = z`.
    #[must_use]
    pub fn right(&self) -> DVectorView<'_, f64> {
        let n = self.parameters();
        self.triangle.generic_view((0, n), (Dyn(n), Const::<1>))
    }

    /// Weighted sum of squares that remains at the solution.
    fn remainder(&self) -> f64 {
        let n = self.parameters();
        self.triangle[(n, n)].powi(2)
    }

    /// Solves for the parameters: rank first, then values.
    ///
    /// `prior` (one value per parameter) fills the unobservable directions; `gradient`, when given, is added to the right
    /// of the normal equations (a correction for noise in the regressors).
    #[must_use]
    pub fn solve(&self, prior: &[f64], gradient: Option<&[f64]>) -> Solution {
        self.scaled().solve(prior, gradient, &[])
    }

    /// The factor R with columns of length one.
    pub(super) fn scaled(&self) -> Scaled<'_> {
        let (factor, scale) = unit_columns(self.factor().into_owned());
        Scaled { of: self, factor, scale }
    }
}

impl Scaled<'_> {
    /// [`Information::solve`] without a step along directions that are known not to be shown.
    ///
    /// Equations feel a hidden direction as far as they are not those of the reference that hides it: a run that tracks badly moves
    /// otherwise. Values stay at the prior along such a direction, so that the prior's error enters what is shown. A prior is as
    /// uncertain as it is large, and the covariance contains what this uncertainty does to the shown combinations (Schmidt's
    /// considered parameters).
    pub(super) fn solve(&self, prior: &[f64], gradient: Option<&[f64]>, hidden: &[Vec<f64>]) -> Solution {
        if hidden.is_empty()
            && let Some(inverse) = inverse_of_full_rank(&self.factor)
        {
            return self.solve_with(&inverse, gradient);
        }
        let Scaled { of, factor, scale } = self;
        let n = scale.len();
        let start = DVector::from_fn(n, |i, _| prior.get(i).copied().unwrap_or(0.0) * scale[i]);
        let mut target = of.right().into_owned();
        target.gemv(-1.0, factor, &start, 1.0);
        let shown = beside(hidden, scale);
        let singular = Singular::new(&self.in_terms_of(shown.as_ref()), tolerance::RANK);
        let mut step = DVector::zeros(n);
        let mut covariance = DMatrix::zeros(n, n);
        let extra = gradient.map(|g| DVector::from_fn(n, |i, _| g[i] / scale[i]));
        let whole = |directions: DMatrix<f64>| match &shown {
            Some(basis) => basis * directions,
            None => directions,
        };
        let null = whole(singular.null());
        let lost: Vec<Vec<f64>> = null.column_iter().map(|direction| direction.iter().copied().collect()).collect();
        let rank = singular.rank();
        let felt = shown.as_ref().and_then(|shown| self.felt(shown, &start));
        let mut considered = DMatrix::zeros(n, felt.as_ref().map_or(0, DMatrix::nrows));
        let directions = whole(singular.right);
        for ((value, direction), left) in
            singular.values.iter().zip(directions.column_iter()).zip(singular.left.column_iter())
        {
            let mut share = left.dot(&target) / value;
            if let Some(extra) = &extra {
                share += direction.dot(extra) / (value * value);
            }
            step.axpy(share, &direction, 1.0);
            covariance.ger(1.0 / (value * value), &direction, &direction, 1.0);
            if let Some(felt) = &felt {
                considered.ger(1.0 / value, &direction, &(felt * left), 1.0);
            }
        }
        covariance += &considered * considered.transpose();
        let total = start + step;
        for r in 0..n {
            for c in 0..n {
                covariance[(r, c)] /= scale[r] * scale[c];
            }
        }
        let mut misfit = of.right().into_owned();
        misfit.gemv(-1.0, factor, &total, 1.0);
        let spanned: Vec<Vec<f64>>;
        let known = match &shown {
            None => &[],
            Some(basis) if basis.ncols() + hidden.len() == n => hidden,
            // Directions that rounding alone holds apart count once.
            Some(basis) => {
                let span = complement(basis);
                let span = span.column_iter().map(|direction| direction.iter().copied().collect()).collect();
                spanned = beside_known(&[], span, scale);
                &spanned
            }
        };
        let unobservable = known.iter().cloned().chain(beside_known(known, lost, scale)).collect();
        Solution {
            values: total.iter().zip(scale).map(|(t, s)| t / s).collect(),
            covariance,
            rank,
            unobservable,
            remainder: of.remainder() + misfit.norm_squared(),
        }
    }

    /// The solution from the inverse of the factor.
    fn solve_with(&self, inverse: &DMatrix<f64>, gradient: Option<&[f64]>) -> Solution {
        let mut target = self.of.right().into_owned();
        let mut remainder = self.of.remainder();
        if let Some(gradient) = gradient {
            // R' R theta = R' z + g is R theta = z + R'^-1 g.
            let scaled = DVector::from_iterator(gradient.len(), gradient.iter().zip(&self.scale).map(|(g, s)| g / s));
            let shift = inverse.tr_mul(&scaled);
            remainder += shift.norm_squared();
            target += shift;
        }
        let values = inverse * target;
        let scale = &self.scale;
        let n = scale.len();
        Solution {
            values: values.iter().zip(scale).map(|(value, s)| value / s).collect(),
            covariance: DMatrix::from_fn(n, n, |r, c| inverse.row(r).dot(&inverse.row(c)) / (scale[r] * scale[c])),
            rank: n,
            unobservable: Vec::new(),
            remainder,
        }
    }

    /// Ratio of the largest to the smallest singular value that counts, over what is orthogonal to the hidden directions; infinite
    /// when none counts.
    pub(super) fn condition(self, hidden: &[Vec<f64>]) -> f64 {
        condition(&self.in_terms_of(beside(hidden, &self.scale).as_ref()), tolerance::RANK)
    }

    /// What the equations feel of the prior's uncertainty along what is orthogonal to `shown`: a row for every independent deviation. All
    /// parameters are scaled. The prior `start` has the deviations of its own size, a parameter whose prior is zero those of the largest.
    /// Nothing where no prior is stated.
    fn felt(&self, shown: &DMatrix<f64>, start: &DVector<f64>) -> Option<DMatrix<f64>> {
        let largest = start.amax();
        if !(largest > 0.0 && largest.is_finite()) {
            return None;
        }
        let hidden = complement(shown);
        let size = |j: usize| if start[j] == 0.0 { largest } else { start[j].abs() };
        // With the deviations S of all parameters, those along the hidden directions N alone have the covariance (N' S^-2 N)^-1.
        let weighed = DMatrix::from_fn(hidden.nrows(), hidden.ncols(), |j, c| hidden[(j, c)] / size(j));
        let mut felt = (&self.factor * &hidden).transpose();
        let regular = Cholesky::new(weighed.tr_mul(&weighed))?.l_dirty().solve_lower_triangular_mut(&mut felt);
        regular.then_some(felt)
    }

    /// The factor for the coordinates of a basis in place of the scaled parameters; the factor itself without a basis.
    fn in_terms_of(&self, basis: Option<&DMatrix<f64>>) -> Cow<'_, DMatrix<f64>> {
        basis.map_or(Cow::Borrowed(&self.factor), |basis| Cow::Owned(&self.factor * basis))
    }

    /// Which parameters belong to an unobservable direction.
    pub(super) fn touched(&self, unobservable: &[Vec<f64>]) -> Vec<bool> {
        touched(unobservable, &self.scale)
    }
}

/// A direction of parameters that were multiplied by `scale` as one of the parameters themselves, its largest component one.
pub(super) fn raw(scaled: &[f64], scale: &[f64]) -> Vec<f64> {
    let raw: Vec<f64> = scaled.iter().zip(scale).map(|(d, s)| d / s).collect();
    largest_one(&raw)
}

/// Which parameters belong to one of some directions, when they are weighed by `scale`.
pub(super) fn touched(directions: &[Vec<f64>], scale: &[f64]) -> Vec<bool> {
    let mut touched = vec![false; scale.len()];
    for direction in directions {
        let weighed = || direction.iter().zip(scale).map(|(d, s)| (d * s).abs());
        let peak = weighed().fold(0.0, f64::max);
        for (flag, part) in touched.iter_mut().zip(weighed()) {
            *flag |= part > tolerance::HIDDEN_COMPONENT * peak;
        }
    }
    touched
}

/// Another basis of the space that independent directions of about unit length span, by Gauss-Jordan elimination with full
/// pivoting. Every direction has a component of its own, which is one there and zero in the others and is returned beside
/// it, so that unrelated parameters stand in different directions.
pub fn reduced(directions: Vec<Vec<f64>>) -> Vec<(usize, Vec<f64>)> {
    eliminated(directions, Vec::new())
}

/// [`reduced`], where a direction that has a component of its own already keeps it: base parameters that are known exactly stay the
/// combinations that they are.
pub(crate) fn set_apart(mut directions: Vec<Vec<f64>>) -> Vec<(usize, Vec<f64>)> {
    let mut own = Vec::new();
    for index in 0..directions.len() {
        let is_own = |column: usize| {
            directions[index][column].abs() == 1.0
                && directions.iter().enumerate().all(|(other, direction)| other == index || direction[column] == 0.0)
        };
        if let Some(column) = (0..directions[index].len()).rev().find(|&column| is_own(column)) {
            let sign = directions[index][column];
            directions[index].iter_mut().for_each(|entry| *entry *= sign);
            directions.swap(own.len(), index);
            own.push(column);
        }
    }
    eliminated(directions, own)
}

/// Gauss-Jordan elimination with full pivoting behind the first directions, which have the columns `own` for themselves.
fn eliminated(mut directions: Vec<Vec<f64>>, mut own: Vec<usize>) -> Vec<(usize, Vec<f64>)> {
    for done in own.len()..directions.len() {
        let entries = directions.iter().enumerate().skip(done).flat_map(|(row, direction)| {
            direction.iter().enumerate().map(move |(column, entry)| (row, column, entry.abs()))
        });
        let Some((row, column, _)) = entries.max_by(|a, b| a.2.total_cmp(&b.2)) else { break };
        directions.swap(done, row);
        own.push(column);
        let mut pivot = std::mem::take(&mut directions[done]);
        let largest = pivot[column];
        pivot.iter_mut().for_each(|entry| *entry /= largest);
        for other in directions.iter_mut().filter(|other| !other.is_empty()) {
            let share = other[column];
            for (entry, by) in other.iter_mut().zip(&pivot) {
                *entry -= share * by;
                if entry.abs() < tolerance::RANK {
                    *entry = 0.0;
                }
            }
        }
        directions[done] = pivot;
    }
    let mut reduced: Vec<(usize, Vec<f64>)> = own.into_iter().zip(directions).collect();
    reduced.sort_by_key(|(_, direction)| direction.iter().position(|entry| *entry != 0.0));
    reduced
}

/// The inverse of a triangle, when it proves that every singular value counts: none is below `1 / |inverse|`, none above the
/// triangle's own length.
fn inverse_of_full_rank(triangle: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = triangle.nrows();
    let mut inverse = DMatrix::identity(n, n);
    let regular = triangle.solve_upper_triangular_mut(&mut inverse);
    // A comparison with a value that is not a number is false, and proves nothing.
    (regular && inverse.norm() * triangle.norm() * tolerance::RANK < 1.0).then_some(inverse)
}

/// Directions of scaled parameters, which known directions do not span, as directions of the parameters themselves. Where a known
/// direction has a component for itself they have none, so that known base parameters stay what they are.
pub(super) fn beside_known(known: &[Vec<f64>], mut lost: Vec<Vec<f64>>, scale: &[f64]) -> Vec<Vec<f64>> {
    if !lost.is_empty() {
        for (own, direction) in set_apart(known.to_vec()) {
            let lead = direction[own] * scale[own];
            for other in &mut lost {
                let share = other[own] / lead;
                for ((entry, by), scale) in other.iter_mut().zip(&direction).zip(scale) {
                    *entry -= share * by * scale;
                }
                other[own] = 0.0;
            }
        }
        // Elimination takes directions of about unit length.
        for direction in lost.iter_mut().filter(|_| !known.is_empty()) {
            let length = direction.iter().map(|entry| entry * entry).sum::<f64>().sqrt();
            direction.iter_mut().for_each(|entry| *entry /= length);
        }
    }
    reduced(lost).iter().map(|(_, direction)| raw(direction, scale)).collect()
}

/// An orthonormal basis, in scaled parameters, of what is orthogonal to the hidden directions; nothing when there are none.
pub(super) fn beside(hidden: &[Vec<f64>], scale: &[f64]) -> Option<DMatrix<f64>> {
    if hidden.is_empty() {
        return None;
    }
    let n = scale.len();
    // Directions of one length: beside a long one a short one would count as rounding.
    let (columns, _) = unit_columns(DMatrix::from_fn(n, hidden.len(), |r, c| hidden[c][r] * scale[r]));
    Some(complement(&columns)).filter(|basis| basis.ncols() > 0)
}

#[cfg(test)]
mod tests {
    use super::Information;
    use tpm_numerics::{DMatrix, DVector};

    /// Rows `[a b]` beside each other.
    fn beside(a: &DMatrix<f64>, b: &[f64]) -> DMatrix<f64> {
        let columns = a.ncols();
        let mut rows = a.clone().insert_column(columns, 0.0);
        rows.column_mut(columns).copy_from_slice(b);
        rows
    }

    #[test]
    fn pooling_equals_solving_everything_at_once() {
        let a = DMatrix::from_fn(7, 3, |r, c| ((r * r * 5 + c * 3 + r * c * c) as f64 * 0.7).sin());
        let b: Vec<f64> = (0..7).map(|r| f64::from(r).cos()).collect();
        let rows = beside(&a, &b);
        let whole = Information::of(rows.clone()).solve(&[0.0; 3], None);
        let pooled = Information::of(rows.rows(0, 2).into_owned())
            .pool(&Information::of(rows.rows(2, 5).into_owned()))
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
        let solved = Information::of(beside(&a, &[5.0, 10.0, 3e-6])).solve(&[4.0, 0.0, 0.0], None);
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

    /// Two combinations are shown as wholes: no unobservable direction mixes the parameters of both.
    #[test]
    fn directions_that_have_nothing_in_common_are_apart() {
        // a + 2 b and 3 c - d + e, in units that differ, and f.
        let combinations =
            [[1.0, 2.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 3.0, -100.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 1e-3]];
        let a = DMatrix::from_fn(8, 6, |r, c| {
            combinations.iter().enumerate().map(|(i, row)| ((r * (i + 2)) as f64).sin() * row[c]).sum()
        });
        let solved = Information::of(beside(&a, &[1.0; 8])).solve(&[0.0; 6], None);
        assert_eq!((solved.rank, solved.unobservable.len()), (3, 3));
        for direction in &solved.unobservable {
            for combination in combinations {
                let along: f64 = direction.iter().zip(combination).map(|(d, c)| d * c).sum();
                assert!(along.abs() < 1e-9, "{direction:?}");
            }
            let of_first = direction[..2].iter().any(|d| *d != 0.0);
            let of_second = direction[2..5].iter().any(|d| *d != 0.0);
            assert!(of_first != of_second && direction[5] == 0.0, "{direction:?}");
        }
        assert!((solved.unobservable[0][1] + 0.5).abs() < 1e-12, "{solved:?}");
    }

    /// Solving by the inverse of the triangle agrees with solving by singular values.
    #[test]
    fn full_rank_needs_no_singular_values() {
        let a = DMatrix::from_fn(9, 4, |r, c| {
            ((r * r * 3 + c * 5 + r * c * c) as f64 * 0.9).sin() * 1e3_f64.powi(c as i32)
        });
        let b: Vec<f64> = (0..9).map(|r| (1.3 * f64::from(r)).cos()).collect();
        let information = Information::of(beside(&a, &b));
        let gradient = [0.3, -20.0, 1e4, 5e6];
        let solved = information.solve(&[0.0; 4], Some(&gradient));
        // The normal equations, well conditioned enough here.
        let gram = a.tr_mul(&a);
        let right = a.tr_mul(&DVector::from_column_slice(&b)) + DVector::from_column_slice(&gradient);
        let covariance = gram.try_inverse().expect("regular");
        let values = &covariance * right;
        let misfit = a * &values - DVector::from_column_slice(&b);
        assert_eq!((solved.rank, solved.unobservable.len()), (4, 0));
        for i in 0..4 {
            assert!((solved.values[i] - values[i]).abs() < 1e-10 * values[i].abs(), "{solved:?} {values}");
            assert!((solved.covariance[(i, i)] / covariance[(i, i)] - 1.0).abs() < 1e-10);
        }
        assert!((solved.remainder - misfit.norm_squared()).abs() < 1e-9 * solved.remainder);
        // By singular values, as a hidden direction asks for: where the prior is right along it, the others come out the same.
        let hidden = [vec![0.0, 0.0, 0.0, 1.0]];
        let beside = information.scaled().solve(&[0.0, 0.0, 0.0, values[3]], Some(&gradient), &hidden);
        assert_eq!(beside.rank, 3);
        for i in 0..4 {
            assert!((beside.values[i] - values[i]).abs() < 1e-9 * values[i].abs(), "{beside:?} {values}");
        }
        let condition = |hidden: &[Vec<f64>]| information.scaled().condition(hidden);
        assert!((condition(&[]) - scaled_condition(&information)).abs() < 1e-10);
        assert!(condition(&hidden) <= condition(&[]));
    }

    /// Of two parameters that the rows do not feel but in the last digits of a third one, the hidden directions lie side by side.
    #[test]
    fn hidden_directions_that_lie_side_by_side_count_once() {
        let rows = DMatrix::from_row_slice(3, 3, &[1.0, 1e-18, 0.0, 0.0, 1e-18, 1e-18, 0.0, 0.0, 1e-18]);
        let hidden = [vec![0.7, 1.0, 0.0], vec![0.7, 0.0, 1.0]];
        let solved = Information::of(beside(&rows, &[1.0, 0.0, 0.0])).scaled().solve(&[], None, &hidden);
        assert_eq!(solved.rank + solved.unobservable.len(), 3, "{solved:?}");
    }

    /// The sum of two parameters is shown and their difference is hidden by the reference, but a run that tracks badly feels it.
    #[test]
    fn what_is_felt_of_a_hidden_direction_widens_what_is_shown() {
        let (truth, prior, hidden) = ([2.0, 3.0], [3.0, 2.0], [vec![1.0, -1.0]]);
        let solved = |rows: &[[f64; 2]]| {
            let a = DMatrix::from_fn(rows.len(), 2, |r, c| 1e3 * rows[r][c]);
            let b: Vec<f64> = (0..rows.len()).map(|r| a[(r, 0)] * truth[0] + a[(r, 1)] * truth[1]).collect();
            let solved = Information::of(beside(&a, &b)).scaled().solve(&prior, None, &hidden);
            assert_eq!((solved.rank, solved.unobservable.len()), (1, 1));
            // No number moves along the hidden direction.
            assert!((solved.values[0] - solved.values[1] - 1.0).abs() < 0.1, "{solved:?}");
            (solved.values[0] + solved.values[1] - 5.0, solved.covariance.sum().sqrt())
        };
        // The prior is off, and the deviation says so.
        let (error, deviation) = solved(&[[1.02, 0.98]]);
        assert!(error.abs() > 0.03 && error.abs() < deviation && deviation < 0.1, "{error} {deviation}");
        // Of two runs that feel it in opposite ways the mean needs no prior.
        let (error, deviation) = solved(&[[1.02, 0.98], [0.98, 1.02]]);
        assert!(error.abs() < 1e-9 && deviation < 2e-3, "{error} {deviation}");
        // Where it is not felt at all the prior does nothing.
        let (error, deviation) = solved(&[[1.0, 1.0]]);
        assert!(error.abs() < 1e-9 && (deviation - 1e-3).abs() < 1e-6, "{error} {deviation}");
    }

    fn scaled_condition(information: &Information) -> f64 {
        let mut scaled = information.factor().into_owned();
        scaled.column_iter_mut().for_each(|mut column| {
            let norm = column.norm();
            column /= norm;
        });
        let values = (scaled.tr_mul(&scaled)).symmetric_eigenvalues();
        (values.max() / values.min()).sqrt()
    }
}
