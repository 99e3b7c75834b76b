//! Whether a motion keeps within limits at every instant, not only at samples.
//!
//! Positions and their derivatives are finite series: their largest magnitude exceeds that of equal steps of a period by a factor that is
//! known ([`excess`]). Torques are not: they are enclosed over ranges of the phase, which are halved until every range keeps within or an
//! instant beyond is found.

use super::series::excess;
use tpm_controller::model::EvalError;
use tpm_interpret::{BaseRows, Interval};
use tpm_motion::trajectory::{HarmonicSeries, Trajectory};

/// Samples in the period of the highest harmonic for the bound of a series; it then exceeds the largest value by at most 5e-4.
const STEPS: usize = 100;
/// Ranges of the phase to begin with, in a period of the highest harmonic.
const RANGES: usize = 32;
/// Most halvings of a range: its length is then 1e-6 of a period.
const HALVINGS: u32 = 14;

/// A bound of the largest magnitude of a derivative of `series - centre`, for every instant.
pub(super) fn bound(series: &HarmonicSeries, frequency: f64, order: usize, centre: f64) -> f64 {
    let highest = series.highest_harmonic().max(1);
    let samples = STEPS * highest as usize;
    let shift = if order == 0 { centre } else { 0.0 };
    let at = |n: usize| {
        let phase = 2.0 * std::f64::consts::PI * n as f64 / samples as f64;
        (series.derivative(phase, frequency, order) - shift).abs()
    };
    (0..samples).map(at).fold(0.0, f64::max) * excess(highest, samples)
}

/// What of the inputs' limits was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Torques {
    /// Every instant keeps within.
    Within,
    /// The share of its limit that an input asks for at a phase: beyond one, or so near that it cannot be told.
    Beyond(f64),
}

/// Whether the inputs `factors times forces` keep within their limits along a motion. `factors` is row-major, inputs times rows.
pub(super) fn torques(
    rows: &BaseRows,
    motion: &Trajectory,
    constants: &[f64],
    parameters: &[f64],
    factors: &[f64],
    limits: &[f64],
) -> Result<Torques, EvalError> {
    let dims = rows.dims();
    let count = RANGES * motion.highest_harmonic().max(1) as usize;
    let width = 2.0 * std::f64::consts::PI / count as f64;
    let mut stack: Vec<(f64, f64, u32)> =
        (0..count).map(|n| ((n as f64 + 0.5) * width, 0.5 * width, HALVINGS)).collect();
    let mut enclosed = vec![Interval { low: 0.0, high: 0.0 }; dims.motion_len()];
    let mut workspace = Vec::new();
    while let Some((middle, half, halvings)) = stack.pop() {
        for (at, slot) in enclosed.iter_mut().enumerate() {
            let series = &motion.coordinates[at % dims.coordinates];
            *slot = around(series, motion.frequency, at / dims.coordinates, middle, half);
        }
        let forces = rows.forces_within(&enclosed, constants, parameters, &mut workspace)?;
        let share = limits.iter().zip(factors.chunks_exact(dims.rows.max(1))).map(|(limit, factors)| {
            let input = factors
                .iter()
                .zip(&forces)
                .fold(Interval::around(0.0), |sum, (&factor, &force)| sum + Interval::around(factor) * force);
            input.magnitude() / limit
        });
        let share = share.fold(0.0, f64::max);
        if share <= 1.0 {
            continue;
        }
        if halvings == 0 {
            return Ok(Torques::Beyond(share));
        }
        stack.extend([-0.5, 0.5].map(|side| (middle + side * half, 0.5 * half, halvings - 1)));
    }
    Ok(Torques::Within)
}

/// The values of a series' derivative for phases within `half` of `middle`: by its slope there and a bound of its curvature.
fn around(series: &HarmonicSeries, frequency: f64, order: usize, middle: f64, half: f64) -> Interval {
    let value = series.derivative(middle, frequency, order);
    let slope = series.derivative(middle, frequency, order + 1).abs() / frequency;
    let curvature: f64 = series
        .lines
        .iter()
        .map(|line| {
            let k = f64::from(line.harmonic);
            k * k * (k * frequency).powi(order as i32) * line.cos.hypot(line.sin)
        })
        .sum();
    // Rounding of the sums themselves.
    let radius = (half * slope + 0.5 * half * half * curvature) * (1.0 + 1e-12) + 1e-13 * (value.abs() + curvature);
    Interval { low: value - radius, high: value + radius }
}
