//! Measured motion: inverse dynamics in the frequency domain.
//!
//! Invariant: the regressors are evaluated on the measured motion itself, with spectral derivatives over whole periods, and
//! their harmonics are equated with those of the applied input. Nothing is linearised about a reference, so that one run
//! without noise gives the parameters exactly, for any term (sin, sgn, products).
//!
//! Noise of the measured motion enters the regressors. It is followed to first order through the time-varying Jacobian of
//! the rows along the motion, which gives each harmonic equation its variance, and the bias it would leave in the normal
//! equations (errors in variables) is subtracted.

use super::select::{highest_visible, strongest, unexplained_tail, visible, without_stragglers};
use super::{Equations, Estimate, Information, Status};
use crate::harmonics::{Hold, Spectra, hold_factor};
use crate::model::{Dims, EvalError, Model};
use nalgebra::{Complex, DMatrix, RowDVector};
use realfft::RealFftPlanner;
use std::string::String;
use std::vec;
use std::vec::Vec;

/// Fewest points of a period at which the rows are evaluated.
const MIN_GRID: usize = 1024;
/// Most points of a period at which the rows are evaluated (terms that jump need many).
const MAX_GRID: usize = 32_768;
/// Harmonics of regressors that change by less than this share when the grid is doubled are taken for converged.
const GRID_TOLERANCE: f64 = 1e-9;
/// Most points of a period at which the Jacobian is evaluated.
const JACOBIAN_GRID: usize = 1024;
/// How far the floor under the highest lines must stand above the noise between them to be taken for a repeated error.
const REPEATED: f64 = 4.0;
/// A line of an input below this share of its neighbours is their distortion, not excitation.
const DISTORTION: f64 = 1e-3;
/// A line far above all others counts from this share of the strongest line on.
const SUBSTANTIAL: f64 = 0.1;
/// Lines on either side that count as neighbours.
const NEIGHBOURS: usize = 8;
/// The mean of an input is used from this share of its root mean square on.
const MEAN_FORCE: f64 = 0.01;
/// A deviation beyond this share of the value, and a visible share of the force, makes a parameter poorly determined.
const POOR: f64 = 0.25;
/// Smallest share of the force that counts in that judgement.
const POOR_FORCE: f64 = 0.01;

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
}

/// The harmonic equations of one record.
#[derive(Clone, Debug)]
pub struct MeasuredMotion {
    dims: Dims,
    fundamental: f64,
    /// Lines of B u, per row.
    drive: Vec<Vec<Complex<f64>>>,
    /// Lines of the known terms, per row.
    known: Vec<Vec<Complex<f64>>>,
    /// Lines of the regressors, per row and parameter.
    phi: Vec<Vec<Complex<f64>>>,
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
}

/// Harmonics that the model does not explain and that were therefore left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Tail {
    from: usize,
    to: usize,
}

/// d row / d slot along the period, slots being the coordinates' derivatives that the model uses.
#[derive(Clone, Debug)]
struct Jacobian {
    points: usize,
    /// (coordinate, derivative).
    slots: Vec<(usize, usize)>,
    /// `[slot][(row * (parameters + 1) + j) * points + i]`; j = parameters is the known term.
    values: Vec<Vec<f64>>,
}

impl Jacobian {
    fn series(&self, slot: usize, column: usize) -> &[f64] {
        &self.values[slot][column * self.points..(column + 1) * self.points]
    }
}

/// Phasors per signal, or per entry of a matrix, and harmonic.
type Lines = Vec<Vec<Complex<f64>>>;

