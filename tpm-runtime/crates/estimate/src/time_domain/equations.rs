//! The equations of a record in one band of frequencies.

use crate::error::EstimateError;
use crate::time_domain::low_pass::LowPass;
use crate::time_domain::motion::{Motion, Moving, TimeRecord};
use crate::time_domain::transform::{Transform, quick};
use num_complex::Complex;
use rayon::prelude::*;
use std::f64::consts::PI;
use tpm_controller::derivatives::RowDerivatives;
use tpm_controller::model::{EvalError, Model};
use tpm_motion::held;
use tpm_numerics::{alarm, root_mean_square, whole};

/// Cut-off of the low pass on the motion, in units of that on the rows: what the rows' own low pass takes later need not be taken here.
const MOTION_CUT_OFF_RATIO: f64 = 2.0;
/// Samples of the motion in one oscillation at the cut-off: a sign that jumps does so at one of them.
const SAMPLES_PER_OSCILLATION: f64 = 32.0;
/// A sign is believed where its argument is above this share of its root mean square: nearer to rest, friction takes any value
/// between its two.
pub(crate) const LEAST_ARGUMENT: f64 = 0.02;
/// Share of the time around an equation for which a sign in it may be unknown: a passage through rest, but no stop.
const MOST_UNKNOWN_TIME: f64 = 0.25;
/// Share of the low pass's reach within which it has most of its weight.
const HEAVY_REACH: f64 = 0.25;
/// Samples that one task evaluates.
const SAMPLES_PER_TASK: usize = 1024;

/// What is evaluated: a model, its constants, and the derivatives of its rows where they are known.
#[derive(Clone, Copy)]
pub(super) struct Machine<'a> {
    pub(super) model: &'a dyn Model<f64>,
    pub(super) derivatives: Option<&'a dyn RowDerivatives<f64>>,
    pub(super) constants: &'a [f64],
}

impl Machine<'_> {
    /// Number of different arguments of signs in the rows.
    fn switches(self) -> usize {
        self.derivatives.map_or(0, RowDerivatives::switches)
    }
}

/// Equations of one row of the model, one per instant.
#[derive(Clone, Debug, Default)]
pub(super) struct RowEquations {
    /// Regressor and right-hand side, parameters plus one entries per instant.
    pub(super) entries: Vec<f64>,
    /// What noise of the sensors adds to the regressor and, last, takes from the right-hand side.
    pub(super) noise: Vec<f64>,
    /// Whether an instant counts.
    pub(super) counts: Vec<bool>,
    /// Whether an input acts in the row.
    pub(super) driven: bool,
}

/// Equations of all rows in one band.
pub(super) struct Equations {
    pub(super) rows: Vec<RowEquations>,
    /// Instants between which residuals are correlated.
    pub(super) correlated: usize,
}

impl Equations {
    /// Instants of which some equation counts.
    pub(super) fn instants(&self) -> usize {
        self.rows.first().map_or(0, |row| row.counts.len())
    }

    /// The equations of a record behind a low pass.
    ///
    /// # Errors
    /// [`EstimateError::Model`] and [`EstimateError::NotFinite`] when the rows cannot be evaluated on the motion.
    pub(super) fn of(
        machine: Machine<'_>,
        record: &TimeRecord<'_>,
        motion: &Motion,
        low_pass: LowPass,
    ) -> Result<Self, EstimateError> {
        let dims = machine.model.dims();
        let mut rows = vec![RowEquations::default(); dims.rows];
        // Twice the frequency above which nothing passes.
        let rate = low_pass.stop() / PI;
        for stretch in &motion.stretches {
            Band { machine, record, stretch, low_pass, rate }.append(&mut rows)?;
        }
        Ok(Equations { rows, correlated: whole::above(rate * low_pass.reach()) })
    }

    /// The longest time that a band takes from either end of a stretch, s.
    pub(super) fn lost(low_pass: LowPass) -> f64 {
        low_pass.reach() * (1.0 + 1.0 / MOTION_CUT_OFF_RATIO)
    }
}

/// What the rows hold beside their entries at successive samples.
struct Signs {
    /// Whether an input acts in a row.
    driven: Vec<bool>,
    /// Whether a sign acts in a row, sign by sign.
    acts: Vec<bool>,
    /// Arguments of the signs, sample by sample.
    arguments: Vec<f64>,
}

/// One stretch in one band.
struct Band<'a> {
    machine: Machine<'a>,
    record: &'a TimeRecord<'a>,
    stretch: &'a Moving,
    low_pass: LowPass,
    /// Instants per second.
    rate: f64,
}

/// Rows along a motion: one entry per sample and row for every parameter, and for the right-hand side.
struct Along {
    entries: Vec<f64>,
    driven: Vec<bool>,
    /// Arguments of the signs, sample by sample.
    arguments: Vec<f64>,
    /// Whether a sign acts in a row, sign by sign.
    acts: Vec<bool>,
}

