//! Least-squares smoothing of a sampled signal and of its rate, sample by sample.
//!
//! A polynomial of degree d is fitted to the last N samples; its value and slope at the newest one are
//!
//! ```text
//! p[n] = sum_i a_i x[n-i] ,   v[n] = sum_i b_i x[n-i] ,   i = 0 .. N-1
//! ```
//!
//! (Savitzky and Golay's filter at the end of its window, where a control loop needs it; Feng, 5.3, smooths positions and
//! velocities by least squares.) Invariant: a polynomial of degree d passes unchanged, with its derivative, once N samples of it
//! are in; the response is that of the finite sums, exactly. After the start nothing allocates.

use num_complex::Complex;
use serde::{Deserialize, Serialize};
use tpm_numerics::{DMatrix, DVector};

/// Highest degree of the polynomial.
pub const MOST_DEGREE: usize = 5;
/// Most samples in the window: each is a state of the loop whose stability is checked.
pub const MOST_SAMPLES: usize = 100;

/// The length of the window and the degree of the polynomial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Smoothing {
    /// Samples to which the polynomial is fitted.
    pub samples: usize,
    /// Degree of the polynomial.
    pub degree: usize,
}

impl Smoothing {
    /// Whether the degree lies between 1 and [`MOST_DEGREE`].
    #[must_use]
    pub const fn has_degree(self) -> bool {
        self.degree >= 1 && self.degree <= MOST_DEGREE
    }

    /// Whether there are more samples than the degree, and at most [`MOST_SAMPLES`].
    #[must_use]
    pub const fn has_samples(self) -> bool {
        self.samples > self.degree && self.samples <= MOST_SAMPLES
    }

    /// Weights of the samples, the newest first, in the value and in the slope (1/s) for samples every `sample_time`
    /// seconds. The degree is lowered to at most one less than the number of samples, which determine no higher one.
    #[must_use]
    pub fn weights(self, sample_time: f64) -> (Vec<f64>, Vec<f64>) {
        let count = self.samples.max(2);
        let degree = self.degree.clamp(1, count - 1);
        // Times in windows, so that the powers are of one size.
        let window = (count - 1) as f64;
        let powers = DMatrix::from_fn(count, degree + 1, |i, k| (-(i as f64) / window).powi(k as i32));
        let (q, r) = powers.qr().unpack();
        // Value and slope at the newest sample are the first two coefficients c of the fit `R c = Q' x`.
        let weights = |coefficient: usize, scale: f64| {
            let unit = DVector::from_fn(degree + 1, |k, _| if k == coefficient { scale } else { 0.0 });
            let solved =
                r.tr_solve_upper_triangular(&unit).expect("invariant: powers of distinct times are independent");
            (&q * solved).iter().copied().collect()
        };
        (weights(0, 1.0), weights(1, 1.0 / (window * sample_time)))
    }

    /// Responses of value and slope at the angular frequency W (rad/s).
    #[must_use]
    pub fn responses(self, frequency: f64, sample_time: f64) -> (Complex<f64>, Complex<f64>) {
        let (value, slope) = self.weights(sample_time);
        let sum = |weights: &[f64]| {
            let turned = |(i, weight): (usize, &f64)| Complex::from_polar(*weight, -frequency * sample_time * i as f64);
            weights.iter().enumerate().map(turned).sum()
        };
        (sum(&value), sum(&slope))
    }
}

/// The filter at work on one signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoother {
    value: Vec<f64>,
    slope: Vec<f64>,
    /// The last samples as a ring, and the place of the newest.
    past: Vec<f64>,
    newest: usize,
    begun: bool,
}

impl Smoother {
    /// A filter for samples every `sample_time` seconds.
    #[must_use]
    pub fn new(smoothing: Smoothing, sample_time: f64) -> Self {
        let (value, slope) = smoothing.weights(sample_time);
        Smoother { past: vec![0.0; value.len()], value, slope, newest: 0, begun: false }
    }

