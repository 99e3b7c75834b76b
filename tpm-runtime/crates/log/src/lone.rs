//! Outliers of a single sample: a sensor that failed for one sample, or a line that was lost and written as zero.
//!
//! A motion is smooth from sample to sample, so that a reading lies close to the cubic through its four neighbours. Its
//! distance from that cubic is
//!
//! ```text
//! d_k = y_k - (-y_{k-2} + 4 y_{k-1} + 4 y_{k+1} - y_{k+2}) / 6 .
//! ```
//!
//! One reading that is wrong by `s` among right ones gives `d = s (1/6, -2/3, 1, -2/3, 1/6)` from two samples before to
//! two samples after it. No jump, bend or noise of a motion has this pattern.

use crate::steps::Steps;
use tpm_numerics::differences::deviation_of;

/// Weights of the neighbours in the cubic: of the two outer ones, then of the two inner ones.
const WEIGHTS: [f64; 2] = [-1.0 / 6.0, 4.0 / 6.0];
/// Detection threshold of |d_k|, in standard deviations of d over the signal: far beyond noise.
const NOISE_THRESHOLD: f64 = 12.0;
/// Detection threshold of |d_k|, in least steps of the readings: the rounding errors of five readings together are
/// smaller.
const STEP_THRESHOLD: f64 = 4.0;
/// Tolerance on the pattern of d at the four neighbours, as a share of the detection threshold.
const MOST_OFF_PATTERN: f64 = 1.0 / 3.0;

/// Indices of the outliers, each with the value interpolated from its four neighbours, in the signal's unit. `steps` are those in which the
/// signal's numbers are written.
pub fn lone_readings(signal: &[f64], steps: &Steps) -> Vec<(usize, f64)> {
    if signal.len() < 9 {
        return Vec::new();
    }
    let by_neighbours =
        |k: usize| WEIGHTS[0] * (signal[k - 2] + signal[k + 2]) + WEIGHTS[1] * (signal[k - 1] + signal[k + 1]);
    let apart = |k: usize| signal[k] - by_neighbours(k);
    let usual = deviation_of((2..signal.len() - 2).map(|k| apart(k).abs()));
    let far = (NOISE_THRESHOLD * usual).max(STEP_THRESHOLD * steps.least());
    let alone = |k: usize| {
        let size = apart(k);
        let near = |at: usize, weight: f64| (apart(at) + weight * size).abs() <= MOST_OFF_PATTERN * far;
        // A reading that was recorded twice is late by a sample, which is no fault of one reading.
        let twice = signal[k].to_bits() == signal[k - 1].to_bits() || signal[k].to_bits() == signal[k + 1].to_bits();
        size.abs() > far
            && !twice
            && near(k - 1, WEIGHTS[1])
            && near(k + 1, WEIGHTS[1])
            && near(k - 2, WEIGHTS[0])
            && near(k + 2, WEIGHTS[0])
    };
    (4..signal.len() - 4).filter(|&k| alone(k)).map(|k| (k, by_neighbours(k))).collect()
}

#[cfg(test)]
mod tests {
    use crate::steps::Steps;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn lone_readings(signal: &[f64]) -> Vec<(usize, f64)> {
        super::lone_readings(signal, &Steps::of(signal))
    }

    fn motion(noise: f64, step: f64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let reading = |i: u32| {
            let random: f64 = StandardNormal.sample(&mut rng);
            let th = 0.01 * f64::from(i);
            let x = th.cos() - (3.0 * th).cos() / 9.0 + noise * random;
            if step > 0.0 { (x / step).round() * step } else { x }
        };
        (0..20_000).map(reading).collect()
    }

    #[test]
    fn single_wrong_readings_are_found_and_nothing_else() {
        for (noise, step) in [(0.0, 0.0), (1e-3, 0.0), (0.0, 1e-3), (1e-4, 1e-3), (3e-3, 1e-3)] {
            let mut signal = motion(noise, step);
            assert_eq!(lone_readings(&signal), [], "{noise} {step}");
            let wrong = [40, 777, 5_000, 5_011, 19_000];
            let right: Vec<f64> = wrong.iter().map(|&k| signal[k]).collect();
            wrong.iter().for_each(|&k| signal[k] = if signal[k].abs() > 0.1 { 0.0 } else { 1.0 });
            let found = lone_readings(&signal);
            assert_eq!(found.iter().map(|of| of.0).collect::<Vec<_>>(), wrong, "{noise} {step}");
            for ((_, value), right) in found.iter().zip(right) {
                assert!((value - right).abs() < 1e-3 + 4.0 * noise.max(step), "{value} {right}");
            }
        }
    }

    #[test]
    fn jumps_rests_and_repeated_readings_stay() {
        let mut signal = motion(1e-4, 0.0);
        signal[3000..].iter_mut().for_each(|x| *x += 0.5);
        let rest = signal[8000];
        signal[8000..12_000].fill(rest);
        (13_000..20_000).step_by(20).for_each(|k| signal[k] = signal[k - 1]);
        assert_eq!(lone_readings(&signal), []);
    }
}