/// Rows sampled along a period.
struct Sampled {
    points: usize,
    motion: Vec<f64>,
    phi: Vec<f64>,
    known: Vec<f64>,
    map: Vec<f64>,
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
        };
        this.used = (0..dims.rows).map(|r| this.excited(r, wanted, false)).collect();
        let rank = this.rank();
        if rank < dims.parameters {
            // A parameter may be visible only where the motion is distorted.
            let narrow = core::mem::take(&mut this.used);
            this.used = (0..dims.rows).map(|r| this.excited(r, wanted, true)).collect();
            if this.rank() == rank {
                this.used = narrow;
            }
        }
        let even = context.even_in_velocity(&sampled)?;
        this.decide_means(&even);
        Ok(this)
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
    fn excited(&self, row: usize, limit: usize, distortion: bool) -> Vec<usize> {
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
                let applied =
                    self.driven[row] && substantial && visible(drive[k], self.drive_variance(row, k).max(floor), peak);
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
        without_stragglers(visible_lines, |k| self.drive[row][k].norm() > SUBSTANTIAL * peak)
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
        let even: Vec<Vec<f64>> = self.used.iter().map(|u| vec![1.0; u.len()]).collect();
        let p = self.dims.parameters;
        let all: Vec<usize> = (0..p).collect();
        let (matrix, right) = self.equations(&even).weighted(&all);
        Information::of(&matrix, &right).solve(&vec![0.0; p], None).rank
    }

    fn equations(&self, variance: &[Vec<f64>]) -> Equations {
        let p = self.dims.parameters;
        let mut equations = Equations::new(p);
        let mut phi = vec![Complex::new(0.0, 0.0); p];
        for (row, lines) in self.used.iter().enumerate() {
            for (i, &k) in lines.iter().enumerate() {
                for (j, entry) in phi.iter_mut().enumerate() {
                    *entry = self.phi[row * p + j][k];
                }
                let right = self.drive[row][k] - self.known[row][k];
                equations.push(row, k, &phi, right, variance[row][i]);
            }
        }
        equations
    }

    fn drive_variance(&self, row: usize, k: usize) -> f64 {
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
    fn size_jacobian(&self, column: usize) -> Vec<f64> {
        (0..self.jacobian.slots.len())
            .map(|s| {
                let series = self.jacobian.series(s, column);
                series.iter().map(|x| x * x).sum::<f64>() / series.len().max(1) as f64
            })
            .collect()
    }

    /// About the noise that a column carries at a harmonic: enough to tell whether its line is more than noise.
    fn column_variance(&self, sizes: &[f64], k: usize) -> f64 {
        let turn = k as f64 * self.fundamental;
        self.jacobian
            .slots
            .iter()
            .zip(sizes)
            .map(|(&(c, d), size)| size * turn.powi(2 * d as i32) * self.noise[k][(c, c)].re)
            .sum()
    }

    /// Variance of every used equation's noise at theta, and the expectation of conj(regressor noise) times row noise.
    fn row_noise(&self, theta: &[f64]) -> (Vec<Vec<f64>>, Vec<Vec<Vec<f64>>>) {
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
                row_variance.push(total + (1e-14 * scale).powi(2) + f64::MIN_POSITIVE);
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
        cut
    }
}

/// Estimates the parameters from the pooled equations of one or several records of the same model.
///
/// The records' line selections are refined in place (a tail that the model does not explain is left out when the number
/// of harmonics was not given).
///
/// # Errors
/// [`EstimateError`].
pub fn estimate_measured_motion(
    records: &mut [MeasuredMotion],
    settings: &Settings,
) -> Result<Estimate, EstimateError> {
    let Some(dims) = records.first().map(|r| r.dims) else {
        return Err(EstimateError::NoSignal);
    };
    let mut estimate = solve_records(records, dims, settings)?;
    if settings.harmonics.is_none() {
        // Each cut lowers the median of what remains, so the loop is short; it ends at half of the lines at the latest.
        for _ in 0..8 {
            let mut cut = false;
            for record in records.iter_mut() {
                let (variance, _) = record.row_noise(&estimate.values);
                cut |= record.cut_tail(&estimate.values, &variance);
            }
            if !cut {
                break;
            }
            estimate = solve_records(records, dims, settings)?;
        }
    }
    Ok(estimate)
}

