//! Estimators from the harmonics of the tracking error: `error`, `effort` and `hill` (Feng, Eqns 3.22 and 4.29, with the
//! exact phase).
//!
//! The machine was driven by `u = f + C`, feed-forward f with the estimates theta' and feedback C of the measured error e.
//! Linearised about the reference, `Phi(q) theta = Phi(q_r) theta + J e`, and harmonic by harmonic
//!
//! ```text
//! B Lambda theta = hold (f - C E) - known - J(theta') E ,
//! ```
//!
//! with B Lambda from the exact table, where the reference has one (hold is one where inputs are not held). The estimators
//! differ in J: they take nothing of it (`effort`), its mean along the reference, which is the linear part of the rows (`error`;
//! dividing by `H^-1 = J + hold C` gives Feng's `E = H B Lambda P`, P = theta' - theta), or its periodic whole (`hill`). Invariant: a fixed point of the update is the true
//! theta for all three when the machine obeys the model, since J is multiplied by an error that then vanishes.

use crate::along::Along;
use crate::equations::Equations;
use crate::error::EstimateError;
use crate::run::error_lines;
use crate::table::RowLines;
use num_complex::Complex;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{Dims, Model};
use tpm_motion::trajectory::{HarmonicSeries, Trajectory};
use tpm_motion::{Spectra, Trial, held};
use tpm_numerics::DMatrix;
use tpm_numerics::fourier::analyse;
use tpm_numerics::{alarm, tolerance};

/// How much of the rows' dependence on the error is taken into account.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum FirstOrder {
    /// Nothing: the feedback's effort alone is compared with B Lambda theta.
    Effort,
    /// The mean of the rows' derivatives: the linear terms, with their phase.
    Error,
    /// The periodic derivatives, which couple the harmonics.
    Hill,
}

/// The harmonic equations of one run before the parameters of its feed-forward are put in: `B Lambda theta = applied - felt theta'`.
#[derive(Clone, Debug)]
pub(super) struct Reduced {
    /// `B Lambda theta = right`, without the response to the error on the right, and the variances of the noise.
    pub(super) equations: Equations,
    /// What was applied, less the known terms along the reference.
    applied: Vec<Complex<f64>>,
    /// Response of the rows to the tracking error, equation by equation: per parameter of value one and, last, of the known term.
    felt: Vec<Complex<f64>>,
    /// The part of `felt` that comes from the lines of the error that stand out of their noise.
    certain: Vec<Complex<f64>>,
    /// What `certain` leaves out of the rows along the measured motion, laid out as `felt`.
    missed: Vec<Complex<f64>>,
    /// Square of the size of `H^-1`: what an error of one makes of an equation.
    size: Vec<f64>,
    /// Variance of the part of every equation's error that other runs of the same motion repeat.
    repeated: Vec<f64>,
    /// theta', the parameters of the feed-forward.
    pub(super) parameters: Vec<f64>,
    /// The reference, and the coordinates that it leaves open.
    reference: (Trajectory, Vec<usize>),
}

impl Reduced {
    /// The equations where the parameters are about `theta`, with the variances of the noise and of what the linearisation leaves out.
    ///
    /// The latest run is linearised at the parameters of its feed-forward. In an earlier run the response to the error is taken for every
    /// parameter by itself, as a part of its regressor: as far as its lines stand out of their noise, so that noise is no regressor. What the
    /// linearisation leaves out of these lines is then a part of the regressor too. It has one sign in every campaign that begins alike: as
    /// a variance it would leave a bias of several spreads.
    ///
    /// An error that so many `others` repeat does not average out: it counts in each run as often as there are runs.
    pub(super) fn weighted(&self, theta: &[f64], latest: bool, others: usize) -> Equations {
        let mut equations = self.linearised(theta, latest).0;
        for (variance, repeated) in equations.variance.iter_mut().zip(&self.repeated) {
            *variance += others as f64 * repeated;
        }
        equations
    }

