//! Harmonics of recorded signals, with the covariance of their noise.
//!
//! Invariant: the lines are those of the trigonometric polynomial that fits the windowed record best. For a whole number
//! of samples per period that is one Fourier transform (its bins at multiples of the number of periods); otherwise the
//! normal equations of the fit, a Hermitian Toeplitz matrix with a condition near one, are solved. The noise of a line is
//! estimated from the bins of the same windowed transform between the lines, where a periodic signal vanishes.

use crate::{mean_error, noise_variance};
use num_complex::Complex;
use rayon::prelude::*;
use std::f64::consts::PI;
use tpm_numerics::fourier::{analyse, forward, synthesise};
use tpm_numerics::{Cholesky, DMatrix, DVector, Dyn, Iteration, alarm};

/// Highest harmonic that is fitted when the period is not a whole number of samples; it bounds the size of the linear system.
const HIGHEST_FITTED: usize = 256;
/// Least noise variance, in counts squared, that dithers the quantiser: from it on the mean rounding error is less
/// steep than the motion, since its slope 2 exp(-2 pi^2 s^2) is below one.
const LEAST_DITHER: f64 = std::f64::consts::LN_2 / (2.0 * PI * PI);
/// The fixed-point iteration between a motion and its mean rounding error; the largest change of the motion is in counts.
const ROUNDING_ITERATION: Iteration = Iteration { most: 50, settled: 1e-6 };
/// Least number of bins between the lines that one noise estimate averages.
const LEAST_NOISE_BINS: usize = 16;

/// Weight of the samples of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Window {
    /// Equal weights, for records of fewer than four periods, where a Hann window would mix neighbouring lines.
    Rectangular,
    /// `1 - cos`: motion that is not periodic (noise passed round a control loop) does not leak into the lines.
    Hann,
}

impl Window {
    /// Hann from four whole periods on.
    #[must_use]
    pub const fn for_periods(periods: usize) -> Self {
        if periods >= 4 { Window::Hann } else { Window::Rectangular }
    }

    /// Weight of sample i of n, the weights summing to one.
    fn weight(self, i: usize, n: usize) -> f64 {
        let even = 1.0 / n as f64;
        match self {
            Window::Rectangular => even,
            Window::Hann => even * (1.0 - (2.0 * PI * i as f64 / n as f64).cos()),
        }
    }

    /// Noise bandwidth in bins: N times the sum of the squared weights.
    pub const fn bandwidth(self) -> f64 {
        match self {
            Window::Rectangular => 1.0,
            Window::Hann => 1.5,
        }
    }

    /// Half width, in bins, of the neighbourhood of a line that the line itself fills.
    pub const fn guard(self) -> f64 {
        match self {
            Window::Rectangular => 0.5,
            Window::Hann => 1.5,
        }
    }
}

impl std::fmt::Display for Window {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Window::Rectangular => "rectangular",
            Window::Hann => "hann",
        })
    }
}

/// Why a record has no harmonics.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpectrumError {
    /// Less than one period.
    #[error("the record has {samples} samples, one period needs {period}")]
    TooShort {
        /// Samples in the record.
        samples: usize,
        /// Samples in a period.
        period: f64,
    },
    /// Not even the first harmonic is resolved.
    #[error("a period of {period} samples resolves no harmonic; sample faster")]
    TooCoarse {
        /// Samples in a period.
        period: f64,
    },
    /// The record does not determine the harmonics: the normal equations are singular.
    #[error("the harmonics cannot be told apart on {samples} samples; use a whole number of periods, at least two")]
    Singular {
        /// Samples in the record.
        samples: usize,
    },
}

