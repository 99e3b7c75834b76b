//! Fourier integrals accumulated sample by sample, in fixed memory, as a controller needs them.
//!
//! Invariant: a bank of phasors `e^{j 2 pi k n / N}`, one per harmonic, is rotated at every sample and set exactly every
//! [`RESET`] samples, so that its error stays below `RESET` roundings however long the run is. A period is summed by itself
//! before it joins the total, so that rounding grows with the samples of a period plus the number of periods, not their
//! product.

use crate::support::AccumulatorError;
use crate::support::Real;

/// Samples after which the phasors are set exactly again.
const RESET: usize = 64;

/// Harmonics 0 to H of several signals over whole periods of N samples, in memory of the caller.
#[derive(Debug)]
pub struct Accumulator<'m, T: Real> {
    samples_per_period: usize,
    channels: usize,
    harmonics: usize,
    count: usize,
    /// cos and sin of 2 pi k / N for k = 1, ..., H.
    step: &'m mut [T],
    /// cos and sin of 2 pi k n / N at the present sample.
    phasor: &'m mut [T],
    /// Per channel: sum of x, then sums of x cos and x sin per harmonic, over the present period.
    period: &'m mut [T],
    /// The sums over all whole periods so far, in the layout of `period`.
    total: &'m mut [T],
}

impl<'m, T: Real> Accumulator<'m, T> {
    /// Entries of memory that an accumulator of so many channels and harmonics needs.
    #[must_use]
    pub const fn memory_len(channels: usize, harmonics: usize) -> usize {
        4 * harmonics + 2 * channels * (2 * harmonics + 1)
    }

    /// An empty accumulator for `channels` signals, harmonics 0 to `harmonics`, periods of `samples_per_period` samples.
    ///
    /// # Errors
    /// [`AccumulatorError::TooFewSamples`] when a period does not resolve the highest harmonic, [`AccumulatorError::Memory`]
    /// when `memory` is shorter than [`memory_len`](Self::memory_len).
    pub fn new(
        samples_per_period: usize,
        channels: usize,
        harmonics: usize,
        memory: &'m mut [T],
    ) -> Result<Self, AccumulatorError> {
        if samples_per_period < 2 * harmonics + 1 {
            return Err(AccumulatorError::TooFewSamples { samples: samples_per_period, harmonics });
        }
        let needed = Self::memory_len(channels, harmonics);
        let given = memory.len();
        let Some((used, _)) = memory.split_at_mut_checked(needed) else {
            return Err(AccumulatorError::Memory { needed, given });
        };
        let (step, rest) = used.split_at_mut(2 * harmonics);
        let (phasor, rest) = rest.split_at_mut(2 * harmonics);
        let (period, total) = rest.split_at_mut(channels * (2 * harmonics + 1));
        let mut this = Accumulator { samples_per_period, channels, harmonics, count: 0, step, phasor, period, total };
        for (k, pair) in this.step.chunks_exact_mut(2).enumerate() {
            let (sin, cos) = exact_angle::<T>(k + 1, 1, samples_per_period).sin_cos();
            pair[0] = cos;
            pair[1] = sin;
        }
        this.clear();
        Ok(this)
    }

    /// Clears all sums and returns to the state before the first sample.
    ///
    /// ```
    /// # use tpm_controller::harmonics::Accumulator;
    /// let mut memory = [0.0_f64; Accumulator::<f64>::memory_len(1, 1)];
    /// let mut sums = Accumulator::new(8, 1, 1, &mut memory)?;
    /// sums.push(&[1.0])?;
    /// sums.clear();
    /// assert_eq!(sums.count(), 0);
    /// # Ok::<(), tpm_controller::AccumulatorError>(())
    /// ```
    pub fn clear(&mut self) {
        self.count = 0;
        self.period.fill(T::ZERO);
        self.total.fill(T::ZERO);
    }

    /// Number of samples processed since the start.
    #[must_use]
    pub const fn count(&self) -> usize {
        self.count
    }

    /// Processes one sample of every channel.
    ///
    /// # Errors
    /// [`AccumulatorError::Channels`] when the sample has another number of channels; the sums are then unchanged.
    pub fn push(&mut self, sample: &[T]) -> Result<(), AccumulatorError> {
        if sample.len() != self.channels {
            return Err(AccumulatorError::Channels { needed: self.channels, given: sample.len() });
        }
        if self.count.is_multiple_of(RESET) {
            let n = self.count % self.samples_per_period;
            for (k, pair) in self.phasor.chunks_exact_mut(2).enumerate() {
                let (sin, cos) = exact_angle::<T>(k + 1, n, self.samples_per_period).sin_cos();
                pair[0] = cos;
                pair[1] = sin;
            }
        }
        let width = 2 * self.harmonics + 1;
        for (&x, sums) in sample.iter().zip(self.period.chunks_exact_mut(width)) {
            if let Some((mean, lines)) = sums.split_first_mut() {
                *mean += x;
                for (sum, &part) in lines.iter_mut().zip(self.phasor.iter()) {
                    *sum += x * part;
                }
            }
        }
        for (now, by) in self.phasor.chunks_exact_mut(2).zip(self.step.chunks_exact(2)) {
            let (cos, sin) = (now[0], now[1]);
            now[0] = cos * by[0] - sin * by[1];
            now[1] = sin * by[0] + cos * by[1];
        }
        self.count += 1;
        if self.count.is_multiple_of(self.samples_per_period) {
            for (total, period) in self.total.iter_mut().zip(self.period.iter_mut()) {
                *total += *period;
                *period = T::ZERO;
            }
        }
        Ok(())
    }

