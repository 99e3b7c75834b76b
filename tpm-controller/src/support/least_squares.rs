//! Least squares with as many unknowns as a model has parameters, on the controller.
//!
//! Invariant: the matrix is a fixed-size array, nothing allocates and nothing indexes, so that no input can make it panic. The
//! method is Gram-Schmidt orthogonalisation, modified, with column pivoting, the right-hand side carried along as one more
//! column; that is as stable as Householder's (Björck, 1967) and needs no index arithmetic.

use super::Label;
use super::Real;
use core::fmt;

/// Why a linear system has no unique solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolveError {
    /// The data do not determine this parameter: its column is zero, or a combination of others.
    Unobservable {
        /// Index of the parameter.
        parameter: usize,
        /// Its name.
        name: &'static str,
    },
    /// An entry of the matrix or of the data is infinite or not a number.
    NotFinite,
}

impl fmt::Display for SolveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unobservable { name, .. } => {
                write!(f, "the data do not determine the parameter {name}; vary the amplitudes' ratio or the pattern")
            }
            Self::NotFinite => f.write_str("the matrix or the data hold a number that is not finite"),
        }
    }
}

impl core::error::Error for SolveError {}

/// A column of the matrix with the place it came from.
#[derive(Clone, Copy)]
struct Column<T, const R: usize> {
    index: usize,
    values: [T; R],
}

/// One row of the triangular factor.
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

/// The x that minimises |A x - b|, A given by rows, with the labels of x's entries for errors.
///
/// Columns are scaled to unit length first; a column whose part outside the span of the others is below the rounding error of
/// that scaling is reported, since any value of its parameter would fit as well.
///
/// # Errors
/// [`SolveError::Unobservable`], [`SolveError::NotFinite`].
pub fn least_squares<T: Real, const R: usize, const C: usize>(
    matrix: &[[T; C]; R],
    right: &[T; R],
    labels: &[Label<'static>; C],
) -> Result<[T; C], SolveError> {
    factorised(matrix, right, labels).map(|factors| factors.solution)
}

/// Everything that the data say about x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeastSquares<T, const C: usize> {
    /// The x that minimises |A x - b|, rows counted by their deviations.
    pub solution: [T; C],
    /// Its covariance, when the rows' errors have the deviations that were given, or 1 where none were.
    pub covariance: [[T; C]; C],
    /// Euclidean length of what is left of b, in deviations.
    pub residual: T,
    /// Frobenius norm of the matrix with columns of length 1, times that of its inverse: at least the condition number, and at
    /// most C times that.
    pub condition: T,
}

/// The x that minimises |A x - b| with every row divided by the standard deviation of its error, and how well it is known.
///
/// # Errors
/// [`SolveError::Unobservable`], [`SolveError::NotFinite`] (a deviation of zero leads there too).
pub fn weighted_least_squares<T: Real, const R: usize, const C: usize>(
    matrix: &[[T; C]; R],
    right: &[T; R],
    deviations: Option<&[T; R]>,
    labels: &[Label<'static>; C],
) -> Result<LeastSquares<T, C>, SolveError> {
    let (mut matrix, mut right) = (*matrix, *right);
    if let Some(deviations) = deviations {
        for ((row, right), &deviation) in matrix.iter_mut().zip(&mut right).zip(deviations) {
            for entry in row {
                *entry /= deviation;
            }
            *right /= deviation;
        }
    }
    let Factors { pivots, scales, solution, residual } = factorised(&matrix, &right, labels)?;
    let mut covariance = [[T::ZERO; C]; C];
    let mut square = T::ZERO;
    for k in 0..C {
        // A column of the inverse of the triangular factor; the covariance is the sum of their squares.
        let column = substituted(&pivots, |j, _| if j == k { T::ONE } else { T::ZERO });
        for ((row, &a), &scale) in covariance.iter_mut().zip(&column).zip(&scales) {
            square += a * a;
            for ((entry, &b), &other) in row.iter_mut().zip(&column).zip(&scales) {
                *entry += a / scale * (b / other);
            }
        }
    }
    let condition = (T::from_f64(C as f64) * square).sqrt();
    Ok(LeastSquares { solution, covariance, residual, condition })
}

/// The triangular factor with what follows from it at once.
struct Factors<T, const C: usize> {
    pivots: [Pivot<T, C>; C],
    /// Lengths of the columns.
    scales: [T; C],
    solution: [T; C],
    residual: T,
}

fn factorised<T: Real, const R: usize, const C: usize>(
    matrix: &[[T; C]; R],
    right: &[T; R],
    labels: &[Label<'static>; C],
) -> Result<Factors<T, C>, SolveError> {
    let mut columns = [Column { index: 0, values: [T::ZERO; R] }; C];
    let mut scales = [T::ONE; C];
    for (c, (column, scale)) in columns.iter_mut().zip(&mut scales).enumerate() {
        column.index = c;
        for (value, row) in column.values.iter_mut().zip(matrix) {
            *value = row.get(c).copied().unwrap_or(T::ZERO);
        }
        *scale = length(&column.values);
        if !scale.is_finite() {
            return Err(SolveError::NotFinite);
        }
        if *scale > T::ZERO {
            for value in &mut column.values {
                *value /= *scale;
            }
        }
    }
    let mut right = *right;
    if !right.iter().all(|value| value.is_finite()) {
        return Err(SolveError::NotFinite);
    }
    let tiny = T::EPSILON * T::from_f64(4.0 * (R + C) as f64);
    let mut pivots = [Pivot { index: 0, diagonal: T::ONE, right: T::ZERO, row: [T::ZERO; C] }; C];
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
        pivot.index = first.index;
        if diagonal <= tiny {
            let name = labels.get(first.index).map_or("", |label| label.name);
            return Err(SolveError::Unobservable { parameter: first.index, name });
        }
        pivot.diagonal = diagonal;
        for value in &mut first.values {
            *value /= diagonal;
        }
        for other in rest.iter_mut() {
            let entry = project(&first.values, &mut other.values);
            if let Some(slot) = pivot.row.get_mut(other.index) {
                *slot = entry;
            }
        }
        pivot.right = project(&first.values, &mut right);
        left = rest;
    }
    let mut solution = substituted(&pivots, |_, pivot| pivot.right);
    for (value, &scale) in solution.iter_mut().zip(&scales) {
        *value /= scale;
    }
    Ok(Factors { pivots, scales, solution, residual: length(&right) })
}

/// The solution of the triangular system, by original places; `right` is asked for every pivot and its number.
fn substituted<T: Real, const C: usize>(pivots: &[Pivot<T, C>; C], right: impl Fn(usize, &Pivot<T, C>) -> T) -> [T; C] {
    let mut solution = [T::ZERO; C];
    for (k, pivot) in pivots.iter().enumerate().rev() {
        // Entries of columns that are not solved yet are zero in the row.
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

/// Euclidean length, scaled by the largest entry so that squares neither overflow nor vanish.
fn length<T: Real>(values: &[T]) -> T {
    let mut largest = T::ZERO;
    for &value in values {
        if !value.is_finite() {
            return value.abs();
        }
        largest = largest.max(value.abs());
    }
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
