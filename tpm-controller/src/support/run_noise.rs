//! The noise of one run, read halfway between the harmonics, and what it makes of the rows at the harmonics.
//!
//! Halfway between the harmonics the rows hold without the periodic motion, so that `B u - J q` there is noise alone. The variances of
//! white noise in every sensor and of a white force on every row are those of largest likelihood; the rows' derivatives J along the motion,
//! which mix the lines, say what they make of every row at every harmonic. The force is there only where it explains more than chance does:
//! from a few lines its variance would otherwise take a share of the sensors', and the small harmonics would count less than they show.
//!
//! Invariants: nothing allocates; every loop has a length that the model fixes, and indices run up to lengths of the arrays that they index.
#![allow(
    clippy::needless_range_loop,
    reason = "an index of rows or columns reads as in the mathematics, and is below the array's length"
)]

use super::{Phasor, Real, RunWorkspace};

/// Steps of the maximum-likelihood iteration for the variances of the noise.
const NOISE_STEPS: usize = 30;
/// A column is shown where it is so many times as large as what noise makes of it.
const LEAST_VISIBLE: f64 = 4.0;
/// A force is known to this share of the largest one of its row at best: an equation that no sensor disturbs, such as the mean of a row
/// without a stiffness, would otherwise count for more than harmonics that were left out.
const LEAST_FORCE: f64 = 1e-7;
/// Roundings of its largest line that every line of a coordinate may have gathered.
const ROUNDINGS: f64 = 16.0;
/// What the forces of all rows must add to the logarithm of the likelihood, for each row: twice it exceeds 4 by chance once in 40 times.
const LEAST_GAIN: f64 = 2.0;
/// Harmonics of a derivative below this share of its largest one do not mix lines of noise.
const LEAST_MIXING: f64 = 1e-3;

impl<
    T: Real,
    const Q: usize,
    const R: usize,
    const P: usize,
    const S: usize,
    const L: usize,
    const E: usize,
    const K: usize,
