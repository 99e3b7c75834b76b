//! Gauss-Newton over states and parameters, and the noise under which it weighs a record.

use crate::estimate::output_error::chain::Chain;
use crate::estimate::output_error::misfit::{self, Along, CandidateKind, Misfit};
use crate::estimate::output_error::problem::{Column, Differentiable, Problem};
use crate::estimate::output_error::smoother::{Noise, Smoothed};
use crate::numerics::DMatrix;
use num_complex::Complex;
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;
use tpm_core::model::EvalError;

/// Most Gauss-Newton steps.
const MOST_STEPS: usize = 15;
/// The iteration has converged when no parameter moves by more than this share of its deviation.
const CONVERGED: f64 = 1e-2;
/// Samples on which the noise is told from the motion.
const TUNING: usize = 4000;
/// Least gain of twice the logarithm of the likelihood at which a kind of noise is believed.
const BELIEVED: f64 = 10.0;
/// Least noise of a sensor, as a share of its root mean square: rounding of numbers that a file holds.
const ROUNDING: f64 = 1e-9;

/// The signals of a record over whole periods.
#[derive(Clone, Debug)]
pub struct Signals<'a> {
    /// Time between samples, s.
    pub sample_time: f64,
    /// What the inputs do between samples.
    pub hold: Hold,
    /// Measured coordinates.
    pub coordinates: Vec<&'a [f64]>,
    /// Recorded inputs.
    pub inputs: Vec<&'a [f64]>,
    /// Samples of a period.
    pub samples_per_period: f64,
    /// White noise of each sensor by the spectrum: a standard deviation.
    pub white: Vec<f64>,
    /// Step of each sensor; zero where its values lie on no grid.
    pub steps: Vec<f64>,
    /// Phasors of the coordinates at the harmonics of the period.
    pub lines: Vec<Vec<Complex<f64>>>,
}

/// Why a record was not fitted sample by sample.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OutputErrorFault {
    /// The rows do not determine the motion.
    #[error(
        "the motion does not follow from the inputs: the model has not as many rows with derivatives as coordinates"
    )]
    NotSimulable,
    /// The model could not be evaluated.
    #[error("the model could not be simulated: {0}")]
    Evaluation(#[from] EvalError),
    /// The record does not show all parameters.
    #[error("the parameters do not show one by one when the record is simulated")]
    Singular,
    /// Gauss-Newton steps did not become small.
    #[error("the simulation did not settle on parameters in {steps} steps")]
    NotConverged {
        /// Steps that were made.
        steps: usize,
    },
}

/// Parameters that explain every sample of a record.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OutputError {
    /// Value of every parameter, in the model's units.
    pub values: Vec<f64>,
    /// Covariance of the free parameters from noise alone, in the order of `free`.
    covariance: DMatrix<f64>,
    /// Indices of the parameters that were estimated.
    pub free: Vec<usize>,
    /// Gauss-Newton steps that were made.
    pub iterations: usize,
    /// Standard deviation of every sensor's noise as it was found, unit of the coordinate.
    pub sensor_noise: Vec<f64>,
    /// Standard deviation of the noise of every recorded input, unit of the input; zero where the record is taken as exact.
    pub input_noise: Vec<f64>,
    /// Correlation of each sensor's noise from one sample to the next.
    pub colour: Vec<f64>,
    /// Root mean square of measured less simulated motion, unit of the coordinate.
    pub residual: Vec<f64>,
    /// What the model leaves unexplained.
    pub misfit: Misfit,
}

impl OutputError {
    /// Covariance of two free parameters, by their places in `free`, from noise alone; nothing beyond them.
    #[must_use]
    pub fn covariance(&self, one: usize, other: usize) -> Option<f64> {
        self.covariance.get((one, other)).copied()
    }

