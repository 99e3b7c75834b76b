//! Exact numbers as literals, each rounded once and correctly.

use tpm_symbolic::number::rational::{self, Rational};

/// A rational number rounded to both precisions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rounded {
    /// Nearest in double precision.
    pub double: f64,
    /// Nearest in single precision.
    pub single: f32,
}

impl Rounded {
    /// Rounds a number to each precision directly.
    #[must_use]
    pub fn new(value: &Rational) -> Self {
        Self { double: rational::to_f64(value), single: rational::to_f32(value) }
    }

    /// Whether rounding the double to single precision gives the nearest single.
    #[must_use]
    pub fn agrees(self) -> bool {
        // The cast performs the second rounding, which is compared with the direct one.
        #[allow(clippy::cast_possible_truncation)]
        let twice = self.double as f32;
        twice.to_bits() == self.single.to_bits()
    }

    /// Whether rounding made the number infinite, or a nonzero number zero.
    #[must_use]
    pub fn is_lost(self, value: &Rational) -> bool {
        use num_traits::Zero;
        !self.double.is_finite() || (self.double.abs() < f64::MIN_POSITIVE && !value.is_zero())
    }
}

/// The shortest digits that read back as this number, with a point or an exponent.
#[must_use]
pub fn digits(value: f64) -> String {
    format!("{value:?}")
}

/// The shortest digits that read back as this number, with a point or an exponent.
#[must_use]
pub fn digits_single(value: f32) -> String {
    format!("{value:?}")
}

/// Whether a literal resembles a well-known irrational constant, so that a lint would report it as a mistake.
#[must_use]
pub fn resembles_constant(value: f64) -> bool {
    use std::f64::consts as c;
    let known = [
        c::E,
        c::FRAC_1_PI,
        c::FRAC_1_SQRT_2,
        c::FRAC_2_PI,
        c::FRAC_2_SQRT_PI,
        c::FRAC_PI_2,
        c::FRAC_PI_3,
        c::FRAC_PI_4,
        c::FRAC_PI_6,
        c::FRAC_PI_8,
        c::LN_2,
        c::LN_10,
        c::LOG10_2,
        c::LOG10_E,
        c::LOG2_10,
        c::LOG2_E,
        c::PI,
        c::SQRT_2,
        c::TAU,
    ];
    known.iter().any(|constant| (value.abs() / constant - 1.0).abs() < 2e-3)
}

#[cfg(test)]
mod tests {
    use super::{Rounded, digits};
    use tpm_symbolic::number::rational::{integer, power, ratio};

    #[test]
    fn a_number_halfway_between_two_singles_is_rounded_once() {
        // 1 + 2^-24 + 2^-60 lies just above the middle of two singles; its double is exactly the middle.
        let value = integer(1) + power(&integer(2), -24) + power(&integer(2), -60);
        let rounded = Rounded::new(&value);
        assert!(!rounded.agrees());
        assert_eq!(rounded.single, 1.0 + f32::EPSILON);
        assert!(Rounded::new(&ratio(-55, 27)).agrees());
    }

    #[test]
    fn literals_read_back() {
        for value in [1.0, -55.0 / 27.0, 1e300, 5e-324, 0.1] {
            assert_eq!(digits(value).parse::<f64>(), Ok(value));
        }
        assert!(Rounded::new(&power(&integer(10), 400)).is_lost(&integer(1)));
        assert!(Rounded::new(&power(&integer(10), -400)).is_lost(&power(&integer(10), -400)));
        assert!(!Rounded::new(&integer(0)).is_lost(&integer(0)));
    }
}
