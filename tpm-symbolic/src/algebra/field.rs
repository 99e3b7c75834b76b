//! Fields in which expressions can be evaluated: the rationals, and the residues modulo a prime.
//!
//! An identity over the rationals holds modulo every prime that divides none of its denominators. A number that is
//! nonzero modulo a prime is nonzero. So a rank modulo a prime is a certain lower bound of the rank, and each of its
//! numbers takes one machine word.

use crate::budget;
use crate::number::rational::{Rational, ratio};
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{One, Signed, ToPrimitive, Zero};

/// A field with exact arithmetic.
pub trait Field {
    /// Its elements; equal elements are equal data.
    type Element: Clone + PartialEq;

    /// The image of a rational number; `None` where its denominator has no inverse.
    fn number(&self, value: &Rational) -> Option<Self::Element>;
    /// The sum.
    fn add(&self, a: &Self::Element, b: &Self::Element) -> Self::Element;
    /// The difference.
    fn sub(&self, a: &Self::Element, b: &Self::Element) -> Self::Element;
    /// The product.
    fn mul(&self, a: &Self::Element, b: &Self::Element) -> Self::Element;
    /// The inverse; `None` of zero.
    fn inverse(&self, a: &Self::Element) -> Option<Self::Element>;
    /// Whether an element is zero.
    fn is_zero(&self, a: &Self::Element) -> bool;
    /// An element from a random word: of a finite field any element, of the rationals a nonzero fraction of small
    /// numbers.
    fn element(&self, word: u64) -> Self::Element;

    /// The element zero.
    fn zero(&self) -> Self::Element {
        self.number(&Rational::zero()).expect("invariant: zero is in every field")
    }

    /// The element one.
    fn one(&self) -> Self::Element {
        self.number(&Rational::one()).expect("invariant: one is in every field")
    }

    /// The vector times a nonzero factor that makes sums of products with it cheap: over the rationals, the factor
    /// makes all components whole numbers.
    fn cleared(&self, vector: Vec<Self::Element>) -> Vec<Self::Element> {
        vector
    }

    /// `base ^ exponent`; `None` for a negative power of zero.
    fn power(&self, base: &Self::Element, exponent: i32) -> Option<Self::Element> {
        let mut square = if exponent < 0 { self.inverse(base)? } else { base.clone() };
        let mut rest = exponent.unsigned_abs();
        let mut result = self.one();
        while rest > 0 {
            if rest & 1 == 1 {
                result = self.mul(&result, &square);
            }
            rest >>= 1;
            if rest > 0 {
                square = self.mul(&square, &square);
            }
        }
        Some(result)
    }

    /// Brings `rows` to reduced row echelon form in place, with pivots in the given order of the columns. Returns the
    /// pivot column of every remaining row; rows of zeros are dropped.
    fn reduce(&self, rows: &mut Vec<Vec<Self::Element>>, order: &[usize]) -> Vec<usize> {
        let mut pivots = Vec::new();
        for &column in order {
            let top = pivots.len();
            let Some(found) = (top..rows.len()).find(|&r| !self.is_zero(&rows[r][column])) else { continue };
            rows.swap(top, found);
            let inverse = self.inverse(&rows[top][column]).expect("invariant: a pivot is not zero");
            for value in &mut rows[top] {
                *value = self.mul(value, &inverse);
            }
            let pivot = std::mem::take(&mut rows[top]);
            for row in rows.iter_mut().filter(|row| !row.is_empty()) {
                if self.is_zero(&row[column]) {
                    continue;
                }
                budget::charge(ENTRY * row.len() as u64);
                let factor = row[column].clone();
                for (value, of_pivot) in row.iter_mut().zip(&pivot) {
                    if !self.is_zero(of_pivot) {
                        *value = self.sub(value, &self.mul(&factor, of_pivot));
                    }
                }
            }
            rows[top] = pivot;
            pivots.push(column);
        }
        rows.truncate(pivots.len());
        pivots
    }
}

/// The rational numbers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rationals;

impl Field for Rationals {
    type Element = Rational;

    fn number(&self, value: &Rational) -> Option<Rational> {
        Some(value.clone())
    }

    fn add(&self, a: &Rational, b: &Rational) -> Rational {
        a + b
    }

    fn sub(&self, a: &Rational, b: &Rational) -> Rational {
        a - b
    }

    fn mul(&self, a: &Rational, b: &Rational) -> Rational {
        a * b
    }

    fn inverse(&self, a: &Rational) -> Option<Rational> {
        (!a.is_zero()).then(|| a.recip())
    }

    fn is_zero(&self, a: &Rational) -> bool {
        a.is_zero()
    }