/// Harmonics of several signals over the same whole periods.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Spectra {
    /// Fundamental angular frequency, rad/s.
    pub fundamental: f64,
    /// Time between samples, s.
    pub sample_time: f64,
    /// Samples in a period, perhaps not whole.
    pub samples_per_period: f64,
    /// Whole periods in the record.
    pub periods: usize,
    /// Window that was used.
    pub window: Window,
    /// Per channel, per harmonic: the one-sided phasor a_c - j a_s (the mean at 0).
    pub lines: Vec<Vec<Complex<f64>>>,
    /// Per harmonic: covariance of the noise of the channels' phasors, E[n n^H], signal units squared (of the means at 0).
    pub noise: Vec<DMatrix<Complex<f64>>>,
    /// Bins that each noise estimate averages; 0 when the record has one period only.
    pub noise_bins: usize,
    /// Per channel: the step of the quantiser, when all values are whole multiples of one step apart; zero otherwise.
    pub steps: Vec<f64>,
    /// Per channel: whether the motion rests in every period, so that the same counts are read repeatedly.
    pub rests: Vec<bool>,
    /// Per channel: the windowed transform, its weights summing to one (of the residual of the fit for broken periods).
    pub bins: Vec<Vec<Complex<f64>>>,
}

impl Spectra {
    /// The spectra of some of the channels, in the order given.
    ///
    /// # Panics
    /// When there is no such channel.
    #[must_use]
    pub fn select(&self, channels: &[usize]) -> Self {
        let n = channels.len();
        Spectra {
            lines: channels.iter().map(|&c| self.lines[c].clone()).collect(),
            noise: self
                .noise
                .iter()
                .map(|noise| DMatrix::from_fn(n, n, |r, c| noise[(channels[r], channels[c])]))
                .collect(),
            steps: channels.iter().map(|&c| self.steps[c]).collect(),
            rests: channels.iter().map(|&c| self.rests[c]).collect(),
            bins: if self.bins.is_empty() {
                Vec::new()
            } else {
                channels.iter().map(|&c| self.bins[c].clone()).collect()
            },
            ..*self
        }
    }

    /// Analyses the first `periods` whole periods of every channel (equal lengths).
    ///
    /// # Errors
    /// [`SpectrumError::TooShort`] when a channel is shorter than the periods, [`SpectrumError::TooCoarse`] when a period has
    /// fewer than three samples, [`SpectrumError::Singular`] when a broken period does not tell its harmonics apart.
    pub fn analyse(
        channels: &[&[f64]],
        sample_time: f64,
        samples_per_period: f64,
        periods: usize,
    ) -> Result<Self, SpectrumError> {
        let whole = is_whole(samples_per_period);
        // Negative or missing periods become zero samples, which is refused below.
        let used = (samples_per_period * periods as f64 + 1e-6).floor().max(0.0) as usize;
        let samples = channels.iter().map(|c| c.len()).min().unwrap_or(0);
        if used == 0 || used > samples {
            return Err(SpectrumError::TooShort { samples, period: samples_per_period });
        }
        let resolved = (((samples_per_period - 1.0) / 2.0).floor()).max(0.0) as usize;
        if resolved == 0 {
            return Err(SpectrumError::TooCoarse { period: samples_per_period });
        }
        let window = Window::for_periods(periods);
        let weights: Vec<f64> = (0..used).map(|i| window.weight(i, used)).collect();
        let transform = forward(used);
        let highest = if whole { resolved } else { resolved.min(HIGHEST_FITTED) };
        let fit = if whole {
            None
        } else {
            Some(LineFit::new(&weights, samples_per_period, highest).ok_or(SpectrumError::Singular { samples: used })?)
        };
        let of = |channel: &&[f64]| {
            let signal = &channel[..used];
            let fitted = fit.as_ref().map(|fit| fit.solve(signal, &weights));
            let mut windowed = match (&fit, &fitted) {
                (Some(fit), Some(found)) => fit.residual(signal, found),
                _ => signal.to_vec(),
            };
            windowed.iter_mut().zip(&weights).for_each(|(x, w)| *x *= w);
            let mut spectrum = transform.make_output_vec();
            transform.process(&mut windowed, &mut spectrum).expect("invariant: buffers were made for this transform");
            let line = |k: usize| match spectrum[k * periods] {
                line if k == 0 => Complex::new(line.re, 0.0),
                line => line * 2.0,
            };
            let lines = fitted.unwrap_or_else(|| (0..=highest).map(line).collect());
            (lines, (spectrum, tpm_numerics::step(signal)))
        };
        #[expect(clippy::type_complexity, reason = "lines, bins and steps, channel by channel")]
        let (lines, (bins, steps)): (Vec<Vec<Complex<f64>>>, (Vec<Vec<Complex<f64>>>, Vec<f64>)) =
            channels.par_iter().map(of).unzip();
        let (noise, noise_bins) = line_noise(&bins, highest + 1, used as f64 / samples_per_period, window);
        Ok(Spectra {
            fundamental: 2.0 * PI / (samples_per_period * sample_time),
            sample_time,
            samples_per_period,
            periods,
            window,
            lines,
            noise,
            noise_bins,
            steps,
            rests: channels.iter().map(|_| false).collect(),
            bins,
        })
    }

