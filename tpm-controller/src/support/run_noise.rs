//! The noise of one run, read halfway between the harmonics, and what it makes of the rows at the harmonics.
//!
//! Halfway between the harmonics the rows hold without the periodic motion, so that `B u - J q` there is noise alone. The variances of
//! white noise in every sensor and of a white force on every row are those of largest likelihood; the rows' derivatives J along the motion,
//! which mix the lines, say what they make of every row at every harmonic. The force is there only where it explains more than chance does:
//! from a few lines its variance would otherwise take a share of the sensors', and the small harmonics would count less than they show.
//!
//! Invariants: nothing allocates; every loop has a length that the model fixes, and indices run up to lengths of the arrays that they index.

use super::{Phasor, Real, RunModel, RunWorkspace};

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

impl<
    T: Real,
    const U: usize,
    const Q: usize,
    const R: usize,
    const P: usize,
    const S: usize,
    const L: usize,
    const E: usize,
    const K: usize,
> RunWorkspace<T, U, Q, R, P, S, L, E, K>
{
    /// What a line of a coordinate, `line - 2 shift`, makes of a line of a row through one harmonic of the row's derivatives.
    pub(super) fn through<M: RunModel<T, U, R, P, S>>(
        &self,
        model: &M,
        row: usize,
        coordinate: usize,
        line: i32,
        shift: i32,
    ) -> Phasor<T> {
        let _ = model;
        let (half_lines, distance) = (line - 2 * shift, shift.unsigned_abs());
        let source = T::from_f64(half_lines as f64) / T::from_f64(2.0) * self.w;
        let harmonic = distance as usize;
        let mut sum = Phasor::zero();
        if harmonic >= L {
            return sum;
        }
        for entry in 0..S {
            if M::COORDINATES[entry] == coordinate {
                let gain = self.gains[row][entry][harmonic];
                let turned = if shift < 0 { gain.conj() } else { gain };
                sum += turned * Phasor::derivative(source, M::ORDERS[entry]);
            }
        }
        sum
    }

    /// Variances of the sensors and of a force on every row, from the lines halfway between the harmonics: the maximum of their likelihood,
    /// by steps that never make a variance negative. A force is there only where it explains more than chance does.
    pub(super) fn find_noise<M: RunModel<T, U, R, P, S>>(&mut self, model: &M) {
        for line in 0..L {
            for row in 0..R {
                let mut residual = self.drive[row][line];
                for coordinate in 0..Q {
                    let mut felt = T::ZERO;
                    for shift in -self.reach..=self.reach {
                        let through = self.through(model, row, coordinate, line as i32, shift);
                        felt += through.square();
                        let source = line as i32 - 2 * shift;
                        let distance = source.unsigned_abs();
                        let place = distance as usize;
                        if place < L {
                            let measured = self.motion[coordinate][place];
                            residual -= through * if source < 0 { measured.conj() } else { measured };
                        }
                    }
                    self.felt[row][line][coordinate] = felt;
                }
                self.left[row][line] = residual.square();
            }
        }
        let mut roundings = [T::ZERO; R];
        self.begin_noise(&mut roundings);
        let begin_sensors = self.sensors;
        let begin_forces = self.forces;
        self.forces = roundings;
        let alone = self.fit_noise(false);
        let alone_sensors = self.sensors;
        self.sensors = begin_sensors;
        self.forces = begin_forces;
        let both = self.fit_noise(true);
        self.disturbed = both - alone > T::from_f64(LEAST_GAIN) * T::from_f64(R as f64);
        if !self.disturbed {
            self.sensors = alone_sensors;
            self.forces = roundings;
        }
    }

    /// Takes the variances of the sensors, and of the forces too or as they are, to those of largest likelihood; gives its logarithm.
    fn fit_noise(&mut self, with_forces: bool) -> T {
        for _ in 0..NOISE_STEPS {
            self.improve_noise(with_forces);
        }
        let mut sum = T::ZERO;
        for row in 0..R {
            for line in (1..L).step_by(2) {
                let variance = self.variance(row, line);
                if variance > T::ZERO && variance.is_finite() {
                    sum -= self.left[row][line] / variance + variance.ln();
                }
            }
        }
        sum
    }

    /// Variances to begin with: what is left of every row by its force, and by every sensor as much as the rows allow it. Gives those that
    /// rounding has by itself.
    fn begin_noise(&mut self, roundings: &mut [T; R]) {
        self.sensors = [T::ZERO; Q];
        for row in 0..R {
            let mut sum = T::ZERO;
            for line in (1..L).step_by(2) {
                sum += self.left[row][line];
            }
            let mut peak = T::ZERO;
            for line in 0..L {
                peak = peak.max(self.drive[row][line].square()).max(self.known[row][line].square());
            }
            let least = T::EPSILON.max(T::from_f64(LEAST_FORCE));
            roundings[row] = least * least * peak;
            self.forces[row] = (sum / (T::from_f64(L as f64) / T::from_f64(2.0))).max(roundings[row]);
            for coordinate in 0..Q {
                let mut felt = T::ZERO;
                for line in (1..L).step_by(2) {
                    felt += self.felt[row][line][coordinate];
                }
                if felt > T::ZERO {
                    self.sensors[coordinate] = self.sensors[coordinate].max(sum / felt);
                }
            }
        }
    }

    /// One step towards the variances of largest likelihood.
    fn improve_noise(&mut self, with_forces: bool) {
        let mut sensors = [[T::ZERO; 2]; Q];
        let mut forces = [[T::ZERO; 2]; R];
        for row in 0..R {
            for line in (1..L).step_by(2) {
                let variance = self.variance(row, line);
                if !variance.is_finite() || variance <= T::ZERO {
                    continue;
                }
                let given = self.left[row][line] / variance / variance;
                let expected = T::ONE / variance;
                for coordinate in 0..Q {
                    sensors[coordinate][0] += self.felt[row][line][coordinate] * given;
                    sensors[coordinate][1] += self.felt[row][line][coordinate] * expected;
                }
                forces[row][0] += given;
                forces[row][1] += expected;
            }
        }
        for coordinate in 0..Q {
            if sensors[coordinate][1] > T::ZERO {
                self.sensors[coordinate] *= (sensors[coordinate][0] / sensors[coordinate][1]).sqrt();
            }
        }
        for row in 0..R {
            if with_forces && forces[row][1] > T::ZERO {
                self.forces[row] *= (forces[row][0] / forces[row][1]).sqrt();
            }
        }
    }

    /// Variance of a line of a row.
    pub(super) fn variance(&self, row: usize, line: usize) -> T {
        let mut sum = self.forces[row];
        for coordinate in 0..Q {
            sum += self.felt[row][line][coordinate] * self.sensors[coordinate];
        }
        sum
    }

    /// Says which columns of the regressor stand out of what noise, or rounding, makes of them at any harmonic of any row. A column of noise
    /// alone shows nothing of its parameter, and would say so with a number.
    pub(super) fn find_shown<M: RunModel<T, U, R, P, S>>(&mut self, model: &M) {
        let _ = model;
        let mut noise = self.sensors;
        for coordinate in 0..Q {
            let mut peak = T::ZERO;
            for line in 0..L {
                peak = peak.max(self.motion[coordinate][line].square());
            }
            let rounding = T::from_f64(ROUNDINGS) * T::EPSILON;
            noise[coordinate] = noise[coordinate].max(peak * rounding * rounding);
        }
        for column in 0..P {
            self.stands[column] = false;
            for row in 0..R {
                for harmonic in 0..L / 2 {
                    let mut variance = T::ZERO;
                    for entry in 0..S {
                        let derivative = Phasor::derivative(self.w * T::from_f64(harmonic as f64), M::ORDERS[entry]);
                        let felt = derivative.square() * noise[M::COORDINATES[entry]];
                        variance += self.slopes[row][column][entry] * felt;
                    }
                    let size = self.regressor[row][column][2 * harmonic].square();
                    if size > T::from_f64(LEAST_VISIBLE * LEAST_VISIBLE) * variance {
                        self.stands[column] = true;
                    }
                }
            }
        }
    }
}
