//! Low passes of a split feed-forward (Feng, Figures 6.3 and 6.4), as coefficients in sampled time.
//!
//! ```text
//! F(s) = 1 / (s^2/w_n^2 + s/(Q w_n) + 1) ,      s = c (1 - z^-1)/(1 + z^-1) ,   c = w_n / tan(w_n T/2)
//! y_n = g (x_n + 2 x_{n-1} + x_{n-2}) - a_1 y_{n-1} - a_2 y_{n-2} ,   t = tan(w_n T/2)
//! g = t^2/d ,   a_1 = 2 (t^2 - 1)/d ,   a_2 = (1 - t/Q + t^2)/d ,   d = 1 + t/Q + t^2
//! ```
//!
//! Invariant: the discrete filter agrees with the continuous one at w_n and passes a constant unchanged. Coefficients
//! are rationals with an error below 1e-40, so that the literals are the exact coefficients, each rounded once.

use num_traits::Signed;
use thiserror::Error;
use tpm_symbolic::number::rational::{self, Rational};

/// A low pass of second order and unit gain.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LowPass {
    /// Undamped natural frequency w_n, rad/s.
    pub natural_frequency: Rational,
    /// Quality factor Q.
    pub quality: Rational,
}

/// 1/sqrt(2), the quality factor where none is given: a second-order low pass with it is maximally flat and has no peak.
const FLATTEST: &str = "0.70710678118654752440084436210484903928";

/// The filters of a feed-forward.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Filters {
    /// Time between samples, s.
    pub sample_time: Rational,
    /// The filter of the motion-dependent part; in the common scheme, of the whole feed-forward.
    pub dependent: LowPass,
    /// The filter of the motion-independent part in the split scheme, when that part is filtered.
    pub independent: Option<LowPass>,
}

/// Why a low pass does not exist.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum FilterError {
    /// A text is not a number.
    #[error("`{0}` is not a number such as 100 or 0.001")]
    NotNumber(String),
    /// A value is not positive.
    #[error("the {0} of a low pass must be positive")]
    NotPositive(&'static str),
    /// The natural frequency is too high for the sample time.
    #[error(
        "a low pass of {natural_frequency} rad/s needs more than two samples per turn: samples every {sample_time} s allow less than pi/{sample_time} rad/s"
    )]
    TooFast {
        /// The natural frequency, rad/s.
        natural_frequency: String,
        /// The time between samples, s.
        sample_time: String,
    },
    /// The feed-forward of the model cannot be split.
    #[error(
        "the inputs of this model have no motion-dependent and motion-independent parts to filter: every input must follow from one equation"
    )]
    NoParts,
}

/// The filter's coefficients.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Coefficients {
    /// The gain g.
    pub(super) gain: Rational,
    /// The feedback coefficients a_1, a_2.
    pub(super) feedback: [Rational; 2],
}

impl LowPass {
    /// A low pass written as `W` or `W:Q`, its numbers exactly as they stand.
    ///
    /// # Errors
    /// [`FilterError::NotNumber`].
    pub fn parse(text: &str) -> Result<Self, FilterError> {
        let (frequency, quality) = text.split_once(':').unwrap_or((text, FLATTEST));
        let number =
            |text: &str| rational::parse(text.trim()).ok_or_else(|| FilterError::NotNumber(text.trim().to_owned()));
        Ok(Self { natural_frequency: number(frequency)?, quality: number(quality)? })
    }

    /// Coefficients for samples every `sample_time` seconds.
    pub(super) fn coefficients(&self, sample_time: &Rational) -> Result<Coefficients, FilterError> {
        for (value, name) in
            [(&self.natural_frequency, "natural frequency"), (&self.quality, "quality"), (sample_time, "sample time")]
        {
            if !value.is_positive() {
                return Err(FilterError::NotPositive(name));
            }
        }
        let half = &self.natural_frequency * sample_time / rational::integer(2);
        // The bound lies below pi/2 by more than the remainders of the series.
        if half >= rational::ratio(157_079, 100_000) {
            return Err(FilterError::TooFast {
                natural_frequency: rational::display(&self.natural_frequency),
                sample_time: rational::display(sample_time),
            });
        }
        let t = tangent(&half);
        let (one, two, square) = (rational::integer(1), rational::integer(2), &t * &t);
        let damping = &t / &self.quality;
        let below = &one + &damping + &square;
        Ok(Coefficients {
            gain: &square / &below,
            feedback: [&two * (&square - &one) / &below, (&one - &damping + &square) / &below],
        })
    }

    /// `100 rad/s, quality 1`.
    pub(super) fn describe(&self) -> String {
        format!("{} rad/s, quality {}", decimal(&self.natural_frequency), decimal(&self.quality))
    }
}

impl Filters {
    /// Checks that both filters exist.
    ///
    /// # Errors
    /// When a value is not positive, or a natural frequency is too high for the sample time.
    pub fn check(&self) -> Result<(), FilterError> {
        self.coefficients().map(|_| ())
    }

