//! Frequency response of a machine from a record of its input and output.
//!
//! Invariant: segments of equal length, their mean removed, weighted with a window (Welch); with U and Y the transforms of a
//! segment and sums over the segments,
//!
//! ```text
//! H1 = sum conj(U) Y / sum |U|^2      H2 = sum |Y|^2 / sum conj(Y) U      coherence = |sum conj(U) Y|^2 / (sum |U|^2 sum |Y|^2)
//! ```
//!
//! H1 averages noise on the output away, H2 noise on the input; they enclose the truth when both carry noise. A held input
//! ([`Hold::Zoh`]) lags by half a sample: every line is divided by the response of the hold, `(1 - e^{-jWT})/(jWT)`, so
//! that H is that of the machine in continuous time. Lines whose coherence could be chance are marked and never fitted.
//! The decision is made on neighbouring lines together, because a choice line by line would select lines whose noise
//! raises the coherence.

use num_complex::Complex;
use std::f64::consts::PI;
use tpm_controller::harmonics::Hold;
use tpm_motion::{Window, held};
use tpm_numerics::fourier::forward;
use tpm_numerics::{alarm, tolerance};

/// Shortest segment: fewer samples leave no line that the window resolves.
const SHORTEST_SEGMENT: usize = 16;
/// Number of lines on either side over which the coherence of a line is averaged.
const LINES_PER_SIDE: usize = 20;
/// Largest ratio of the input powers of two lines whose coherences are averaged together.
const MOST_POWER_RATIO: f64 = 30.0;

/// How the record is averaged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Welch {
    /// Samples in a segment; lines are 1/(segment * sample time) apart.
    pub segment: usize,
    /// Share of a segment that the next one repeats, from 0 to below 1.
    pub overlap: f64,
    /// Weight of the samples of a segment.
    pub window: Window,
    /// Hold of the input between samples.
    pub hold: Hold,
}

impl Welch {
    /// Half overlapping segments with a periodic Hann window, for any excitation that does not repeat.
    #[must_use]
    pub const fn new(segment: usize, hold: Hold) -> Self {
        Welch { segment, overlap: 0.5, window: Window::Hann, hold }
    }

    /// Whole periods of an excitation that repeats, such as a multisine: nothing leaks, and a window would only mix
    /// neighbouring lines, whose inputs may cancel.
    #[must_use]
    pub const fn periodic(period: usize, hold: Hold) -> Self {
        Welch { segment: period, overlap: 0.0, window: Window::Rectangular, hold }
    }

    /// Sum of the squared correlations of a line's error with those of all lines: under the Hann window neighbours'
    /// transforms correlate by -2/3 and 1/6, so that it is 1 + 2 (4/9 + 1/36).
    pub(super) fn line_correlation(&self) -> f64 {
        match self.window {
            Window::Rectangular => 1.0,
            Window::Hann => 1.0 + 2.0 * (4.0 / 9.0 + 1.0 / 36.0),
        }
    }

    fn weights(&self) -> Vec<f64> {
        let n = self.segment;
        match self.window {
            Window::Rectangular => vec![1.0; n],
            Window::Hann => (0..n).map(|i| 0.5 - 0.5 * (2.0 * PI * i as f64 / n as f64).cos()).collect(),
        }
    }
}

