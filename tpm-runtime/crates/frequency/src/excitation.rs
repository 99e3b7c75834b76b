//! Inputs that excite a band of frequencies.
//!
//! Invariant: an excitation depends on its settings alone, the seed among them, so that an experiment can be repeated.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use realfft::num_complex::Complex;
use std::f64::consts::PI;
use tpm_numerics::fourier::inverse;
use tpm_numerics::root_mean_square;

/// Largest distance of a hold from a whole number of samples, in samples.
const MOST_OFF_WHOLE_SAMPLES: f64 = 1e-6;

/// Why an excitation cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExcitationError {
    /// A setting is not a positive, finite number.
    #[error("the {setting} of the excitation is {value}; it must be a positive number")]
    NotPositive {
        /// Name of the setting.
        setting: &'static str,
        /// Value of the setting.
        value: f64,
    },
    /// The hold is no whole number of samples.
    #[error(
        "a hold of {hold} s is not a whole number of samples of {sample_time} s; choose a multiple of the sample time"
    )]
    Hold {
        /// Time for which each value is held, s.
        hold: f64,
        /// Time between samples, s.
        sample_time: f64,
    },
    /// The band is empty or reaches beyond half the sampling frequency.
    #[error("the band {low} to {high} Hz must rise and end below half the sampling frequency, {nyquist} Hz")]
    Band {
        /// Lowest frequency, Hz.
        low: f64,
        /// Highest frequency, Hz.
        high: f64,
        /// Half the sampling frequency, Hz.
        nyquist: f64,
    },
    /// No line of a multisine lies in the band.
    #[error(
        "a period of {period} samples has no line from {low} to {high} Hz, only multiples of {spacing} Hz; lengthen the period or widen the band"
    )]
    NoLine {
        /// Samples in a period.
        period: usize,
        /// Lowest frequency, Hz.
        low: f64,
        /// Highest frequency, Hz.
        high: f64,
        /// Distance of the lines, Hz.
        spacing: f64,
    },
}

/// Phases of the lines of a multisine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phases {
    /// Schroeder's: line i of n has the phase `-pi i (i - 1)/n`, which keeps the peak low (M. R. Schroeder, 1970).
    Schroeder,
    /// Random and uniform over a turn, from a seed: averaging over several seeds reveals nonlinear distortions.
    Random {
        /// Seed of the phases.
        seed: u64,
    },
}

/// An input over time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Excitation {
    /// Gaussian values, each held for a while; the band ends where the hold has its first zero, at 1/hold Hz.
    Noise {
        /// Standard deviation, unit of the input.
        std: f64,
        /// Time for which each value is held, s; a whole number of samples.
        hold: f64,
        /// Seed of the values.
        seed: u64,
    },
    /// Lines of equal amplitude at every multiple of the period's frequency within a band; repeats after the period.
    Multisine {
        /// Samples in a period.
        period: usize,
        /// Lowest frequency, Hz.
        low: f64,
        /// Highest frequency, Hz.
        high: f64,
        /// Root mean square, unit of the input.
        rms: f64,
        /// Phases of the lines.
        phases: Phases,
    },
    /// A sine whose frequency rises linearly over the whole record.
    Chirp {
        /// Frequency at the start, Hz.
        low: f64,
        /// Frequency at the end, Hz.
        high: f64,
        /// Amplitude, unit of the input.
        amplitude: f64,
    },
}

