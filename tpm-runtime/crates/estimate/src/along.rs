//! A model's rows along a prescribed motion: harmonics of the regressors and derivatives with respect to the motion.
//!
//! Invariant: `phi` and `known` are one-sided phasors of one period, from the exact table (B Lambda) or sampled, and sampled ones
//! are exact to rounding when the regressors are finite Fourier series that the grid resolves. `jacobian` holds d(row)/d(slot)
//! at every point of that grid, column by column, so that it is linear in the parameters and need not be formed again when
//! they change.

use crate::error::EstimateError;
use crate::information::Information;
use crate::table::{LineTable, RowLines};
use num_complex::Complex;
use tpm_controller::model::{Dims, Model};
use tpm_motion::Trial;
use tpm_motion::trajectory::Trajectory;
use tpm_numerics::DMatrix;
use tpm_numerics::differences::FIVE_POINT;
use tpm_numerics::fourier::{analyse, synthesise, two_sided};
use tpm_numerics::{Doubling, tolerance};

/// Points of a period at which the rows are evaluated: doubled until no harmonic changes by more than a share of the largest.
const GRID: Doubling = Doubling { least: 256, most: 8192, settled: 1e-12 };
/// Step of the difference quotients as a share of a slot's own amplitude: with five points exact for terms up to the
/// fourth degree, and otherwise good to `DIFFERENCE_STEP^4`.
const DIFFERENCE_STEP: f64 = 1e-2;

/// The rows of a model along a reference.
#[derive(Clone, Debug)]
pub struct Along {
    pub(super) dims: Dims,
    pub(super) frequency: f64,
    /// Lines of the regressors, per row and parameter.
    pub(super) phi: Vec<Vec<Complex<f64>>>,
    /// Lines of the known terms, per row.
    pub(super) known: Vec<Vec<Complex<f64>>>,
    /// Mean of B over the period, rows x inputs.
    pub(super) map: Vec<f64>,
    /// (coordinate, derivative) of every slot that the rows read.
    slots: Vec<(usize, usize)>,
    points: usize,
    /// `[slot][(row * (parameters + 1) + j) * points + i]`; j = parameters is the known term.
    jacobian: Vec<Vec<f64>>,
    /// `[slot][row * (parameters + 1) + j]`: sums of the Jacobian over the points of the period.
    sums: Vec<Vec<f64>>,
}

impl Along {
    /// Samples the rows along a trajectory, harmonics 0 to `harmonics`.
    ///
    /// # Errors
    /// [`EstimateError::Model`] when the model refuses an evaluation, [`EstimateError::NotFinite`] when a term is not finite.
    pub fn new(
        model: &dyn Model<f64>,
        constants: &[f64],
        trajectory: &Trajectory,
        harmonics: usize,
    ) -> Result<Self, EstimateError> {
        let least = (4 * (harmonics + 1)).max(8 * trajectory.highest_harmonic() as usize);
        let mut points = GRID.clamp(least.next_power_of_two());
        loop {
            let sampled = Sampled::new(model, constants, trajectory, points)?;
            let (phi, known) = sampled.lines(model.dims(), 1, harmonics);
            let (coarse, coarse_known) = sampled.lines(model.dims(), 2, harmonics);
            let settled = phi.iter().zip(&coarse).chain(known.iter().zip(&coarse_known)).all(|(fine, coarse)| {
                let peak = fine.iter().map(|z| z.norm()).fold(0.0, f64::max);
                fine.iter().zip(coarse).all(|(a, b)| (a - b).norm() <= GRID.settled * peak)
            });
            if settled || points >= GRID.most {
                return sampled.finish(model, constants, trajectory.frequency, phi, known);
            }
            points *= 2;
        }
    }

    /// Lines 0 to `harmonics` of the rows along a motion.
    ///
    /// # Errors
    /// [`EstimateError::Model`] when the model refuses an evaluation, [`EstimateError::NotFinite`] when a term is not finite.
    pub(super) fn lines(
        model: &dyn Model<f64>,
        constants: &[f64],
        trajectory: &Trajectory,
        harmonics: usize,
    ) -> Result<RowLines, EstimateError> {
        let least = (8 * (harmonics + 1)).max(8 * trajectory.highest_harmonic() as usize);
        let points = GRID.clamp(least.next_power_of_two());
        let (regressors, known) = Sampled::new(model, constants, trajectory, points)?.lines(model.dims(), 1, harmonics);
        Ok(RowLines { regressors, known })
    }

