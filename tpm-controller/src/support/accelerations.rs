//! Accelerations from a mass matrix, on the controller.
//!
//! Invariant: the matrix is a fixed-size array, nothing allocates and nothing indexes, so that no input can make it panic.

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
    matrix: [[T; N]; N],
    mut right: [T; N],
    labels: &[Label<'static>; N],
) -> Result<[T; N], SingularMass> {
    let mut rows = [([T::ZERO; N], T::ZERO); N];
    for ((row, entries), &right) in rows.iter_mut().zip(&matrix).zip(&right) {
        let largest = entries.iter().fold(T::ZERO, |largest, entry| largest.max(entry.abs()));
        if !right.is_finite() || !entries.iter().all(|entry| entry.is_finite()) {
            return Err(SingularMass::NotFinite);
        }
        *row = (*entries, right);
        if largest > T::ZERO {
            row.0.iter_mut().for_each(|entry| *entry /= largest);
            row.1 /= largest;
        }
    }
    let at = |row: &([T; N], T), column: usize| row.0.get(column).copied().unwrap_or(T::ZERO);
    let tiny = T::EPSILON * T::from_f64(N as f64);
    // The largest entry that a column had, against which its pivot is small.
    let mut sizes = [T::ZERO; N];
    for (column, size) in sizes.iter_mut().enumerate() {
        *size = rows.iter().fold(T::ZERO, |largest, row| largest.max(at(row, column).abs()));
    }
    let mut left = rows.as_mut_slice();
    for (k, &size) in sizes.iter().enumerate() {
        let Some((first, rest)) = left.split_first_mut() else { break };
        for other in rest.iter_mut() {
            if at(other, k).abs() > at(first, k).abs() {
                core::mem::swap(first, other);
            }
        }
        let pivot = at(first, k);
        if pivot.abs() <= tiny * size {
            let name = labels.get(k).map_or("", |label| label.name);
            return Err(SingularMass::Undetermined { coordinate: k, name });
        }
        for other in rest.iter_mut() {
            let factor = at(other, k) / pivot;
            for (entry, &above) in other.0.iter_mut().zip(&first.0).skip(k) {
                *entry -= factor * above;
            }
            other.1 -= factor * first.1;
        }
        left = rest;
    }
    right = [T::ZERO; N];
    for (k, row) in rows.iter().enumerate().rev() {
        let mut sum = row.1;
        for (&entry, &value) in row.0.iter().zip(&right).skip(k + 1) {
            sum -= entry * value;
        }
        if let Some(slot) = right.get_mut(k) {
            *slot = sum / at(row, k);
        }
    }
    if right.iter().all(|value| value.is_finite()) { Ok(right) } else { Err(SingularMass::NotFinite) }
}
