//! A record in the time domain, and its linearisation about a motion.

use crate::output_error::chain::Chain;
use crate::output_error::error::OutputErrorFault;
use crate::output_error::noise::Noise;
use crate::output_error::signals::Signals;
use crate::transition::{
    SHORTEST_PASSAGE, TRANSITIONS_PER_TASK, integral, loose, multiply, needed_steps, slow, states,
};
use rayon::prelude::*;
use std::ops::Range;
use tpm_controller::derivatives::RowDerivatives;
use tpm_controller::harmonics::Hold;
use tpm_controller::linear;
use tpm_controller::model::{EvalError, Model};
use tpm_numerics::{patience, root_mean_square, through_even};

/// Share of its root mean square velocity below which a coordinate turns: what a model without friction lacks may be anything there.
const TURNING_VELOCITY: f64 = 0.05;
/// A model that can be simulated, with the derivatives of its rows.
#[derive(Clone, Copy)]
pub struct Differentiable<'a> {
    /// The rows.
    pub model: &'a dyn Model<f64>,
    /// Their derivatives.
    pub derivatives: &'a dyn RowDerivatives<f64>,
}

impl std::fmt::Debug for Differentiable<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Differentiable").field("model", &self.model.name()).finish_non_exhaustive()
    }
}

/// A force or an error of a reading with an unknown factor, sample by sample.
#[derive(Clone, Debug)]
pub(super) struct Column {
    pub(super) place: Place,
    /// One value per sample.
    pub(super) values: Vec<f64>,
    /// Whether a value holds until the next sample, as held inputs do; otherwise it changes evenly.
    pub(super) held: bool,
}

/// Where a [`Column`] acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// On the left-hand side of a row.
    Row(usize),
    /// On the reading of a coordinate.
    Reading(usize),
}

/// The motion of a record, and what its inputs are taken to have been.
#[derive(Clone, Debug)]
pub(super) struct Trajectory {
    /// The states, sample by sample.
    pub(super) states: Vec<f64>,
    /// What the inputs are taken to be beside what was recorded, sample by sample.
    pub(super) disturbed: Vec<f64>,
    /// An input that acts otherwise than it was recorded, and how it acts, sample by sample.
    pub(super) applied: Option<(usize, Vec<f64>)>,
}

/// A record whose motion follows from its inputs.
#[derive(Clone)]
pub(super) struct Problem<'a> {
    pub(super) machine: Differentiable<'a>,
    pub(super) constants: &'a [f64],
    pub(super) hold: Hold,
    pub(super) sample_time: f64,
    pub(super) coordinates: Vec<&'a [f64]>,
    /// The readings of every sensor: the coordinates, then measured rates.
    pub(super) readings: Vec<&'a [f64]>,
    /// State that every sensor reads.
    pub(super) sensors: Vec<usize>,
    pub(super) inputs: Vec<&'a [f64]>,
    /// Parameters that are estimated.
    pub(super) free: Vec<usize>,
    /// Coordinate and order of every state.
    pub(super) states: Vec<(usize, usize)>,
    /// Whether the state after a sample does not follow from the one before.
    pub(super) breaks: Vec<bool>,
    /// Steps of integration per sample.
    pub(super) steps: usize,
    /// Fewest samples between two stops of a machine with friction.
    pub(super) shortest_passage: usize,
    /// Size of the noise of each sensor, beside which what is exact is small.
    pub(super) scale: Vec<f64>,
    /// Directions of the free parameters that the data do not show.
    pub(super) hidden: Vec<Vec<f64>>,
}

/// Motion and inputs at an instant.
struct Instant {
    motion: Vec<f64>,
    inputs: Vec<f64>,
    forward: Vec<f64>,
}

