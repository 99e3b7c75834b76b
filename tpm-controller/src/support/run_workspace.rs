//! The rows of a model along the measured motion of one run, in memory of fixed size: harmonics of the regressor, of the known terms and
//! of the applied inputs, and lines of the rows' derivatives.
//!
//! Invariants: nothing allocates, and every loop has a length that the model fixes. Harmonic k stands in the place of line 2 k
//! ([`RunLines`](super::RunLines)).

use super::{Phasor, Real, RunFault, RunLines, RunSampling, Solution, SquareRoot};

/// Step of difference quotients as a share of a motion's root mean square.
const DIFFERENCE_STEP: f64 = 1e-2;
/// Harmonics of a derivative below this share of its largest one do not mix lines of noise.
const LEAST_MIXING: f64 = 1e-3;

/// The rows of a model: U inputs, R rows, P parameters, S entries of a motion.
pub trait RunModel<T: Real, const U: usize, const R: usize, const P: usize, const S: usize> {
    /// The coordinate of every entry of a motion.
    const COORDINATES: [usize; S];
    /// The order of the derivative that it is.
    const ORDERS: [u32; S];
    /// Points of a period at which the rows are evaluated.
    const POINTS: usize;

    /// The regressor, the known terms and the input map at a motion. Entries that are zero at every motion may be left out: all are zero
    /// before the call.
    fn rows(&self, motion: &[T; S], regressor: &mut [[T; P]; R], known: &mut [T; R], map: &mut [[T; U]; R]);
}

/// The memory of an update: U inputs, Q coordinates, R rows, P parameters, S entries of a motion, L lines, `E = R (L - 1)` equations at all
/// harmonics, and `K = E (E + 1) / 2` covariances of them.
#[derive(Clone, Copy, Debug)]
pub struct RunWorkspace<
    T,
    const U: usize,
    const Q: usize,
    const R: usize,
    const P: usize,
    const S: usize,
    const L: usize,
    const E: usize,
    const K: usize,
