//! Measured motion: inverse dynamics in the frequency domain.
//!
//! Invariant: the regressors are evaluated on the measured motion itself, with spectral derivatives over whole periods, and
//! their harmonics are equated with those of the applied input. Nothing is linearised about a reference, so that one run
//! without noise gives the parameters exactly, for any term (sin, sgn, products).
//!
//! Noise of the measured motion enters the regressors. It is followed to first order through the time-varying Jacobian of
//! the rows along the motion, which gives each harmonic equation its variance, and the bias it would leave in the normal
//! equations (errors in variables) is subtracted.

mod coupled;
mod fit;
mod noise;
mod sampling;

pub use fit::estimate_measured_motion;
#[cfg(feature = "interpret")]
pub(in crate::estimate) use fit::{Fitted, Structure, estimate_structured};

use crate::estimate::equations::Equations;
use crate::estimate::information::Information;
use crate::estimate::numerical::NumericalSettings;
use crate::estimate::select::{ALONE, highest_visible, strongest, unexplained_tail, visible, without_stragglers};
use crate::numerics::DMatrix;
use crate::run::Spectra;
use coupled::Coupled;
use num_complex::Complex;
use sampling::{Context, Jacobian, Lines, drive_lines, hold_corrected};
use std::string::String;
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;
use tpm_core::model::{Dims, EvalError, Model};

/// A line of an input below this share of its neighbours is their distortion, not excitation.
const DISTORTION: f64 = 1e-3;
/// An equation far above all others counts from this share of the strongest input on: one of feedback noise passes for
/// excitation otherwise, and what it shows is the inverse of the feedback.
const SUBSTANTIAL: f64 = 0.1;
/// Lines on either side that count as neighbours.
const NEIGHBOURS: usize = 8;
/// The mean of an input is used from this share of its root mean square on.
const MEAN_FORCE: f64 = 0.01;
/// Why measured motion gave no estimate.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EstimateError {
    /// The model refused an evaluation.
    #[error("the model cannot be evaluated: {0}")]
    Model(#[from] EvalError),
    /// Spectra and model do not have the same number of signals.
    #[error("the model has {needed} coordinates and inputs, the record has {given} signals")]
    Channels {
        /// Coordinates plus inputs.
        needed: usize,
        /// Signals in the record.
        given: usize,
    },
    /// A term is not finite along the measured motion.
    #[error(
        "row {row} is not finite on the measured motion ({what}); is a square root taken of a negative number, or a scale wrong?"
    )]
    NotFinite {
        /// Name of the row.
        row: String,
        /// The term.
        what: String,
    },
    /// No harmonic stands out of the noise.
    #[error(
        "no harmonic of the inputs or of the motion stands out of the noise; excite the machine more, or record longer"
    )]
    NoSignal,
    /// A frozen parameter does not exist.
    #[error("there is no parameter number {0} to freeze")]
    Frozen(usize),
    /// Every parameter is frozen.
    #[error("all parameters are frozen; there is nothing to identify")]
    AllFrozen,
}

/// A parameter that is held at a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frozen {
    /// Index of the parameter.
    pub parameter: usize,
    /// Its value, in the model's unit.
    pub value: f64,
}

/// How much every equation counts in a measured-motion estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Weights {
    /// By its noise and the model's own error: the smallest deviations.
    #[default]
    Noise,
    /// Alike, rows by the size of their force: the model whose force is nearest to the machine's over the period, whatever the
    /// noise. For models that leave something out, such as a series cut off: their parameters move with the weights.
    Equal,
}

