//! False alarms: from which size on something is no chance.
//!
//! Thresholds of normal variables are multiples of a standard deviation; thresholds of a line's power are multiples of the mean power of
//! its noise; everything else is the rate itself. The rate of one test stands in the doc of every threshold and is what the tail
//! functions of [`tail`](crate::tail) give for it, which the tests of this module check. "To either side" is P(|z| > x), "to one side"
//! P(z > x).
//!
//! A line is a complex normal variable, so that its power over the mean power of its noise is exponential, P(> x) = exp(-x). Where the
//! mean is read from n bins it is P(> x) = (1 + x/n)^-n, the F distribution with (2, 2n) degrees of freedom.
//!
//! Invariant: a decision has one threshold, named after what it decides; equal numbers that decide different things have different names.

use crate::tail::normal_two_sided;

/// Threshold of an exponential variable of mean one with a rate of false alarms of `rate` for all of `tests` tests together (Bonferroni).
///
/// Twice the threshold bounds a chi-squared variable of one degree of freedom, whose tail lies below exp(-x/2).
pub fn exponential(rate: f64, tests: usize) -> f64 {
    (tests as f64 / rate).ln()
}

/// Threshold of the square of a standard normal variable with a rate of false alarms of `rate` for all of `tests` tests together
/// (Bonferroni).
pub fn squared_normal(rate: f64, tests: usize) -> f64 {
    let wanted = rate / tests.max(1) as f64;
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if normal_two_sided(middle) > wanted { low = middle } else { high = middle }
    }
    high * high
}

// Estimates that contradict each other, in standard deviations.

/// One in a thousand, to one side.
const ONE_IN_A_THOUSAND: f64 = 3.09;

/// Runs of a campaign contradict each other when the significance of their difference, as a normal variable, is larger: once in 1,000
/// pairs, to one side.
pub const RUNS_CONTRADICT: f64 = ONE_IN_A_THOUSAND;
/// Lumped parameters contradict the physical ones when the significance of the misfit, as a normal variable, is larger: once in 1,000
/// models, to one side.
pub const LUMPED_CONTRADICT: f64 = ONE_IN_A_THOUSAND;
/// The halves of a record contradict each other in one parameter: 4.7 in 10,000, to either side.
pub const HALVES_CONTRADICT: f64 = 3.5;
/// A log contradicts the others in one parameter: 6.3 in 100,000, to either side.
pub const LOGS_CONTRADICT: f64 = 4.0;
/// Rate at which several logs of an unchanged machine are found to scatter more than their deviations say (chi-squared), so that
/// deviations are widened.
pub const LOGS_SCATTER_RATE: f64 = 0.01;
/// Share of comparisons of results without a difference in which one may be claimed: all tests of a comparison together (Holm).
pub const COMPARISON_RATE: f64 = 0.05;
/// The latest run changed an estimate: 2.7 in 1,000, to either side.
pub const ESTIMATE_CHANGED: f64 = 3.0;
/// A bias leaves the interval that a standard deviation states: normal variables are as far off in 2.7 of 1,000 cases, to either side.
pub const BIAS_LEAVES_INTERVAL: f64 = 3.0;
/// A value is certainly negative: 2.3 in 100, to one side.
pub const SURELY_NEGATIVE: f64 = 2.0;
/// Damping or friction that is certainly negative, which the model's wording forbids: 2.3 in 10,000, to one side.
pub const DRIVES: f64 = 3.5;
/// A limit of an input is told from none: 5.7 in 10,000,000, to either side.
pub const LIMIT_SHOWN: f64 = 5.0;
/// One of two models predicts better, in standard errors of the difference of their errors: 4.6 in 100, to either side.
pub const MODELS_DIFFER: f64 = 2.0;

// What the residuals of a model show.

