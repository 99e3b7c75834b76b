//! Exact rational numbers and their one rounding.
//!
//! Invariant: a [`Rational`] is in lowest terms with a positive denominator, and it becomes a float in exactly one
//! place, [`to_f64`] or [`to_f32`], rounded to nearest, ties to even.

use num_bigint::{BigInt, BigUint, Sign};
use num_traits::{One, Signed, Zero};

pub use crate::number::representation::Rational;

/// The rational `numerator / denominator`.
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!(ratio(2, -4), ratio(-1, 2));
/// ```
///
/// # Panics
/// When `denominator` is zero.
#[must_use]
pub fn ratio(numerator: i64, denominator: i64) -> Rational {
    Rational::new(BigInt::from(numerator), BigInt::from(denominator))
}

/// The rational `value / 1`.
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!(integer(3), ratio(6, 2));
/// ```
#[must_use]
pub fn integer(value: i64) -> Rational {
    Rational::from_integer(BigInt::from(value))
}

/// The `f64` nearest to `value`, ties to even; infinite when the magnitude is beyond the largest finite `f64`.
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!(to_f64(&ratio(1, 3)), 1.0 / 3.0);
/// ```
#[must_use]
pub fn to_f64(value: &Rational) -> f64 {
    // Division of two numbers that a double holds is rounded once.
    if let Some((numerator, denominator)) = value.as_words()
        && numerator.abs().max(denominator) <= 1 << 53
    {
        return numerator as f64 / denominator as f64;
    }
    quotient_to_f64(&value.numer(), &value.denom())
}

/// The `f64` nearest to a quotient that need not be in lowest terms, the denominator positive.
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!(quotient_to_f64(&2.into(), &4.into()), 0.5);
/// ```
#[must_use]
pub fn quotient_to_f64(numerator: &BigInt, denominator: &BigInt) -> f64 {
    let (bits, exponent, negative) = round_to(numerator, denominator, 53, -1074);
    scale_by_power_of_two(bits, exponent, negative, 971)
}

/// The `f32` nearest to `value`, ties to even, rounded once from the exact value (not by way of `f64`).
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!(to_f32(&ratio(1, 3)), 1.0_f32 / 3.0);
/// ```
#[must_use]
pub fn to_f32(value: &Rational) -> f32 {
    let (bits, exponent, negative) = round_to(&value.numer(), &value.denom(), 24, -149);
    // Every f32 is an f64, so this second conversion is exact unless the value overflows f32.
    scale_by_power_of_two(bits, exponent, negative, 104) as f32
}

/// Rounds to `precision` bits with the least exponent `least`: value = bits * 2^exponent, bits < 2^precision.
fn round_to(numerator: &BigInt, denominator: &BigInt, precision: u64, least: i64) -> (u64, i64, bool) {
    if numerator.is_zero() {
        return (0, 0, false);
    }
    let negative = numerator.sign() == Sign::Minus;
    let (numerator, denominator) = (numerator.magnitude(), denominator.magnitude());
    // The quotient of the shifted numerator has `precision` or `precision + 1` bits above the last place.
    let mut exponent = i64::try_from(numerator.bits()).expect("invariant: bit length fits")
        - i64::try_from(denominator.bits()).expect("invariant: bit length fits")
        - i64::try_from(precision).expect("invariant: precision is small");
    exponent = exponent.max(least);
    let divide = |exponent: i64| -> (BigUint, BigUint, BigUint) {
        let (n, d) = if exponent >= 0 {
            (numerator.clone(), denominator << exponent.unsigned_abs())
        } else {
            (numerator << exponent.unsigned_abs(), denominator.clone())
        };
        let quotient = &n / &d;
        let remainder = n - &quotient * &d;
        (quotient, remainder, d)
    };
    let (mut quotient, mut remainder, mut divisor) = divide(exponent);
    if quotient.bits() > precision {
        exponent += 1;
        (quotient, remainder, divisor) = divide(exponent);
    }
    let mut bits = u64::try_from(&quotient).expect("invariant: the quotient has at most `precision` bits");
    let twice = remainder << 1;
    if twice > divisor || (twice == divisor && bits & 1 == 1) {
        bits += 1;
    }
    (bits, exponent, negative)
}