/// Why a record has no frequency response.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ResponseError {
    /// Input and output have different lengths.
    #[error("the input has {input} samples, the output {output}; cut the record to the part that has both")]
    Lengths {
        /// Samples of the input.
        input: usize,
        /// Samples of the output.
        output: usize,
    },
    /// A value is no number.
    #[error("sample {sample} of the {signal} is not finite; cut the record around it")]
    NotFinite {
        /// Input or output.
        signal: &'static str,
        /// The sample, from 0.
        sample: usize,
    },
    /// The sample time is no positive number.
    #[error("a sample time of {sample_time} s; it must be a positive number")]
    SampleTime {
        /// The sample time, s.
        sample_time: f64,
    },
    /// The segment is too short to resolve anything.
    #[error("segments of {segment} samples resolve no line; {SHORTEST_SEGMENT} samples are the least")]
    Segment {
        /// Samples in a segment.
        segment: usize,
    },
    /// The overlap is out of range.
    #[error("an overlap of {overlap}; it must be from 0 to below 1")]
    Overlap {
        /// The overlap.
        overlap: f64,
    },
    /// The record holds no two segments.
    #[error(
        "the record has {samples} samples, {needed} are needed for two segments of {segment}, without which there is no coherence; \
         record longer or take segments of at most {longest} samples"
    )]
    Short {
        /// Samples in the record.
        samples: usize,
        /// Samples in a segment.
        segment: usize,
        /// Samples that two segments need.
        needed: usize,
        /// Longest segment of which the record holds two.
        longest: usize,
    },
    /// A signal does not change.
    #[error(
        "the {signal} does not change within any segment; is it the right column, and was the machine switched on?"
    )]
    Constant {
        /// Input or output.
        signal: &'static str,
    },
}

/// Estimate of the response, by the error that it averages away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ResponseEstimator {
    /// Averages noise on the output away.
    #[default]
    H1,
    /// Averages noise on the input away.
    H2,
}

/// The response at one frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ResponseLine {
    /// Angular frequency, rad/s.
    pub frequency: f64,
    /// Output over input, noise on the output averaged away.
    pub h1: Complex<f64>,
    /// Output over input, noise on the input averaged away.
    pub h2: Complex<f64>,
    /// Share of the output's power that follows linearly from the input, 0 to 1.
    pub coherence: f64,
    /// Power density of the input, unit squared per Hz, one-sided.
    pub input: f64,
    /// Power density of the output, unit squared per Hz, one-sided.
    pub output: f64,
    /// Standard deviation of H1 as a complex number: the root of E|H1 - H|^2.
    pub std: f64,
    /// Whether the coherence is more than chance; a line that is not must not be fitted.
    pub usable: bool,
}

impl ResponseLine {
    /// Frequency in Hz.
    #[must_use]
    pub fn hertz(&self) -> f64 {
        self.frequency / (2.0 * PI)
    }
}

/// A run of lines without usable response.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Gap {
    /// First frequency, Hz.
    pub low: f64,
    /// Last frequency, Hz.
    pub high: f64,
    /// Lines in it.
    pub lines: usize,
    /// Largest coherence in it.
    pub coherence: f64,
}

impl std::fmt::Display for Gap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "no usable response from {:.4} to {:.4} Hz ({} lines, coherence {:.2} at most): excite that band, or leave it out",
            self.low, self.high, self.lines, self.coherence
        )
    }
}

/// How much the correction for the hold changes the response.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct HoldEffect {
    /// Median relative change over the band.
    pub median: f64,
    /// Largest relative change.
    pub largest: f64,
}

/// The frequency response of one output to one input.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct FrequencyResponse {
    /// Time between samples, s.
    pub sample_time: f64,
    /// How the record was averaged.
    pub welch: Welch,
    /// Segments averaged.
    pub segments: usize,
    /// Number of independent segments whose average has the same variance; overlapping segments share data.
    pub averages: f64,
    /// Lines from 0 to half the sampling frequency.
    pub lines: Vec<ResponseLine>,
}

impl FrequencyResponse {
    /// Estimates the response from samples that are `sample_time` apart.
    ///
    /// # Errors
    /// [`ResponseError`] when the record is too short for two segments, holds a value that is not finite or does not change, or a
    /// setting is out of range.
    pub fn estimate(input: &[f64], output: &[f64], sample_time: f64, welch: &Welch) -> Result<Self, ResponseError> {
        let step = check(input, output, sample_time, welch)?;
        let segments = (input.len() - welch.segment) / step + 1;
        let weights = welch.weights();
        let power = Power::sum(input, output, &weights, step);
        if power.input.iter().all(|&p| p == 0.0) {
            return Err(ResponseError::Constant { signal: "input" });
        }
        if power.output.iter().all(|&p| p == 0.0) {
            return Err(ResponseError::Constant { signal: "output" });
        }
        let averages = effective_averages(&weights, step, segments);
        let lines = power.lines(sample_time, welch, segments, averages);
        Ok(FrequencyResponse { sample_time, welch: *welch, segments, averages, lines })
    }

