//! Denominators in factored form, and reduction of fractions by the primes that are known to be in them.
//!
//! Invariant: a [`Denominator`] is the product of 2^two, the powers of the [`Factors`]' odd primes, and the powers of
//! its cofactors, which are products of primes beyond [`TRIAL`] that were not found by trial division. The cofactors
//! need not be coprime: the exponents then describe a common multiple that may be larger than the least one, and
//! reduction by a cofactor takes a greatest common divisor.

use crate::numerator::{Numerator, OddPrime, Scalar};
use num_bigint::{BigInt, BigUint};
use num_integer::Integer;
use num_traits::{One, ToPrimitive};
use smallvec::SmallVec;

/// Trial division goes this far; what remains below its square is prime.
const TRIAL: u64 = 1024;

/// The odd primes and cofactors met so far.
#[derive(Clone, Debug, Default)]
pub(crate) struct Factors {
    primes: Vec<OddPrime>,
    cofactors: Vec<BigUint>,
}

/// A positive integer by its exponents; lists end with a non-zero entry or are empty.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Denominator {
    two: u32,
    odd: SmallVec<[u32; 6]>,
    cofactors: SmallVec<[u32; 2]>,
}

impl Denominator {
    /// self * other^times. Exponents saturate; whoever goes that far is refused for the size of the numbers.
    pub(crate) fn multiply(&mut self, other: &Self, times: u32) {
        self.two = self.two.saturating_add(other.two.saturating_mul(times));
        let combine = |into: &mut [u32], from: &[u32]| {
            for (into, from) in into.iter_mut().zip(from) {
                *into = into.saturating_add(from.saturating_mul(times));
            }
        };
        if self.odd.len() < other.odd.len() {
            self.odd.resize(other.odd.len(), 0);
        }
        combine(&mut self.odd, &other.odd);
        if self.cofactors.len() < other.cofactors.len() {
            self.cofactors.resize(other.cofactors.len(), 0);
        }
        combine(&mut self.cofactors, &other.cofactors);
    }

    /// A common multiple of both.
    pub(crate) fn join(&mut self, other: &Self) {
        self.two = self.two.max(other.two);
        let join = |into: &mut [u32], from: &[u32]| {
            for (into, from) in into.iter_mut().zip(from) {
                *into = (*into).max(*from);
            }
        };
        if self.odd.len() < other.odd.len() {
            self.odd.resize(other.odd.len(), 0);
        }
        join(&mut self.odd, &other.odd);
        if self.cofactors.len() < other.cofactors.len() {
            self.cofactors.resize(other.cofactors.len(), 0);
        }
        join(&mut self.cofactors, &other.cofactors);
    }
}

impl Factors {
    /// The factored form of a positive integer.
    pub(crate) fn factor(&mut self, value: &BigUint) -> Denominator {
        let Some(small) = value.to_u64() else { return self.factor_big(value) };
        self.factor_word(small)
    }

    /// The factored form of a positive word.
    pub(crate) fn factor_word(&mut self, value: u64) -> Denominator {
        let mut result = Denominator { two: value.trailing_zeros(), ..Denominator::default() };
        let mut rest = value >> result.two;
        for index in 0..self.primes.len() {
            let prime = self.primes[index].value;
            while rest.is_multiple_of(prime) {
                rest /= prime;
                self.count(&mut result, index);
            }
        }
        let mut trial = 3;
        while rest > 1 && trial < TRIAL {
            if trial * trial > rest {
                trial = rest;
            }
            if rest.is_multiple_of(trial) {
                let index = self.prime(trial);
                while rest.is_multiple_of(trial) {
                    rest /= trial;
                    self.count(&mut result, index);
                }
            }
            trial += 2;
        }
        if rest > 1 {
            if rest < TRIAL * TRIAL {
                let index = self.prime(rest);
                self.count(&mut result, index);
            } else {
                self.cofactor(&mut result, BigUint::from(rest));
            }
        }
        result
    }

