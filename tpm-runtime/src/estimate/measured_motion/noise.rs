//! Noise of the harmonic equations.
//!
//! Invariant: to first order a row's noise is its input's noise less the Jacobian along the motion times the motion's noise.
//! The Jacobian varies over the period and so mixes the harmonics of the noise; correlation between input and motion at one
//! harmonic (noise passed round a control loop) is kept.

use super::MeasuredMotion;
use nalgebra::Complex;
use realfft::RealFftPlanner;
use std::vec;
use std::vec::Vec;

impl MeasuredMotion {
    pub(super) fn drive_variance(&self, row: usize, k: usize) -> f64 {
        let c = self.dims.coordinates;
        let mut sum = 0.0;
        for i in 0..self.dims.inputs {
            for l in 0..self.dims.inputs {
                sum += self.map[(row, i)] * self.map[(row, l)] * self.noise[k][(c + i, c + l)].re;
            }
        }
        sum
    }

    fn mean_jacobian(&self, column: usize) -> Vec<f64> {
        (0..self.jacobian.slots.len())
            .map(|s| {
                let series = self.jacobian.series(s, column);
                series.iter().sum::<f64>() / series.len().max(1) as f64
            })
            .collect()
    }

    /// Response of a column to the coordinates' phasors at one harmonic, from mean derivatives.
    fn response(&self, mean: &[f64], k: usize) -> Vec<Complex<f64>> {
        let mut response = vec![Complex::new(0.0, 0.0); self.dims.coordinates];
        let turn = Complex::new(0.0, k as f64 * self.fundamental);
        for (&(c, d), &value) in self.jacobian.slots.iter().zip(mean) {
            response[c] += turn.powu(d as u32) * value;
        }
        response
    }

    /// Mean square of a column's derivatives along the period, per slot.
    pub(super) fn size_jacobian(&self, column: usize) -> Vec<f64> {
        (0..self.jacobian.slots.len())
            .map(|s| {
                let series = self.jacobian.series(s, column);
                series.iter().map(|x| x * x).sum::<f64>() / series.len().max(1) as f64
            })
            .collect()
    }

    /// About the noise that a column carries at a harmonic: enough to tell whether its line is more than noise.
    pub(super) fn column_variance(&self, sizes: &[f64], k: usize) -> f64 {
        let turn = k as f64 * self.fundamental;
        self.jacobian
            .slots
            .iter()
            .zip(sizes)
            .map(|(&(c, d), size)| size * turn.powi(2 * d as i32) * self.noise[k][(c, c)].re)
            .sum()
    }

    /// Variance of every used equation's noise at theta, and the expectation of conj(regressor noise) times row noise.
    pub(super) fn row_noise(&self, theta: &[f64]) -> (Vec<Vec<f64>>, Vec<Vec<Vec<f64>>>) {
        let p = self.dims.parameters;
        let c = self.dims.coordinates;
        let slots = self.jacobian.slots.len();
        let points = self.jacobian.points;
        let mut planner = RealFftPlanner::<f64>::new();
        let transform = planner.plan_fft_forward(points);
        let mut variance = Vec::with_capacity(self.dims.rows);
        let mut bias = Vec::with_capacity(self.dims.rows);
        for row in 0..self.dims.rows {
            // Two-sided Fourier coefficients of d(row)/d(slot) along the period.
            let mut gain: Vec<Vec<Complex<f64>>> = Vec::with_capacity(slots);
            for s in 0..slots {
                let mut series = vec![0.0; points];
                // The known term stands behind the parameters, with the factor one.
                for (j, factor) in theta.iter().copied().chain([1.0]).enumerate() {
                    let part = self.jacobian.series(s, row * (p + 1) + j);
                    for (sum, value) in series.iter_mut().zip(part) {
                        *sum += factor * value;
                    }
                }
                let mut spectrum = transform.make_output_vec();
                transform.process(&mut series, &mut spectrum).expect("invariant: buffers were made for this transform");
                let scale = 1.0 / points as f64;
                gain.push(spectrum.iter().map(|z| z * scale).collect());
            }
            // A coefficient that rounding alone leaves mixes no noise between harmonics.
            let strongest: Vec<f64> =
                gain.iter().map(|g| g.iter().map(Complex::norm_sqr).fold(0.0, f64::max)).collect();
            let mixing: Vec<usize> = (0..points / 2)
                .filter(|&m| m == 0 || gain.iter().zip(&strongest).any(|(g, s)| g[m].norm_sqr() > 1e-14 * s))
                .collect();
            let coefficient = |s: usize, m: isize| {
                let z = gain[s][m.unsigned_abs()];
                if m < 0 { z.conj() } else { z }
            };
            let columns: Vec<Vec<f64>> = (0..p).map(|j| self.mean_jacobian(row * (p + 1) + j)).collect();
            let mut row_variance = Vec::with_capacity(self.used[row].len());
            let mut row_bias = Vec::with_capacity(self.used[row].len());
            for &k in &self.used[row] {
                let mut total = 0.0;
                for &m in &mixing {
                    for m in [m as isize, -(m as isize)] {
                        let line = k as isize - m;
                        if line.unsigned_abs() > self.motion_harmonics || (m == 0 && line == k as isize) {
                            continue;
                        }
                        let at = self.line_response(&|s| coefficient(s, m), line);
                        // The mean is not doubled, and a mean takes half of a line's amplitude from either side.
                        let share = match (k, line) {
                            (0, _) => 0.25,
                            (_, 0) => 4.0,
                            _ => 1.0,
                        };
                        total += share * self.form(&at, &at, line.unsigned_abs(), line < 0, c);
                    }
                }
                let mut direct: Vec<Complex<f64>> =
                    self.line_response(&|s| coefficient(s, 0), k as isize).iter().map(|z| -z).collect();
                for i in 0..self.dims.inputs {
                    direct.push(Complex::new(self.map[(row, i)], 0.0));
                }
                total += self.form(&direct, &direct, k, false, direct.len());
                let scale = self.drive[row][k].norm()
                    + (0..p).map(|j| (self.phi[row * p + j][k] * theta[j]).norm()).sum::<f64>();
                // Never below the rounding of the transforms, so that an exact record has finite weights.
                let refined = self.refined.as_ref().and_then(|rows| rows[row].get(k));
                let noise = refined.copied().unwrap_or(total) + self.error_apart(row, k);
                row_variance.push(noise + (1e-14 * scale).powi(2) + f64::MIN_POSITIVE);
                row_bias.push(
                    columns
                        .iter()
                        .map(|mean| {
                            let mut response = self.response(mean, k);
                            response.resize(direct.len(), Complex::new(0.0, 0.0));
                            self.form(&direct, &response, k, false, direct.len())
                        })
                        .collect(),
                );
            }
            variance.push(row_variance);
            bias.push(row_bias);
        }
        (variance, bias)
    }