fn scale_by_power_of_two(bits: u64, exponent: i64, negative: bool, greatest: i64) -> f64 {
    let magnitude = if bits == 0 {
        0.0
    } else if exponent > greatest {
        f64::INFINITY
    } else {
        // Two exact steps: a single factor 2^-1074 times 2^53 would be exact too, but 2^exponent alone may not be a
        // normal number.
        let half = i32::try_from(exponent / 2).expect("invariant: exponent is bounded");
        let rest = i32::try_from(exponent).expect("invariant: exponent is bounded") - half;
        bits as f64 * 2f64.powi(half) * 2f64.powi(rest)
    };
    if negative { -magnitude } else { magnitude }
}

/// The exact value of a finite `f64`; `None` for infinities and NaN.
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!((from_f64(0.75), from_f64(f64::NAN)), (Some(ratio(3, 4)), None));
/// ```
#[must_use]
pub fn from_f64(value: f64) -> Option<Rational> {
    Rational::from_float(value)
}

/// Parses `12`, `0.1`, `1.5e-3` or `-55/27` exactly; `None` when the text is not such a number.
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!(parse("1.5e-3"), Some(ratio(3, 2000)));
/// assert_eq!(parse("one"), None);
/// ```
#[must_use]
pub fn parse(text: &str) -> Option<Rational> {
    if let Some((numerator, denominator)) = text.split_once('/') {
        let denominator: BigInt = denominator.trim().parse().ok()?;
        if denominator.is_zero() {
            return None;
        }
        return Some(Rational::new(numerator.trim().parse().ok()?, denominator));
    }
    let (mantissa, exponent) = match text.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
        None => (text, 0),
    };
    // A number such as 1e999999999 would fill the memory; no physical quantity is beyond this bound.
    if exponent.unsigned_abs() > 100_000 {
        return None;
    }
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let negative = whole.starts_with('-');
    let whole = whole.strip_prefix(['-', '+']).unwrap_or(whole);
    if !whole.bytes().chain(fraction.bytes()).all(|b| b.is_ascii_digit()) || (whole.is_empty() && fraction.is_empty()) {
        return None;
    }
    let digits: BigInt = format!("{whole}{fraction}").parse().ok()?;
    let places = i32::try_from(fraction.len()).ok()?.checked_sub(exponent)?;
    let power = BigInt::from(10).pow(places.unsigned_abs());
    let value = if places >= 0 { Rational::new(digits, power) } else { Rational::from_integer(digits * power) };
    Some(if negative { -value } else { value })
}

/// Writes `n` or `n/d`.
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!(display(&ratio(-55, 27)), "-55/27");
/// ```
#[must_use]
pub fn display(value: &Rational) -> String {
    value.to_string()
}

/// The value for use in a name: exact where numerator and denominator are short, otherwise the nearest number of four
/// or five significant digits.
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!(readable(&ratio(123_456_789, 1_000_000_000)), ratio(12_346, 100_000));
/// ```
#[must_use]
pub fn readable(value: &Rational) -> Rational {
    /// Most digits of a short numerator or denominator.
    const SHORT: usize = 6;
    let magnitude = abs(value);
    let [above, below] = [magnitude.numer(), magnitude.denom()].map(|number| number.to_string().len());
    if above <= SHORT && below <= SHORT {
        return value.clone();
    }
    // Differences of lengths are far below the range of an i32.
    let places = 4 + below as i32 - above as i32;
    let scale = power(&integer(10), places);
    let scaled = &magnitude * &scale;
    let nearest = (scaled.numer() * 2 + scaled.denom()) / (scaled.denom() * 2);
    let rounded = Rational::from_integer(nearest) / scale;
    if value.is_negative() { -rounded } else { rounded }
}

