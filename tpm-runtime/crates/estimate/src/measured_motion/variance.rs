//! Variance of a record's used equations, and the bias that noise in the regressors leaves.

use crate::measured_motion::path::Followed;
use crate::measured_motion::record::MeasuredMotion;
use num_complex::Complex;
use tpm_numerics::fourier::coefficient;

impl MeasuredMotion {
    /// Variance of an equation that it shares with no other equation.
    pub(super) fn error_apart(&self, row: usize, k: usize) -> f64 {
        self.apart[row].get(k).copied().unwrap_or(0.0)
    }

    /// Variance of every used equation's noise at theta.
    pub(super) fn row_noise(&self, theta: &[f64]) -> Vec<Vec<f64>> {
        let p = self.dims.parameters;
        let of_row = |row: usize| {
            let refined = self.refined.as_ref().map_or(&[][..], |rows| &rows[row]);
            let known = self.used[row].last().is_none_or(|&k| k < refined.len());
            let followed = (!known).then(|| Followed::new(&self.path, row, theta));
            let of_line = |&k: &usize| {
                let noise = followed.as_ref().map_or(0.0, |followed| followed.variance(k));
                let scale = self.drive[row][k].norm()
                    + (0..p).map(|j| (self.phi[row * p + j][k] * theta[j]).norm()).sum::<f64>();
                let noise = refined.get(k).copied().unwrap_or(noise) + self.error_apart(row, k);
                // Never below the rounding of the transforms, so that an exact record has finite weights.
                noise + (1e-14 * scale).powi(2) + f64::MIN_POSITIVE
            };
            self.used[row].iter().map(of_line).collect()
        };
        (0..self.dims.rows).map(of_row).collect()
    }

    /// Expectation of conj(regressor noise) times row noise at theta, per row, used equation and parameter; from the means of
    /// the derivatives along the motion.
    pub(super) fn row_bias(&self, theta: &[f64]) -> Vec<Vec<Vec<f64>>> {
        let p = self.dims.parameters;
        let of_row = |row: usize| {
            let followed = Followed::new(&self.path, row, theta);
            let of_line = |&k: &usize| {
                let direct = followed.direct(k);
                let of_parameter = |j: usize| {
                    let mean = |s: usize| coefficient(&self.path.jacobian.lines[s][row * (p + 1) + j], 0);
                    let mut response = self.path.line_response(&mean, k as isize);
                    response.resize(direct.len(), Complex::new(0.0, 0.0));
                    self.path.form(&direct, &response, k, false, direct.len())
                };
                (0..p).map(of_parameter).collect()
            };
            self.used[row].iter().map(of_line).collect()
        };
        (0..self.dims.rows).map(of_row).collect()
    }

    /// Variances with which every used equation counts alike over the period, and rows by the size of their force at theta.
    pub(super) fn alike(&self, theta: &[f64]) -> Vec<f64> {
        let of_row = |(row, lines): (usize, &Vec<usize>)| {
            let (_, force) = self.row_power(row, theta);
            let line = if force > 0.0 { force * force } else { 1.0 };
            // In the mean square over a period a mean's square counts twice as much as an amplitude's.
            lines.iter().map(|&k| if k == 0 { line / 4.0 } else { line }).collect::<Vec<f64>>()
        };
        self.used.iter().enumerate().flat_map(of_row).collect()
    }
}