    /// Whether two runs have one reference. Open coordinates are not compared: their reference follows from the parameters.
    pub(super) fn repeats(&self, other: &Self) -> bool {
        self.reference.0.prescribes_as(&other.reference.0, &other.reference.1)
    }

    /// Sets the variance of the noise of the first `count` equations, and that of what other runs repeat, by row and harmonic.
    pub(super) fn set_noise(&mut self, count: usize, variance: &[Vec<f64>], repeated: &[Vec<f64>]) {
        self.equations.set_variance(count, variance);
        let places = self.equations.row.iter().zip(&self.equations.harmonic).take(count);
        for (slot, (&row, &harmonic)) in self.repeated.iter_mut().zip(places) {
            *slot = repeated.get(row).and_then(|of_row| of_row.get(harmonic)).copied().unwrap_or(0.0);
        }
    }

    /// Whether the noise of the equations is larger than what the linearisation leaves out where the parameters are `theta`.
    pub(super) fn is_of_noise(&self, theta: &[f64]) -> bool {
        let missing = self.linearised(theta, true).1;
        let share = |e: usize| missing[self.equations.row[e]] * self.size[e] / self.equations.variance[e];
        let lines = self.equations.len();
        let mean = (0..lines).map(|e| share(e).min(f64::from(u16::MAX))).sum::<f64>() / lines.max(1) as f64;
        mean <= 1.0
    }

    /// The equations, and what the linearisation leaves out row by row as the variance of an error.
    fn linearised(&self, theta: &[f64], latest: bool) -> (Equations, Vec<f64>) {
        let mut equations = self.equations.clone();
        let width = theta.len() + 1;
        let factors: Vec<f64> = theta.iter().copied().chain([1.0]).collect();
        let mut largest = vec![0.0_f64; equations.row.iter().max().map_or(0, |row| row + 1)];
        for e in 0..equations.len() {
            let of = e * width..(e + 1) * width;
            let [felt, certain, missed] = [&self.felt, &self.certain, &self.missed].map(|lines| &lines[of.clone()]);
            if latest {
                equations.right[e] = self.applied[e] - sum(felt, self.parameters.iter().chain(&[1.0]));
                let steps = theta.iter().zip(&self.parameters).map(|(to, from)| to - from);
                let missing = sum(missed, &factors)
                    + felt.iter().zip(steps).map(|(felt, step)| felt * step).sum::<Complex<f64>>();
                let slot = &mut largest[equations.row[e]];
                *slot = slot.max(missing.norm_sqr() / self.size[e]);
            } else {
                // The regressors take what the right-hand side had, and what the linearisation leaves out.
                equations.right[e] = self.applied[e] - sum(felt, &factors) + sum(certain, theta) - missed[theta.len()];
                let regressors = &mut equations.regressors[e * theta.len()..(e + 1) * theta.len()];
                let whole = certain.iter().zip(missed).map(|(felt, missed)| felt + missed);
                regressors.iter_mut().zip(whole).for_each(|(phi, felt)| *phi += felt);
            }
        }
        for (e, variance) in equations.variance.iter_mut().enumerate() {
            *variance += largest[equations.row[e]] * self.size[e];
        }
        (equations, largest)
    }

    /// Sum of squares of the tracking error, as far as the equations show it, and of the noise in it.
    pub(super) fn tracking(&self) -> (f64, f64) {
        let equations = self.linearised(&self.parameters, true).0;
        (0..equations.len()).fold((0.0, 0.0), |(error, noise), e| {
            let of_error = equations.residual(e, &self.parameters).norm_sqr();
            (error + of_error / self.size[e], noise + self.equations.variance[e] / self.size[e])
        })
    }

    /// Adds further equations of the same run.
    pub(super) fn append(&mut self, mut others: Self) {
        self.equations.append(others.equations);
        self.applied.append(&mut others.applied);
        self.felt.append(&mut others.felt);
        self.certain.append(&mut others.certain);
        self.missed.append(&mut others.missed);
        self.size.append(&mut others.size);
        self.repeated.append(&mut others.repeated);
    }