    /// Takes in one sample and returns value and slope. The signal is taken as constant before its first sample.
    pub fn push(&mut self, sample: f64) -> (f64, f64) {
        if !self.begun {
            self.past.fill(sample);
            self.begun = true;
        }
        self.newest = self.newest.checked_sub(1).unwrap_or(self.past.len() - 1);
        self.past[self.newest] = sample;
        let (older, newer) = self.past.split_at(self.newest);
        let weighed = newer.iter().chain(older).zip(self.value.iter().zip(&self.slope));
        weighed.fold((0.0, 0.0), |(value, slope), (x, (a, b))| (value + a * x, slope + b * x))
    }
}

#[cfg(test)]
mod tests {
    use super::{Smoother, Smoothing};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SAMPLE_TIME: f64 = 1e-3;

    #[test]
    fn polynomials_pass_with_their_derivatives() {
        for (samples, degree) in [(2, 1), (5, 2), (15, 2), (40, 3), (100, 5)] {
            let mut smoother = Smoother::new(Smoothing { samples, degree }, SAMPLE_TIME);
            let curve = |t: f64| (0..=degree).map(|k| (k as f64 + 1.0) * t.powi(k as i32)).sum::<f64>();
            let slope = |t: f64| (1..=degree).map(|k| (k * (k + 1)) as f64 * t.powi(k as i32 - 1)).sum::<f64>();
            for n in 0..300 {
                let t = SAMPLE_TIME * f64::from(n) - 0.15;
                let (value, rate) = smoother.push(curve(t));
                if n as usize + 1 >= samples {
                    assert!((value - curve(t)).abs() < 1e-12, "{samples} {degree}: {value} {}", curve(t));
                    assert!((rate / slope(t) - 1.0).abs() < 1e-7, "{samples} {degree}: {rate} {}", slope(t));
                }
            }
        }
    }

    #[test]
    fn straight_lines_have_the_weights_of_the_textbook() {
        // Regression on N points: slope weights 12 (m - i) / (N (N^2 - 1)) about the middle m, variances (4N-2)/(N(N+1)),
        // 12/(N(N^2-1)).
        let n = 9.0_f64;
        let (value, slope) = Smoothing { samples: 9, degree: 1 }.weights(1.0);
        for (i, weight) in slope.iter().enumerate() {
            assert!((weight - 12.0 * (4.0 - i as f64) / (n * (n * n - 1.0))).abs() < 1e-14);
        }
        let power = |weights: &[f64]| weights.iter().map(|w| w * w).sum::<f64>();
        assert!((power(&value) - (4.0 * n - 2.0) / (n * (n + 1.0))).abs() < 1e-14);
        assert!((power(&slope) - 12.0 / (n * (n * n - 1.0))).abs() < 1e-14);
    }

    #[test]
    fn white_noise_leaves_with_the_weights_power() {
        let smoothing = Smoothing { samples: 21, degree: 2 };
        let (value, slope) = smoothing.weights(SAMPLE_TIME);
        let mut smoother = Smoother::new(smoothing, SAMPLE_TIME);
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let (count, mut sums) = (200_000, [0.0, 0.0]);
        for _ in 0..count {
            let noise: f64 = StandardNormal.sample(&mut random);
            let (v, r) = smoother.push(noise);
            sums[0] += v * v / f64::from(count);
            sums[1] += r * r / f64::from(count);
        }
        for (found, weights) in sums.into_iter().zip([value, slope]) {
            let expected = weights.iter().map(|w| w * w).sum::<f64>();
            assert!((found / expected - 1.0).abs() < 0.03, "{found} {expected}");
        }
    }

    #[test]
    fn the_response_is_that_of_the_filter() {
        let smoothing = Smoothing { samples: 15, degree: 2 };
        let frequency = 60.0;
        let (value, rate) = smoothing.responses(frequency, SAMPLE_TIME);
        let mut smoother = Smoother::new(smoothing, SAMPLE_TIME);
        for n in 0..2000 {
            let phase = frequency * SAMPLE_TIME * f64::from(n);
            let (v, r) = smoother.push(phase.cos());
            if n > 20 {
                assert!((v - (value.re * phase.cos() - value.im * phase.sin())).abs() < 1e-12);
                assert!((r - (rate.re * phase.cos() - rate.im * phase.sin())).abs() < 1e-9);
            }
        }
        // Slow motion passes as it is.
        let (value, rate) = smoothing.responses(1.0, SAMPLE_TIME);
        assert!((value - 1.0).norm() < 1e-5 && (rate.im - 1.0).abs() < 1e-3);
    }
}