    fn cleared(&self, vector: Vec<Rational>) -> Vec<Rational> {
        let common = vector.iter().fold(BigInt::one(), |common, value| match value.is_integer() {
            true => common,
            false => common.lcm(&value.denom()),
        });
        let whole = |value: Rational| Rational::from_integer(value.numer() * (&common / value.denom()));
        vector.into_iter().map(|value| if value.is_zero() { value } else { whole(value) }).collect()
    }

    fn element(&self, word: u64) -> Rational {
        // Results grow with the drawn numbers: at the end of a long arm they are the square of the product over all
        // joints, so the numbers are small.
        let above = i64::try_from(word % 13).unwrap_or_default() + 1;
        let below = i64::try_from((word >> 16) % 7).unwrap_or_default() + 1;
        ratio(if word >> 63 == 1 { -above } else { above }, below)
    }
}

/// Bits of the primes of [`Residues::PRIMES`], and by how much they may be below that power of two for products without a division: with
/// factors below 2^61 the first fold is below 2^82, and the second one below 2^61 + 2^41.
const BITS: u32 = 61;
const MOST_LITTLE: u64 = 1 << 20;

/// Operations for an entry of a row in one step of an elimination, for the budget.
const ENTRY: u64 = 2;

/// The field of residues modulo a prime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Residues {
    prime: u64,
}

impl Residues {
    /// Primes between 2^60 and 2^61, the largest first, each 3 modulo 4: there 1 + t^2 is never zero, so that every t is the tangent
    /// of half an angle.
    pub const PRIMES: [u64; 4] =
        [2_305_843_009_213_693_951, 2_305_843_009_213_693_907, 2_305_843_009_213_693_723, 2_305_843_009_213_693_487];

    /// The field of a prime.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::field::{Field, Residues, reconstruct}, number::rational::ratio};
    /// let seven = Residues::new(7);
    /// assert_eq!(seven.mul(&3, &5), 1);
    /// ```
    #[must_use]
    pub fn new(prime: u64) -> Self {
        Self { prime }
    }

    /// The fields of all such primes, the largest first; they begin with those of [`PRIMES`](Self::PRIMES).
    pub fn all() -> impl Iterator<Item = Self> {
        (1_u64 << 60..1 << 61).rev().filter(|number| number % 4 == 3).map(Self::new).filter(Self::is_prime)
    }

    /// Whether the number is prime: Miller and Rabin, with witnesses that decide every number of 64 bits. It must be 3 modulo 4, so
    /// that half of its predecessor is odd.
    fn is_prime(&self) -> bool {
        let half = (self.prime - 1) / 2;
        [2u64, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37].iter().all(|witness| {
            let power = self.raised(*witness, half);
            power == 1 || power == self.prime - 1
        })
    }

    fn raised(&self, base: u64, mut exponent: u64) -> u64 {
        let (mut square, mut result) = (base, 1);
        while exponent > 0 {
            if exponent & 1 == 1 {
                result = self.mul(&result, &square);
            }
            square = self.mul(&square, &square);
            exponent >>= 1;
        }
        result
    }

    /// The prime.
    #[must_use]
    pub fn prime(&self) -> u64 {
        self.prime
    }

    fn residue(&self, value: &BigInt) -> u64 {
        value.mod_floor(&BigInt::from(self.prime)).to_u64().expect("invariant: a residue is below its prime")
    }
}

impl Field for Residues {
    type Element = u64;

    fn number(&self, value: &Rational) -> Option<u64> {
        if let Some((numerator, 1)) = value.as_words() {
            return u64::try_from(i128::from(numerator).rem_euclid(i128::from(self.prime))).ok();
        }
        let below = self.inverse(&self.residue(&value.denom()))?;
        Some(self.mul(&self.residue(&value.numer()), &below))
    }

    fn add(&self, a: &u64, b: &u64) -> u64 {
        let sum = a + b;
        if sum >= self.prime { sum - self.prime } else { sum }
    }

    fn sub(&self, a: &u64, b: &u64) -> u64 {
        if a >= b { a - b } else { a + (self.prime - b) }
    }

    fn mul(&self, a: &u64, b: &u64) -> u64 {
        let product = u128::from(*a) * u128::from(*b);
        // Below 2^61 by a little, modulo which 2^61 is that little: what is above 61 bits is folded down twice, without a division.
        let little = (1_u64 << BITS).wrapping_sub(self.prime);
        if little > MOST_LITTLE {
            return (product % u128::from(self.prime)) as u64;
        }
        let fold = |value: u128| (value >> BITS) * u128::from(little) + (value & ((1 << BITS) - 1));
        let folded = fold(fold(product)) as u64;
        if folded >= self.prime { folded - self.prime } else { folded }
    }

