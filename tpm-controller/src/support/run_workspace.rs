//! The rows of a model along the measured motion of one run, in memory of fixed size: harmonics of the regressor, of the known terms and
//! of the applied inputs, and lines of the rows' derivatives.
//!
//! Invariants: nothing allocates, and every loop has a length that the model fixes. Harmonic k stands in the place of line 2 k
//! ([`RunLines`](super::RunLines)).
#![allow(
    clippy::needless_range_loop,
    reason = "an index of rows or columns reads as in the mathematics, and is below the array's length"
)]

use super::{Phasor, Real, RunFault};

/// Step of difference quotients as a share of a motion's root mean square.
const DIFFERENCE_STEP: f64 = 1e-2;

/// The rows of a model: U inputs, R rows, P parameters, S entries of a motion.
pub trait RunModel<T: Real, const U: usize, const R: usize, const P: usize, const S: usize> {
    /// Coordinate and order of the derivative of every entry of a motion.
    const MOTION: [(usize, u32); S];
    /// Points of a period at which the rows are evaluated.
    const POINTS: usize;

    /// The regressor, the known terms and the input map at a motion. Entries that are zero at every motion may be left out: all are zero
    /// before the call.
    fn rows(&self, motion: &[T; S], regressor: &mut [[T; P]; R], known: &mut [T; R], map: &mut [[T; U]; R]);
}

/// How the samples were taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunSampling<T> {
    /// Time between samples, s.
    pub sample_time: T,
    /// Whether every input is held until the next sample.
    pub held: bool,
    /// Time from a recorded input to its force, s, beyond the hold.
    pub delay: T,
}

/// The memory of an update: Q coordinates, R rows, P parameters, S entries of a motion, L lines, `E = R (L - 1)` equations at all harmonics,
/// and `K = E (E + 1) / 2` covariances of them.
#[derive(Clone, Copy, Debug)]
pub struct RunWorkspace<
    T,
    const Q: usize,
    const R: usize,
    const P: usize,
    const S: usize,
    const L: usize,
    const E: usize,
    const K: usize,