    /// What the reference alone shows of the parameters in `free`: every harmonic of every row with the same weight.
    ///
    /// # Errors
    /// [`EstimateError::Model`] when the model refuses an evaluation, [`EstimateError::NotFinite`] when a term is not finite.
    pub(super) fn design(
        model: &dyn Model<f64>,
        constants: &[f64],
        trajectory: &Trajectory,
        harmonics: usize,
        free: &[usize],
    ) -> Result<Information, EstimateError> {
        let dims = model.dims();
        let points = GRID.clamp((8 * (harmonics + 1)).next_power_of_two());
        let sampled = Sampled::new(model, constants, trajectory, points)?;
        let (phi, _) = sampled.lines(dims, 1, harmonics);
        // What equations show does not depend on their right-hand sides, which stay zero.
        let mut matrix = DMatrix::zeros(dims.rows * (2 * harmonics + 1), free.len() + 1);
        for row in 0..dims.rows {
            for (c, &j) in free.iter().enumerate() {
                for (k, line) in phi[row * dims.parameters + j].iter().enumerate() {
                    let at = row * (2 * harmonics + 1);
                    if k > 0 {
                        matrix[(at + 2 * k - 1, c)] = line.re;
                        matrix[(at + 2 * k, c)] = line.im;
                    } else {
                        matrix[(at, c)] = line.re;
                    }
                }
            }
        }
        Ok(Information::of(matrix))
    }

    /// Square root of the information about the parameters in `samples` samples over whole periods whose coordinates have
    /// white noise of these standard deviations, the inputs known: rows of unit variance. Its Gram matrix is the inverse of
    /// the Cramer-Rao bound of the steady state.
    ///
    /// With the inputs fixed, the motion answers to a change of the parameters by `-J^-1 Phi`, in which the periodic derivatives
    /// J couple the harmonics. `None` when there are not as many rows as coordinates, or J is singular.
    pub(super) fn predicted(&self, theta: &[f64], noise: &[f64], samples: usize) -> Option<DMatrix<f64>> {
        let Dims { rows, coordinates, parameters, .. } = self.dims;
        let highest = self.phi.first()?.len().checked_sub(1)?;
        if rows != coordinates {
            return None;
        }
        // Coordinate by coordinate: real parts of the lines from the mean on, then imaginary parts from harmonic 1 on.
        let width = 2 * highest + 1;
        let place = |c: usize, k: usize, imaginary: bool| c * width + if imaginary { highest + k } else { k };
        let parts = |lines: &[Complex<f64>]| -> Vec<f64> {
            lines.iter().map(|line| line.re).chain(lines[1..].iter().map(|line| line.im)).collect()
        };
        let factors: Vec<f64> = theta.iter().copied().chain([1.0]).collect();
        let mut derivative = DMatrix::zeros(rows * width, coordinates * width);
        let mut error = vec![vec![Complex::new(0.0, 0.0); highest + 1]; coordinates];
        for c in 0..coordinates {
            for k in 0..=highest {
                for imaginary in [false, true].into_iter().take(if k == 0 { 1 } else { 2 }) {
                    error[c][k] = if imaginary { Complex::new(0.0, 1.0) } else { Complex::new(1.0, 0.0) };
                    for row in 0..rows {
                        let lines = parts(&self.applied(row, &factors, &error, highest));
                        let mut column = derivative.column_mut(place(c, k, imaginary));
                        column.rows_mut(row * width, width).copy_from_slice(&lines);
                    }
                }
                error[c][k] = Complex::new(0.0, 0.0);
            }
        }
        let mut felt = DMatrix::zeros(rows * width, parameters);
        for row in 0..rows {
            for j in 0..parameters {
                felt.column_mut(j).rows_mut(row * width, width).copy_from_slice(&parts(self.regressor(row, j)));
            }
        }
        let factors = derivative.lu();
        let sizes = factors.u().diagonal().abs();
        if sizes.min() <= tolerance::PIVOT * sizes.max() {
            return None;
        }
        let mut answer = factors.solve(&felt)?;
        for (c, deviation) in noise.iter().enumerate().take(coordinates) {
            for (i, mut row) in answer.rows_mut(c * width, width).row_iter_mut().enumerate() {
                // A mean has the variance 1/N of the samples', a phasor's part 2/N.
                let share = if i == 0 { 1.0 } else { 2.0 };
                row *= (samples as f64 / share).sqrt() / deviation;
            }
        }
        answer.iter().all(|value| value.is_finite()).then_some(answer)
    }