    fn factor_big(&mut self, value: &BigUint) -> Denominator {
        let two = u32::try_from(value.trailing_zeros().unwrap_or(0)).expect("invariant: exponents fit");
        let mut result = Denominator { two, ..Denominator::default() };
        let mut rest = value >> two;
        // A composite trial number never divides: its own primes have been taken out before.
        for trial in (3..TRIAL).step_by(2) {
            while (&rest % trial).to_u64() == Some(0) {
                rest /= trial;
                let index = self.prime(trial);
                self.count(&mut result, index);
            }
        }
        if rest < BigUint::from(TRIAL * TRIAL) {
            let small = self.factor_word(rest.to_u64().expect("invariant: compared just before"));
            result.multiply(&small, 1);
        } else {
            self.cofactor(&mut result, rest);
        }
        result
    }

    fn prime(&mut self, value: u64) -> usize {
        self.primes.iter().position(|prime| prime.value == value).unwrap_or_else(|| {
            self.primes.push(OddPrime::new(value));
            self.primes.len() - 1
        })
    }

    fn count(&self, result: &mut Denominator, index: usize) {
        if result.odd.len() <= index {
            result.odd.resize(index + 1, 0);
        }
        result.odd[index] += 1;
    }

    fn cofactor(&mut self, result: &mut Denominator, value: BigUint) {
        let index = self.cofactors.iter().position(|present| *present == value).unwrap_or_else(|| {
            self.cofactors.push(value);
            self.cofactors.len() - 1
        });
        if result.cofactors.len() <= index {
            result.cofactors.resize(index + 1, 0);
        }
        result.cofactors[index] += 1;
    }

    /// An upper bound of the bit length.
    pub(crate) fn bits(&self, denominator: &Denominator) -> u64 {
        let odd = denominator.odd.iter().zip(&self.primes).map(|(&e, prime)| f64::from(e) * prime.log2);
        let cofactors = denominator.cofactors.iter().zip(&self.cofactors).map(|(&e, c)| f64::from(e) * c.bits() as f64);
        // The added part exceeds the rounding of the sum by far.
        let logarithm = odd.chain(cofactors).sum::<f64>() * (1.0 + 1e-12) + 1e-9;
        u64::from(denominator.two) + logarithm.floor() as u64 + 1
    }

    /// multiple / denominator, for a multiple made by [`Denominator::join`].
    pub(crate) fn quotient(&self, multiple: &Denominator, denominator: &Denominator) -> Scalar {
        if multiple == denominator {
            return Scalar::ONE;
        }
        let at = |list: &[u32], i: usize| list.get(i).copied().unwrap_or(0);
        let mut small = Some(1i64);
        let mut factor = |value: u64| {
            small = small.and_then(|small| small.checked_mul(i64::try_from(value).ok()?));
        };
        let two = multiple.two - denominator.two;
        if two < 63 {
            factor(1 << two)
        } else {
            factor(u64::MAX)
        }
        for (i, &e) in multiple.odd.iter().enumerate() {
            self.primes[i].power_factors(e - at(&denominator.odd, i)).for_each(&mut factor);
        }
        if multiple.cofactors == denominator.cofactors
            && let Some(value) = small
        {
            return Scalar::Small(value);
        }
        let mut value = BigUint::one() << two;
        for (i, &e) in multiple.odd.iter().enumerate() {
            value *= BigUint::from(self.primes[i].value).pow(e - at(&denominator.odd, i));
        }
        for (i, &e) in multiple.cofactors.iter().enumerate() {
            value *= self.cofactors[i].pow(e - at(&denominator.cofactors, i));
        }
        Scalar::from_big(&BigInt::from(value))
    }

    /// Prepares the reduction of many fractions over the same denominator.
    pub(crate) fn reduction(&self, denominator: &Denominator) -> Reduction<'_> {
        let odd = denominator.odd.iter().zip(&self.primes).filter(|(e, _)| **e > 0).map(|(&e, prime)| (prime, e));
        let cofactor = denominator.cofactors.iter().zip(&self.cofactors).filter(|(e, _)| **e > 0);
        let cofactor = cofactor.map(|(&e, c)| c.pow(e)).reduce(|a, b| a * b);
        let bits = self.bits(denominator);
        Reduction { two: denominator.two, odd: odd.collect(), cofactor, bits }
    }
}

