//! Exponent vectors packed into machine words.
//!
//! Invariant: all keys of one [`Layout`] have fields of the same width, which holds every exponent in sums of the keys
//! in use, so that adding keys as integers adds exponents field by field. A negative exponent borrows from the next
//! field; reading the fields from the low end reverses the borrow. For non-negative exponents the order of the keys is
//! lexicographic, the last variable first.

use smallvec::{SmallVec, smallvec};
use std::hash::Hash;

/// The number of variables and the width of the field that holds the exponent of one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    /// Bits of a field: 4, 8, 16, 32 or 64.
    bits: u32,
    /// Number of variables.
    pub(crate) variables: usize,
}

impl Layout {
    /// The layout for `variables` exponents of magnitude at most `largest`.
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
    /// Calls `each` with every variable, from the first, and its exponent, at least up to the last non-zero exponent.
    fn exponents(&self, layout: Layout, each: impl FnMut(usize, i64));
}

/// A key of one word.
pub(crate) trait ShortKey: Key + Copy + Default + Hash {
    /// Variables whose exponent is not zero, the last one first, with their exponents.
    type Present: ExactSizeIterator<Item = (usize, i64)>;
    /// A one in every field.
    fn ones(layout: Layout) -> Self;
    /// The factors whose exponent is not zero.
    fn present(&self, layout: Layout, ones: Self) -> Self::Present;
    /// A word whose order is that of the lists of factors, the last variable's factor first. At the first variable that
    /// only one of two lists contains, the list without the variable is the larger one unless it has ended. Where both
    /// lists contain a variable, its exponents decide.
    ///
    /// A field is 0 once the list has ended, all ones for a variable that the list skips before its end, and otherwise
    /// the exponent, counted from the lowest one on without the exponent 0.
    fn listed(&self, layout: Layout, ones: Self) -> Self;
}

/// All fields of a key, unpacked together.
pub(crate) struct Fields<K> {
    /// Bits of a field.
    bits: u32,
    /// The exponents, each raised by half of what a field can hold.
    raised: K,
    /// The highest bit of the fields whose exponent is not zero.
    present: K,
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

        impl Fields<$key> {
            #[inline]
            fn of(key: $key, layout: Layout, ones: $key) -> Self {
                let high = ones << (layout.bits - 1);
                // Raised fields are not negative, so no field borrows from the next.
                let raised = key.wrapping_add(high);
                let (off, low) = (raised ^ high, high - ones);
                Self { bits: layout.bits, raised, present: (((off & low) + low) | off) & high }
            }
        }

        impl Iterator for Fields<$key> {
            type Item = (usize, i64);

            #[inline]
            fn next(&mut self) -> Option<(usize, i64)> {
                let top = self.present.checked_ilog2()?;
                self.present ^= 1 << top;
                // The width of a field is a power of two, so the mask gives the first bit of the field that contains
                // bit `top`.
                let field = self.raised >> (top & !(self.bits - 1));
                let half = 1 << (self.bits - 1);
                let exponent = (field as u64 & (half - 1 + half)).wrapping_sub(half) as i64;
                Some(((top >> self.bits.trailing_zeros()) as usize, exponent))
            }

            #[inline]
            fn size_hint(&self) -> (usize, Option<usize>) {
                let left = self.present.count_ones() as usize;
                (left, Some(left))
            }
        }

        impl ExactSizeIterator for Fields<$key> {}

        impl ShortKey for $key {
            type Present = Fields<$key>;

            fn ones(layout: Layout) -> Self {
                (0..layout.variables).fold(0, |ones, variable| ones | <Self as Key>::variable(layout, variable))
            }

            #[inline]
            fn present(&self, layout: Layout, ones: Self) -> Fields<$key> {
                Fields::<$key>::of(*self, layout, ones)
            }

            #[inline]
            fn listed(&self, layout: Layout, ones: Self) -> Self {
                let Fields { raised, present, .. } = Fields::<$key>::of(*self, layout, ones);
                if present == 0 {
                    return 0;
                }
                let (high, sign) = (ones << (layout.bits - 1), layout.bits - 1);
                let coded = raised - ((raised & present) >> sign);
                let absent = high ^ present;
                // All ones in the fields of variables that are absent, modulo 2^BITS.
                let absent = (absent << 1).wrapping_sub(absent >> sign);
                let ended = present.trailing_zeros() >> layout.bits.trailing_zeros() << layout.bits.trailing_zeros();
                (coded | absent) & (<$key>::MAX << ended)
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
