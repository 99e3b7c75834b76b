//! Noise of the harmonic equations.
//!
//! Invariant: to first order a row's noise is its input's noise less the Jacobian along the motion times the motion's noise.
//! The Jacobian varies over the period and so mixes the harmonics of the noise; correlation between input and motion at one
//! harmonic (noise passed round a control loop) is kept.

use crate::measured_motion::sampling::Jacobian;
use crate::noise::mixing;
use num_complex::Complex;
use tpm_controller::model::Dims;
use tpm_numerics::DMatrix;
use tpm_numerics::fourier::coefficient;

/// How the channels' noise enters the rows along the motion of one record.
#[derive(Clone, Debug)]
pub(super) struct NoisePath {
    pub(super) dims: Dims,
    /// Fundamental angular frequency, rad/s.
    pub(super) fundamental: f64,
    /// Mean of B over the period, rows x inputs.
    pub(super) map: DMatrix<f64>,
    /// Covariance of the channels' noise per harmonic, hold corrected.
    pub(super) noise: Vec<DMatrix<Complex<f64>>>,
    /// Highest harmonic of the motion.
    pub(super) motion_harmonics: usize,
    pub(super) jacobian: Jacobian,
}

impl NoisePath {
    /// Variance of a row's phasor at a harmonic by the inputs' noise.
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

    /// Rough variance of a column's phasor at a harmonic, from mean squares: enough to tell whether its line is more than noise.
    pub(super) fn column_variance(&self, sizes: &[f64], k: usize) -> f64 {
        let turn = k as f64 * self.fundamental;
        self.jacobian
            .slots
            .iter()
            .zip(sizes)
            .map(|(&(c, d), size)| size * turn.powi(2 * d as i32) * self.noise[k][(c, c)].re)
            .sum()
    }

    /// Response of a row to the coordinates' phasors at a harmonic, from a coefficient of its derivative per slot.
    pub(super) fn line_response(&self, coefficient: &dyn Fn(usize) -> Complex<f64>, line: isize) -> Vec<Complex<f64>> {
        let mut response = vec![Complex::new(0.0, 0.0); self.dims.coordinates];
        let turn = Complex::new(0.0, line as f64 * self.fundamental);
        for (s, &(c, d)) in self.jacobian.slots.iter().enumerate() {
            response[c] += turn.powu(d as u32) * coefficient(s);
        }
        response
    }

    /// Re(left S right^H) with the noise covariance S of one harmonic, over the first `size` channels.
    pub(super) fn form(
        &self,
        left: &[Complex<f64>],
        right: &[Complex<f64>],
        k: usize,
        conjugate: bool,
        size: usize,
    ) -> f64 {
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
pub(super) struct Followed<'a> {
    path: &'a NoisePath,
    row: usize,
    /// Two-sided Fourier coefficients of d(row)/d(slot) along the period.
    gain: Vec<Vec<Complex<f64>>>,
    /// Harmonics of `gain` that mix the harmonics of noise.
    mixing: Vec<isize>,
}

impl<'a> Followed<'a> {
    pub(super) fn new(path: &'a NoisePath, row: usize, theta: &[f64]) -> Self {
        let gain = path.jacobian.gains(row, theta);
        Followed { path, row, mixing: mixing(&gain), gain }
    }

    /// Response to the channels' phasors at one harmonic through the mean derivatives.
    pub(super) fn direct(&self, k: usize) -> Vec<Complex<f64>> {
        let path = self.path;
        let mut direct = path.line_response(&|s| coefficient(&self.gain[s], 0), k as isize);
        direct.iter_mut().for_each(|z| *z = -*z);
        direct.extend((0..path.dims.inputs).map(|i| Complex::new(path.map[(self.row, i)], 0.0)));
        direct
    }

    /// E|n|^2 of the row's phasor at a harmonic.
    pub(super) fn variance(&self, k: usize) -> f64 {
        let path = self.path;
        let mut total = 0.0;
        for &m in &self.mixing {
            let line = k as isize - m;
            if line.unsigned_abs() > path.motion_harmonics || m == 0 {
                continue;
            }
            let through = path.line_response(&|s| coefficient(&self.gain[s], m), line);
            // A mean takes half of a line's amplitude from either side, and unlike a line's phasor is not doubled.
            let share = match (k, line) {
                (0, _) => 0.25,
                (_, 0) => 4.0,
                _ => 1.0,
            };
            total += share * path.form(&through, &through, line.unsigned_abs(), line < 0, path.dims.coordinates);
        }
        let direct = self.direct(k);
        total + path.form(&direct, &direct, k, false, direct.len())
    }
}
