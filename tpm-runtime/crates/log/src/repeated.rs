//! Readings that were recorded twice: the sensor had not been read again when the row was written.
//!
//! Between two samples a channel moves by more than its resolution, unless it rests, turns or is a coarse encoder. Where
//!
//! ```text
//! y_k = y_{k-1}   but   |y_{k+1} - y_{k-1}| > 8 r ,      r the step in which the numbers are written,
//! ```
//!
//! the reading y_k is the one before, late by a sample. Rounding makes readings equal too, about as often as it makes them differ by one
//! step, or by two, in a given direction. Readings count as repeated only where there are more equal ones than that by chance. A repeated
//! reading holds no information; it is replaced by the cubic through the two fresh readings on either side.

use crate::steps::Steps;
use std::ops::Range;
use tpm_numerics::through;

/// Most successive readings that repeat; a channel that is constant for longer rests, or is recorded at a lower rate.
pub(super) const MOST_IN_A_ROW: usize = 3;
/// Largest share of repeated readings; a channel with more is recorded at a lower rate than the others, which
/// interpolation cannot mend.
const MOST_REPEATED_SHARE: f64 = 0.2;
/// Least change of the signal across equal readings that rounding does not explain, in steps per reading.
const LEAST_CHANGE: f64 = 4.0;
/// Standard deviations of the number of equal readings that rounding makes (a Poisson variable) by which the number found must exceed it.
const MARGIN_DEVIATIONS: f64 = 5.0;
/// Least number of equal readings, and by which it must exceed that of rounding beside [`MARGIN_DEVIATIONS`].
const MARGIN_COUNT: f64 = 8.0;

/// Indices of the readings that repeat the reading before, each with the value interpolated from the fresh readings
/// around it.
pub(super) fn repeated_readings(signal: &[f64], steps: &Steps) -> Vec<(usize, f64)> {
    // Most channels have too few equal readings to look any further.
    if (signal.windows(2).filter(|pair| pair[0] == pair[1]).count() as f64) < MARGIN_COUNT {
        return Vec::new();
    }
    let step_at = |one: f64, other: f64| steps.at(one.abs().max(other.abs()));
    let changes = |from: usize, to: usize| {
        from > 0
            && to < signal.len()
            && (signal[to] - signal[from - 1]).abs()
                > LEAST_CHANGE * step_at(signal[from - 1], signal[to]) * (to - from + 1) as f64
    };
    let mut runs: Vec<Range<usize>> = Vec::new();
    let mut from = 0;
    while from < signal.len() {
        let to = from + signal[from..].iter().take_while(|value| **value == signal[from]).count().max(1);
        if (2..=MOST_IN_A_ROW + 1).contains(&(to - from)) && changes(from, to) {
            runs.push(from + 1..to);
        }
        from = to;
    }
    let found: usize = runs.iter().map(Range::len).sum();
    if (found as f64) < MARGIN_COUNT || found as f64 > MOST_REPEATED_SHARE * signal.len() as f64 {
        return Vec::new();
    }
    // Rounding makes differences by one or two steps, up or down, four times as often as it makes equal readings, so
    // that their number is a safe bound.
    let close = |k: &usize| {
        let apart = (signal[*k] - signal[*k - 1]).abs() / step_at(signal[*k], signal[*k - 1]);
        apart > 0.0 && apart < 2.5 && changes(*k - 1, *k + 1)
    };
    let chance = (2..signal.len() - 1).filter(close).count() as f64;
    if found as f64 <= chance + MARGIN_DEVIATIONS * chance.sqrt() + MARGIN_COUNT {
        return Vec::new();
    }
    let mut fresh = vec![true; signal.len()];
    runs.iter().for_each(|run| fresh[run.clone()].fill(false));
    let stale = runs.into_iter().flatten();
    stale.filter_map(|k| Some((k, by_fresh(signal, &fresh, k)?))).collect()
}

/// Value at a sample of the cubic through two fresh readings on either side; nothing near the ends.
fn by_fresh(signal: &[f64], fresh: &[bool], k: usize) -> Option<f64> {
    let mut before = (0..k).rev().filter(|&i| fresh[i]);
    let mut after = (k + 1..signal.len()).filter(|&i| fresh[i]);
    let at = [before.next()?, before.next()?, after.next()?, after.next()?];
    Some(through(at.map(|i| i as f64 - k as f64), at.map(|i| signal[i]), 0.0))
}

#[cfg(test)]
mod tests {
    use crate::steps::Steps;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn repeated_readings(signal: &[f64]) -> Vec<(usize, f64)> {
        super::repeated_readings(signal, &Steps::of(signal))
    }

    /// A motion of amplitude one with rests, noise and a step of the readings.
    fn motion(noise: f64, step: f64, speed: f64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let reading = |i: u32| {
            let random: f64 = StandardNormal.sample(&mut rng);
            let th = speed * f64::from(i);
            let x = th.cos() - (3.0 * th).cos() / 9.0 + noise * random;
            if step > 0.0 { (x / step).round() * step } else { x }
        };
        (0..20_000).map(reading).collect()
    }

    #[test]
    fn readings_that_repeat_are_found_and_replaced() {
        for (noise, step) in [(0.0, 0.0), (1e-4, 0.0), (3e-3, 0.0), (1e-4, 1e-6), (0.0, 1e-5)] {
            let clean = motion(noise, step, 0.01);
            assert_eq!(repeated_readings(&clean), [], "{noise} {step}");
            let (mut signal, mut repeated) = (clean.clone(), Vec::new());
            let mut rng = ChaCha8Rng::seed_from_u64(9);
            for k in 10..signal.len() - 10 {
                if rng.random_bool(0.05) {
                    signal[k] = signal[k - 1];
                    repeated.push(k);
                }
            }
            let found = repeated_readings(&signal);
            let all = found.len() as f64 / repeated.len() as f64;
            assert!((0.9..1.05).contains(&all), "{noise} {step}: {} of {}", found.len(), repeated.len());
            for &(k, value) in &found {
                assert!((value - clean[k]).abs() < 1e-4 + 6.0 * noise + step, "{noise} {step}: {value} at {k}");
            }
        }
    }

    #[test]
    fn readings_that_are_equal_by_their_significant_digits_stay() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let reading = |i: u32| {
            let random: f64 = StandardNormal.sample(&mut rng);
            let x: f64 = (1e-4 * f64::from(i)).sin() + 1e-6 * random;
            format!("{x:.6e}").parse().expect("a number")
        };
        let signal: Vec<f64> = (0..200_000).map(reading).collect();
        assert_eq!(repeated_readings(&signal), []);
    }

    #[test]
    fn encoders_rests_turns_and_lower_rates_stay() {
        for speed in [1e-4, 1e-3, 0.01, 0.05] {
            for (noise, step) in [(0.0, 1e-4), (0.0, 1e-3), (1e-4, 1e-3), (1e-5, 1e-3), (0.0, 0.02), (1e-3, 1e-3)] {
                assert_eq!(repeated_readings(&motion(noise, step, speed)), [], "{noise} {step} {speed}");
            }
        }
        let mut rests = motion(0.0, 0.0, 0.01);
        for from in (1000..20_000).step_by(4000) {
            let value = rests[from];
            rests[from..from + 700].fill(value);
        }
        assert_eq!(repeated_readings(&rests), []);
        let held: Vec<f64> = motion(1e-4, 0.0, 0.01).iter().flat_map(|x| [*x; 4]).collect();
        assert_eq!(repeated_readings(&held), []);
        assert_eq!(repeated_readings(&[1.0; 40]), []);
        assert_eq!(repeated_readings(&[]), []);
    }
}
