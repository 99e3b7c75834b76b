//! Uneven time stamps: whether the readings or the stamps are late, and held inputs at even times.
//!
//! A motion is smooth, so that a reading lies close to the cubic through its four neighbours. Readings that were taken
//! evenly and stamped late lie on the cubic over even times; readings that were taken late lie on the cubic over their
//! stamps.
//!
//! A held input is no smooth signal: it jumps at its stamps and stays. A cubic through it rings at every jump. Its samples on the grid are
//! its means from one point to the next, so that its integral, which is what moves a machine, is that of the record.

use crate::stamps::LEAST_GAP;
use tpm_numerics::through;

/// Most readings on which a residual is taken.
const MOST_JUDGED: usize = 200_000;
/// What is less than this share of the steps of a signal is a rounding error.
const ROUNDING: f64 = 1e-6;

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
        signal[k] - through(nodes.map(|i| time(i) - now), nodes.map(|i| signal[i]), 0.0)
    })
}

/// Logarithm of the mean distance of readings from the cubic through their four neighbours, in the unit of the signal, as noise of one size
/// makes it wherever the neighbours lie; at least that of the rounding errors.
pub(super) fn roughness(time: &[f64], signal: &[f64]) -> f64 {
    let skip = (signal.len() / MOST_JUDGED).max(1);
    let (mut sum, mut count, mut largest) = (0.0, 0.0, 0.0_f64);
    for k in (2..signal.len().saturating_sub(2)).step_by(skip) {
        // Times relative to the reading keep the digits of stamps that count from 1970, values their own.
        let nodes = [k - 2, k - 1, k + 1, k + 2];
        let [t, y] = [nodes.map(|i| time[i] - time[k]), nodes.map(|i| signal[i] - signal[k])];
        let unit = |n: usize| through(t, std::array::from_fn(|i| f64::from(u8::from(i == n))), 0.0);
        let gain = 1.0 + (0..4).map(|n| unit(n).powi(2)).sum::<f64>();
        sum += through(t, y, 0.0).abs() / gain.sqrt();
        count += 1.0;
        largest = largest.max(y.iter().fold(0.0, |most, y| y.abs().max(most)));
    }
    (sum / f64::max(count, 1.0)).max(ROUNDING * largest).max(f64::MIN_POSITIVE).ln()
}

/// Least share of the readings that repeat the one before, from which on a channel is held between jumps.
const LEAST_HELD: f64 = 0.5;

/// Whether a channel stays at its readings and jumps between them.
pub(super) fn is_held(signal: &[f64]) -> bool {
    let equal = signal.windows(2).filter(|pair| pair[0] == pair[1]).count();
    let steps = signal.len().saturating_sub(1);
    equal < steps && equal as f64 >= LEAST_HELD * steps as f64
}

/// Means of a signal that is held between its times, in samples from zero, from every even time to the next one. Where readings are missing
/// it changed before any of them or before the one behind, so that half of the time between is the mean.
pub(super) fn held_on_grid(at: &[f64], signal: &[f64], samples: usize) -> Vec<f64> {
    let until = |i: usize| match at.get(i + 1) {
        Some(next) if next - at[i] >= LEAST_GAP => 0.5 * (at[i] + next + 1.0),
        next => next.copied().unwrap_or(f64::INFINITY),
    };
    let mut i = 0;
    (0..samples)
        .map(|k| {
            let (from, to) = (k as f64, (k + 1) as f64);
            while until(i) <= from {
                i += 1;
            }
            let (first, mut at, mut sum) = (i, from, 0.0);
            while at < to {
                let end = until(i).min(to);
                sum += (end - at) * signal[i];
                at = end;
                i += usize::from(at < to);
            }
            // An interval within which nothing changes has that very value.
            if signal[first..=i].iter().all(|value| *value == signal[i]) { signal[i] } else { sum }
        })
        .collect()
}

/// The reading before each point of an even grid.
pub(super) fn readings_before(at: &[f64], samples: usize) -> Vec<usize> {
    let mut i = 0;
    (0..samples)
        .map(|k| {
            while i + 1 < at.len() && at[i + 1] <= k as f64 {
                i += 1;
            }
            i
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{held_on_grid, is_held};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn a_held_input_keeps_its_integral() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let at: Vec<f64> =
            (0..4000).map(|i| f64::from(i) + f64::from(i.min(1)) * rng.random_range(-0.1..0.1)).collect();
        let signal: Vec<f64> = (0..4000).map(|i: usize| [0.0, 70.0, -30.0, 70.0][i / 37 % 4]).collect();
        assert!(is_held(&signal));
        assert!(!is_held(&[1.0; 9]));
        assert!(!is_held(&at));
        let samples = 3990;
        let grid = held_on_grid(&at, &signal, samples);
        let end = samples as f64;
        let since = |i: usize| at.get(i).map_or(end, |at| at.min(end));
        let whole: f64 = (0..4000).map(|i| (since(i + 1) - since(i)) * signal[i]).sum();
        assert!((grid.iter().sum::<f64>() - whole).abs() < 1e-5);
        // Means lie between the levels, but for rounding.
        assert!(grid.iter().all(|u| *u > -30.0 - 1e-9 && *u < 70.0 + 1e-9));
        assert!(grid.iter().filter(|u| (*u - 70.0).abs() < 1e-9).count() > 1900);
    }

    #[test]
    fn a_held_input_changes_amid_what_is_missing() {
        assert_eq!(held_on_grid(&[0.0, 1.0, 4.0, 5.0], &[2.0, 2.0, 6.0, 6.0], 6), [2.0, 2.0, 2.0, 6.0, 6.0, 6.0]);
    }
}