    /// The lines from `low` to `high` Hz, usable or not.
    pub fn band(&self, low: f64, high: f64) -> impl Iterator<Item = &ResponseLine> {
        self.lines.iter().filter(move |line| (low..=high).contains(&line.hertz()))
    }

    /// First and last frequency, Hz, of the longest run of usable lines; `None` when none is usable.
    #[must_use]
    pub fn usable_band(&self) -> Option<(f64, f64)> {
        let longest = self.lines.split(|line| !line.usable).max_by_key(|run| run.len())?;
        Some((longest.first()?.hertz(), longest.last()?.hertz()))
    }

    /// Radius of the circle around H1 (the estimator that the theory is for) in which H lies with this probability.
    ///
    /// From the F distribution with 2 and 2 n - 2 degrees of freedom, n averages (Bendat and Piersol, Random Data,
    /// section 9.2); for two degrees of freedom its quantile has a closed form. Infinite for a line that is not usable.
    #[must_use]
    pub fn radius(&self, line: &ResponseLine, probability: f64) -> f64 {
        if !line.usable {
            return f64::INFINITY;
        }
        let free = self.averages - 1.0;
        let quantile = free * ((1.0 - probability).powf(-1.0 / free) - 1.0);
        line.std * quantile.sqrt()
    }

    /// Runs of lines of a band without a usable response.
    #[must_use]
    pub fn gaps(&self, low: f64, high: f64) -> Vec<Gap> {
        let mut gaps: Vec<Gap> = Vec::new();
        let mut open = false;
        for line in self.band(low, high) {
            let hertz = line.hertz();
            match gaps.last_mut() {
                _ if line.usable => open = false,
                Some(gap) if open => {
                    gap.high = hertz;
                    gap.lines += 1;
                    gap.coherence = gap.coherence.max(line.coherence);
                }
                _ => {
                    gaps.push(Gap { low: hertz, high: hertz, lines: 1, coherence: line.coherence });
                    open = true;
                }
            }
        }
        gaps
    }

    /// Effect of dividing by the hold, |H corrected - H recorded| / |H corrected| over a band; zero without a hold.
    #[must_use]
    pub fn hold_effect(&self, low: f64, high: f64) -> HoldEffect {
        let mut changes: Vec<f64> = self
            .band(low, high)
            .map(|line| (Complex::new(1.0, 0.0) - hold_of(line.frequency, self.sample_time, self.welch.hold)).norm())
            .collect();
        changes.sort_by(f64::total_cmp);
        HoldEffect {
            median: changes.get(changes.len() / 2).copied().unwrap_or(0.0),
            largest: changes.last().copied().unwrap_or(0.0),
        }
    }
}

/// Frequency response of a hold at an angular frequency, rad/s.
pub(super) fn hold_of(frequency: f64, sample_time: f64, hold: Hold) -> Complex<f64> {
    held(hold, frequency * sample_time)
}

/// Checks record and settings; returns the number of samples from the start of a segment to the start of the next.
fn check(input: &[f64], output: &[f64], sample_time: f64, welch: &Welch) -> Result<usize, ResponseError> {
    let Welch { segment, overlap, .. } = *welch;
    if input.len() != output.len() {
        return Err(ResponseError::Lengths { input: input.len(), output: output.len() });
    }
    if !(sample_time.is_finite() && sample_time > 0.0) {
        return Err(ResponseError::SampleTime { sample_time });
    }
    if segment < SHORTEST_SEGMENT {
        return Err(ResponseError::Segment { segment });
    }
    if !(0.0..1.0).contains(&overlap) {
        return Err(ResponseError::Overlap { overlap });
    }
    let step = segment - (overlap * segment as f64).floor() as usize;
    let (samples, needed) = (input.len(), segment + step);
    if samples < needed {
        let longest = (samples as f64 / (2.0 - overlap)).floor() as usize;
        return Err(ResponseError::Short { samples, segment, needed, longest });
    }
    for (signal, values) in [("input", input), ("output", output)] {
        if let Some(sample) = values.iter().position(|x| !x.is_finite()) {
            return Err(ResponseError::NotFinite { signal, sample });
        }
    }
    Ok(step)
}

