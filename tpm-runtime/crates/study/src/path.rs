//! A pattern of few harmonics fitted to a given path (Feng, 3.2.1).
//!
//! Invariant: a path of a stroke is played forth and back, so that its series has cosines only. Its odd derivatives
//! vanish at both ends by symmetry; the ends themselves and the requested even derivatives are met exactly. A closed
//! path has cosines and sines, and no ends. Within these conditions the series is the least-squares fit to the path.

use serde::Serialize;
use std::f64::consts::PI;
use tpm_controller::linear::solve_in_place;
use tpm_motion::trajectory::{HarmonicSeries, Line};
use tpm_numerics::root_mean_square;

/// Fewest samples of a path for each coefficient of its series.
const SAMPLES_PER_COEFFICIENT: usize = 2;

/// Settings of the fit of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathSettings {
    /// Highest harmonic of the series.
    pub harmonics: u32,
    /// Number of derivatives that vanish at both ends of a stroke.
    pub rest: u32,
    /// Whether the path ends where it begins, so that it is repeated instead of played back.
    pub closed: bool,
}

/// Why a path cannot be fitted by a pattern.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PathError {
    /// The harmonics cannot meet the conditions at the ends.
    #[error(
        "harmonics up to {harmonics} cannot start and end with the path with {rest} vanishing derivatives at both ends; the least that can go up to {least}"
    )]
    TooFewHarmonics {
        /// Highest harmonic asked for.
        harmonics: u32,
        /// Number of derivatives that vanish.
        rest: u32,
        /// Least highest harmonic.
        least: u32,
    },
    /// The path has too few samples for its harmonics.
    #[error("the path has {samples} samples, too few for harmonics up to {harmonics}; {least} are the least")]
    TooShort {
        /// Number of samples.
        samples: usize,
        /// Highest harmonic asked for.
        harmonics: u32,
        /// Least number of samples.
        least: usize,
    },
    /// The path does not move.
    #[error("the path of `{coordinate}` stands still")]
    Still {
        /// Name of the coordinate.
        coordinate: String,
    },
}

/// The Fourier series of one coordinate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FittedCoordinate {
    /// Name of the coordinate.
    pub coordinate: String,
    /// Half of the distance between its ends; half of its range on a closed path.
    pub size: f64,
    /// Mean of the series.
    pub mean: f64,
    /// Harmonics with the amplitudes of their cosine and sine, unit of the coordinate.
    pub lines: Vec<(u32, f64, f64)>,
    /// Root mean square of the distance from the path.
    pub rms: f64,
    /// Largest distance from the path.
    pub largest: f64,
}

impl FittedCoordinate {
    /// The series.
    #[must_use]
    pub fn series(&self) -> HarmonicSeries {
        let lines = self.lines.iter().map(|&(harmonic, cos, sin)| Line { harmonic, cos, sin }).collect();
        HarmonicSeries { mean: self.mean, lines }
    }
}

/// A pattern fitted to a path.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FittedPath {
    /// Fundamental frequency at which the pattern takes the time of the path, rad/s.
    pub frequency: f64,
    /// The coordinates.
    pub coordinates: Vec<FittedCoordinate>,
}

/// Fits Fourier series to a path, given the names and equidistant samples of the coordinates. The last sample is the
/// end of a stroke, or lies one sample before the beginning of a closed path. `sample_time` is in s.
///
/// # Errors
/// [`PathError`] when the harmonics cannot meet the conditions at the ends, the samples are too few, or nothing moves.
pub fn fit_path(
    path: &[(String, Vec<f64>)],
    sample_time: f64,
    settings: PathSettings,
) -> Result<FittedPath, PathError> {
    let PathSettings { harmonics, rest, closed } = settings;
    let samples = path.first().map_or(0, |(_, values)| values.len());
    // The conditions at the ends 0 and pi separate into even and odd cosines: each kind has to meet one end value and
    // the even derivatives.
    let least = 2 * (rest / 2) + 1;
    if harmonics < if closed { 1 } else { least } {
        return Err(PathError::TooFewHarmonics { harmonics, rest, least });
    }
    let least = SAMPLES_PER_COEFFICIENT * (if closed { 2 } else { 1 } * harmonics as usize + 1);
    if samples < least {
        return Err(PathError::TooShort { samples, harmonics, least });
    }
    let step = if closed { 2.0 * PI / samples as f64 } else { PI / (samples as f64 - 1.0) };
    let fitted = path.iter().map(|(name, values)| {
        let (first, last) = (values[0], values[samples - 1]);
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let size = if closed || first == last { 0.5 * (high - low) } else { 0.5 * (last - first).abs() };
        if size <= 0.0 {
            return Err(PathError::Still { coordinate: name.clone() });
        }
        let coefficients = nearest(values, step, settings).ok_or(PathError::TooFewHarmonics {
            harmonics,
            rest,
            least: 2 * (rest / 2) + 1,
        })?;
        let lines = (1..=harmonics).map(|k| {
            let sin = if closed { coefficients[(harmonics + k) as usize] } else { 0.0 };
            (k, coefficients[k as usize], sin)
        });
        let mut found = FittedCoordinate {
            coordinate: name.clone(),
            size,
            mean: coefficients[0],
            lines: lines.collect(),
            rms: 0.0,
            largest: 0.0,
        };
        let series = found.series();
        let distance = |(n, value): (usize, &f64)| series.derivative(n as f64 * step, 1.0, 0) - value;
        let distances: Vec<f64> = values.iter().enumerate().map(distance).collect();
        found.rms = root_mean_square(distances.iter().copied());
        found.largest = distances.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        Ok(found)
    });
    Ok(FittedPath { frequency: step / sample_time, coordinates: fitted.collect::<Result<_, PathError>>()? })
}

