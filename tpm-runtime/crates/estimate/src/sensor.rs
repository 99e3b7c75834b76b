//! What the readings of a sensor say of the sensor itself: its noise, and the step of its counts.

use tpm_numerics::differences::white_noise;
use tpm_numerics::{counted, grid, root_mean_square, tolerance};

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
        let grids: Vec<[f64; 2]> =
            signals.iter().map(|own| [own, own.get(1..).unwrap_or_default()].map(grid)).collect();
        let counts = signals
            .iter()
            .zip(&grids)
            .map(|(own, [whole, rest])| counted(own, *whole).max(counted(own.get(1..).unwrap_or_default(), *rest)));
        let step = of_all(counts);
        let seen = (power / count).sqrt().max(rounding(step));
        let least = tolerance::READING * size;
        // Rounding is there however many counts the motion passes between two readings.
        Sensor {
            noise: seen.max(rounding(of_all(grids.iter().map(|[whole, rest]| whole.max(*rest))))).max(least),
            step,
            noisy: seen > least,
        }
    }
}

/// The least of the steps of stretches; zero where one of them has none.
fn of_all(steps: impl Iterator<Item = f64>) -> f64 {
    let least = steps.fold(f64::INFINITY, |least, step| if step > 0.0 { least.min(step) } else { 0.0 });
    if least.is_finite() { least } else { 0.0 }
}

/// Deviation of what is lost in rounding to multiples of a step.
fn rounding(step: f64) -> f64 {
    step / 12.0_f64.sqrt()
}