> RunWorkspace<T, Q, R, P, S, L, E, K>
{
    /// Harmonics of the derivatives that mix the lines of noise: those that are a part of the largest one of their entry.
    pub(super) fn find_reach(&mut self) {
        let least = T::from_f64(LEAST_MIXING * LEAST_MIXING);
        self.reach = 0;
        for lines in self.gains.iter().flatten() {
            let peak = lines.iter().fold(T::ZERO, |peak, line| peak.max(line.square()));
            for (m, line) in lines.iter().enumerate().skip(1) {
                if line.square() > least * peak {
                    self.reach = self.reach.max(m);
                }
            }
        }
    }

    /// What a line of a coordinate, `line - 2 shift`, makes of a line of a row through one harmonic of the row's derivatives.
    pub(super) fn through(
        &self,
        slots: &[(usize, u32); S],
        row: usize,
        coordinate: usize,
        line: i32,
        shift: i32,
        w: T,
    ) -> Phasor<T> {
        let source = T::from_f64(f64::from(line - 2 * shift) / 2.0) * w;
        let mut sum = Phasor::ZERO;
        for (lines, &(of, order)) in self.gains[row].iter().zip(slots) {
            if of != coordinate {
                continue;
            }
            let harmonic = lines.get(shift.unsigned_abs() as usize).copied().unwrap_or(Phasor::ZERO);
            let gain = if shift < 0 { harmonic.conj() } else { harmonic };
            sum += gain * Phasor::derivative(source, order);
        }
        sum
    }

    /// Variances of the sensors and of a force on every row, from the lines halfway between the harmonics: the maximum of their likelihood,
    /// by steps that never make a variance negative.
    pub(super) fn find_noise(&mut self, slots: &[(usize, u32); S], w: T) {
        let reach = self.reach as i32;
        let mut left = [[T::ZERO; L]; R];
        for line in 0..L {
            for row in 0..R {
                let mut residual = self.drive[row][line];
                for coordinate in 0..Q {
                    let mut felt = T::ZERO;
                    for shift in -reach..=reach {
                        let through = self.through(slots, row, coordinate, line as i32, shift, w);
                        felt += through.square();
                        let source = line as i32 - 2 * shift;
                        let measured = self.motion[coordinate].get(source.unsigned_abs() as usize).copied();
                        let measured = measured.unwrap_or(Phasor::ZERO);
                        residual -= through * if source < 0 { measured.conj() } else { measured };
                    }
                    self.felt[row][line][coordinate] = felt;
                }
                left[row][line] = residual.square();
            }
        }
        let rounding = self.begin_noise(&left);
        let begin = (self.sensors, self.forces);
        self.forces = rounding;
        let alone = self.fit_noise(&left, false);
        let of_sensors = (self.sensors, self.forces);
        (self.sensors, self.forces) = begin;
        let both = self.fit_noise(&left, true);
        self.disturbed = both - alone > T::from_f64(LEAST_GAIN * R as f64);
        if self.disturbed {
            return;
        }
        (self.sensors, self.forces) = of_sensors;
    }

    /// Takes the variances of the sensors, and of the forces too or as they are, to those of largest likelihood; gives its logarithm.
    fn fit_noise(&mut self, left: &[[T; L]; R], with_forces: bool) -> T {
        for _ in 0..NOISE_STEPS {
            self.improve_noise(left, with_forces);
        }
        let mut sum = T::ZERO;
        for row in 0..R {
            for line in (1..L).step_by(2) {
                let variance = self.variance(row, line);
                if variance > T::ZERO && variance.is_finite() {
                    sum -= left[row][line] / variance + variance.ln();
                }
            }
        }
        sum
    }

    /// Variances to begin with: what is left of every row by its force, and by every sensor as much as the rows allow it. Gives those that
    /// rounding has by itself.
    fn begin_noise(&mut self, left: &[[T; L]; R]) -> [T; R] {
        let mut roundings = [T::ZERO; R];
        self.sensors = [T::ZERO; Q];
        let count = T::from_f64(L as f64 / 2.0);
        for row in 0..R {
            let halfway = || (1..L).step_by(2);
            let sum = halfway().fold(T::ZERO, |sum, line| sum + left[row][line]);
            let peak = self.drive[row].iter().chain(&self.known[row]).fold(T::ZERO, |peak, z| peak.max(z.square()));
            let least = T::EPSILON.max(T::from_f64(LEAST_FORCE));
            let rounding = least * least * peak;
            roundings[row] = rounding;
            self.forces[row] = (sum / count).max(rounding);
            for coordinate in 0..Q {
                let felt = halfway().fold(T::ZERO, |sum, line| sum + self.felt[row][line][coordinate]);
                if felt > T::ZERO {
                    let level = sum / felt;
                    self.sensors[coordinate] = self.sensors[coordinate].max(level);
                }
            }
        }
        roundings
    }

    /// One step towards the variances of largest likelihood.
    fn improve_noise(&mut self, left: &[[T; L]; R], with_forces: bool) {
        let (mut sensors, mut forces) = ([[T::ZERO; 2]; Q], [[T::ZERO; 2]; R]);
        for row in 0..R {
            for line in (1..L).step_by(2) {
                let variance = self.variance(row, line);
                if !variance.is_finite() || variance <= T::ZERO {
                    continue;
                }
                let (given, expected) = (left[row][line] / variance / variance, T::ONE / variance);
                for (sums, felt) in sensors.iter_mut().zip(self.felt[row][line]) {
                    sums[0] += felt * given;
                    sums[1] += felt * expected;
                }
                forces[row][0] += given;
                forces[row][1] += expected;
            }
        }
        let rows = if with_forces { R } else { 0 };
        let own = self.sensors.iter_mut().zip(sensors).chain(self.forces.iter_mut().zip(forces).take(rows));
        for (variance, [given, expected]) in own {
            if expected > T::ZERO {
                *variance *= (given / expected).sqrt();
            }
        }
    }

    /// Variance of a line of a row.
    pub(super) fn variance(&self, row: usize, line: usize) -> T {
        let felt = self.felt[row][line].iter().zip(&self.sensors);
        felt.fold(self.forces[row], |sum, (felt, sensor)| sum + *felt * *sensor)
    }

    /// Says which columns of the regressor stand out of what noise, or rounding, makes of them at any harmonic of any row. A column of noise
    /// alone shows nothing of its parameter, and would say so with a number.
    pub(super) fn find_shown(&mut self, slots: &[(usize, u32); S], w: T) {
        let least = T::from_f64(LEAST_VISIBLE * LEAST_VISIBLE);
        let mut noise = self.sensors;
        for (noise, lines) in noise.iter_mut().zip(&self.motion) {
            let peak = lines.iter().fold(T::ZERO, |peak, line| peak.max(line.square()));
            *noise = noise.max(peak * T::from_f64(ROUNDINGS * ROUNDINGS) * T::EPSILON * T::EPSILON);
        }
        for column in 0..P {
            let stands = |row: usize, harmonic: usize| {
                let mut variance = T::ZERO;
                for (slope, &(coordinate, order)) in self.slopes[row][column].iter().zip(slots) {
                    let felt = Phasor::derivative(w * T::from_f64(harmonic as f64), order).square();
                    variance += *slope * felt * noise[coordinate];
                }
                self.regressor[row][column][2 * harmonic].square() > least * variance
            };
            self.shown[column] = (0..R).any(|row| (0..L / 2).any(|harmonic| stands(row, harmonic)));
        }
    }
}