/// Number of independent segments whose average has the variance of the average of these overlapping ones (P. D. Welch,
/// 1967).
fn effective_averages(weights: &[f64], step: usize, segments: usize) -> f64 {
    let power: f64 = weights.iter().map(|w| w * w).sum();
    let count = segments as f64;
    let shared: f64 = (1..segments)
        .take_while(|m| m * step < weights.len())
        .map(|m| {
            let common: f64 = weights[m * step..].iter().zip(weights).map(|(a, b)| a * b).sum();
            (1.0 - m as f64 / count) * (common / power).powi(2)
        })
        .sum();
    count / (1.0 + 2.0 * shared)
}

/// Constants, common to all lines, of the test whether a coherence is more than chance.
struct Chance {
    /// Number of independent averages.
    averages: f64,
    /// Number of neighbouring lines that count as one independent line.
    correlation: f64,
    /// Input power up to which a line holds only rounding.
    rounding: f64,
}

/// Sums of the segments' spectra.
struct Power {
    input: Vec<f64>,
    output: Vec<f64>,
    cross: Vec<Complex<f64>>,
    /// Sum of the squared weights of the window.
    window: f64,
}

impl Power {
    fn sum(input: &[f64], output: &[f64], window: &[f64], step: usize) -> Self {
        let segment = window.len();
        let transform = forward(segment);
        let mut scratch = transform.make_scratch_vec();
        let mut windowed = transform.make_input_vec();
        let (mut u, mut y) = (transform.make_output_vec(), transform.make_output_vec());
        let mut power = Power {
            input: vec![0.0; u.len()],
            output: vec![0.0; u.len()],
            cross: vec![Complex::new(0.0, 0.0); u.len()],
            window: window.iter().map(|w| w * w).sum(),
        };
        let mut spectrum = |signal: &[f64], out: &mut [Complex<f64>]| {
            let mean = signal.iter().sum::<f64>() / segment as f64;
            for ((value, x), w) in windowed.iter_mut().zip(signal).zip(window) {
                *value = (x - mean) * w;
            }
            transform
                .process_with_scratch(&mut windowed, out, &mut scratch)
                .expect("invariant: buffers were made for this transform");
        };
        for (u_segment, y_segment) in input.windows(segment).step_by(step).zip(output.windows(segment).step_by(step)) {
            spectrum(u_segment, &mut u);
            spectrum(y_segment, &mut y);
            for (k, (u, y)) in u.iter().zip(&y).enumerate() {
                power.input[k] += u.norm_sqr();
                power.output[k] += y.norm_sqr();
                power.cross[k] += u.conj() * y;
            }
        }
        power
    }

    fn lines(&self, sample_time: f64, welch: &Welch, segments: usize, averages: f64) -> Vec<ResponseLine> {
        let density = 2.0 * sample_time / (self.window * segments as f64);
        let coherence: Vec<f64> = (0..self.input.len()).map(|k| self.coherence(k)).collect();
        let chance = Chance {
            averages,
            correlation: welch.line_correlation(),
            rounding: tolerance::POWER * self.input.iter().copied().fold(0.0, f64::max),
        };
        (0..self.input.len())
            .map(|k| {
                let (uu, yy, uy) = (self.input[k], self.output[k], self.cross[k]);
                let frequency = 2.0 * PI * k as f64 / (welch.segment as f64 * sample_time);
                let hold = hold_of(frequency, sample_time, welch.hold);
                let zero = Complex::new(0.0, 0.0);
                let h1 = if uu > 0.0 { uy / uu / hold } else { zero };
                let h2 = if uy.norm_sqr() > 0.0 { Complex::from(yy) / uy.conj() / hold } else { zero };
                // The mean was removed, so that the line at zero holds only rounding; the last line has no phase.
                let inner = k > 0 && 2 * k < welch.segment;
                let usable = inner && self.excited(k, &coherence, &chance);
                let variance = (1.0 - coherence[k]) * yy / uu / (averages - 1.0) / hold.norm_sqr();
                let std = if variance.is_nan() { f64::INFINITY } else { variance.sqrt() };
                ResponseLine {
                    frequency,
                    h1,
                    h2,
                    coherence: coherence[k],
                    input: density * uu,
                    output: density * yy,
                    std,
                    usable,
                }
            })
            .collect()
    }