/// Gain of twice the logarithm of the likelihood from which on a kind of noise, or a limit of an input, is believed. With one number more
/// to fit, as a chi-squared variable of one degree of freedom: 1.6 in 1,000.
pub const LIKELIHOOD_GAIN: f64 = 10.0;
/// Innovations are correlated: 3.4 in 1,000,000, to one side. They are stronger at the harmonics of the motion, in standard deviations of
/// the mean of exponential powers, which is not normal: 1.3 in 10,000 with one sensor and 24 harmonics.
pub const INNOVATIONS_NOT_WHITE: f64 = 4.5;
/// A measured rate is not that of the position: 6.8 in 1,000,000, to either side.
pub const RATE_FAULT: f64 = 4.5;
/// Highest rate at which a right model is said to lack a term, all candidates together.
pub const MISSING_TERM_RATE: f64 = 0.01;
/// Rate at which a term enters the variance components of a right model, all candidates together.
pub const MISSING_COMPONENT_RATE: f64 = 0.05;
/// Highest rate at which a sensor is said to see a vibration where there is none, all windows of a spectrum together.
pub const VIBRATION_RATE: f64 = 0.002;
/// Rate at which a right model fails a test of whiteness or independence.
pub const WHITENESS_RATE: f64 = 0.01;
/// A single correlation is beyond so many standard deviations, to either side, at the rate [`WHITENESS_RATE`].
pub const WHITENESS_BAND: f64 = 2.575_829_303_548_901;
/// A force that the model lacks would be noticed when it moves the residuals by so many standard deviations: the root of the noncentrality
/// at which a test with one false alarm in twenty overlooks one force in twenty, 1.960 + 1.645.
pub const FORCE_NOTICED: f64 = 3.605;

// What the noise of a signal hides.

/// Averaged coherence of a line whose output has nothing to do with its input: once in 1,000 lines, to one side.
pub const COHERENT_LINE: f64 = ONE_IN_A_THOUSAND;
/// Two periods of a record differ by more than white noise: 3.2 in 100,000, to one side, where the mean square of their difference is
/// normal, as it is over many samples.
pub const PERIODS_DIFFER: f64 = 4.0;
/// Slope of a channel that is not at rest: 6.3 in 100,000, to either side.
pub const SLOPE_MOVES: f64 = 4.0;
/// A channel stays at a level, and jumps to it, beyond what its noise does: 3.4 in 1,000,000 for a normal variable, to one side. The sum of
/// squares of a short stay has a longer tail.
pub const PLATEAU_STAYS: f64 = 4.5;
/// Noise turns the sign of a term within so many standard deviations of zero: beyond, 1.3 in 1,000, to one side.
pub const SIGN_KNOWN: f64 = 3.0;
/// Deviation by which noise moves a motion: 4.6 in 100 are farther, to either side.
pub const MOTION_STRAYS: f64 = 2.0;

// Lines beside noise, in multiples of the mean power of their noise.