    /// Fits the free parameters of a model to a record, from given values on.
    ///
    /// # Errors
    /// [`OutputErrorFault`].
    pub fn fit(
        machine: Differentiable<'_>,
        constants: &[f64],
        signals: &Signals<'_>,
        start: &[f64],
        free: &[usize],
        hidden: &[Vec<f64>],
    ) -> Result<Self, OutputErrorFault> {
        let states = Problem::states(machine.model).ok_or(OutputErrorFault::NotSimulable)?;
        let samples = signals.coordinates.first().map_or(0, |c| c.len());
        let mut problem = Problem {
            machine,
            constants,
            hold: signals.hold,
            sample_time: signals.sample_time,
            coordinates: signals.coordinates.clone(),
            inputs: signals.inputs.clone(),
            free: free.to_vec(),
            states,
            breaks: vec![false; samples.saturating_sub(1)],
            steps: 1,
            disturbed: vec![0.0; samples * signals.inputs.len()],
        };
        let outputs = signals.coordinates.len();
        let mut state = State {
            motion: signals.motion(&problem.states),
            theta: start.to_vec(),
            terms: Vec::new(),
            noise: signals.noise(),
        };
        let scale: Vec<f64> = (0..outputs).map(|c| state.noise.typical(c, outputs)).collect();
        problem.steps = problem.needed_steps(&state.motion, &state.theta)?;
        let iterations = state.settle(&mut problem, signals, &scale, hidden, true)?;
        let columns = misfit::columns(&problem, signals, &state.motion, &state.theta)?;
        let acting: Vec<_> = columns.iter().map(|candidate| candidate.column.clone()).collect();
        let chain = problem.linearise(&state.motion, &state.theta, &acting, &scale)?;
        let smoothed = Smoothed::new(&chain, &state.noise, false);
        let p = free.len();
        let bare = Solution::of_columns(&smoothed, p, hidden)?;
        let mut found = misfit::judge(&smoothed, free, &columns, &bare, signals);
        if !found.terms.is_empty() {
            // With the terms in the model the parameters may be far away, where the linear answer is not exact.
            let mut richer = State {
                terms: found
                    .terms
                    .iter()
                    .map(|term| Active { term: term.term, row: term.row, value: 0.0, std: 0.0 })
                    .collect(),
                ..state.clone()
            };
            let kept = problem.disturbed.clone();
            if richer.settle(&mut problem, signals, &scale, hidden, false).is_ok() {
                for (term, active) in found.terms.iter_mut().zip(&richer.terms) {
                    (term.term, term.value) = (active.term, active.value);
                    term.std = active.std * found.scale.sqrt();
                }
                for (shift, &j) in found.shift.iter_mut().zip(free) {
                    *shift = richer.theta[j] - state.theta[j];
                }
            }
            problem.disturbed = kept;
        }
        let residual = (0..outputs)
            .map(|c| {
                let of = chain.errors.iter().skip(c).step_by(outputs);
                (of.map(|e| e * e).sum::<f64>() / samples.max(1) as f64).sqrt()
            })
            .collect();
        Ok(OutputError {
            values: state.theta,
            covariance: &bare.covariance * found.scale,
            free: free.to_vec(),
            iterations,
            sensor_noise: scale.iter().map(|sigma| sigma * found.scale.sqrt()).collect(),
            input_noise: state.noise.inputs.iter().map(|sigma| sigma * found.scale.sqrt()).collect(),
            colour: state.noise.colour,
            residual,
            misfit: found,
        })
    }
}

/// A candidate term that is part of the model.
#[derive(Clone, Copy, Debug)]
struct Active {
    term: CandidateKind,
    row: Option<usize>,
    value: f64,
    std: f64,
}

/// What Gauss-Newton steps change.
#[derive(Clone)]
struct State {
    motion: Vec<f64>,
    theta: Vec<f64>,
    terms: Vec<Active>,
    noise: Noise,
}