> {
    /// Lines of the measured coordinates.
    pub(super) motion: [[Phasor<T>; L]; Q],
    /// Harmonics of the motion along which the rows are evaluated, in the places of even lines: the measured one, or the reference.
    pub(super) path: [[Phasor<T>; L]; Q],
    /// Harmonics of what the tracking error makes of the rows, in the places of even lines, where the reference is the path.
    pub(super) response: [[Phasor<T>; L]; R],
    /// Harmonics of Phi, in the places of even lines.
    pub(super) regressor: [[[Phasor<T>; L]; P]; R],
    /// Harmonics of the known terms, in the places of even lines.
    pub(super) known: [[Phasor<T>; L]; R],
    /// Lines of B u.
    pub(super) drive: [[Phasor<T>; L]; R],
    /// Harmonics of what the rows leave at the present parameters, in the places of even lines.
    pub(super) rest: [[Phasor<T>; L]; R],
    /// Lines of the rows' derivatives by every entry of the motion, in the places of harmonics: entry m is harmonic m.
    pub(super) gains: [[[Phasor<T>; L]; S]; R],
    /// What a unit of noise in a coordinate makes of the variance of a row, line by line.
    pub(super) felt: [[[T; Q]; L]; R],
    /// Mean squares of the derivatives of every entry of the regressor by every entry of the motion.
    pub(super) slopes: [[[T; S]; P]; R],
    /// Whether a column of the regressor stands out of what noise makes of it.
    pub(super) shown: [bool; P],
    /// Variance of a line of every coordinate's sensor, and of the force on every row.
    pub(super) sensors: [T; Q],
    pub(super) forces: [T; R],
    /// Whether a force disturbs the rows, beside what the sensors' noise makes of them.
    pub(super) disturbed: bool,
    /// Whether it is known what motion that noise makes adds to the means of the rows, and how far it is uncertain, as a share of it.
    pub(super) shifts: bool,
    pub(super) doubt: T,
    /// What it adds to the means of the regressor, and takes of what the rows leave.
    pub(super) shift: [[T; P]; R],
    pub(super) shifted: [T; R],
    /// The highest harmonic of the derivatives that mixes lines of noise.
    pub(super) reach: usize,
    /// Harmonic, row and part (real, imaginary) of the equations that count.
    pub(super) places: [[u16; 3]; E],
    /// Their coefficients and right sides.
    pub(super) rows: [[T; P]; E],
    pub(super) right: [T; E],
    /// How many there are.
    pub(super) count: usize,
    /// Their covariance, then its Cholesky factor: the lower triangle, row by row.
    pub(super) noise: [T; K],
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
> Default for RunWorkspace<T, Q, R, P, S, L, E, K>
{
    fn default() -> Self {
        Self {
            motion: [[Phasor::ZERO; L]; Q],
            path: [[Phasor::ZERO; L]; Q],
            response: [[Phasor::ZERO; L]; R],
            regressor: [[[Phasor::ZERO; L]; P]; R],
            known: [[Phasor::ZERO; L]; R],
            drive: [[Phasor::ZERO; L]; R],
            rest: [[Phasor::ZERO; L]; R],
            gains: [[[Phasor::ZERO; L]; S]; R],
            felt: [[[T::ZERO; Q]; L]; R],
            slopes: [[[T::ZERO; S]; P]; R],
            shown: [false; P],
            sensors: [T::ZERO; Q],
            forces: [T::ZERO; R],
            disturbed: false,
            shifts: false,
            doubt: T::ZERO,
            shift: [[T::ZERO; P]; R],
            shifted: [T::ZERO; R],
            reach: 0,
            places: [[0; 3]; E],
            rows: [[T::ZERO; P]; E],
            right: [T::ZERO; E],
            count: 0,
            noise: [T::ZERO; K],
        }
    }
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
    /// Lines of the applied inputs, the channels behind the coordinates.
    pub(super) fn applied<const U: usize, const C: usize>(
        lines: &[[Phasor<T>; L]; C],
        w: T,
        sampling: RunSampling<T>,
    ) -> [[Phasor<T>; L]; U] {
        let two = T::from_f64(2.0);
        let mut inputs = [[Phasor::ZERO; L]; U];
        for (own, lines) in inputs.iter_mut().zip(lines.iter().skip(Q)) {
            for (index, (own, line)) in own.iter_mut().zip(lines).enumerate() {
                let frequency = w * T::from_f64(index as f64 / 2.0);
                let half = frequency * sampling.sample_time / two;
                let (hold, size) = match sampling.held && half > T::ZERO {
                    true => (half, half.sin() / half),
                    false => (T::ZERO, T::ONE),
                };
                *own = *line * Phasor::turn(-(frequency * sampling.delay + hold)).times(size);
            }
        }
        inputs
    }

    /// Harmonics of the regressor, the known terms and B u along the path, and halfway lines of B u by the mean of B, which it returns.
    pub(super) fn evaluate<M: RunModel<T, U, R, P, S>, const U: usize>(
        &mut self,
        model: &M,
        inputs: &[[Phasor<T>; L]; U],
        w: T,
    ) -> Result<[[T; U]; R], RunFault> {
        self.regressor = [[[Phasor::ZERO; L]; P]; R];
        self.known = [[Phasor::ZERO; L]; R];
        self.drive = [[Phasor::ZERO; L]; R];
        let mut mean_map = [[T::ZERO; U]; R];
        let mean = T::ONE / T::from_f64(M::POINTS as f64);
        for point in 0..M::POINTS {
            let turn = turn::<T>(point, M::POINTS);
            let motion = motion_at(&self.path, &M::MOTION, turn, w);
            let (mut phi, mut known, mut map) = ([[T::ZERO; P]; R], [T::ZERO; R], [[T::ZERO; U]; R]);
            model.rows(&motion, &mut phi, &mut known, &mut map);
            let mut forces = [T::ZERO; U];
            for (force, lines) in forces.iter_mut().zip(inputs) {
                *force = value_at(lines, 0, turn, w);
            }
            for row in 0..R {
                let drive = map[row].iter().zip(&forces).fold(T::ZERO, |sum, (b, u)| sum + *b * *u);
                if !drive.is_finite() || !known[row].is_finite() || !phi[row].iter().all(|entry| entry.is_finite()) {
                    return Err(RunFault::Equations);
                }
                for (lines, value) in self.regressor[row].iter_mut().zip(phi[row]) {
                    add_harmonics(lines, value * mean, turn);
                }
                add_harmonics(&mut self.known[row], known[row] * mean, turn);
                add_harmonics(&mut self.drive[row], drive * mean, turn);
                for (sum, value) in mean_map[row].iter_mut().zip(map[row]) {
                    *sum += value * mean;
                }
            }
        }
        for (drive, map) in self.drive.iter_mut().zip(&mean_map) {
            for (lines, b) in inputs.iter().zip(map) {
                let halfway = drive.iter_mut().zip(lines).skip(1).step_by(2);
                halfway.for_each(|(sum, line)| *sum += line.times(*b));
            }
        }
        Ok(mean_map)
    }

    /// Lines of the rows' derivatives along the path at these parameters, and harmonics of what the rows leave there: taken before the
    /// harmonics it is small, and rounding with it.
    pub(super) fn differentiate<M: RunModel<T, U, R, P, S>, const U: usize>(
        &mut self,
        model: &M,
        inputs: &[[Phasor<T>; L]; U],
        theta: &[T; P],
        w: T,
    ) {
        self.rest = [[Phasor::ZERO; L]; R];
        self.gains = [[[Phasor::ZERO; L]; S]; R];
        self.slopes = [[[T::ZERO; S]; P]; R];
        let mean = T::ONE / T::from_f64(M::POINTS as f64);
        let steps = self.steps(&M::MOTION, w);
        for point in 0..M::POINTS {
            let turn = turn::<T>(point, M::POINTS);
            let motion = motion_at(&self.path, &M::MOTION, turn, w);
            add_rest(model, &motion, inputs, theta, turn, w, &mut self.rest);
            for entry in 0..S {
                let mut sides = [([[T::ZERO; P]; R], [T::ZERO; R]); 2];
                for ((phi, known), sign) in sides.iter_mut().zip([T::ONE, -T::ONE]) {
                    let mut moved = motion;
                    moved[entry] += sign * steps[entry];
                    model.rows(&moved, phi, known, &mut [[T::ZERO; U]; R]);
                }
                let [(up, up_known), (down, down_known)] = sides;
                let both = steps[entry] + steps[entry];
                for row in 0..R {
                    let mut slope = (up_known[row] - down_known[row]) / both;
                    for column in 0..P {
                        let own = (up[row][column] - down[row][column]) / both;
                        slope += own * theta[column];
                        self.slopes[row][column][entry] += own * own * mean;
                    }
                    let mut turned = Phasor::new(slope * mean, T::ZERO);
                    for line in &mut self.gains[row][entry] {
                        *line += turned;
                        turned = turned * turn.conj();
                    }
                }
            }
        }
        self.find_reach();
    }

    /// Steps of difference quotients by the entries of the motion.
    pub(super) fn steps(&self, slots: &[(usize, u32); S], w: T) -> [T; S] {
        slots.map(|(coordinate, order)| step(&self.path[coordinate], order, w))
    }

    /// The motion along the path at one of the points of a period.
    pub(super) fn motion_at(&self, slots: &[(usize, u32); S], point: usize, points: usize, w: T) -> [T; S] {
        motion_at(&self.path, slots, turn::<T>(point, points), w)
    }

    /// Harmonics of what the rows leave along a motion at these parameters.
    pub(super) fn left<M: RunModel<T, U, R, P, S>, const U: usize>(
        model: &M,
        motion: &[[Phasor<T>; L]; Q],
        inputs: &[[Phasor<T>; L]; U],
        theta: &[T; P],
        w: T,
    ) -> [[Phasor<T>; L]; R] {
        let mut rest = [[Phasor::ZERO; L]; R];
        for point in 0..M::POINTS {
            let turn = turn::<T>(point, M::POINTS);
            add_rest(model, &motion_at(motion, &M::MOTION, turn, w), inputs, theta, turn, w, &mut rest);
        }
        rest
    }
}

/// Adds what the rows leave at a point of the period to its harmonics.
fn add_rest<T: Real, M, const U: usize, const R: usize, const P: usize, const S: usize, const L: usize>(
    model: &M,
    motion: &[T; S],
    inputs: &[[Phasor<T>; L]; U],
    theta: &[T; P],
    turn: Phasor<T>,
    w: T,
    rest: &mut [[Phasor<T>; L]; R],
) where
    M: RunModel<T, U, R, P, S>,
{
    let (mut phi, mut known, mut map) = ([[T::ZERO; P]; R], [T::ZERO; R], [[T::ZERO; U]; R]);
    model.rows(motion, &mut phi, &mut known, &mut map);
    for row in 0..R {
        let mut left = -known[row];
        for (b, lines) in map[row].iter().zip(inputs) {
            left += *b * value_at(lines, 0, turn, w);
        }
        for (entry, theta) in phi[row].iter().zip(theta) {
            left -= *entry * *theta;
        }
        add_harmonics(&mut rest[row], left / T::from_f64(M::POINTS as f64), turn);
    }
}

/// `e^{j phase}` at a point of a period.
fn turn<T: Real>(point: usize, points: usize) -> Phasor<T> {
    Phasor::turn(T::from_f64(2.0 * core::f64::consts::PI * point as f64 / points as f64))
}

/// A signal of harmonics, or a derivative of it, at a point of the period.
fn value_at<T: Real, const L: usize>(lines: &[Phasor<T>; L], order: u32, turn: Phasor<T>, w: T) -> T {
    let mut turned = Phasor::ONE;
    let mut sum = T::ZERO;
    for (harmonic, line) in lines.iter().step_by(2).enumerate() {
        if harmonic > 0 || order == 0 {
            sum += (*line * turned * Phasor::derivative(w * T::from_f64(harmonic as f64), order)).re;
        }
        turned = turned * turn;
    }
    sum
}

/// The entries of the motion at a point of the period.
fn motion_at<T: Real, const Q: usize, const S: usize, const L: usize>(
    lines: &[[Phasor<T>; L]; Q],
    slots: &[(usize, u32); S],
    turn: Phasor<T>,
    w: T,
) -> [T; S] {
    let entry = |(coordinate, order): (usize, u32)| {
        lines.get(coordinate).map_or(T::ZERO, |lines| value_at(lines, order, turn, w))
    };
    slots.map(entry)
}

/// Adds a share of a mean to the harmonics of a signal.
fn add_harmonics<T: Real, const L: usize>(lines: &mut [Phasor<T>; L], value: T, turn: Phasor<T>) {
    let mut turned = Phasor::new(value, T::ZERO);
    for (harmonic, line) in lines.iter_mut().step_by(2).enumerate() {
        *line += if harmonic == 0 { turned } else { turned.times(T::from_f64(2.0)) };
        turned = turned * turn.conj();
    }
}

/// The step of a difference quotient by an entry of the motion.
fn step<T: Real, const L: usize>(lines: &[Phasor<T>; L], order: u32, w: T) -> T {
    let mut square = T::ZERO;
    for (harmonic, line) in lines.iter().step_by(2).enumerate() {
        square += (*line * Phasor::derivative(w * T::from_f64(harmonic as f64), order)).square();
    }
    let share = T::from_f64(DIFFERENCE_STEP);
    if square > T::ZERO { square.sqrt() * share } else { share }
}