    /// Coefficients of both filters.
    pub(super) fn coefficients(&self) -> Result<(Coefficients, Option<Coefficients>), FilterError> {
        let independent = self.independent.as_ref().map(|filter| filter.coefficients(&self.sample_time)).transpose()?;
        Ok((self.dependent.coefficients(&self.sample_time)?, independent))
    }

    /// The documentation of the common scheme.
    pub(super) const COMMON: &str = "Feed-forward of which everything passes the low pass (Feng, Figure 6.3)";

    /// The documentation of the split scheme.
    pub(super) const fn split(&self) -> &'static str {
        match self.independent {
            Some(_) => {
                "Feed-forward of which the motion-dependent part passes the low pass and the motion-independent one a faster one (Feng, Figure 6.4)"
            }
            None => "Feed-forward of which only the motion-dependent part passes the low pass (Feng, Figure 6.4)",
        }
    }

    /// In words, the part of the feed-forward that the filter [`dependent`](Self::dependent) is for.
    pub(super) const DEPENDENT: &str = "the motion-dependent part, or of all of it";
    /// In words, the part of the feed-forward that the filter [`independent`](Self::independent) is for.
    pub(super) const INDEPENDENT: &str = "the motion-independent part";

    /// The documentation of one filter, which is for the given part.
    pub(super) fn about(&self, filter: &LowPass, part: &str) -> String {
        format!(
            "The low pass of {part}: {}, for a sample every {} s.\n\n\
             The bilinear image of `1/(s^2/w_n^2 + s/(Q w_n) + 1)`, warped so that both agree at the natural frequency w_n\n\
             (Feng, Figures 6.3 and 6.4); a constant passes unchanged.",
            filter.describe(),
            decimal(&self.sample_time)
        )
    }
}

/// The most readable text of a number: a decimal where that is exact and short.
fn decimal(value: &Rational) -> String {
    let double = rational::to_f64(value);
    match rational::from_f64(double) {
        Some(back) if rational::abs(&(&back - value)) * rational::integer(1_000_000_000_000) < rational::abs(value) => {
            format!("{double}")
        }
        _ => rational::display(value),
    }
}

/// tan of an angle in (0, pi/2), with an error below 1e-40 of the tangent or of its inverse.
fn tangent(angle: &Rational) -> Rational {
    let square = angle * angle;
    let (mut sine, mut cosine) = (rational::integer(0), rational::integer(0));
    // 1.5708^n / n! is below 1e-60 from n = 60 on.
    let mut term = rational::integer(1);
    for n in 0..64i64 {
        let sign = if n % 4 < 2 { term.clone() } else { -term.clone() };
        if n % 2 == 0 {
            cosine += sign
        } else {
            sine += sign
        }
        term = term * angle / rational::integer(n + 1);
        if square.is_positive() && term < rational::power(&rational::integer(10), -60) {
            break;
        }
    }
    sine / cosine
}

#[cfg(test)]
mod tests {
    use super::{FilterError, LowPass, tangent};
    use tpm_symbolic::number::rational;

    fn low_pass(natural_frequency: i64, quality: i64) -> LowPass {
        LowPass { natural_frequency: rational::integer(natural_frequency), quality: rational::integer(quality) }
    }

    #[test]
    fn coefficients_are_those_of_the_formula() {
        for half in [1e-4, 0.05, 0.7, 1.5] {
            let exact = rational::from_f64(half).expect("finite");
            assert!((rational::to_f64(&tangent(&exact)) / half.tan() - 1.0).abs() < 4.0 * f64::EPSILON, "{half}");
        }
        let found = low_pass(100, 1).coefficients(&rational::ratio(1, 1000)).expect("slow enough");
        let t = 0.05_f64.tan();
        let below = 1.0 + t + t * t;
        let expected = [t * t / below, 2.0 * (t * t - 1.0) / below, (1.0 - t + t * t) / below];
        for (found, expected) in [&found.gain, &found.feedback[0], &found.feedback[1]].into_iter().zip(expected) {
            assert!((rational::to_f64(found) - expected).abs() < 1e-15, "{expected}");
        }
        // A constant passes: 4 g = 1 + a_1 + a_2, exactly.
        let sum = rational::integer(1) + &found.feedback[0] + &found.feedback[1];
        assert_eq!(found.gain * rational::integer(4), sum);
    }

    #[test]
    fn what_is_no_filter_is_refused() {
        let second = rational::integer(1);
        assert_eq!(low_pass(0, 1).coefficients(&second), Err(FilterError::NotPositive("natural frequency")));
        assert_eq!(low_pass(1, -1).coefficients(&second), Err(FilterError::NotPositive("quality")));
        assert_eq!(low_pass(1, 1).coefficients(&-second.clone()), Err(FilterError::NotPositive("sample time")));
        let refused = low_pass(4, 1).coefficients(&second).expect_err("too fast").to_string();
        assert!(refused.contains("4 rad/s"), "{refused}");
    }
}
