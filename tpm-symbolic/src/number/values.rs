//! Lists of numerators of a common width.

use crate::number::numerator::Numerator;
use crate::number::wide::Wide;
use num_bigint::BigInt;

/// Numerators of one width, which [`Values::hold`] chooses.
#[derive(Clone, Debug)]
pub(crate) enum Values {
    One(Vec<i64>),
    Two(Vec<i128>),
    Three(Vec<Wide<3>>),
    Four(Vec<Wide<4>>),
    Six(Vec<Wide<6>>),
    Eight(Vec<Wide<8>>),
    Big(Vec<BigInt>),
}

/// Runs the same code for whichever width `$values` has; with `=> $wrap` the result, a vector of the same width, is
/// wrapped again.
macro_rules! for_width {
    ($values:expr, $list:ident => $body:expr) => {
        match $values {
            $crate::number::values::Values::One($list) => $body,
            $crate::number::values::Values::Two($list) => $body,
            $crate::number::values::Values::Three($list) => $body,
            $crate::number::values::Values::Four($list) => $body,
            $crate::number::values::Values::Six($list) => $body,
            $crate::number::values::Values::Eight($list) => $body,
            $crate::number::values::Values::Big($list) => $body,
        }
    };
    ($values:expr, $list:ident => wrap $body:expr) => {
        match $values {
            $crate::number::values::Values::One($list) => $crate::number::values::Values::One($body),
            $crate::number::values::Values::Two($list) => $crate::number::values::Values::Two($body),
            $crate::number::values::Values::Three($list) => $crate::number::values::Values::Three($body),
            $crate::number::values::Values::Four($list) => $crate::number::values::Values::Four($body),
            $crate::number::values::Values::Six($list) => $crate::number::values::Values::Six($body),
            $crate::number::values::Values::Eight($list) => $crate::number::values::Values::Eight($body),
            $crate::number::values::Values::Big($list) => $crate::number::values::Values::Big($body),
        }
    };
}
pub(crate) use for_width;

impl Values {
    /// The number of bits b such that the width holds every magnitude below 2^b.
    pub(crate) fn capacity(&self) -> u64 {
        fn bits<T: Numerator>(_: &[T]) -> u64 {
            T::BITS
        }
        for_width!(self, list => bits(list))
    }

    /// These numbers in the narrowest width for magnitudes below 2^bits.
    pub(crate) fn widened(&self, bits: u64) -> Self {
        fn convert<S: Numerator, T: Numerator>(from: &[S]) -> Vec<T> {
            let words = if S::BITS == u64::MAX { 0 } else { S::BITS.div_ceil(64) as usize };
            let mut scratch: Vec<u64> = Vec::new();
            from.iter()
                .map(|value| {
                    let words = if words == 0 { (value.to_big().bits() / 64 + 1) as usize } else { words };
                    scratch.resize(words, 0);
                    value.write_words(&mut scratch);
                    T::from_words(&scratch)
                })
                .collect()
        }
        match bits {
            0..=63 => for_width!(self, list => Self::One(convert(list))),
            64..=127 => for_width!(self, list => Self::Two(convert(list))),
            128..=191 => for_width!(self, list => Self::Three(convert(list))),
            192..=255 => for_width!(self, list => Self::Four(convert(list))),
            256..=383 => for_width!(self, list => Self::Six(convert(list))),
            384..=511 => for_width!(self, list => Self::Eight(convert(list))),
            _ => for_width!(self, list => Self::Big(convert(list))),
        }
    }

    /// Widens the list to hold magnitudes below 2^bits.
    pub(crate) fn hold(&mut self, bits: u64) {
        if self.capacity() < bits {
            *self = self.widened(bits);
        }
    }

    /// The values as big integers.
    pub(crate) fn to_big(&self) -> Vec<BigInt> {
        for_width!(self, list => list.iter().map(Numerator::to_big).collect())
    }
}