impl Excitation {
    /// `samples` values, `sample_time` seconds apart.
    ///
    /// # Errors
    /// [`ExcitationError`] when a setting is out of range.
    pub fn samples(&self, samples: usize, sample_time: f64) -> Result<Vec<f64>, ExcitationError> {
        positive("sample time", sample_time)?;
        match *self {
            Excitation::Noise { std, hold, seed } => noise(samples, sample_time, std, hold, seed),
            Excitation::Multisine { period, low, high, rms, phases } => {
                band(low, high, sample_time)?;
                positive("root mean square", rms)?;
                let one = multisine(period, sample_time, low, high, rms, phases)?;
                Ok(one.iter().copied().cycle().take(samples).collect())
            }
            Excitation::Chirp { low, high, amplitude } => {
                band(low, high, sample_time)?;
                positive("amplitude", amplitude)?;
                let duration = samples as f64 * sample_time;
                Ok((0..samples)
                    .map(|i| {
                        let t = i as f64 * sample_time;
                        amplitude * (2.0 * PI * t * (low + 0.5 * (high - low) * t / duration)).sin()
                    })
                    .collect())
            }
        }
    }
}

/// Largest magnitude over root mean square; zero for a signal that is zero.
#[must_use]
pub fn crest_factor(signal: &[f64]) -> f64 {
    let size = root_mean_square(signal.iter().copied());
    let peak = signal.iter().fold(0.0_f64, |peak, x| peak.max(x.abs()));
    if size > 0.0 { peak / size } else { 0.0 }
}

fn positive(setting: &'static str, value: f64) -> Result<(), ExcitationError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(ExcitationError::NotPositive { setting, value }) }
}

fn band(low: f64, high: f64, sample_time: f64) -> Result<(), ExcitationError> {
    let nyquist = 0.5 / sample_time;
    if low >= 0.0 && low < high && high < nyquist { Ok(()) } else { Err(ExcitationError::Band { low, high, nyquist }) }
}