    /// Shifts the means of the regressors and of the known term as noise does: `shifts` has, per row, one number for every
    /// parameter and, last, for the known term. `uncertainty` is the standard deviation of the whole shift at the parameters
    /// theta, as a share of it.
    pub(super) fn shift_means(&mut self, shifts: &[Vec<f64>], theta: &[f64], uncertainty: f64) {
        for (e, applied) in self.applied.iter_mut().enumerate() {
            if self.equations.harmonic[e] == 0
                && let Some(shift) = shifts.get(self.equations.row[e])
            {
                *applied -= self.equations.shift_mean(e, shift, theta, uncertainty);
            }
        }
    }
}

/// Sum of lines times real factors.
fn sum<'f>(lines: &[Complex<f64>], factors: impl IntoIterator<Item = &'f f64>) -> Complex<f64> {
    lines.iter().zip(factors).map(|(line, factor)| line * factor).sum()
}

impl FirstOrder {
    /// The harmonic equations of one run: `spectra` has the measured coordinates as its first channels, over whole periods
    /// that start at the phase zero of the trial; `hold` is how the inputs became forces.
    ///
    /// # Errors
    /// [`EstimateError::Channels`] when spectra or trial do not fit the model, [`EstimateError::NoSignal`] when the record does
    /// not resolve a harmonic.
    pub(super) fn reduce(
        self,
        model: &dyn Model<f64>,
        trial: &Trial,
        along: &Along,
        spectra: &Spectra,
        hold: Hold,
        harmonics: usize,
    ) -> Result<Reduced, EstimateError> {
        let Dims { coordinates, inputs, .. } = along.dims;
        let highest = highest(trial, along, spectra, coordinates, harmonics)?;
        if highest == 0 {
            return Err(EstimateError::NoSignal);
        }
        let error = error_lines(trial, spectra, coordinates, 2 * highest);
        let forward = feed_forward_lines(trial, inputs, highest);
        self.assemble(model, trial, along, (&error, &spectra.noise), (0, highest), |row, k, linear, right| {
            let frequency = k as f64 * along.frequency;
            for (i, lines) in forward.iter().enumerate() {
                *right += trial.control.drive(i, frequency, hold) * along.map[row * inputs + i] * lines[k];
            }
            let mut gain = fed_back(trial, along, hold, row, k);
            *right -= gain.iter().zip(&error).map(|(g, e)| g * e[k]).sum::<Complex<f64>>();
            // Noise passes through H^-1, whatever part of J an estimator takes into its equation; `effort` weighs by the loop alone.
            if self != FirstOrder::Effort {
                for (gain, linear) in gain.iter_mut().zip(linear) {
                    *gain += linear;
                }
            }
            Driven { size: gain.iter().map(Complex::norm_sqr).sum(), through: gain }
        })
    }

    /// The harmonic equations of a run whose rates were measured (Feng, 3.4: the velocity error as further data): with the
    /// inputs as they were applied, since the feedback need not have seen the positions alone, from harmonic `least` on.
    ///
    /// `spectra` has the coordinates, measured or integrated from their measured rates, as its first channels, then the inputs.
    /// Rate and position have sensors, and noise, of their own, so that both sets of equations count.
    ///
    /// # Errors
    /// [`EstimateError::Channels`] when spectra or trial do not fit the model, [`EstimateError::Model`] when the model refuses an
    /// evaluation.
    pub(super) fn reduce_applied(
        self,
        model: &dyn Model<f64>,
        trial: &Trial,
        along: &Along,
        spectra: &Spectra,
        hold: Hold,
        (least, harmonics): (usize, usize),
    ) -> Result<Reduced, EstimateError> {
        let Dims { coordinates, inputs, .. } = along.dims;
        let highest = highest(trial, along, spectra, coordinates + inputs, harmonics)?;
        let mut error = error_lines(trial, spectra, coordinates, 2 * highest);
        for lines in &mut error {
            // A rate does not show the mean of its coordinate.
            for line in lines.iter_mut().take(least) {
                *line = Complex::new(0.0, 0.0);
            }
        }
        self.assemble(model, trial, along, (&error, &spectra.noise), (least, highest), |row, k, linear, right| {
            // Noise enters by the coordinates, and by the inputs, into which the loop feeds it back.
            let mut through: Vec<Complex<f64>> = linear.iter().map(|j| -j).collect();
            let held = held(hold, k as f64 * along.frequency * trial.control.sample_time);
            for i in 0..inputs {
                let map = held * along.map[row * inputs + i];
                *right += map * spectra.lines[coordinates + i][k];
                through.push(map);
            }
            let gain = fed_back(trial, along, hold, row, k);
            Driven { size: gain.iter().zip(linear).map(|(gain, j)| (gain + j).norm_sqr()).sum(), through }
        })
    }

