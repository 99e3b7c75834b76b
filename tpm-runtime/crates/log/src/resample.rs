//! Uneven time stamps: whether the readings or the stamps are late, and readings on an even grid.
//!
//! A motion is smooth, so that a reading lies close to the cubic through its four neighbours. Readings that were taken
//! evenly and stamped late lie on the cubic over even times; readings that were taken late lie on the cubic over their
//! stamps.
//!
//! A held input is no smooth signal: it jumps at its stamps and stays. A cubic through it rings at every jump. Its samples on the grid are
//! its means from one point to the next, so that its integral, which is what moves a machine, is that of the record.

use serde::Serialize;
use tpm_numerics::differences::deviation_of;

/// Most readings on which a residual is taken.
const MOST_JUDGED: usize = 200_000;
/// Order of the error of a cubic in the step.
const CUBIC_ERROR_ORDER: f64 = 4.0;

/// The error that interpolation makes in a signal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InterpolationError {
    /// The column.
    pub column: String,
    /// Root mean square of the error, in the unit of the signal. It is extrapolated to the step of the record from the
    /// residuals of cubics through every second and every fourth reading. Noise of the readings counts as error.
    pub rms: f64,
    /// That error as a share of the signal's standard deviation.
    pub share: f64,
}

/// Value at a time of the cubic through four points.
pub(super) fn cubic(t: [f64; 4], y: [f64; 4], at: f64) -> f64 {
    let mut value = 0.0;
    for (i, yi) in y.iter().enumerate() {
        let mut weight = 1.0;
        for j in 0..4 {
            if j != i {
                weight *= (at - t[j]) / (t[i] - t[j]);
            }
        }
        value += weight * yi;
    }
    value
}

/// Residuals of readings about the cubic through the four readings that are `near` and `far` places before and behind
/// them.
pub(super) fn residuals<'a>(
    time: impl Fn(usize) -> f64 + 'a,
    signal: &'a [f64],
    near: usize,
    far: usize,
) -> impl Iterator<Item = f64> + 'a {
    let skip = (signal.len() / MOST_JUDGED).max(1);
    (far..signal.len().saturating_sub(far)).step_by(skip).map(move |k| {
        let nodes = [k - far, k - near, k + near, k + far];
        // Times relative to the reading keep the digits of stamps that count from 1970.
        let now = time(k);
        signal[k] - cubic(nodes.map(|i| time(i) - now), nodes.map(|i| signal[i]), 0.0)
    })
}

/// Robust deviation of the residuals of a signal at given times.
fn roughness(time: impl Fn(usize) -> f64, signal: &[f64]) -> f64 {
    deviation_of(residuals(time, signal, 1, 2).map(f64::abs))
}

/// Logarithm of the ratio of a signal's roughness at its stamps to its roughness on an even grid; zero where either is
/// zero.
pub(super) fn rougher_at_stamps(stamps: &[f64], signal: &[f64]) -> f64 {
    let even = roughness(|i| i as f64, signal);
    let stamped = roughness(|i| stamps[i], signal);
    if even > 0.0 && stamped > 0.0 { (stamped / even).ln() } else { 0.0 }
}

/// The readings on an even grid, by cubic interpolation between their stamps.
pub(super) fn on_grid(stamps: &[f64], signal: &[f64], step: f64, samples: usize) -> Vec<f64> {
    let last = stamps.len() - 1;
    let mut i = 0;
    (0..samples)
        .map(|k| {
            let at = stamps[0] + k as f64 * step;
            while i + 1 < last && stamps[i + 1] <= at {
                i += 1;
            }
            let first = i.saturating_sub(1).min(last.saturating_sub(3));
            let nodes = [first, first + 1, first + 2, first + 3];
            cubic(nodes.map(|n| stamps[n] - at), nodes.map(|n| signal[n]), 0.0)
        })
        .collect()
}

/// Least share of the readings that repeat the one before, from which on a channel is held between jumps.
const LEAST_HELD: f64 = 0.5;

/// Whether a channel stays at its readings and jumps between them.
pub(super) fn is_held(signal: &[f64]) -> bool {
    let equal = signal.windows(2).filter(|pair| pair[0] == pair[1]).count();
    let steps = signal.len().saturating_sub(1);
    equal < steps && equal as f64 >= LEAST_HELD * steps as f64
}