    /// The rows along a trial's reference, harmonics 0 to `harmonics`: those of the exact table where there is one for it,
    /// sampled otherwise.
    ///
    /// # Errors
    /// [`EstimateError::Model`] when the model refuses an evaluation, [`EstimateError::NotFinite`] when a term is not finite.
    pub(super) fn of_trial(
        model: &dyn Model<f64>,
        trial: &Trial,
        harmonics: usize,
        table: Option<&dyn LineTable>,
    ) -> Result<Self, EstimateError> {
        let sampled = Along::new(model, &trial.constants, &trial.trajectory, harmonics)?;
        let exact = table.and_then(|t| t.lines(&trial.trajectory, &trial.amplitudes, &trial.constants, harmonics));
        Ok(match exact {
            Some(RowLines { regressors, known }) => Along { phi: regressors, known, ..sampled },
            None => sampled,
        })
    }

    /// Phasors of the known term of a row: one-sided, a_c - j a_s, from harmonic 0 on.
    #[must_use]
    pub fn known(&self, row: usize) -> &[Complex<f64>] {
        &self.known[row]
    }

    /// Phasors of a regressor: one-sided, a_c - j a_s, from harmonic 0 on.
    #[must_use]
    pub fn regressor(&self, row: usize, parameter: usize) -> &[Complex<f64>] {
        &self.phi[row * self.dims.parameters + parameter]
    }

    /// (coordinate, derivative) of every slot that the rows read.
    pub(super) fn slots(&self) -> &[(usize, usize)] {
        &self.slots
    }

    /// Two-sided Fourier coefficients of d(row)/d(slot) along the period from the mean on, per slot.
    pub(super) fn gains(&self, row: usize, theta: &[f64]) -> Lines {
        let width = self.dims.parameters + 1;
        let gain = |jacobian: &Vec<f64>| {
            let mut series = vec![0.0; self.points];
            for (j, factor) in theta.iter().copied().chain([1.0]).enumerate() {
                let at = (row * width + j) * self.points;
                for (sum, value) in series.iter_mut().zip(&jacobian[at..at + self.points]) {
                    *sum += factor * value;
                }
            }
            two_sided(&series)
        };
        self.jacobian.iter().map(gain).collect()
    }

    /// Response of a row to the coordinates' phasors at one harmonic, from the mean of the derivatives along the reference:
    /// the linear terms `k1 - m W^2 + ...`, and what even powers of the reference add to them.
    pub(super) fn response(&self, row: usize, theta: &[f64], harmonic: usize) -> Vec<Complex<f64>> {
        let turn = Complex::new(0.0, harmonic as f64 * self.frequency);
        let width = self.dims.parameters + 1;
        let mut response = vec![Complex::new(0.0, 0.0); self.dims.coordinates];
        for (&(c, d), sums) in self.slots.iter().zip(&self.sums) {
            let own = &sums[row * width..(row + 1) * width];
            let sum: f64 = theta.iter().chain(&[1.0]).zip(own).map(|(factor, sum)| factor * sum).sum();
            response[c] += turn.powu(d as u32) * (sum / self.points as f64);
        }
        response
    }

    /// Phasor at a harmonic of a row's response to an error, from the mean of the derivatives, for one parameter of value one
    /// alone; the column behind the parameters is the known term.
    pub(super) fn mean_applied(
        &self,
        row: usize,
        column: usize,
        harmonic: usize,
        error: &[Vec<Complex<f64>>],
    ) -> Complex<f64> {
        let turn = Complex::new(0.0, harmonic as f64 * self.frequency);
        let at = row * (self.dims.parameters + 1) + column;
        let parts = self.slots.iter().zip(&self.sums);
        parts.map(|(&(c, d), sums)| turn.powu(d as u32) * error[c][harmonic] * (sums[at] / self.points as f64)).sum()
    }

