//! What motion that noise makes adds to the means of the rows.
//!
//! Noise of the sensors goes round the loop and moves the machine by nu, which no harmonic shows. The mean of a row that is even in a
//! velocity holds `mean Phi(q + nu) = mean Phi(q) + Phi'' cov(nu) / 2`. Since nu follows from the inputs, which are known, its covariance can
//! be worked out, and the mean be used: it shows such a term best.
//!
//! Halfway between the harmonics `J nu = B u`. Above the lines, where masses alone answer to forces, the velocity of nu is that of a mass
//! under the same input, which is passed sample by sample through a filter: what it has passed is there as the sum of its squares.
//!
//! Invariants: nothing allocates; every loop has a length that the model fixes, and indices run up to lengths of the arrays that they index.

use super::run_workspace::{motion_at, turn_at};
use super::{Phasor, Real, RunLines, RunModel, RunSampling, RunWorkspace};

/// Where the filter begins, as a share of the highest line: what it lacks there the lines have, and above them it lacks nothing.
const BEGINNING: f64 = 0.6;
/// Damping of the two sections of a filter of Butterworth's fourth order, `2 cos(pi/8)` and `2 cos(3 pi/8)`.
const FLAT: f64 = 1.847_759_065_022_573_5;
const SHARP: f64 = 0.765_366_864_730_179_6;
/// Lower bound on the square of the relative deviation of what the filter passed.
const LEAST_DOUBT: f64 = 4e-4;
/// Noise of a line exceeds so many times its variance once in 8000 lines.
const MOST_NOISE: f64 = 9.0;
/// A term has a mean where it is so many times as large as the noise of its row.
const LEAST_VISIBLE: f64 = 4.0;

/// What the inputs of a run hold above its lines: U inputs through `s^3 / B(s)`, the high pass of Butterworth's fourth order over s, and the
/// sums of the products of what has passed behind the first period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunPassed<T, const U: usize> {
    samples_per_period: u32,
    count: u32,
    /// The tangent of half the angle by which the filter's first frequency turns in a sample.
    bend: T,
    states: [[T; 4]; U],
    products: [[T; U]; U],
}

impl<T: Real, const U: usize> RunPassed<T, U> {
    /// Before the first sample of a run with so many lines.
    #[must_use]
    pub fn new(samples_per_period: u32, lines: usize) -> Self {
        let (states, products) = ([[T::ZERO; 4]; U], [[T::ZERO; U]; U]);
        let mut this = Self { samples_per_period, count: 0, bend: T::ZERO, states, products };
        this.begin(samples_per_period, lines);
        this
    }

    /// Begins a run with so many lines.
    pub fn begin(&mut self, samples_per_period: u32, lines: usize) {
        self.samples_per_period = samples_per_period;
        self.count = 0;
        self.bend = tangent(T::from_f64(BEGINNING) * T::from_f64(lines as f64) / T::from_f64(2.0), samples_per_period);
        self.states = [[T::ZERO; 4]; U];
        self.products = [[T::ZERO; U]; U];
    }

    /// Takes in the next sample of the inputs. Between samples a mass under a held force goes on: its velocity has that of the middle, and
    /// a twelfth of the square of the step.
    pub fn push(&mut self, inputs: &[T; U]) {
        let mut passed = [T::ZERO; U];
        let mut fast = [T::ZERO; U];
        let two = T::from_f64(2.0);
        for input in 0..U {
            let mut value = inputs[input];
            for section in 0..2 {
                let damping = if section == 0 { T::from_f64(FLAT) } else { T::from_f64(SHARP) };
                let band = self.states[input][2 * section];
                let low = self.states[input][2 * section + 1];
                let share = T::ONE / (T::ONE + self.bend * (self.bend + damping));
                let rate = share * (band + self.bend * (value - low));
                let slow = low + self.bend * rate;
                self.states[input][2 * section] = two * rate - band;
                self.states[input][2 * section + 1] = two * slow - low;
                let high = value - damping * rate - slow;
                if section == 0 {
                    fast[input] = high;
                    value = rate;
                } else {
                    passed[input] = high;
                }
            }
        }
        if self.count >= self.samples_per_period {
            let between = self.bend * self.bend / T::from_f64(3.0);
            for input in 0..U {
                for other in 0..=input {
                    self.products[input][other] += passed[input] * passed[other] + between * fast[input] * fast[other];
                }
            }
        }
        self.count = self.count.saturating_add(1);
    }