impl Band<'_> {
    fn append(&self, rows: &mut [RowEquations]) -> Result<(), EstimateError> {
        let h = self.record.sample_time;
        let duration = self.stretch.points as f64 * h;
        let lost = Equations::lost(self.low_pass);
        let (first, last) = (lost, self.stretch.samples as f64 * h - lost);
        if first >= last {
            return Ok(());
        }
        let wanted = duration * SAMPLES_PER_OSCILLATION * self.low_pass.cut_off / (2.0 * PI);
        let fine = quick(whole::below(wanted)).min(self.stretch.points);
        let wide = LowPass { cut_off: MOTION_CUT_OFF_RATIO * self.low_pass.cut_off };
        let inputs: Vec<Vec<f64>> = (self.stretch.inputs.iter().enumerate())
            .map(|(i, input)| {
                let actuator = self.record.actuators.get(i).copied().unwrap_or_default();
                input.filtered(fine, |w| held(self.record.hold, w * h) * actuator.response(w) * wide.response(w))
            })
            .collect();
        let right = self.along(&self.motion(fine, wide, false), &inputs, fine)?;
        let noisy = self.along(&self.motion(fine, wide, true), &inputs, fine)?;
        let unsure = self.unsure(&right, &noisy, fine);
        let dims = self.machine.model.dims();
        let width = dims.parameters + 1;
        let apart = duration / fine as f64;
        let coarse = quick(whole::above(duration * self.rate)).min(fine);
        let instants = coarse as f64 / duration;
        let kept = whole::above(first * instants)..whole::below(last * instants);
        if kept.is_empty() {
            return Ok(());
        }
        // What a low pass leaves of a row's entries, column by column.
        let passed = |of: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let signal: Vec<f64> = (0..fine).map(of).collect();
            let transform = Transform::new(&signal, fine, apart);
            let all = transform.filtered(coarse, |w| Complex::from(self.low_pass.response(w)));
            all[kept.clone()].to_vec()
        };
        for (r, row) in rows.iter_mut().enumerate() {
            let at = |k: usize, column: usize| (k * dims.rows + r) * width + column;
            let base = row.counts.len();
            row.entries.resize((base + kept.len()) * width, 0.0);
            row.noise.resize((base + kept.len()) * width, 0.0);
            for column in 0..width {
                let own = passed(&|k| right.entries[at(k, column)]);
                let noise = passed(&|k| noisy.entries[at(k, column)] - right.entries[at(k, column)]);
                for (k, (own, noise)) in own.iter().zip(&noise).enumerate() {
                    row.entries[(base + k) * width + column] = *own;
                    row.noise[(base + k) * width + column] = *noise;
                }
            }
            row.driven |= right.driven[r];
            let counts = kept.clone().map(|k| {
                let near = HEAVY_REACH * self.low_pass.reach();
                let middle = k as f64 / instants;
                let from = whole::below((middle - near) / apart).min(fine - 1);
                let to = whole::below((middle + near) / apart).clamp(from + 1, fine);
                unsure[r]
                    .as_ref()
                    .is_none_or(|sums| f64::from(sums[to] - sums[from]) <= MOST_UNKNOWN_TIME * (to - from) as f64)
            });
            row.counts.extend(counts);
        }
        Ok(())
    }

    /// Coordinates and their derivatives, sample by sample in the order of a motion.
    fn motion(&self, fine: usize, low_pass: LowPass, with_noise: bool) -> Vec<f64> {
        let model = self.machine.model;
        let dims = model.dims();
        let slots = dims.motion_len();
        let mut motion = vec![0.0; fine * slots];
        for (c, signal) in self.stretch.coordinates.iter().enumerate() {
            for d in 0..=model.coordinate_order(c) {
                let response = |w: f64| low_pass.response(w);
                let mut values = signal.derivative(fine, d, response);
                if with_noise {
                    let noise = self.stretch.noise[c].derivative(fine, d, response);
                    values.iter_mut().zip(&noise).for_each(|(value, noise)| *value += noise);
                }
                for (k, value) in values.iter().enumerate() {
                    motion[k * slots + d * dims.coordinates + c] = *value;
                }
            }
        }
        motion
    }

    fn along(&self, motion: &[f64], inputs: &[Vec<f64>], fine: usize) -> Result<Along, EstimateError> {
        let model = self.machine.model;
        let dims = model.dims();
        let width = dims.parameters + 1;
        let mut entries = vec![0.0; fine * dims.rows * width];
        let tasks = entries.par_chunks_mut(dims.rows * width * SAMPLES_PER_TASK).enumerate();
        let signs: Vec<Signs> = tasks
            .map(|(task, entries)| self.evaluate(task * SAMPLES_PER_TASK, entries, motion, inputs))
            .collect::<Result<_, _>>()?;
        if let Some(at) = entries.iter().position(|entry| !entry.is_finite()) {
            let (row, column) = (at / width % dims.rows, at % width);
            let what = if column + 1 < width { model.parameter(column).name } else { "known terms and inputs" };
            return Err(EstimateError::NotFinite { row: model.row(row).name.to_string(), what: what.to_string() });
        }
        let any = |of: &dyn Fn(&Signs) -> bool| signs.iter().any(of);
        let switches = self.machine.switches();
        Ok(Along {
            driven: (0..dims.rows).map(|r| any(&|signs| signs.driven[r])).collect(),
            acts: (0..switches * dims.rows).map(|at| any(&|signs| signs.acts[at])).collect(),
            arguments: signs.into_iter().flat_map(|signs| signs.arguments).collect(),
            entries,
        })
    }

    /// Evaluates the rows at successive samples from `first` on, as many as there are entries.
    fn evaluate(
        &self,
        first: usize,
        entries: &mut [f64],
        motion: &[f64],
        inputs: &[Vec<f64>],
    ) -> Result<Signs, EvalError> {
        let Machine { model, derivatives, constants } = self.machine;
        let dims = model.dims();
        let (p, slots) = (dims.parameters, dims.motion_len());
        let switches = self.machine.switches();
        let mut scratch = vec![0.0; model.workspace_len()];
        let mut phi = vec![0.0; dims.regressor_len()];
        let mut known = vec![0.0; dims.rows];
        let mut map = vec![0.0; dims.input_map_len()];
        let mut rows = vec![0.0; derivatives.map_or(0, RowDerivatives::workspace_len)];
        let mut switching = vec![0.0; switches * (1 + dims.rows)];
        let (ones, rest) = (vec![1.0; p], vec![0.0; dims.inputs]);
        let mut signs =
            Signs { driven: vec![false; dims.rows], acts: vec![false; switches * dims.rows], arguments: Vec::new() };
        for (i, entries) in entries.chunks_exact_mut(dims.rows * (p + 1)).enumerate() {
            let k = first + i;
            let instant = &motion[k * slots..(k + 1) * slots];
            model.regressor(instant, constants, &mut scratch, &mut phi)?;
            model.known(instant, constants, &mut scratch, &mut known)?;
            model.input_map(instant, constants, &mut scratch, &mut map)?;
            for (r, entries) in entries.chunks_exact_mut(p + 1).enumerate() {
                entries[..p].copy_from_slice(&phi[r * p..(r + 1) * p]);
                let factors = &map[r * dims.inputs..(r + 1) * dims.inputs];
                signs.driven[r] |= factors.iter().any(|factor| factor.abs() > 0.0);
                let force: f64 = factors.iter().zip(inputs).map(|(factor, input)| factor * input[k]).sum();
                entries[p] = force - known[r];
            }
            if let Some(derivatives) = derivatives.filter(|_| switches > 0) {
                derivatives.switching(instant, &ones, constants, &rest, &mut rows, &mut switching)?;
                for (s, of) in switching.chunks_exact(1 + dims.rows).enumerate() {
                    signs.arguments.push(of[0]);
                    for (r, height) in of[1..].iter().enumerate() {
                        signs.acts[s * dims.rows + r] |= height.abs() > 0.0;
                    }
                }
            }
        }
        Ok(signs)
    }

    /// Per row, how many samples before each one have a sign in the row that is not known; nothing for a row without a sign.
    fn unsure(&self, right: &Along, noisy: &Along, fine: usize) -> Vec<Option<Vec<u32>>> {
        let rows = self.machine.model.dims().rows;
        let switches = right.arguments.len() / fine.max(1);
        let mut unsure = vec![false; fine * switches];
        for s in 0..switches {
            let argument = |k: usize| right.arguments[k * switches + s];
            let noise = root_mean_square((0..fine).map(|k| noisy.arguments[k * switches + s] - argument(k)));
            let bound = (alarm::SIGN_KNOWN * noise).max(LEAST_ARGUMENT * root_mean_square((0..fine).map(argument)));
            (0..fine).for_each(|k| unsure[k * switches + s] = argument(k).abs() <= bound);
        }
        let of = |r: usize| {
            let own: Vec<usize> = (0..switches).filter(|s| right.acts[s * rows + r]).collect();
            (!own.is_empty()).then(|| {
                let mut sums = Vec::with_capacity(fine + 1);
                let mut sum = 0;
                sums.push(sum);
                for k in 0..fine {
                    sum += u32::from(own.iter().any(|s| unsure[k * switches + s]));
                    sums.push(sum);
                }
                sums
            })
        };
        (0..rows).map(of).collect()
    }
}