/// A denominator, ready to reduce fractions.
pub(crate) struct Reduction<'a> {
    two: u32,
    odd: SmallVec<[(&'a OddPrime, u32); 6]>,
    cofactor: Option<BigUint>,
    bits: u64,
}

impl Reduction<'_> {
    /// Number of words that hold every reduced denominator.
    pub(crate) fn words(&self) -> usize {
        self.bits.div_ceil(64) as usize
    }

    /// Whether the denominator is even.
    pub(crate) fn is_even(&self) -> bool {
        self.two > 0
    }

    /// Appends `numerator / (denominator / 2^halvings)` in lowest terms: `words` words of the numerator in two's
    /// complement, then [`Self::words`] of the positive denominator. The numerator is not zero; the denominator is even
    /// when `halvings` is 1.
    pub(crate) fn push<T: Numerator>(&self, numerator: &T, halvings: u32, words: usize, out: &mut Vec<u64>) {
        if self.cofactor.is_some() {
            return self.push_with_cofactor(&numerator.to_big(), halvings, words, out);
        }
        let negative = numerator.is_negative();
        let two = self.two - halvings;
        let magnitude = if negative { numerator.negated() } else { numerator.clone() };
        let shift = magnitude.trailing_zeros().min(two);
        let mut magnitude = if shift > 0 { magnitude.shifted_right(shift) } else { magnitude };
        let two = two - shift;
        let signed = |magnitude: T| if negative { magnitude.negated() } else { magnitude };
        if self.bits <= 128 {
            let mut denominator = 1u128;
            for (prime, exponent) in &self.odd {
                let mut exponent = *exponent;
                while exponent > 0
                    && let Some(quotient) = magnitude.divided_exactly(prime)
                {
                    magnitude = quotient;
                    exponent -= 1;
                }
                for factor in prime.power_factors(exponent) {
                    denominator *= u128::from(factor);
                }
            }
            denominator <<= two;
            signed(magnitude).push_words(words, out);
            out.push(denominator as u64);
            if self.words() == 2 {
                out.push((denominator >> 64) as u64);
            }
            return;
        }
        // The denominator is written behind the numerator, whose final value is known only after the division.
        let mut exponents: SmallVec<[u32; 6]> = SmallVec::new();
        for (prime, exponent) in &self.odd {
            let mut exponent = *exponent;
            while exponent > 0
                && let Some(quotient) = magnitude.divided_exactly(prime)
            {
                magnitude = quotient;
                exponent -= 1;
            }
            exponents.push(exponent);
        }
        signed(magnitude).push_words(words, out);
        let start = out.len();
        out.resize(start + self.words(), 0);
        let denominator = &mut out[start..];
        // 2^two first, so that only the words above it are multiplied.
        let low = (two / 64) as usize;
        denominator[low] = 1 << (two % 64);
        let mut top = low + 1;
        for ((prime, _), exponent) in self.odd.iter().zip(exponents) {
            for factor in prime.power_factors(exponent) {
                let mut carry = 0u128;
                for word in &mut denominator[low..top] {
                    let product = u128::from(*word) * u128::from(factor) + carry;
                    *word = product as u64;
                    carry = product >> 64;
                }
                if carry > 0 {
                    denominator[top] = carry as u64;
                    top += 1;
                }
            }
        }
    }

    fn push_with_cofactor(&self, numerator: &BigInt, halvings: u32, words: usize, out: &mut Vec<u64>) {
        let mut denominator = BigUint::one() << (self.two - halvings);
        for (prime, exponent) in &self.odd {
            denominator *= BigUint::from(prime.value).pow(*exponent);
        }
        if let Some(cofactor) = &self.cofactor {
            denominator *= cofactor;
        }
        let common = numerator.magnitude().gcd(&denominator);
        (numerator / BigInt::from(common.clone())).push_words(words, out);
        let start = out.len();
        out.extend((denominator / common).iter_u64_digits());
        out.resize(start + self.words(), 0);
    }
}