fn solve_records(records: &[MeasuredMotion], dims: Dims, settings: &Settings) -> Result<Estimate, EstimateError> {
    let p = dims.parameters;
    let mut start = settings.prior.clone();
    start.resize(p, 0.0);
    let mut free: Vec<usize> = (0..p).collect();
    for frozen in &settings.frozen {
        if frozen.parameter >= p {
            return Err(EstimateError::Frozen(frozen.parameter));
        }
        start[frozen.parameter] = frozen.value;
        free.retain(|&j| j != frozen.parameter);
    }
    if free.is_empty() && p > 0 {
        return Err(EstimateError::AllFrozen);
    }
    let prior_free: Vec<f64> = free.iter().map(|&j| start[j]).collect();

    let mut theta = start.clone();
    let mut model_error = vec![vec![0.0; dims.rows]; records.len()];
    let mut weights: Vec<Vec<Vec<f64>>> = records
        .iter()
        .map(|record| {
            (0..dims.rows)
                .map(|r| {
                    // The first pass weighs all lines of a row alike, rows by the size of their force.
                    let (_, force) = record.row_power(r, &vec![1.0; p]);
                    let size = if force > 0.0 { force * force } else { 1.0 };
                    record.used[r].iter().map(|_| size).collect()
                })
                .collect()
        })
        .collect();
    let mut gradient = vec![0.0; free.len()];
    let mut information = Information::empty(free.len());
    let mut solution = information.solve(&prior_free, None);
    let mut equations_total = 0;
    for pass in 0..12 {
        information = Information::empty(free.len());
        equations_total = 0;
        for (record, variance) in records.iter().zip(&weights) {
            let mut equations = record.equations(variance);
            for e in 0..equations.len() {
                for frozen in &settings.frozen {
                    let part = equations.regressor(e)[frozen.parameter] * frozen.value;
                    equations.right[e] -= part;
                }
            }
            equations_total += equations.real_len();
            let (matrix, right) = equations.weighted(&free);
            information = information.pool(&Information::of(&matrix, &right));
        }
        let correction = (pass > 0).then_some(gradient.as_slice());
        solution = information.solve(&prior_free, correction);
        let before = theta.clone();
        for (&j, &value) in free.iter().zip(&solution.values) {
            theta[j] = value;
        }
        let moved = free
            .iter()
            .map(|&j| (theta[j] - before[j]).abs() - 1e-9 * theta[j].abs())
            .fold(f64::NEG_INFINITY, f64::max);
        if pass > 2 && moved <= 0.0 {
            break;
        }
        gradient.fill(0.0);
        let share = 1.0 - (solution.rank as f64 / equations_total.max(1) as f64).min(1.0);
        for (i, record) in records.iter().enumerate() {
            let (mut variance, bias) = record.row_noise(&theta);
            for row in 0..dims.rows {
                let residual = record.residuals(row, &theta);
                let error = excess(&residual, &variance[row], &record.used[row], share);
                model_error[i][row] = error;
                for (v, &k) in variance[row].iter_mut().zip(&record.used[row]) {
                    *v += if k == 0 { error / 4.0 } else { error };
                }
                for ((v, &k), parts) in variance[row].iter().zip(&record.used[row]).zip(&bias[row]) {
                    let weight = if k == 0 { 1.0 } else { 2.0 } / v;
                    for (g, &j) in gradient.iter_mut().zip(&free) {
                        *g -= weight * parts[j];
                    }
                }
            }
            weights[i] = variance;
        }
    }

    let freedom = equations_total.saturating_sub(solution.rank);
    let chi_squared = if freedom > 0 { solution.remainder / freedom as f64 } else { 0.0 };
    // Noise read between the lines may miss errors that repeat in every period; the residuals then show them.
    let inflation = chi_squared.max(1.0);
    let mut covariance = DMatrix::zeros(p, p);
    for (a, &i) in free.iter().enumerate() {
        for (b, &j) in free.iter().enumerate() {
            covariance[(i, j)] = solution.covariance[(a, b)] * inflation;
        }
    }
    let mut unobservable = Vec::new();
    for direction in &solution.unobservable {
        let mut full = vec![0.0; p];
        for (&j, &part) in free.iter().zip(direction) {
            full[j] = part;
        }
        unobservable.push(full);
    }
    let norms = information.column_norms();
    let scales: Vec<f64> = norms.iter().map(|n| if *n > 0.0 { *n } else { 1.0 }).collect();
    let touched = Information::touched(&solution.unobservable, &scales);
    let (residual, _) = pooled_residual(records, &theta);
    let mut std = vec![0.0; p];
    let mut status = vec![Status::Frozen; p];
    for (a, &j) in free.iter().enumerate() {
        if touched[a] {
            std[j] = f64::INFINITY;
            status[j] = Status::Unobservable;
            continue;
        }
        std[j] = covariance[(j, j)].max(0.0).sqrt();
        let uncertain_force = records.iter().map(|record| record.force_share(j, std[j])).fold(0.0, f64::max);
        status[j] = if std[j] > POOR * theta[j].abs() && uncertain_force > POOR_FORCE {
            Status::PoorlyDetermined
        } else {
            Status::Identified
        };
    }
    Ok(Estimate {
        values: theta,
        std,
        covariance,
        status,
        rank: solution.rank,
        unobservable,
        condition: solution.condition,
        residual,
        chi_squared,
        model_error: (0..dims.rows).map(|r| model_error.iter().map(|e| e[r].sqrt()).fold(0.0, f64::max)).collect(),
    })
}

