//! What the innovations of a fit show: whether they are white.

use crate::output_error::signals::Signals;
use num_complex::Complex;
use std::f64::consts::PI;
use tpm_numerics::alarm;
use tpm_numerics::fourier::forward;

/// Harmonics at which the innovations are compared with their neighbours.
const MOST_HARMONICS: usize = 24;
/// A vibration of the machine lies above this multiple of the highest harmonic of its motion.
const VIBRATION_OVER_MOTION: f64 = 2.0;
/// Samples that a vibration must have in one of its periods.
const LEAST_SAMPLES_PER_VIBRATION: usize = 5;
/// Bins on either side over which the power of the innovations is averaged.
const BINS_PER_SIDE: usize = 10;

/// Innovations of every sensor, each with the sample to which it belongs.
pub(super) struct Innovations {
    sensors: Vec<Vec<(u32, f64)>>,
}

/// Something that is measured beside what chance allows.
pub(super) struct Finding {
    pub(super) value: f64,
    pub(super) beyond_chance: bool,
}

impl Innovations {
    /// Sorts innovations by sensor, given the sample and the sensor of each.
    pub(super) fn new(innovations: &[f64], places: &[(u32, u32)], sensors: usize) -> Self {
        let mut of = vec![Vec::with_capacity(innovations.len() / sensors.max(1)); sensors];
        for (&value, &(sample, sensor)) in innovations.iter().zip(places) {
            of[sensor as usize].push((sample, value));
        }
        Innovations { sensors: of }
    }

    /// Correlation of successive innovations of the same sensor.
    pub(super) fn neighbours(&self) -> Finding {
        let all = self.sensors.iter().flatten();
        let (power, count) = all.fold((0.0, 0.0), |(power, count), (_, e)| (power + e * e, count + 1.0));
        let pairs = self.sensors.iter().flat_map(|sensor| sensor.windows(2));
        let product: f64 = pairs.map(|pair| pair[0].1 * pair[1].1).sum();
        let value = if power > 0.0 { product / power } else { 0.0 };
        Finding { value, beyond_chance: value * f64::sqrt(count) > alarm::INNOVATIONS_NOT_WHITE }
    }

    /// Mean power at the lowest harmonics in units of the mean power; one where the motion has no harmonics.
    pub(super) fn at_harmonics(&self, samples_per_period: Option<f64>) -> Finding {
        let Some(samples_per_period) = samples_per_period else {
            return Finding { value: 1.0, beyond_chance: false };
        };
        let mut power = 0.0;
        let mut count = 0.0;
        for sensor in &self.sensors {
            let number = sensor.len() as f64;
            let variance = sensor.iter().map(|(_, e)| e * e).sum::<f64>() / number.max(1.0);
            if variance <= 0.0 {
                continue;
            }
            for k in 1..=MOST_HARMONICS.min((samples_per_period / 4.0) as usize) {
                let angle = -2.0 * PI * k as f64 / samples_per_period;
                let line: Complex<f64> =
                    sensor.iter().map(|&(sample, e)| Complex::from_polar(e, angle * f64::from(sample))).sum();
                power += line.norm_sqr() / number / variance;
                count += 1.0;
            }
        }
        if count > 0.0 {
            let value: f64 = power / count;
            // |line|^2 over its mean is exponential: mean one, variance one.
            Finding { value, beyond_chance: (value - 1.0) * f64::sqrt(count) > alarm::INNOVATIONS_NOT_WHITE }
        } else {
            Finding { value: 1.0, beyond_chance: false }
        }
    }

    /// Frequency, in Hz, at which the innovations have more power than chance allows beside the harmonics of the motion.
    pub(super) fn vibration(&self, signals: &Signals<'_>) -> Option<f64> {
        let mut worst: Option<(f64, f64)> = None;
        for ((c, _), sensor) in signals.sensors().zip(&self.sensors) {
            let mut series: Vec<f64> = sensor.iter().map(|(_, e)| *e).collect();
            let samples = series.len();
            if samples < 16 * BINS_PER_SIDE {
                continue;
            }
            let transform = forward(samples);
            let mut spectrum = transform.make_output_vec();
            transform.process(&mut series, &mut spectrum).ok()?;
            let above = VIBRATION_OVER_MOTION * signals.highest(c) * samples as f64 * signals.sample_time;
            // Bins at the harmonics tell of terms, not of vibrations.
            let between = |bin: usize| {
                let Some(period) = signals.samples_per_period().map(|of| samples as f64 / of) else { return true };
                let beyond = (bin as f64 / period).fract();
                beyond.min(1.0 - beyond) * period > 0.75 || period < 2.0
            };
            let powers: Vec<(usize, f64)> = (spectrum.iter().enumerate().skip(1))
                .filter(|(bin, _)| between(*bin))
                .map(|(bin, z)| (bin, z.norm_sqr()))
                .collect();
            let mean = powers.iter().map(|p| p.1).sum::<f64>() / powers.len().max(1) as f64;
            let count = 2 * BINS_PER_SIDE + 1;
            if mean <= 0.0 || powers.len() < 4 * count {
                continue;
            }
            for window in powers.windows(count) {
                let level = window.iter().map(|p| p.1).sum::<f64>() / count as f64 / mean;
                // Chernoff's bound on the mean of exponential variables.
                let unlikely = count as f64 * (level - 1.0 - level.ln());
                if level > 1.0
                    && unlikely > alarm::exponential(alarm::VIBRATION_RATE, powers.len())
                    && worst.is_none_or(|(most, _)| level > most)
                {
                    let strongest = window.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
                    // Nearer to the sampling frequency it is how the record was sampled that shows.
                    if strongest.0 * LEAST_SAMPLES_PER_VIBRATION < samples && strongest.0 as f64 > above {
                        worst = Some((level, strongest.0 as f64 / (samples as f64 * signals.sample_time)));
                    }
                }
            }
        }
        worst.map(|(_, frequency)| frequency)
    }
}
