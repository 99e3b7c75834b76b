//! Accelerations from a mass matrix, on the controller.
//!
//! Invariants: the matrix is a fixed-size array, nothing allocates, and every index is that of a loop below its length, so that no input can
//! make it panic.

use super::Label;
use super::Real;
use core::fmt;

/// Why accelerations do not follow from forces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SingularMass {
    /// With these parameters no equation determines the acceleration of this coordinate: its inertia is zero, or that of a combination
    /// of coordinates is.
    Undetermined {
        /// Index of the coordinate.
        coordinate: usize,
        /// Its name.
        name: &'static str,
    },
    /// A number of the motion, of the inputs or of the parameters is infinite or not a number.
    NotFinite,
}

impl fmt::Display for SingularMass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Undetermined { name, .. } => {
                write!(f, "the mass matrix is singular: nothing determines the acceleration of {name}")
            }
            Self::NotFinite => f.write_str("the motion, the inputs or the parameters hold a number that is not finite"),
        }
    }
}

impl core::error::Error for SingularMass {}

/// Whether accelerations that follow from M = L D L^T count: every pivot (entry of D) is positive beyond the rounding of the entry of M on
/// the diagonal from which it comes, and every acceleration is finite. Elimination with pivoting decides about others ([`accelerations`]).
pub fn factors_hold<T: Real, const N: usize>(pivots: &[T; N], diagonal: &[T; N], accelerations: &[T; N]) -> bool {
    let tiny = T::EPSILON * T::from_f64(N as f64);
    pivots.iter().zip(diagonal).all(|(&pivot, &entry)| pivot > tiny * entry.abs())
        && accelerations.iter().all(|value| value.is_finite())
}

/// The accelerations a with M a = b: elimination with row pivoting, every row divided by its largest entry first, so that the units of
/// the rows do not decide the order.
///
/// # Errors
/// [`SingularMass::Undetermined`] when a pivot vanishes to rounding, [`SingularMass::NotFinite`].
pub fn accelerations<T: Real, const N: usize>(
    mut matrix: [[T; N]; N],
    mut right: [T; N],
    labels: &[Label<'static>; N],
) -> Result<[T; N], SingularMass> {
    match eliminate(&mut matrix, &mut right) {
        coordinate if coordinate < N => {
            let name = labels.get(coordinate).map_or("", |label| label.name);
            Err(SingularMass::Undetermined { coordinate, name })
        }
        coordinate if coordinate == N => Ok(right),
        _ => Err(SingularMass::NotFinite),
    }
}

/// The x with `matrix x = right` in the place of the right-hand side, by elimination with row pivoting; the matrix is destroyed. Gives the
/// number of unknowns, the first unknown whose pivot vanishes to rounding, or one more than their number when a number is not finite.
fn eliminate<T: Real, const N: usize>(matrix: &mut [[T; N]; N], right: &mut [T; N]) -> usize {
    for i in 0..N {
        let mut largest = T::ZERO;
        for j in 0..N {
            if !matrix[i][j].is_finite() {
                return N + 1;
            }
            largest = largest.max(matrix[i][j].abs());
        }
        if !right[i].is_finite() {
            return N + 1;
        }
        if largest > T::ZERO {
            for j in 0..N {
                matrix[i][j] /= largest;
            }
            right[i] /= largest;
        }
    }
    // The largest entry that a column had, against which its pivot is small.
    let mut sizes = [T::ZERO; N];
    for i in 0..N {
        for j in 0..N {
            sizes[j] = sizes[j].max(matrix[i][j].abs());
        }
    }
    for k in 0..N {
        for i in k + 1..N {
            if matrix[i][k].abs() > matrix[k][k].abs() {
                matrix.swap(k, i);
                right.swap(k, i);
            }
        }
        if matrix[k][k].abs() <= T::EPSILON * T::from_f64(N as f64) * sizes[k] {
            return k;
        }
        for i in k + 1..N {
            let factor = matrix[i][k] / matrix[k][k];
            for j in k..N {
                let above = factor * matrix[k][j];
                matrix[i][j] -= above;
            }
            let above_right = factor * right[k];
            right[i] -= above_right;
        }
    }
    for k in (0..N).rev() {
        let mut sum = right[k];
        for j in k + 1..N {
            sum -= matrix[k][j] * right[j];
        }
        right[k] = sum / matrix[k][k];
        if !right[k].is_finite() {
            return N + 1;
        }
    }
    N
}