> {
    /// Angular frequency of the run, rad/s.
    pub(super) w: T,
    /// Lines of the measured coordinates, and of the inputs as they were applied.
    pub(super) motion: [[Phasor<T>; L]; Q],
    pub(super) inputs: [[Phasor<T>; L]; U],
    /// Harmonics of the motion along which the rows are evaluated, in the places of even lines: the measured one, or the reference.
    pub(super) path: [[Phasor<T>; L]; Q],
    /// Harmonics of what the tracking error makes of the rows where the reference is the path, and of what the rows leave along the
    /// measured motion.
    pub(super) response: [[Phasor<T>; L]; R],
    pub(super) whole: [[Phasor<T>; L]; R],
    /// Harmonics of Phi, in the places of even lines.
    pub(super) regressor: [[[Phasor<T>; L]; P]; R],
    /// Harmonics of the known terms, in the places of even lines.
    pub(super) known: [[Phasor<T>; L]; R],
    /// Lines of B u, and the mean of B.
    pub(super) drive: [[Phasor<T>; L]; R],
    pub(super) map: [[T; U]; R],
    /// Harmonics of what the rows leave at the present parameters, in the places of even lines.
    pub(super) rest: [[Phasor<T>; L]; R],
    /// Lines of the rows' derivatives by every entry of the motion, in the places of harmonics: entry m is harmonic m.
    pub(super) gains: [[[Phasor<T>; L]; S]; R],
    /// The highest harmonic of the derivatives that mixes lines of noise.
    pub(super) reach: i32,
    /// What a unit of noise in a coordinate makes of the variance of a row, line by line, and the square of what noise leaves there.
    pub(super) felt: [[[T; Q]; L]; R],
    pub(super) left: [[T; L]; R],
    /// Mean squares of the derivatives of every entry of the regressor by every entry of the motion.
    pub(super) slopes: [[[T; S]; P]; R],
    /// Whether a column of the regressor stands out of what noise makes of it.
    pub(super) stands: [bool; P],
    /// Variance of a line of every coordinate's sensor, and of the force on every row.
    pub(super) sensors: [T; Q],
    pub(super) forces: [T; R],
    /// Whether a force disturbs the rows, beside what the sensors' noise makes of them.
    pub(super) disturbed: bool,
    /// Whether it is known what motion that noise makes adds to the means of the rows, and how far it is uncertain, as a share of it.
    pub(super) shifts: bool,
    pub(super) doubt: T,
    /// The covariance of that motion, what it adds to the means of the regressor, and takes of what the rows leave.
    pub(super) covariance: [[T; S]; S],
    pub(super) shift: [[T; P]; R],
    pub(super) shifted: [T; R],
    /// Harmonic, row and part (real, imaginary) of the equations that count, their coefficients and right sides, and how many there are.
    pub(super) places: [[u16; 3]; E],
    pub(super) rows: [[T; P]; E],
    pub(super) right: [T; E],
    pub(super) count: usize,
    /// What noise is multiplied by in every equation.
    pub(super) by: [[T; 2]; E],
    /// Their covariance, then its Cholesky factor: the lower triangle, row by row.
    pub(super) noise: [T; K],
    /// The parameters to begin with, those of the present pass, and those from which its steps count.
    pub(super) prior: [T; P],
    pub(super) theta: [T; P],
    pub(super) about: [T; P],
    /// The equations for the step, and their solution.
    pub(super) factor: SquareRoot<T, P>,
    pub(super) found: Solution<T, P>,
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
> Default for RunWorkspace<T, U, Q, R, P, S, L, E, K>
{
    fn default() -> Self {
        Self {
            w: T::ZERO,
            motion: [[Phasor::zero(); L]; Q],
            inputs: [[Phasor::zero(); L]; U],
            path: [[Phasor::zero(); L]; Q],
            response: [[Phasor::zero(); L]; R],
            whole: [[Phasor::zero(); L]; R],
            regressor: [[[Phasor::zero(); L]; P]; R],
            known: [[Phasor::zero(); L]; R],
            drive: [[Phasor::zero(); L]; R],
            map: [[T::ZERO; U]; R],
            rest: [[Phasor::zero(); L]; R],
            gains: [[[Phasor::zero(); L]; S]; R],
            reach: 0,
            felt: [[[T::ZERO; Q]; L]; R],
            left: [[T::ZERO; L]; R],
            slopes: [[[T::ZERO; S]; P]; R],
            stands: [false; P],
            sensors: [T::ZERO; Q],
            forces: [T::ZERO; R],
            disturbed: false,
            shifts: false,
            doubt: T::ZERO,
            covariance: [[T::ZERO; S]; S],
            shift: [[T::ZERO; P]; R],
            shifted: [T::ZERO; R],
            places: [[0; 3]; E],
            rows: [[T::ZERO; P]; E],
            right: [T::ZERO; E],
            count: 0,
            by: [[T::ZERO; 2]; E],
            noise: [T::ZERO; K],
            prior: [T::ZERO; P],
            theta: [T::ZERO; P],
            about: [T::ZERO; P],
            factor: SquareRoot::default(),
            found: Solution::default(),
        }
    }
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
    /// Takes the lines of a run: those of the coordinates as they are, the inputs as they were applied.
    ///
    /// # Errors
    /// The fault of the run; [`RunFault::Equations`] when its frequency or a prior is not finite.
    pub(super) fn take<const C: usize>(
        &mut self,
        run: &RunLines<T, C, L>,
        sampling: &RunSampling<T>,
    ) -> Result<(), RunFault> {
        run.finished()?;
        let period = T::from_f64(f64::from(run.samples_per_period)) * sampling.sample_time;
        self.w = T::from_f64(2.0) * T::PI / period;
        if self.w <= T::ZERO || !self.w.is_finite() {
            return Err(RunFault::Equations);
        }
        for column in 0..P {
            if !self.prior[column].is_finite() {
                return Err(RunFault::Equations);
            }
        }
        for line in 0..L {
            for coordinate in 0..Q {
                self.motion[coordinate][line] = run.line(coordinate, line);
            }
            let frequency = self.w * (T::from_f64(line as f64) / T::from_f64(2.0));
            let half = frequency * sampling.sample_time / T::from_f64(2.0);
            let held = sampling.held && half > T::ZERO;
            let size = if held { half.sin() / half } else { T::ONE };
            let turned = frequency * sampling.delay + if held { half } else { T::ZERO };
            let applied = Phasor::turn(-turned).times(size);
            for input in 0..U {
                self.inputs[input][line] = run.line(Q + input, line) * applied;
            }
        }
        self.theta = self.prior;
        self.sensors = [T::ZERO; Q];
        self.forget_shift();
        Ok(())
    }

    /// Harmonics of the regressor, the known terms and B u along the path, and halfway lines of B u by the mean of B.
    ///
    /// # Errors
    /// [`RunFault::Equations`] when a row is not finite.
    pub(super) fn evaluate<M: RunModel<T, U, R, P, S>>(&mut self, model: &M) -> Result<(), RunFault> {
        self.regressor = [[[Phasor::zero(); L]; P]; R];
        self.known = [[Phasor::zero(); L]; R];
        self.drive = [[Phasor::zero(); L]; R];
        self.map = [[T::ZERO; U]; R];
        let mean = T::ONE / T::from_f64(M::POINTS as f64);
        for point in 0..M::POINTS {
            let turn = turn_at(model, point);
            let mut motion = [T::ZERO; S];
            motion_at(model, &self.path, turn, self.w, &mut motion);
            let mut phi = [[T::ZERO; P]; R];
            let mut known = [T::ZERO; R];
            let mut map = [[T::ZERO; U]; R];
            model.rows(&motion, &mut phi, &mut known, &mut map);
            let mut forces = [T::ZERO; U];
            for input in 0..U {
                forces[input] = value_at(&self.inputs[input], 0, turn, self.w);
            }
            for row in 0..R {
                let mut drive = T::ZERO;
                for input in 0..U {
                    drive += map[row][input] * forces[input];
                    self.map[row][input] += map[row][input] * mean;
                }
                if !drive.is_finite() || !known[row].is_finite() {
                    return Err(RunFault::Equations);
                }
                for column in 0..P {
                    if !phi[row][column].is_finite() {
                        return Err(RunFault::Equations);
                    }
                    add_harmonics(&mut self.regressor[row][column], phi[row][column] * mean, turn);
                }
                add_harmonics(&mut self.known[row], known[row] * mean, turn);
                add_harmonics(&mut self.drive[row], drive * mean, turn);
            }
        }
        for row in 0..R {
            for input in 0..U {
                for line in (1..L).step_by(2) {
                    self.drive[row][line] += self.inputs[input][line].times(self.map[row][input]);
                }
            }
        }
        Ok(())
    }

    /// Lines of the rows' derivatives along the path at the present parameters, and harmonics of what the rows leave there: taken before
    /// the harmonics it is small, and rounding with it.
    pub(super) fn differentiate<M: RunModel<T, U, R, P, S>>(&mut self, model: &M) {
        self.gains = [[[Phasor::zero(); L]; S]; R];
        self.slopes = [[[T::ZERO; S]; P]; R];
        self.rest = [[Phasor::zero(); L]; R];
        let mean = T::ONE / T::from_f64(M::POINTS as f64);
        let mut steps = [T::ZERO; S];
        self.steps(model, &mut steps);
        for point in 0..M::POINTS {
            let turn = turn_at(model, point);
            let mut motion = [T::ZERO; S];
            motion_at(model, &self.path, turn, self.w, &mut motion);
            self.add_rest(model, &motion, turn, false);
            for entry in 0..S {
                let both = steps[entry] + steps[entry];
                let centre = motion[entry];
                let mut up = [[T::ZERO; P]; R];
                let mut up_known = [T::ZERO; R];
                let mut map = [[T::ZERO; U]; R];
                motion[entry] = centre + steps[entry];
                model.rows(&motion, &mut up, &mut up_known, &mut map);
                let mut down = [[T::ZERO; P]; R];
                let mut down_known = [T::ZERO; R];
                motion[entry] = centre - steps[entry];
                model.rows(&motion, &mut down, &mut down_known, &mut map);
                motion[entry] = centre;
                for row in 0..R {
                    let mut slope = (up_known[row] - down_known[row]) / both;
                    for column in 0..P {
                        let own = (up[row][column] - down[row][column]) / both;
                        slope += own * self.theta[column];
                        self.slopes[row][column][entry] += own * own * mean;
                    }
                    let mut turned = Phasor::new(slope * mean, T::ZERO);
                    for line in 0..L {
                        self.gains[row][entry][line] += turned;
                        turned = turned * turn.conj();
                    }
                }
            }
        }
        self.find_reach();
    }

    /// Harmonics of the derivatives that mix the lines of noise: those that are a part of the largest one of their entry.
    fn find_reach(&mut self) {
        self.reach = 0;
        for row in 0..R {
            for entry in 0..S {
                let mut peak = T::ZERO;
                for line in 0..L {
                    peak = peak.max(self.gains[row][entry][line].square());
                }
                for line in 1..L {
                    if self.gains[row][entry][line].square() > T::from_f64(LEAST_MIXING * LEAST_MIXING) * peak {
                        self.reach = self.reach.max(line as i32);
                    }
                }
            }
        }
    }

    /// Steps of difference quotients by the entries of the motion.
    pub(super) fn steps<M: RunModel<T, U, R, P, S>>(&self, model: &M, steps: &mut [T; S]) {
        let _ = model;
        for entry in 0..S {
            let mut square = T::ZERO;
            for line in (0..L).step_by(2) {
                let harmonic = line / 2;
                let derivative = Phasor::derivative(self.w * T::from_f64(harmonic as f64), M::ORDERS[entry]);
                square += (self.path[M::COORDINATES[entry]][line] * derivative).square();
            }
            let share = T::from_f64(DIFFERENCE_STEP);
            steps[entry] = if square > T::ZERO { square.sqrt() * share } else { share };
        }
    }

    /// Adds what the rows leave at a point of the period to its harmonics: along the path, or along the whole measured motion.
    pub(super) fn add_rest<M: RunModel<T, U, R, P, S>>(
        &mut self,
        model: &M,
        motion: &[T; S],
        turn: Phasor<T>,
        whole: bool,
    ) {
        let mut phi = [[T::ZERO; P]; R];
        let mut known = [T::ZERO; R];
        let mut map = [[T::ZERO; U]; R];
        model.rows(motion, &mut phi, &mut known, &mut map);
        let mut forces = [T::ZERO; U];
        for input in 0..U {
            forces[input] = value_at(&self.inputs[input], 0, turn, self.w);
        }
        for row in 0..R {
            let mut left = -known[row];
            for input in 0..U {
                left += map[row][input] * forces[input];
            }
            for column in 0..P {
                left -= phi[row][column] * self.theta[column];
            }
            left /= T::from_f64(M::POINTS as f64);
            if whole {
                add_harmonics(&mut self.whole[row], left, turn);
            } else {
                add_harmonics(&mut self.rest[row], left, turn);
            }
        }
    }
}

/// `e^{j phase}` at a point of a period.
pub(super) fn turn_at<
    T: Real,
    M: RunModel<T, U, R, P, S>,
    const U: usize,
    const R: usize,
    const P: usize,
    const S: usize,
>(
    model: &M,
    point: usize,
) -> Phasor<T> {
    let _ = model;
    Phasor::turn(T::from_f64(2.0 * core::f64::consts::PI * point as f64 / M::POINTS as f64))
}

/// A signal of harmonics, or a derivative of it, at a point of the period.
fn value_at<T: Real, const L: usize>(lines: &[Phasor<T>; L], order: u32, turn: Phasor<T>, w: T) -> T {
    let mut turned = Phasor::new(T::ONE, T::ZERO);
    let mut sum = T::ZERO;
    for harmonic in 0..L / 2 {
        if harmonic > 0 || order == 0 {
            let derivative = Phasor::derivative(w * T::from_f64(harmonic as f64), order);
            sum += (lines[2 * harmonic] * turned * derivative).re;
        }
        turned = turned * turn;
    }
    sum
}

/// The entries of a motion at a point of the period.
pub(super) fn motion_at<
    T: Real,
    M: RunModel<T, U, R, P, S>,
    const U: usize,
    const Q: usize,
    const R: usize,
    const P: usize,
    const S: usize,
    const L: usize,
>(
    model: &M,
    lines: &[[Phasor<T>; L]; Q],
    turn: Phasor<T>,
    w: T,
    motion: &mut [T; S],
) {
    let _ = model;
    for entry in 0..S {
        motion[entry] = value_at(&lines[M::COORDINATES[entry]], M::ORDERS[entry], turn, w);
    }
}

/// Adds a share of a mean to the harmonics of a signal.
fn add_harmonics<T: Real, const L: usize>(lines: &mut [Phasor<T>; L], value: T, turn: Phasor<T>) {
    let mut turned = Phasor::new(value, T::ZERO);
    for harmonic in 0..L / 2 {
        lines[2 * harmonic] += if harmonic == 0 { turned } else { turned.times(T::from_f64(2.0)) };
        turned = turned * turn.conj();
    }
}
