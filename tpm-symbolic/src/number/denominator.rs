//! Denominators in factored form, and reduction of fractions by the known prime factors.
//!
//! Invariant: a [`Denominator`] is the product of 2^two, the powers of the [`Factors`]' odd primes, and the powers of
//! its cofactors, which are products of primes beyond [`TRIAL`] that trial division did not find. The cofactors need
//! not be coprime: the exponents then describe a common multiple that may be larger than the least one, and reduction
//! by a cofactor requires a greatest common divisor.

use crate::budget;
use crate::number::numerator::Numerator;
use crate::number::prime::OddPrime;
use crate::number::scalar::Scalar;
use crate::number::words::write_unsigned;
use num_bigint::{BigInt, BigUint};
use num_integer::Integer;
use num_traits::{One, ToPrimitive};
use smallvec::SmallVec;

/// Upper bound of trial divisors; a remainder below the square of the bound is prime.
const TRIAL: u64 = 1024;

/// Operations for creating a big integer, for the budget.
const NEW_INTEGER: u64 = 48;
/// Operations for dividing one word of a big integer, for the budget.
const DIVIDED_WORD: u64 = 12;

/// The odd primes and cofactors found so far.
#[derive(Clone, Debug, Default)]
pub(crate) struct Factors {
    /// The primes beyond [`OddPrime::SMALL`], whose primes come first in the numbering.
    primes: Vec<OddPrime>,
    cofactors: Vec<BigUint>,
}

static SMALL: [OddPrime; 9] = OddPrime::SMALL;

/// A positive integer by its exponents.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Denominator {
    two: u32,
    /// The exponents of the first odd primes.
    odd: [u32; FIRST],
    /// The exponents of all other factors, when there are any: most denominators are copied and multiplied without
    /// them.
    rare: Option<Box<Rare>>,
}

/// The number of odd primes whose exponents are stored without an allocation.
const FIRST: usize = 8;

/// Exponents of rare factors. A list is empty or ends with a non-zero entry, and at least one list is not empty.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Rare {
    /// The exponents of the odd primes after the first [`FIRST`].
    more: Vec<u32>,
    cofactors: Vec<u32>,
}

/// into[i] = combine(into[i], from[i]), with missing entries as 0.
fn combine(into: &mut Vec<u32>, from: &[u32], combine: impl Fn(u32, u32) -> u32) {
    if into.len() < from.len() {
        into.resize(from.len(), 0);
    }
    into.iter_mut().zip(from).for_each(|(into, &from)| *into = combine(*into, from));
}

impl Denominator {
    /// self * other^times. Exponents saturate; an expansion with such exponents is refused for the size of its numbers.
    pub(crate) fn multiply(&mut self, other: &Self, times: u32) {
        let raise = |into: u32, from: u32| into.saturating_add(from.saturating_mul(times));
        self.two = raise(self.two, other.two);
        self.odd.iter_mut().zip(other.odd).for_each(|(into, from)| *into = raise(*into, from));
        if let Some(other) = &other.rare {
            let rare = self.rare.get_or_insert_default();
            combine(&mut rare.more, &other.more, raise);
            combine(&mut rare.cofactors, &other.cofactors, raise);
        }
    }

    /// self = a * b, for exponents whose sums are known to fit.
    #[inline]
    pub(crate) fn set_product(&mut self, a: &Self, b: &Self) {
        self.two = a.two + b.two;
        for (into, (a, b)) in self.odd.iter_mut().zip(a.odd.iter().zip(b.odd)) {
            *into = a + b;
        }
        if self.rare.is_some() || a.rare.is_some() || b.rare.is_some() {
            self.rare.clone_from(&a.rare);
            if let Some(other) = &b.rare {
                let rare = self.rare.get_or_insert_default();
                combine(&mut rare.more, &other.more, |into, from| into + from);
                combine(&mut rare.cofactors, &other.cofactors, |into, from| into + from);
            }
        }
    }

    /// self *= 2.
    pub(crate) fn double(&mut self) {
        self.two += 1;
    }

    /// Divides by 2 as often as possible, at most `most` times, and returns how often.
    pub(crate) fn halve(&mut self, most: u32) -> u32 {
        let times = self.two.min(most);
        self.two -= times;
        times
    }