/// The binomial coefficient C(n, k), zero when `k > n`.
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!((binomial(5, 2), binomial(2, 5)), (10.into(), 0.into()));
/// ```
#[must_use]
pub fn binomial(n: u64, k: u64) -> BigInt {
    if k > n {
        return BigInt::zero();
    }
    let k = k.min(n - k);
    let mut result = BigInt::one();
    for i in 0..k {
        result = result * (n - i) / (i + 1);
    }
    result
}

/// Integer power, negative exponents included.
///
/// ```
/// # use tpm_symbolic::number::rational::*;
/// assert_eq!(power(&ratio(2, 3), -2), ratio(9, 4));
/// ```
///
/// # Panics
/// When `base` is zero and `exponent` is negative.
#[must_use]
pub fn power(base: &Rational, exponent: i32) -> Rational {
    num_traits::pow::Pow::pow(base, exponent)
}

/// Whether `value` is a whole number.
#[must_use]
pub fn is_integer(value: &Rational) -> bool {
    value.is_integer()
}

/// The absolute value.
#[must_use]
pub fn abs(value: &Rational) -> Rational {
    value.abs()
}

#[cfg(test)]
mod tests {
    use super::{integer, parse, ratio, to_f32, to_f64};
    use num_bigint::BigInt;
    use proptest::prelude::{any, prop_assert_eq, proptest};

    #[test]
    fn rounding_is_to_nearest_even() {
        let two53 = integer(1 << 53);
        assert_eq!(to_f64(&(&two53 + integer(1))), 9_007_199_254_740_992.0);
        assert_eq!(to_f64(&(&two53 + integer(3))), 9_007_199_254_740_996.0);
        assert_eq!(to_f64(&ratio(1, 3)), 1.0 / 3.0);
        assert_eq!(to_f64(&ratio(-55, 27)), -55.0 / 27.0);
        assert_eq!(to_f64(&integer(0)), 0.0);
    }

    #[test]
    fn extremes_underflow_gradually_and_overflow_to_infinity() {
        let tiny = super::Rational::new(BigInt::from(1), BigInt::from(1) << 1074);
        assert_eq!(to_f64(&tiny), f64::from_bits(1));
        assert_eq!(to_f64(&(tiny / integer(2))), 0.0);
        let huge = super::Rational::from_integer(BigInt::from(1) << 1024);
        assert_eq!(to_f64(&huge), f64::INFINITY);
        assert_eq!(to_f64(&(huge - integer(1))), f64::INFINITY);
        assert_eq!(to_f32(&super::Rational::from_integer(BigInt::from(1) << 128)), f32::INFINITY);
    }

    #[test]
    fn decimals_are_exact() {
        assert_eq!(parse("0.1"), Some(ratio(1, 10)));
        assert_eq!(parse("1.5e-3"), Some(ratio(3, 2000)));
        assert_eq!(parse("2e3"), Some(integer(2000)));
        assert_eq!(parse("-55/27"), Some(ratio(-55, 27)));
        assert_eq!(parse("1/0"), None);
        assert_eq!(parse("."), None);
        assert_eq!(parse("1e999999999"), None);
    }

    proptest! {
        #[test]
        fn floats_survive_the_round_trip(value in any::<f64>()) {
            if let Some(exact) = super::from_f64(value) {
                prop_assert_eq!(to_f64(&exact), value);
            }
        }

        #[test]
        fn single_precision_is_rounded_once(value in any::<f64>()) {
            if let Some(exact) = super::from_f64(value) {
                prop_assert_eq!(to_f32(&exact), value as f32);
            }
        }

        #[test]
        fn small_quotients_agree_with_hardware_division(n in -(1i64 << 53)..(1i64 << 53), d in 1i64..(1i64 << 53)) {
            prop_assert_eq!(to_f64(&ratio(n, d)), n as f64 / d as f64);
        }
    }
}
