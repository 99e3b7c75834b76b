//! Integers of several machine words.

use crate::number::numerator::Numerator;
use crate::number::prime::OddPrime;
use crate::number::words::big_from_words;
use num_bigint::BigInt;

/// N little-endian words in two's complement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wide<const N: usize>([u64; N]);

impl<const N: usize> Wide<N> {
    fn fill(negative: bool) -> u64 {
        if negative { u64::MAX } else { 0 }
    }

    fn magnitude(&self) -> Self {
        if self.is_negative() { self.negated() } else { *self }
    }
}

impl<const N: usize> Numerator for Wide<N> {
    const BITS: u64 = 64 * N as u64 - 1;

    fn zero() -> Self {
        Self([0; N])
    }

    #[inline]
    fn is_zero(&self) -> bool {
        self.0.iter().all(|&word| word == 0)
    }

    #[inline]
    fn is_negative(&self) -> bool {
        self.0[N - 1] >> 63 == 1
    }

    fn from_words(words: &[u64]) -> Self {
        let fill = Self::fill(words.last().is_some_and(|word| word >> 63 == 1));
        Self(std::array::from_fn(|i| words.get(i).copied().unwrap_or(fill)))
    }

    #[inline]
    fn write_words(&self, out: &mut [u64]) {
        let fill = Self::fill(self.is_negative());
        for (i, slot) in out.iter_mut().enumerate() {
            *slot = self.0.get(i).copied().unwrap_or(fill);
        }
    }

    #[inline]
    fn plus(&self, other: &Self) -> Self {
        let mut carry = false;
        Self(std::array::from_fn(|i| {
            let (sum, first) = self.0[i].overflowing_add(other.0[i]);
            let (sum, second) = sum.overflowing_add(u64::from(carry));
            carry = first | second;
            sum
        }))
    }

    #[inline]
    fn minus(&self, other: &Self) -> Self {
        let mut borrow = false;
        Self(std::array::from_fn(|i| {
            let (difference, first) = self.0[i].overflowing_sub(other.0[i]);
            let (difference, second) = difference.overflowing_sub(u64::from(borrow));
            borrow = first | second;
            difference
        }))
    }

    #[inline]
    fn times(&self, factor: i64) -> Self {
        let by = u128::from(factor.unsigned_abs());
        let mut carry = 0u128;
        // Modulo 2^(64 N) the product of a two's complement and a non-negative word is the plain product.
        let product = Self(std::array::from_fn(|i| {
            let sum = u128::from(self.0[i]) * by + carry;
            carry = sum >> 64;
            sum as u64
        }));
        if factor < 0 { product.negated() } else { product }
    }

    #[inline]
    fn negated(&self) -> Self {
        Self::zero().minus(self)
    }

    fn bit_length(values: &[Self]) -> u64 {
        let mut mask = [0u64; N];
        for value in values {
            for (mask, word) in mask.iter_mut().zip(value.magnitude().0) {
                *mask |= word;
            }
        }
        let top = mask.iter().rposition(|&word| word != 0);
        top.map_or(0, |i| 64 * (i as u64 + 1) - u64::from(mask[i].leading_zeros()))
    }

    #[inline]
    fn trailing_zeros(&self) -> u32 {
        let mut count = 0;
        for word in self.0 {
            if word != 0 {
                return count + word.trailing_zeros();
            }
            count += 64;
        }
        count
    }

    #[inline]
    fn shifted_right(&self, count: u32) -> Self {
        let (words, bits) = ((count / 64) as usize, count % 64);
        let fill = Self::fill(self.is_negative());
        let word = |i: usize| self.0.get(i).copied().unwrap_or(fill);
        Self(std::array::from_fn(|i| match bits {
            0 => word(i + words),
            _ => word(i + words) >> bits | word(i + words + 1) << (64 - bits),
        }))
    }

    #[inline]
    fn divided_exactly(&self, prime: &OddPrime) -> Option<Self> {
        // Hensel division from the low end: the final borrow is zero exactly when p divides.
        let mut borrow = 0u64;
        let quotient = Self(std::array::from_fn(|i| {
            let (word, under) = self.0[i].overflowing_sub(borrow);
            let digit = word.wrapping_mul(prime.inverse);
            borrow = ((u128::from(digit) * u128::from(prime.value)) >> 64) as u64 + u64::from(under);
            digit
        }));
        (borrow == 0).then_some(quotient)
    }

    #[inline]
    fn as_word(&self) -> Option<i64> {
        None
    }

    fn to_big(&self) -> BigInt {
        big_from_words(&self.0)
    }
}
