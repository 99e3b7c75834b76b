//! Which combinations of the parameters the perturbed runs of `numerical` change, and by how much.
//!
//! A column of the matrix errs by the noise over the step, and by its curvature times the step. The response is taken to bend by as much
//! as it changes when a parameter changes by its whole value, until updates have shown how much more or less it bends; both errors are
//! then alike at the mean, by ratio, of that value and of the step that changes the error by its noise. Combinations that hardly show need
//! the longest steps. Once a matrix is known, its principal directions are perturbed, each by a step of its own, and before that one
//! parameter at a time.
//!
//! Invariant: changes are independent; what is given in steps is in multiples of them.

use num_complex::Complex;
use tpm_numerics::{DMatrix, DVector};

/// Largest change in a perturbed run, as a share of the parameters' values, or of the values at which they make the whole force.
const MOST_PERTURBATION: f64 = 0.5;

/// A perturbed run changes the error by this many times its noise, if the largest change allows.
const LEAST_OVER_NOISE: f64 = 5.0;
/// Largest change that an update plays along a principal direction, in values of the parameters.
const MOST_UPDATE: f64 = 2.0;

/// Phasors per coordinate and harmonic.
pub(super) type Lines = Vec<Vec<Complex<f64>>>;

/// A measured column of M.
#[derive(Clone)]
pub(super) struct Column {
    /// Change of every coordinate's error lines by the step of the perturbed run.
    pub(super) lines: Lines,
    /// How much of the noise of every run since the matrix was begun is in the column.
    pub(super) noise: Vec<f64>,
}

/// The changes of the perturbed runs.
#[derive(Clone)]
pub(super) struct Perturbations {
    /// The parameters that are perturbed.
    pub(super) parameters: Vec<usize>,
    /// Change of every one of these parameters, a column for every run.
    changes: DMatrix<f64>,
    inverse: DMatrix<f64>,
    /// Sizes of these parameters.
    sizes: DVector<f64>,
}

/// How much changes of parameters change the error: `c' R c` is the power of its lines for the changes c.
#[derive(Clone)]
pub(super) struct Response {
    /// The parameters that were perturbed.
    parameters: Vec<usize>,
    matrix: DMatrix<f64>,
}

impl Perturbations {
    /// Changes for parameters of such sizes, given what is expected of each parameter alone or measured of all, the power of the noise in
    /// all lines, and how much the response bends.
    pub(super) fn new(
        parameters: Vec<usize>,
        sizes: &[f64],
        alone: &[f64],
        measured: Option<&Response>,
        noise: f64,
        bend: f64,
    ) -> Self {
        let scale = DMatrix::from_diagonal(&DVector::from_column_slice(sizes));
        let expected = DMatrix::from_diagonal(&DVector::from_column_slice(alone));
        let known = measured.filter(|measured| measured.parameters == parameters);
        let response = known.map_or(expected, |measured| measured.matrix.clone());
        let principal = (&scale * response * &scale).symmetric_eigen();
        let step = |power: f64| {
            if power <= 0.0 {
                return MOST_PERTURBATION;
            }
            let of_noise = (noise / power).sqrt();
            (of_noise / bend).sqrt().max(LEAST_OVER_NOISE * of_noise).min(MOST_PERTURBATION)
        };
        let steps = principal.eigenvalues.map(step);
        let changes = scale.clone() * &principal.eigenvectors * DMatrix::from_diagonal(&steps);
        // The eigenvectors are orthonormal, and sizes and steps are above zero.
        let inverse = DMatrix::from_diagonal(&steps.map(f64::recip))
            * principal.eigenvectors.transpose()
            * DMatrix::from_diagonal(&scale.diagonal().map(f64::recip));
        Perturbations { parameters, changes, inverse, sizes: DVector::from_column_slice(sizes) }
    }

    /// Number of perturbed runs.
    pub(super) fn count(&self) -> usize {
        self.parameters.len()
    }

    /// The change of every perturbed parameter in one of the runs.
    pub(super) fn change(&self, run: usize) -> impl Iterator<Item = (usize, f64)> {
        self.parameters.iter().copied().zip(self.changes.column(run).iter().copied().collect::<Vec<f64>>())
    }

    /// Multiplies the changes of the runs from the given one on.
    pub(super) fn scale(&mut self, from: usize, factor: f64) {
        for run in from..self.count() {
            self.changes.column_mut(run).scale_mut(factor);
            self.inverse.row_mut(run).scale_mut(factor.recip());
        }
    }

