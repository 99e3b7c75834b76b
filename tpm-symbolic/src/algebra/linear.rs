//! Exact linear algebra over the rationals, on small dense matrices.
//!
//! Invariant: matrices are lists of rows of equal length. Elimination picks the first non-zero pivot: over the
//! rationals there is no rounding, so no pivot is better than another for accuracy.

use crate::budget;
use crate::number::rational::Rational;
use num_traits::{One, Zero};

/// Operations per entry in one elimination step, for the budget.
const ENTRY: u64 = 16;

/// Brings `rows` to reduced row echelon form in place and returns the pivot columns.
///
/// ```
/// # use tpm_symbolic::{algebra::linear::*, number::rational::integer};
/// let mut rows = vec![vec![integer(2), integer(4)], vec![integer(1), integer(2)]];
/// assert_eq!((reduce(&mut rows), rows), (vec![0], vec![vec![integer(1), integer(2)]]));
/// ```
pub fn reduce(rows: &mut Vec<Vec<Rational>>) -> Vec<usize> {
    let width = rows.first().map_or(0, Vec::len);
    let mut pivots = Vec::new();
    for column in 0..width {
        let top = pivots.len();
        let Some(found) = (top..rows.len()).find(|&r| !rows[r][column].is_zero()) else { continue };
        rows.swap(top, found);
        let inverse = rows[top][column].recip();
        for value in &mut rows[top][column..] {
            *value *= &inverse;
        }
        let pivot_row = rows[top].clone();
        for (r, row) in rows.iter_mut().enumerate() {
            if r != top && !row[column].is_zero() {
                budget::charge(ENTRY * (width - column) as u64);
                let factor = row[column].clone();
                for (value, pivot) in row[column..].iter_mut().zip(&pivot_row[column..]) {
                    if !pivot.is_zero() {
                        *value -= &factor * pivot;
                    }
                }
            }
        }
        pivots.push(column);
    }
    rows.truncate(pivots.len());
    pivots
}

/// Solves the augmented system (last column is the right-hand side); `None` unless there is exactly one solution.
///
/// ```
/// # use tpm_symbolic::{algebra::linear::*, number::rational::integer};
/// assert_eq!(solve_unique(vec![vec![integer(2), integer(6)]], 1), Some(vec![integer(3)]));
/// assert_eq!(solve_unique(vec![vec![integer(0), integer(6)]], 1), None);
/// ```
#[must_use]
pub fn solve_unique(mut rows: Vec<Vec<Rational>>, unknowns: usize) -> Option<Vec<Rational>> {
    let pivots = reduce(&mut rows);
    if pivots.len() != unknowns || pivots.last().is_some_and(|&last| last >= unknowns) {
        return None;
    }
    Some(rows.iter().map(|row| row[unknowns].clone()).collect())
}

/// A basis of the null space of `rows`, each vector with a 1 at its own free column.
///
/// ```
/// # use tpm_symbolic::{algebra::linear::*, number::rational::integer};
/// assert_eq!(null_space(vec![vec![integer(1), integer(2)]], 2), [[integer(-2), integer(1)]]);
/// ```
#[must_use]
pub fn null_space(mut rows: Vec<Vec<Rational>>, columns: usize) -> Vec<Vec<Rational>> {
    let pivots = reduce(&mut rows);
    (0..columns)
        .filter(|column| !pivots.contains(column))
        .map(|free| {
            let mut vector = vec![Rational::zero(); columns];
            vector[free] = Rational::one();
            for (row, &pivot) in rows.iter().zip(&pivots) {
                vector[pivot] = -row[free].clone();
            }
            vector
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{null_space, reduce, solve_unique};
    use crate::number::rational::integer;

    #[test]
    fn rank_and_null_space_of_a_singular_matrix() {
        let rows = vec![
            vec![integer(1), integer(2), integer(3)],
            vec![integer(4), integer(5), integer(6)],
            vec![integer(7), integer(8), integer(9)],
        ];
        assert_eq!(reduce(&mut rows.clone()).len(), 2);
        assert_eq!(null_space(rows, 3), vec![vec![integer(1), integer(-2), integer(1)]]);
    }

    #[test]
    fn only_a_single_solution_counts() {
        assert_eq!(solve_unique(vec![vec![integer(2), integer(6)]], 1), Some(vec![integer(3)]));
        assert_eq!(solve_unique(vec![vec![integer(1), integer(1)], vec![integer(1), integer(2)]], 1), None);
        assert_eq!(solve_unique(vec![], 1), None);
        assert_eq!(solve_unique(vec![], 0), Some(vec![]));
    }
}