/// Residual of all records as a share of the force: root mean square over rows and records of each one's share.
fn pooled_residual(records: &[MeasuredMotion], theta: &[f64]) -> (f64, usize) {
    let (mut sum, mut rows) = (0.0, 0);
    for record in records {
        for row in 0..record.dims.rows {
            let (residual, force) = record.row_power(row, theta);
            if force > 0.0 {
                sum += (residual / force).powi(2);
                rows += 1;
            }
        }
    }
    ((sum / f64::from(rows.max(1))).sqrt(), rows as usize)
}

impl MeasuredMotion {
    /// Largest share of a row's force that a change of one parameter makes.
    fn force_share(&self, parameter: usize, change: f64) -> f64 {
        let p = self.dims.parameters;
        (0..self.dims.rows)
            .map(|row| {
                let (mut part, mut force) = (0.0, 0.0);
                for &k in &self.used[row] {
                    let share = if k == 0 { 1.0 } else { 0.5 };
                    part += share * (self.phi[row * p + parameter][k] * change).norm_sqr();
                    force += share
                        * if self.driven[row] {
                            self.drive[row][k].norm_sqr()
                        } else {
                            self.phi[row * p + parameter][k].norm_sqr()
                        };
                }
                if force > 0.0 { (part / force).sqrt() } else { 0.0 }
            })
            .fold(0.0, f64::max)
    }
}

