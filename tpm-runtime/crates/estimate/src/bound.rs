//! What a periodic steady state can tell of the parameters at best: the Cramer-Rao bound.
//!
//! The inputs are known. To first order the motion answers to a change of the parameters so that the rows stay as they are,
//! `J dq + Phi dtheta = 0`, with J the derivatives of the rows along the motion. Smooth rows are solved harmonic by harmonic
//! ([`Along::predicted`]).
//!
//! Rows with a jump, such as Coulomb friction, have no derivative where the motion passes the jump, and near rest the friction takes any
//! value between plus and minus its limit. There the bound leaves the equation out: an unknown force may act at that instant.
//! The other equations, `r = J n - Phi dtheta` with noise n of covariance C on the coordinates, hold the information
//! `Phi' (J C J')^-1 Phi`. Where nothing holds a position (no spring, a joint without gravity), dq has a drift over the whole
//! record besides its harmonics.
//!
//! Invariant: nothing but the noise and the motion decides which equations are left out. A row is left out at an instant when one
//! of its terms jumps within twice the distance by which the machine strays from the motion, or between that instant and the next.

use crate::along::Along;
use crate::error::EstimateError;
use std::f64::consts::PI;
use tpm_controller::model::{EvalError, Model};
use tpm_motion::trajectory::Trajectory;
use tpm_numerics::DMatrix;
use tpm_numerics::differences::FIVE_POINT;
use tpm_numerics::singular::Singular;
use tpm_numerics::{alarm, tolerance};

/// Least number of instants of a period at which rows with a jump are compared. Four times as many change the bound of a mass under
/// Coulomb friction by 8 %.
const LEAST_INSTANTS: usize = 201;
/// A term jumps when it departs from a straight line by more than this share of its root mean square: jumps do so by about one,
/// and smooth terms by the square of the noise's share of the motion.
const LEAST_BEND_OF_JUMP: f64 = 0.1;
/// Least step of the difference quotients as a share of a slot's root mean square, far above rounding.
const LEAST_DIFFERENCE_STEP: f64 = 1e-6;

/// The noise of a record over whole periods of a steady state.
#[derive(Clone, Copy, Debug)]
pub struct RecordNoise<'a> {
    /// Standard deviation of the white noise on the samples of every coordinate.
    pub deviations: &'a [f64],
    /// Number of samples.
    pub samples: usize,
    /// Number of periods.
    pub periods: usize,
    /// Root mean square of the distance between the machine's motion and the trajectory, in every slot of a motion. Only rows with a
    /// jump read it.
    pub stray: &'a [f64],
}

/// Square root of the information about the parameters in a record of a steady state along a trajectory: rows of unit variance,
/// whose Gram matrix is the inverse of the Cramer-Rao bound. Smooth rows are followed up to the harmonic `harmonics`.
///
/// `None` when there are not as many rows as coordinates, or when the rows do not determine the motion.
///
/// # Errors
/// [`EstimateError::Model`] when the model refuses an evaluation, [`EstimateError::NotFinite`] when a term is not finite.
pub fn information_root(
    model: &dyn Model<f64>,
    constants: &[f64],
    trajectory: &Trajectory,
    theta: &[f64],
    noise: RecordNoise<'_>,
    harmonics: usize,
) -> Result<Option<DMatrix<f64>>, EstimateError> {
    let dims = model.dims();
    if dims.rows != dims.coordinates {
        return Ok(None);
    }
    let jumps = has_jumps(model, constants, trajectory)?;
    if !jumps {
        let along = Along::new(model, constants, trajectory, harmonics)?;
        if let Some(root) = along.predicted(theta, noise.deviations, noise.samples) {
            return Ok(Some(root));
        }
    }
    let resolved = 2 * harmonics + 1;
    let count = if jumps { resolved.max(LEAST_INSTANTS) } else { resolved };
    let mut rows = Instants::new(model, constants, trajectory, noise.stray, count)?;
    if !jumps {
        // Instants this far apart make a bend look like a jump.
        rows.left_out.fill(false);
    }
    Ok(rows.information_root(model, constants, theta, noise)?)
}