    fn coherence(&self, k: usize) -> f64 {
        let (uu, yy) = (self.input[k], self.output[k]);
        if uu > 0.0 && yy > 0.0 { (self.cross[k].norm_sqr() / uu / yy).min(1.0) } else { 0.0 }
    }

    /// Whether the mean coherence of a line and of its neighbours with similar input power is more than chance.
    ///
    /// If output and input are unrelated, a coherence over n averages is Beta(1, n - 1) distributed. The quantile of
    /// the mean of several coherences follows from the variance and skewness of this distribution (Cornish-Fisher).
    fn excited(&self, k: usize, coherence: &[f64], chance: &Chance) -> bool {
        let &Chance { averages, correlation, rounding } = chance;
        let power = self.input[k];
        if power <= rounding {
            return false;
        }
        let (from, to) = (k.saturating_sub(LINES_PER_SIDE).max(1), (k + LINES_PER_SIDE + 1).min(coherence.len()));
        let (mut sum, mut count) = (0.0, 0.0);
        for (present, input) in coherence[from..to].iter().zip(&self.input[from..to]) {
            if (power / MOST_POWER_RATIO..=power * MOST_POWER_RATIO).contains(input) {
                sum += present;
                count += 1.0;
            }
        }
        let independent = (count / correlation).max(1.0);
        let free = averages - 1.0;
        let deviation = (free / (free + 2.0)).sqrt() / averages;
        let skewness = 2.0 * (free - 1.0) * (free + 2.0).sqrt() / ((free + 3.0) * free.sqrt());
        let quantile = alarm::COHERENT_LINE
            + (alarm::COHERENT_LINE * alarm::COHERENT_LINE - 1.0) / 6.0 * skewness.max(0.0) / independent.sqrt();
        sum / count > 1.0 / averages + quantile * deviation / independent.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::{FrequencyResponse, ResponseError, Welch, effective_averages};
    use crate::excitation::{Excitation, Phases};
    use num_complex::Complex;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use std::f64::consts::PI;
    use tpm_controller::harmonics::Hold;

    fn white(n: usize, seed: u64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| StandardNormal.sample(&mut random)).collect()
    }

    /// y' + 5 y = 5 u under a held input, exactly: a sampled system whose continuous response is 5/(s + 5).
    fn first_order(input: &[f64], sample_time: f64) -> Vec<f64> {
        let decay = (-5.0 * sample_time).exp();
        let mut y = 0.0;
        input
            .iter()
            .map(|u| {
                let now = y;
                y = decay * y + (1.0 - decay) * u;
                now
            })
            .collect()
    }

    fn truth(frequency: f64) -> Complex<f64> {
        Complex::from(5.0) / Complex::new(5.0, frequency)
    }

    /// Sums written out: no transform library, no shared code.
    #[test]
    fn agrees_with_the_definition() {
        let (u, y) = (white(100, 1), white(100, 2));
        let welch = Welch { overlap: 0.25, ..Welch::new(32, Hold::None) };
        let found = FrequencyResponse::estimate(&u, &y, 0.1, &welch).expect("long enough");
        assert_eq!(found.segments, 3);
        for k in [1_usize, 5, 15] {
            let (mut uu, mut yy, mut uy) = (0.0, 0.0, Complex::new(0.0, 0.0));
            for start in [0, 24, 48] {
                let line = |x: &[f64]| {
                    let part = &x[start..start + 32];
                    let mean = part.iter().sum::<f64>() / 32.0;
                    (0..32)
                        .map(|i| {
                            let turn = 2.0 * PI * i as f64 / 32.0;
                            Complex::from_polar((part[i] - mean) * (0.5 - 0.5 * turn.cos()), -turn * k as f64)
                        })
                        .sum::<Complex<f64>>()
                };
                let (a, b) = (line(&u), line(&y));
                uu += a.norm_sqr();
                yy += b.norm_sqr();
                uy += a.conj() * b;
            }
            let line = found.lines[k];
            assert!((line.h1 - uy / uu).norm() < 1e-13 * line.h1.norm());
            assert!((line.h2 - yy / uy.conj()).norm() < 1e-12 * line.h2.norm());
            assert!((line.coherence - uy.norm_sqr() / uu / yy).abs() < 1e-13);
        }
        // Parseval: the density of white noise of power 1 at 10 Hz is 0.2 per Hz.
        let long = white(40_000, 3);
        let found = FrequencyResponse::estimate(&long, &long, 0.1, &welch).expect("long enough");
        let mean = found.lines[2..15].iter().map(|line| line.input).sum::<f64>() / 13.0;
        assert!((mean - 0.2).abs() < 0.005, "{mean}");
    }

