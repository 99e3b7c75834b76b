//! Numbers with a standard deviation, to the digits that the deviation supports.
//!
//! Invariant: a deviation has two significant digits, and its value ends at the same decimal place. Where both are written with
//! a power of ten, they share it, so that they can be compared digit by digit.

use crate::table::number;

/// Significant digits of a deviation.
const DEVIATION_DIGITS: usize = 2;
/// Most decimal places between the first digit of a value and the last one that its deviation supports: the precision of a double.
const MOST_PLACES: i32 = 15;
/// Significant digits of a number that is taken for exact: few enough to hide the rounding of a computation.
const EXACT_DIGITS: usize = 12;
/// Range of the power of ten of the first digit of a number that is written without an exponent.
const PLAIN_EXPONENTS: std::ops::Range<i32> = -4..7;

/// The decimal place to which a value and its standard deviation are rounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// Power of ten of the last digit.
    place: i32,
    /// The power of ten that is written behind the number; nothing for a number without an exponent.
    exponent: Option<i32>,
}

impl Cut {
    /// The last decimal place that a standard deviation supports. Nothing where the deviation is zero or not finite, or
    /// so small that a double of the value's size has no digits there.
    #[must_use]
    pub fn new(value: f64, std: f64) -> Option<Self> {
        if !(value.is_finite() && std.is_finite() && std > 0.0) {
            return None;
        }
        let first = leading(std, DEVIATION_DIGITS - 1);
        let place = first + 1 - DEVIATION_DIGITS as i32;
        // The value may round up to a further digit, as 9.996 does to 10.00.
        let lead = match usize::try_from(leading(value, EXACT_DIGITS) - place) {
            Ok(digits) if value != 0.0 => leading(value, digits).max(first),
            _ => first,
        };
        let plain = PLAIN_EXPONENTS.contains(&lead);
        (lead - place <= MOST_PLACES).then_some(Cut { place, exponent: (!plain).then_some(lead) })
    }

    /// The number rounded to the last significant digit of its deviation.
    #[must_use]
    pub fn text(self, number: f64) -> String {
        match self.exponent {
            Some(exponent) => format!("{}e{exponent}", self.mantissa(number)),
            None => self.mantissa(number),
        }
    }

    /// The digits of the rounded number without its power of ten.
    fn mantissa(self, number: f64) -> String {
        let exponent = self.exponent.unwrap_or(0);
        let decimals = exponent - self.place;
        let number = times_ten_to(number, -exponent);
        let text = match usize::try_from(decimals) {
            Ok(decimals) => format!("{number:.decimals$}"),
            Err(_) => format!("{:.0}", times_ten_to(times_ten_to(number, decimals).round(), -decimals)),
        };
        match text.strip_prefix('-') {
            Some(size) if size.bytes().all(|byte| matches!(byte, b'0' | b'.')) => size.to_owned(),
            _ => text,
        }
    }
}

/// A number times a power of ten, in two steps, so that powers beyond the range of doubles reach numbers near its ends.
fn times_ten_to(number: f64, power: i32) -> f64 {
    let half = power / 2;
    number * 10.0_f64.powi(half) * 10.0_f64.powi(power - half)
}

/// Power of ten of a number's first digit once it is rounded to so many digits behind the first.
fn leading(number: f64, behind: usize) -> i32 {
    let text = format!("{number:.behind$e}");
    text.split_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or(0)
}

/// A value and its standard deviation as two cells of a table, rounded to the same decimal place. A missing number is a
/// dash. A value with a deviation of zero is taken for exact; a value whose deviation is not finite keeps six digits.
#[must_use]
pub fn cells(value: Option<f64>, std: Option<f64>) -> [String; 2] {
    let dash = || "-".to_owned();
    match (value, std.filter(|std| std.is_finite() && *std >= 0.0)) {
        (None, _) => [dash(), dash()],
        (Some(value), None) => [number(value), dash()],
        (Some(value), Some(0.0)) => [exact(value), "0".to_owned()],
        (Some(value), Some(std)) => match Cut::new(value, std) {
            Some(cut) => [cut.text(value), cut.text(std)],
            None => [exact(value), digits(std, DEVIATION_DIGITS)],
        },
    }
}

/// A value and its deviation in running text, such as `1.30582 +- 0.00028` or `(3.756 +- 0.033)e-5`.
#[must_use]
pub fn plus_minus(value: f64, std: f64) -> String {
    match Cut::new(value, std) {
        Some(cut @ Cut { exponent: Some(exponent), .. }) => {
            format!("({} +- {})e{exponent}", cut.mantissa(value), cut.mantissa(std))
        }
        _ => cells(Some(value), Some(std)).join(" +- "),
    }
}

/// A number to compare with a value and its standard deviation, such as the true value. It is rounded to the decimal
/// place of that value, and written as exact where there is no deviation.
#[must_use]
pub fn beside(number: f64, value: Option<f64>, std: Option<f64>) -> String {
    match value.zip(std).and_then(|(value, std)| Cut::new(value, std)) {
        // A number of a very different size than the value would lose its digits, or have too many.
        Some(cut) if number == 0.0 || (leading(number, EXACT_DIGITS) - cut.place).unsigned_abs() < 16 => {
            cut.text(number)
        }
        _ => exact(number),
    }
}

