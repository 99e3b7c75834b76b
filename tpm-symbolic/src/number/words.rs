//! Conversion of big integers to and from little-endian words.

use num_bigint::{BigInt, BigUint, Sign};

/// Fills `out` with the words of a non-negative integer; `out` is long enough for it.
pub(crate) fn write_unsigned(value: &BigUint, out: &mut [u64]) {
    let mut digits = value.iter_u64_digits();
    out.iter_mut().for_each(|slot| *slot = digits.next().unwrap_or(0));
    debug_assert!(digits.next().is_none(), "invariant: the bound keeps the number of words");
}

/// The integer of little-endian words in two's complement.
pub(crate) fn big_from_words(words: &[u64]) -> BigInt {
    let negative = words.last().is_some_and(|word| word >> 63 == 1);
    if !negative {
        return BigInt::from(unsigned_from_words(words));
    }
    let mut carry = true;
    let magnitude: Vec<u64> = words
        .iter()
        .map(|&word| {
            let (word, over) = (!word).overflowing_add(u64::from(carry));
            carry = over;
            word
        })
        .collect();
    BigInt::from_biguint(Sign::Minus, unsigned_from_words(&magnitude))
}

/// The non-negative integer of little-endian words.
pub(crate) fn unsigned_from_words(words: &[u64]) -> BigUint {
    match words {
        [low] => BigUint::from(*low),
        [low, high] => BigUint::from(u128::from(*low) | u128::from(*high) << 64),
        _ => BigUint::new(words.iter().flat_map(|&word| [word as u32, (word >> 32) as u32]).collect()),
    }
}
