//! Strokes with rests between them, played over and over: one periodic motion.
//!
//! A stroke is a part of a trajectory, from one phase to another, and a rest after it. A sequence of strokes is
//! periodic, but it is no finite series, since its derivatives jump where a rest begins. Its Fourier series is
//! truncated where the omitted accelerations are negligible. The truncated series is the reference, a [`Trajectory`]
//! like any other, so that the harmonics of the reference are exactly those that are played.
//!
//! Invariant: positions, velocities and accelerations are continuous from every stroke to the rest behind it and to the
//! next stroke, and from the last stroke to the first.

use crate::trajectory::{HarmonicSeries, Line, Trajectory};
use std::f64::consts::TAU;
use tpm_numerics::fourier::analyse;
use tpm_numerics::tolerance;

/// Samples of a period from which the series is computed. The series decays so fast that aliases are far below the
/// truncation error.
const SERIES_SAMPLES: usize = 1 << 14;
/// Truncation bound: root mean square of the omitted acceleration, as a share of that of the whole acceleration.
const MOST_OMITTED: f64 = 2e-4;
/// Highest harmonic of the series.
const HIGHEST_HARMONIC: usize = 512;
/// Smallest amplitude of a substantial harmonic, as a share of the largest amplitude of its coordinate.
const LEAST_SUBSTANTIAL: f64 = 1e-4;

/// A part of a trajectory, and the rest after it.
#[derive(Clone, Debug, PartialEq)]
pub struct Stroke {
    /// The trajectory at the frequency of the strokes.
    pub trajectory: Trajectory,
    /// Phases of the trajectory between which it is played, rad.
    pub phases: (f64, f64),
    /// Rest after it, s.
    pub dwell: f64,
}

impl Stroke {
    fn moving(&self) -> f64 {
        (self.phases.1 - self.phases.0) / self.trajectory.frequency
    }
}

/// A derivative that is discontinuous at the end of a stroke.
#[derive(Clone, Debug, PartialEq)]
pub struct Break {
    /// The stroke, from 0.
    pub stroke: usize,
    /// The coordinate.
    pub coordinate: usize,
    /// Order of the derivative: 0 is the position, 1 the velocity, 2 the acceleration.
    pub order: usize,
    /// Its value at the end of the stroke, and its value just after: zero in a rest.
    pub values: (f64, f64),
    /// Whether a rest follows.
    pub rests: bool,
}

/// The first discontinuity at the end of a stroke among positions, velocities and accelerations; none for strokes that
/// form one smooth motion.
#[must_use]
pub fn first_break(strokes: &[Stroke]) -> Option<Break> {
    let coordinates = strokes.first()?.trajectory.coordinates.len();
    let value = |stroke: &Stroke, c: usize, phase: f64, order: usize| {
        stroke.trajectory.coordinates[c].derivative(phase, stroke.trajectory.frequency, order)
    };
    // The sum of the magnitudes of the harmonics bounds every value of a derivative.
    let bound = |stroke: &Stroke, c: usize, order: usize| {
        let series = &stroke.trajectory.coordinates[c];
        let lines = series.lines.iter().map(|line| {
            line.cos.hypot(line.sin) * (f64::from(line.harmonic) * stroke.trajectory.frequency).powi(order as i32)
        });
        lines.sum::<f64>() + if order == 0 { series.mean.abs() } else { 0.0 }
    };
    for order in 0..=2 {
        for c in 0..coordinates {
            let allowed =
                tolerance::JUNCTION * strokes.iter().map(|stroke| bound(stroke, c, order)).fold(0.0, f64::max);
            for (i, stroke) in strokes.iter().enumerate() {
                let next = &strokes[(i + 1) % strokes.len()];
                let ends = value(stroke, c, stroke.phases.1, order);
                let begins = value(next, c, next.phases.0, order);
                let rests = stroke.dwell > 0.0;
                let mut goes_on = vec![begins];
                if rests && order > 0 {
                    // In a rest the derivatives are zero: the stroke must end at zero, and the next stroke must begin
                    // there.
                    goes_on.insert(0, 0.0);
                }
                if let Some(&other) = goes_on.iter().find(|other| (ends - **other).abs() > allowed) {
                    return Some(Break { stroke: i, coordinate: c, order, values: (ends, other), rests });
                }
            }
        }
    }
    None
}

/// The strokes one after the other, over and over, as a Fourier series.
///
/// The strokes should be continuous from one to the next ([`first_break`]); the series smooths any jumps. Without
/// strokes, or with a total duration of zero, nothing moves.
#[must_use]
pub fn repeated(strokes: &[Stroke]) -> Trajectory {
    let total: f64 = strokes.iter().map(|stroke| stroke.moving() + stroke.dwell).sum();
    let coordinates = strokes.first().map_or(0, |stroke| stroke.trajectory.coordinates.len());
    let mut positions = vec![0.0; SERIES_SAMPLES * coordinates];
    let mut at = (0, 0.0);
    for (n, position) in positions.chunks_exact_mut(coordinates.max(1)).enumerate() {
        let time = n as f64 / SERIES_SAMPLES as f64 * total;
        while at.0 + 1 < strokes.len() && time >= at.1 + strokes[at.0].moving() + strokes[at.0].dwell {
            at = (at.0 + 1, at.1 + strokes[at.0].moving() + strokes[at.0].dwell);
        }
        let stroke = &strokes[at.0];
        let passed = (time - at.1).min(stroke.moving());
        stroke.trajectory.motion(stroke.phases.0 + stroke.trajectory.frequency * passed, position);
    }
    let series = (0..coordinates).map(|c| cut(&positions, c, coordinates)).collect();
    Trajectory { frequency: TAU / total, coordinates: series }
}