    /// Lines 0 to `harmonics` of `d(row)/d(motion) e` for an error given by its lines: the product with the band matrix of
    /// harmonic balance, without forming it. `factors` has the parameters and, last, the factor of the known term.
    pub(super) fn applied(
        &self,
        row: usize,
        factors: &[f64],
        error: &[Vec<Complex<f64>>],
        harmonics: usize,
    ) -> Vec<Complex<f64>> {
        let width = self.dims.parameters + 1;
        let mut product = vec![0.0; self.points];
        for (&(c, d), values) in self.slots.iter().zip(&self.jacobian) {
            let lines = &error[c];
            let wave = synthesise(lines, d, self.frequency, lines.len().saturating_sub(1), self.points);
            for (j, factor) in factors.iter().enumerate().filter(|(_, factor)| factor.abs() > 0.0) {
                let at = (row * width + j) * self.points;
                for ((sum, gain), e) in product.iter_mut().zip(&values[at..at + self.points]).zip(&wave) {
                    *sum += factor * gain * e;
                }
            }
        }
        analyse(&product, 0, 1, harmonics)
    }
}

struct Sampled {
    points: usize,
    motion: Vec<f64>,
    phi: Vec<f64>,
    known: Vec<f64>,
    map: Vec<f64>,
}

type Lines = Vec<Vec<Complex<f64>>>;

impl Sampled {
    fn new(
        model: &dyn Model<f64>,
        constants: &[f64],
        trajectory: &Trajectory,
        points: usize,
    ) -> Result<Self, EstimateError> {
        let dims = model.dims();
        let mut scratch = vec![0.0; model.workspace_len()];
        let mut sampled = Sampled {
            points,
            motion: vec![0.0; points * dims.motion_len()],
            phi: vec![0.0; points * dims.regressor_len()],
            known: vec![0.0; points * dims.rows],
            map: vec![0.0; dims.input_map_len()],
        };
        let mut map = vec![0.0; dims.input_map_len()];
        for i in 0..points {
            let motion = &mut sampled.motion[i * dims.motion_len()..(i + 1) * dims.motion_len()];
            trajectory.motion_at(i, points, 0.0, motion);
            let size = dims.regressor_len();
            model.regressor(motion, constants, &mut scratch, &mut sampled.phi[i * size..(i + 1) * size])?;
            let rows = dims.rows;
            model.known(motion, constants, &mut scratch, &mut sampled.known[i * rows..(i + 1) * rows])?;
            model.input_map(motion, constants, &mut scratch, &mut map)?;
            for (sum, value) in sampled.map.iter_mut().zip(&map) {
                *sum += value / points as f64;
            }
        }
        let rows = dims.rows.max(1);
        let not_finite =
            |row: usize, what: &str| EstimateError::NotFinite { row: model.row(row).name.into(), what: what.into() };
        if let Some(at) = sampled.phi.iter().position(|x| !x.is_finite()) {
            let entry = at % dims.regressor_len();
            return Err(not_finite(entry / dims.parameters, model.parameter(entry % dims.parameters).name));
        }
        if let Some(at) = sampled.known.iter().position(|x| !x.is_finite()) {
            return Err(not_finite(at % rows, "a term without an unknown parameter"));
        }
        Ok(sampled)
    }

    fn lines(&self, dims: Dims, stride: usize, harmonics: usize) -> (Lines, Lines) {
        let size = dims.regressor_len();
        let phi = (0..size).map(|e| analyse(&self.phi, e, size * stride, harmonics)).collect();
        let known = (0..dims.rows).map(|r| analyse(&self.known, r, dims.rows * stride, harmonics)).collect();
        (phi, known)
    }