    /// Changes of the perturbed parameters in steps.
    pub(super) fn in_steps(&self, change: &[f64]) -> Vec<f64> {
        (&self.inverse * DVector::from_column_slice(change)).iter().copied().collect()
    }

    /// What is too much in an update, given in steps, as changes of the perturbed parameters: along a principal direction that hardly
    /// shows, noise makes updates beyond any linearisation.
    pub(super) fn excess(&self, steps: &[f64], columns: &[Column]) -> Vec<f64> {
        let Some(Response { matrix, .. }) = self.response(columns) else { return vec![0.0; self.count()] };
        let scale = DMatrix::from_diagonal(&self.sizes);
        let principal = (&scale * matrix * &scale).symmetric_eigen();
        let update = (&self.changes * DVector::from_column_slice(steps)).component_div(&self.sizes);
        let beyond = principal.eigenvectors.tr_mul(&update).map(|along| along - along.clamp(-MOST_UPDATE, MOST_UPDATE));
        (scale * principal.eigenvectors * beyond).iter().copied().collect()
    }

    /// Columns per parameter of those per step.
    pub(super) fn by_parameter(&self, columns: &[Lines]) -> Vec<Lines> {
        let of = |j: usize| {
            let mut sum = columns[0].clone();
            for (c, lines) in sum.iter_mut().enumerate() {
                for (k, line) in lines.iter_mut().enumerate() {
                    *line = columns.iter().enumerate().map(|(i, column)| column[c][k] * self.inverse[(i, j)]).sum();
                }
            }
            sum
        };
        (0..columns.len()).map(of).collect()
    }

    /// The response that a whole matrix shows; nothing before it is whole.
    pub(super) fn response(&self, columns: &[Column]) -> Option<Response> {
        if columns.len() < self.count() {
            return None;
        }
        let lines = |i: usize| columns[i].lines.iter().flatten();
        let product = |a: &Complex<f64>, b: &Complex<f64>| (a.conj() * b).re;
        let matrix = DMatrix::from_fn(columns.len(), columns.len(), |i, j| {
            lines(i).zip(lines(j)).map(|(a, b)| product(a, b)).sum::<f64>()
        });
        let matrix = self.inverse.tr_mul(&(matrix * &self.inverse));
        Some(Response { parameters: self.parameters.clone(), matrix })
    }
}

#[cfg(test)]
mod tests {
    use super::{Column, Perturbations};
    use num_complex::Complex;

    #[test]
    fn a_combination_that_hardly_shows_is_perturbed_by_a_longer_step() {
        // Two parameters whose columns are nearly alike: their sum shows a thousand times as much as their difference.
        let noise = 1e-6_f64;
        let first = Perturbations::new(vec![0, 2], &[2.0, 3.0], &[0.25, 1.0 / 9.0], None, noise * noise, 1.0);
        let changes: Vec<Vec<f64>> = (0..2).map(|i| first.change(i).map(|(_, change)| change).collect()).collect();
        for change in &changes {
            let [a, b] = [change[0] / 2.0, change[1] / 3.0].map(f64::abs);
            assert!((a.max(b) - 1e-3).abs() < 1e-9 && a.min(b) < 1e-12, "one at a time: {changes:?}");
        }
        let column = |change: &[f64]| {
            let (sum, difference) = (change[0] / 2.0 + change[1] / 3.0, change[0] / 2.0 - change[1] / 3.0);
            Column { lines: vec![vec![Complex::new(sum, 0.0), Complex::new(0.0, 1e-3 * difference)]], noise: vec![] }
        };
        let columns: Vec<Column> = changes.iter().map(|change| column(change)).collect();
        let response = first.response(&columns).expect("whole");
        let next = Perturbations::new(vec![0, 2], &[2.0, 3.0], &[0.0, 0.0], Some(&response), noise * noise, 1.0);
        let mut found: Vec<f64> = (0..2)
            .map(|i| {
                let change: Vec<f64> = next.change(i).map(|(_, change)| change).collect();
                let unit = next.in_steps(&change);
                assert!((unit[i] - 1.0).abs() < 1e-12 && unit[1 - i].abs() < 1e-12, "{unit:?}");
                (change[0] / 2.0).hypot(change[1] / 3.0)
            })
            .collect();
        found.sort_by(f64::total_cmp);
        // sqrt(noise / effect) with the effects sqrt(2) and sqrt(2) / 1000.
        let expected = [1e-3 / 2.0_f64.sqrt().sqrt(), 1e-3 * (1e3_f64 / 2.0_f64.sqrt()).sqrt()];
        for (found, expected) in found.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
        }
    }
}
