//! The harmonic equations of one record, and which of them are used.
//!
//! Invariant: an equation is used where the input, or a strong regressor, stands out of the noise of the same record.

use crate::equations::Equations;
use crate::error::EstimateError;
use crate::information::Information;
use crate::measured_motion::coupled::Coupled;
use crate::measured_motion::path::NoisePath;
use crate::measured_motion::repeats::Repeats;
use crate::measured_motion::sampling::{Context, Lines, drive_lines, hold_corrected};
use crate::select::{highest_visible, strongest, unexplained_tail, visible, without_stragglers};
use crate::settings::Settings;
use num_complex::Complex;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{Dims, Model};
use tpm_motion::Spectra;
use tpm_numerics::alarm;

/// A line of an input below this share of the strongest of its [`LINES_PER_SIDE`] is distortion, not excitation.
const LEAST_EXCITATION: f64 = 1e-3;
/// An equation at a harmonic far above all others is used from this share of the strongest input line on. A weaker one may be
/// fed-back noise, which shows the inverse of the feedback.
const LEAST_LONE_DRIVE: f64 = 0.1;
/// Lines on either side that count as neighbours.
const LINES_PER_SIDE: usize = 8;
/// The mean of an input is used from this share of its root mean square on.
const LEAST_MEAN_FORCE: f64 = 0.01;

/// The harmonic equations of one record.
#[derive(Clone, Debug)]
pub struct MeasuredMotion {
    pub(super) dims: Dims,
    /// Lines of B u, per row.
    pub(super) drive: Lines,
    /// Lines of the known terms, per row.
    pub(super) known: Lines,
    /// Lines of the regressors, per row and parameter.
    pub(super) phi: Lines,
    /// Whether an input acts on the row.
    pub(super) driven: Vec<bool>,
    /// Power of the floor under the highest lines of B u, per row: where the spectrum of the input ends.
    floor: Vec<f64>,
    /// How the channels' noise enters the rows.
    pub(super) path: NoisePath,
    /// Used harmonics, per row, ascending.
    pub(super) used: Vec<Vec<usize>>,
    tail: Option<Tail>,
    /// Noise variance of the rows' phasors by harmonic, where more is known than the channels' covariance says.
    pub(super) refined: Option<Vec<Vec<f64>>>,
    /// Variance of the rows' phasors by harmonic that does not come from the sensors' noise; no two equations share it.
    pub(super) apart: Vec<Vec<f64>>,
    /// What other records of the same motion repeat; nothing without counts.
    pub(super) repeats: Option<Repeats>,
    /// Relative level of the white noise of every coordinate's sensor, where the sensors are known to be the only source of noise.
    white: Option<Vec<f64>>,
    /// Correlations of the used equations' noise, where they are known.
    pub(super) coupled: Option<Coupled>,
}

/// Harmonics that the model does not explain and that were therefore left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Tail {
    from: usize,
    to: usize,
}