/// Highest harmonic of a series of strokes whose amplitude exceeds a ten-thousandth of the largest of its coordinate.
/// Higher harmonics shape the corners at the rests, and are hidden in noise.
#[must_use]
pub fn substantial_harmonic(strokes: &Trajectory) -> u32 {
    let of = |series: &HarmonicSeries| {
        let size = |line: &Line| line.cos.hypot(line.sin);
        let largest = series.lines.iter().map(size).fold(0.0, f64::max);
        let above = series.lines.iter().filter(|line| size(line) > LEAST_SUBSTANTIAL * largest);
        above.map(|line| line.harmonic).max().unwrap_or(0)
    };
    strokes.coordinates.iter().map(of).max().unwrap_or(0)
}

/// The series of coordinate `c`, truncated where the omitted accelerations are negligible.
fn cut(positions: &[f64], c: usize, coordinates: usize) -> HarmonicSeries {
    let lines = analyse(positions, c, coordinates, SERIES_SAMPLES / 4);
    let square = |(k, line): (usize, &num_complex::Complex<f64>)| line.norm_sqr() * (k as f64).powi(4);
    let whole: f64 = lines.iter().enumerate().map(square).sum();
    let mut left = whole;
    let mut highest = 0;
    for (k, line) in lines.iter().enumerate().take(HIGHEST_HARMONIC + 1) {
        left -= square((k, line));
        highest = k;
        if left <= MOST_OMITTED * MOST_OMITTED * whole {
            break;
        }
    }
    HarmonicSeries::from_phasors(&lines[..=highest], |k, line| {
        square((k, line)) > tolerance::SERIES * tolerance::SERIES * whole
    })
}

#[cfg(test)]
mod tests {
    use super::{Stroke, first_break, repeated};
    use crate::trajectory::tests::rest_to_rest_3;
    use std::f64::consts::PI;

    fn forth_and_back(dwell: f64) -> [Stroke; 2] {
        let trajectory = rest_to_rest_3().trajectory(&[0.3], PI);
        [(0.0, PI), (PI, 2.0 * PI)].map(|phases| Stroke { trajectory: trajectory.clone(), phases, dwell })
    }

    #[test]
    fn strokes_without_rests_are_the_pattern() {
        let whole = repeated(&forth_and_back(0.0));
        let pattern = rest_to_rest_3().trajectory(&[0.3], PI);
        assert!((whole.frequency - pattern.frequency).abs() < 1e-15);
        let (found, expected) = (&whole.coordinates[0], &pattern.coordinates[0]);
        assert_eq!(found.lines.len(), expected.lines.len());
        for (found, expected) in found.lines.iter().zip(&expected.lines) {
            assert_eq!(found.harmonic, expected.harmonic);
            assert!((found.cos - expected.cos).abs() < 1e-15 && found.sin.abs() < 1e-15);
        }
    }

    #[test]
    fn the_reference_rests_where_it_is_to_rest() {
        let strokes = forth_and_back(0.5);
        assert_eq!(first_break(&strokes), None);
        let whole = repeated(&strokes);
        // Two strokes of a second and two rests of half a second.
        assert!((whole.frequency - 2.0 * PI / 3.0).abs() < 1e-15);
        let end = 0.3 * 8.0 / 9.0;
        let fastest = 0.3 * PI * PI * 2.0;
        let at =
            |time: f64, order: usize| whole.coordinates[0].derivative(whole.frequency * time, whole.frequency, order);
        for i in 0..=20 {
            let time = 1.0 + 0.5 * f64::from(i) / 20.0;
            assert!((at(time, 0) + end).abs() < 1e-6 * end, "{}", at(time, 0) + end);
            assert!((at(time + 1.5, 0) - end).abs() < 1e-6 * end);
            assert!(at(time, 2).abs() < 5e-3 * fastest, "{} of {fastest}", at(time, 2));
            let moving = f64::from(i) / 20.0;
            let exact = strokes[0].trajectory.coordinates[0].derivative(PI * moving, PI, 0);
            assert!((at(moving, 0) - exact).abs() < 1e-6 * end);
        }
        assert!(whole.highest_harmonic() < 200, "{}", whole.highest_harmonic());
    }

    #[test]
    fn what_does_not_go_on_is_found() {
        let mut early = forth_and_back(0.5);
        early[0].phases.1 = 0.75 * PI;
        early[1].phases.0 = 0.75 * PI;
        let found = first_break(&early).expect("a velocity at the end of the first stroke");
        assert_eq!((found.stroke, found.coordinate, found.order, found.rests), (0, 0, 1, true));
        // Without the rest the velocity is continuous into the second stroke.
        early[0].dwell = 0.0;
        assert_eq!(first_break(&early), None);
        let alone = first_break(&early[..1]).expect("the stroke does not return");
        assert_eq!((alone.order, alone.rests), (0, false));
    }
}