    /// `(a_c, a_s)` of one harmonic of one channel; `(a_0, 0)` for harmonic 0.
    ///
    /// ```
    /// # use tpm_controller::harmonics::Accumulator;
    /// let mut memory = [0.0_f64; Accumulator::<f64>::memory_len(1, 1)];
    /// let mut sums = Accumulator::new(4, 1, 1, &mut memory)?;
    /// for sample in [5.0, 3.0, 1.0, 3.0] {
    ///     sums.push(&[sample])?;
    /// }
    /// let (cosine, sine) = sums.coefficients(0, 1)?;
    /// assert!((cosine - 2.0_f64).abs() < 1e-12 && sine.abs() < 1e-12);
    /// # Ok::<(), tpm_controller::AccumulatorError>(())
    /// ```
    ///
    /// # Errors
    /// [`AccumulatorError::NotWhole`] unless whole periods were taken in, [`AccumulatorError::Channels`] for a channel that does
    /// not exist, [`AccumulatorError::TooFewSamples`] for a harmonic that was not accumulated.
    pub fn coefficients(&self, channel: usize, harmonic: usize) -> Result<(T, T), AccumulatorError> {
        if channel >= self.channels {
            return Err(AccumulatorError::Channels { needed: self.channels, given: channel });
        }
        if harmonic > self.harmonics {
            return Err(AccumulatorError::TooFewSamples { samples: self.samples_per_period, harmonics: harmonic });
        }
        let beyond = self.count % self.samples_per_period;
        if beyond != 0 || self.count == 0 {
            return Err(AccumulatorError::NotWhole { samples: beyond });
        }
        let width = 2 * self.harmonics + 1;
        let sums = &self.total[channel * width..(channel + 1) * width];
        let total = T::from_f64(self.count as f64);
        if harmonic == 0 {
            return Ok((sums[0] / total, T::ZERO));
        }
        let scale = T::from_f64(2.0) / total;
        Ok((sums[2 * harmonic - 1] * scale, sums[2 * harmonic] * scale))
    }
}

/// 2 pi k n / N with k n reduced modulo N in whole numbers, so that late samples are as exact as early ones.
fn exact_angle<T: Real>(k: usize, n: usize, period: usize) -> T {
    // Both factors are below N, so the product fits 128 bits whatever the platform's word is.
    let reduced = (k as u128 * n as u128 % period as u128) as f64;
    T::from_f64(2.0 * core::f64::consts::PI * reduced / period as f64)
}

#[cfg(test)]
mod tests {
    use super::{Accumulator, AccumulatorError};
    use std::vec;

    #[test]
    fn recovers_a_fourier_series_after_a_million_samples() {
        let n = 997;
        let mut memory = vec![0.0_f64; Accumulator::<f64>::memory_len(2, 9)];
        let mut bank = Accumulator::new(n, 2, 9, &mut memory).expect("memory fits");
        for i in 0..n * 1003 {
            let th = 2.0 * std::f64::consts::PI * (i % n) as f64 / n as f64;
            let x = 0.25 + 3.0 * th.cos() - 2.0 * (9.0 * th).sin();
            bank.push(&[x, (4.0 * th).cos()]).expect("two channels");
        }
        let near = |found: (f64, f64), c: f64, s: f64| {
            assert!((found.0 - c).abs() < 1e-12 && (found.1 - s).abs() < 1e-12, "{found:?} {c} {s}");
        };
        near(bank.coefficients(0, 0).expect("whole"), 0.25, 0.0);
        near(bank.coefficients(0, 1).expect("whole"), 3.0, 0.0);
        near(bank.coefficients(0, 5).expect("whole"), 0.0, 0.0);
        near(bank.coefficients(0, 9).expect("whole"), 0.0, -2.0);
        near(bank.coefficients(1, 4).expect("whole"), 1.0, 0.0);
        bank.push(&[0.0, 0.0]).expect("two channels");
        assert_eq!(bank.coefficients(0, 0), Err(AccumulatorError::NotWhole { samples: 1 }));
    }

    #[test]
    fn faults_are_named() {
        let mut memory = [0.0_f32; 4];
        assert!(matches!(Accumulator::new(8, 1, 4, &mut memory), Err(AccumulatorError::TooFewSamples { .. })));
        assert!(matches!(
            Accumulator::new(9, 1, 4, &mut memory),
            Err(AccumulatorError::Memory { needed: 34, given: 4 })
        ));
    }
}
