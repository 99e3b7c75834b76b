//! Exponent vectors packed into machine words.
//!
//! Invariant: all keys of one [`Layout`] have fields of the same width, wide enough for every exponent that sums of the
//! keys in use can reach, so that adding keys as integers adds exponents field by field. A borrow from a negative
//! exponent runs into the next field and is undone by reading the fields from the low end. For non-negative exponents
//! the order of the keys is lexicographic, the last variable first.

use smallvec::{SmallVec, smallvec};
use std::hash::Hash;

/// Widths of the fields and numbers of words.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    /// Bits of a field: 4, 8, 16, 32 or 64.
    bits: u32,
    /// Number of variables.
    pub(crate) variables: usize,
}

impl Layout {
    /// For `variables` exponents of magnitude at most `largest`.
    pub(crate) fn new(variables: usize, largest: u64) -> Self {
        let bits = [4, 8, 16, 32].into_iter().find(|bits| largest < 1 << (bits - 1)).unwrap_or(64);
        Self { bits, variables }
    }

    /// The number of bits of a key.
    pub(crate) fn key_bits(&self) -> u64 {
        self.variables as u64 * u64::from(self.bits)
    }
}

/// A packed exponent vector.
pub(crate) trait Key: Clone + Ord {
    fn one(layout: Layout) -> Self;
    fn variable(layout: Layout, variable: usize) -> Self;
    /// self += times * other.
    fn add(&mut self, other: &Self, times: i64);
    /// Calls back with the variables, from the first, and their exponents, at least up to the last that is not zero.
    fn exponents(&self, layout: Layout, each: impl FnMut(usize, i64));
}

/// A key of one word.
pub(crate) trait ShortKey: Key + Copy + Hash {
    /// A word that compares as the lists of factors do: by the first variable that is in one of them only, a list being
    /// larger without it unless it has ended; by the exponent where both have it.
    ///
    /// The fields, the first variable's in front, are 0 once the list has ended, all ones for a variable that is left out
    /// before, and otherwise the exponent, counted from the lowest one on without the exponent 0.
    fn listed(&self, layout: Layout) -> Self;
}

macro_rules! short_key {
    ($key:ty, $signed:ty) => {
        impl Key for $key {
            fn one(_: Layout) -> Self {
                0
            }

            fn variable(layout: Layout, variable: usize) -> Self {
                1 << (layout.bits as usize * variable)
            }

            #[inline]
            fn add(&mut self, other: &Self, times: i64) {
                *self = self.wrapping_add(other.wrapping_mul(<$signed>::from(times) as Self));
            }

            #[inline]
            fn exponents(&self, layout: Layout, mut each: impl FnMut(usize, i64)) {
                let mut rest = *self;
                for variable in 0..layout.variables {
                    if rest == 0 {
                        break;
                    }
                    let field = ((rest as u64) << (64 - layout.bits)) as i64 >> (64 - layout.bits);
                    each(variable, field);
                    rest = rest.wrapping_sub(<$signed>::from(field) as Self).checked_shr(layout.bits).unwrap_or(0);
                }
            }
        }

        impl ShortKey for $key {
            fn listed(&self, layout: Layout) -> Self {
                let bits = layout.bits;
                let absent = <$key>::MAX >> (<$key>::BITS - bits);
                let (mut word, mut read, mut ended) = (0, 0, 0);
                self.exponents(layout, |_, exponent| {
                    let code = match exponent {
                        0 => absent,
                        _ => ((exponent - i64::from(exponent > 0)) as Self & absent) ^ (1 << (bits - 1)),
                    };
                    word = (word << (bits - 1) << 1) | code;
                    read += 1;
                    ended = if exponent == 0 { ended } else { read };
                });
                // What was read after the last factor goes, and the first variable's field moves to the front.
                let word = word.checked_shr(bits * (read - ended)).unwrap_or(0);
                word.checked_shl(bits * (layout.variables as u32 - ended)).unwrap_or(0)
            }
        }
    };
}
short_key!(u64, i64);
short_key!(u128, i128);

/// A key of any length; the last variables come first, so that the derived order is lexicographic.
pub(crate) type LongKey = SmallVec<[u64; 6]>;

fn place(layout: Layout, variable: usize) -> (usize, u32) {
    let per_word = (64 / layout.bits) as usize;
    let words = layout.variables.div_ceil(per_word);
    (words - 1 - variable / per_word, (variable % per_word) as u32 * layout.bits)
}

impl Key for LongKey {
    fn one(layout: Layout) -> Self {
        smallvec![0; layout.variables.div_ceil((64 / layout.bits) as usize)]
    }

    fn variable(layout: Layout, variable: usize) -> Self {
        let mut key = <Self as Key>::one(layout);
        let (word, shift) = place(layout, variable);
        key[word] = 1 << shift;
        key
    }

    fn add(&mut self, other: &Self, times: i64) {
        for (word, other) in self.iter_mut().zip(other) {
            *word = word.wrapping_add(other.wrapping_mul(times as u64));
        }
    }

    fn exponents(&self, layout: Layout, mut each: impl FnMut(usize, i64)) {
        let mut rest = 0;
        for variable in 0..layout.variables {
            let (word, shift) = place(layout, variable);
            if shift == 0 {
                rest = self[word];
            }
            let field = (rest << (64 - layout.bits)) as i64 >> (64 - layout.bits);
            each(variable, field);
            rest = rest.wrapping_sub(field as u64).checked_shr(layout.bits).unwrap_or(0);
        }
    }
}