/// Means of a signal that is held between its stamps, from every point of an even grid to the next one.
pub(super) fn held_on_grid(stamps: &[f64], signal: &[f64], step: f64, samples: usize) -> Vec<f64> {
    // Times since the first stamp keep the digits of stamps that count from 1970.
    let until = |i: usize| stamps.get(i + 1).map_or(f64::INFINITY, |stamp| stamp - stamps[0]);
    let mut i = 0;
    (0..samples)
        .map(|k| {
            let (from, to) = (k as f64 * step, (k + 1) as f64 * step);
            while until(i) <= from {
                i += 1;
            }
            // An interval within which nothing changes has that very value.
            if until(i) >= to {
                return signal[i];
            }
            let (mut at, mut sum) = (from, 0.0);
            while at < to {
                let end = until(i).min(to);
                sum += (end - at) * signal[i];
                at = end;
                i += usize::from(at < to);
            }
            sum / step
        })
        .collect()
}

/// The reading before each point of an even grid.
pub(super) fn readings_before(stamps: &[f64], step: f64, samples: usize) -> Vec<usize> {
    let mut i = 0;
    (0..samples)
        .map(|k| {
            let at = stamps[0] + k as f64 * step;
            while i + 1 < stamps.len() && stamps[i + 1] <= at {
                i += 1;
            }
            i
        })
        .collect()
}

/// Root mean square of the error of interpolation between the stamps of a signal, in its unit. The residuals at two and
/// at four times the step show with which power of the step the error falls.
pub(super) fn interpolation_error(stamps: &[f64], signal: &[f64]) -> f64 {
    let rms = |near: usize, far: usize| {
        let (sum, count) =
            residuals(|i| stamps[i], signal, near, far).fold((0.0, 0), |(sum, n), r| (sum + r * r, n + 1));
        if count > 0 { f64::sqrt(sum / f64::from(count)) } else { 0.0 }
    };
    // These cubics have two and four times the step of the record.
    let (second, fourth) = (rms(1, 3), rms(2, 6));
    if second > 0.0 && fourth > 0.0 {
        second * (-(fourth / second).log2().clamp(0.0, CUBIC_ERROR_ORDER)).exp2()
    } else {
        second
    }
}

#[cfg(test)]
mod tests {
    use super::{held_on_grid, interpolation_error, is_held, on_grid, rougher_at_stamps};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Stamps every 10 ms that are uneven by up to 1 ms.
    fn stamps() -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        (0..4000).map(|i| 1.7e9 + 0.01 * f64::from(i) + rng.random_range(-1e-3..1e-3)).collect()
    }

    fn motion(t: f64) -> f64 {
        (3.0 * (t - 1.7e9)).sin()
    }

    #[test]
    fn late_stamps_are_told_from_late_readings() {
        let stamps = stamps();
        let late: Vec<f64> = stamps.iter().map(|t| motion(*t)).collect();
        let even: Vec<f64> = (0..4000).map(|i| motion(1.7e9 + 0.01 * f64::from(i))).collect();
        assert!(rougher_at_stamps(&stamps, &late) < -1.0);
        assert!(rougher_at_stamps(&stamps, &even) > 1.0);
    }

    #[test]
    fn a_held_input_keeps_its_integral() {
        let stamps = stamps();
        let signal: Vec<f64> = (0..4000).map(|i: usize| [0.0, 70.0, -30.0, 70.0][i / 37 % 4]).collect();
        assert!(is_held(&signal));
        assert!(!is_held(&[1.0; 9]));
        assert!(!is_held(&stamps));
        let samples = 3990;
        let grid = held_on_grid(&stamps, &signal, 0.01, samples);
        let end = 0.01 * samples as f64;
        let since = |i: usize| stamps.get(i).map_or(end, |stamp| (stamp - stamps[0]).min(end));
        let whole: f64 = (0..4000).map(|i| (since(i + 1) - since(i)) * signal[i]).sum();
        assert!((0.01 * grid.iter().sum::<f64>() - whole).abs() < 1e-5);
        // Means lie between the levels, but for rounding.
        assert!(grid.iter().all(|u| *u > -30.0 - 1e-9 && *u < 70.0 + 1e-9));
        assert!(grid.iter().filter(|u| (*u - 70.0).abs() < 1e-9).count() > 1900);
    }

    #[test]
    fn the_error_of_interpolation_is_stated() {
        let stamps = stamps();
        let signal: Vec<f64> = stamps.iter().map(|t| motion(*t)).collect();
        let grid = on_grid(&stamps, &signal, 0.01, 3999);
        let squares = grid.iter().enumerate().map(|(k, x)| (x - motion(stamps[0] + 0.01 * k as f64)).powi(2));
        let (error, stated) = ((squares.sum::<f64>() / 3999.0).sqrt(), interpolation_error(&stamps, &signal));
        assert!(error < 2.0 * stated && stated < 20.0 * error, "{error} {stated}");
    }
}
