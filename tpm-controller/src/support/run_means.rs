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
#![allow(
    clippy::needless_range_loop,
    reason = "an index of rows or columns reads as in the mathematics, and is below the array's length"
)]

use super::{Phasor, Real, RunLines, RunModel, RunSampling, RunWorkspace};

/// Where the filter begins, as a share of the highest line: what it lacks there the lines have, and above them it lacks nothing.
const BEGINNING: f64 = 0.6;
/// Damping of the two sections of a filter of Butterworth's fourth order, `2 cos(pi/8)` and `2 cos(3 pi/8)`.
const DAMPING: [f64; 2] = [1.847_759_065_022_573_5, 0.765_366_864_730_179_6];
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
        let first = T::from_f64(BEGINNING * lines as f64 / 2.0);
        let bend = tangent(first, samples_per_period);
        Self { samples_per_period, count: 0, bend, states: [[T::ZERO; 4]; U], products: [[T::ZERO; U]; U] }
    }

    /// Takes in the next sample of the inputs.
    pub fn push(&mut self, inputs: &[T; U]) {
        let (mut passed, mut fast) = ([T::ZERO; U], [T::ZERO; U]);
        let two = T::from_f64(2.0);
        for input in 0..U {
            let mut value = inputs[input];
            for (section, damping) in DAMPING.into_iter().enumerate() {
                let damping = T::from_f64(damping);
                let [band, low] = [2 * section, 2 * section + 1];
                let states = &mut self.states[input];
                let share = T::ONE / (T::ONE + self.bend * (self.bend + damping));
                let rate = share * (states[band] + self.bend * (value - states[low]));
                let slow = states[low] + self.bend * rate;
                states[band] = two * rate - states[band];
                states[low] = two * slow - states[low];
                let high = value - damping * rate - slow;
                if section == 0 {
                    fast[input] = high;
                    value = rate;
                } else {
                    value = high;
                }
            }
            passed[input] = value;
        }
        if self.count >= self.samples_per_period {
            // Between samples a mass under a held force goes on: its velocity has that of the middle, and a twelfth of the square of the step.
            let between = self.bend * self.bend / T::from_f64(3.0);
            for input in 0..U {
                for other in 0..=input {
                    self.products[input][other] += passed[input] * passed[other] + between * fast[input] * fast[other];
                }
            }
        }
        self.count = self.count.saturating_add(1);
    }

    /// Mean products of what has passed; nothing within the first period.
    pub(super) fn means(&self) -> Option<[[T; U]; U]> {
        let count = self.count.checked_sub(self.samples_per_period).filter(|count| *count > 0)?;
        Some(self.products.map(|row| row.map(|sum| sum / T::from_f64(f64::from(count)))))
    }
}

/// `tan(w T / 2)` at so many harmonics.
fn tangent<T: Real>(harmonic: T, samples_per_period: u32) -> T {
    let (sine, cosine) = (T::PI * harmonic / T::from_f64(f64::from(samples_per_period))).sin_cos();
    sine / cosine
}

/// The covariance of the motion that noise makes, and how uncertain it is, as a share of it.
struct Motion<T, const S: usize> {
    covariance: [[T; S]; S],
    doubt: T,
}