    #[test]
    fn overlapping_segments_count_for_less() {
        // Half-overlapping Hann: neighbours correlate by 1/6; K / (1 + 2 (1 - 1/K)/36).
        let weights = Welch::new(1024, Hold::None).weights();
        let found = effective_averages(&weights, 512, 9);
        assert!((found - 9.0 / (1.0 + 2.0 * (8.0 / 9.0) / 36.0)).abs() < 1e-9);
        assert!((effective_averages(&weights, 1024, 9) - 9.0).abs() < 1e-12);
    }

    #[test]
    fn the_hold_is_corrected_and_its_effect_stated() {
        let u = Excitation::Multisine { period: 2000, low: 0.5, high: 50.0, rms: 1.0, phases: Phases::Schroeder }
            .samples(12_000, 1e-3)
            .expect("valid");
        let y = first_order(&u, 1e-3);
        let error = |hold| {
            let found = FrequencyResponse::estimate(&u[4000..], &y[4000..], 1e-3, &Welch::periodic(2000, hold))
                .expect("long enough");
            let mut errors: Vec<f64> =
                found.band(1.0, 49.0).map(|line| (line.h1 / truth(line.frequency) - 1.0).norm()).collect();
            errors.sort_by(f64::total_cmp);
            (errors[errors.len() / 2], errors[errors.len() - 1], found.hold_effect(1.0, 49.0))
        };
        let (median, largest, effect) = error(Hold::Zoh);
        // The images of the hold remain: sum over k of (W/(k Ws))^2 = pi^2/3 (W/Ws)^2 for a slope of 1/W.
        let images = |hertz: f64| PI * PI / 3.0 * (hertz / 1000.0).powi(2);
        assert!((largest / images(49.0) - 1.0).abs() < 0.02, "{largest:e}");
        assert!((median / images(25.0) - 1.0).abs() < 0.05, "{median:e}");
        let (median, largest, none) = error(Hold::None);
        assert!((median / effect.median - 1.0).abs() < 0.03 && (largest / effect.largest - 1.0).abs() < 0.05);
        assert_eq!((none.median, none.largest), (0.0, 0.0));
    }

    #[test]
    fn the_stated_error_is_the_spread() {
        let welch = Welch::new(512, Hold::Zoh);
        let (mut spread, mut stated, mut inside, mut count) = (0.0, 0.0, 0, 0);
        let mut mean = Complex::new(0.0, 0.0);
        for seed in 0..60 {
            let u = white(10_000, 100 + seed);
            let noise = white(10_000, 200 + seed);
            let y: Vec<f64> = first_order(&u, 1e-3).iter().zip(&noise).map(|(y, n)| y + 0.02 * n).collect();
            let found = FrequencyResponse::estimate(&u, &y, 1e-3, &welch).expect("long enough");
            for line in &found.lines[10..30] {
                let error = line.h1 - truth(line.frequency);
                mean += error;
                spread += error.norm_sqr();
                stated += line.std * line.std;
                inside += usize::from(error.norm() < found.radius(line, 0.95));
                count += 1;
            }
        }
        let (ratio, share) = (stated / spread, f64::from(inside as u32) / f64::from(count));
        assert!((0.85..1.15).contains(&ratio), "{ratio}");
        assert!((0.92..0.975).contains(&share), "{share}");
        assert!(mean.norm() / f64::from(count) < 0.1 * (spread / f64::from(count)).sqrt(), "{mean}");
    }

