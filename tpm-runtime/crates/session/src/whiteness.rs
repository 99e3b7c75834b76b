//! Tests of one-step prediction errors: whether they are white, and independent of the inputs before them (Ljung, System
//! Identification, 16.6).
//!
//! Where the model and its noise are right, prediction errors in units of their deviations are white: they are independent of everything
//! before them. Both tests are chi-squared tests over [`LAGS`] lags and give a false alarm with chance [`FALSE_ALARM`] each.
//!
//! - Whiteness: `Q = N (N + 2) sum r_l^2 / (N - l)` of the autocorrelations r_l (Ljung and Box).
//! - Independence of an input: `b' G^-1 b` of the products `b_l = sum e_k u_{k-l}` and their covariance G, which is the information
//!   matrix of the past inputs where the errors are white; autocorrelations beyond their band add to it, with Bartlett's weights. Lags are
//!   positive: in a closed loop later inputs follow from earlier errors, and that says nothing about the model.
//!
//! A long record rejects every model but a perfect one, since it shows the smallest misfit. The fits say how large the misfit is.

use serde::Serialize;
use tpm_numerics::tail::chi_squared_upper;
use tpm_numerics::{DMatrix, DVector, alarm, tolerance};

/// Lags over which correlations are tested.
pub const LAGS: usize = 25;
/// Chance that a test fails although the model is right.
pub const FALSE_ALARM: f64 = alarm::WHITENESS_RATE;
/// Fewest samples that are tested, in units of the lags.
const LEAST_SAMPLES_PER_LAG: usize = 4;

/// A test of correlations.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CorrelationTest {
    /// The correlations at lags 1, 2, ...
    pub correlations: Vec<f64>,
    /// Where the model is right, each of them is beyond this size with the chance of a false alarm.
    pub band: f64,
    /// The statistic of all of them together.
    pub statistic: f64,
    /// Its degrees of freedom: it is chi-squared where the model is right.
    pub freedom: usize,
    /// Chance of a statistic as large where the model is right.
    pub chance: f64,
    /// Whether that chance is no less than the chance of a false alarm.
    pub passed: bool,
}

impl CorrelationTest {
    fn new(correlations: Vec<f64>, band: f64, statistic: f64, freedom: usize) -> Self {
        let chance = chi_squared_upper(statistic, freedom);
        CorrelationTest { correlations, band, statistic, freedom, chance, passed: chance >= FALSE_ALARM }
    }

    /// The largest correlation, and its lag in samples.
    #[must_use]
    pub fn largest(&self) -> (f64, usize) {
        let lags = self.correlations.iter().zip(1..);
        lags.fold(
            (0.0, 0),
            |largest: (f64, usize), (&r, lag)| if r.abs() > largest.0.abs() { (r, lag) } else { largest },
        )
    }

    /// Number of correlations beyond their band.
    #[must_use]
    pub fn outside(&self) -> usize {
        self.correlations.iter().filter(|r| r.abs() > self.band).count()
    }
}

/// Tests whether prediction errors are white, stretch by stretch; nothing where there are too few.
pub(super) fn whiteness(stretches: &[&[f64]]) -> Option<CorrelationTest> {
    let count: usize = stretches.iter().map(|e| e.len()).sum();
    let power: f64 = stretches.iter().flat_map(|e| e.iter()).map(|e| e * e).sum();
    if count < LEAST_SAMPLES_PER_LAG * LAGS || power <= 0.0 {
        return None;
    }
    let n = count as f64;
    let correlations: Vec<f64> = (1..=LAGS).map(|lag| products(stretches, lag) / power).collect();
    let terms = correlations.iter().zip(1..).map(|(r, lag)| r * r / (n - f64::from(lag)));
    let statistic = n * (n + 2.0) * terms.sum::<f64>();
    Some(CorrelationTest::new(correlations, alarm::WHITENESS_BAND / n.sqrt(), statistic, LAGS))
}