    /// Multiplies a channel by a frequency response, a function of the angular frequency (rad/s) that is real at zero:
    /// its lines, the covariance of its noise with that of all channels, and its transform.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn pass(&mut self, channel: usize, response: impl Fn(f64) -> Complex<f64>) {
        for (k, line) in self.lines[channel].iter_mut().enumerate() {
            *line *= response(k as f64 * self.fundamental);
        }
        for (k, noise) in self.noise.iter_mut().enumerate() {
            let factor = response(k as f64 * self.fundamental);
            noise.row_mut(channel).iter_mut().for_each(|z| *z *= factor);
            noise.column_mut(channel).iter_mut().for_each(|z| *z *= factor.conj());
        }
        let step = self.fundamental / self.periods.max(1) as f64;
        if let Some(bins) = self.bins.get_mut(channel) {
            for (b, bin) in bins.iter_mut().enumerate() {
                *bin *= response(b as f64 * step);
            }
        }
    }

    /// The mean rounding error of a quantised channel along a period, in the channel's unit; `reading` is one of its
    /// readings and places the grid. Nothing where the readings are not quantised, or where noise does not dither the
    /// quantiser.
    ///
    /// Under normal noise the mean rounding error is a smooth function of the motion, see [`mean_error`]. It is the
    /// same in every period, so that it biases the lines, most of all where the motion dwells. The motion follows from
    /// the lines and the error from the motion, by a fixed-point iteration. With enough noise the error is less steep
    /// than the motion, and the iteration converges.
    pub fn mean_rounding(&self, channel: usize, reading: f64) -> Option<Vec<f64>> {
        let (step, points) = (self.step(channel), self.samples_per_period.round() as usize);
        let highest = self.highest();
        if !(step > 0.0 && self.has_whole_periods() && self.noise_bins > 0 && highest > 0) {
            return None;
        }
        // White noise has E|n|^2 = 4 sigma^2 bandwidth / N in every line. What differs from period to period at low frequencies alone is
        // alike in neighbouring readings and dithers them together, so that as many rounding errors as there are periods do not average
        // out: the highest quarter of the lines tells what noise dithers reading by reading.
        let samples = self.samples_per_period * self.periods as f64;
        let upper = highest - highest / 4..=highest;
        let count = upper.clone().count() as f64;
        let power = upper.map(|k| self.variance(channel, k)).sum::<f64>() / count;
        let noise = noise_variance(power * samples / (4.0 * self.window.bandwidth() * step * step));
        if noise < LEAST_DITHER {
            return None;
        }
        let measured = &self.lines[channel];
        let stands_out = |(k, line): (usize, &Complex<f64>)| {
            k == 0 || line.norm_sqr() > alarm::LINE_OF_MOTION * self.variance(channel, k)
        };
        let certain: Vec<bool> = measured.iter().enumerate().map(stands_out).collect();
        let motion = |lines: &[Complex<f64>]| {
            let of = |(line, certain): (&Complex<f64>, &bool)| if *certain { *line } else { Complex::new(0.0, 0.0) };
            let lines: Vec<Complex<f64>> = lines.iter().zip(&certain).map(of).collect();
            synthesise(&lines, 0, self.fundamental, highest, points)
        };
        let mut before = motion(measured);
        for _ in 0..ROUNDING_ITERATION.most {
            let error: Vec<f64> = before.iter().map(|x| step * mean_error((x - reading) / step, noise)).collect();
            let of_error = analyse(&error, 0, 1, highest);
            let lines: Vec<Complex<f64>> = measured.iter().zip(&of_error).map(|(line, error)| line - error).collect();
            let now = motion(&lines);
            let moved = now.iter().zip(&before).map(|(now, before)| (now - before).abs()).fold(0.0, f64::max);
            if moved <= ROUNDING_ITERATION.settled * step {
                return Some(error);
            }
            before = now;
        }
        None
    }

    /// Whether a period is a whole number of samples.
    pub fn has_whole_periods(&self) -> bool {
        is_whole(self.samples_per_period)
    }

    /// Highest harmonic that the record resolves.
    #[must_use]
    pub fn highest(&self) -> usize {
        self.noise.len().saturating_sub(1)
    }

    /// Noise floor of the highest quarter of a channel's lines, as the variance E|n|^2 of one phasor. `None` when there
    /// are fewer than 32 lines, or when the highest lines that the sampling resolves were not fitted.
    ///
    /// Errors that repeat in every period, such as the quantisation of a repeated motion, are absent between the lines
    /// but present in this floor. The median ignores single lines that stand out; the median of |n|^2 is ln 2 times its
    /// mean.
    #[must_use]
    pub fn floor(&self, channel: usize) -> Option<f64> {
        let lines = self.lines.get(channel)?;
        let resolved = ((self.samples_per_period - 1.0) / 2.0).floor() as usize;
        if lines.len() <= resolved || lines.len() < 32 {
            return None;
        }
        let mut top: Vec<f64> = lines[lines.len() - lines.len() / 4..].iter().map(Complex::norm_sqr).collect();
        top.sort_by(f64::total_cmp);
        top.get(top.len() / 2).map(|median| median / std::f64::consts::LN_2)
    }

    /// Covariance E[n m*] of the noise of two channels' phasors at a harmonic, in the product of their units; nothing beyond the
    /// channels or the highest harmonic.
    #[must_use]
    pub fn covariance(&self, harmonic: usize, channel: usize, other: usize) -> Option<Complex<f64>> {
        self.noise.get(harmonic)?.get((channel, other)).copied()
    }

    /// The step of a channel's quantiser, in the channel's unit; zero for a channel that is not quantised.
    #[must_use]
    pub fn step(&self, channel: usize) -> f64 {
        self.steps.get(channel).copied().unwrap_or(0.0)
    }

    /// Noise variance E|n|^2 of one phasor of one channel.
    #[must_use]
    pub fn variance(&self, channel: usize, harmonic: usize) -> f64 {
        self.noise.get(harmonic).map_or(0.0, |m| m[(channel, channel)].re)
    }
}