/// Whether a term of the rows jumps along a trajectory.
///
/// # Errors
/// [`EvalError`] when the model refuses an evaluation.
pub fn has_jumps(model: &dyn Model<f64>, constants: &[f64], trajectory: &Trajectory) -> Result<bool, EvalError> {
    let instants = LEAST_INSTANTS.max(8 * trajectory.highest_harmonic() as usize + 1);
    let stray = vec![0.0; model.dims().motion_len()];
    Ok(Instants::new(model, constants, trajectory, &stray, instants)?.left_out.contains(&true))
}

/// The rows at equally spaced instants of a period.
struct Instants {
    /// Number of instants, odd, so that every harmonic of their values has a derivative.
    count: usize,
    frequency: f64,
    /// (coordinate, derivative) of every slot that the rows read.
    slots: Vec<(usize, usize)>,
    /// Motions, one after the other.
    motions: Vec<f64>,
    /// `[slot][instant]`: the distance to both sides within which a row without a jump counts as smooth.
    reach: Vec<Vec<f64>>,
    /// `[row * count + instant]`: whether the row jumps there.
    left_out: Vec<bool>,
}

/// The entries of the regressor matrix and, behind them in every row, the known term.
struct Terms<'m> {
    model: &'m dyn Model<f64>,
    constants: &'m [f64],
    scratch: Vec<f64>,
    phi: Vec<f64>,
    known: Vec<f64>,
}

impl<'m> Terms<'m> {
    fn new(model: &'m dyn Model<f64>, constants: &'m [f64]) -> Self {
        let dims = model.dims();
        let zeros = |count| vec![0.0; count];
        let (scratch, phi, known) = (zeros(model.workspace_len()), zeros(dims.regressor_len()), zeros(dims.rows));
        Terms { model, constants, scratch, phi, known }
    }

    /// Adds the weighted terms at a motion to `sum`, rows x (parameters + 1).
    fn add(&mut self, motion: &[f64], weight: f64, sum: &mut [f64]) -> Result<(), EvalError> {
        self.model.regressor(motion, self.constants, &mut self.scratch, &mut self.phi)?;
        self.model.known(motion, self.constants, &mut self.scratch, &mut self.known)?;
        let parameters = self.model.dims().parameters;
        for (row, known) in self.known.iter().enumerate() {
            let sum = &mut sum[row * (parameters + 1)..(row + 1) * (parameters + 1)];
            let own = &self.phi[row * parameters..(row + 1) * parameters];
            for (slot, value) in sum.iter_mut().zip(own.iter().chain([known])) {
                *slot += weight * value;
            }
        }
        Ok(())
    }
}

impl Instants {
    fn new(
        model: &dyn Model<f64>,
        constants: &[f64],
        trajectory: &Trajectory,
        stray: &[f64],
        instants: usize,
    ) -> Result<Self, EvalError> {
        let dims = model.dims();
        let (count, width, length) = (instants | 1, dims.parameters + 1, dims.motion_len());
        let mut motions = vec![0.0; count * length];
        for (i, motion) in motions.chunks_exact_mut(length).enumerate() {
            trajectory.motion_at(i, count, 0.0, motion);
        }
        let slots: Vec<(usize, usize)> =
            (0..dims.coordinates).flat_map(|c| (0..=model.coordinate_order(c)).map(move |d| (c, d))).collect();
        let mut reach = Vec::with_capacity(slots.len());
        for &(c, d) in &slots {
            let slot = d * dims.coordinates + c;
            let at = |i: usize| motions[(i % count) * length + slot];
            let size = ((0..count).map(|i| at(i) * at(i)).sum::<f64>() / count as f64).sqrt();
            let least = if size > 0.0 { LEAST_DIFFERENCE_STEP * size } else { LEAST_DIFFERENCE_STEP };
            let strayed = alarm::MOTION_STRAYS * stray[slot];
            let next = |i: usize| (at(i + 1) - at(i)).abs().max((at(i) - at(i + count - 1)).abs());
            reach.push((0..count).map(|i| least.max(strayed).max(next(i))).collect::<Vec<f64>>());
        }
        let mut terms = Terms::new(model, constants);
        let mut squares = vec![0.0; dims.rows * width];
        let mut now = vec![0.0; dims.rows * width];
        for motion in motions.chunks_exact(length) {
            now.fill(0.0);
            terms.add(motion, 1.0, &mut now)?;
            for (square, value) in squares.iter_mut().zip(&now) {
                *square += value * value / count as f64;
            }
        }
        let mut left_out = vec![false; dims.rows * count];
        let mut moved = vec![0.0; length];
        for (&(c, d), reach) in slots.iter().zip(&reach) {
            // Rows are affine in the highest derivatives.
            if d == model.coordinate_order(c) {
                continue;
            }
            for (i, motion) in motions.chunks_exact(length).enumerate() {
                moved.copy_from_slice(motion);
                now.fill(0.0);
                // The change over the whole distance less twice the change over half of it: nothing for a straight line.
                for (shift, weight) in [(1.0, 1.0), (-1.0, -1.0), (0.5, -2.0), (-0.5, 2.0)] {
                    let slot = d * dims.coordinates + c;
                    moved[slot] = motion[slot] + shift * reach[i];
                    terms.add(&moved, weight, &mut now)?;
                }
                for (row, (bent, squares)) in now.chunks_exact(width).zip(squares.chunks_exact(width)).enumerate() {
                    let jumps =
                        |(bent, square): (&f64, &f64)| bent.abs() > LEAST_BEND_OF_JUMP * square.sqrt() && *square > 0.0;
                    left_out[row * count + i] |= bent.iter().zip(squares).any(jumps);
                }
            }
        }
        Ok(Instants { count, frequency: trajectory.frequency, slots, motions, reach, left_out })
    }