/// What the caller may decide about a measured-motion estimate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// Highest harmonic that may be used; chosen from the spectrum when not given.
    pub harmonics: Option<usize>,
    /// Points of a period at which the rows are evaluated; doubled until converged when not given.
    pub grid: Option<usize>,
    /// Values that unobservable directions keep, one per parameter; zeros when empty.
    pub prior: Vec<f64>,
    /// Parameters that are held.
    pub frozen: Vec<Frozen>,
    /// Harmonics up to this one are those of the experiment: an input that is known to be small there says as much as a
    /// large one. Beyond, and by default, what is not excited counts as distortion.
    pub reach: usize,
    /// Directions that the experiments cannot show, known beforehand: the estimate keeps its prior along them although
    /// noise and errors of the tracking seem to show them.
    pub hidden: Vec<Vec<f64>>,
    /// How much every equation counts.
    pub weights: Weights,
    /// How `numerical` uses its matrix.
    pub numerical: NumericalSettings,
    /// Factor on the weight of all earlier runs when a run is taken in, for parameters that drift; one, or zero, forgets nothing.
    pub forgetting: f64,
}

impl Settings {
    /// Whether earlier runs lose weight, so that parameters that drift are followed.
    pub(crate) fn forgets(&self) -> bool {
        self.forgetting > 0.0 && self.forgetting < 1.0
    }

    /// Share of its weight that a run has after `age` later ones.
    #[must_use]
    pub(super) fn memory(&self, age: usize) -> f64 {
        if self.forgets() { self.forgetting.powi(age as i32) } else { 1.0 }
    }
}

/// The harmonic equations of one record.
#[derive(Clone, Debug)]
pub struct MeasuredMotion {
    dims: Dims,
    fundamental: f64,
    /// Lines of B u, per row.
    drive: Lines,
    /// Lines of the known terms, per row.
    known: Lines,
    /// Lines of the regressors, per row and parameter.
    phi: Lines,
    /// Mean of B over the period, rows x inputs.
    map: DMatrix<f64>,
    driven: Vec<bool>,
    /// Power of the floor under the highest lines of B u, per row: where the spectrum of the input ends.
    floor: Vec<f64>,
    /// Covariance of the channels' noise per harmonic, hold corrected.
    noise: Vec<DMatrix<Complex<f64>>>,
    motion_harmonics: usize,
    jacobian: Jacobian,
    /// Used harmonics, per row, ascending.
    used: Vec<Vec<usize>>,
    tail: Option<Tail>,
    /// Noise variance of the rows' phasors by harmonic, where more is known than the channels' covariance says.
    refined: Option<Vec<Vec<f64>>>,
    /// Variance of the rows' phasors by harmonic that has nothing to do with the sensors' noise.
    apart: Vec<Vec<f64>>,
    /// Relative level of the white noise of every coordinate's sensor, where the noise is known to be that alone.
    white: Option<Vec<f64>>,
    /// The noise that the used equations have in common, where it is known.
    coupled: Option<Coupled>,
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
    /// [`EstimateError`].
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
            fundamental: spectra.fundamental,
            drive,
            known,
            phi,
            floor: (0..dims.rows)
                .map(|r| input_floor.iter().enumerate().map(|(i, f)| map[(r, i)] * map[(r, i)] * f).sum())
                .collect(),
            map,
            driven,
            noise,
            motion_harmonics,
            jacobian,
            used: Vec::new(),
            tail: None,
            refined: None,
            apart: vec![Vec::new(); dims.rows],
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
    pub(in crate::estimate) fn slots(&self) -> &[(usize, usize)] {
        &self.jacobian.slots
    }

    /// Mean factor of every input in a row.
    pub(in crate::estimate) fn input_map(&self, row: usize) -> Vec<f64> {
        self.map.row(row).iter().copied().collect()
    }

    /// Two-sided Fourier coefficients of d(row)/d(slot) along the period, per slot.
    pub(in crate::estimate) fn gains(&self, row: usize, theta: &[f64]) -> Vec<Vec<Complex<f64>>> {
        self.jacobian.gains(row, theta)
    }

    /// Variance of an equation that none of the others has a part in.
    fn error_apart(&self, row: usize, k: usize) -> f64 {
        self.apart[row].get(k).copied().unwrap_or(0.0)
    }

