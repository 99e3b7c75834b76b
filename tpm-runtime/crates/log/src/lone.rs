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
//! two samples after it. No jump or noise of a motion has this pattern. A bend, where an input of a machine of first order steps, comes near
//! it: it gives `d = b (0, -1/2, 1, -1/2, 0)` at a sample, and between two samples a mean of this for either of them. Which of the two it is, is
//! told by what either leaves of five distances, weighted by the inverse of their covariance: that of readings with independent noise is
//! `cov(d_i, d_j) = (-1)^(i-j) binomial(8, 4 + i - j) / 36` of the noise's variance.

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

/// The pattern of d about a single reading that is wrong.
const LONE: [f64; 5] = [1.0 / 6.0, -2.0 / 3.0, 1.0, -2.0 / 3.0, 1.0 / 6.0];
/// The pattern of d about a bend at the third of five samples.
const BEND: [f64; 5] = [0.0, -0.5, 1.0, -0.5, 0.0];

/// Inverse of the covariance of d at five samples in sequence, but for a factor.
const PRECISION: [[f64; 5]; 5] = [
    [196.0, 392.0, 420.0, 280.0, 98.0],
    [392.0, 931.0, 1092.0, 770.0, 280.0],
    [420.0, 1092.0, 1431.0, 1092.0, 420.0],
    [280.0, 770.0, 1092.0, 931.0, 392.0],
    [98.0, 280.0, 420.0, 392.0, 196.0],
];

/// The product of two patterns, weighted by the precision.
fn dot(one: &[f64; 5], other: &[f64; 5]) -> f64 {
    let weighted = PRECISION.iter().map(|row| row.iter().zip(other).map(|(weight, other)| weight * other).sum::<f64>());
    one.iter().zip(weighted).map(|(one, other)| one * other).sum()
}

/// Sum of squares that a multiple of a pattern leaves.
fn left_by(d: &[f64; 5], pattern: &[f64; 5]) -> f64 {
    dot(d, d) - dot(d, pattern).powi(2) / dot(pattern, pattern)
}

/// Sum of squares that a bend at the third of five samples, or between it and one of its neighbours, leaves.
fn left_by_bend(d: &[f64; 5]) -> f64 {
    let beside = [[-0.5, 1.0, -0.5, 0.0, 0.0], [0.0, 0.0, -0.5, 1.0, -0.5]].map(|other| {
        let (own, cross, size) = (dot(&BEND, &BEND), dot(&BEND, &other), dot(&other, &other));
        let (near, far) = (dot(d, &BEND), dot(d, &other));
        let determinant = own * size - cross * cross;
        let parts = [(size * near - cross * far) / determinant, (own * far - cross * near) / determinant];
        // Both are parts of one bend.
        if parts[0] * parts[1] > 0.0 { dot(d, d) - parts[0] * near - parts[1] * far } else { f64::INFINITY }
    });
    beside.into_iter().fold(left_by(d, &BEND), f64::min)
}

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
    let bent = |k: usize| {
        let d: [f64; 5] = std::array::from_fn(|at| apart(k + at - 2));
        left_by_bend(&d) <= left_by(&d, &LONE)
    };
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
            && !bent(k)
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

    /// A temperature under a heater that is switched: it bends at every switch, by amounts of all sizes.
    #[test]
    fn bends_stay() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        for noise in [0.0, 0.01, 0.05] {
            let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
            let (mut slope, mut value, mut signal) = (0.0, 0.0, Vec::new());
            for i in 0..30_000 {
                signal.push(value + noise * draw());
                if i % 30 == 0 {
                    // A switch falls between two readings too.
                    let (next, at) = (3.0 * draw(), draw().abs().fract());
                    value += at * slope + (1.0 - at) * next;
                    slope = next;
                } else {
                    value += slope;
                }
            }
            assert_eq!(lone_readings(&signal), [], "{noise}");
        }
    }

    #[test]
    fn the_precision_is_the_inverse_of_the_covariance() {
        let covariance = |i: usize, j: usize| [70.0, -56.0, 28.0, -8.0, 1.0][i.abs_diff(j)];
        for (i, row) in super::PRECISION.iter().enumerate() {
            for j in 0..5 {
                let entry: f64 = row.iter().enumerate().map(|(k, weight)| weight * covariance(k, j)).sum();
                assert_eq!(entry, if i == j { 1386.0 } else { 0.0 }, "{i} {j}");
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
