//! Characteristic polynomial, determinant and adjugate of a small square matrix over a commutative ring that contains
//! the rationals, by the method of Faddeev and LeVerrier.
//!
//! The only divisions are by the whole numbers 1..n, so the method is fraction-free over polynomials: no entry of the
//! matrix is ever inverted, and a mass matrix M is inverted as adj(M) / det(M).
//!
//! Invariant: matrices are square lists of rows, of the same size.

use crate::budget;
use crate::number::rational::{self, Rational};
use num_traits::{One, Zero};

/// Operations for an entry that is looked at, for the budget.
const VISITED: u64 = 4;
/// Operations for an entry of a new matrix, for the budget: also a zero takes memory of its own.
const MADE: u64 = 32;
/// Operations for a product of two entries and its sum, beside those that long entries count themselves.
const MULTIPLIED: u64 = 64;

/// A square matrix as a list of rows.
pub type Matrix<E> = Vec<Vec<E>>;

/// Arithmetic of a commutative ring that contains the rationals.
pub trait Ring {
    /// The ring element that equals a rational number.
    type Element: Clone;
    /// The element of a rational number.
    fn number(&mut self, value: &Rational) -> Self::Element;
    /// The sum.
    fn add(&mut self, a: &Self::Element, b: &Self::Element) -> Self::Element;
    /// Adds to a sum, which keeps its memory where the ring can do that.
    fn add_to(&mut self, sum: &mut Self::Element, part: Self::Element) {
        *sum = self.add(sum, &part);
    }
    /// The product.
    fn mul(&mut self, a: &Self::Element, b: &Self::Element) -> Self::Element;
    /// The element multiplied by a rational number.
    fn scale(&mut self, a: &Self::Element, factor: &Rational) -> Self::Element;
    /// Whether the element is known to be zero, so that its products need not be formed.
    fn is_zero(&self, a: &Self::Element) -> bool;
}

/// The rational numbers.
pub struct Rationals;

impl Ring for Rationals {
    type Element = Rational;

    fn number(&mut self, value: &Rational) -> Rational {
        value.clone()
    }

    fn add(&mut self, a: &Rational, b: &Rational) -> Rational {
        a + b
    }

    fn mul(&mut self, a: &Rational, b: &Rational) -> Rational {
        a * b
    }

    fn scale(&mut self, a: &Rational, factor: &Rational) -> Rational {
        a * factor
    }

    fn is_zero(&self, a: &Rational) -> bool {
        a.is_zero()
    }
}

/// det(s I - A) and adj(s I - A) as polynomials in s.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Characteristic<E> {
    /// Coefficients of det(s I - A) from s^0 to s^n; the last is 1.
    pub coefficients: Vec<E>,
    /// Matrix coefficients of adj(s I - A) from s^0 to s^(n-1).
    pub adjugate: Vec<Matrix<E>>,
}

/// The characteristic polynomial and the resolvent of `matrix`.
pub fn characteristic<R: Ring>(ring: &mut R, matrix: &Matrix<R::Element>) -> Characteristic<R::Element> {
    let mut adjugate = Vec::with_capacity(matrix.len());
    let coefficients = recursion(ring, matrix, |power| adjugate.push(power));
    adjugate.reverse();
    Characteristic { coefficients, adjugate }
}

/// The coefficients of det(s I - A) from s^0 to s^n, and to `each` the matrix coefficients of adj(s I - A) from s^(n-1) down to s^0.
fn recursion<R: Ring>(
    ring: &mut R,
    matrix: &Matrix<R::Element>,
    mut each: impl FnMut(Matrix<R::Element>),
) -> Vec<R::Element> {
    let n = matrix.len();
    let (zero, one) = (ring.number(&Rational::zero()), ring.number(&Rational::one()));
    let mut coefficients = vec![one.clone()];
    // N_1 = I; c_{n-k} = -tr(A N_k) / k; N_{k+1} = A N_k + c_{n-k} I.
    let mut current: Matrix<R::Element> =
        (0..n).map(|i| (0..n).map(|j| if i == j { one.clone() } else { zero.clone() }).collect()).collect();
    for k in 1..=n {
        let mut product = multiply(ring, matrix, &current);
        let trace = (0..n).fold(zero.clone(), |sum, i| ring.add(&sum, &product[i][i]));
        let divisor = i64::try_from(k).expect("invariant: the size of a matrix fits in i64");
        let coefficient = ring.scale(&trace, &rational::ratio(-1, divisor));
        for (i, row) in product.iter_mut().enumerate() {
            row[i] = ring.add(&row[i], &coefficient);
        }
        coefficients.push(coefficient);
        each(std::mem::replace(&mut current, product));
    }
    coefficients.reverse();
    coefficients
}

