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

use crate::estimate::along::Along;
use crate::estimate::equations::Equations;
use crate::estimate::error::EstimateError;
use crate::estimate::noise::ROUNDING;
use crate::estimate::run::error_lines;
use crate::numerics::DMatrix;
use crate::numerics::fourier::analyse;
use crate::run::Spectra;
use crate::run::Trial;
use crate::run::held;
use num_complex::Complex;
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;
use tpm_core::model::Dims;

/// How much of the rows' dependence on the error is taken into account.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(in crate::estimate) enum FirstOrder {
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
    /// `B Lambda theta = right`, with the right-hand sides as [`complete`](Self::complete) left them.
    pub(super) equations: Equations,
    /// What was applied, less the known terms along the reference.
    applied: Vec<Complex<f64>>,
    /// Response of the rows to the tracking error, equation by equation: per parameter of value one and, last, of the known term.
    felt: Vec<Complex<f64>>,
    /// theta', the parameters of the feed-forward.
    pub(super) parameters: Vec<f64>,
}

impl Reduced {
    /// Works out the right-hand sides with the parameters of the feed-forward.
    pub(super) fn complete(&mut self) {
        let width = self.parameters.len() + 1;
        for ((right, applied), felt) in
            self.equations.right.iter_mut().zip(&self.applied).zip(self.felt.chunks_exact(width))
        {
            let felt: Complex<f64> = felt.iter().zip(self.parameters.iter().chain(&[1.0])).map(|(z, t)| z * t).sum();
            *right = applied - felt;
        }
    }

    /// Adds further equations of the same run.
    pub(super) fn append(&mut self, mut others: Self) {
        self.equations.append(others.equations);
        self.applied.append(&mut others.applied);
        self.felt.append(&mut others.felt);
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

impl FirstOrder {
    /// The harmonic equations of one run: `spectra` has the measured coordinates as its first channels, over whole periods
    /// that start at the phase zero of the trial; `hold` is how the inputs became forces.
    ///
    /// # Errors
    /// [`EstimateError::Channels`] when spectra or trial do not fit the model, [`EstimateError::NoSignal`] when the record does
    /// not resolve a harmonic.
    pub(super) fn reduce(
        self,
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
        Ok(self.assemble(trial, along, &error, (0, highest), &spectra.noise, |row, k, linear, right| {
            let frequency = k as f64 * along.frequency;
            let mut gain = vec![Complex::new(0.0, 0.0); coordinates];
            for (i, lines) in forward.iter().enumerate() {
                let map = trial.control.drive(i, frequency, hold) * along.map[row * inputs + i];
                *right += map * lines[k];
                for (c, gain) in gain.iter_mut().enumerate() {
                    *gain += map * trial.control.response(i, c, frequency);
                }
            }
            *right -= gain.iter().zip(&error).map(|(g, e)| g * e[k]).sum::<Complex<f64>>();
            // Noise passes through H^-1, whatever part of J an estimator takes into its equation; `effort` weighs by the loop alone.
            if self != FirstOrder::Effort {
                for (gain, linear) in gain.iter_mut().zip(linear) {
                    *gain += linear;
                }
            }
            gain
        }))
    }

    /// The harmonic equations of a run whose rates were measured (Feng, 3.4: the velocity error as further data): with the
    /// inputs as they were applied, since the feedback need not have seen the positions alone, from harmonic `least` on.
    ///
    /// `spectra` has the coordinates, measured or integrated from their measured rates, as its first channels, then the inputs.
    /// Rate and position have sensors, and noise, of their own, so that both sets of equations count.
    ///
    /// # Errors
    /// [`EstimateError::Channels`] when spectra or trial do not fit the model.
    pub(super) fn reduce_applied(
        self,
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
        Ok(self.assemble(trial, along, &error, (least, highest), &spectra.noise, |row, k, linear, right| {
            // Noise enters by the coordinates, and by the inputs, into which the loop feeds it back.
            let mut through: Vec<Complex<f64>> = linear.iter().map(|j| -j).collect();
            let held = held(hold, k as f64 * along.frequency * trial.control.sample_time);
            for i in 0..inputs {
                let map = held * along.map[row * inputs + i];
                *right += map * spectra.lines[coordinates + i][k];
                through.push(map);
            }
            through
        }))
    }

    /// The equations of harmonics `least` to `highest`. `drive` is given a row, a harmonic, the row's linear response there, and
    /// the right-hand side, to which it adds the inputs; it returns the factor by which every channel's noise enters.
    fn assemble(
        self,
        trial: &Trial,
        along: &Along,
        error: &[Vec<Complex<f64>>],
        (least, highest): (usize, usize),
        noise: &[DMatrix<Complex<f64>>],
        drive: impl Fn(usize, usize, &[Complex<f64>], &mut Complex<f64>) -> Vec<Complex<f64>>,
    ) -> Reduced {
        let dims = along.dims;
        let peak = error.iter().flatten().map(|line| line.norm()).fold(0.0, f64::max);
        let width = dims.parameters + 1;
        let mut equations = Equations::new(dims.parameters);
        let (mut without_error, mut felt) = (Vec::new(), Vec::new());
        let mut phi = vec![Complex::new(0.0, 0.0); dims.parameters];
        for row in 0..dims.rows {
            let coupled: Vec<Vec<Complex<f64>>> = match self {
                FirstOrder::Hill => {
                    let one = |j: usize| -> Vec<f64> { (0..width).map(|i| f64::from(u8::from(i == j))).collect() };
                    (0..width).map(|j| along.applied(row, &one(j), error, highest)).collect()
                }
                FirstOrder::Effort | FirstOrder::Error => Vec::new(),
            };
            for k in least..=highest {
                let linear = along.response(row, &trial.parameters, k);
                let mut applied = -along.known[row][k];
                let through = drive(row, k, &linear, &mut applied);
                without_error.push(applied);
                match self {
                    FirstOrder::Effort => felt.extend((0..width).map(|_| Complex::new(0.0, 0.0))),
                    FirstOrder::Error => felt.extend((0..width).map(|j| along.mean_applied(row, j, k, error))),
                    FirstOrder::Hill => felt.extend(coupled.iter().map(|lines| lines[k])),
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
                        variance += x.norm_sqr() * (ROUNDING * peak).powi(2);
                    }
                }
                equations.push(row, k, &phi, applied, variance);
            }
        }
        Reduced { equations, applied: without_error, felt, parameters: trial.parameters.clone() }
    }
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

/// Lines of the samples of every input's feed-forward.
fn feed_forward_lines(trial: &Trial, inputs: usize, highest: usize) -> Vec<Vec<Complex<f64>>> {
    (0..inputs).map(|i| analyse(&trial.feed_forward, i, inputs, highest)).collect()
}