impl MeasuredMotion {
    /// Builds the equations of a record whose channels are the coordinates and then the inputs of the model.
    ///
    /// # Errors
    /// [`EstimateError::Channels`] when the record does not fit the model, [`EstimateError::NoSignal`] when nothing stands out of
    /// the noise, [`EstimateError::Model`] and [`EstimateError::NotFinite`] when the rows cannot be evaluated on the motion.
    pub fn new(
        model: &dyn Model<f64>,
        constants: &[f64],
        spectra: &Spectra,
        hold: Hold,
        settings: &Settings,
    ) -> Result<Self, EstimateError> {
        let dims = model.dims();
        let channels = dims.coordinates + dims.inputs;
        if spectra.lines.len() != channels {
            return Err(EstimateError::Channels { needed: channels, given: spectra.lines.len() });
        }
        let limit = spectra.highest();
        let (inputs, noise) = hold_corrected(spectra, dims, hold);
        let input_floor: Vec<f64> =
            (0..dims.inputs).map(|i| spectra.floor(dims.coordinates + i).unwrap_or(0.0)).collect();
        let reach = |channel: usize, lines: &[Complex<f64>], floor: f64| {
            highest_visible(lines, |k| noise[k][(channel, channel)].re.max(floor), limit)
        };
        let band = (0..dims.inputs).map(|i| reach(dims.coordinates + i, &inputs[i], input_floor[i])).max().unwrap_or(0);
        let motion_band = (0..dims.coordinates).map(|c| reach(c, &spectra.lines[c], 0.0)).max().unwrap_or(0);
        let motion_harmonics = motion_band.max(band).max(settings.harmonics.unwrap_or(0)).min(limit);
        if motion_harmonics == 0 {
            return Err(EstimateError::NoSignal);
        }
        let wanted = settings.harmonics.unwrap_or(motion_harmonics).min(limit).max(1);
        let context = Context { model, dims, constants, spectra, motion_harmonics };
        let (sampled, phi, known) = context.converge(wanted, settings.grid)?;
        let (drive, map) = drive_lines(dims, &sampled, &inputs, wanted);
        let driven = (0..dims.rows)
            .map(|r| {
                sampled
                    .map
                    .chunks_exact(dims.input_map_len().max(1))
                    .any(|m| m[r * dims.inputs..(r + 1) * dims.inputs].iter().any(|b| b.abs() > 0.0))
            })
            .collect();
        let jacobian = context.jacobian(&sampled)?;
        let mut this = MeasuredMotion {
            dims,
            drive,
            known,
            phi,
            floor: (0..dims.rows)
                .map(|r| input_floor.iter().enumerate().map(|(i, f)| map[(r, i)] * map[(r, i)] * f).sum())
                .collect(),
            driven,
            path: NoisePath { dims, fundamental: spectra.fundamental, map, noise, motion_harmonics, jacobian },
            used: Vec::new(),
            tail: None,
            refined: None,
            apart: vec![Vec::new(); dims.rows],
            repeats: None,
            white: None,
            coupled: None,
        };
        this.used = (0..dims.rows).map(|r| this.excited(r, wanted, settings.reach, false)).collect();
        let rank = this.rank();
        if rank < dims.parameters {
            // A parameter may be visible only where the motion is distorted.
            let narrow = core::mem::take(&mut this.used);
            this.used = (0..dims.rows).map(|r| this.excited(r, wanted, settings.reach, true)).collect();
            if this.rank() == rank {
                this.used = narrow;
            }
        }
        let even = context.even_in_velocity(&sampled)?;
        this.decide_means(&even);
        Ok(this)
    }

    /// (coordinate, derivative) of every slot that the rows read.
    pub(crate) fn slots(&self) -> &[(usize, usize)] {
        &self.path.jacobian.slots
    }

    /// Mean factor of every input in a row.
    pub(crate) fn input_map(&self, row: usize) -> Vec<f64> {
        self.path.map.row(row).iter().copied().collect()
    }

    /// Two-sided Fourier coefficients of d(row)/d(slot) along the period, per slot.
    pub(crate) fn gains(&self, row: usize, theta: &[f64]) -> Vec<Vec<Complex<f64>>> {
        self.path.jacobian.gains(row, theta)
    }

    /// Sets the variance of the rows' phasors, from harmonic 0 on: that of the coordinates' sensors, and `apart` what every phasor
    /// has besides. `white` has the sensors' relative levels where their noise is white.
    pub(crate) fn set_variance(&mut self, variance: Vec<Vec<f64>>, apart: Vec<Vec<f64>>, white: Option<Vec<f64>>) {
        self.refined = Some(variance);
        self.apart = apart;
        self.white = white;
    }

    /// Takes the means of the driven rows in, after shifting the mean of every regressor (and, last, of the known term) as noise
    /// does; `uncertainty` is the standard deviation of a row's whole shift at theta, as a share of it.
    pub(crate) fn admit_means(&mut self, shifts: &[Vec<f64>], theta: &[f64], uncertainty: f64) {
        let p = self.dims.parameters;
        for (row, shift) in shifts.iter().enumerate() {
            for (j, value) in shift.iter().enumerate() {
                if j < p {
                    self.phi[row * p + j][0] += *value;
                } else {
                    self.known[row][0] += *value;
                }
            }
            let whole: f64 = shift.iter().zip(theta.iter().chain(&[1.0])).map(|(s, t)| s * t).sum();
            if let Some(mean) = self.apart[row].first_mut() {
                *mean += (uncertainty * whole).powi(2);
            }
            if self.driven[row] && !self.used[row].contains(&0) {
                self.used[row].insert(0, 0);
            }
        }
    }

    /// Works out the correlations of the used equations' noise.
    pub(crate) fn couple(&mut self) {
        self.coupled = self.white.as_ref().and_then(|white| Coupled::new(&self.path, white, &self.used));
    }

    /// Highest harmonic used in any row.
    #[must_use]
    pub fn harmonics(&self) -> usize {
        self.used.iter().flatten().copied().max().unwrap_or(0)
    }