    /// A common multiple of both.
    pub(crate) fn join(&mut self, other: &Self) {
        self.two = self.two.max(other.two);
        self.odd.iter_mut().zip(other.odd).for_each(|(into, from)| *into = (*into).max(from));
        if let Some(other) = &other.rare {
            let rare = self.rare.get_or_insert_default();
            combine(&mut rare.more, &other.more, u32::max);
            combine(&mut rare.cofactors, &other.cofactors, u32::max);
        }
    }

    fn more(&self) -> &[u32] {
        self.rare.as_ref().map_or(&[], |rare| rare.more.as_slice())
    }

    fn cofactors(&self) -> &[u32] {
        self.rare.as_ref().map_or(&[], |rare| rare.cofactors.as_slice())
    }

    /// Calls `each` with the index and the exponent of every prime whose exponent is not 0.
    #[inline]
    fn primes(&self, mut each: impl FnMut(usize, u32)) {
        for (index, &exponent) in self.odd.iter().enumerate() {
            if exponent > 0 {
                each(index, exponent);
            }
        }
        if let Some(rare) = &self.rare {
            for (index, &exponent) in rare.more.iter().enumerate().filter(|(_, exponent)| **exponent > 0) {
                each(FIRST + index, exponent);
            }
        }
    }

    fn exponent(&self, prime: usize) -> u32 {
        let more = || self.more().get(prime - FIRST).copied().unwrap_or(0);
        self.odd.get(prime).copied().unwrap_or_else(more)
    }