/// Sum of the products of errors that are `lag` samples apart.
fn products(stretches: &[&[f64]], lag: usize) -> f64 {
    let of = |e: &&[f64]| e.iter().zip(e.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>();
    stretches.iter().map(of).sum()
}

/// Tests whether prediction errors are independent of an input before them, stretch by stretch; nothing where there are too few, or the
/// input is constant. `white` has the autocorrelations of the errors.
pub(super) fn independence(
    stretches: &[&[f64]],
    inputs: &[&[f64]],
    white: &CorrelationTest,
) -> Option<CorrelationTest> {
    let all = || inputs.iter().flat_map(|u| u.iter());
    let samples = all().count().max(1) as f64;
    let mean = all().sum::<f64>() / samples;
    let size = (all().map(|u| (u - mean).powi(2)).sum::<f64>() / samples).sqrt();
    if size <= 0.0 {
        return None;
    }
    let mut sums = DVector::<f64>::zeros(LAGS);
    let mut information = DMatrix::<f64>::zeros(LAGS, LAGS);
    let (mut power, mut count) = (0.0, 0.0);
    for (errors, input) in stretches.iter().zip(inputs) {
        let (first, length) = (LAGS, errors.len());
        if length <= first {
            continue;
        }
        let u: Vec<f64> = input.iter().map(|u| (u - mean) / size).collect();
        for (k, error) in errors.iter().enumerate().skip(first) {
            power += error * error;
            count += 1.0;
            for (sum, past) in sums.iter_mut().zip(u[k - LAGS..k].iter().rev()) {
                *sum += error * past;
            }
        }
        let past = |lag: usize| &u[first - lag..length - lag];
        let mut own = DMatrix::<f64>::zeros(LAGS, LAGS);
        for b in 1..=LAGS {
            own[(0, b - 1)] = past(1).iter().zip(past(b)).map(|(x, y)| x * y).sum();
        }
        // From one pair of lags to the next the products change by the two ends alone.
        for a in 2..=LAGS {
            for b in a..=LAGS {
                own[(a - 1, b - 1)] = own[(a - 2, b - 2)] + u[first - a] * u[first - b] - u[length - a] * u[length - b];
            }
        }
        information += own;
    }
    if count < (LEAST_SAMPLES_PER_LAG * LAGS) as f64 || power <= 0.0 {
        return None;
    }
    let variance = power / count;
    let correlations: Vec<f64> = sums.iter().map(|sum| sum / count / variance.sqrt()).collect();
    // Errors that are not white make products of neighbouring samples depend on each other.
    // Without the weights the covariance of estimated correlations need not be positive.
    let weight = |lag: usize| 1.0 - lag as f64 / (LAGS + 1) as f64;
    let beyond = white.correlations.iter().zip(1..).filter(|(r, _)| r.abs() > white.band);
    let coloured: Vec<(usize, f64)> = beyond.map(|(r, lag)| (lag, weight(lag) * r)).collect();
    let centred: Vec<Vec<f64>> = inputs.iter().map(|u| u.iter().map(|u| (u - mean) / size).collect()).collect();
    let centred: Vec<&[f64]> = centred.iter().map(Vec::as_slice).collect();
    let reach = if coloured.is_empty() { 0 } else { 2 * LAGS };
    let shifted: Vec<f64> = (0..reach).map(|lag| products(&centred, lag)).collect();
    let at = |lag: usize| shifted.get(lag).copied().unwrap_or(0.0);
    for a in 0..LAGS {
        for b in a..LAGS {
            let apart = b - a;
            let added: f64 = coloured.iter().map(|&(lag, r)| r * (at(lag + apart) + at(lag.abs_diff(apart)))).sum();
            information[(a, b)] += added;
            information[(b, a)] = information[(a, b)];
        }
    }
    let band = alarm::WHITENESS_BAND * (information[(0, 0)].max(0.0)).sqrt() / count;
    let eigen = information.symmetric_eigen();
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let (mut statistic, mut freedom) = (0.0, 0);
    for (i, &value) in eigen.eigenvalues.iter().enumerate().filter(|(_, value)| **value > tolerance::GRAM * largest) {
        statistic += eigen.eigenvectors.column(i).dot(&sums).powi(2) / (value * variance);
        freedom += 1;
    }
    (freedom > 0).then(|| CorrelationTest::new(correlations, band, statistic, freedom))
}

#[cfg(test)]
mod tests {
    use super::{FALSE_ALARM, LAGS, independence, whiteness};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SAMPLES: usize = 1000;
    const SEEDS: u64 = 400;

    fn noise(seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..SAMPLES).map(|_| Distribution::<f64>::sample(&StandardNormal, &mut rng)).collect()
    }

    /// A slow input, of which most past values say the same.
    fn slow() -> Vec<f64> {
        (0..SAMPLES).map(|k| (0.02 * k as f64).sin() + 0.3 * (0.11 * k as f64).cos() + 2.0).collect()
    }

    /// At most so many false alarms of [`SEEDS`] tests are chance with 99.9 %: the upper end of the binomial distribution.
    const MOST: usize = 12;

    #[test]
    fn white_errors_give_as_many_false_alarms_as_stated() {
        assert_eq!(FALSE_ALARM * SEEDS as f64, 4.0);
        let u = slow();
        let of = |seed: u64| {
            let e = noise(seed);
            let (first, second) = e.split_at(400);
            let white = whiteness(&[first, second]).expect("many");
            let apart = independence(&[first, second], &[&u[..400], &u[400..]], &white).expect("many");
            assert!(apart.freedom < LAGS, "{}", apart.freedom);
            (white.passed, apart.passed)
        };
        let found: Vec<(bool, bool)> = (0..SEEDS).map(of).collect();
        let [white, apart] = [found.iter().filter(|f| !f.0).count(), found.iter().filter(|f| !f.1).count()];
        println!("false alarms of {SEEDS}: whiteness {white}, independence {apart}");
        assert!(white <= MOST && apart <= MOST, "{white} {apart}");
    }

    #[test]
    fn coloured_errors_are_not_taken_for_dependent_ones() {
        let u = noise(1_000_000);
        let alarms = (0..SEEDS).filter(|&seed| {
            let mut e = noise(seed);
            for k in 1..e.len() {
                e[k] += 0.7 * e[k - 1];
            }
            let white = whiteness(&[&e]).expect("many");
            assert!(!white.passed && (white.largest().0 - 0.7).abs() < 0.15 && white.largest().1 == 1);
            !independence(&[&e], &[&u], &white).expect("many").passed
        });
        let alarms = alarms.count();
        println!("false alarms of independence beside coloured errors: {alarms} of {SEEDS}");
        assert!(alarms <= MOST, "{alarms}");
    }

    #[test]
    fn errors_that_follow_an_input_are_found() {
        let (u, mut e) = (noise(7), noise(8));
        for k in 3..e.len() {
            e[k] += 0.3 * u[k - 3];
        }
        let white = whiteness(&[&e]).expect("many");
        let found = independence(&[&e], &[&u], &white).expect("many");
        assert!(!found.passed && found.largest().1 == 3 && found.outside() >= 1, "{found:?}");
        assert_eq!(whiteness(&[&e[..50]]), None);
        assert_eq!(independence(&[&e], &[&e.iter().map(|_| 1.0).collect::<Vec<f64>>()], &white), None);
    }
}