/// What the evaluation of a transition needs.
struct Scratch {
    now: Instant,
    rows: Vec<f64>,
    model: Vec<f64>,
    jacobian: Vec<f64>,
    phi: Vec<f64>,
    map: Vec<f64>,
    switching: Vec<f64>,
    rates: [Vec<f64>; 4],
    state: Vec<f64>,
    right: Vec<f64>,
    mass: Vec<f64>,
    matrix: Vec<f64>,
    jacobian_of_states: Vec<f64>,
    forces: Vec<f64>,
    power: Vec<f64>,
    product: Vec<f64>,
}

impl<'a> Problem<'a> {
    /// The problem of a record, with one step of integration per sample; `free` are the parameters that are estimated, `hidden` the
    /// directions of them that the data do not show.
    ///
    /// # Errors
    /// [`OutputErrorFault::NotSimulable`] when the rows do not determine the motion.
    pub(super) fn new(
        machine: Differentiable<'a>,
        constants: &'a [f64],
        signals: &Signals<'a>,
        noise: &Noise,
        free: &[usize],
        hidden: &[Vec<f64>],
    ) -> Result<Self, OutputErrorFault> {
        let states = states(machine.model).ok_or(OutputErrorFault::NotSimulable)?;
        let samples = signals.coordinates.first().map_or(0, |c| c.len());
        let place = |of: (usize, usize)| states.iter().position(|state| *state == of);
        let sensors: Vec<usize> =
            signals.sensors().map(place).collect::<Option<_>>().ok_or(OutputErrorFault::NotSimulable)?;
        let rates = signals.rates.iter().map(|rate| rate.readings);
        let outputs = sensors.len();
        let mut breaks = vec![false; samples.saturating_sub(1)];
        for &join in signals.joins.iter().filter(|join| (1..samples).contains(*join)) {
            breaks[join - 1] = true;
        }
        Ok(Problem {
            machine,
            constants,
            hold: signals.hold,
            sample_time: signals.sample_time,
            coordinates: signals.coordinates.clone(),
            readings: signals.coordinates.iter().copied().chain(rates).collect(),
            sensors,
            inputs: signals.inputs.clone(),
            free: free.to_vec(),
            states,
            breaks,
            steps: 1,
            shortest_passage: (signals.typical_period() * SHORTEST_PASSAGE) as usize,
            scale: (0..outputs).map(|c| noise.typical(c, outputs)).collect(),
            hidden: hidden.to_vec(),
        })
    }

