//! Noise of the harmonic equations.
//!
//! Invariant: to first order a row's noise is its input's noise less the Jacobian along the motion times the motion's noise.
//! The Jacobian varies over the period and so mixes the harmonics of the noise; correlation between input and motion at one
//! harmonic (noise passed round a control loop) is kept.

use crate::estimate::applied::mixing;
use crate::estimate::measured_motion::MeasuredMotion;
use crate::numerics::fourier::coefficient;
use num_complex::Complex;
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

    /// Mean square of a column's derivatives along the period, per slot.
    pub(super) fn size_jacobian(&self, column: usize) -> Vec<f64> {
        let size = |lines: &[Complex<f64>]| {
            let mean = lines.first().map_or(0.0, Complex::norm_sqr);
            mean + 2.0 * lines.iter().skip(1).map(Complex::norm_sqr).sum::<f64>()
        };
        self.jacobian.lines.iter().map(|columns| size(&columns[column])).collect()
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

    /// Variance of every used equation's noise at theta.
    pub(super) fn row_noise(&self, theta: &[f64]) -> Vec<Vec<f64>> {
        let p = self.dims.parameters;
        let of_row = |row: usize| {
            let refined = self.refined.as_ref().map_or(&[][..], |rows| &rows[row]);
            let known = self.used[row].last().is_none_or(|&k| k < refined.len());
            let followed = (!known).then(|| Followed::new(self, row, theta));
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

    /// Expectation of conj(regressor noise) times row noise at theta, per row, used equation and parameter.
    pub(super) fn row_bias(&self, theta: &[f64]) -> Vec<Vec<Vec<f64>>> {
        let p = self.dims.parameters;
        let of_row = |row: usize| {
            let followed = Followed::new(self, row, theta);
            let of_line = |&k: &usize| {
                let direct = followed.direct(k);
                let of_parameter = |j: usize| {
                    // From mean derivatives.
                    let mean = |s: usize| coefficient(&self.jacobian.lines[s][row * (p + 1) + j], 0);
                    let mut response = self.line_response(&mean, k as isize);
                    response.resize(direct.len(), Complex::new(0.0, 0.0));
                    self.form(&direct, &response, k, false, direct.len())
                };
                (0..p).map(of_parameter).collect()
            };
            self.used[row].iter().map(of_line).collect()
        };
        (0..self.dims.rows).map(of_row).collect()
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

/// The channels' noise on its way through a row at theta.
struct Followed<'a> {
    record: &'a MeasuredMotion,
    row: usize,
    /// Two-sided Fourier coefficients of d(row)/d(slot) along the period.
    gain: Vec<Vec<Complex<f64>>>,
    /// Their harmonics that mix noise.
    mixing: Vec<isize>,
}

impl<'a> Followed<'a> {
    fn new(record: &'a MeasuredMotion, row: usize, theta: &[f64]) -> Self {
        let gain = record.jacobian.gains(row, theta);
        Followed { record, row, mixing: mixing(&gain), gain }
    }

    /// Response to the channels' phasors at one harmonic through the mean derivatives.
    fn direct(&self, k: usize) -> Vec<Complex<f64>> {
        let record = self.record;
        let mut direct = record.line_response(&|s| coefficient(&self.gain[s], 0), k as isize);
        direct.iter_mut().for_each(|z| *z = -*z);
        direct.extend((0..record.dims.inputs).map(|i| Complex::new(record.map[(self.row, i)], 0.0)));
        direct
    }

    fn variance(&self, k: usize) -> f64 {
        let record = self.record;
        let mut total = 0.0;
        for &m in &self.mixing {
            let line = k as isize - m;
            if line.unsigned_abs() > record.motion_harmonics || m == 0 {
                continue;
            }
            let through = record.line_response(&|s| coefficient(&self.gain[s], m), line);
            // The mean is not doubled, and a mean takes half of a line's amplitude from either side.
            let share = match (k, line) {
                (0, _) => 0.25,
                (_, 0) => 4.0,
                _ => 1.0,
            };
            total += share * record.form(&through, &through, line.unsigned_abs(), line < 0, record.dims.coordinates);
        }
        let direct = self.direct(k);
        total + record.form(&direct, &direct, k, false, direct.len())
    }
}

/// Steps of the grid on which an addition to the noise is looked for.
const STEPS: u32 = 240;

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
    // The least of a grid, found by halving it: where no term's slope lets the cost fall, only the first point is looked at,
    // where none lets it rise, only the last.
    let (low, high) = ((bottom * 1e-3).max(top * 1e-24).ln(), (top * 2.0).ln());
    let addition = |i: u32| (low + (high - low) * f64::from(i) / f64::from(STEPS)).exp();
    let (mut best, mut least) = (0.0, cost(0.0));
    let mut intervals = [(0, 0); 2 * STEPS.ilog2() as usize + 4];
    intervals[0] = (0, STEPS);
    let mut waiting = 1;
    while waiting > 0 {
        waiting -= 1;
        let (first, last) = intervals[waiting];
        let (from, to) = (addition(first), addition(last));
        let slope = |near: f64, far: f64| {
            lines
                .iter()
                .map(|&(power, v, count)| count * (1.0 / (v + far) - power / (v + near) / (v + near)))
                .sum::<f64>()
        };
        let tried = if first == last || slope(from, to) >= 0.0 {
            from
        } else if slope(to, from) <= 0.0 {
            to
        } else {
            let middle = first + (last - first) / 2;
            // The left half is looked at first.
            intervals[waiting] = (middle + 1, last);
            intervals[waiting + 1] = (first, middle);
            waiting += 2;
            continue;
        };
        let now = cost(tried);
        if now < least {
            least = now;
            best = tried;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::{STEPS, excess};
    use num_complex::Complex;
    use std::vec::Vec;

    #[test]
    fn the_excess_is_the_best_point_of_the_whole_grid() {
        for case in 0..200_u32 {
            let number = |i: u32| f64::from((case * 7919 + i * 104_729) % 1009) / 1009.0;
            let count = 1 + case % 9;
            let variance: Vec<f64> = (0..count).map(|i| 10.0_f64.powf(-8.0 * number(i))).collect();
            let power: Vec<f64> = (0..count).map(|i| 10.0_f64.powf(-8.0 * number(i + 50))).collect();
            let residual: Vec<Complex<f64>> = power.iter().map(|p| Complex::new(p.sqrt(), 0.0)).collect();
            let harmonics: Vec<usize> = (1..=count as usize).collect();
            let cost = |a: f64| power.iter().zip(&variance).map(|(p, v)| (v + a).ln() + p / (v + a)).sum::<f64>();
            let top = power.iter().copied().fold(0.0, f64::max);
            let bottom = variance.iter().copied().fold(f64::INFINITY, f64::min);
            let (low, high) = ((bottom * 1e-3).max(top * 1e-24).ln(), (top * 2.0).ln());
            let grid = (0..=STEPS).map(|i| (low + (high - low) * f64::from(i) / f64::from(STEPS)).exp());
            let least = grid.chain([0.0]).map(cost).fold(f64::INFINITY, f64::min);
            let found = cost(excess(&residual, &variance, &harmonics, 1.0));
            assert!((found - least).abs() <= 1e-12 * (1.0 + least.abs()), "{case}: {found} {least}");
        }
    }
}