    /// The equations of harmonics `least` to `highest`. `drive` is given a row, a harmonic, the row's linear response there, and
    /// the right-hand side, to which it adds the inputs.
    fn assemble(
        self,
        model: &dyn Model<f64>,
        trial: &Trial,
        along: &Along,
        (error, noise): (&[Lines], &[Covariance]),
        (least, highest): (usize, usize),
        drive: impl Fn(usize, usize, &[Complex<f64>], &mut Complex<f64>) -> Driven,
    ) -> Result<Reduced, EstimateError> {
        let dims = along.dims;
        let peak = error.iter().flatten().map(|line| line.norm()).fold(0.0, f64::max);
        let width = dims.parameters + 1;
        let mut reduced = Reduced {
            equations: Equations::new(dims.parameters),
            applied: Vec::new(),
            felt: Vec::new(),
            certain: Vec::new(),
            missed: Vec::new(),
            size: Vec::new(),
            repeated: Vec::new(),
            parameters: trial.parameters.clone(),
            reference: (trial.trajectory.clone(), trial.open.clone()),
        };
        let mut phi = vec![Complex::new(0.0, 0.0); dims.parameters];
        let certain = certain(error, noise);
        let displaced = displaced(&trial.trajectory, &certain);
        let RowLines { regressors, known } = Along::lines(model, &trial.constants, &displaced, highest)?;
        for (row, displaced) in known.iter().enumerate() {
            let felt = self.felt(along, row, error, highest);
            let foreseen = self.felt(along, row, &certain, highest);
            for k in least..=highest {
                let linear = along.response(row, &trial.parameters, k);
                let mut applied = -along.known[row][k];
                let Driven { through, size } = drive(row, k, &linear, &mut applied);
                reduced.applied.push(applied);
                reduced.size.push(size);
                reduced.repeated.push(0.0);
                for j in 0..width {
                    let change = match regressors.get(row * dims.parameters + j).filter(|_| j < dims.parameters) {
                        Some(lines) => lines[k] - along.regressor(row, j)[k],
                        None => displaced[k] - along.known[row][k],
                    };
                    reduced.felt.push(felt[j][k]);
                    reduced.certain.push(foreseen[j][k]);
                    reduced.missed.push(change - foreseen[j][k]);
                }
                for (j, entry) in phi.iter_mut().enumerate() {
                    *entry = along.regressor(row, j)[k];
                }
                let mut variance = f64::MIN_POSITIVE;
                for (a, x) in through.iter().enumerate() {
                    for (b, y) in through.iter().enumerate() {
                        variance += (x * noise[k][(a, b)] * y.conj()).re;
                    }
                    if a < dims.coordinates {
                        variance += x.norm_sqr() * (tolerance::READING * peak).powi(2);
                    }
                }
                reduced.equations.push(row, k, &phi, applied, variance);
            }
        }
        Ok(reduced)
    }