    /// Sets the noise variance of the rows' phasors, from harmonic 0 on, when it is that of the coordinates' sensors alone,
    /// whose levels relative to each other are given where it is white, and what every phasor has of its own besides.
    pub(in crate::estimate) fn set_variance(
        &mut self,
        variance: Vec<Vec<f64>>,
        apart: Vec<Vec<f64>>,
        white: Option<Vec<f64>>,
    ) {
        self.refined = Some(variance);
        self.apart = apart;
        self.white = white;
    }

    /// Takes the means of the driven rows in, with what noise adds to the mean of every regressor (and, last, of the known
    /// term); `uncertainty` is the standard deviation of a shift as a share of it.
    pub(in crate::estimate) fn admit_means(&mut self, shifts: &[Vec<f64>], theta: &[f64], uncertainty: f64) {
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

    /// Works out what noise the used equations have in common.
    pub(in crate::estimate) fn couple(&mut self) {
        self.coupled = Coupled::new(self);
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
        self.motion_harmonics
    }

    /// Lines of a row in which the input, or a regressor that is strong there, stands out of the noise.
    ///
    /// With `distortion`, also lines at which only the motion stands out.
    fn excited(&self, row: usize, limit: usize, reach: usize, distortion: bool) -> Vec<usize> {
        let p = self.dims.parameters;
        let peak = strongest(&self.drive[row]);
        let force = (0.5 * self.drive[row].iter().skip(1).map(Complex::norm_sqr).sum::<f64>()).sqrt();
        let peaks: Vec<f64> = (0..p).map(|j| strongest(&self.phi[row * p + j])).collect();
        let sizes: Vec<Vec<f64>> = (0..p).map(|j| self.size_jacobian(row * (p + 1) + j)).collect();
        let visible_lines = (0..=limit)
            .filter(|&k| {
                // Sensors have offsets: a mean counts when it is a part of the force, not when it is merely not zero.
                let drive = &self.drive[row];
                let around = &drive[k.saturating_sub(NEIGHBOURS).max(1)..drive.len().min(k + NEIGHBOURS + 1)];
                let near = around.iter().map(|z| z.norm()).fold(0.0, f64::max);
                let share = if k == 0 { MEAN_FORCE * force } else { DISTORTION * near };
                let substantial = drive[k].norm() > share;
                let floor = if k == 0 { self.floor[row] / 4.0 } else { self.floor[row] };
                let applied = self.driven[row]
                    && (k > 0 && k <= reach
                        || substantial && visible(drive[k], self.drive_variance(row, k).max(floor), peak));
                // An equation whose regressors are noise says nothing, and in strength biases.
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
                        && visible(line, self.column_variance(&sizes[j], k), peaks[j])
                })
            })
            .collect();
        without_stragglers(visible_lines, |k| {
            let noise = self.drive_variance(row, k).max(self.floor[row]);
            self.drive[row][k].norm() > SUBSTANTIAL * peak && self.drive[row][k].norm_sqr() > ALONE * noise
        })
    }

    /// Takes the mean into a row, or not: it carries the bias of terms that are even in velocity.
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

    /// The used equations, those of a row with one variance.
    fn equations(&self, variance: impl Fn(usize) -> f64) -> Equations {
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
    fn residuals(&self, row: usize, theta: &[f64]) -> Vec<Complex<f64>> {
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
    /// A free row has no input; its force is that of its terms, taken without their signs.
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

    /// Variances of the used equations that let every one count alike over the period, rows by the size of their force at theta.
    fn alike(&self, theta: &[f64]) -> Vec<f64> {
        let of_row = |(row, lines): (usize, &Vec<usize>)| {
            let (_, force) = self.row_power(row, theta);
            let line = if force > 0.0 { force * force } else { 1.0 };
            // The square of a mean has twice the share in the mean square that an amplitude's square has.
            lines.iter().map(|&k| if k == 0 { line / 4.0 } else { line }).collect::<Vec<f64>>()
        };
        self.used.iter().enumerate().flat_map(of_row).collect()
    }

    /// Cuts a tail that the model does not explain; true when there was one.
    fn cut_tail(&mut self, theta: &[f64], variance: &[Vec<f64>]) -> bool {
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