/// Solves a complex system in its place, the largest pivot first; nothing where there is none.
fn eliminate<T: Real, const Q: usize>(matrix: &mut [[Phasor<T>; Q]; Q], right: &mut [Phasor<T>; Q]) -> Option<()> {
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
        if !(size > T::ZERO && size.is_finite()) {
            return None;
        }
        let inverse = matrix[step][step].conj().times(T::ONE / size);
        matrix[step] = matrix[step].map(|entry| entry * inverse);
        right[step] = right[step] * inverse;
        for row in 0..Q {
            if row == step {
                continue;
            }
            let factor = matrix[row][step];
            for column in 0..Q {
                let own = matrix[step][column];
                matrix[row][column] -= factor * own;
            }
            let own = right[step];
            right[row] -= factor * own;
        }
    }
    Some(())
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
    /// The mean response of the rows to the coordinates at an angular frequency; of second derivatives alone where it is zero.
    fn mean_response(&self, slots: &[(usize, u32); S], w: T) -> [[Phasor<T>; Q]; Q] {
        let mut matrix = [[Phasor::ZERO; Q]; Q];
        for (row, gains) in matrix.iter_mut().zip(&self.gains) {
            for (lines, &(coordinate, order)) in gains.iter().zip(slots) {
                let gain = lines[0].re;
                if w > T::ZERO {
                    row[coordinate] += Phasor::derivative(w, order).times(gain);
                } else if order == 2 {
                    row[coordinate] += Phasor::new(gain, T::ZERO);
                }
            }
        }
        matrix
    }

    /// Covariance of the motion that noise makes on its way round the loop; nothing where it is not known.
    fn true_motion<const U: usize, const C: usize>(
        &self,
        slots: &[(usize, u32); S],
        run: &RunLines<T, C, L>,
        (passed, map): (&RunPassed<T, U>, &[[T; U]; R]),
        inputs: &[[Phasor<T>; L]; U],
        (sample_time, w): (T, T),
    ) -> Option<Motion<T, S>> {
        let two = T::from_f64(2.0);
        let corner = two / sample_time * passed.bend;
        let top = w * T::from_f64(L as f64 / 2.0);
        if Q != R || !(corner > T::ZERO && corner.is_finite()) {
            return None;
        }
        let mut above = passed.means()?;
        let mut answer = [[T::ZERO; U]; Q];
        for input in 0..U {
            let mut masses = self.mean_response(slots, T::ZERO);
            let mut right = [Phasor::ZERO; Q];
            for (right, row) in right.iter_mut().zip(map) {
                *right = Phasor::new(row[input], T::ZERO);
            }
            eliminate(&mut masses, &mut right)?;
            for (answer, found) in answer.iter_mut().zip(right) {
                answer[input] = found.re;
            }
        }
        // How far masses are from being all that answers, at the highest line.
        let (masses, whole) = (self.mean_response(slots, T::ZERO), self.mean_response(slots, top));
        let (mut apart, mut size) = (T::ZERO, T::ZERO);
        for (mass, own) in masses.iter().flatten().zip(whole.iter().flatten()) {
            let mass = mass.times(top * top);
            apart += (*own + mass).square();
            size += mass.square();
        }
        // The variance of the band of a harmonic over the square of a line.
        let band = run.samples_behind_line() * two / T::from_f64(f64::from(run.samples_per_period()));
        let mut covariance = [[T::ZERO; S]; S];
        let mut squares = [T::ZERO; S];
        for line in 1..L {
            let ratio = tangent(T::from_f64(line as f64 / 2.0), run.samples_per_period()) / passed.bend;
            let cube = ratio * ratio * ratio;
            let share = cube * cube / (T::ONE + cube * cube * ratio * ratio);
            if line % 2 == 0 {
                // The periodic part of what was passed, without the noise of the line.
                for input in 0..U {
                    for other in 0..=input {
                        let product = |at: usize| {
                            let (own, by) = (inputs[input][at], inputs[other][at]);
                            own.re * by.re + own.im * by.im
                        };
                        above[input][other] -= share * (product(line) - product(line + 1)) / two;
                    }
                }
                continue;
            }
            let frequency = w * T::from_f64(line as f64) / two;
            let mut response = self.mean_response(slots, frequency);
            let mut moved = [Phasor::ZERO; Q];
            for (moved, drive) in moved.iter_mut().zip(&self.drive) {
                *moved = drive[line];
            }
            eliminate(&mut response, &mut moved)?;
            // Near a resonance inputs say little. What was measured is this motion and the noise of the sensor.
            for ((moved, lines), sensor) in moved.iter_mut().zip(&self.motion).zip(&self.sensors) {
                let most = two * (lines[line].square() + T::from_f64(MOST_NOISE) * *sensor);
                if moved.square() > most {
                    *moved = lines[line];
                }
            }
            let modelled = answer.map(|row| {
                row.iter().zip(inputs).fold(Phasor::ZERO, |sum, (answer, lines)| sum + lines[line].times(*answer))
            });
            let product = |a: Phasor<T>, b: Phasor<T>| a.re * b.re + a.im * b.im;
            for (entry, &(a, of_a)) in slots.iter().enumerate() {
                for (second, &(b, of_b)) in slots.iter().enumerate() {
                    let parts = (Phasor::derivative(frequency, of_a), Phasor::derivative(frequency, of_b));
                    let mut own = product(moved[a] * parts.0, moved[b] * parts.1);
                    if of_a + of_b == 2 {
                        let filtered = share * product(modelled[a], modelled[b]) / (corner * corner);
                        own -= if of_a == 1 { filtered } else { -filtered };
                    }
                    covariance[entry][second] += band * own;
                    if entry == second {
                        squares[entry] += band * own * band * own / two;
                    }
                }
            }
        }
        // The band above the lines is at least as wide as that below.
        let independent = T::from_f64(f64::from(run.samples()) / f64::from(run.samples_per_period()) * L as f64 / 2.0);
        let share = T::ONE / independent + T::from_f64(LEAST_DOUBT) + apart / size;
        let mut doubt = T::ZERO;
        for (entry, &(a, of_a)) in slots.iter().enumerate() {
            for (second, &(b, of_b)) in slots.iter().enumerate() {
                let mut tail = T::ZERO;
                for input in 0..U {
                    for other in 0..U {
                        let product = if input >= other { above[input][other] } else { above[other][input] };
                        tail += answer[a][input] * answer[b][other] * product;
                    }
                }
                tail /= corner * corner;
                if of_a + of_b == 2 {
                    covariance[entry][second] += if of_a == 1 { tail } else { -tail };
                }
                if entry == second && of_a == 1 {
                    let own = covariance[entry][entry];
                    if !(own > T::ZERO && own.is_finite()) {
                        return None;
                    }
                    squares[entry] += tail * tail * share;
                    doubt = doubt.max((squares[entry] / (own * own)).sqrt());
                }
            }
        }
        Some(Motion { covariance, doubt })
    }

    /// Finds what the motion that noise makes adds to the means of the regressor, half the mean second derivative times its covariance, and
    /// takes of what the rows leave, where a row has a mean. It is not known where noise is not that of the sensors alone, or masses do not answer above the lines.
    pub(super) fn find_shift<M: RunModel<T, U, R, P, S>, const U: usize, const C: usize>(
        &mut self,
        model: &M,
        run: &RunLines<T, C, L>,
        passed: (&RunPassed<T, U>, &[[T; U]; R]),
        inputs: &[[Phasor<T>; L]; U],
        (sampling, theta, w): (RunSampling<T>, &[T; P], T),
    ) {
        self.forget_shift();
        if self.disturbed || !(0..R).any(|row| self.has_mean(row, theta)) {
            return;
        }
        if self.reach == 0 {
            // Where derivatives do not vary along the motion, nothing is added.
            self.shifts = true;
            return;
        }
        let motion = self.true_motion(&M::MOTION, run, passed, inputs, (sampling.sample_time, w));
        let Some(Motion { covariance, doubt }) = motion else { return };
        self.shifts = true;
        self.doubt = doubt;
        let steps = self.steps(&M::MOTION, w);
        for point in 0..M::POINTS {
            let at = self.motion_at(&M::MOTION, point, M::POINTS, w);
            for entry in 0..S {
                for second in 0..=entry {
                    let half = if entry == second { 0.5 } else { 1.0 };
                    let share = T::from_f64(half) * covariance[entry][second]
                        / (T::from_f64(4.0 * M::POINTS as f64) * steps[entry] * steps[second]);
                    // Accelerations are in the rows as they are.
                    if share.abs() <= T::ZERO || M::MOTION[entry].1 + M::MOTION[second].1 == 4 {
                        continue;
                    }
                    for (first, other) in [(T::ONE, T::ONE), (T::ONE, -T::ONE), (-T::ONE, T::ONE), (-T::ONE, -T::ONE)] {
                        let (mut phi, mut known) = ([[T::ZERO; P]; R], [T::ZERO; R]);
                        let mut moved = at;
                        moved[entry] += first * steps[entry];
                        moved[second] += other * steps[second];
                        model.rows(&moved, &mut phi, &mut known, &mut [[T::ZERO; U]; R]);
                        let share = share * first * other;
                        for row in 0..R {
                            self.shifted[row] += share * known[row];
                            for column in 0..P {
                                self.shift[row][column] += share * phi[row][column];
                                self.shifted[row] += share * phi[row][column] * theta[column];
                            }
                        }
                    }
                }
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
    pub(super) fn has_mean(&self, row: usize, theta: &[T; P]) -> bool {
        let least = T::from_f64(LEAST_VISIBLE * LEAST_VISIBLE) * self.variance(row, 0);
        let terms = self.regressor[row].iter().zip(theta).map(|(lines, theta)| lines[0].times(*theta));
        terms.chain([self.known[row][0]]).any(|term| term.square() > least)
    }
}
