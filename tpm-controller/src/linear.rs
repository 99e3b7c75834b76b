//! Small dense linear algebra in memory of the caller.
//!
//! Invariant: matrices are row-major slices, nothing allocates, and the order of operations is fixed, so that results are
//! the same on every machine.

use crate::support::Real;

/// Solves the square system `matrix x = right` by elimination with row pivoting; the solution replaces `right`.
///
/// `matrix` (n x n, n = `right.len()`) is overwritten. Pivots are compared after scaling each row by its largest entry, so
/// that the units of the rows do not decide the order.
///
/// ```
/// # use tpm_controller::linear::solve_in_place;
/// let mut solution = [4.0, 6.0];
/// assert_eq!(solve_in_place(&mut [0.0, 2.0, 3.0, 0.0], &mut solution), Ok(()));
/// assert_eq!(solution, [2.0, 2.0]);
/// assert_eq!(solve_in_place(&mut [1.0, 1.0, 1.0, 1.0], &mut solution), Err(1));
/// ```
///
/// # Errors
/// The column whose pivot vanishes (to rounding), or that is not finite.
///
/// # Panics
/// When `matrix` has fewer than n x n entries.
pub fn solve_in_place<T: Real>(matrix: &mut [T], right: &mut [T]) -> Result<(), usize> {
    let n = right.len();
    if let ([entry], [value]) = (&*matrix, &mut *right) {
        // One unknown is the most frequent case, for which the general method below reduces to a division.
        let size = entry.abs();
        if !size.is_finite() || size <= T::ZERO {
            return Err(0);
        }
        *value /= size;
        if *entry < T::ZERO {
            *value = -*value;
        }
        return Ok(());
    }
    for r in 0..n {
        let mut largest = T::ZERO;
        for c in 0..n {
            let size = matrix[r * n + c].abs();
            if !size.is_finite() {
                return Err(c);
            }
            largest = largest.max(size);
        }
        if largest > T::ZERO {
            for c in 0..n {
                matrix[r * n + c] /= largest;
            }
            right[r] /= largest;
        }
    }
    let tiny = T::EPSILON * T::from_f64(n as f64);
    for k in 0..n {
        let mut pivot = k;
        for r in k + 1..n {
            if matrix[r * n + k].abs() > matrix[pivot * n + k].abs() {
                pivot = r;
            }
        }
        let size = matrix[pivot * n + k].abs();
        if !size.is_finite() || size <= T::ZERO || (n > 1 && size <= tiny * column_size(matrix, n, k)) {
            return Err(k);
        }
        if pivot != k {
            for c in 0..n {
                matrix.swap(k * n + c, pivot * n + c);
            }
            right.swap(k, pivot);
        }
        for r in k + 1..n {
            let factor = matrix[r * n + k] / matrix[k * n + k];
            if factor.abs() > T::ZERO {
                for c in k..n {
                    let above = matrix[k * n + c];
                    matrix[r * n + c] -= factor * above;
                }
                let above = right[k];
                right[r] -= factor * above;
            }
        }
    }
    for k in (0..n).rev() {
        let mut sum = right[k];
        for c in k + 1..n {
            sum -= matrix[k * n + c] * right[c];
        }
        right[k] = sum / matrix[k * n + k];
    }
    Ok(())
}

/// Largest absolute entry of a column.
fn column_size<T: Real>(matrix: &[T], n: usize, column: usize) -> T {
    (0..n).fold(T::ZERO, |largest, r| largest.max(matrix[r * n + column].abs()))
}

#[cfg(test)]
mod tests {
    use super::solve_in_place;

    #[test]
    fn solves_badly_scaled_rows() {
        // x = (1, -2, 3), rows in units 1e12 apart.
        let mut matrix = [1e-9, 2e-9, -1e-9, 0.0, 5.0, 1.0, 3e12, 0.0, 1e12];
        let mut right = [-6e-9, -7.0, 6e12];
        solve_in_place(&mut matrix, &mut right).expect("regular");
        for (found, expected) in right.iter().zip([1.0_f64, -2.0, 3.0]) {
            assert!((found - expected).abs() < 1e-13, "{found} {expected}");
        }
    }

    #[test]
    fn names_the_column_that_is_not_determined() {
        let mut matrix = [1.0, 2.0, 2.0, 4.0];
        assert_eq!(solve_in_place(&mut matrix, &mut [1.0, 2.0]), Err(1));
        let mut zero = [0.0];
        assert_eq!(solve_in_place(&mut zero, &mut [1.0]), Err(0));
        let mut fault = [f64::NAN];
        assert_eq!(solve_in_place(&mut fault, &mut [1.0]), Err(0));
        // A small mass is not a singular one.
        let mut small = [5.4e-6_f64];
        let mut right = [1.0];
        solve_in_place(&mut small, &mut right).expect("regular");
        assert!((right[0] * 5.4e-6 - 1.0).abs() < 1e-15);
    }
}