fn is_whole(samples_per_period: f64) -> bool {
    (samples_per_period - samples_per_period.round()).abs() < 1e-9
}

/// Covariance of the noise in the first `count` lines, estimated from the bins between lines, and the least number of
/// bins that an estimate averages.
fn line_noise(
    bins: &[Vec<Complex<f64>>],
    count: usize,
    bins_per_line: f64,
    window: Window,
) -> (Vec<DMatrix<Complex<f64>>>, usize) {
    let channels = bins.len();
    let last = bins.first().map_or(0, Vec::len);
    let free: Vec<usize> = (1..last)
        .filter(|&b| {
            let nearest = (b as f64 / bins_per_line).round() * bins_per_line;
            (b as f64 - nearest).abs() > window.guard()
        })
        .collect();
    let per_line = (bins_per_line.ceil() - 2.0 * window.guard()).max(0.0);
    let half =
        if per_line > 0.0 { (LEAST_NOISE_BINS as f64 / per_line / 2.0).ceil().max(0.5) * bins_per_line } else { 0.0 };
    let mut averaged = usize::MAX;
    let mut noise = Vec::with_capacity(count);
    for k in 0..count {
        let centre = k as f64 * bins_per_line;
        let from = free.partition_point(|&b| (b as f64) < centre - half);
        let to = free.partition_point(|&b| (b as f64) <= centre + half);
        let mut sum = DMatrix::<Complex<f64>>::zeros(channels, channels);
        for &b in &free[from..to] {
            for r in 0..channels {
                for c in 0..channels {
                    sum[(r, c)] += bins[r][b] * bins[c][b].conj();
                }
            }
        }
        let number = to - from;
        averaged = averaged.min(number);
        // A one-sided phasor is twice the transform's bin; the mean is real and is not doubled.
        let scale = if k == 0 { 1.0 } else { 4.0 };
        if number > 0 {
            sum *= Complex::new(scale / number as f64, 0.0);
        }
        noise.push(sum);
    }
    (noise, if averaged == usize::MAX { 0 } else { averaged })
}