/// A line belongs to the motion: 1.2 lines of noise in 10,000, and 7.9 with noise from sixteen bins.
pub const LINE_OF_MOTION: f64 = 9.0;
/// What a prediction misses of a line is no noise: 1.2 lines in 10,000.
pub const PREDICTION_MISSES: f64 = 9.0;
/// A line counts as an equation: with noise from sixteen bins 2.3 lines of noise in 1,000,000.
pub const VISIBLE_LINE: f64 = 20.0;
/// A line far above all others counts. Over hundreds of campaigns one line of noise alone passes [`VISIBLE_LINE`], and everything below
/// it would count as motion. With noise from sixteen bins 2.3 lines of noise in 10^23.
pub const LONE_LINE: f64 = 400.0;
/// A measured line stands in for the reference, whose coordinate rests: 3.7 lines of noise in 10^44.
pub const MEASURED_LINE: f64 = 100.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tail::{NORMAL_95, chi_squared_upper, normal_two_sided};

    /// Rates to two digits, as the docs state them.
    fn check(name: &str, rate: f64, stated: f64) {
        assert!((rate / stated - 1.0).abs() < 0.05, "{name}: {rate:e} is not {stated:e}");
    }

    #[test]
    fn normal_thresholds_have_the_stated_rates() {
        let either = [
            ("halves", HALVES_CONTRADICT, 4.7e-4),
            ("logs", LOGS_CONTRADICT, 6.3e-5),
            ("estimate", ESTIMATE_CHANGED, 2.7e-3),
            ("bias", BIAS_LEAVES_INTERVAL, 2.7e-3),
            ("limit", LIMIT_SHOWN, 5.7e-7),
            ("models", MODELS_DIFFER, 4.6e-2),
            ("rate", RATE_FAULT, 6.8e-6),
            ("slope", SLOPE_MOVES, 6.3e-5),
            ("motion", MOTION_STRAYS, 4.6e-2),
            ("band", WHITENESS_BAND, WHITENESS_RATE),
        ];
        for (name, threshold, stated) in either {
            check(name, normal_two_sided(threshold), stated);
        }
        let one = [
            ("runs", RUNS_CONTRADICT, 1e-3),
            ("lumped", LUMPED_CONTRADICT, 1e-3),
            ("coherence", COHERENT_LINE, 1e-3),
            ("negative", SURELY_NEGATIVE, 2.3e-2),
            ("drives", DRIVES, 2.3e-4),
            ("innovations", INNOVATIONS_NOT_WHITE, 3.4e-6),
            ("periods", PERIODS_DIFFER, 3.2e-5),
            ("plateau", PLATEAU_STAYS, 3.4e-6),
            ("sign", SIGN_KNOWN, 1.3e-3),
        ];
        for (name, threshold, stated) in one {
            check(name, 0.5 * normal_two_sided(threshold), stated);
        }
        assert!((normal_two_sided(WHITENESS_BAND) / WHITENESS_RATE - 1.0).abs() < 1e-12);
        // A variable of mean 3.605 is below the threshold of one false alarm in twenty once in twenty times.
        check("noticed", 0.5 * normal_two_sided(FORCE_NOTICED - NORMAL_95), 0.05);
        // The mean of 24 exponential powers, times 48, is chi-squared with 48 degrees of freedom.
        let harmonics = 48.0 * (1.0 + INNOVATIONS_NOT_WHITE / 24.0_f64.sqrt());
        check("harmonics", chi_squared_upper(harmonics, 48), 1.3e-4);
        check("likelihood", chi_squared_upper(LIKELIHOOD_GAIN, 1), 1.6e-3);
    }

    #[test]
    fn lines_of_noise_pass_at_the_stated_rates() {
        // |z|^2 of a complex normal line over its mean, twice, is chi-squared with two degrees of freedom.
        let known = |threshold: f64| chi_squared_upper(2.0 * threshold, 2);
        let of_sixteen = |threshold: f64| (1.0 + threshold / 16.0).powi(-16);
        check("motion", known(LINE_OF_MOTION), 1.2e-4);
        check("motion", of_sixteen(LINE_OF_MOTION), 7.9e-4);
        check("prediction", known(PREDICTION_MISSES), 1.2e-4);
        check("visible", of_sixteen(VISIBLE_LINE), 2.3e-6);
        check("lone", of_sixteen(LONE_LINE), 2.3e-23);
        check("measured", known(MEASURED_LINE), 3.7e-44);
    }

    #[test]
    fn a_family_of_tests_keeps_its_rate() {
        for (rate, tests) in [(MISSING_TERM_RATE, 1), (MISSING_TERM_RATE, 12), (VIBRATION_RATE, 5000)] {
            let threshold = exponential(rate, tests);
            assert!((tests as f64 * (-threshold).exp() / rate - 1.0).abs() < 1e-12);
            assert!(tests as f64 * chi_squared_upper(2.0 * threshold, 1) < rate);
        }
    }
}
