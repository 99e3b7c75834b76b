//! The power of a signal in bands of frequencies, which tells how fast a machine moves.

use crate::time_domain::transform::{Transform, quick};
use std::f64::consts::PI;

/// Ratio of the ends of a band of frequencies over which power is averaged.
const BAND_RATIO: f64 = 1.15;
/// Power, as a multiple of that of the noise, at which a band of many frequencies holds motion.
const LEAST_POWER_RATIO: f64 = 2.0;
/// What a band of one frequency needs more; a band of n frequencies needs this over the root of n more.
const ONE_LINE_EXCESS: f64 = 8.0;

/// How fast a signal moves, as far as its noise lets see.
#[derive(Clone, Debug, PartialEq)]
pub struct Swiftness {
    /// Highest frequency that stands out of the noise, Hz.
    pub highest: f64,
    /// Time in which the signal goes to and fro once, on the average, s.
    pub typical_period: f64,
    /// Frequency (Hz), and the deviation that white noise of the power there would have, unit of the signal.
    pub spectrum: Vec<(f64, f64)>,
}

impl Swiftness {
    /// How fast a signal moves that is recorded in stretches, given the deviation of its noise.
    pub fn of(signals: &[&[f64]], sample_time: f64, noise: f64) -> Self {
        let bands = Bands::of(signals, sample_time);
        let highest = bands.highest(noise);
        let level = |(upper, power, unit, count): &(f64, f64, f64, f64)| {
            (*count > 0.0).then(|| (upper / BAND_RATIO.sqrt() / (2.0 * PI), (power / unit).sqrt()))
        };
        Swiftness {
            highest: highest / (2.0 * PI),
            typical_period: bands.typical_period(highest),
            spectrum: bands.bands.iter().filter_map(level).collect(),
        }
    }
}

/// Time in which a signal goes to and fro once, on the average, given the deviation of its noise, s.
pub(crate) fn typical_period(signal: &[f64], sample_time: f64, noise: f64) -> f64 {
    let bands = Bands::of(&[signal], sample_time);
    bands.typical_period(bands.highest(noise))
}

/// A spectrum of power over all stretches, in bands.
pub(super) struct Bands {
    /// Upper end (rad/s), power, power that white noise of deviation one would have, and number of frequencies.
    bands: Vec<(f64, f64, f64, f64)>,
}

impl Bands {
    pub(super) fn of(signals: &[&[f64]], sample_time: f64) -> Self {
        let longest = signals.iter().map(|signal| signal.len()).max().unwrap_or(2).max(2);
        let lowest = 2.0 * PI / (longest as f64 * sample_time);
        let count = ((PI / sample_time / lowest).ln() / BAND_RATIO.ln()).ceil().max(1.0) as usize + 1;
        let mut bands: Vec<(f64, f64, f64, f64)> =
            (1..=count).map(|i| (lowest * BAND_RATIO.powi(i as i32), 0.0, 0.0, 0.0)).collect();
        for signal in signals.iter().filter(|signal| signal.len() > 2) {
            let samples = signal.len();
            let mean = signal.iter().sum::<f64>() / samples as f64;
            // Without a window the ends of a motion that does not close would pass for high frequencies.
            let hann = |k: usize| 0.5 - 0.5 * (2.0 * PI * (k as f64 + 0.5) / samples as f64).cos();
            let windowed: Vec<f64> = signal.iter().enumerate().map(|(k, x)| (x - mean) * hann(k)).collect();
            let points = quick(samples);
            let mut padded = windowed;
            padded.resize(points, 0.0);
            let transform = Transform::new(&padded, points, sample_time);
            let spacing = transform.spacing();
            for (k, power) in transform.powers().enumerate().skip(1) {
                let at = ((k as f64 * spacing / lowest).ln() / BAND_RATIO.ln()).max(0.0) as usize;
                let band = &mut bands[at.min(count - 1)];
                band.1 += power;
                band.2 += 0.375 * samples as f64;
                band.3 += 1.0;
            }
        }
        Bands { bands }
    }

    /// Highest frequency at which there is more than white noise of a deviation, rad/s.
    pub(super) fn highest(&self, white: f64) -> f64 {
        let stands_out = |&&(_, power, unit, count): &&(f64, f64, f64, f64)| {
            count > 0.0 && power > (LEAST_POWER_RATIO + ONE_LINE_EXCESS / count.sqrt()) * white * white * unit
        };
        self.bands.iter().rev().find(stands_out).or(self.bands.first()).map_or(0.0, |band| band.0)
    }

    /// Mean square of the signal and of its rate, but for a factor, up to a frequency.
    fn moments(&self, highest: f64) -> (f64, f64) {
        let own = self.bands.iter().filter(|band| band.0 <= highest * BAND_RATIO);
        own.fold((0.0, 0.0), |(position, rate), band| (position + band.1, rate + band.1 * band.0 * band.0 / BAND_RATIO))
    }

    /// Time in which the signal goes to and fro once, on the average, up to a frequency, s.
    pub(super) fn typical_period(&self, highest: f64) -> f64 {
        let (position, rate) = self.moments(highest);
        let frequency = (rate / position.max(f64::MIN_POSITIVE)).sqrt();
        2.0 * PI / frequency.max(f64::MIN_POSITIVE)
    }
}