impl State {
    /// Makes Gauss-Newton steps until they are small; with `tuned`, the noise is found on the way. Returns how many.
    fn settle(
        &mut self,
        problem: &mut Problem<'_>,
        signals: &Signals<'_>,
        scale: &[f64],
        hidden: &[Vec<f64>],
        tuned: bool,
    ) -> Result<usize, OutputErrorFault> {
        let free = problem.free.clone();
        for iteration in 0..MOST_STEPS {
            let columns = self.columns(problem, signals)?;
            let values: Vec<f64> = (self.terms.iter())
                .flat_map(|active| {
                    let limit = matches!(active.term, CandidateKind::Limit { .. });
                    std::iter::once(active.value).chain(limit.then_some(0.0))
                })
                .collect();
            let chain = problem.linearise_at(&self.motion, &self.theta, &columns, &values, scale)?;
            if tuned && (iteration == 0 || iteration == 3) {
                self.noise = tune(&chain, &self.noise, signals);
            }
            let smoothed = Smoothed::new(&chain, &self.noise, true);
            let solution = Solution::of_columns(&smoothed, chain.columns, hidden)?;
            let (states, inputs) =
                smoothed.corrections(&chain, &self.noise, &solution.step).ok_or(OutputErrorFault::Singular)?;
            let mut share = 1.0_f64;
            for (at, &j) in free.iter().enumerate() {
                // A parameter is never moved by more than itself in one step unless it is nothing.
                let size = self.theta[j].abs().max(3.0 * solution.deviation(at));
                share = share.min(size / solution.step[at].abs().max(f64::MIN_POSITIVE));
            }
            if std::env::var("TPM_DEBUG").is_ok() {
                std::eprintln!(
                    "it {iteration} share {share} theta {:?} step {:?} dev {:?} noise {:?} colour {:?} rss {} det {}",
                    self.theta,
                    solution.step,
                    (0..free.len()).map(|a| solution.deviation(a)).collect::<Vec<_>>(),
                    self.noise.inputs,
                    self.noise.colour,
                    smoothed.root.last().unwrap().powi(2) / smoothed.places.len() as f64,
                    smoothed.determinant
                );
            }
            for (at, &j) in free.iter().enumerate() {
                self.theta[j] += share * solution.step[at];
            }
            for (value, correction) in self.motion.iter_mut().zip(&states) {
                *value += share * correction;
            }
            for (value, correction) in problem.disturbed.iter_mut().zip(&inputs) {
                *value += share * correction;
            }
            let mut at = free.len();
            for active in &mut self.terms {
                active.value += share * solution.step[at];
                active.std = solution.deviation(at);
                at += 1;
                if let CandidateKind::Limit { limit, .. } = &mut active.term {
                    *limit += (share * solution.step[at]).clamp(-0.2 * *limit, 0.2 * *limit);
                    at += 1;
                }
            }
            let still = (0..chain.columns).all(|at| solution.step[at].abs() <= CONVERGED * solution.deviation(at));
            if share >= 1.0 && still && (iteration > 3 || !tuned) {
                return Ok(iteration + 1);
            }
        }
        Err(OutputErrorFault::NotConverged { steps: MOST_STEPS })
    }

    /// The columns of the terms that are part of the model; a limit has one more, for where it lies.
    fn columns(&self, problem: &Problem<'_>, signals: &Signals<'_>) -> Result<Vec<Column>, OutputErrorFault> {
        if self.terms.is_empty() {
            return Ok(Vec::new());
        }
        let along = Along::new(problem, signals, &self.motion, &self.theta)?;
        let mut columns = Vec::new();
        for active in &self.terms {
            columns.push(along.column(active.term, active.row));
            if let CandidateKind::Limit { .. } = active.term {
                columns.push(along.edge(active.term, active.row, active.value));
            }
        }
        Ok(columns)
    }
}

/// A step of the columns, and their covariance for noise of the stated size.
pub(super) struct Solution {
    pub(super) step: Vec<f64>,
    pub(super) covariance: DMatrix<f64>,
    /// Upper triangle of the information about the columns.
    pub(super) root: DMatrix<f64>,
}