    /// Whether anything has passed behind the first period.
    fn is_begun(&self) -> bool {
        self.count > self.samples_per_period
    }

    /// A mean product of what has passed, of an input and one that is not behind it.
    pub(super) fn mean(&self, input: usize, other: usize) -> T {
        let passed = self.count - self.samples_per_period;
        self.products[input][other] / T::from_f64(f64::from(passed))
    }
}

/// `tan(w T / 2)` at so many harmonics.
fn tangent<T: Real>(harmonic: T, samples_per_period: u32) -> T {
    let half = T::PI * harmonic / T::from_f64(f64::from(samples_per_period));
    half.sin() / half.cos()
}

/// The real part of a phasor times the conjugate of another.
fn product<T: Real>(a: Phasor<T>, b: Phasor<T>) -> T {
    a.re * b.re + a.im * b.im
}

/// Solves a complex system in its place, the largest pivot first; says whether there is a solution.
fn eliminate<T: Real, const Q: usize>(matrix: &mut [[Phasor<T>; Q]; Q], right: &mut [Phasor<T>; Q]) -> bool {
    for step in 0..Q {
        let mut best = step;
        for row in step + 1..Q {
            if matrix[row][step].square() > matrix[best][step].square() {
                best = row;
            }
        }
        matrix.swap(step, best);
        right.swap(step, best);
        let size = matrix[step][step].square();
        if size <= T::ZERO || !size.is_finite() {
            return false;
        }
        let inverse = matrix[step][step].conj().times(T::ONE / size);
        for column in 0..Q {
            matrix[step][column] = matrix[step][column] * inverse;
        }
        right[step] = right[step] * inverse;
        for row in 0..Q {
            if row == step {
                continue;
            }
            let factor = matrix[row][step];
            for column in 0..Q {
                let own = factor * matrix[step][column];
                matrix[row][column] -= own;
            }
            let own_right = factor * right[step];
            right[row] -= own_right;
        }
    }
    true
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
    /// The mean response of the rows to the coordinates at an angular frequency; of second derivatives alone where it is zero.
    fn mean_response<M: RunModel<T, U, R, P, S>>(&self, model: &M, w: T, matrix: &mut [[Phasor<T>; Q]; Q]) {
        let _ = model;
        for row in 0..Q {
            for column in 0..Q {
                matrix[row][column] = Phasor::zero();
            }
            for entry in 0..S {
                let gain = self.gains[row][entry][0].re;
                if w > T::ZERO {
                    matrix[row][M::COORDINATES[entry]] += Phasor::derivative(w, M::ORDERS[entry]).times(gain);
                } else if M::ORDERS[entry] == 2 {
                    matrix[row][M::COORDINATES[entry]] += Phasor::new(gain, T::ZERO);
                }
            }
        }
    }

    /// Covariance of the motion that noise makes on its way round the loop: what the inputs halfway between the harmonics explain, and above
    /// the lines what the filter passed, to which masses alone answer. Says whether it is known.
    fn true_motion<M: RunModel<T, U, R, P, S>, const C: usize>(
        &mut self,
        model: &M,
        run: &RunLines<T, C, L>,
        passed: &RunPassed<T, U>,
        sampling: &RunSampling<T>,
    ) -> bool {
        let two = T::from_f64(2.0);
        let corner = two / sampling.sample_time * passed.bend;
        let top = self.w * T::from_f64(L as f64) / two;
        if Q != R || corner <= T::ZERO || !corner.is_finite() || !passed.is_begun() {
            return false;
        }
        let mut matrix = [[Phasor::zero(); Q]; Q];
        let mut right = [Phasor::zero(); Q];
        let mut above = [[T::ZERO; U]; U];
        let mut answer = [[T::ZERO; U]; Q];
        for input in 0..U {
            self.mean_response(model, T::ZERO, &mut matrix);
            for row in 0..Q {
                right[row] = Phasor::new(self.map[row][input], T::ZERO);
            }
            if !eliminate(&mut matrix, &mut right) {
                return false;
            }
            for coordinate in 0..Q {
                answer[coordinate][input] = right[coordinate].re;
            }
            for other in 0..=input {
                above[input][other] = passed.mean(input, other);
            }
        }
        // How far masses are from being all that answers, at the highest line.
        let mut masses = [[Phasor::zero(); Q]; Q];
        self.mean_response(model, T::ZERO, &mut masses);
        self.mean_response(model, top, &mut matrix);
        let mut apart = T::ZERO;
        let mut whole = T::ZERO;
        for row in 0..Q {
            for column in 0..Q {
                let mass = masses[row][column].times(top * top);
                apart += (matrix[row][column] + mass).square();
                whole += mass.square();
            }
        }
        // The variance of the band of a harmonic over the square of a line.
        let period = T::from_f64(f64::from(run.samples_per_period));
        let band = run.samples_behind_line() * two / period;
        let mut squares = [T::ZERO; S];
        self.covariance = [[T::ZERO; S]; S];
        for line in 1..L {
            let ratio = tangent(T::from_f64(line as f64) / two, run.samples_per_period) / passed.bend;
            let cube = ratio * ratio * ratio;
            let share = cube * cube / (T::ONE + cube * cube * ratio * ratio);
            if line % 2 == 0 {
                // The periodic part of what was passed, without the noise of the line.
                for input in 0..U {
                    for other in 0..=input {
                        let periodic = product(self.inputs[input][line], self.inputs[other][line]);
                        let noise = product(self.inputs[input][line + 1], self.inputs[other][line + 1]);
                        above[input][other] -= share * (periodic - noise) / two;
                    }
                }
                continue;
            }
            let frequency = self.w * T::from_f64(line as f64) / two;
            self.mean_response(model, frequency, &mut matrix);
            let mut modelled = [Phasor::zero(); Q];
            for row in 0..Q {
                right[row] = self.drive[row][line];
                for input in 0..U {
                    modelled[row] += self.inputs[input][line].times(answer[row][input]);
                }
            }
            if !eliminate(&mut matrix, &mut right) {
                return false;
            }
            for coordinate in 0..Q {
                // Near a resonance inputs say little. What was measured is this motion and the noise of the sensor.
                let measured = self.motion[coordinate][line];
                let most = two * (measured.square() + T::from_f64(MOST_NOISE) * self.sensors[coordinate]);
                if right[coordinate].square() > most {
                    right[coordinate] = measured;
                }
            }
            for entry in 0..S {
                let part = right[M::COORDINATES[entry]] * Phasor::derivative(frequency, M::ORDERS[entry]);
                for second in 0..S {
                    let beside = right[M::COORDINATES[second]] * Phasor::derivative(frequency, M::ORDERS[second]);
                    let mut own = product(part, beside);
                    if M::ORDERS[entry] + M::ORDERS[second] == 2 {
                        let mass = product(modelled[M::COORDINATES[entry]], modelled[M::COORDINATES[second]]);
                        let filtered = share * mass / (corner * corner);
                        own -= if M::ORDERS[entry] == 1 { filtered } else { -filtered };
                    }
                    self.covariance[entry][second] += band * own;
                    if entry == second {
                        squares[entry] += band * own * band * own / two;
                    }
                }
            }
        }
        // The band above the lines is at least as wide as that below.
        let number = run.samples / run.samples_per_period;
        let periods = T::from_f64(f64::from(number));
        let inexact = T::ONE / (periods * T::from_f64(L as f64) / two) + T::from_f64(LEAST_DOUBT) + apart / whole;
        self.doubt = T::ZERO;
        for entry in 0..S {
            for second in 0..S {
                let mut tail = T::ZERO;
                for input in 0..U {
                    for other in 0..U {
                        let both = if input >= other { above[input][other] } else { above[other][input] };
                        tail += answer[M::COORDINATES[entry]][input] * answer[M::COORDINATES[second]][other] * both;
                    }
                }
                tail /= corner * corner;
                if M::ORDERS[entry] + M::ORDERS[second] == 2 {
                    self.covariance[entry][second] += if M::ORDERS[entry] == 1 { tail } else { -tail };
                }
                if entry == second && M::ORDERS[entry] == 1 {
                    let own = self.covariance[entry][entry];
                    if own <= T::ZERO || !own.is_finite() {
                        return false;
                    }
                    squares[entry] += tail * tail * inexact;
                    self.doubt = self.doubt.max((squares[entry] / (own * own)).sqrt());
                }
            }
        }
        true
    }

    /// Finds what the motion that noise makes adds to the means of the regressor, half the mean second derivative times its covariance, and
    /// takes of what the rows leave, where a row has a mean. It is not known where noise is not that of the sensors alone, or masses do not
    /// answer above the lines. Where derivatives do not vary along the motion, nothing is added.
    pub(super) fn find_shift<M: RunModel<T, U, R, P, S>, const C: usize>(
        &mut self,
        model: &M,
        run: &RunLines<T, C, L>,
        passed: &RunPassed<T, U>,
        sampling: &RunSampling<T>,
    ) {
        self.forget_shift();
        let mut any = false;
        for row in 0..R {
            any |= self.has_mean(row);
        }
        if self.disturbed || !any {
            return;
        }
        if self.reach == 0 {
            self.shifts = true;
            return;
        }
        if !self.true_motion(model, run, passed, sampling) {
            self.doubt = T::ZERO;
            return;
        }
        self.shifts = true;
        let mut steps = [T::ZERO; S];
        self.steps(model, &mut steps);
        for point in 0..M::POINTS {
            let turn = turn_at(model, point);
            let mut motion = [T::ZERO; S];
            motion_at(model, &self.path, turn, self.w, &mut motion);
            for entry in 0..S {
                for second in 0..=entry {
                    let half = if entry == second { T::from_f64(0.5) } else { T::ONE };
                    let points = T::from_f64(M::POINTS as f64);
                    let share = half * self.covariance[entry][second]
                        / (T::from_f64(4.0) * steps[entry] * steps[second] * points);
                    // Accelerations are in the rows as they are.
                    if share.abs() > T::ZERO && M::ORDERS[entry] + M::ORDERS[second] != 4 {
                        for side in 0..4 {
                            let forward = if side < 2 { steps[entry] } else { -steps[entry] };
                            let beside = if side % 2 == 0 { steps[second] } else { -steps[second] };
                            let sign = if side == 1 || side == 2 { -share } else { share };
                            let mut moved = motion;
                            moved[entry] += forward;
                            moved[second] += beside;
                            self.add_shifted(model, &moved, sign);
                        }
                    }
                }
            }
        }
    }

    /// Adds a share of the rows at a motion to what is added to their means.
    fn add_shifted<M: RunModel<T, U, R, P, S>>(&mut self, model: &M, motion: &[T; S], share: T) {
        let mut phi = [[T::ZERO; P]; R];
        let mut known = [T::ZERO; R];
        let mut map = [[T::ZERO; U]; R];
        model.rows(motion, &mut phi, &mut known, &mut map);
        for row in 0..R {
            self.shifted[row] += share * known[row];
            for column in 0..P {
                self.shift[row][column] += share * phi[row][column];
                self.shifted[row] += share * phi[row][column] * self.theta[column];
            }
        }
    }

    /// No shift is known.
    pub(super) fn forget_shift(&mut self) {
        self.shifts = false;
        self.doubt = T::ZERO;
        self.shift = [[T::ZERO; P]; R];
        self.shifted = [T::ZERO; R];
    }

    /// Whether a term of a row has a mean that stands out of the noise of the row.
    pub(super) fn has_mean(&self, row: usize) -> bool {
        let mut largest = self.known[row][0].square();
        for column in 0..P {
            largest = largest.max(self.regressor[row][column][0].times(self.theta[column]).square());
        }
        largest > T::from_f64(LEAST_VISIBLE * LEAST_VISIBLE) * self.variance(row, 0)
    }
}
