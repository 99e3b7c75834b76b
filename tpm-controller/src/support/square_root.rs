//! Least squares sample by sample: what any number of rows say about the unknowns, as a triangular factor of fixed size.
//!
//! Every row is rotated into the factor R of A = Q R (Givens), so that no square of the matrix is ever formed and single precision
//! keeps its digits. Rotations round every column by itself; columns are scaled to unit length when the solution is asked for.
//!
//! Invariant: nothing allocates and nothing indexes, so that no input can make it panic.

use super::Real;
use core::fmt;

/// The smallest share of a column that no other columns explain and that counts: columns that are equal by the laws of a machine differ by
/// the rounding of their own evaluation, which no number of rows tells.
const LEAST_SHARE: f64 = 1e-8;

/// A number of a row, or of a matrix, is infinite or not a number; what was there before has stayed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotFinite;

impl fmt::Display for NotFinite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the data hold a number that is not finite")
    }
}

impl core::error::Error for NotFinite {}

/// What rows of A x = b have said so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SquareRoot<T, const C: usize> {
    /// The triangular factor of A; zeros below its diagonal.
    factor: [[T; C]; C],
    /// Q^T b, as far as A reaches.
    right: [T; C],
    /// Euclidean length of what A does not reach.
    residual: T,
    /// The number of rows; past ones count less after a fading.
    rows: T,
}

impl<T: Real, const C: usize> Default for SquareRoot<T, C> {
    fn default() -> Self {
        Self { factor: [[T::ZERO; C]; C], right: [T::ZERO; C], residual: T::ZERO, rows: T::ZERO }
    }
}

impl<T: Real, const C: usize> SquareRoot<T, C> {
    /// Takes in a row of A with its entry of b, both divided by the deviation of the row's error.
    ///
    /// # Errors
    /// [`NotFinite`] when a number of the row is not; the row is left out then.
    pub fn push(&mut self, mut row: [T; C], mut right: T) -> Result<(), NotFinite> {
        if !right.is_finite() || !row.iter().all(|entry| entry.is_finite()) {
            return Err(NotFinite);
        }
        for (k, (kept, kept_right)) in self.factor.iter_mut().zip(&mut self.right).enumerate() {
            let Some((&diagonal, &entry)) = kept.get(k).zip(row.get(k)) else { break };
            if entry.abs() <= T::ZERO {
                continue;
            }
            let length = hypotenuse(diagonal, entry);
            let (cosine, sine) = (diagonal / length, entry / length);
            for (kept, new) in kept.iter_mut().zip(&mut row).skip(k) {
                let turned = cosine * *kept + sine * *new;
                *new = cosine * *new - sine * *kept;
                *kept = turned;
            }
            let turned = cosine * *kept_right + sine * right;
            right = cosine * right - sine * *kept_right;
            *kept_right = turned;
        }
        self.residual = hypotenuse(self.residual, right);
        self.rows += T::ONE;
        Ok(())
    }

    /// Lets all rows so far count `share` times, from 0 to 1.
    pub fn fade(&mut self, share: T) {
        let root = share.sqrt();
        self.factor.iter_mut().flatten().chain(&mut self.right).for_each(|value| *value *= root);
        self.residual *= root;
        self.rows *= share;
    }

    /// Takes in all rows of another factor.
    pub fn pool(&mut self, other: &Self) {
        let rows = self.rows + other.rows;
        for (row, right) in other.factor.iter().zip(other.right) {
            // A factor has finite entries only.
            let _ = self.push(*row, right);
        }
        self.residual = hypotenuse(self.residual, other.residual);
        self.rows = rows;
    }

    /// Makes the equations those of the unknowns less `by`.
    pub fn move_by(&mut self, by: &[T; C]) {
        for (row, right) in self.factor.iter().zip(&mut self.right) {
            for (entry, by) in row.iter().zip(by) {
                *right -= *entry * *by;
            }
        }
    }

    /// The number of rows so far; past ones count less after a fading.
    #[must_use]
    pub fn rows(&self) -> T {
        self.rows
    }

