//! Integers of fixed width for numerators, and the big integer for values beyond these widths.
//!
//! Invariant: the caller of an operation has established a bound by which the result needs at most [`Numerator::BITS`]
//! bits, so that the fixed widths never wrap. The one-word and two-word types are the machine's own, and are checked in
//! builds with debug assertions.

use crate::number::prime::OddPrime;
use crate::number::words::{big_from_words, write_unsigned};
use num_bigint::{BigInt, Sign};
use num_traits::{Signed, Zero};
use std::ops::{Add, Sub};

/// An integer of some width.
pub(crate) trait Numerator: Clone {
    /// Values of magnitude below 2^BITS are represented.
    const BITS: u64;
    fn zero() -> Self;
    fn is_zero(&self) -> bool;
    fn is_negative(&self) -> bool;
    /// The integer of all the given little-endian words in two's complement.
    fn from_words(words: &[u64]) -> Self;
    /// Fills `out` with the low words of the two's complement.
    fn write_words(&self, out: &mut [u64]);
    fn plus(&self, other: &Self) -> Self;
    fn minus(&self, other: &Self) -> Self;
    fn times(&self, factor: i64) -> Self;
    fn negated(&self) -> Self;
    /// The bit length of the largest magnitude.
    fn bit_length(values: &[Self]) -> u64;
    /// Number of trailing zero bits; the value is not zero.
    fn trailing_zeros(&self) -> u32;
    /// The value divided by 2^count, which must divide it.
    fn shifted_right(&self, count: u32) -> Self;
    /// The quotient of the non-negative `self` by the prime, when the prime divides it.
    fn divided_exactly(&self, prime: &OddPrime) -> Option<Self>;
    /// The value as a machine word, for the width of one word only.
    fn as_word(&self) -> Option<i64>;
    /// The value as a big integer.
    fn to_big(&self) -> BigInt;
}

impl Numerator for i64 {
    const BITS: u64 = 63;

    fn zero() -> Self {
        0
    }

    #[inline]
    fn is_zero(&self) -> bool {
        *self == 0
    }

    #[inline]
    fn is_negative(&self) -> bool {
        *self < 0
    }

    fn from_words(words: &[u64]) -> Self {
        words.first().map_or(0, |&word| word as i64)
    }

    #[inline]
    fn write_words(&self, out: &mut [u64]) {
        for (i, slot) in out.iter_mut().enumerate() {
            *slot = if i == 0 { *self as u64 } else { (*self >> 63) as u64 };
        }
    }

    #[inline]
    fn plus(&self, other: &Self) -> Self {
        self + other
    }

    #[inline]
    fn minus(&self, other: &Self) -> Self {
        self - other
    }

    #[inline]
    fn times(&self, factor: i64) -> Self {
        self * factor
    }

    #[inline]
    fn negated(&self) -> Self {
        -self
    }

    fn bit_length(values: &[Self]) -> u64 {
        let mask = values.iter().fold(0u64, |mask, value| mask | value.unsigned_abs());
        u64::from(64 - mask.leading_zeros())
    }

    #[inline]
    fn trailing_zeros(&self) -> u32 {
        Self::trailing_zeros(*self)
    }

    #[inline]
    fn shifted_right(&self, count: u32) -> Self {
        self >> count
    }

    #[inline]
    fn divided_exactly(&self, prime: &OddPrime) -> Option<Self> {
        prime.divide_exactly(*self as u64).map(|quotient| quotient as i64)
    }

    #[inline]
    fn as_word(&self) -> Option<i64> {
        Some(*self)
    }

    fn to_big(&self) -> BigInt {
        BigInt::from(*self)
    }
}

impl Numerator for i128 {
    const BITS: u64 = 127;

    fn zero() -> Self {
        0
    }

    #[inline]
    fn is_zero(&self) -> bool {
        *self == 0
    }

    #[inline]
    fn is_negative(&self) -> bool {
        *self < 0
    }

    fn from_words(words: &[u64]) -> Self {
        match words {
            [] => 0,
            [low] => Self::from(*low as i64),
            [low, high, ..] => (u128::from(*low) | u128::from(*high) << 64) as Self,
        }
    }

    #[inline]
    fn write_words(&self, out: &mut [u64]) {
        for (i, slot) in out.iter_mut().enumerate() {
            *slot = match i {
                0 => *self as u64,
                1 => (*self >> 64) as u64,
                _ => (*self >> 127) as u64,
            };
        }
    }

    #[inline]
    fn plus(&self, other: &Self) -> Self {
        self + other
    }

    #[inline]
    fn minus(&self, other: &Self) -> Self {
        self - other
    }

    #[inline]
    fn times(&self, factor: i64) -> Self {
        // The debug build checks the bound. The product modulo 2^128 takes three word multiplications.
        debug_assert!(self.checked_mul(Self::from(factor)).is_some(), "invariant: the bound keeps products in range");
        self.wrapping_mul(Self::from(factor))
    }

    #[inline]
    fn negated(&self) -> Self {
        -self
    }

    fn bit_length(values: &[Self]) -> u64 {
        let mask = values.iter().fold(0u128, |mask, value| mask | value.unsigned_abs());
        u64::from(128 - mask.leading_zeros())
    }

    #[inline]
    fn trailing_zeros(&self) -> u32 {
        Self::trailing_zeros(*self)
    }

    #[inline]
    fn shifted_right(&self, count: u32) -> Self {
        self >> count
    }

    #[inline]
    fn divided_exactly(&self, prime: &OddPrime) -> Option<Self> {
        let quotient = (*self as u128).wrapping_mul(prime.inverse_wide);
        (quotient <= prime.largest_wide).then_some(quotient as Self)
    }

    #[inline]
    fn as_word(&self) -> Option<i64> {
        None
    }

    fn to_big(&self) -> BigInt {
        BigInt::from(*self)
    }
}

impl Numerator for BigInt {
    const BITS: u64 = u64::MAX;

    fn zero() -> Self {
        Zero::zero()
    }

    #[inline]
    fn is_zero(&self) -> bool {
        Zero::is_zero(self)
    }

    #[inline]
    fn is_negative(&self) -> bool {
        Signed::is_negative(self)
    }

    fn from_words(words: &[u64]) -> Self {
        big_from_words(words)
    }

    #[inline]
    fn write_words(&self, out: &mut [u64]) {
        write_unsigned(self.magnitude(), out);
        if self.sign() == Sign::Minus {
            let mut carry = true;
            for word in out {
                (*word, carry) = (!*word).overflowing_add(u64::from(carry));
            }
        }
    }

    #[inline]
    fn plus(&self, other: &Self) -> Self {
        self.add(other)
    }

    #[inline]
    fn minus(&self, other: &Self) -> Self {
        self.sub(other)
    }

    #[inline]
    fn times(&self, factor: i64) -> Self {
        self * factor
    }

    #[inline]
    fn negated(&self) -> Self {
        -self
    }

    fn bit_length(values: &[Self]) -> u64 {
        values.iter().map(Self::bits).max().unwrap_or(0)
    }

    #[inline]
    fn trailing_zeros(&self) -> u32 {
        u32::try_from(Self::trailing_zeros(self).unwrap_or(0)).unwrap_or(u32::MAX)
    }

    #[inline]
    fn shifted_right(&self, count: u32) -> Self {
        self >> count
    }

    #[inline]
    fn divided_exactly(&self, prime: &OddPrime) -> Option<Self> {
        Zero::is_zero(&(self % prime.value)).then(|| self / prime.value)
    }

    fn as_word(&self) -> Option<i64> {
        None
    }

    fn to_big(&self) -> BigInt {
        self.clone()
    }
}