    fn inverse(&self, a: &u64) -> Option<u64> {
        if *a == 0 {
            return None;
        }
        // Fermat.
        Some(self.raised(*a, self.prime - 2))
    }

    fn is_zero(&self, a: &u64) -> bool {
        *a == 0
    }

    fn element(&self, word: u64) -> u64 {
        word % self.prime
    }
}

/// The rational of smallest size that is `residue` modulo `modulus`: numerator and denominator both below the root of half the
/// modulus, where there is at most one. `None` when there is none.
///
/// ```
/// # use tpm_symbolic::{algebra::field::{Field, Residues, reconstruct}, number::rational::ratio};
/// // 3 * 336 = 1 modulo 1007.
/// assert_eq!(reconstruct(&336.into(), &1007.into()), Some(ratio(1, 3)));
/// ```
#[must_use]
pub fn reconstruct(residue: &BigInt, modulus: &BigInt) -> Option<Rational> {
    let bound: BigInt = (modulus >> 1u32).sqrt();
    let (mut above, mut rest) = (modulus.clone(), residue.mod_floor(modulus));
    let (mut before, mut factor) = (BigInt::zero(), BigInt::one());
    while rest > bound {
        let quotient = &above / &rest;
        let next = &above - &quotient * &rest;
        above = std::mem::replace(&mut rest, next);
        let next = &before - &quotient * &factor;
        before = std::mem::replace(&mut factor, next);
    }
    let sound = !factor.is_zero() && factor.abs() <= bound && rest.gcd(&factor).is_one();
    sound.then(|| Rational::new(rest, factor))
}

#[cfg(test)]
mod tests {
    use super::{Field, Rationals, Residues, reconstruct};
    use crate::number::rational::{integer, ratio};
    use num_bigint::BigInt;
    use proptest::prelude::{prop_assert_eq, proptest};

    #[test]
    fn products_are_the_remainders_of_products() {
        let fields =
            Residues::PRIMES.into_iter().chain([7, (1 << 61) - 3, 1_152_921_504_606_847_067]).map(Residues::new);
        for field in fields {
            let prime = field.prime();
            let numbers = [0, 1, 2, 3, prime / 2, prime / 3 * 2, prime - 2, prime - 1].map(|number| number % prime);
            for (a, b) in numbers.iter().flat_map(|a| numbers.iter().map(move |b| (a, b))) {
                assert_eq!(u128::from(field.mul(a, b)), u128::from(*a) * u128::from(*b) % u128::from(prime), "{prime}");
            }
        }
    }

    #[test]
    fn the_primes_are_all_that_are_three_modulo_four() {
        assert!(Residues::PRIMES.iter().all(|prime| prime % 4 == 3 && prime >> 60 == 1));
        assert_eq!(Residues::all().take(4).map(|field| field.prime()).collect::<Vec<_>>(), Residues::PRIMES);
        // Products of two primes, Carmichael numbers and squares among the small ones are told apart.
        let small = (3..2000).filter(|number| number % 4 == 3 && *number > 37);
        for number in small {
            let divided =
                (2..number).take_while(|divisor| divisor * divisor <= number).any(|divisor| number % divisor == 0);
            assert_eq!(Residues::new(number).is_prime(), !divided, "{number}");
        }
    }

    #[test]
    fn elimination_takes_pivots_in_the_order_that_is_asked_for() {
        // Column 2 is column 0 plus twice column 1.
        let rows = || vec![vec![integer(1), integer(0), integer(1)], vec![integer(3), integer(5), integer(13)]];
        let (mut forward, mut backward) = (rows(), rows());
        assert_eq!(Rationals.reduce(&mut forward, &[0, 1, 2]), [0, 1]);
        assert_eq!(forward, [[integer(1), integer(0), integer(1)], [integer(0), integer(1), integer(2)]]);
        assert_eq!(Rationals.reduce(&mut backward, &[2, 1, 0]), [2, 1]);
        assert_eq!(backward[1], [integer(-2), integer(1), integer(0)]);
    }

    proptest! {
        #[test]
        fn rationals_come_back_from_their_residues(numerator in -1_000_000i64..1_000_000, denominator in 1i64..1_000_000) {
            let value = ratio(numerator, denominator);
            for prime in Residues::PRIMES {
                let field = Residues::new(prime);
                let residue = field.number(&value).expect("a small denominator");
                prop_assert_eq!(reconstruct(&BigInt::from(residue), &BigInt::from(prime)), Some(value.clone()));
            }
        }
    }
}