    fn line_response(&self, coefficient: &dyn Fn(usize) -> Complex<f64>, line: isize) -> Vec<Complex<f64>> {
        let mut response = vec![Complex::new(0.0, 0.0); self.dims.coordinates];
        let turn = Complex::new(0.0, line as f64 * self.fundamental);
        for (s, &(c, d)) in self.jacobian.slots.iter().enumerate() {
            response[c] += turn.powu(d as u32) * coefficient(s);
        }
        response
    }

    /// Re(left S right^H) with the noise covariance S of one harmonic, over the first `size` channels.
    fn form(&self, left: &[Complex<f64>], right: &[Complex<f64>], k: usize, conjugate: bool, size: usize) -> f64 {
        let mut sum = 0.0;
        for (a, x) in left.iter().enumerate().take(size) {
            for (b, y) in right.iter().enumerate().take(size) {
                let entry = self.noise[k][(a, b)];
                let entry = if conjugate { entry.conj() } else { entry };
                sum += (x * entry * y.conj()).re;
            }
        }
        sum
    }
}

/// Power per harmonic that residuals show beyond the stated noise: the maximum of the likelihood of a flat addition.
///
/// Maximum likelihood, not a moment: lines with much noise say little about a small addition, and must not drown the lines
/// with little noise in it. `share` is the degrees of freedom that the fit left, per equation.
pub(super) fn excess(residual: &[Complex<f64>], variance: &[f64], harmonics: &[usize], share: f64) -> f64 {
    if residual.is_empty() || share <= 0.0 {
        return 0.0;
    }
    let lines: Vec<(f64, f64, f64)> = residual
        .iter()
        .zip(variance)
        .zip(harmonics)
        .map(|((r, &v), &k)| {
            // A mean is one real equation and carries a quarter of the power of a line.
            if k == 0 { (4.0 * r.norm_sqr() / share, 4.0 * v, 0.5) } else { (r.norm_sqr() / share, v, 1.0) }
        })
        .collect();
    let cost = |addition: f64| {
        lines.iter().map(|&(power, v, count)| count * ((v + addition).ln() + power / (v + addition))).sum::<f64>()
    };
    let top = lines.iter().map(|l| l.0).fold(0.0, f64::max);
    let bottom = lines.iter().map(|l| l.1).fold(f64::INFINITY, f64::min);
    if top <= 0.0 {
        return 0.0;
    }
    let (mut best, mut least) = (0.0, cost(0.0));
    let (low, high) = ((bottom * 1e-3).max(top * 1e-24).ln(), (top * 2.0).ln());
    let steps = 240;
    for i in 0..=steps {
        let addition = (low + (high - low) * f64::from(i) / f64::from(steps)).exp();
        let now = cost(addition);
        if now < least {
            least = now;
            best = addition;
        }
    }
    best
}