    /// The problem of some of the samples.
    pub(super) fn part(&self, samples: Range<usize>) -> Self {
        let cut = |signals: &[&'a [f64]]| signals.iter().map(|signal| &signal[samples.clone()]).collect();
        Problem {
            coordinates: cut(&self.coordinates),
            readings: cut(&self.readings),
            inputs: cut(&self.inputs),
            breaks: self.breaks[samples.start..samples.end.max(samples.start + 1) - 1].to_vec(),
            ..self.clone()
        }
    }

    pub(super) fn samples(&self) -> usize {
        self.coordinates.first().map_or(0, |c| c.len())
    }

    fn scratch(&self) -> Scratch {
        let (dims, n) = (self.machine.model.dims(), self.states.len());
        let derivatives = self.machine.derivatives;
        Scratch {
            now: Instant {
                motion: vec![0.0; dims.motion_len()],
                inputs: vec![0.0; dims.inputs],
                forward: vec![0.0; self.machine.model.forward_workspace_len()],
            },
            rows: vec![0.0; derivatives.workspace_len()],
            model: vec![0.0; self.machine.model.workspace_len()],
            jacobian: vec![0.0; dims.rows * dims.motion_len()],
            phi: vec![0.0; dims.regressor_len()],
            map: vec![0.0; dims.input_map_len()],
            switching: vec![0.0; derivatives.switches() * (1 + dims.rows)],
            rates: std::array::from_fn(|_| vec![0.0; n]),
            state: vec![0.0; n],
            right: Vec::new(),
            mass: Vec::new(),
            matrix: Vec::new(),
            jacobian_of_states: Vec::new(),
            forces: Vec::new(),
            power: Vec::new(),
            product: Vec::new(),
        }
    }

    /// Place of a state in a motion.
    pub(super) fn place(&self, (coordinate, derivative): (usize, usize)) -> usize {
        derivative * self.machine.model.dims().coordinates + coordinate
    }

    /// Takes a state and the inputs at a share of the time after sample k, and solves the rows for the highest derivatives.
    fn at(
        &self,
        (k, share): (usize, f64),
        state: &[f64],
        trajectory: &Trajectory,
        theta: &[f64],
        now: &mut Instant,
    ) -> Result<(), EvalError> {
        let inputs = self.inputs.len();
        let disturbed = &trajectory.disturbed[k * inputs..(k + 1) * inputs];
        for (i, (value, disturbed)) in now.inputs.iter_mut().zip(disturbed).enumerate() {
            let input = match &trajectory.applied {
                Some((at, applied)) if *at == i => applied.as_slice(),
                _ => self.inputs[i],
            };
            *value = disturbed + self.between_samples(input, k, share);
        }
        for (&of, &value) in self.states.iter().zip(state) {
            now.motion[self.place(of)] = value;
        }
        self.machine.model.forward_dynamics(&mut now.motion, theta, self.constants, &now.inputs, &mut now.forward)
    }

    /// A recorded input at a share of the time after sample k.
    pub(super) fn between_samples(&self, input: &[f64], k: usize, share: f64) -> f64 {
        match self.hold {
            Hold::Zoh => input[k],
            Hold::None => between(input, k, share),
        }
    }

    /// The states of a trajectory at sample k.
    fn state<'t>(&self, trajectory: &'t Trajectory, k: usize) -> &'t [f64] {
        &trajectory.states[k * self.states.len()..(k + 1) * self.states.len()]
    }

    /// The state one sample after sample k of a trajectory, into `to`.
    fn advance(
        &self,
        k: usize,
        trajectory: &Trajectory,
        theta: &[f64],
        steps: usize,
        scratch: &mut Scratch,
        to: &mut [f64],
    ) -> Result<(), EvalError> {
        let h = self.sample_time / steps as f64;
        let coordinates = self.machine.model.dims().coordinates;
        let Scratch { now, rates, state, .. } = scratch;
        to.copy_from_slice(self.state(trajectory, k));
        for step in 0..steps {
            for stage in 0..4 {
                let reach = [0.0, 0.5, 0.5, 1.0][stage];
                for (i, value) in state.iter_mut().enumerate() {
                    let before = if stage > 0 { rates[stage - 1][i] } else { 0.0 };
                    *value = to[i] + reach * h * before;
                }
                self.at((k, (step as f64 + reach) / steps as f64), state, trajectory, theta, now)?;
                for (rate, &of) in rates[stage].iter_mut().zip(&self.states) {
                    *rate = now.motion[self.place(of) + coordinates];
                }
            }
            for (i, value) in to.iter_mut().enumerate() {
                let [a, b, c, d] = &*rates;
                *value += h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
            }
        }
        Ok(())
    }

    /// How many steps from one sample to the next leave no error of the integration that matters.
    pub(super) fn needed_steps(&self, trajectory: &Trajectory, theta: &[f64]) -> Result<usize, EvalError> {
        let transitions: Vec<usize> = (0..self.samples().saturating_sub(1)).collect();
        let mut scratch = self.scratch();
        let state = |k: usize| self.state(trajectory, k);
        needed_steps(&transitions, self.machine.derivatives.switches() > 0, state, |k, steps, to| {
            self.advance(k, trajectory, theta, steps, &mut scratch, to)
        })
    }

    /// Linearises the record about a trajectory, parameters and values of the columns.
    ///
    /// # Errors
    /// [`EvalError`] when the model cannot be evaluated.
    pub(super) fn linearise_at(
        &self,
        trajectory: &Trajectory,
        theta: &[f64],
        columns: &[Column],
        values: &[f64],
    ) -> Result<Chain, OutputErrorFault> {
        if patience::is_over() {
            return Err(OutputErrorFault::Ended);
        }
        let dims = self.machine.model.dims();
        let (n, samples) = (self.states.len(), self.samples());
        let switches = self.machine.derivatives.switches();
        let p = self.free.len() + columns.len();
        let width = p + dims.inputs + switches;
        let transitions = samples.saturating_sub(1);
        let outputs = self.sensors.len();
        let mut chain = Chain {
            samples,
            sample_time: self.sample_time,
            order: n,
            columns: p,
            inputs: dims.inputs,
            switches,
            states: self.states.clone(),
            outputs: self.sensors.clone(),
            scale: self.scale.clone(),
            breaks: self.breaks.clone(),
            transition: vec![0.0; transitions * n * n],
            forcing: vec![0.0; transitions * n * width],
            defect: vec![0.0; transitions * n],
            errors: vec![0.0; samples * outputs],
            reading_columns: Vec::new(),
            loose: self.loose(trajectory, theta)?,
            turns: self.turns(trajectory),
            disturbed: trajectory.disturbed.clone(),
            nothing: vec![0.0; p],
        };
        let parts = (chain.transition.par_chunks_mut(n * n * TRANSITIONS_PER_TASK))
            .zip(chain.forcing.par_chunks_mut((n * width).max(1) * TRANSITIONS_PER_TASK))
            .zip(chain.defect.par_chunks_mut(n * TRANSITIONS_PER_TASK))
            .enumerate();
        parts.try_for_each(|(task, ((transition, forcing), defect))| {
            let mut scratch = self.scratch();
            let mut next = vec![0.0; n];
            let parts = transition.chunks_exact_mut(n * n).zip(forcing.chunks_exact_mut(n * width));
            for (i, ((transition, forcing), defect)) in parts.zip(defect.chunks_exact_mut(n)).enumerate() {
                let k = task * TRANSITIONS_PER_TASK + i;
                let (from, to) = (self.state(trajectory, k), self.state(trajectory, k + 1));
                self.advance(k, trajectory, theta, self.steps, &mut scratch, &mut next)?;
                for (s, value) in defect.iter_mut().enumerate() {
                    *value = next[s] - to[s];
                    next[s] = 0.5 * (next[s] + from[s]);
                }
                self.differentiate((k, &next), trajectory, theta, columns, &mut scratch, (transition, forcing))?;
            }
            Ok::<(), EvalError>(())
        })?;
        for (k, errors) in chain.errors.chunks_exact_mut(outputs).enumerate() {
            for (c, error) in errors.iter_mut().enumerate() {
                *error = self.readings[c][k] - trajectory.states[k * n + chain.outputs[c]];
            }
        }
        if columns.iter().any(|column| matches!(column.place, Place::Reading(_))) {
            chain.reading_columns = vec![0.0; samples * outputs * p];
            for (j, column) in columns.iter().enumerate() {
                let Place::Reading(c) = column.place else { continue };
                for (k, value) in column.values.iter().enumerate() {
                    chain.reading_columns[(k * outputs + c) * p + self.free.len() + j] = *value;
                }
            }
        }
        for (j, value) in values.iter().enumerate().filter(|(_, value)| value.abs() > 0.0) {
            let at = self.free.len() + j;
            for (defect, forcing) in chain.defect.iter_mut().zip(chain.forcing.chunks_exact(width)) {
                *defect += value * forcing[at];
            }
            if let Place::Reading(c) = columns[j].place {
                let errors = chain.errors.iter_mut().skip(c).step_by(outputs);
                for (error, own) in errors.zip(&columns[j].values) {
                    *error -= value * own;
                }
            }
        }
        Ok(chain)
    }

    /// Derivatives of the transition after sample k at the state in its middle: those of `exp(J h)` and of its integral, to the fourth
    /// order.
    fn differentiate(
        &self,
        (k, middle): (usize, &[f64]),
        trajectory: &Trajectory,
        theta: &[f64],
        columns: &[Column],
        scratch: &mut Scratch,
        (transition, forcing): (&mut [f64], &mut [f64]),
    ) -> Result<(), EvalError> {
        let (model, derivatives) = (self.machine.model, self.machine.derivatives);
        let dims = model.dims();
        let (n, rows) = (self.states.len(), dims.rows);
        let switches = derivatives.switches();
        let p = self.free.len() + columns.len();
        let width = p + dims.inputs + switches;
        self.at((k, 0.5), middle, trajectory, theta, &mut scratch.now)?;
        let Instant { motion, inputs, .. } = &scratch.now;
        derivatives.rows(motion, theta, self.constants, inputs, &mut scratch.rows, &mut scratch.jacobian)?;
        model.sensitivity(motion, theta, self.constants, &mut scratch.model, &mut scratch.phi)?;
        model.input_map(motion, self.constants, &mut scratch.model, &mut scratch.map)?;
        if switches > 0 {
            self.switching(theta, scratch)?;
        }
        // Right-hand sides of M x = -dr/d(state), -phi, ..., B, -jump: one row of `right` per column.
        let motion_len = dims.motion_len();
        let all = n + width;
        let Scratch { jacobian, phi, map, switching, right, mass, matrix, .. } = scratch;
        right.clear();
        right.resize(all * rows, 0.0);
        mass.clear();
        for row in 0..rows {
            let mut put = |column: usize, value: f64| right[column * rows + row] = value;
            for (s, &of) in self.states.iter().enumerate() {
                put(s, -jacobian[row * motion_len + self.place(of)]);
            }
            for (j, &free) in self.free.iter().enumerate() {
                put(n + j, -phi[row * dims.parameters + free]);
            }
            for (j, column) in columns.iter().enumerate() {
                if column.place == Place::Row(row) {
                    let later = if column.held { column.values[k] } else { column.values[k + 1] };
                    put(n + self.free.len() + j, -0.5 * (column.values[k] + later));
                }
            }
            for i in 0..dims.inputs {
                put(n + p + i, map[row * dims.inputs + i]);
            }
            for s in 0..switches {
                put(n + p + dims.inputs + s, -switching[s * (1 + rows) + 1 + row]);
            }
            mass.extend(
                (0..rows).map(|c| jacobian[row * motion_len + model.coordinate_order(c) * dims.coordinates + c]),
            );
        }
        for column in right.chunks_exact_mut(rows) {
            matrix.clear();
            matrix.extend_from_slice(mass);
            let solved = linear::solve_in_place(matrix, column);
            solved.map_err(|coordinate| EvalError::Singular { coordinate })?;
        }
        // J: rates of the states by the states; g: by the forcings.
        let Scratch { right, jacobian_of_states: jacobian, forces: rates, power, product, .. } = scratch;
        jacobian.clear();
        jacobian.resize(n * n, 0.0);
        rates.clear();
        rates.resize(n * width, 0.0);
        for (s, &(c, d)) in self.states.iter().enumerate() {
            if d + 1 < model.coordinate_order(c) {
                jacobian[s * n + s + 1] = 1.0;
            } else {
                for j in 0..n {
                    jacobian[s * n + j] = right[j * rows + c];
                }
                for j in 0..width {
                    rates[s * width + j] = right[(n + j) * rows + c];
                }
            }
        }
        integral(jacobian, n, self.sample_time, power, product);
        transition.fill(0.0);
        multiply(jacobian, power, n, n, transition);
        for s in 0..n {
            transition[s * n + s] += 1.0;
        }
        forcing.fill(0.0);
        multiply(power, rates, n, width, forcing);
        Ok(())
    }

    /// Arguments and jumps of all switches at the instant in `scratch`.
    fn switching(&self, theta: &[f64], scratch: &mut Scratch) -> Result<(), EvalError> {
        let Instant { motion, inputs, .. } = &scratch.now;
        let derivatives = self.machine.derivatives;
        derivatives.switching(motion, theta, self.constants, inputs, &mut scratch.rows, &mut scratch.switching)
    }

    /// Evaluates `width` numbers at every sample of a trajectory.
    fn at_every_sample(
        &self,
        trajectory: &Trajectory,
        theta: &[f64],
        width: usize,
        evaluate: impl Fn(&mut Scratch, &mut [f64]) -> Result<(), EvalError> + Sync,
    ) -> Result<Vec<f64>, EvalError> {
        let mut values = vec![0.0; self.samples() * width];
        values.par_chunks_mut(width.max(1) * TRANSITIONS_PER_TASK).enumerate().try_for_each(|(task, values)| {
            let mut scratch = self.scratch();
            for (i, values) in values.chunks_exact_mut(width).enumerate() {
                let k = task * TRANSITIONS_PER_TASK + i;
                self.at((k, 0.0), self.state(trajectory, k), trajectory, theta, &mut scratch.now)?;
                evaluate(&mut scratch, values)?;
            }
            Ok(())
        })?;
        Ok(values)
    }

    /// The regressor and, behind it, the input map along a trajectory, sample by sample.
    pub(super) fn along(&self, trajectory: &Trajectory, theta: &[f64]) -> Result<Vec<f64>, EvalError> {
        let model = self.machine.model;
        let dims = model.dims();
        let width = dims.regressor_len() + dims.input_map_len();
        self.at_every_sample(trajectory, theta, width, |scratch, values| {
            let (regressor, map) = values.split_at_mut(dims.regressor_len());
            model.sensitivity(&scratch.now.motion, theta, self.constants, &mut scratch.model, regressor)?;
            model.input_map(&scratch.now.motion, self.constants, &mut scratch.model, map)
        })
    }

    /// Whether a coordinate turns in a transition, or moves slowly beside its root mean square velocity.
    fn turns(&self, trajectory: &Trajectory) -> Vec<bool> {
        let (n, samples) = (self.states.len(), self.samples());
        let mut turns = vec![false; samples.saturating_sub(1)];
        for s in (0..n).filter(|&s| self.states[s].1 == 1) {
            let rate = |k: usize| trajectory.states[k * n + s];
            let band = TURNING_VELOCITY * root_mean_square((0..samples).map(rate));
            for (k, turn) in turns.iter_mut().enumerate() {
                *turn |= slow(rate(k), rate(k + 1), band);
            }
        }
        turns
    }

    /// How loose every switch's force is in every transition, as a multiple of half its jump.
    pub(super) fn loose(&self, trajectory: &Trajectory, theta: &[f64]) -> Result<Vec<f64>, EvalError> {
        let (switches, rows) = (self.machine.derivatives.switches(), self.machine.model.dims().rows);
        if switches == 0 {
            return Ok(Vec::new());
        }
        let arguments = self.at_every_sample(trajectory, theta, switches, |scratch, values| {
            self.switching(theta, scratch)?;
            let arguments = scratch.switching.iter().step_by(1 + rows);
            values.iter_mut().zip(arguments).for_each(|(value, argument)| *value = *argument);
            Ok(())
        })?;
        Ok(loose(&arguments, switches, self.shortest_passage, self.hold))
    }
}

/// A signal at a share of the time after sample k: the polynomial through six samples around.
fn between(signal: &[f64], k: usize, share: f64) -> f64 {
    const NODES: usize = 6;
    if share <= 0.0 || signal.len() < NODES {
        return signal[k];
    }
    let first = k.saturating_sub(NODES / 2 - 1).min(signal.len() - NODES);
    let six: [f64; NODES] = std::array::from_fn(|i| signal[first + i]);
    through_even(six, (k - first) as f64 + share)
}