    /// Euclidean length of what no x explains.
    #[must_use]
    pub fn residual(&self) -> T {
        self.residual
    }

    /// The right-hand sides of the triangular factor.
    #[must_use]
    pub fn right_side(&self) -> [T; C] {
        self.right
    }

    /// The rows of the triangular factor, each with its right-hand side: equations of x with independent errors of variance one.
    pub fn equations(&self) -> impl Iterator<Item = (&[T; C], T)> {
        self.factor.iter().zip(self.right)
    }

    /// What the rows say about x: modified Gram-Schmidt with column pivoting on the factor, its columns scaled to unit length.
    ///
    /// A direction counts as not shown when what is left of its column is within the rounding errors of all rows, which add up like a
    /// random walk, or below 1e-8.
    #[must_use]
    pub fn solution(&self) -> Shown<T, C> {
        let mut columns = [Column { index: 0, values: [T::ZERO; C] }; C];
        let mut scales = [T::ONE; C];
        for (c, (column, scale)) in columns.iter_mut().zip(&mut scales).enumerate() {
            column.index = c;
            for (value, row) in column.values.iter_mut().zip(&self.factor) {
                *value = row.get(c).copied().unwrap_or(T::ZERO);
            }
            let length = length(&column.values);
            if length > T::ZERO {
                *scale = length;
                column.values.iter_mut().for_each(|value| *value /= length);
            }
        }
        let rounding = T::EPSILON * T::from_f64(4.0) * (T::from_f64(C as f64) + self.rows.sqrt());
        let tiny = rounding.max(T::from_f64(LEAST_SHARE));
        let mut pivots = [Pivot { index: 0, diagonal: T::ONE, right: T::ZERO, row: [T::ZERO; C] }; C];
        let mut right = self.right;
        let mut rank = 0;
        let mut left = columns.as_mut_slice();
        for pivot in &mut pivots {
            let Some((first, rest)) = left.split_first_mut() else { break };
            let mut diagonal = length(&first.values);
            for other in rest.iter_mut() {
                let size = length(&other.values);
                if size > diagonal {
                    diagonal = size;
                    core::mem::swap(first, other);
                }
            }
            if diagonal <= tiny {
                break;
            }
            pivot.index = first.index;
            pivot.diagonal = diagonal;
            first.values.iter_mut().for_each(|value| *value /= diagonal);
            for other in rest.iter_mut() {
                let entry = project(&first.values, &mut other.values);
                if let Some(slot) = pivot.row.get_mut(other.index) {
                    *slot = entry;
                }
            }
            pivot.right = project(&first.values, &mut right);
            rank += 1;
            left = rest;
        }
        // Free columns are those that no pivot has taken.
        let mut free = [true; C];
        for pivot in pivots.iter().take(rank) {
            free.iter_mut().skip(pivot.index).take(1).for_each(|free| *free = false);
        }
        let mut shown = free.map(|free| !free);
        let leak = tiny.sqrt();
        for (index, _) in free.iter().enumerate().filter(|(_, free)| **free) {
            let of_column = |_: usize, pivot: &Pivot<T, C>| pivot.row.get(index).copied().unwrap_or(T::ZERO);
            for (shown, share) in shown.iter_mut().zip(substituted(&pivots, rank, of_column)) {
                *shown &= share.abs() <= leak;
            }
        }
        let mut covariance = [[T::ZERO; C]; C];
        let mut all = T::ZERO;
        for k in 0..rank {
            // A column of the inverse of the triangular factor.
            let column = substituted(&pivots, rank, |j, _| if j == k { T::ONE } else { T::ZERO });
            for (sums, &entry) in covariance.iter_mut().zip(&column) {
                sums.iter_mut().zip(&column).for_each(|(sum, &other)| *sum += entry * other);
                all += entry * entry;
            }
        }
        let values = substituted(&pivots, rank, |_, pivot| pivot.right);
        let mut found = Shown {
            solution: [None; C],
            deviations: [None; C],
            covariance: [[T::ZERO; C]; C],
            rank,
            residual: hypotenuse(self.residual, length(&right)),
            condition: (T::from_f64(rank as f64) * all).sqrt(),
        };
        for ((sums, &scale), &own) in covariance.iter_mut().zip(&scales).zip(&shown) {
            for ((sum, &other), &also) in sums.iter_mut().zip(&scales).zip(&shown) {
                *sum = if own && also { *sum / scale / other } else { T::ZERO };
            }
        }
        let slots = found.solution.iter_mut().zip(&mut found.deviations);
        for (c, (((slot, deviation), value), (scale, shown))) in
            slots.zip(values).zip(scales.into_iter().zip(shown)).enumerate()
        {
            if shown {
                *slot = Some(value / scale);
                *deviation = covariance.get(c).and_then(|row| row.get(c)).map(|square| square.sqrt());
            }
        }
        found.covariance = covariance;
        found
    }
}