    /// Harmonics used in one row, ascending.
    #[must_use]
    pub fn used(&self, row: usize) -> &[usize] {
        self.used.get(row).map_or(&[], Vec::as_slice)
    }

    /// First and last harmonic of a tail that was left out because the model does not explain it.
    #[must_use]
    pub fn left_out(&self) -> Option<(usize, usize)> {
        self.tail.map(|t| (t.from, t.to))
    }

    /// Highest harmonic of the motion from which the regressors were built.
    #[must_use]
    pub const fn motion_harmonics(&self) -> usize {
        self.path.motion_harmonics
    }

    /// Lines of a row in which the input, or a regressor that is strong there, stands out of the noise.
    ///
    /// With `distortion`, also lines at which only the motion stands out.
    fn excited(&self, row: usize, limit: usize, reach: usize, distortion: bool) -> Vec<usize> {
        let p = self.dims.parameters;
        let peak = strongest(&self.drive[row]);
        let force = (0.5 * self.drive[row].iter().skip(1).map(Complex::norm_sqr).sum::<f64>()).sqrt();
        let peaks: Vec<f64> = (0..p).map(|j| strongest(&self.phi[row * p + j])).collect();
        let sizes: Vec<Vec<f64>> = (0..p).map(|j| self.path.size_jacobian(row * (p + 1) + j)).collect();
        let visible_lines = (0..=limit)
            .filter(|&k| {
                // Sensors have offsets: a mean counts when it is a part of the force, not when it is merely not zero.
                let drive = &self.drive[row];
                let around = &drive[k.saturating_sub(LINES_PER_SIDE).max(1)..drive.len().min(k + LINES_PER_SIDE + 1)];
                let near = around.iter().map(|z| z.norm()).fold(0.0, f64::max);
                let share = if k == 0 { LEAST_MEAN_FORCE * force } else { LEAST_EXCITATION * near };
                let substantial = drive[k].norm() > share;
                let floor = if k == 0 { self.floor[row] / 4.0 } else { self.floor[row] };
                let applied = self.driven[row]
                    && (k > 0 && k <= reach
                        || substantial && visible(drive[k], self.path.drive_variance(row, k).max(floor), peak));
                // An equation whose regressors are noise says nothing, and many of them bias the estimate.
                (0..p).any(|j| {
                    let line = self.phi[row * p + j][k];
                    // Where nothing is applied a weak line of a regressor is distortion, and a mean an offset.
                    let strong = match (self.driven[row], k) {
                        (true, 0) => f64::INFINITY,
                        (true, _) if distortion => 1e-9,
                        (true, _) | (false, 0) => 0.1,
                        (false, _) => 1e-9,
                    };
                    (applied || line.norm() > strong * peaks[j])
                        && peaks[j] > 0.0
                        && visible(line, self.path.column_variance(&sizes[j], k), peaks[j])
                })
            })
            .collect();
        without_stragglers(visible_lines, |k| {
            let noise = self.path.drive_variance(row, k).max(self.floor[row]);
            self.drive[row][k].norm() > LEAST_LONE_DRIVE * peak
                && self.drive[row][k].norm_sqr() > alarm::LONE_LINE * noise
        })
    }

    /// Leaves the means of rows with terms that are even in velocity out, since noise biases them. A mean that is not used comes
    /// in where the rank needs it.
    fn decide_means(&mut self, even_in_velocity: &[bool]) {
        for (lines, &even) in self.used.iter_mut().zip(even_in_velocity) {
            if even {
                lines.retain(|&k| k > 0);
            }
        }
        for row in 0..self.dims.rows {
            if self.used[row].contains(&0) {
                continue;
            }
            let without = self.rank();
            self.used[row].insert(0, 0);
            if self.rank() == without {
                self.used[row].remove(0);
            }
        }
    }

    /// Rank of the used equations.
    fn rank(&self) -> usize {
        let p = self.dims.parameters;
        let all: Vec<usize> = (0..p).collect();
        Information::of(self.equations(|_| 1.0).weighted(&all, &[])).solve(&vec![0.0; p], None).rank
    }