    /// Lines 0 to `highest` of what the estimator takes of a row's response to an error: per parameter of value one and, last, of
    /// the known term.
    fn felt(self, along: &Along, row: usize, error: &[Vec<Complex<f64>>], highest: usize) -> Vec<Vec<Complex<f64>>> {
        let width = along.dims.parameters + 1;
        let one = |j: usize| -> Vec<f64> { (0..width).map(|i| f64::from(u8::from(i == j))).collect() };
        let of = |j: usize| match self {
            FirstOrder::Effort => vec![Complex::new(0.0, 0.0); highest + 1],
            FirstOrder::Error => (0..=highest).map(|k| along.mean_applied(row, j, k, error)).collect(),
            FirstOrder::Hill => along.applied(row, &one(j), error, highest),
        };
        (0..width).map(of).collect()
    }
}

/// The lines of one coordinate, by harmonic.
type Lines = Vec<Complex<f64>>;
/// The covariance of all channels' noise in one line.
type Covariance = DMatrix<Complex<f64>>;

/// What acts on a row at one harmonic.
struct Driven {
    /// The factor by which every channel's noise enters.
    through: Vec<Complex<f64>>,
    /// Square of the size of `H^-1`.
    size: f64,
}

/// The lines of an error that stand out of their noise.
fn certain(error: &[Vec<Complex<f64>>], noise: &[DMatrix<Complex<f64>>]) -> Vec<Vec<Complex<f64>>> {
    let of = |(c, lines): (usize, &Vec<Complex<f64>>)| {
        let stands = |k: usize, line: &Complex<f64>| {
            line.norm_sqr() > alarm::VISIBLE_LINE * noise.get(k).map_or(f64::INFINITY, |noise| noise[(c, c)].re)
        };
        let line = |(k, line): (usize, &Complex<f64>)| if stands(k, line) { *line } else { Complex::new(0.0, 0.0) };
        lines.iter().enumerate().map(line).collect()
    };
    error.iter().enumerate().map(of).collect()
}

/// A reference and an error together.
fn displaced(reference: &Trajectory, error: &[Vec<Complex<f64>>]) -> Trajectory {
    let mut displaced = reference.clone();
    for (series, lines) in displaced.coordinates.iter_mut().zip(error) {
        let error = HarmonicSeries::from_phasors(lines, |_, line| line.norm_sqr() > 0.0);
        series.mean += error.mean;
        series.lines.extend(error.lines);
    }
    displaced
}

/// The highest harmonic that is wanted, resolved and known along the reference.
fn highest(
    trial: &Trial,
    along: &Along,
    spectra: &Spectra,
    needed: usize,
    harmonics: usize,
) -> Result<usize, EstimateError> {
    let dims = along.dims;
    if spectra.lines.len() < needed || trial.parameters.len() != dims.parameters {
        let needed = dims.coordinates + dims.inputs;
        return Err(EstimateError::Channels { needed, given: spectra.lines.len() });
    }
    let kept = along.known.first().map_or(0, |lines| lines.len().saturating_sub(1));
    Ok(harmonics.min(spectra.highest()).min(kept))
}

/// What the feedback answers in a row to an error of one in every coordinate at a harmonic, with its sign turned.
pub(crate) fn fed_back(trial: &Trial, along: &Along, hold: Hold, row: usize, harmonic: usize) -> Vec<Complex<f64>> {
    let Dims { coordinates, inputs, .. } = along.dims;
    let frequency = harmonic as f64 * along.frequency;
    let mut gain = vec![Complex::new(0.0, 0.0); coordinates];
    for i in 0..inputs {
        let map = trial.control.drive(i, frequency, hold) * along.map[row * inputs + i];
        for (c, gain) in gain.iter_mut().enumerate() {
            *gain += map * trial.control.response(i, c, frequency);
        }
    }
    gain
}

/// Lines of the samples of every input's feed-forward.
pub fn feed_forward_lines(trial: &Trial, inputs: usize, highest: usize) -> Vec<Vec<Complex<f64>>> {
    (0..inputs).map(|i| analyse(&trial.feed_forward, i, inputs, highest)).collect()
}