    fn count(&mut self, prime: usize) {
        match self.odd.get_mut(prime) {
            Some(exponent) => *exponent += 1,
            None => {
                let index = prime - FIRST;
                let more = &mut self.rare.get_or_insert_default().more;
                more.resize(more.len().max(index + 1), 0);
                more[index] += 1;
            }
        }
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
        for index in 0..SMALL.len() + self.primes.len() {
            if rest == 1 {
                break;
            }
            while let Some(quotient) = self.known(index).divide_exactly(rest) {
                rest = quotient;
                result.count(index);
            }
        }
        let mut trial = 31;
        while rest > 1 && trial < TRIAL {
            if trial * trial > rest {
                trial = rest;
            }
            if rest.is_multiple_of(trial) {
                let index = self.prime(trial);
                while rest.is_multiple_of(trial) {
                    rest /= trial;
                    result.count(index);
                }
            }
            trial += 2;
        }
        if rest > 1 {
            if rest < TRIAL * TRIAL {
                let index = self.prime(rest);
                result.count(index);
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
        // A composite trial divisor never divides, since its prime factors were divided out before.
        for trial in (3..TRIAL).step_by(2) {
            while (&rest % trial).to_u64() == Some(0) {
                rest /= trial;
                let index = self.prime(trial);
                result.count(index);
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

    fn known(&self, index: usize) -> &OddPrime {
        SMALL.get(index).unwrap_or_else(|| &self.primes[index - SMALL.len()])
    }

    fn prime(&mut self, value: u64) -> usize {
        let mut known = SMALL.iter().chain(&self.primes);
        known.position(|prime| prime.value == value).unwrap_or_else(|| {
            self.primes.push(OddPrime::new(value));
            SMALL.len() + self.primes.len() - 1
        })
    }

    fn cofactor(&mut self, result: &mut Denominator, value: BigUint) {
        let index = self.cofactors.iter().position(|present| *present == value).unwrap_or_else(|| {
            self.cofactors.push(value);
            self.cofactors.len() - 1
        });
        let cofactors = &mut result.rare.get_or_insert_default().cofactors;
        cofactors.resize(cofactors.len().max(index + 1), 0);
        cofactors[index] += 1;
    }

    /// An upper bound of the bit length.
    pub(crate) fn bits(&self, denominator: &Denominator) -> u64 {
        // In units of 2^-20; the product of 32 bits of exponent and 36 bits of the logarithm could exceed one word.
        let mut logarithm = 0u128;
        denominator.primes(|prime, e| logarithm += u128::from(self.known(prime).log2) * u128::from(e));
        for (&e, cofactor) in denominator.cofactors().iter().zip(&self.cofactors) {
            logarithm += (u128::from(e) * u128::from(cofactor.bits())) << 20;
        }
        u64::from(denominator.two) + (logarithm >> 20) as u64 + 1
    }

    /// multiple / denominator, for a multiple made by [`Denominator::join`].
    pub(crate) fn quotient(&self, multiple: &Denominator, denominator: &Denominator) -> Scalar {
        if multiple == denominator {
            return Scalar::ONE;
        }
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
        multiple.primes(|i, e| self.known(i).power_factors(e - denominator.exponent(i)).for_each(&mut factor));
        if multiple.cofactors() == denominator.cofactors()
            && let Some(value) = small
        {
            return Scalar::Small(value);
        }
        let mut value = BigUint::one() << two;
        multiple.primes(|i, e| value *= BigUint::from(self.known(i).value).pow(e - denominator.exponent(i)));
        for (i, &e) in multiple.cofactors().iter().enumerate() {
            value *= self.cofactors[i].pow(e - denominator.cofactors().get(i).copied().unwrap_or(0));
        }
        Scalar::from_big(&BigInt::from(value))
    }

    /// Divides by every odd prime as often as the denominator contains it and `divide` reports that the numerators were
    /// divided by it too. Cofactors are unchanged.
    pub(crate) fn reduce(&self, denominator: &mut Denominator, mut divide: impl FnMut(&OddPrime) -> bool) {
        let mut by = |index: usize, exponent: &mut u32| {
            while *exponent > 0 && divide(self.known(index)) {
                *exponent -= 1;
            }
        };
        for (index, exponent) in denominator.odd.iter_mut().enumerate() {
            if *exponent > 0 {
                by(index, exponent);
            }
        }
        if let Some(rare) = &mut denominator.rare {
            rare.more.iter_mut().enumerate().for_each(|(index, exponent)| by(FIRST + index, exponent));
            let kept = rare.more.iter().rposition(|exponent| *exponent > 0).map_or(0, |last| last + 1);
            rare.more.truncate(kept);
            if rare.more.is_empty() && rare.cofactors.is_empty() {
                denominator.rare = None;
            }
        }
    }

    /// Prepares the reduction of many fractions over the same denominator.
    pub(crate) fn reduction(&self, denominator: &Denominator) -> Reduction<'_> {
        let mut odd: SmallVec<[(&OddPrime, u32); 4]> = SmallVec::new();
        let mut product = Some(1u128);
        denominator.primes(|prime, exponent| {
            let prime = self.known(prime);
            odd.push((prime, exponent));
            product = prime.power_factors(exponent).fold(product, |product, f| product?.checked_mul(u128::from(f)));
        });
        let mut cofactor: Option<BigUint> = None;
        if denominator.rare.is_some() {
            let powers = denominator.cofactors().iter().zip(&self.cofactors).filter(|(e, _)| **e > 0);
            cofactor = powers.map(|(&e, c)| c.pow(e)).reduce(|a, b| a * b);
        }
        let exact = product.filter(|_| cofactor.is_none()).map(|product| {
            let bits = u64::from(denominator.two) + u64::from(128 - product.leading_zeros());
            (product, bits)
        });
        let (product, bits) = exact.filter(|(_, bits)| *bits <= 128).unwrap_or_else(|| (1, self.bits(denominator)));
        Reduction { two: denominator.two, odd, cofactor, words: bits.div_ceil(64) as usize, product }
    }
}

/// A denominator, prepared for the reduction of many fractions.
pub(crate) struct Reduction<'a> {
    two: u32,
    odd: SmallVec<[(&'a OddPrime, u32); 4]>,
    cofactor: Option<BigUint>,
    words: usize,
    /// The product of the odd primes' powers, when the whole denominator fits two words.
    product: u128,
}

impl Reduction<'_> {
    /// Number of words that hold every reduced denominator.
    pub(crate) fn words(&self) -> usize {
        self.words
    }

    /// Whether the denominator is even.
    pub(crate) fn is_even(&self) -> bool {
        self.two > 0
    }

    /// Writes `numerator / (denominator / 2^halvings)` in lowest terms: the numerator's words in two's complement, then
    /// [`Self::words`] of the positive denominator. The numerator is not zero; the denominator is even when `halvings`
    /// is 1.
    #[inline(always)]
    pub(crate) fn write<T: Numerator>(&self, numerator: &T, halvings: u32, out: &mut [u64]) {
        let (above, below) = out.split_at_mut(out.len() - self.words);
        if self.cofactor.is_some() {
            return self.write_with_cofactor(&numerator.to_big(), halvings, above, below);
        }
        if let ([below], Some(word)) = (&mut *below, numerator.as_word()) {
            return self.write_word(word, self.two - halvings, above, below);
        }
        self.write_wide(numerator, self.two - halvings, above, below);
    }

    /// [`Self::write`] for numbers of one word; `two` is the denominator's exponent.
    #[inline]
    fn write_word(&self, numerator: i64, two: u32, above: &mut [u64], below: &mut u64) {
        let mut magnitude = numerator.unsigned_abs();
        let shift = magnitude.trailing_zeros().min(two);
        magnitude >>= shift;
        let mut product = self.product as u64;
        for (prime, exponent) in self.odd.as_slice() {
            for _ in 0..*exponent {
                let Some(quotient) = prime.divide_exactly(magnitude) else { break };
                magnitude = quotient;
                product = prime.divide_word(product);
            }
        }
        *below = product << (two - shift);
        if let Some((first, rest)) = above.split_first_mut() {
            *first = if numerator < 0 { magnitude.wrapping_neg() } else { magnitude };
            if !rest.is_empty() {
                rest.fill((numerator >> 63) as u64);
            }
        }
    }

    /// [`Self::write`] for all other numbers.
    #[inline(never)]
    fn write_wide<T: Numerator>(&self, numerator: &T, two: u32, above: &mut [u64], below: &mut [u64]) {
        let negative = numerator.is_negative();
        let magnitude = if negative { numerator.negated() } else { numerator.clone() };
        let shift = magnitude.trailing_zeros().min(two);
        let mut magnitude = if shift > 0 { magnitude.shifted_right(shift) } else { magnitude };
        let two = two - shift;
        // The remaining denominator, in the number of words reserved for it.
        match below {
            [below] => {
                let mut product = self.product as u64;
                for (prime, exponent) in &self.odd {
                    self.divide(&mut magnitude, prime, *exponent, || product = prime.divide_word(product));
                }
                *below = product << two;
            }
            [low, high] => {
                let mut product = self.product;
                for (prime, exponent) in &self.odd {
                    self.divide(&mut magnitude, prime, *exponent, || product = prime.divide_multiple(product));
                }
                product <<= two;
                (*low, *high) = (product as u64, (product >> 64) as u64);
            }
            _ => self.write_long(&mut magnitude, two, below),
        }
        if negative { magnitude.negated().write_words(above) } else { magnitude.write_words(above) }
    }

    /// Divides by the prime as often as possible, at most `exponent` times, and calls `each` after every division.
    #[inline]
    fn divide<T: Numerator>(&self, magnitude: &mut T, prime: &OddPrime, exponent: u32, mut each: impl FnMut()) {
        for _ in 0..exponent {
            // Each division of a big integer allocates a new one, which the charge for all values does not cover.
            if T::BITS == u64::MAX {
                let words = T::bit_length(std::slice::from_ref(magnitude)) / 64 + 1;
                budget::charge(NEW_INTEGER + DIVIDED_WORD * words);
            }
            let Some(quotient) = magnitude.divided_exactly(prime) else { break };
            *magnitude = quotient;
            each();
        }
    }

    /// Writes a denominator of more than two words: 2^two first, then the other factors.
    fn write_long<T: Numerator>(&self, magnitude: &mut T, two: u32, below: &mut [u64]) {
        let low = (two / 64) as usize;
        below.fill(0);
        below[low] = 1 << (two % 64);
        let mut top = low + 1;
        for (prime, exponent) in &self.odd {
            let mut exponent = *exponent;
            self.divide(magnitude, prime, exponent, || exponent -= 1);
            for factor in prime.power_factors(exponent) {
                let mut carry = 0u128;
                for word in &mut below[low..top] {
                    let product = u128::from(*word) * u128::from(factor) + carry;
                    *word = product as u64;
                    carry = product >> 64;
                }
                if carry > 0 {
                    below[top] = carry as u64;
                    top += 1;
                }
            }
        }
    }

    fn write_with_cofactor(&self, numerator: &BigInt, halvings: u32, above: &mut [u64], below: &mut [u64]) {
        let mut denominator = BigUint::one() << (self.two - halvings);
        for (prime, exponent) in &self.odd {
            denominator *= BigUint::from(prime.value).pow(*exponent);
        }
        if let Some(cofactor) = &self.cofactor {
            denominator *= cofactor;
        }
        let common = numerator.magnitude().gcd(&denominator);
        (numerator / BigInt::from(common.clone())).write_words(above);
        write_unsigned(&(denominator / common), below);
    }
}