impl Solution {
    /// The solution for the first `p` columns, without the others.
    pub(super) fn of_columns(smoothed: &Smoothed, p: usize, hidden: &[Vec<f64>]) -> Result<Self, OutputErrorFault> {
        let width = (smoothed.root.len() as f64).sqrt().round() as usize;
        let mut rows = DMatrix::from_fn(p + hidden.len(), p + 1, |r, c| {
            if r >= p {
                return hidden[r - p].get(c).copied().unwrap_or(0.0);
            }
            let column = if c == p { width - 1 } else { c };
            if c >= r { smoothed.root[r * width + column] } else { 0.0 }
        });
        // Columns of unit size, so that units do not decide what is singular.
        let sizes: Vec<f64> = (0..p).map(|c| rows.view((0, c), (p, 1)).norm().max(f64::MIN_POSITIVE)).collect();
        for (c, size) in sizes.iter().enumerate() {
            rows.column_mut(c).rows_mut(0, p).scale_mut(1.0 / size);
        }
        // Nothing moves along a direction that the data do not show.
        for r in p..p + hidden.len() {
            for (c, size) in sizes.iter().enumerate() {
                rows[(r, c)] /= *size;
            }
            let norm = rows.row(r).norm().max(f64::MIN_POSITIVE);
            rows.row_mut(r).scale_mut(1e3 / norm);
        }
        let right = rows.column(p).into_owned();
        let matrix = rows.columns(0, p).into_owned();
        let qr = matrix.qr();
        let (q, r) = qr.unpack();
        if (0..p).any(|i| !(r[(i, i)].abs() > 1e-9)) {
            return Err(OutputErrorFault::Singular);
        }
        let solved = r.solve_upper_triangular(&q.tr_mul(&right)).ok_or(OutputErrorFault::Singular)?;
        let inverse = r.solve_upper_triangular(&DMatrix::identity(p, p)).ok_or(OutputErrorFault::Singular)?;
        let mut covariance = &inverse * inverse.transpose();
        for a in 0..p {
            for b in 0..p {
                covariance[(a, b)] /= sizes[a] * sizes[b];
            }
        }
        let step: Vec<f64> = solved.iter().zip(&sizes).map(|(value, size)| value / size).collect();
        let root = DMatrix::from_fn(p, p, |i, j| if j >= i { r[(i, j)] * sizes[j] } else { 0.0 });
        if step.iter().all(|value| value.is_finite()) {
            Ok(Solution { step, covariance, root })
        } else {
            Err(OutputErrorFault::Singular)
        }
    }

    fn deviation(&self, at: usize) -> f64 {
        self.covariance[(at, at)].max(0.0).sqrt()
    }
}

impl Signals<'_> {
    /// The motion by its harmonics, all states at every sample.
    fn motion(&self, states: &[(usize, usize)]) -> Vec<f64> {
        let samples = self.coordinates.first().map_or(0, |c| c.len());
        let n = states.len();
        let mut motion = vec![0.0; samples * n];
        let fundamental = 2.0 * std::f64::consts::PI / (self.samples_per_period * self.sample_time);
        for (s, &(c, derivative)) in states.iter().enumerate() {
            for (k, line) in self.lines[c].iter().enumerate() {
                let turn = Complex::new(0.0, k as f64 * fundamental);
                let phasor = line * turn.powu(derivative as u32);
                if phasor.norm_sqr() <= 0.0 {
                    continue;
                }
                let angle = k as f64 * fundamental * self.sample_time;
                let step = Complex::new(angle.cos(), angle.sin());
                let mut wave = phasor;
                for (i, slot) in motion.iter_mut().skip(s).step_by(n).enumerate() {
                    if i % 1024 == 0 {
                        let at = (i as f64 * angle).rem_euclid(2.0 * std::f64::consts::PI);
                        wave = phasor * Complex::new(at.cos(), at.sin());
                    }
                    *slot += wave.re;
                    wave *= step;
                }
            }
        }
        motion
    }

    /// The noise of the sensors: white by the spectrum, and the rounding to counts where there is any.
    ///
    /// A reading that stays on one count for L samples is one reading, and readings that repeat from period to period are those of one
    /// period.
    fn noise(&self) -> Noise {
        let outputs = self.coordinates.len();
        let samples = self.coordinates.first().map_or(0, |c| c.len());
        let mut readings = vec![0.0; samples * outputs];
        for (c, signal) in self.coordinates.iter().enumerate() {
            let power = signal.iter().map(|x| x * x).sum::<f64>() / samples.max(1) as f64;
            let least = (ROUNDING * power.sqrt()).powi(2).max(f64::MIN_POSITIVE);
            let step = self.steps[c];
            let rounded = step * step / 12.0;
            let own = (self.white[c].powi(2) - rounded).max(0.0);
            if step > 0.0 && own.sqrt() < 0.5 * step {
                let period = self.samples_per_period.round() as usize;
                let pairs = signal.iter().zip(signal.iter().skip(period.max(1)));
                let (same, all) = pairs.fold((0_u32, 0_u32), |(same, all), (a, b)| {
                    (same + u32::from((a - b).abs() < 0.5 * step), all + 1)
                });
                let repeats = if all > 0 { f64::from(same) / f64::from(all) } else { 0.0 };
                let periods = samples as f64 / self.samples_per_period.max(1.0);
                let copies = 1.0 + (periods - 1.0).max(0.0) * repeats;
                let mut k = 0;
                while k < samples {
                    let first = k;
                    while k < samples && (signal[k] - signal[first]).abs() < 0.5 * step {
                        k += 1;
                    }
                    let variance = (rounded * (k - first) as f64 + own) * copies;
                    for sample in first..k {
                        readings[sample * outputs + c] = variance.max(least).sqrt();
                    }
                }
            } else {
                let sigma = self.white[c].powi(2).max(least).sqrt();
                readings.iter_mut().skip(c).step_by(outputs).for_each(|slot| *slot = sigma);
            }
        }
        Noise { readings, colour: vec![0.0; outputs], inputs: vec![0.0; self.inputs.len()] }
    }

    /// Whether rounding to counts makes up the noise of a sensor.
    pub(super) fn counted(&self) -> bool {
        self.steps
            .iter()
            .zip(&self.white)
            .any(|(step, white)| *step > 0.0 && (white * white - step * step / 12.0).max(0.0).sqrt() < 0.5 * step)
    }
}

