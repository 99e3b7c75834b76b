//! Gauss-Newton over states and parameters, and the noise under which it weighs a record.

use crate::estimate::output_error::chain::Chain;
use crate::estimate::output_error::clipping::{self, Clipping};
use crate::estimate::output_error::local;
use crate::estimate::output_error::misfit::{self, Along, Candidate, CandidateKind, Half, Misfit};
use crate::estimate::output_error::problem::{Column, Differentiable, Place, Problem};
use crate::estimate::output_error::smoother::{Noise, Smoothed};
use crate::numerics::DMatrix;
use num_complex::Complex;
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;
use tpm_core::model::EvalError;

/// Most Gauss-Newton steps.
const MOST_STEPS: usize = 25;
/// The iteration has converged when no parameter moves by more than this share of its deviation.
const CONVERGED: f64 = 1e-2;
/// After this many steps a parameter may still move by [`SETTLED`].
const PATIENT: usize = 6;
/// Share of its deviation by which a parameter may move when the steps no longer become smaller.
const SETTLED: f64 = 0.5;
/// Variance of the first innovations, in units of the sensors' white noise, above which there is more than that.
const NOISY: f64 = 10.0;
/// Samples on which the noise is told from the motion.
const TUNING: usize = 4000;
/// Least gain of twice the logarithm of the likelihood at which a kind of noise is believed.
const BELIEVED: f64 = 10.0;
/// Power that harmonics leave of a record, in units of its noise, above which they are no description of its motion.
const UNEXPLAINED: f64 = 100.0;
/// Share of a period over which a polynomial is fitted on either side of a sample, as one over this.
const LOCAL: u32 = 60;
/// Shortest time between two stops of a machine, as a share of the period.
const SHORTEST_PASSAGE: f64 = 0.02;
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
    /// Phasors of the coordinates at the harmonics of the period, as far as they stand out of the noise.
    pub lines: Vec<Vec<Complex<f64>>>,
    /// Phasors of the inputs at the harmonics of the period, as far as they stand out of the noise.
    pub input_lines: Vec<Vec<Complex<f64>>>,
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
    /// Gauss-Newton steps that were made; nothing where they did not settle on parameters with the model as it is, so that the values
    /// are those from which they began.
    pub iterations: Option<usize>,
    /// Standard deviation of every sensor's noise as it was found, unit of the coordinate.
    pub sensor_noise: Vec<f64>,
    /// Standard deviation of the noise of every recorded input, unit of the input; zero where the record is taken as exact.
    pub input_noise: Vec<f64>,
    /// Correlation of each sensor's noise from one sample to the next.
    pub colour: Vec<f64>,
    /// Root mean square of measured less simulated motion, unit of the coordinate.
    pub residual: Vec<f64>,
    /// What is not explained, as a share: the largest of that residual beside the motion, and of what the inputs are taken to have
    /// been beside what was recorded.
    pub share: f64,
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
            shortest_passage: (signals.samples_per_period * SHORTEST_PASSAGE) as usize,
        };
        let outputs = signals.coordinates.len();
        let clipped = clipping::find(&problem, signals, start)?;
        let mut state = State {
            motion: signals.motion(&problem.states),
            theta: clipped.as_ref().map_or(start, |clipped| &clipped.theta).to_vec(),
            terms: Vec::new(),
            noise: signals.noise(),
            own: Vec::new(),
        };
        if let Some(Clipping { input, applied, edge, .. }) = &clipped {
            problem.inputs[*input] = applied;
            state.own.push((edge.clone(), 0.0));
        }
        let scale: Vec<f64> = (0..outputs).map(|c| state.noise.typical(c, outputs)).collect();
        problem.steps = problem.needed_steps(&state.motion, &state.theta)?;
        let begun = state.clone();
        let settled = state.settle(&mut problem, signals, &scale, hidden, true);
        if settled.is_err() {
            // Terms that are missing may be what keeps the parameters from settling; they are looked for where the fit began.
            state = State { noise: state.noise, ..begun };
            problem.disturbed.fill(0.0);
        }
        let columns = misfit::columns(&problem, signals, &state.motion, &state.theta)?;
        let own = state.own.iter().map(|(column, _)| column.clone());
        let acting: Vec<Column> = own.chain(columns.iter().map(|candidate| candidate.column.clone())).collect();
        let mut values: Vec<f64> = state.own.iter().map(|(_, value)| *value).collect();
        values.resize(acting.len(), 0.0);
        let chain = problem.linearise_at(&state.motion, &state.theta, &acting, &values, &scale)?;
        let smoothed = Smoothed::new(&chain, &state.noise, false);
        let p = free.len() + state.own.len();
        let bare = Solution::of_columns(&smoothed, p, hidden)?;
        let mut found = misfit::judge(&smoothed, (free, p), &columns, &bare, signals, state.noise.is_plain());
        found.halves = halves(&chain, &state.noise, p, hidden);
        let mut explained = false;
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
            if richer.settle(&mut problem, signals, &scale, hidden, settled.is_err()).is_ok() {
                explained = true;
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
        if let (Some(clipped), Some((_, moved))) = (&clipped, state.own.first()) {
            let at = free.len();
            found.terms.insert(
                0,
                Candidate {
                    term: CandidateKind::Limit { input: clipped.input, limit: clipped.limit + moved },
                    row: match clipped.edge.place {
                        Place::Row(row) => Some(row),
                        Place::Reading(_) => None,
                    },
                    value: 1.0,
                    std: (bare.covariance[(at, at)] * found.scale).sqrt(),
                    gain: 1.0,
                },
            );
            found.limited = true;
        }
        let iterations = match settled {
            Ok(iterations) => Some(iterations),
            Err(_) if explained => None,
            Err(fault) => return Err(fault),
        };
        let residual = (0..outputs)
            .map(|c| {
                let of = chain.errors.iter().skip(c).step_by(outputs);
                (of.map(|e| e * e).sum::<f64>() / samples.max(1) as f64).sqrt()
            })
            .collect();
        let spread = |signal: &[f64]| -> f64 {
            let mean = signal.iter().sum::<f64>() / signal.len().max(1) as f64;
            (signal.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / signal.len().max(1) as f64).sqrt()
        };
        let residual: Vec<f64> = residual;
        let by_motion = residual.iter().zip(&signals.coordinates).map(|(left, signal)| left / spread(signal));
        let inputs = signals.inputs.len();
        let by_input = signals.inputs.iter().enumerate().map(|(i, input)| {
            let taken: Vec<f64> = problem.disturbed.iter().skip(i).step_by(inputs.max(1)).copied().collect();
            spread(&taken) / spread(input)
        });
        let share = by_motion.chain(by_input).filter(|share| share.is_finite()).fold(0.0, f64::max);
        Ok(OutputError {
            share,
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

/// The steps of the first `p` columns that either half of a record asks for, with their variances; nothing where a half does not show
/// them.
fn halves(chain: &Chain, noise: &Noise, p: usize, hidden: &[Vec<f64>]) -> Vec<Half> {
    let middle = chain.samples / 2;
    let outputs = chain.outputs.len();
    let of = |from: usize, samples: usize| -> Option<Vec<(f64, f64)>> {
        let part = chain.stretch(from, samples);
        let readings = noise.readings[from * outputs..(from + samples) * outputs].to_vec();
        let smoothed = Smoothed::new(&part, &Noise { readings, ..noise.clone() }, false);
        let solution = Solution::of_columns(&smoothed, p, hidden).ok()?;
        Some((0..p).map(|j| (solution.step[j], solution.covariance[(j, j)])).collect())
    };
    let (Some(first), Some(second)) = (of(0, middle), of(middle, chain.samples - middle)) else { return Vec::new() };
    let pair = |((first, own), (second, other)): ((f64, f64), (f64, f64))| Half {
        moved: second - first,
        variance: own + other,
    };
    first.into_iter().zip(second).map(pair).collect()
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
    /// Columns that are part of the model for this record, with their values.
    own: Vec<(Column, f64)>,
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
            let own = self.own.iter().map(|(_, value)| *value);
            let values: Vec<f64> = own.chain(self.terms.iter().map(|active| active.value)).collect();
            let mut chain = problem.linearise_at(&self.motion, &self.theta, &columns, &values, scale)?;
            // The noise is told from the motion once the motion obeys the model, and again where there is more than white noise of
            // the sensors.
            if tuned && (iteration == 1 || iteration == 3 && !self.noise.is_plain()) {
                self.noise = tune(&chain, &self.noise, signals);
                if self.noise.inputs.iter().all(|sigma| *sigma <= 0.0) {
                    problem.disturbed.fill(0.0);
                    chain = chain.as_recorded();
                }
            }
            let mut smoothed = Smoothed::new(&chain, &self.noise, true);
            if tuned && iteration == 0 && smoothed.scale() > NOISY {
                self.noise = tune(&chain, &self.noise, signals);
                smoothed = Smoothed::new(&chain, &self.noise, true);
            }
            let solution = Solution::of_columns(&smoothed, chain.columns, hidden)?;
            let (states, inputs) =
                smoothed.corrections(&chain, &self.noise, &solution.step).ok_or(OutputErrorFault::Singular)?;
            // Signs that turn a sample earlier or later make whole steps go to and fro.
            let turning = iteration >= PATIENT && problem.machine.derivatives.switches() > 0;
            let whole = if turning { 0.5 } else { 1.0 };
            let mut share: f64 = whole;
            for (at, &j) in free.iter().enumerate() {
                // A parameter moves by half of itself at most in one step, unless it is nothing.
                let size = (0.5 * self.theta[j].abs()).max(3.0 * solution.deviation(at));
                share = share.min(size / solution.step[at].abs().max(f64::MIN_POSITIVE));
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
            for (_, value) in &mut self.own {
                *value += share * solution.step[at];
                at += 1;
            }
            for active in &mut self.terms {
                active.value += share * solution.step[at];
                active.std = solution.deviation(at);
                at += 1;
            }
            let small = if turning { SETTLED } else { CONVERGED };
            let still = (0..chain.columns).all(|at| solution.step[at].abs() <= small * solution.deviation(at));
            if share >= whole && still && (iteration > 3 || iteration > 1 && self.noise.is_plain() || !tuned) {
                return Ok(iteration + 1);
            }
        }
        Err(OutputErrorFault::NotConverged { steps: MOST_STEPS })
    }

    /// The columns that are part of the model for this record, and those of the terms.
    fn columns(&self, problem: &Problem<'_>, signals: &Signals<'_>) -> Result<Vec<Column>, OutputErrorFault> {
        let mut columns: Vec<Column> = self.own.iter().map(|(column, _)| column.clone()).collect();
        if self.terms.is_empty() {
            return Ok(columns);
        }
        let along = Along::new(problem, signals, &self.motion, &self.theta)?;
        columns.extend(self.terms.iter().map(|active| along.column(active.term, active.row)));
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
    /// The motion from which the fit begins, given derivatives of coordinates at every sample: that of the harmonics, or of
    /// polynomials over a few samples for a coordinate whose record the harmonics do not explain, such as one that has not settled.
    pub(super) fn motion(&self, slots: &[(usize, usize)]) -> Vec<f64> {
        let samples = self.coordinates.first().map_or(0, |c| c.len());
        let n = slots.len();
        let mut motion = vec![0.0; samples * n];
        for (c, signal) in self.coordinates.iter().enumerate() {
            let mut periodic = vec![0.0; samples];
            self.synthesise(&self.lines[c], 0, periodic.iter_mut());
            let power = |left: &mut dyn Iterator<Item = f64>| left.map(|e| e * e).sum::<f64>() / samples.max(1) as f64;
            let left = power(&mut signal.iter().zip(&periodic).map(|(x, y)| x - y));
            let noise = self.white[c].powi(2) + self.steps[c].powi(2) / 12.0;
            let order = slots.iter().filter(|slot| slot.0 == c).map(|slot| slot.1).max().unwrap_or(0);
            let half = ((self.samples_per_period / f64::from(LOCAL)) as usize).max(3 + order);
            let local = if left > UNEXPLAINED * noise {
                local::derivatives(signal, self.sample_time, half, order)
            } else {
                None
            };
            for (s, &(_, derivative)) in slots.iter().enumerate().filter(|(_, slot)| slot.0 == c) {
                let to = motion.iter_mut().skip(s).step_by(n);
                match &local {
                    Some(local) => {
                        let from = local.iter().skip(derivative).step_by(order + 1);
                        to.zip(from).for_each(|(to, from)| *to = *from);
                    }
                    None => self.synthesise(&self.lines[c], derivative, to),
                }
            }
        }
        motion
    }

    /// The highest harmonic of a coordinate that is no smaller than a thousandth of the largest.
    pub(super) fn highest(&self, coordinate: usize) -> usize {
        let lines = &self.lines[coordinate];
        let peak = lines.iter().skip(1).map(|line| line.norm()).fold(0.0, f64::max);
        lines.iter().rposition(|line| line.norm() >= 1e-3 * peak).unwrap_or(1).max(1)
    }

    /// The periodic part of an input.
    pub(super) fn periodic_input(&self, input: usize) -> Vec<f64> {
        let mut wave = vec![0.0; self.inputs[input].len()];
        self.synthesise(&self.input_lines[input], 0, wave.iter_mut());
        wave
    }

    /// Adds a derivative of a Fourier series to successive samples.
    fn synthesise<'s>(
        &self,
        lines: &[Complex<f64>],
        derivative: usize,
        mut samples: impl Iterator<Item = &'s mut f64> + ExactSizeIterator,
    ) {
        let fundamental = 2.0 * std::f64::consts::PI / (self.samples_per_period * self.sample_time);
        let wanted = |(k, line): (usize, &Complex<f64>)| {
            let phasor = line * Complex::new(0.0, k as f64 * fundamental).powu(derivative as u32);
            (phasor.norm_sqr() > 0.0).then_some((k as f64 * fundamental * self.sample_time, phasor))
        };
        let mut waves: Vec<(f64, Complex<f64>, Complex<f64>, Complex<f64>)> = (lines.iter().enumerate())
            .filter_map(wanted)
            .map(|(angle, phasor)| (angle, phasor, phasor, Complex::from_polar(1.0, angle)))
            .collect();
        for i in 0..samples.len() {
            let mut sum = 0.0;
            for (angle, phasor, wave, step) in &mut waves {
                // The angle is formed anew now and then, so that rounding does not add up.
                if i % 1024 == 0 {
                    *wave =
                        *phasor * Complex::from_polar(1.0, (i as f64 * *angle).rem_euclid(2.0 * std::f64::consts::PI));
                }
                sum += wave.re;
                *wave *= *step;
            }
            if let Some(slot) = samples.next() {
                *slot += sum;
            }
        }
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
                // The error is a function of the phase of a periodic motion, the same in every period.
                let copies = (samples as f64 / self.samples_per_period.max(1.0)).max(1.0);
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
    let stretch = chain.stretch(from, length).as_recorded();
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