/// det(A) and adj(A), so that A adj(A) = det(A) I.
pub fn adjugate<R: Ring>(ring: &mut R, matrix: &Matrix<R::Element>) -> (R::Element, Matrix<R::Element>) {
    let n = matrix.len();
    // Only the last matrix of the recursion is kept: all of them would take n times its memory.
    let mut rows = Vec::new();
    let coefficients = recursion(ring, matrix, |power| rows = power);
    // det(-A) = (-1)^n det(A), adj(-A) = (-1)^(n-1) adj(A).
    let sign = |odd: bool| rational::integer(if odd { -1 } else { 1 });
    let determinant = ring.scale(&coefficients[0], &sign(n % 2 == 1));
    let factor = sign(n.is_multiple_of(2));
    let scaled = rows.iter().map(|row| row.iter().map(|entry| ring.scale(entry, &factor)).collect()).collect();
    (determinant, scaled)
}

/// The product of two matrices; `b` may have any number of columns. The time is that of the products of elements that are not zero.
pub fn multiply<R: Ring>(ring: &mut R, a: &[Vec<R::Element>], b: &[Vec<R::Element>]) -> Matrix<R::Element> {
    let width = b.first().map_or(0, Vec::len);
    let zero = ring.number(&Rational::zero());
    let mut rows = Vec::with_capacity(a.len());
    for row in a {
        budget::charge(VISITED.saturating_mul(row.len() as u64).saturating_add(MADE.saturating_mul(width as u64)));
        let mut sums = vec![zero.clone(); width];
        for (left, others) in row.iter().zip(b) {
            if ring.is_zero(left) {
                continue;
            }
            budget::charge(VISITED.saturating_mul(width as u64));
            for (sum, right) in sums.iter_mut().zip(others) {
                if ring.is_zero(right) {
                    continue;
                }
                budget::charge(MULTIPLIED);
                let product = ring.mul(left, right);
                ring.add_to(sum, product);
            }
        }
        rows.push(sums);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::{Rationals, adjugate, characteristic, multiply};
    use crate::number::rational::{Rational, integer, ratio};
    use proptest::prelude::{prop, prop_assert_eq, proptest};

    #[test]
    fn companion_matrix_has_its_polynomial() {
        // s^3 - 2 s^2 - 5 s + 6 = (s - 1)(s + 2)(s - 3)
        let rows = [[0, 1, 0], [0, 0, 1], [-6, 5, 2]];
        let matrix: Vec<Vec<Rational>> = rows.iter().map(|row| row.iter().map(|&v| integer(v)).collect()).collect();
        let found = characteristic(&mut Rationals, &matrix);
        assert_eq!(found.coefficients, vec![integer(6), integer(-5), integer(-2), integer(1)]);
        let (determinant, _) = adjugate(&mut Rationals, &matrix);
        assert_eq!(determinant, integer(-6));
    }

    proptest! {
        #[test]
        fn a_matrix_times_its_adjugate_is_its_determinant(
            entries in prop::collection::vec((-9i64..10, 1i64..5), 25),
            n in 1usize..6,
        ) {
            let matrix: Vec<Vec<Rational>> =
                (0..n).map(|i| (0..n).map(|j| ratio(entries[5 * i + j].0, entries[5 * i + j].1)).collect()).collect();
            let (determinant, inverse) = adjugate(&mut Rationals, &matrix);
            let product = multiply(&mut Rationals, &matrix, &inverse);
            for (i, row) in product.iter().enumerate() {
                for (j, value) in row.iter().enumerate() {
                    prop_assert_eq!(value, &(if i == j { determinant.clone() } else { integer(0) }));
                }
            }
        }
    }
}