/// A number with so many significant digits, without an exponent where its magnitude is at least 1e-4 and below 1e7.
#[must_use]
pub fn digits(number: f64, significant: usize) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    let behind = significant.max(1) - 1;
    let lead = leading(number, behind);
    let place = lead - behind as i32;
    Cut { place, exponent: (!PLAIN_EXPONENTS.contains(&lead)).then_some(lead) }.text(number)
}

/// Probabilities below this one are not told from zero, which no chance is.
const LEAST_PROBABILITY: f64 = 1e-300;

/// A probability in a front end's own digits; one that is too small to be told from zero as a bound, since a chance is never zero.
#[must_use]
pub fn probability(p: f64, shown: fn(f64) -> String) -> String {
    if p < LEAST_PROBABILITY { "<1e-300".to_owned() } else { shown(p) }
}

/// A number that is taken for exact, with at most twelve significant digits.
#[must_use]
pub fn exact(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    let behind = EXACT_DIGITS - 1;
    let rounded: f64 = format!("{number:.behind$e}").parse().unwrap_or(number);
    if PLAIN_EXPONENTS.contains(&leading(number, behind)) { rounded.to_string() } else { format!("{rounded:e}") }
}

#[cfg(test)]
mod tests {
    use super::{beside, cells, digits, exact, plus_minus};

    fn both(value: f64, std: f64) -> (String, String) {
        let [value, std] = cells(Some(value), Some(std));
        (value, std)
    }

    #[test]
    fn value_and_deviation_end_at_one_place() {
        for (value, std, expected) in [
            (1.305_821_7, 0.000_283_4, ("1.30582", "0.00028")),
            (40.001_954, 0.001_838_3, ("40.0020", "0.0018")),
            (-2714.71, 35.2, ("-2715", "35")),
            // Digits that the deviation does not support become zeros.
            (271_471.0, 3520.0, ("271500", "3500")),
            // The deviation rounds up to a further digit, and so does the value.
            (9.996, 0.0996, ("10.00", "0.10")),
            (0.0, 0.25, ("0.00", "0.25")),
        ] {
            let (value, std) = both(value, std);
            assert_eq!((value.as_str(), std.as_str()), expected);
        }
    }

    #[test]
    fn large_and_tiny_numbers_share_a_power_of_ten() {
        assert_eq!(both(3.755_61e-5, 3.257e-7), ("3.756e-5".into(), "0.033e-5".into()));
        assert_eq!(both(9.999_96e-8, 5.1e-11), ("1.00000e-7".into(), "0.00051e-7".into()));
        assert_eq!(both(-1.234_567e12, 4.4e8), ("-1.23457e12".into(), "0.00044e12".into()));
        assert_eq!(both(2.0e-310, 1.0e-312), ("2.000e-310".into(), "0.010e-310".into()));
    }

    #[test]
    fn a_deviation_may_be_larger_than_its_value() {
        assert_eq!(both(-0.0012, 0.53), ("0.00".into(), "0.53".into()));
        assert_eq!(both(1.3, 4200.0), ("0".into(), "4200".into()));
        assert_eq!(both(1e-9, 2.5e-7), ("0.0e-7".into(), "2.5e-7".into()));
    }

    #[test]
    fn deviations_that_are_no_deviation_are_said() {
        assert_eq!(both(0.018_26, 0.0), ("0.01826".into(), "0".into()));
        assert_eq!(both(0.1 + 0.2, 0.0), ("0.3".into(), "0".into()));
        assert_eq!(both(2.0, f64::INFINITY), ("2".into(), "-".into()));
        assert_eq!(both(2.0, f64::NAN), ("2".into(), "-".into()));
        // No double has digits for such a deviation beside such a value.
        assert_eq!(both(2.5, 1.23e-20), ("2.5".into(), "1.2e-20".into()));
        assert_eq!(cells(Some(2.0), None), ["2", "-"]);
        assert_eq!(cells(None, Some(2.0)), ["-", "-"]);
    }

    #[test]
    fn running_text_names_the_power_of_ten_once() {
        assert_eq!(plus_minus(1.305_821_7, 0.000_283_4), "1.30582 +- 0.00028");
        assert_eq!(plus_minus(3.755_61e-5, 3.257e-7), "(3.756 +- 0.033)e-5");
        assert_eq!(plus_minus(0.5, 0.0), "0.5 +- 0");
    }

    #[test]
    fn what_stands_beside_a_value_is_cut_as_it_is() {
        assert_eq!(beside(2.0, Some(2.000_14), Some(0.000_11)), "2.00000");
        assert_eq!(beside(2.0, Some(2.0), Some(0.0)), "2");
        assert_eq!(beside(2.5, None, None), "2.5");
    }

    #[test]
    fn significant_digits_are_counted_after_rounding() {
        assert_eq!(digits(0.099_96, 3), "0.100");
        assert_eq!(digits(0.000_113_891, 3), "0.000114");
        assert_eq!(digits(1.938e-7, 2), "1.9e-7");
        assert_eq!(exact(1e21), "1e21");
    }
}