/// Coefficients of 1, cos 1, ..., cos K and, for a closed path, sin 1, ..., sin K: the normal equations with the
/// conditions at the ends as constraints. `None` where they have no unique solution.
fn nearest(values: &[f64], step: f64, settings: PathSettings) -> Option<Vec<f64>> {
    let PathSettings { harmonics, rest, closed } = settings;
    let highest = harmonics as usize;
    let unknowns = if closed { 2 * highest + 1 } else { highest + 1 };
    let basis = |phase: f64| -> Vec<f64> {
        let cosines = (0..=highest).map(|k| (k as f64 * phase).cos());
        let sines = (highest + 2..=unknowns).map(|i| ((i - highest - 1) as f64 * phase).sin());
        cosines.chain(sines).collect()
    };
    // Constraints: the values at both ends of the path, and the even derivatives there, in units of the highest
    // harmonic.
    let mut conditions: Vec<(Vec<f64>, f64)> = Vec::new();
    if !closed {
        for (phase, value) in [(0.0, values[0]), (PI, values[values.len() - 1])] {
            conditions.push((basis(phase), value));
            for order in (2..=rest as i32).step_by(2) {
                let scaled = |(k, cos): (usize, f64)| cos * (k as f64 / highest as f64).powi(order);
                conditions.push((basis(phase).into_iter().enumerate().map(scaled).collect(), 0.0));
            }
        }
    }
    let width = unknowns + conditions.len();
    let mut matrix = vec![0.0; width * width];
    let mut right = vec![0.0; width];
    for (n, value) in values.iter().enumerate() {
        let row = basis(n as f64 * step);
        for i in 0..unknowns {
            right[i] += row[i] * value / values.len() as f64;
            for j in 0..unknowns {
                matrix[i * width + j] += row[i] * row[j] / values.len() as f64;
            }
        }
    }
    for (c, (row, value)) in conditions.iter().enumerate() {
        right[unknowns + c] = *value;
        for (i, entry) in row.iter().enumerate() {
            matrix[i * width + unknowns + c] = *entry;
            matrix[(unknowns + c) * width + i] = *entry;
        }
    }
    solve_in_place(&mut matrix, &mut right).ok()?;
    right.truncate(unknowns);
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::{PathError, PathSettings, fit_path};
    use std::f64::consts::PI;

    #[test]
    fn a_path_that_is_a_pattern_is_found_again() {
        let phase = |n: usize| PI * n as f64 / 200.0;
        let path: Vec<f64> = (0..=200).map(|n| 0.5 - 0.2 * (phase(n).cos() - (3.0 * phase(n)).cos() / 9.0)).collect();
        let settings = PathSettings { harmonics: 5, rest: 3, closed: false };
        let found = fit_path(&[("x".to_string(), path)], 0.01, settings).expect("fits");
        assert!((found.frequency - PI / 2.0).abs() < 1e-12);
        let x = &found.coordinates[0];
        assert!(x.largest < 1e-12 && (x.mean - 0.5).abs() < 1e-12, "{x:?}");
        assert!((x.lines[0].1 + 0.2).abs() < 1e-12 && (x.lines[2].1 - 0.2 / 9.0).abs() < 1e-12);
        assert!((x.size - 0.2 * 8.0 / 9.0).abs() < 1e-12);
    }

    #[test]
    fn ends_are_kept_and_more_harmonics_are_nearer() {
        // A ramp has corners at both ends, which no finite series has.
        let path: Vec<f64> = (0..=400).map(|n| f64::from(n) / 400.0).collect();
        let of = |harmonics| {
            let settings = PathSettings { harmonics, rest: 3, closed: false };
            fit_path(&[("x".to_string(), path.clone())], 1e-3, settings)
        };
        let (few, more) = (of(3).expect("fits"), of(9).expect("fits"));
        for found in [&few, &more] {
            let series = found.coordinates[0].series();
            for (phase, end) in [(0.0, 0.0), (PI, 1.0)] {
                assert!((series.derivative(phase, 1.0, 0) - end).abs() < 1e-12);
                for order in 1..=3 {
                    assert!(series.derivative(phase, 1.0, order).abs() < 1e-9);
                }
            }
        }
        assert!(more.coordinates[0].rms < 0.7 * few.coordinates[0].rms);
        assert_eq!(of(2), Err(PathError::TooFewHarmonics { harmonics: 2, rest: 3, least: 3 }));
        assert!(matches!(of(300), Err(PathError::TooShort { least: 602, .. })));
    }

    #[test]
    fn a_closed_path_has_sines() {
        let phase = |n: usize| 2.0 * PI * n as f64 / 64.0;
        let path: Vec<f64> = (0..64).map(|n| 1.0 + phase(n).sin() - 0.3 * (2.0 * phase(n)).cos()).collect();
        let settings = PathSettings { harmonics: 2, rest: 0, closed: true };
        let found = fit_path(&[("x".to_string(), path)], 0.1, settings).expect("fits");
        let x = &found.coordinates[0];
        assert!((x.lines[0].2 - 1.0).abs() < 1e-12 && (x.lines[1].1 + 0.3).abs() < 1e-12 && x.largest < 1e-12);
        let still = fit_path(&[("y".to_string(), vec![1.0; 64])], 0.1, settings);
        assert!(matches!(still, Err(PathError::Still { .. })));
    }
}
