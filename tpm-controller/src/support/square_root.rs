//! Least squares sample by sample: what any number of rows say about the unknowns, as a triangular factor of fixed size.
//!
//! Every row is rotated into the factor R of A = Q R (Givens), so that no square of the matrix is ever formed and single precision
//! keeps its digits. Rotations round every column by itself; columns are scaled to unit length when the solution is asked for.
//!
//! Invariants: nothing allocates, and indices are below the lengths of the arrays that they index, so that no input can make it panic. Where
//! an index or the end of a loop is itself a value in memory, `min` bounds it by the size although it never is above, so that a compiler sees
//! that no path to a panic remains. All but what Rust alone is given is of the subset that is printed as C too.

use super::Real;
use core::fmt;

/// The smallest share of a column that no other columns explain and that counts: columns that are equal by the laws of a machine differ by
/// the rounding of their own evaluation, which no number of rows tells.
const LEAST_SHARE: f64 = 1e-8;

/// A row is left out where it leaves so many deviations of what is left of those before it: no error of a sensor that works does, and one
/// such row among thousands would decide about the unknowns.
const GATE: f64 = 50.0;

/// One of so many rows is left out at most.
const RARE: f64 = 100.0;

/// Why the equations of a sample are left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleFault {
    /// A number is infinite or not a number, or a deviation is zero.
    NotFinite,
    /// An equation leaves 50 times what those before it leave on the average.
    StandsOut,
}

impl fmt::Display for SampleFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotFinite => "the sample holds a number that is not finite",
            Self::StandsOut => "the sample stands out of those before it; check sensors and inputs",
        })
    }
}

impl core::error::Error for SampleFault {}

/// The triangular factor of all equations so far, each divided by the deviation of its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SquareRoot<T, const C: usize> {
    /// The triangular factor of A; zeros below its diagonal.
    pub(super) factor: [[T; C]; C],
    /// Q^T b, as far as A reaches.
    pub(super) right: [T; C],
    /// Euclidean length of what A does not reach.
    pub(super) residual: T,
    /// The number of rows; past ones count less after a fading.
    pub(super) rows: T,
    /// The number of rows that were left out since they stand out, which fades as rows do.
    left_out: T,
}

impl<T: Real, const C: usize> Default for SquareRoot<T, C> {
    fn default() -> Self {
        let zero = T::ZERO;
        Self { factor: [[zero; C]; C], right: [zero; C], residual: zero, rows: zero, left_out: zero }
    }
}