/// Number of successive samples whose harmonics are computed side by side.
const LANES: usize = 8;
/// Number of groups of [`LANES`] samples that one thread takes at a time.
const GROUPS_PER_TASK: usize = 4096;

/// Weighted least-squares fit of harmonics whose period is not a whole number of samples.
struct LineFit {
    factor: Cholesky<Complex<f64>, Dyn>,
    highest: usize,
    angle: f64,
}

impl LineFit {
    fn new(weights: &[f64], samples_per_period: f64, highest: usize) -> Option<Self> {
        let angle = 2.0 * PI / samples_per_period;
        // Gram matrix of e^{j k w t}: entry (k, l) depends on l - k only.
        let mut lags = vec![Complex::new(0.0, 0.0); 2 * highest + 1];
        project(weights, angle, &mut lags);
        let size = 2 * highest + 1;
        let gram = DMatrix::from_fn(size, size, |r, c| {
            // project() sums w e^{-j lag}; entry (r, c) needs w e^{+j (c - r)}.
            if c >= r { lags[c - r].conj() } else { lags[r - c] }
        });
        Some(LineFit { factor: gram.cholesky()?, highest, angle })
    }

    fn solve(&self, signal: &[f64], weights: &[f64]) -> Vec<Complex<f64>> {
        let windowed: Vec<f64> = signal.iter().zip(weights).map(|(x, w)| x * w).collect();
        let mut right = vec![Complex::new(0.0, 0.0); self.highest + 1];
        project(&windowed, self.angle, &mut right);
        let h = self.highest;
        let full = DVector::from_fn(2 * h + 1, |i, _| if i >= h { right[i - h] } else { right[h - i].conj() });
        let found = self.factor.solve(&full);
        (0..=h).map(|k| if k == 0 { Complex::new(found[h].re, 0.0) } else { found[h + k] * 2.0 }).collect()
    }

    fn residual(&self, signal: &[f64], lines: &[Complex<f64>]) -> Vec<f64> {
        let mean = lines.first().map_or(0.0, |mean| mean.re);
        let mut residual = signal.to_vec();
        residual.par_chunks_mut(LANES * GROUPS_PER_TASK).enumerate().for_each(|(part, residual)| {
            for (group, residual) in residual.chunks_mut(LANES).enumerate() {
                let (cos, sin) = turns(self.angle, (part * GROUPS_PER_TASK + group) * LANES);
                // Horner's rule in e^{j w t}.
                let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
                for line in lines.iter().skip(1).rev() {
                    for lane in 0..LANES {
                        let (a, b) = (re[lane] + line.re, im[lane] + line.im);
                        re[lane] = a * cos[lane] - b * sin[lane];
                        im[lane] = a * sin[lane] + b * cos[lane];
                    }
                }
                residual.iter_mut().zip(re).for_each(|(x, sum)| *x -= mean + sum);
            }
        });
        residual
    }
}

