//! Harmonics of a run near natural modes of the machine (Feng, 2.1, 3.2.1, 4.2).
//!
//! Invariant: the modes are those of the parameters with which the feed-forward of the run is computed, so that they are known
//! before the run is played.

use num_complex::Complex;
use serde::Serialize;
use tpm_controller::model::Model;
use tpm_motion::Trial;
use tpm_numerics::fourier::analyse;
use tpm_plant::stability::natural_modes;

/// Largest relative distance of a harmonic from a natural frequency at which the harmonic counts as near the mode.
const MOST_DISTANCE_OF_MODE: f64 = 0.05;
/// Smallest harmonic that is compared with the natural modes, as a share of the largest: of the acceleration of a coordinate, and
/// of an input.
const LEAST_HARMONIC: f64 = 1e-3;

/// A harmonic near a natural mode of the machine (Feng, 2.1, 4.2).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NearMode {
    /// Coordinate or input that has the harmonic.
    pub signal: String,
    /// The harmonic.
    pub harmonic: u32,
    /// Natural frequency of the mode, rad/s.
    pub frequency: f64,
}

/// The first harmonic of the reference, or of the feed-forward, near a natural mode. The modes are computed with
/// the parameters of the feed-forward; there are none where these determine no motion.
pub fn near_mode(model: &dyn Model<f64>, trial: &Trial) -> Option<NearMode> {
    let position: Vec<f64> = trial.trajectory.coordinates.iter().map(|series| series.mean).collect();
    let modes = natural_modes(model, &trial.parameters, &trial.constants, &position).unwrap_or_default();
    if modes.is_empty() {
        return None;
    }
    let near = |harmonic: u32| {
        let frequency = f64::from(harmonic) * trial.trajectory.frequency;
        modes.iter().copied().find(|mode| (frequency / mode - 1.0).abs() < MOST_DISTANCE_OF_MODE)
    };
    let found = |signal: &str, harmonic: u32| {
        near(harmonic).map(|frequency| NearMode { signal: signal.into(), harmonic, frequency })
    };
    let moved = trial.trajectory.coordinates.iter().enumerate().find_map(|(c, series)| {
        let acceleration = |k: u32, cos: f64, sin: f64| f64::from(k).powi(2) * cos.hypot(sin);
        let sizes = series.lines.iter().map(|line| (line.harmonic, acceleration(line.harmonic, line.cos, line.sin)));
        let largest = sizes.clone().map(|(_, size)| size).fold(0.0, f64::max);
        let mut strong = sizes.filter(|(_, size)| *size > LEAST_HARMONIC * largest);
        strong.find_map(|(harmonic, _)| found(model.coordinate(c).name, harmonic))
    });
    moved.or_else(|| {
        let inputs = model.dims().inputs;
        let reach = 8 * trial.trajectory.highest_harmonic() as usize;
        (0..inputs).find_map(|i| {
            let lines = analyse(&trial.feed_forward, i, inputs, reach);
            let largest = lines.iter().skip(1).map(|line| line.norm()).fold(0.0, f64::max);
            let strong = |&(_, line): &(usize, &Complex<f64>)| line.norm() > LEAST_HARMONIC * largest;
            let mut strong = lines.iter().enumerate().skip(1).filter(strong);
            strong.find_map(|(k, _)| found(model.input(i).name, k as u32))
        })
    })
}