impl<T: Real, const C: usize> SquareRoot<T, C> {
    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.factor = [[T::ZERO; C]; C];
        self.right = [T::ZERO; C];
        self.residual = T::ZERO;
        self.rows = T::ZERO;
        self.left_out = T::ZERO;
    }

    /// Whether a row stands out of what all rows before it leave: by more deviations than errors have, and not by rounding. The row is
    /// destroyed; it has finite numbers only.
    pub fn stands_out(&self, row: &mut [T; C], right: T) -> bool {
        let mut rest = right;
        for k in 0..C {
            if row[k].abs() > T::ZERO {
                let length = hypotenuse(self.factor[k][k], row[k]);
                let cosine = self.factor[k][k] / length;
                let sine = row[k] / length;
                for j in k..C {
                    row[j] = cosine * row[j] - sine * self.factor[k][j];
                }
                rest = cosine * rest - sine * self.right[k];
            }
        }
        let freedom = self.rows - T::from_f64(C as f64);
        if freedom <= T::ZERO {
            return false;
        }
        let deviation = self.residual / freedom.sqrt();
        rest.abs() > T::from_f64(GATE) * deviation + T::EPSILON.sqrt() * right.abs()
    }

    /// Whether one more row may be left out: at most one of so many, so that a machine that has changed is followed.
    pub fn leaves_out(&mut self) -> bool {
        let share = (self.left_out + T::ONE) * T::from_f64(RARE);
        let rare = share <= self.rows;
        if rare {
            self.left_out += T::ONE;
        }
        rare
    }

    /// Takes in a row of A with its entry of b, both divided by the deviation of the row's error.
    ///
    /// # Errors
    /// [`SampleFault::NotFinite`] when a number of the row is not; the row is left out then.
    pub fn push(&mut self, mut row: [T; C], right: T) -> Result<(), SampleFault> {
        if self.take(&mut row, right) { Ok(()) } else { Err(SampleFault::NotFinite) }
    }

    /// Takes in a row with its right-hand side, and destroys it. Says whether all numbers are finite; the row is left out otherwise.
    pub fn take(&mut self, row: &mut [T; C], right: T) -> bool {
        if !right.is_finite() {
            return false;
        }
        for j in 0..C {
            if !row[j].is_finite() {
                return false;
            }
        }
        let mut rest = right;
        for k in 0..C {
            if row[k].abs() <= T::ZERO {
                continue;
            }
            let length = hypotenuse(self.factor[k][k], row[k]);
            let cosine = self.factor[k][k] / length;
            let sine = row[k] / length;
            for j in k..C {
                let turned = cosine * self.factor[k][j] + sine * row[j];
                row[j] = cosine * row[j] - sine * self.factor[k][j];
                self.factor[k][j] = turned;
            }
            let turned_right = cosine * self.right[k] + sine * rest;
            rest = cosine * rest - sine * self.right[k];
            self.right[k] = turned_right;
        }
        self.residual = hypotenuse(self.residual, rest);
        self.rows += T::ONE;
        true
    }

    /// Lets all rows so far count `share` times, from 0 to 1.
    pub fn fade(&mut self, share: T) {
        let root = share.sqrt();
        for k in 0..C {
            for j in k..C {
                self.factor[k][j] *= root;
            }
            self.right[k] *= root;
        }
        self.residual *= root;
        self.rows *= share;
        self.left_out *= share;
    }

    /// Takes in all rows of another factor.
    pub fn pool(&mut self, other: &Self) {
        let rows = self.rows + other.rows;
        for k in 0..C {
            let mut row = other.factor[k];
            // A factor has finite entries only.
            let _ = self.take(&mut row, other.right[k]);
        }
        self.residual = hypotenuse(self.residual, other.residual);
        self.rows = rows;
    }

    /// Makes the equations those of the unknowns less `by`.
    pub fn move_by(&mut self, by: &[T; C]) {
        for k in 0..C {
            for j in 0..C {
                self.right[k] -= self.factor[k][j] * by[j];
            }
        }
    }

    /// The number of rows so far; past ones count less after a fading.
    #[must_use]
    pub fn rows(&self) -> T {
        self.rows
    }

    /// Euclidean length of what no x explains.
    #[must_use]
    pub fn residual(&self) -> T {
        self.residual
    }

    /// What the rows say about x: modified Gram-Schmidt with column pivoting on the factor, its columns scaled to unit length.
    ///
    /// A direction counts as not shown when what is left of its column is within the rounding errors of all rows, which add up like a
    /// random walk, or below 1e-8.
    pub fn solve(&self, found: &mut Solution<T, C>) {
        let rounding = T::EPSILON * T::from_f64(4.0) * (T::from_f64(C as f64) + self.rows.sqrt());
        let tiny = rounding.max(T::from_f64(LEAST_SHARE));
        found.scale(self);
        found.eliminate(tiny);
        found.residual = hypotenuse(self.residual, length(&found.right));
        found.judge(tiny.sqrt());
        found.invert();
        for k in 0..C {
            found.steps[k] = T::ZERO;
            found.values[k] = T::ZERO;
            found.column[k] = if k < found.rank { found.projected[k] } else { T::ZERO };
        }
        found.substitute();
        for k in 0..found.rank.min(C) {
            let place = found.order[k].min(C - 1);
            found.steps[place] = found.column[k];
            found.values[place] = found.column[k] / found.scales[place];
        }
        found.spread();
    }

    /// The sum of squares of what is left of the data, over its degrees of freedom; zero where there are none.
    #[must_use]
    pub fn chi_squared(&self, found: &Solution<T, C>) -> T {
        let freedom = self.rows - T::from_f64(found.rank as f64);
        if freedom > T::ZERO { found.residual * found.residual / freedom } else { T::ZERO }
    }

    /// What the rows say about x.
    #[must_use]
    pub fn solution(&self) -> Shown<T, C> {
        let mut found = Solution::default();
        self.solve(&mut found);
        let mut shown = Shown {
            solution: [None; C],
            deviations: [None; C],
            covariance: found.covariance,
            rank: found.rank,
            residual: found.residual,
            condition: found.condition,
        };
        for place in 0..C {
            if found.shown[place] {
                shown.solution[place] = Some(found.values[place]);
                shown.deviations[place] = Some(found.deviations[place]);
            }
        }
        shown
    }
}

