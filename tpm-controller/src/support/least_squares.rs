//! Least squares with as many unknowns as a model has parameters, on the controller.
//!
//! Invariants: nothing allocates, and every index is that of a loop below its length, so that no input can make it panic. The
//! method is Gram-Schmidt orthogonalisation, modified, with column pivoting, the right-hand side carried along as one more
//! column; that is as stable as Householder's (Björck, 1967).

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
    weighted_least_squares(matrix, right, None, labels).map(|found| found.solution)
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
        for i in 0..R {
            for j in 0..C {
                matrix[i][j] /= deviations[i];
            }
            right[i] /= deviations[i];
        }
    }
    let mut fit = Fit::new();
    match fit.solve(&mut matrix, &mut right) {
        place if place < C => {
            Err(SolveError::Unobservable { parameter: place, name: labels.get(place).map_or("", |label| label.name) })
        }
        place if place == C => Ok(LeastSquares {
            solution: fit.solution,
            covariance: fit.covariance,
            residual: fit.residual,
            condition: fit.condition,
        }),
        _ => Err(SolveError::NotFinite),
    }
}

/// The memory of a solution, and what the data say.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit<T, const C: usize> {
    /// The triangular factor, its columns in the order of the pivots, and then its inverse.
    factor: [[T; C]; C],
    /// Lengths of the columns, and the places from which they came, in that order.
    scales: [T; C],
    order: [usize; C],
    projected: [T; C],
    /// The x, its covariance, the length of what is left of b, and the condition.
    pub(super) solution: [T; C],
    pub(super) covariance: [[T; C]; C],
    pub(super) residual: T,
    pub(super) condition: T,
    /// The number of pivots that were found.
    pub rank: usize,
}

/// Euclidean length of a column, or of the right-hand side, scaled by the largest entry so that squares neither overflow nor vanish.
fn column_length<T: Real, const C: usize>(matrix: &[[T; C]], column: usize) -> T {
    let mut largest = T::ZERO;
    let mut sum = T::ZERO;
    if column >= C {
        return sum;
    }
    for i in 0..matrix.len() {
        if !matrix[i][column].is_finite() {
            return matrix[i][column].abs();
        }
        largest = largest.max(matrix[i][column].abs());
    }
    if largest <= T::ZERO {
        return largest;
    }
    for i in 0..matrix.len() {
        let part = matrix[i][column] / largest;
        sum += part * part;
    }
    largest * sum.sqrt()
}

/// Euclidean length of numbers, in the same way.
fn length<T: Real>(values: &[T]) -> T {
    let mut largest = T::ZERO;
    for i in 0..values.len() {
        largest = largest.max(values[i].abs());
    }
    if largest <= T::ZERO {
        return largest;
    }
    let mut sum = T::ZERO;
    for i in 0..values.len() {
        let part = values[i] / largest;
        sum += part * part;
    }
    largest * sum.sqrt()
}

impl<T: Real, const C: usize> Fit<T, C> {
    fn new() -> Self {
        let (vector, matrix) = ([T::ZERO; C], [[T::ZERO; C]; C]);
        Self {
            factor: matrix,
            scales: vector,
            order: [0; C],
            projected: vector,
            solution: vector,
            covariance: matrix,
            residual: T::ZERO,
            condition: T::ZERO,
            rank: 0,
        }
    }

