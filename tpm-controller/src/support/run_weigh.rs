//! The equations of a run at all harmonics, made independent of each other.
//!
//! A row at harmonic k has noise of many lines, since derivatives that vary along the motion mix them, and rows and harmonics have it in
//! common: `e_k = sum_l G_(k-l) n_l`. Where the noise of a large harmonic reaches a small one, which shows a parameter, all of it may be
//! taken off again by what the large one has; weighed each by itself, equations would show a few times less. So the real and imaginary parts
//! of all visible equations are divided by the Cholesky factor of the covariance that they have together.
//!
//! Invariants: nothing allocates; every loop has a length that the model fixes, and indices run up to lengths of the arrays that they index.

use super::{Phasor, Real, RunFault, RunModel, RunWorkspace};

/// A harmonic is used where a force on a row is so many times as large as the noise of the row.
const LEAST_VISIBLE: f64 = 4.0;
/// Roundings of its variance that are left of an equation at least, whose noise others have.
const ROUNDINGS: f64 = 256.0;

/// Which means are among the equations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunMeans {
    /// None of them.
    None,
    /// Those of rows of which a term has a mean.
    OfTerms,
    /// All of them.
    All,
}

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
    /// The equations of the visible harmonics for the step from the present parameters, independent and of variance one; `weighed` by the
    /// noise, otherwise rows by the size of their forces.
    ///
    /// # Errors
    /// [`RunFault::Equations`] when a number is not finite.
    pub(super) fn equations<M: RunModel<T, U, R, P, S>>(
        &mut self,
        model: &M,
        weighed: bool,
        means: RunMeans,
    ) -> Result<(), RunFault> {
        self.collect(weighed, means);
        self.noise = [T::ZERO; K];
        for index in 0..self.count {
            let row = self.places[index][1] as usize;
            let is_mean = self.places[index][0] == 0;
            let force = if weighed { self.forces[row] } else { self.size(row) };
            // A phasor's real and imaginary part have half of its variance each, a mean a quarter of that of the other phasors.
            let share = if is_mean { T::from_f64(0.25) } else { T::from_f64(0.5) };
            let doubt = if is_mean { self.doubt * self.shifted[row] } else { T::ZERO };
            self.noise[at(index, index)] = force * share + doubt * doubt;
        }
        if weighed {
            for line in 0..L as i32 / 2 + self.reach {
                for coordinate in 0..Q {
                    self.add_noise(model, coordinate, line);
                }
            }
        }
        self.factor.clear();
        for index in 0..self.count {
            self.whiten(index)?;
            let mut row = self.rows[index];
            if !self.factor.take(&mut row, self.right[index]) {
                return Err(RunFault::Equations);
            }
        }
        Ok(())
    }

    /// Harmonic, row and part of all equations that count, and their coefficients.
    fn collect(&mut self, weighed: bool, means: RunMeans) {
        self.count = 0;
        for harmonic in 0..L / 2 {
            if (harmonic == 0 && means == RunMeans::None) || (weighed && !self.is_visible(harmonic)) {
                continue;
            }
            for row in 0..R {
                if harmonic == 0 && means == RunMeans::OfTerms && !self.has_mean(row) {
                    continue;
                }
                for part in 0..if harmonic > 0 { 2 } else { 1 } {
                    let index = self.count;
                    if index >= E {
                        return;
                    }
                    // Harmonics, rows and parts are few.
                    self.places[index][0] = harmonic as u16;
                    self.places[index][1] = row as u16;
                    self.places[index][2] = part as u16;
                    for column in 0..P {
                        let entry = self.regressor[row][column][2 * harmonic];
                        let shift = if harmonic == 0 { self.shift[row][column] } else { T::ZERO };
                        let own = if part == 0 { entry.re + shift } else { entry.im };
                        self.rows[index][column] = if self.stands[column] { own } else { T::ZERO };
                    }
                    let right = self.rest[row][2 * harmonic];
                    let taken = if harmonic == 0 { self.shifted[row] } else { T::ZERO };
                    self.right[index] = if part == 0 { right.re - taken } else { right.im };
                    self.count += 1;
                }
            }
        }
    }

    /// Adds what the noise of a coordinate that reaches an equation by a shift is multiplied by there.
    fn add_shift<M: RunModel<T, U, R, P, S>>(
        &mut self,
        model: &M,
        index: usize,
        coordinate: usize,
        shift: i32,
        sign: T,
    ) {
        if shift.abs() > self.reach {
            return;
        }
        let row = self.places[index][1] as usize;
        let line = 2 * self.places[index][0] as i32;
        let through = self.through(model, row, coordinate, line, shift);
        if self.places[index][2] == 0 {
            self.by[index][0] += through.re;
            self.by[index][1] -= through.im * sign;
        } else {
            self.by[index][0] += through.im;
            self.by[index][1] += through.re * sign;
        }
    }

    /// Adds the covariance that the noise of a coordinate at one harmonic, below or beyond those that are used, gives all equations. The
    /// mean has a real part alone.
    fn add_noise<M: RunModel<T, U, R, P, S>>(&mut self, model: &M, coordinate: usize, line: i32) {
        for index in 0..self.count {
            let harmonic = self.places[index][0] as i32;
            self.by[index][0] = T::ZERO;
            self.by[index][1] = T::ZERO;
            self.add_shift(model, index, coordinate, harmonic - line, T::ONE);
            if line > 0 {
                self.add_shift(model, index, coordinate, harmonic + line, -T::ONE);
            } else {
                self.by[index][1] = T::ZERO;
            }
            if harmonic == 0 {
                self.by[index][0] /= T::from_f64(2.0);
                self.by[index][1] /= T::from_f64(2.0);
            }
        }
        let half = self.sensors[coordinate] / T::from_f64(2.0);
        let variance = if line > 0 { half } else { half + half };
        for index in 0..self.count {
            for part in 0..2 {
                let own = self.by[index][part] * variance;
                if own.abs() > T::ZERO {
                    for other in 0..=index {
                        self.noise[at(index, other)] += own * self.by[other][part];
                    }
                }
            }
        }
    }

    /// The next row of the Cholesky factor in the place of the covariance, and the equation divided by it. Equations that have all their
    /// noise in common still differ by rounding.
    fn whiten(&mut self, index: usize) -> Result<(), RunFault> {
        let whole = self.noise[at(index, index)];
        let mut pivot = whole;
        for before in 0..index {
            let mut share = self.noise[at(index, before)];
            for other in 0..before {
                share -= self.noise[at(index, other)] * self.noise[at(before, other)];
            }
            share /= self.noise[at(before, before)];
            self.noise[at(index, before)] = share;
            pivot -= share * share;
            for column in 0..P {
                let above = self.rows[before][column];
                self.rows[index][column] -= share * above;
            }
            let above_right = self.right[before];
            self.right[index] -= share * above_right;
        }
        pivot = pivot.max(whole * T::from_f64(ROUNDINGS) * T::EPSILON);
        if pivot <= T::ZERO || !pivot.is_finite() {
            return Err(RunFault::Equations);
        }
        let length = pivot.sqrt();
        self.noise[at(index, index)] = length;
        for column in 0..P {
            self.rows[index][column] /= length;
        }
        self.right[index] /= length;
        Ok(())
    }

    /// Whether a force on any row stands out of the noise: the applied one, or a term at the present parameters.
    fn is_visible(&self, harmonic: usize) -> bool {
        let line = 2 * harmonic;
        for row in 0..R {
            let mut largest = self.drive[row][line].square().max(self.known[row][line].square());
            for column in 0..P {
                largest = largest.max(self.regressor[row][column][line].times(self.theta[column]).square());
            }
            if largest > T::from_f64(LEAST_VISIBLE * LEAST_VISIBLE) * self.variance(row, line) {
                return true;
            }
        }
        false
    }

    /// The square of the force on a row: of the applied one, or, where nothing is applied, of its terms by parameters of one.
    fn size(&self, row: usize) -> T {
        let applied = power(&self.drive[row]);
        if applied > T::ZERO {
            return applied;
        }
        let mut terms = power(&self.known[row]);
        for column in 0..P {
            terms += power(&self.regressor[row][column]);
        }
        if terms > T::ZERO { terms } else { T::ONE }
    }
}

/// The sum of the squares of a signal's harmonics.
fn power<T: Real, const L: usize>(lines: &[Phasor<T>; L]) -> T {
    let mut sum = T::ZERO;
    for line in (0..L).step_by(2) {
        sum += lines[line].square();
    }
    sum
}

/// The place of an entry of a triangle.
fn at(row: usize, column: usize) -> usize {
    row * (row + 1) / 2 + column
}
