//! What the readings of a sensor say of the sensor itself: its noise, and the step of its counts.

use tpm_motion::{grid, step};
use tpm_numerics::differences::white_noise;
use tpm_numerics::{root_mean_square, tolerance};

/// A sensor, told from its readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// Deviation of the noise from sample to sample, rounding to counts included; never zero, since a file rounds its numbers.
    pub noise: f64,
    /// Step of the readings; zero where they lie on no grid.
    pub step: f64,
    /// Whether noise is seen beside the rounding of the numbers in the file.
    pub noisy: bool,
}

impl Sensor {
    /// The sensor behind readings that were recorded in stretches.
    pub fn of(signals: &[&[f64]]) -> Self {
        let count = signals.iter().map(|signal| signal.len()).sum::<usize>().max(1) as f64;
        let power: f64 = signals.iter().map(|signal| white_noise(signal).powi(2) * signal.len() as f64).sum();
        let size = root_mean_square(signals.iter().flat_map(|signal| signal.iter().copied()));
        // A record may begin with a state that no sensor read, which lies on no grid.
        let of_all = |told: fn(&[f64]) -> f64| {
            let steps = signals.iter().map(|signal| told(signal).max(told(signal.get(1..).unwrap_or_default())));
            let step = if steps.clone().all(|step| step > 0.0) { steps.fold(f64::INFINITY, f64::min) } else { 0.0 };
            if step.is_finite() { step } else { 0.0 }
        };
        let step = of_all(step);
        let seen = (power / count).sqrt().max(rounding(step));
        let least = tolerance::READING * size;
        // Rounding is there however many counts the motion passes between two readings.
        Sensor { noise: seen.max(rounding(of_all(grid))).max(least), step, noisy: seen > least }
    }
}

/// Deviation of what is lost in rounding to multiples of a step.
fn rounding(step: f64) -> f64 {
    step / 12.0_f64.sqrt()
}
