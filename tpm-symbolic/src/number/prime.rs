//! Odd primes, and exact division by them without a division.
//!
//! n / p = n * (1/p) modulo 2^64 when p divides n, and the product is then at most (2^64 - 1) / p; for any other n it is larger.

/// An odd prime with the constants for division by multiplication.
#[derive(Clone, Debug)]
pub(crate) struct OddPrime {
    /// The prime.
    pub(crate) value: u64,
    /// 1/value modulo 2^64.
    pub(super) inverse: u64,
    /// 1/value modulo 2^128.
    pub(super) inverse_wide: u128,
    /// Largest quotient of a word by the prime; `largest_wide` is that of two words.
    largest: u64,
    pub(super) largest_wide: u128,
    /// The binary logarithm in units of 2^-20, rounded up.
    pub(crate) log2: u64,
    /// The powers value^0, value^1, ... that fit one word, `count` of them.
    powers: [u64; 41],
    count: usize,
}

impl OddPrime {
    /// The primes of nearly all denominators, computed at compile time.
    pub(crate) const SMALL: [Self; 9] = [
        Self::with_logarithm(3, 1.584962500721156),
        Self::with_logarithm(5, 2.321928094887362),
        Self::with_logarithm(7, 2.807354922057604),
        Self::with_logarithm(11, 3.4594316186372973),
        Self::with_logarithm(13, 3.700439718141092),
        Self::with_logarithm(17, 4.087462841250339),
        Self::with_logarithm(19, 4.247927513443585),
        Self::with_logarithm(23, 4.523561956057013),
        Self::with_logarithm(29, 4.857980995127572),
    ];

    pub(crate) fn new(value: u64) -> Self {
        Self::with_logarithm(value, (value as f64).log2())
    }

    const fn with_logarithm(value: u64, log2: f64) -> Self {
        debug_assert!(value % 2 == 1 && value > 1, "invariant: an odd prime");
        // Newton's iteration doubles the number of correct low bits; an odd number is its own inverse modulo 8.
        let wide = value as u128;
        let mut inverse_wide = wide;
        let mut i = 0;
        while i < 6 {
            inverse_wide = inverse_wide.wrapping_mul(2u128.wrapping_sub(wide.wrapping_mul(inverse_wide)));
            i += 1;
        }
        let mut powers = [1u64; 41];
        let mut count = 1;
        while count < 41
            && let Some(power) = powers[count - 1].checked_mul(value)
        {
            powers[count] = power;
            count += 1;
        }
        let (largest, largest_wide) = (u64::MAX / value, u128::MAX / wide);
        // One unit more covers the rounding of the logarithm.
        let log2 = (log2 * (1 << 20) as f64) as u64 + 1;
        Self { value, inverse: inverse_wide as u64, inverse_wide, largest, largest_wide, log2, powers, count }
    }

    /// A multiple of the prime, divided by it.
    #[inline]
    pub(crate) fn divide_multiple(&self, multiple: u128) -> u128 {
        multiple.wrapping_mul(self.inverse_wide)
    }

    /// The quotient of a word by the prime, when the prime divides it.
    #[inline]
    pub(crate) fn divide_exactly(&self, word: u64) -> Option<u64> {
        // n is divisible exactly when n/p modulo 2^64 is not above the largest possible quotient.
        let quotient = word.wrapping_mul(self.inverse);
        (quotient <= self.largest).then_some(quotient)
    }

    /// A multiple of the prime that fits one word, divided by it.
    #[inline]
    pub(crate) fn divide_word(&self, multiple: u64) -> u64 {
        multiple.wrapping_mul(self.inverse)
    }

    /// value^exponent as a product of one-word factors.
    pub(crate) fn power_factors(&self, exponent: u32) -> impl Iterator<Item = u64> + '_ {
        let most = self.count - 1;
        let mut rest = exponent as usize;
        std::iter::from_fn(move || {
            if rest == 0 {
                return None;
            }
            let part = rest.min(most);
            rest -= part;
            Some(self.powers[part])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::OddPrime;

    #[test]
    fn logarithms_of_small_primes_are_right() {
        for prime in OddPrime::SMALL {
            assert_eq!(prime.log2, ((prime.value as f64).log2() * f64::from(1 << 20)).ceil() as u64);
        }
    }
}