/// Power per harmonic that residuals show beyond the stated noise: the maximum of the likelihood of a flat addition.
///
/// Maximum likelihood, not a moment: lines with much noise say little about a small addition, and must not drown the lines
/// with little noise in it. `share` is the degrees of freedom that the fit left, per equation.
fn excess(residual: &[Complex<f64>], variance: &[f64], harmonics: &[usize], share: f64) -> f64 {
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

/// Input lines and channel noise with the hold taken into account.
fn hold_corrected(spectra: &Spectra, dims: Dims, hold: Hold) -> (Lines, Vec<DMatrix<Complex<f64>>>) {
    let factor = |k: usize| match hold {
        Hold::None => Complex::new(1.0, 0.0),
        Hold::Zoh => {
            let (re, im) = hold_factor(k as f64 * spectra.fundamental * spectra.sample_time);
            Complex::new(re, im)
        }
    };
    let inputs = (0..dims.inputs)
        .map(|i| spectra.lines[dims.coordinates + i].iter().enumerate().map(|(k, line)| line * factor(k)).collect())
        .collect();
    // An input is what was applied, counts and all; only a coordinate's floor is an error of its measurement.
    let floors: Vec<Option<f64>> = (0..spectra.lines.len()).map(|c| spectra.floor(c)).collect();
    let noise = spectra
        .noise
        .iter()
        .enumerate()
        .map(|(k, covariance)| {
            let mut corrected = covariance.clone();
            for (c, floor) in floors.iter().enumerate() {
                // A mean has a quarter of the variance of a phasor. Both numbers estimate the same noise unless it
                // repeats; taking the larger one always would be biased.
                let repeated = floor.map_or(0.0, |f| if k == 0 { f / 4.0 } else { f });
                let judged = c < dims.coordinates || spectra.noise_bins == 0;
                if judged && REPEATED * corrected[(c, c)].re < repeated {
                    corrected[(c, c)] = Complex::new(repeated, 0.0);
                }
            }
            for i in dims.coordinates..dims.coordinates + dims.inputs {
                let f = factor(k);
                corrected.row_mut(i).iter_mut().for_each(|z| *z *= f);
                corrected.column_mut(i).iter_mut().for_each(|z| *z *= f.conj());
            }
            corrected
        })
        .collect();
    (inputs, noise)
}

/// Values of one period of a signal, or of its derivative, at `points` even times.
fn synthesise(
    planner: &mut RealFftPlanner<f64>,
    lines: &[Complex<f64>],
    derivative: usize,
    fundamental: f64,
    harmonics: usize,
    points: usize,
) -> Vec<f64> {
    let transform = planner.plan_fft_inverse(points);
    let mut spectrum = transform.make_input_vec();
    for (k, slot) in spectrum.iter_mut().enumerate().take(harmonics.min(points / 2 - 1) + 1) {
        let Some(&line) = lines.get(k) else { break };
        *slot = if k == 0 {
            if derivative == 0 { Complex::new(line.re, 0.0) } else { Complex::new(0.0, 0.0) }
        } else {
            line * 0.5 * Complex::new(0.0, k as f64 * fundamental).powu(derivative as u32)
        };
    }
    let mut out = transform.make_output_vec();
    transform
        .process(&mut spectrum, &mut out)
        .expect("invariant: the mean is real and the buffers were made for this transform");
    out
}

/// One-sided phasors 0 to `harmonics` of a period sampled evenly, every `stride`-th value from `offset`.
fn analyse(
    planner: &mut RealFftPlanner<f64>,
    values: &[f64],
    offset: usize,
    stride: usize,
    harmonics: usize,
) -> Vec<Complex<f64>> {
    let mut series: Vec<f64> = values.iter().skip(offset).step_by(stride).copied().collect();
    let points = series.len();
    let transform = planner.plan_fft_forward(points);
    let mut spectrum = transform.make_output_vec();
    transform.process(&mut series, &mut spectrum).expect("invariant: buffers were made for this transform");
    let scale = 1.0 / points as f64;
    (0..=harmonics)
        .map(|k| match spectrum.get(k) {
            Some(z) if k == 0 => z * scale,
            Some(z) => z * (2.0 * scale),
            None => Complex::new(0.0, 0.0),
        })
        .collect()
}

/// Lines of B u per row, and the mean of B.
fn drive_lines(dims: Dims, sampled: &Sampled, inputs: &[Vec<Complex<f64>>], harmonics: usize) -> (Lines, DMatrix<f64>) {
    let size = dims.input_map_len();
    let mut mean = DMatrix::zeros(dims.rows, dims.inputs);
    let mut constant = true;
    if size > 0 {
        for sample in sampled.map.chunks_exact(size) {
            mean += DMatrix::from_row_slice(dims.rows, dims.inputs, sample);
            constant &= sample == &sampled.map[..size];
        }
        mean /= sampled.points as f64;
    }
    if constant {
        if size > 0 {
            mean = DMatrix::from_row_slice(dims.rows, dims.inputs, &sampled.map[..size]);
        }
        let drive = (0..dims.rows)
            .map(|r| {
                (0..=harmonics)
                    .map(|k| {
                        (0..dims.inputs).map(|i| inputs[i].get(k).copied().unwrap_or_default() * mean[(r, i)]).sum()
                    })
                    .collect()
            })
            .collect();
        return (drive, mean);
    }
    let mut planner = RealFftPlanner::new();
    let waves: Vec<Vec<f64>> =
        inputs.iter().map(|lines| synthesise(&mut planner, lines, 0, 1.0, lines.len() - 1, sampled.points)).collect();
    let drive = (0..dims.rows)
        .map(|r| {
            let product: Vec<f64> = sampled
                .map
                .chunks_exact(size)
                .enumerate()
                .map(|(i, map)| {
                    let row = RowDVector::from_row_slice(&map[r * dims.inputs..(r + 1) * dims.inputs]);
                    row.iter().zip(&waves).map(|(b, wave)| b * wave[i]).sum()
                })
                .collect();
            analyse(&mut planner, &product, 0, 1, harmonics)
        })
        .collect();
    (drive, mean)
}

/// What the sampling of a model along a record needs.
struct Context<'a> {
    model: &'a dyn Model<f64>,
    dims: Dims,
    constants: &'a [f64],
    spectra: &'a Spectra,
    motion_harmonics: usize,
}