    #[test]
    fn a_band_without_excitation_is_said() {
        // The excitation ends at 100 Hz; above it there is only the sensor's noise.
        let u = Excitation::Multisine { period: 1000, low: 1.0, high: 100.0, rms: 1.0, phases: Phases::Schroeder }
            .samples(20_000, 1e-3)
            .expect("valid");
        let y: Vec<f64> = first_order(&u, 1e-3).iter().zip(white(20_000, 9)).map(|(y, n)| y + 1e-4 * n).collect();
        let found = FrequencyResponse::estimate(&u, &y, 1e-3, &Welch::periodic(1000, Hold::Zoh)).expect("long enough");
        assert_eq!(found.gaps(5.0, 95.0), []);
        assert_eq!(found.usable_band(), Some((1.0, 100.0)));
        let gaps = found.gaps(5.0, 400.0);
        assert_eq!(gaps.iter().map(|gap| gap.lines).sum::<usize>(), 300, "{gaps:?}");
        assert_eq!((gaps[0].low, gaps[gaps.len() - 1].high), (101.0, 400.0));
        assert!(format!("{}", gaps[0]).contains("excite that band"));
        // With noise on the input there is input power at all lines, and only the coherence shows which were excited.
        let u: Vec<f64> = u.iter().zip(white(20_000, 10)).map(|(u, n)| u + 1e-3 * n).collect();
        let found = FrequencyResponse::estimate(&u, &y, 1e-3, &Welch::periodic(1000, Hold::Zoh)).expect("long enough");
        let passed = found.band(110.0, 400.0).filter(|line| line.usable).count();
        assert!(passed <= 3, "{passed} of 291 lines pass by chance");
        assert!(!found.lines[0].usable);
        assert_eq!(found.radius(&found.lines[300], 0.95), f64::INFINITY);
    }

    #[test]
    fn records_that_cannot_be_used_are_refused() {
        let signal = white(1000, 5);
        let fault =
            |u: &[f64], y: &[f64], dt, welch| FrequencyResponse::estimate(u, y, dt, &welch).expect_err("faulty");
        let welch = Welch::new(256, Hold::None);
        let short = fault(&signal, &signal, 1e-3, Welch::new(900, Hold::None));
        assert_eq!(short, ResponseError::Short { samples: 1000, segment: 900, needed: 1350, longest: 666 });
        assert!(FrequencyResponse::estimate(&signal, &signal, 1e-3, &Welch::new(666, Hold::None)).is_ok());
        assert_eq!(fault(&signal, &signal[1..], 1e-3, welch), ResponseError::Lengths { input: 1000, output: 999 });
        assert_eq!(fault(&[2.5; 1000], &signal, 1e-3, welch), ResponseError::Constant { signal: "input" });
        let mut holed = signal.clone();
        holed[77] = f64::NAN;
        assert_eq!(fault(&signal, &holed, 1e-3, welch), ResponseError::NotFinite { signal: "output", sample: 77 });
        assert_eq!(fault(&signal, &signal, 0.0, welch), ResponseError::SampleTime { sample_time: 0.0 });
        assert_eq!(fault(&signal, &signal, 1.0, Welch::new(4, Hold::None)), ResponseError::Segment { segment: 4 });
        let all = Welch { overlap: 1.0, ..welch };
        assert_eq!(fault(&signal, &signal, 1.0, all), ResponseError::Overlap { overlap: 1.0 });
        // Two segments that share all but one sample are one: nothing is usable, nothing panics.
        let found = FrequencyResponse::estimate(
            &signal,
            &signal,
            1.0,
            &Welch { overlap: 0.999, ..Welch::new(998, Hold::None) },
        );
        let found = found.expect("two segments");
        assert!(found.averages < 1.01 && found.band(0.0, 1.0).all(|line| !line.usable || line.coherence > 0.99));
    }
}