    /// The used equations, all equations of a row with the same variance.
    pub(super) fn equations(&self, variance: impl Fn(usize) -> f64) -> Equations {
        let p = self.dims.parameters;
        let mut equations = Equations::new(p);
        let mut phi = vec![Complex::new(0.0, 0.0); p];
        for (row, lines) in self.used.iter().enumerate() {
            let variance = variance(row);
            for &k in lines {
                for (j, entry) in phi.iter_mut().enumerate() {
                    *entry = self.phi[row * p + j][k];
                }
                let right = self.drive[row][k] - self.known[row][k];
                equations.push(row, k, &phi, right, variance);
            }
        }
        equations
    }

    /// Residual phasors of the used lines of a row.
    pub(super) fn residuals(&self, row: usize, theta: &[f64]) -> Vec<Complex<f64>> {
        let p = self.dims.parameters;
        self.used[row]
            .iter()
            .map(|&k| {
                let mut r = self.drive[row][k] - self.known[row][k];
                for (j, value) in theta.iter().enumerate() {
                    r -= self.phi[row * p + j][k] * *value;
                }
                r
            })
            .collect()
    }

    /// Root mean square over a period of the used lines of a row: residual, and the force it is compared with.
    ///
    /// A row without an input has the root sum of squares of its terms as its force.
    #[must_use]
    pub fn row_power(&self, row: usize, theta: &[f64]) -> (f64, f64) {
        let p = self.dims.parameters;
        let (mut residual, mut force) = (0.0, 0.0);
        for (r, &k) in self.residuals(row, theta).iter().zip(&self.used[row]) {
            let share = if k == 0 { 1.0 } else { 0.5 };
            residual += share * r.norm_sqr();
            force += share
                * if self.driven[row] {
                    self.drive[row][k].norm_sqr()
                } else {
                    self.known[row][k].norm_sqr()
                        + (0..p).map(|j| (self.phi[row * p + j][k] * theta[j]).norm_sqr()).sum::<f64>()
                };
        }
        (residual.sqrt(), force.sqrt())
    }

    /// Used lines of a row at given parameters: harmonic, phasor of the applied force, phasor of the force that the rows predict.
    #[must_use]
    pub fn row_lines(&self, row: usize, theta: &[f64]) -> Vec<(usize, Complex<f64>, Complex<f64>)> {
        let residuals = self.residuals(row, theta);
        let line = |(&k, residual)| (k, self.drive[row][k], self.drive[row][k] - residual);
        self.used[row].iter().zip(residuals).map(line).collect()
    }

    /// Used lines of a row: harmonic, and phasor of its terms under weights of the parameters.
    #[must_use]
    pub fn row_part(&self, row: usize, weights: &[f64]) -> Vec<(usize, Complex<f64>)> {
        let p = self.dims.parameters;
        let of = |k: usize| weights.iter().enumerate().map(|(j, weight)| self.phi[row * p + j][k] * *weight).sum();
        self.used[row].iter().map(|&k| (k, of(k))).collect()
    }

    /// Root mean square over a period of the used lines of a row's terms along a direction in parameter space: of their sum, and the
    /// root sum of squares of the terms.
    #[must_use]
    pub fn row_change(&self, row: usize, direction: &[f64]) -> (f64, f64) {
        let p = self.dims.parameters;
        let (mut change, mut terms) = (0.0, 0.0);
        for &k in &self.used[row] {
            let share = if k == 0 { 1.0 } else { 0.5 };
            let parts = || direction.iter().enumerate().map(|(j, weight)| self.phi[row * p + j][k] * *weight);
            change += share * parts().sum::<Complex<f64>>().norm_sqr();
            terms += share * parts().map(|part| part.norm_sqr()).sum::<f64>();
        }
        (change.sqrt(), terms.sqrt())
    }

    /// Cuts a tail that the model does not explain; true when there was one.
    pub(super) fn cut_tail(&mut self, theta: &[f64], variance: &[Vec<f64>]) -> bool {
        let mut cut = false;
        for (row, of_row) in variance.iter().enumerate() {
            let residual: Vec<f64> = self.residuals(row, theta).iter().map(|r| r.norm()).collect();
            let noise: Vec<f64> = of_row.iter().map(|v| v.sqrt()).collect();
            if let Some(from) = unexplained_tail(&self.used[row], &residual, &noise) {
                let to = self.used[row].last().copied().unwrap_or(from);
                self.used[row].retain(|&k| k < from);
                self.tail = Some(match self.tail {
                    Some(t) => Tail { from: t.from.min(from), to: t.to.max(to) },
                    None => Tail { from, to },
                });
                cut = true;
            }
        }
        if cut && self.coupled.is_some() {
            self.couple();
        }
        cut
    }
}