impl Context<'_> {
    /// Samples the rows on a grid that is doubled until their harmonics no longer change.
    fn converge(&self, harmonics: usize, grid: Option<usize>) -> Result<(Sampled, Lines, Lines), EstimateError> {
        let least = 2 * (self.motion_harmonics.max(harmonics) + 1);
        if let Some(points) = grid {
            let sampled = self.sample(points.max(least))?;
            let (phi, known) = self.columns(&sampled, 1, harmonics);
            return Ok((sampled, phi, known));
        }
        let mut points = (2 * least).next_power_of_two().max(MIN_GRID);
        loop {
            let sampled = self.sample(points)?;
            let (phi, known) = self.columns(&sampled, 1, harmonics);
            if points >= MAX_GRID {
                return Ok((sampled, phi, known));
            }
            let (coarse_phi, coarse_known) = self.columns(&sampled, 2, harmonics);
            let settled = phi.iter().zip(&coarse_phi).chain(known.iter().zip(&coarse_known)).all(|(fine, coarse)| {
                let peak = fine.iter().map(|z| z.norm()).fold(0.0, f64::max);
                fine.iter().zip(coarse).all(|(a, b)| (a - b).norm() <= GRID_TOLERANCE * peak)
            });
            if settled {
                return Ok((sampled, phi, known));
            }
            points *= 2;
        }
    }

    fn columns(&self, sampled: &Sampled, stride: usize, harmonics: usize) -> (Lines, Lines) {
        let mut planner = RealFftPlanner::new();
        let take = |planner: &mut RealFftPlanner<f64>, values: &[f64], width: usize, at: usize| {
            analyse(planner, values, at, width * stride, harmonics)
        };
        let size = self.dims.regressor_len();
        let phi = (0..size).map(|e| take(&mut planner, &sampled.phi, size, e)).collect();
        let known = (0..self.dims.rows).map(|r| take(&mut planner, &sampled.known, self.dims.rows, r)).collect();
        (phi, known)
    }

    fn sample(&self, points: usize) -> Result<Sampled, EstimateError> {
        let points = points + points % 2;
        let dims = self.dims;
        let mut planner = RealFftPlanner::new();
        let mut motion = vec![0.0; points * dims.motion_len()];
        for c in 0..dims.coordinates {
            for d in 0..=self.model.coordinate_order(c) {
                let wave = synthesise(
                    &mut planner,
                    &self.spectra.lines[c],
                    d,
                    self.spectra.fundamental,
                    self.motion_harmonics,
                    points,
                );
                let slot = d * dims.coordinates + c;
                for (i, value) in wave.iter().enumerate() {
                    motion[i * dims.motion_len() + slot] = *value;
                }
            }
        }
        let mut phi = vec![0.0; points * dims.regressor_len()];
        let mut known = vec![0.0; points * dims.rows];
        let mut map = vec![0.0; points * dims.input_map_len()];
        let mut scratch = vec![0.0; self.model.workspace_len()];
        for i in 0..points {
            let now = &motion[i * dims.motion_len()..(i + 1) * dims.motion_len()];
            self.model.regressor(
                now,
                self.constants,
                &mut scratch,
                &mut phi[i * dims.regressor_len()..(i + 1) * dims.regressor_len()],
            )?;
            self.model.known(now, self.constants, &mut scratch, &mut known[i * dims.rows..(i + 1) * dims.rows])?;
            self.model.input_map(
                now,
                self.constants,
                &mut scratch,
                &mut map[i * dims.input_map_len()..(i + 1) * dims.input_map_len()],
            )?;
        }
        if let Some(at) = phi.iter().position(|x| !x.is_finite()) {
            let entry = at % dims.regressor_len();
            return Err(self.not_finite(entry / dims.parameters, self.model.parameter(entry % dims.parameters).name));
        }
        if let Some(at) = known.iter().position(|x| !x.is_finite()) {
            return Err(self.not_finite(at % dims.rows, "a term without an unknown parameter"));
        }
        if let Some(at) = map.iter().position(|x| !x.is_finite()) {
            return Err(self.not_finite(at % dims.input_map_len() / dims.inputs, "the input's factor"));
        }
        Ok(Sampled { points, motion, phi, known, map })
    }

    fn not_finite(&self, row: usize, what: &str) -> EstimateError {
        EstimateError::NotFinite { row: self.model.row(row).name.into(), what: what.into() }
    }

    fn jacobian(&self, sampled: &Sampled) -> Result<Jacobian, EstimateError> {
        let dims = self.dims;
        let slots: Vec<(usize, usize)> =
            (0..dims.coordinates).flat_map(|c| (0..=self.model.coordinate_order(c)).map(move |d| (c, d))).collect();
        let mut stride = 1;
        while sampled.points / stride > JACOBIAN_GRID && (sampled.points / stride).is_multiple_of(2) {
            stride *= 2;
        }
        let points = sampled.points / stride;
        let width = dims.parameters + 1;
        let mut scratch = vec![0.0; self.model.workspace_len()];
        let mut values = Vec::with_capacity(slots.len());
        let mut side = [
            (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows]),
            (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows]),
        ];
        for &(c, d) in &slots {
            let slot = d * dims.coordinates + c;
            let power = sampled.motion.chunks_exact(dims.motion_len()).map(|m| m[slot] * m[slot]).sum::<f64>()
                / sampled.points as f64;
            let step = if power > 0.0 { 1e-3 * power.sqrt() } else { 1e-3 };
            let mut series = vec![0.0; dims.rows * width * points];
            for i in 0..points {
                let at = i * stride * dims.motion_len();
                let mut now = sampled.motion[at..at + dims.motion_len()].to_vec();
                let centre = now[slot];
                for (sign, (phi, known)) in [1.0, -1.0].iter().zip(side.iter_mut()) {
                    now[slot] = centre + sign * step;
                    self.model.regressor(&now, self.constants, &mut scratch, phi)?;
                    self.model.known(&now, self.constants, &mut scratch, known)?;
                }
                for r in 0..dims.rows {
                    for j in 0..width {
                        let difference = if j == dims.parameters {
                            side[0].1[r] - side[1].1[r]
                        } else {
                            side[0].0[r * dims.parameters + j] - side[1].0[r * dims.parameters + j]
                        };
                        series[(r * width + j) * points + i] = difference / (2.0 * step);
                    }
                }
            }
            values.push(series);
        }
        Ok(Jacobian { points, slots, values })
    }

    /// Per row: a term depends on velocities (odd derivatives) and does not change when all of them change sign.
    fn even_in_velocity(&self, sampled: &Sampled) -> Result<Vec<bool>, EstimateError> {
        let dims = self.dims;
        let p = dims.parameters;
        let mut scratch = vec![0.0; self.model.workspace_len()];
        let mut flipped = vec![0.0; dims.regressor_len()];
        let mut still = vec![0.0; dims.regressor_len()];
        let (mut odd_part, mut moving_part) = (vec![0.0_f64; flipped.len()], vec![0.0_f64; flipped.len()]);
        let stride = (sampled.points / 64).max(1);
        for i in (0..sampled.points).step_by(stride) {
            let mut now = sampled.motion[i * dims.motion_len()..(i + 1) * dims.motion_len()].to_vec();
            let phi = &sampled.phi[i * flipped.len()..(i + 1) * flipped.len()];
            for (slot, value) in now.iter_mut().enumerate() {
                if (slot / dims.coordinates) % 2 == 1 {
                    *value = -*value;
                }
            }
            self.model.regressor(&now, self.constants, &mut scratch, &mut flipped)?;
            for (slot, value) in now.iter_mut().enumerate() {
                if (slot / dims.coordinates) % 2 == 1 {
                    *value = 0.0;
                }
            }
            self.model.regressor(&now, self.constants, &mut scratch, &mut still)?;
            for e in 0..phi.len() {
                odd_part[e] = odd_part[e].max((phi[e] - flipped[e]).abs());
                moving_part[e] = moving_part[e].max((phi[e] - still[e]).abs());
            }
        }
        Ok((0..dims.rows)
            .map(|r| (r * p..(r + 1) * p).any(|e| moving_part[e] > 0.0 && odd_part[e] <= 1e-9 * moving_part[e]))
            .collect())
    }
}