/// What the data show of the unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown<T, const C: usize> {
    /// The unknowns of least squares; nothing for those that the data do not show.
    pub solution: [Option<T>; C],
    /// Their standard deviations, when the rows' errors have the deviations that they were divided by.
    pub deviations: [Option<T>; C],
    /// The covariance of the unknowns under the same condition; zero for those that the data do not show.
    pub covariance: [[T; C]; C],
    /// The number of directions that the data show.
    pub rank: usize,
    /// Euclidean length of what is left of the data, in deviations.
    pub residual: T,
    /// Of what is shown, the Frobenius norm of the matrix with columns of length 1, times that of its inverse: at least the condition
    /// number, and at most the rank times that.
    pub condition: T,
}

/// A column of the factor with the place it came from.
#[derive(Clone, Copy)]
struct Column<T, const C: usize> {
    index: usize,
    values: [T; C],
}

/// One row of the second factor, whose columns are in the order of their pivots.
#[derive(Clone, Copy)]
struct Pivot<T, const C: usize> {
    /// The column that was eliminated.
    index: usize,
    /// Its diagonal entry.
    diagonal: T,
    /// The projection of the right-hand side.
    right: T,
    /// Entries of the columns that were left, by their original places.
    row: [T; C],
}

/// The solution of the triangular system of the first pivots, by original places; `right` is asked for every pivot and its number.
fn substituted<T: Real, const C: usize>(
    pivots: &[Pivot<T, C>; C],
    rank: usize,
    right: impl Fn(usize, &Pivot<T, C>) -> T,
) -> [T; C] {
    let mut solution = [T::ZERO; C];
    for (k, pivot) in pivots.iter().enumerate().take(rank).rev() {
        // Columns that are not solved yet, and free ones, are zero in the solution.
        let mut sum = right(k, pivot);
        for (&entry, &value) in pivot.row.iter().zip(&solution) {
            sum -= entry * value;
        }
        if let Some(slot) = solution.get_mut(pivot.index) {
            *slot = sum / pivot.diagonal;
        }
    }
    solution
}

/// The root of the sum of two squares, which neither overflow nor vanish.
fn hypotenuse<T: Real>(a: T, b: T) -> T {
    let (a, b) = (a.abs(), b.abs());
    let (large, small) = if a > b { (a, b) } else { (b, a) };
    if large <= T::ZERO {
        return large;
    }
    let ratio = small / large;
    large * (T::ONE + ratio * ratio).sqrt()
}

/// Euclidean length, scaled by the largest entry so that squares neither overflow nor vanish.
fn length<T: Real>(values: &[T]) -> T {
    let largest = values.iter().fold(T::ZERO, |largest, value| largest.max(value.abs()));
    if largest <= T::ZERO {
        return T::ZERO;
    }
    let mut sum = T::ZERO;
    for &value in values {
        let part = value / largest;
        sum += part * part;
    }
    largest * sum.sqrt()
}

/// Removes the part along the unit vector and returns its size.
fn project<T: Real>(unit: &[T], values: &mut [T]) -> T {
    let mut along = T::ZERO;
    for (&u, &value) in unit.iter().zip(values.iter()) {
        along += u * value;
    }
    for (&u, value) in unit.iter().zip(values.iter_mut()) {
        *value -= along * u;
    }
    along
}