fn noise(samples: usize, sample_time: f64, std: f64, hold: f64, seed: u64) -> Result<Vec<f64>, ExcitationError> {
    positive("standard deviation", std)?;
    positive("hold", hold)?;
    let held = (hold / sample_time).round();
    if held < 1.0 || (hold / sample_time - held).abs() > MOST_OFF_WHOLE_SAMPLES {
        return Err(ExcitationError::Hold { hold, sample_time });
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut signal = Vec::with_capacity(samples);
    let mut value = 0.0;
    for i in 0..samples {
        if i % held as usize == 0 {
            let normal: f64 = StandardNormal.sample(&mut random);
            value = std * normal;
        }
        signal.push(value);
    }
    Ok(signal)
}

fn multisine(
    period: usize,
    sample_time: f64,
    low: f64,
    high: f64,
    rms: f64,
    phases: Phases,
) -> Result<Vec<f64>, ExcitationError> {
    let spacing = 1.0 / (period as f64 * sample_time);
    // Lines lie below half the sampling frequency, as the band does: the last bin of an even transform has no phase.
    let lines: Vec<usize> = (1..period.div_ceil(2)).filter(|&k| (low..=high).contains(&(k as f64 * spacing))).collect();
    if lines.is_empty() {
        return Err(ExcitationError::NoLine { period, low, high, spacing });
    }
    let amplitude = rms * (2.0 / lines.len() as f64).sqrt();
    let mut random = ChaCha8Rng::seed_from_u64(if let Phases::Random { seed } = phases { seed } else { 0 });
    let turn = Uniform::new(0.0, 2.0 * PI).expect("invariant: the range is not empty");
    let transform = inverse(period);
    let mut spectrum = transform.make_input_vec();
    for (i, &line) in lines.iter().enumerate() {
        let phase = match phases {
            Phases::Schroeder => -PI * (i * (i + 1)) as f64 / lines.len() as f64,
            Phases::Random { .. } => turn.sample(&mut random),
        };
        spectrum[line] = Complex::from_polar(0.5 * amplitude, phase);
    }
    let mut signal = transform.make_output_vec();
    transform.process(&mut spectrum, &mut signal).expect("invariant: buffers were made for this transform");
    Ok(signal)
}

#[cfg(test)]
mod tests {
    use super::{Excitation, ExcitationError, Phases, crest_factor};
    use std::f64::consts::PI;
    use tpm_numerics::root_mean_square;

    #[test]
    fn noise_is_held_and_repeatable() {
        let make = |seed| Excitation::Noise { std: 0.3, hold: 0.01, seed }.samples(20_000, 1e-3).expect("valid");
        let signal = make(4);
        assert_eq!(signal, make(4));
        assert_ne!(signal, make(5));
        assert!(signal.chunks(10).all(|held| held.iter().all(|x| *x == held[0])));
        assert_ne!(signal[9], signal[10]);
        let size = root_mean_square(signal.iter().copied());
        assert!((size - 0.3).abs() < 0.02, "{size}");
    }

    #[test]
    fn a_multisine_has_its_lines_and_no_others() {
        for phases in [Phases::Schroeder, Phases::Random { seed: 1 }] {
            let signal = Excitation::Multisine { period: 500, low: 4.0, high: 20.0, rms: 2.0, phases }
                .samples(1000, 1e-3)
                .expect("valid");
            assert!((root_mean_square(signal.iter().copied()) - 2.0).abs() < 1e-12);
            assert!((signal[0] - signal[500]).abs() < 1e-12);
            // Lines 2 Hz apart from 4 to 20 Hz: nine, each of amplitude 2 sqrt(2/9).
            for k in 0..250 {
                let (mut re, mut im) = (0.0, 0.0);
                for (i, x) in signal[..500].iter().enumerate() {
                    let angle = 2.0 * PI * (k * i) as f64 / 500.0;
                    re += x * angle.cos() / 250.0;
                    im += x * angle.sin() / 250.0;
                }
                let expected = if (2..=10).contains(&k) { 2.0 * (2.0_f64 / 9.0).sqrt() } else { 0.0 };
                assert!((re.hypot(im) - expected).abs() < 1e-12, "line {k}");
            }
        }
    }

    #[test]
    fn schroeder_phases_keep_the_peak_low() {
        let make = |phases| {
            let settings = Excitation::Multisine { period: 4096, low: 1.0, high: 100.0, rms: 1.0, phases };
            crest_factor(&settings.samples(4096, 1e-3).expect("valid"))
        };
        let (schroeder, random) = (make(Phases::Schroeder), make(Phases::Random { seed: 3 }));
        assert!(schroeder < 1.9 && schroeder < 0.7 * random, "{schroeder} {random}");
    }

    #[test]
    fn a_chirp_sweeps_its_band() {
        let signal = Excitation::Chirp { low: 1.0, high: 21.0, amplitude: 0.5 }.samples(10_000, 1e-3).expect("valid");
        let crossings = |part: &[f64]| part.windows(2).filter(|w| (w[0] < 0.0) != (w[1] < 0.0)).count();
        // Mean frequency 2 Hz in the first second, 20 Hz in the last.
        assert!((3..=5).contains(&crossings(&signal[..1000])));
        assert!((39..=41).contains(&crossings(&signal[9000..])));
        assert!(signal.iter().all(|x| x.abs() <= 0.5));
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let noise = Excitation::Noise { std: 1.0, hold: 0.0015, seed: 0 };
        assert_eq!(noise.samples(10, 1e-3), Err(ExcitationError::Hold { hold: 0.0015, sample_time: 1e-3 }));
        let chirp = Excitation::Chirp { low: 1.0, high: 600.0, amplitude: 1.0 };
        assert!(matches!(chirp.samples(10, 1e-3), Err(ExcitationError::Band { .. })));
        let sparse = Excitation::Multisine { period: 10, low: 1.0, high: 20.0, rms: 1.0, phases: Phases::Schroeder };
        assert!(matches!(sparse.samples(10, 1e-3), Err(ExcitationError::NoLine { .. })));
        let silent = Excitation::Noise { std: f64::NAN, hold: 0.01, seed: 0 };
        assert!(matches!(silent.samples(10, 1e-3), Err(ExcitationError::NotPositive { .. })));
    }
}