/// The memory of a solution, and what it shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution<T, const C: usize> {
    /// The columns of the factor in unit length, which become orthonormal.
    columns: [[T; C]; C],
    scales: [T; C],
    /// What is left of the right-hand side, and its parts along the pivots.
    right: [T; C],
    projected: [T; C],
    /// The columns in the order of the pivots, the free ones last, and the triangle that they form: a row for every pivot.
    order: [usize; C],
    triangle: [[T; C]; C],
    column: [T; C],
    /// The unknowns of least squares, where they are shown.
    pub values: [T; C],
    /// Their covariance, when the rows' errors have the deviations that they were divided by; zero for those that are not shown.
    pub covariance: [[T; C]; C],
    /// Whether an unknown is shown.
    pub shown: [bool; C],
    /// The smallest unknowns, each in the size of its column, of all that leave as little: what is hidden stays as it is. In a step from
    /// some parameters these hold what is shown, alone and in combinations.
    pub steps: [T; C],
    /// A row for every unknown that leads a combination which is shown: the weights of all unknowns in it, one at its own. A shown unknown is
    /// a combination of itself alone; the others lead none.
    pub combinations: [[T; C]; C],
    /// The standard deviations of the combinations, whose values are `values` of the unknowns that lead them.
    pub deviations: [T; C],
    /// The number of directions that the data show.
    pub rank: usize,
    /// Euclidean length of what is left of the data, in deviations.
    pub residual: T,
    /// Of what is shown, the Frobenius norm of the matrix with columns of length 1, times that of its inverse: at least the condition
    /// number, and at most the rank times that.
    pub condition: T,
}

impl<T: Real, const C: usize> Default for Solution<T, C> {
    fn default() -> Self {
        let (vector, matrix) = ([T::ZERO; C], [[T::ZERO; C]; C]);
        Self {
            columns: matrix,
            scales: vector,
            right: vector,
            projected: vector,
            order: [0; C],
            triangle: matrix,
            column: vector,
            values: vector,
            covariance: matrix,
            shown: [false; C],
            steps: vector,
            combinations: matrix,
            deviations: vector,
            rank: 0,
            residual: T::ZERO,
            condition: T::ZERO,
        }
    }
}

impl<T: Real, const C: usize> Solution<T, C> {
    /// The columns of a factor in unit length.
    fn scale(&mut self, factor: &SquareRoot<T, C>) {
        self.right = factor.right;
        for c in 0..C {
            self.order[c] = c;
            for r in 0..C {
                self.columns[c][r] = factor.factor[r][c];
            }
            let size = length(&self.columns[c]);
            self.scales[c] = if size > T::ZERO { size } else { T::ONE };
            for r in 0..C {
                self.columns[c][r] /= self.scales[c];
            }
        }
    }

    /// Makes the columns orthonormal, the longest one first, until what is left of all is tiny; the right-hand side is carried along.
    fn eliminate(&mut self, tiny: T) {
        self.rank = 0;
        for k in 0..C {
            let mut diagonal = T::ZERO;
            let mut best = k;
            for j in k..C {
                let size = length(&self.columns[self.order[j].min(C - 1)]);
                if size > diagonal {
                    diagonal = size;
                    best = j;
                }
            }
            if diagonal <= tiny {
                break;
            }
            self.order.swap(k, best.min(C - 1));
            let pivot = self.order[k].min(C - 1);
            for r in 0..C {
                self.columns[pivot][r] /= diagonal;
            }
            self.triangle[k][pivot] = diagonal;
            let unit = self.columns[pivot];
            for j in k + 1..C {
                let other = self.order[j].min(C - 1);
                self.triangle[k][other] = Self::take_off(&unit, &mut self.columns[other]);
            }
            self.projected[k] = Self::take_off(&unit, &mut self.right);
            self.rank += 1;
        }
    }

    /// The value of the combination that an unknown leads, for the step from some parameters.
    #[must_use]
    pub fn combined(&self, about: &[T; C], row: usize) -> T {
        let mut sum = self.values[row];
        for place in 0..C {
            sum += self.combinations[row][place] * about[place];
        }
        sum
    }

    /// Solves with the triangle in the place of `column`, which is in the order of the pivots.
    fn substitute(&mut self) {
        let rank = self.rank.min(C);
        for k in (0..rank).rev() {
            let mut sum = self.column[k];
            for j in k + 1..rank {
                sum -= self.triangle[k][self.order[j].min(C - 1)] * self.column[j];
            }
            self.column[k] = sum / self.triangle[k][self.order[k].min(C - 1)];
        }
    }