    /// Derivatives of the rows at their parameters with respect to every slot, `[slot][row * count + instant]`.
    fn gains(&self, terms: &mut Terms<'_>, theta: &[f64]) -> Result<Vec<Vec<f64>>, EvalError> {
        let dims = terms.model.dims();
        let (width, length) = (dims.parameters + 1, dims.motion_len());
        let (mut now, mut here, mut moved) =
            (vec![0.0; dims.rows * width], vec![0.0; dims.rows * width], vec![0.0; length]);
        let mut gains = vec![vec![0.0; dims.rows * self.count]; self.slots.len()];
        for ((&(c, d), reach), gains) in self.slots.iter().zip(&self.reach).zip(&mut gains) {
            let slot = d * dims.coordinates + c;
            for (i, motion) in self.motions.chunks_exact(length).enumerate() {
                moved.copy_from_slice(motion);
                now.fill(0.0);
                here.fill(0.0);
                terms.add(motion, 1.0, &mut here)?;
                // The quotient reaches as far as the row is smooth.
                let step = 0.5 * reach[i];
                for (shift, weight) in FIVE_POINT {
                    moved[slot] = motion[slot] + shift * step;
                    terms.add(&moved, weight / (12.0 * step), &mut now)?;
                }
                for (row, (own, here)) in now.chunks_exact(width).zip(here.chunks_exact(width)).enumerate() {
                    let factors = || theta.iter().chain(&[1.0]);
                    let gain: f64 = own.iter().zip(factors()).map(|(rate, factor)| rate * factor).sum();
                    let size: f64 = here.iter().zip(factors()).map(|(value, factor)| (value * factor).abs()).sum();
                    // What rounding leaves of a slot that the row does not depend on must not hold a position.
                    if (gain * step).abs() > tolerance::PIVOT * size {
                        gains[row * self.count + i] = gain;
                    }
                }
            }
        }
        Ok(gains)
    }