/// Cosines and sines of `angle` times the index of successive samples, from the sample `first` on.
fn turns(angle: f64, first: usize) -> ([f64; LANES], [f64; LANES]) {
    let (mut cos, mut sin) = ([0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        (sin[lane], cos[lane]) = (angle * (first + lane) as f64).sin_cos();
    }
    (cos, sin)
}

/// `out[k] = sum_i x_i e^{-j k angle i}`.
fn project(signal: &[f64], angle: f64, out: &mut [Complex<f64>]) {
    let count = out.len();
    let part = |(part, signal): (usize, &[f64])| {
        let mut sums = vec![Complex::new(0.0, 0.0); count];
        for (group, signal) in signal.chunks(LANES).enumerate() {
            let (cos, sin) = turns(angle, (part * GROUPS_PER_TASK + group) * LANES);
            let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
            re[..signal.len()].copy_from_slice(signal);
            for sum in &mut sums {
                *sum += Complex::new(re.iter().sum::<f64>(), im.iter().sum::<f64>());
                for lane in 0..LANES {
                    let (a, b) = (re[lane], im[lane]);
                    re[lane] = a * cos[lane] + b * sin[lane];
                    im[lane] = b * cos[lane] - a * sin[lane];
                }
            }
        }
        sums
    };
    // Parts are added in their order, so that the sums do not depend on the number of threads.
    let parts: Vec<Vec<Complex<f64>>> = signal.par_chunks(LANES * GROUPS_PER_TASK).enumerate().map(part).collect();
    out.fill(Complex::new(0.0, 0.0));
    for sums in parts {
        out.iter_mut().zip(sums).for_each(|(out, sum)| *out += sum);
    }
}

#[cfg(test)]
mod tests {
    use super::{Spectra, Window, analyse};
    use num_complex::Complex;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use std::f64::consts::PI;
    use tpm_numerics::grid;

    /// Counts of an encoder in degrees as a file gives them, with so many digits behind the point.
    fn degrees(count: f64, digits: i32) -> Vec<f64> {
        let counts =
            (0..3000).map(|i| (2000.0 * (0.01 * f64::from(i)).sin() + 300.0 * (0.047 * f64::from(i)).cos()).round());
        let written = 10.0_f64.powi(digits);
        counts.map(|counts| (counts * count * written).round() / written).collect()
    }

    #[test]
    fn counts_are_seen_through_the_digits_of_a_file() {
        let count = 360.0 / 4096.0;
        for digits in [3, 4, 6] {
            let found = grid(&degrees(count, digits));
            assert!((found / count - 1.0).abs() < 1e-3, "{digits}: {found}");
        }
        // Digits that are as coarse as the counts are the grid, or hide it.
        assert!([1, 2].iter().all(|digits| (grid(&degrees(count, *digits)) / count - 1.0).abs() > 0.1));
        // Noise lies on the grid of its own digits alone.
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let noise: Vec<f64> = StandardNormal.sample_iter(&mut rng).take(3000).collect();
        assert_eq!(grid(&noise), 0.0);
    }

    fn series(period: f64, n: usize) -> Vec<f64> {
        (0..n)
            .map(|i| {
                let th = 2.0 * PI * i as f64 / period;
                0.5 + th.cos() + 0.2 * (3.0 * th).sin() - 0.01 * (7.0 * th).cos()
            })
            .collect()
    }

    fn check(period: f64, periods: usize, n: usize) {
        let x = series(period, n);
        let s = Spectra::analyse(&[&x], 1e-3, period, periods).expect("long enough");
        let expected = [(0, 0.5, 0.0), (1, 1.0, 0.0), (2, 0.0, 0.0), (3, 0.0, -0.2), (7, -0.01, 0.0)];
        for (k, re, im) in expected {
            let error = (s.lines[0][k] - Complex::new(re, im)).norm();
            assert!(error < 1e-12, "period {period}, harmonic {k}: {error:e}");
        }
        assert!(s.variance(0, 3) < 1e-24);
    }

    #[test]
    fn a_response_passes_lines_noise_and_transform_alike() {
        // Two channels with a line and noise between the lines; the second is then the first, halved and delayed.
        let (period, periods) = (40.0, 8);
        let wave = |n: usize| {
            let phase = 2.0 * PI * n as f64 / period;
            phase.cos() + 0.3 * (2.3 * phase).sin()
        };
        let samples: Vec<f64> = (0..320).map(wave).collect();
        let mut spectra = Spectra::analyse(&[&samples, &samples], 0.01, period, periods).expect("whole periods");
        let before = spectra.clone();
        let response = |w: f64| Complex::from_polar(0.5, -0.013 * w);
        spectra.pass(1, response);
        for k in 0..=spectra.highest() {
            let factor = response(k as f64 * spectra.fundamental);
            assert!((spectra.lines[1][k] - before.lines[1][k] * factor).norm() < 1e-14);
            assert_eq!(spectra.lines[0][k], before.lines[0][k]);
            assert!((spectra.noise[k][(0, 1)] - before.noise[k][(0, 1)] * factor.conj()).norm() < 1e-14);
            assert!((spectra.variance(1, k) - 0.25 * before.variance(1, k)).abs() < 1e-14);
        }
        let bin = 19;
        let factor = response(bin as f64 / periods as f64 * spectra.fundamental);
        assert!((spectra.bins[1][bin] - before.bins[1][bin] * factor).norm() < 1e-14);
    }

    #[test]
    fn lines_are_exact_for_whole_and_broken_periods() {
        check(100.0, 2, 250);
        check(100.0, 5, 500);
        check(101.37, 2, 250);
        check(101.37, 6, 700);
        check(40.5, 3, 130);
    }

    #[test]
    fn counts_are_told_from_values() {
        let smooth = series(100.0, 400);
        let counted: Vec<f64> = smooth.iter().map(|x| (x / 0.03).round() * 0.03).collect();
        let s = Spectra::analyse(&[&smooth, &counted], 1e-3, 100.0, 4).expect("long enough");
        assert!(s.steps[0].abs() < 1e-15 && (s.steps[1] - 0.03).abs() < 1e-9, "{:?}", s.steps);
        assert_eq!(s.select(&[1]).steps.len(), 1);
    }

    #[test]
    fn noise_of_a_line_is_what_its_spread_shows() {
        for (period, periods, window) in
            [(64.0, 8, Window::Hann), (64.0, 3, Window::Rectangular), (61.7, 6, Window::Hann)]
        {
            let n = (period * f64::from(periods)) as usize + 1;
            let clean = series(period, n);
            let mut rng = ChaCha8Rng::seed_from_u64(7);
            let (mut spread, mut stated) = (0.0, 0.0);
            for _ in 0..200 {
                let x: Vec<f64> = clean
                    .iter()
                    .map(|c| {
                        let noise: f64 = StandardNormal.sample(&mut rng);
                        c + 0.1 * noise
                    })
                    .collect();
                let s = Spectra::analyse(&[&x], 1e-3, period, periods as usize).expect("long enough");
                assert_eq!(s.window, window);
                spread += (s.lines[0][3] - Complex::new(0.0, -0.2)).norm_sqr();
                stated += s.variance(0, 3);
            }
            let ratio = stated / spread;
            assert!((0.8..1.3).contains(&ratio), "period {period}: {ratio}");
        }
    }

    #[test]
    fn noise_that_dithers_counts_shows_the_motion_between_them() {
        let (step, points, periods) = (1e-3, 5000, 40);
        let wave = |i: usize| {
            let angle = 2.0 * PI * i as f64 / points as f64;
            0.0137 * (angle.cos() - (3.0 * angle).cos() / 9.0) + 0.00021
        };
        // Errors of the lines 0 to 9 before and after, in counts.
        let errors = |deviation: f64| {
            let mut rng = ChaCha8Rng::seed_from_u64(7);
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let readings: Vec<f64> = (0..points * periods)
                .map(|i| ((wave(i) + step * deviation * normal()) / step).round() * step + 0.02)
                .collect();
            let spectra = Spectra::analyse(&[&readings], 1e-3, points as f64, periods).expect("whole periods");
            let truth = |k: usize| match k {
                0 => 0.02021,
                1 => 0.0137,
                3 => -0.0137 / 9.0,
                _ => 0.0,
            };
            let error = |rounding: &[Complex<f64>]| {
                let left = |k: usize| spectra.lines[0][k] - rounding.get(k).copied().unwrap_or_default() - truth(k);
                (0..10).map(|k| left(k).norm()).fold(0.0, f64::max) / step
            };
            let rounding = spectra.mean_rounding(0, readings[0]);
            (error(&[]), rounding.map(|rounding| error(&analyse(&rounding, 0, 1, 9))))
        };
        for deviation in [0.22, 0.3] {
            let (before, after) = errors(deviation);
            let after = after.expect("dithered");
            assert!(after < 0.25 * before, "{deviation}: {before} {after}");
        }
        // Without noise the readings do not show where between two counts the motion lies.
        assert!(errors(0.02).1.is_none());
    }
}