    /// Says what is shown: pivots of which no free column takes more than a leak. Of the others combinations are shown, with as much of the
    /// free unknowns, in the size of their columns, as their columns take.
    fn judge(&mut self, leak: T) {
        let rank = self.rank.min(C);
        self.combinations = [[T::ZERO; C]; C];
        for j in 0..C {
            let place = self.order[j].min(C - 1);
            self.shown[place] = j < rank;
            self.combinations[place][place] = if j < rank { T::ONE } else { T::ZERO };
        }
        for j in rank..C {
            let free = self.order[j].min(C - 1);
            for k in 0..rank {
                self.column[k] = self.triangle[k][free];
            }
            self.substitute();
            for k in 0..rank {
                if self.column[k].abs() > leak || !self.column[k].is_finite() {
                    let pivot = self.order[k].min(C - 1);
                    self.shown[pivot] = false;
                    self.combinations[pivot][free] = self.column[k];
                }
            }
        }
    }

    /// Takes the part along the free directions off the steps, and gives steps and combinations the sizes of the unknowns. A free direction
    /// has one of its own unknown, and less of the pivots by what their columns take; those before it are taken off it first.
    fn spread(&mut self) {
        let rank = self.rank.min(C);
        for j in rank..C {
            let free = self.order[j].min(C - 1);
            for place in 0..C {
                self.columns[free][place] = -self.combinations[place][free];
            }
            self.columns[free][free] = T::ONE;
            for i in rank..j {
                let unit = self.columns[self.order[i].min(C - 1)];
                let _ = Self::take_off(&unit, &mut self.columns[free]);
            }
            let size = length(&self.columns[free]);
            let mut along = T::ZERO;
            for place in 0..C {
                self.columns[free][place] /= size;
                along += self.columns[free][place] * self.steps[place];
            }
            for place in 0..C {
                self.steps[place] -= along * self.columns[free][place];
            }
        }
        for row in 0..C {
            self.steps[row] /= self.scales[row];
            for place in 0..C {
                self.combinations[row][place] *= self.scales[place] / self.scales[row];
            }
        }
    }

    /// Takes the part along a column of unit length off another; gives its size.
    fn take_off(unit: &[T; C], other: &mut [T; C]) -> T {
        let mut along = T::ZERO;
        for r in 0..C {
            along += unit[r] * other[r];
        }
        for r in 0..C {
            other[r] -= along * unit[r];
        }
        along
    }

    /// The covariance, from the columns of the triangle's inverse.
    fn invert(&mut self) {
        let mut all = T::ZERO;
        self.covariance = [[T::ZERO; C]; C];
        let rank = self.rank.min(C);
        for k in 0..rank {
            for j in 0..rank {
                self.column[j] = if j == k { T::ONE } else { T::ZERO };
            }
            self.substitute();
            for j in 0..rank {
                let row = self.order[j].min(C - 1);
                for i in 0..rank {
                    self.covariance[row][self.order[i].min(C - 1)] += self.column[j] * self.column[i];
                }
                all += self.column[j] * self.column[j];
            }
        }
        self.condition = (T::from_f64(self.rank as f64) * all).sqrt();
        for row in 0..C {
            self.deviations[row] = self.covariance[row][row].sqrt() / self.scales[row];
            for place in 0..C {
                let both = self.shown[row] && self.shown[place];
                let own = self.covariance[row][place] / self.scales[row] / self.scales[place];
                self.covariance[row][place] = if both { own } else { T::ZERO };
            }
        }
    }
}

/// What the data show of the unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown<T, const C: usize> {
    /// The unknowns of least squares; nothing for those that the data do not show.
    pub solution: [Option<T>; C],
    /// Their standard deviations, when the rows' errors have the deviations that they were divided by.
    pub deviations: [Option<T>; C],
    /// The covariance of the unknowns under the same condition; zero for those that the data do not show.
    pub covariance: [[T; C]; C],
    /// The number of directions that the data show.
    pub rank: usize,
    /// Euclidean length of what is left of the data, in deviations.
    pub residual: T,
    /// Of what is shown, the Frobenius norm of the matrix with columns of length 1, times that of its inverse: at least the condition
    /// number, and at most the rank times that.
    pub condition: T,
}

/// The root of the sum of two squares, which neither overflow nor vanish.
fn hypotenuse<T: Real>(a: T, b: T) -> T {
    let large = a.abs().max(b.abs());
    let small = a.abs().min(b.abs());
    if large <= T::ZERO {
        return large;
    }
    let ratio = small / large;
    large * (T::ONE + ratio * ratio).sqrt()
}

/// Euclidean length, scaled by the largest entry so that squares neither overflow nor vanish.
fn length<T: Real>(values: &[T]) -> T {
    let mut largest = T::ZERO;
    for i in 0..values.len() {
        largest = largest.max(values[i].abs());
    }
    if largest <= T::ZERO {
        return T::ZERO;
    }
    let mut sum = T::ZERO;
    for i in 0..values.len() {
        let part = values[i] / largest;
        sum += part * part;
    }
    largest * sum.sqrt()
}