    /// The information in the rows that are not left out; `None` when these rows depend on each other.
    fn information_root(
        &self,
        model: &dyn Model<f64>,
        constants: &[f64],
        theta: &[f64],
        noise: RecordNoise<'_>,
    ) -> Result<Option<DMatrix<f64>>, EvalError> {
        let dims = model.dims();
        let (count, n, width) = (self.count, dims.coordinates, dims.parameters + 1);
        let kept: Vec<(usize, usize)> = (0..dims.rows)
            .flat_map(|row| (0..count).map(move |i| (row, i)))
            .filter(|(row, i)| !self.left_out[row * count + i])
            .collect();
        if kept.is_empty() {
            return Ok(None);
        }
        let mut terms = Terms::new(model, constants);
        let mut felt: DMatrix<f64> = DMatrix::zeros(kept.len(), dims.parameters);
        let mut now = vec![0.0; dims.rows * width];
        for (at, &(row, i)) in kept.iter().enumerate() {
            now.fill(0.0);
            terms.add(&self.motions[i * dims.motion_len()..(i + 1) * dims.motion_len()], 1.0, &mut now)?;
            for j in 0..dims.parameters {
                felt[(at, j)] = now[row * width + j];
            }
        }
        let gains = self.gains(&mut terms, theta)?;
        // Rows by a derivative of every coordinate, at noise of variance one.
        let by = |derivative: usize| {
            let mut matrix = DMatrix::zeros(kept.len(), n);
            for (&(c, _), gains) in self.slots.iter().zip(&gains).filter(|(slot, _)| slot.1 == derivative) {
                for (at, (row, i)) in kept.iter().enumerate() {
                    matrix[(at, c)] = gains[row * count + i] * noise.deviations[c];
                }
            }
            matrix
        };
        // Where nothing holds the position, a changed parameter lets the motion drift away at a constant rate, and where nothing
        // damps it either, at a constant acceleration. Over the record, the time has the variance duration^2/12, and what of half
        // its square is no straight line has the variance duration^4/720.
        let free = Singular::new(&by(0), tolerance::PIVOT).null();
        let duration = noise.periods as f64 * 2.0 * PI / self.frequency;
        let instants = (count as f64).sqrt();
        let rate = by(1) * &free * (12.0_f64.sqrt() / (duration * instants));
        let acceleration = by(2) * &free * (720.0_f64.sqrt() / (duration.powi(2) * instants));
        // Transposed: a column for every row that is kept.
        let mut response: DMatrix<f64> = DMatrix::zeros(n * count + 2 * free.ncols(), kept.len());
        let order = self.slots.iter().map(|slot| slot.1).max().unwrap_or(0);
        let kernels: Vec<Vec<f64>> = (0..=order).map(|d| differentiation(d, count, self.frequency)).collect();
        for (at, &(row, i)) in kept.iter().enumerate() {
            for (&(c, d), gains) in self.slots.iter().zip(&gains) {
                let gain = gains[row * count + i] * noise.deviations[c];
                for other in 0..count {
                    response[(c * count + other, at)] += gain * kernels[d][(i + count - other) % count];
                }
            }
        }
        response.rows_mut(n * count, free.ncols()).copy_from(&rate.transpose());
        let mut factor = triangle(response.clone());
        if factor.is_none() && free.ncols() > 0 {
            response.rows_mut(n * count + free.ncols(), free.ncols()).copy_from(&acceleration.transpose());
            factor = triangle(response);
        }
        let Some(factor) = factor else { return Ok(None) };
        // The average over the periods has the noise of all samples, spread over the instants.
        let share = (noise.samples as f64 / count as f64).sqrt();
        let root = factor.transpose().solve_lower_triangular(&felt).map(|root| root * share);
        Ok(root.filter(|root| root.iter().all(|value| value.is_finite())))
    }
}

/// The triangular factor of a matrix; `None` when its columns depend on each other.
fn triangle(matrix: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let columns = matrix.ncols();
    let factor = matrix.qr().unpack_r();
    let sizes: Vec<f64> = (0..columns.min(factor.nrows())).map(|i| factor[(i, i)].abs()).collect();
    let largest = sizes.iter().copied().fold(0.0, f64::max);
    let independent = sizes.len() == columns && sizes.iter().all(|size| *size > tolerance::PIVOT * largest);
    independent.then_some(factor)
}

/// The derivative of the trigonometric polynomial through values at `count` instants (odd) of a period, at the instant that lies `m`
/// after a value of one.
fn differentiation(order: usize, count: usize, frequency: f64) -> Vec<f64> {
    let turn = |m: usize, k: usize| 2.0 * PI * ((m * k) % count) as f64 / count as f64;
    let entry = |m: usize| {
        let harmonic = |k: usize| {
            let rate = (k as f64 * frequency).powi(order as i32);
            2.0 * rate * (turn(m, k) + 0.5 * PI * order as f64).cos()
        };
        let mean = if order == 0 { 1.0 } else { 0.0 };
        (mean + (1..=count / 2).map(harmonic).sum::<f64>()) / count as f64
    };
    (0..count).map(entry).collect()
}