/// The noise of the inputs, and the colour of the sensors' noise, that make a stretch of the record most likely.
fn tune(chain: &Chain, before: &Noise, signals: &Signals<'_>) -> Noise {
    let outputs = chain.outputs.len();
    let length = chain.samples.min(TUNING);
    let from = (chain.samples - length) / 2;
    let stretch = chain.stretch(from, length);
    let cut = |noise: &Noise| Noise {
        readings: noise.readings[from * outputs..(from + length) * outputs].to_vec(),
        colour: noise.colour.clone(),
        inputs: noise.inputs.clone(),
    };
    let cost = |noise: &Noise| -> f64 {
        let smoothed = Smoothed::new(&stretch, &cut(noise), false);
        let readings = smoothed.places.len() as f64;
        let left = smoothed.root.last().map_or(0.0, |z| z * z).max(f64::MIN_POSITIVE);
        let cost = readings * (left / readings).ln() + smoothed.determinant;
        if cost.is_finite() { cost } else { f64::INFINITY }
    };
    let sizes: Vec<f64> = (signals.inputs.iter())
        .map(|input| (input.iter().map(|u| u * u).sum::<f64>() / input.len().max(1) as f64).sqrt())
        .collect();
    let noisy = |noise: &Noise, log: f64| {
        let share = 10.0_f64.powf(log);
        Noise { inputs: sizes.iter().map(|size| share * size).collect(), ..noise.clone() }
    };
    let exact = |noise: &Noise| Noise { inputs: vec![0.0; sizes.len()], ..noise.clone() };
    let inputs = |noise: &Noise| -> (Noise, f64) {
        let none = exact(noise);
        let bare = cost(&none);
        let grid = (1..=6).map(|decade| (-f64::from(decade), cost(&noisy(noise, -f64::from(decade)))));
        let (mut log, mut least) = grid.fold((0.0, f64::INFINITY), |best, now| if now.1 < best.1 { now } else { best });
        if least > bare - BELIEVED {
            return (none, bare);
        }
        let mut width = 0.5;
        while width > 0.04 {
            for tried in [log - width, log + width] {
                let now = cost(&noisy(noise, tried));
                if now < least {
                    (log, least) = (tried, now);
                }
            }
            width *= 0.5;
        }
        (noisy(noise, log), least)
    };
    let (mut best, mut least) = inputs(&exact(before));
    let mut colours: Vec<f64> = vec![0.5, 0.8, 0.9, 0.96];
    let white = best.clone();
    let mut found = false;
    for colour in colours.drain(..) {
        for base in [exact(before), white.clone()] {
            let tried = Noise { colour: vec![colour; outputs], ..base };
            let now = cost(&tried);
            if now < least - if found { 0.0 } else { BELIEVED } {
                (best, least, found) = (tried, now, true);
            }
        }
    }
    if found {
        let mut width = 0.25;
        while width > 0.03 {
            for factor in [1.0 - width, 1.0 + width] {
                // The search is over what is new in every sample.
                let colour = best.colour.iter().map(|colour| 1.0 - (1.0 - colour) * factor).collect();
                let tried = Noise { colour, ..best.clone() };
                let now = cost(&tried);
                if now < least {
                    (best, least) = (tried, now);
                }
            }
            width *= 0.5;
        }
    }
    best
}