    fn finish(
        self,
        model: &dyn Model<f64>,
        constants: &[f64],
        frequency: f64,
        phi: Lines,
        known: Lines,
    ) -> Result<Along, EstimateError> {
        let dims = model.dims();
        let slots: Vec<(usize, usize)> =
            (0..dims.coordinates).flat_map(|c| (0..=model.coordinate_order(c)).map(move |d| (c, d))).collect();
        let width = dims.parameters + 1;
        let mut scratch = vec![0.0; model.workspace_len()];
        let mut side_phi = vec![0.0; dims.regressor_len()];
        let mut side_known = vec![0.0; dims.rows];
        let mut now = vec![0.0; dims.motion_len()];
        let mut jacobian = Vec::with_capacity(slots.len());
        for &(c, d) in &slots {
            let slot = d * dims.coordinates + c;
            let power: f64 = self.motion.chunks_exact(dims.motion_len()).map(|m| m[slot] * m[slot]).sum();
            let amplitude = (power / self.points as f64).sqrt();
            let step = if amplitude > 0.0 { DIFFERENCE_STEP * amplitude } else { DIFFERENCE_STEP };
            let mut values = vec![0.0; dims.rows * width * self.points];
            for i in 0..self.points {
                now.copy_from_slice(&self.motion[i * dims.motion_len()..(i + 1) * dims.motion_len()]);
                let centre = now[slot];
                for (shift, weight) in FIVE_POINT {
                    now[slot] = centre + shift * step;
                    let weight = weight / (12.0 * step);
                    model.regressor(&now, constants, &mut scratch, &mut side_phi)?;
                    model.known(&now, constants, &mut scratch, &mut side_known)?;
                    for r in 0..dims.rows {
                        for j in 0..dims.parameters {
                            values[(r * width + j) * self.points + i] += weight * side_phi[r * dims.parameters + j];
                        }
                        values[(r * width + dims.parameters) * self.points + i] += weight * side_known[r];
                    }
                }
            }
            jacobian.push(values);
        }
        let of_slot = |values: &Vec<f64>| values.chunks_exact(self.points).map(|column| column.iter().sum()).collect();
        let sums = jacobian.iter().map(of_slot).collect();
        Ok(Along { dims, frequency, phi, known, map: self.map, slots, points: self.points, jacobian, sums })
    }
}

#[cfg(test)]
mod tests {
    use super::Along;
    use num_complex::Complex;
    use std::f64::consts::PI;
    use tpm_test_support::models::MassSpringDrag;
    use tpm_test_support::rest_to_rest_3;

    #[test]
    fn harmonics_along_the_pattern_are_those_of_the_table() {
        let (lambda, w) = (0.3, PI);
        let along = Along::new(&MassSpringDrag, &[], &rest_to_rest_3().trajectory(&[lambda], w), 12).expect("finite");
        // Feng, Eqn 3.26, with lambda^2 w^2 (5/9, -5/6, 1/3, -1/18) on harmonics 0, 2, 4, 6 of x'^2.
        let scale = lambda * lambda * w * w;
        let expected = [5.0 / 9.0, 0.0, -5.0 / 6.0, 0.0, 1.0 / 3.0, 0.0, -1.0 / 18.0];
        for (k, line) in along.regressor(0, 2).iter().enumerate() {
            let exact = expected.get(k).copied().unwrap_or(0.0) * scale;
            assert!((line - Complex::new(exact, 0.0)).norm() < 1e-15, "harmonic {k}: {line}");
        }
        assert!((along.regressor(0, 0)[3].re - lambda * w * w).abs() < 1e-14);
        assert!((along.regressor(0, 1)[3].re + lambda / 9.0).abs() < 1e-15);
        let response = along.response(0, &[2.0, 40.0, 1.5], 3);
        assert!((response[0] - Complex::new(40.0 - 2.0 * 9.0 * w * w, 0.0)).norm() < 1e-10, "{response:?}");
    }

    #[test]
    fn the_periodic_derivatives_couple_harmonics_as_the_hill_matrix_does() {
        // Method: row n of k2's part is k2 lambda w^2 [-(n-1) E_{n-1} + (n+1) E_{n+1} + (n-3)/3 E_{n-3} - (n+3)/3 E_{n+3}].
        let (lambda, w, k2) = (0.3, PI, 1.5);
        let along = Along::new(&MassSpringDrag, &[], &rest_to_rest_3().trajectory(&[lambda], w), 12).expect("finite");
        let mut error = vec![vec![Complex::new(0.0, 0.0); 9]];
        error[0][2] = Complex::new(2e-3, -1e-3);
        let product = along.applied(0, &[0.0, 0.0, k2, 1.0], &error, 8);
        // The matrix is written for two-sided coefficients: E_2 is half the phasor, and a phasor is twice its row.
        let e = error[0][2] / 2.0;
        let c = k2 * lambda * w * w;
        // Row 1 sees E_2 through (n+1) E_{n+1} and E_-2, its conjugate, through (n-3)/3 E_{n-3}.
        for (n, row) in [(1, e * 2.0 - e.conj() * (2.0 / 3.0)), (3, e * -2.0), (5, e * (2.0 / 3.0))] {
            let expected = row * c * 2.0;
            assert!((product[n] - expected).norm() < 1e-13, "row {n}: {} {expected}", product[n]);
        }
        assert!(product[0].norm() < 1e-13 && product[2].norm() < 1e-13 && product[4].norm() < 1e-13);
    }
}