    /// Finds the x that minimises |A x - b|; A becomes orthonormal, b what is left of it. Gives the number of unknowns, the first one that
    /// the data do not determine, or one more than their number when a number is not finite.
    pub(super) fn solve(&mut self, matrix: &mut [[T; C]], right: &mut [T]) -> usize {
        self.rank = 0;
        for i in 0..matrix.len().min(right.len()) {
            for j in 0..C {
                if !matrix[i][j].is_finite() {
                    return C + 1;
                }
            }
            if !right[i].is_finite() {
                return C + 1;
            }
        }
        for j in 0..C {
            let size = column_length(matrix, j);
            if !size.is_finite() {
                return C + 1;
            }
            self.order[j] = j;
            self.scales[j] = if size > T::ZERO { size } else { T::ONE };
            for i in 0..matrix.len() {
                matrix[i][j] /= self.scales[j];
            }
        }
        let sides = matrix.len() + C;
        let tiny = T::EPSILON * T::from_f64(4.0) * T::from_f64(sides as f64);
        for k in 0..C {
            let mut diagonal = column_length(matrix, k);
            for j in k + 1..C {
                let size = column_length(matrix, j);
                if size > diagonal {
                    diagonal = size;
                    self.exchange(matrix, k, j);
                }
            }
            if diagonal <= tiny {
                return self.order[k];
            }
            self.eliminate(matrix, right, k, diagonal);
            self.rank += 1;
        }
        self.residual = length(right);
        self.substitute();
        self.invert();
        C
    }

    /// Exchanges two columns.
    fn exchange(&mut self, matrix: &mut [[T; C]], k: usize, j: usize) {
        if k >= C || j >= C {
            return;
        }
        for i in 0..matrix.len() {
            matrix[i].swap(k, j);
        }
        for i in 0..C {
            self.factor[i].swap(k, j);
        }
        self.order.swap(k, j);
        self.scales.swap(k, j);
    }

    /// Gives a column the length one, and takes its part off those behind it and off the right-hand side.
    fn eliminate(&mut self, matrix: &mut [[T; C]], right: &mut [T], k: usize, diagonal: T) {
        if k >= C {
            return;
        }
        self.factor[k][k] = diagonal;
        for i in 0..matrix.len() {
            matrix[i][k] /= diagonal;
        }
        for j in k + 1..C {
            let mut along = T::ZERO;
            for i in 0..matrix.len() {
                along += matrix[i][k] * matrix[i][j];
            }
            for i in 0..matrix.len() {
                let part = along * matrix[i][k];
                matrix[i][j] -= part;
            }
            self.factor[k][j] = along;
        }
        let mut of_right = T::ZERO;
        for i in 0..matrix.len().min(right.len()) {
            of_right += matrix[i][k] * right[i];
        }
        for i in 0..matrix.len().min(right.len()) {
            right[i] -= of_right * matrix[i][k];
        }
        self.projected[k] = of_right;
    }

    /// Solves with the triangular factor, and gives every unknown its place.
    fn substitute(&mut self) {
        for k in (0..C).rev() {
            let mut sum = self.projected[k];
            for j in k + 1..C {
                sum -= self.factor[k][j] * self.projected[j];
            }
            self.projected[k] = sum / self.factor[k][k];
            for place in 0..C {
                if self.order[k] == place {
                    self.solution[place] = self.projected[k] / self.scales[k];
                }
            }
        }
    }

    /// The inverse of the triangular factor in its place, column by column, and with it the covariance.
    fn invert(&mut self) {
        for j in 0..C {
            self.factor[j][j] = T::ONE / self.factor[j][j];
            for i in 0..j {
                let mut sum = T::ZERO;
                for k in i..j {
                    sum += self.factor[i][k] * self.factor[k][j];
                }
                self.factor[i][j] = -(sum * self.factor[j][j]);
            }
        }
        let mut square = T::ZERO;
        for i in 0..C {
            for j in 0..=i {
                let mut sum = T::ZERO;
                for k in i..C {
                    sum += self.factor[i][k] * self.factor[j][k];
                }
                if i == j {
                    square += sum;
                }
                self.place(i, j, sum / self.scales[i] / self.scales[j]);
            }
        }
        self.condition = (T::from_f64(C as f64) * square).sqrt();
    }

    /// Gives the covariance of two columns its two places.
    fn place(&mut self, i: usize, j: usize, value: T) {
        if i >= C || j >= C {
            return;
        }
        for row in 0..C {
            for column in 0..C {
                let own = row == self.order[i] && column == self.order[j];
                if own || (row == self.order[j] && column == self.order[i]) {
                    self.covariance[row][column] = value;
                }
            }
        }
    }
}
