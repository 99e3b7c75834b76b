//! A signal by its frequencies, and what linear filters make of it at fewer samples.
//!
//! A discrete transform is periodic, so that a filter wraps the end of a signal round to its beginning. A filter with a smooth response
//! reaches over a short time: samples farther from both ends than this are those of the filtered signal itself.

use num_complex::Complex;
use std::f64::consts::PI;
use tpm_numerics::fourier::{forward, inverse};

/// A signal by its frequencies.
#[derive(Clone, Debug)]
pub(crate) struct Transform {
    bins: Vec<Complex<f64>>,
    /// Points of the transform, no fewer than samples of the signal.
    points: usize,
    sample_time: f64,
}

/// The least number of points, no fewer than `samples`, that has no prime factor above five.
pub(crate) fn quick(samples: usize) -> usize {
    let smooth = |mut n: usize| {
        for factor in [2, 3, 5] {
            while n.is_multiple_of(factor) {
                n /= factor;
            }
        }
        n == 1
    };
    (samples.max(2)..).find(|&n| n.is_multiple_of(2) && smooth(n)).unwrap_or(samples)
}

impl Transform {
    /// The transform of a signal, at `points` points.
    pub(crate) fn new(signal: &[f64], points: usize, sample_time: f64) -> Self {
        let plan = forward(points);
        let mut padded = signal.to_vec();
        // The value at the end goes over into that at the beginning without a step.
        let (first, last) = (signal.first().copied().unwrap_or(0.0), signal.last().copied().unwrap_or(0.0));
        let beyond = points - signal.len();
        padded.extend((1..=beyond).map(|k| last + (first - last) * k as f64 / (beyond + 1) as f64));
        let mut bins = plan.make_output_vec();
        plan.process(&mut padded, &mut bins).expect("invariant: buffers were made for this transform");
        Transform { bins, points, sample_time }
    }

    /// Angular frequency from one bin to the next, rad/s.
    pub(crate) fn spacing(&self) -> f64 {
        2.0 * PI / self.duration()
    }

    /// Time over which the transform reaches, s.
    pub(crate) fn duration(&self) -> f64 {
        self.points as f64 * self.sample_time
    }

    /// Power of every bin.
    pub(crate) fn powers(&self) -> impl Iterator<Item = f64> {
        self.bins.iter().map(|bin| bin.norm_sqr())
    }

    /// This transform with every bin replaced, given its angular frequency (rad/s) and its number.
    pub(crate) fn map(mut self, mut of: impl FnMut(f64, usize, Complex<f64>) -> Complex<f64>) -> Self {
        let spacing = self.spacing();
        for (k, bin) in self.bins.iter_mut().enumerate() {
            *bin = of(k as f64 * spacing, k, *bin);
        }
        self
    }

    /// Number `k` of the bins.
    pub(crate) fn bin(&self, k: usize) -> Complex<f64> {
        self.bins[k]
    }

    /// The signal with the share of every bin that is given, at `points` even times over the time of the transform.
    pub(crate) fn weighted(&self, points: usize, shares: &[f64]) -> Vec<f64> {
        self.by_bin(points, |k| shares[k].into())
    }

    /// What a filter makes of the signal, at `points` even times over the time of the transform; the response, given the angular
    /// frequency (rad/s), must be nothing from half of that rate on.
    pub(crate) fn filtered(&self, points: usize, response: impl Fn(f64) -> Complex<f64>) -> Vec<f64> {
        let spacing = self.spacing();
        self.by_bin(points, |k| response(k as f64 * spacing))
    }

    /// The signal with every bin multiplied by a factor.
    fn by_bin(&self, points: usize, factor: impl Fn(usize) -> Complex<f64>) -> Vec<f64> {
        let plan = inverse(points);
        let mut bins = plan.make_input_vec();
        let scale = 1.0 / self.points as f64;
        let last = bins.len() - 1;
        for (k, (slot, bin)) in bins.iter_mut().zip(&self.bins).enumerate() {
            *slot = bin * factor(k) * scale;
        }
        // A real signal has real bins at no frequency and at half of the rate, which an odd number of points does not reach.
        bins[0] = Complex::new(bins[0].re, 0.0);
        if points.is_multiple_of(2) {
            bins[last] = Complex::new(bins[last].re, 0.0);
        }
        let mut out = plan.make_output_vec();
        plan.process(&mut bins, &mut out)
            .expect("invariant: the ends are real and the buffers were made for this transform");
        out
    }
}

#[cfg(test)]
mod tests {
    use super::{Transform, quick};
    use num_complex::Complex;
    use std::f64::consts::PI;

    #[test]
    fn quick_numbers_are_even_and_smooth() {
        assert_eq!([1, 7, 30, 1001, 10_000_001].map(quick), [2, 8, 30, 1024, 10_077_696]);
    }

    #[test]
    fn a_derivative_at_fewer_points_is_that_of_the_signal() {
        let (samples, h) = (600, 0.01);
        let rate = 2.0 * PI * 3.0 / (samples as f64 * h);
        let signal: Vec<f64> = (0..samples).map(|k| (rate * k as f64 * h).sin()).collect();
        let transform = Transform::new(&signal, samples, h);
        let found = transform.filtered(60, |w| Complex::new(0.0, w));
        for (k, value) in found.iter().enumerate() {
            let expected = rate * (rate * k as f64 * 10.0 * h).cos();
            assert!((value - expected).abs() < 1e-9 * rate, "{k}: {value} {expected}");
        }
    }
}
