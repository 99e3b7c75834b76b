//! The equations of a run at all harmonics, made independent of each other.
//!
//! A row at harmonic k has noise of many lines, since derivatives that vary along the motion mix them, and rows and harmonics have it in
//! common: `e_k = sum_l G_(k-l) n_l`. Where the noise of a large harmonic reaches a small one, which shows a parameter, all of it may be
//! taken off again by what the large one has; weighed each by itself, equations would show a few times less. So the real and imaginary parts
//! of all visible equations are divided by the Cholesky factor of the covariance that they have together.
//!
//! Invariants: nothing allocates; every loop has a length that the model fixes, and indices run up to lengths of the arrays that they index.
#![allow(
    clippy::needless_range_loop,
    reason = "an index of rows or columns reads as in the mathematics, and is below the array's length"
)]

use super::{Phasor, Real, RunFault, RunWorkspace, SquareRoot};

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
    const Q: usize,
    const R: usize,
    const P: usize,
    const S: usize,
    const L: usize,
    const E: usize,
    const K: usize,
> RunWorkspace<T, Q, R, P, S, L, E, K>
{
    /// The equations of the visible harmonics for the step from these parameters, independent and of variance one; `weighed` by the noise,
    /// otherwise rows by the size of their forces.
    ///
    /// # Errors
    /// [`RunFault::Equations`] when a number is not finite.
    pub(super) fn equations(
        &mut self,
        slots: &[(usize, u32); S],
        theta: &[T; P],
        w: T,
        (weighed, means): (bool, RunMeans),
    ) -> Result<SquareRoot<T, P>, RunFault> {
        self.collect(theta, weighed, means);
        self.noise = [T::ZERO; K];
        for index in 0..self.count {
            let [harmonic, row, _] = self.places[index].map(usize::from);
            let force = if weighed { self.forces[row] } else { self.size(row) };
            // A phasor's real and imaginary part have half of its variance each, a mean a quarter of that of the other phasors.
            let share = if harmonic > 0 { 0.5 } else { 0.25 };
            let doubt = if harmonic > 0 { T::ZERO } else { self.doubt * self.shifted[row] };
            self.noise[at(index, index)] = force * T::from_f64(share) + doubt * doubt;
        }
        if weighed {
            for line in 0..L / 2 + self.reach {
                for coordinate in 0..Q {
                    self.add_noise(slots, coordinate, line, w);
                }
            }
        }
        let mut factor = SquareRoot::default();
        for index in 0..self.count {
            self.whiten(index)?;
            factor.push(self.rows[index], self.right[index]).map_err(|_| RunFault::Equations)?;
        }
        Ok(factor)
    }

    /// Harmonic, row and part of all equations that count, and their coefficients.
    fn collect(&mut self, theta: &[T; P], weighed: bool, means: RunMeans) {
        self.count = 0;
        for harmonic in usize::from(means == RunMeans::None)..L / 2 {
            if weighed && !self.is_visible(theta, harmonic) {
                continue;
            }
            for row in 0..R {
                if harmonic == 0 && means == RunMeans::OfTerms && !self.has_mean(row, theta) {
                    continue;
                }
                let right = self.rest[row][2 * harmonic];
                for part in 0..if harmonic > 0 { 2 } else { 1 } {
                    let of = |z: Phasor<T>| if part == 0 { z.re } else { z.im };
                    let index = self.count;
                    if index >= E {
                        return;
                    }
                    // Harmonics, rows and parts are few.
                    self.places[index] = [harmonic as u16, row as u16, part];
                    for column in 0..P {
                        let shift = if harmonic > 0 { T::ZERO } else { self.shift[row][column] };
                        let entry = of(self.regressor[row][column][2 * harmonic]) + shift;
                        self.rows[index][column] = if self.shown[column] { entry } else { T::ZERO };
                    }
                    self.right[index] = of(right) - if harmonic > 0 { T::ZERO } else { self.shifted[row] };
                    self.count += 1;
                }
            }
        }
    }

    /// Adds the covariance that the noise of a coordinate at one harmonic, below or beyond those that are used, gives all equations.
    fn add_noise(&mut self, slots: &[(usize, u32); S], coordinate: usize, line: usize, w: T) {
        // What the real and the imaginary part of the noise are multiplied by in every equation; the mean has a real part alone.
        let mut by = [[T::ZERO; 2]; E];
        for index in 0..self.count {
            let [harmonic, row, part] = self.places[index].map(usize::from);
            let mut of = |shift: i32, sign: T| {
                if shift.unsigned_abs() as usize > self.reach {
                    return;
                }
                let through = self.through(slots, row, coordinate, 2 * harmonic as i32, shift, w);
                let parts = if part == 0 { [through.re, -through.im] } else { [through.im, through.re] };
                by[index][0] += parts[0];
                by[index][1] += parts[1] * sign;
            };
            of(harmonic as i32 - line as i32, T::ONE);
            if line > 0 {
                of(harmonic as i32 + line as i32, -T::ONE);
            } else {
                by[index][1] = T::ZERO;
            }
            if harmonic == 0 {
                by[index] = by[index].map(|value| value / T::from_f64(2.0));
            }
        }
        let half = self.sensors[coordinate] / T::from_f64(2.0);
        let variance = if line > 0 { half } else { half + half };
        for index in 0..self.count {
            for part in 0..2 {
                let own = by[index][part] * variance;
                if own.abs() > T::ZERO {
                    for other in 0..=index {
                        self.noise[at(index, other)] += own * by[other][part];
                    }
                }
            }
        }
    }

    /// The next row of the Cholesky factor in the place of the covariance, and the equation divided by it.
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
            let above = self.right[before];
            self.right[index] -= share * above;
        }
        // Equations that have all their noise in common still differ by rounding.
        pivot = pivot.max(whole * T::from_f64(ROUNDINGS) * T::EPSILON);
        if !(pivot > T::ZERO && pivot.is_finite()) {
            return Err(RunFault::Equations);
        }
        let length = pivot.sqrt();
        self.noise[at(index, index)] = length;
        self.rows[index].iter_mut().for_each(|entry| *entry /= length);
        self.right[index] /= length;
        Ok(())
    }

    /// Whether a force on any row stands out of the noise: the applied one, or a term at these parameters.
    fn is_visible(&self, theta: &[T; P], harmonic: usize) -> bool {
        let least = T::from_f64(LEAST_VISIBLE * LEAST_VISIBLE);
        (0..R).any(|row| {
            let terms = self.regressor[row].iter().zip(theta).map(|(lines, theta)| lines[2 * harmonic].times(*theta));
            let forces = terms.chain([self.drive[row][2 * harmonic], self.known[row][2 * harmonic]]);
            let largest = forces.fold(T::ZERO, |largest, force| largest.max(force.square()));
            largest > least * self.variance(row, 2 * harmonic)
        })
    }

    /// The square of the force on a row: of the applied one, or, where nothing is applied, of its terms by parameters of one.
    fn size(&self, row: usize) -> T {
        let power = |lines: &[Phasor<T>; L]| lines.iter().step_by(2).fold(T::ZERO, |sum, line| sum + line.square());
        let applied = power(&self.drive[row]);
        if applied > T::ZERO {
            return applied;
        }
        let terms = self.regressor[row].iter().fold(power(&self.known[row]), |sum, lines| sum + power(lines));
        if terms > T::ZERO { terms } else { T::ONE }
    }
}

/// The place of an entry of a triangle.
fn at(row: usize, column: usize) -> usize {
    row * (row + 1) / 2 + column
}
