//! A model along a record, and its linearisation about a motion.

use crate::output_error::{Differentiable, OutputErrorFault};
use crate::simulation::chain::{Chain, Read};
use crate::simulation::record::{Instants, Piece, Reading, Record};
use crate::transition::{SHORTEST_PASSAGE, TRANSITIONS_PER_TASK, integral, loose, multiply, needed_steps, states};
use rayon::prelude::*;
use tpm_controller::harmonics::Hold;
use tpm_controller::linear;
use tpm_controller::model::EvalError;
use tpm_numerics::root_mean_square;

/// Longest time by which an input that is not held may be recorded too late, s.
const LONGEST_LEAD: f64 = 0.06;
/// Deviation of a state of which nothing is known, in units of what it varies over the record.
const UNKNOWN: f64 = 10.0;
/// Steps of integration are not cut at a stamp that is nearer to an end than this share of a step.
const SHORTEST_PART: f64 = 1e-9;

/// A force, or an error of readings, with an unknown factor.
#[derive(Clone, Debug)]
pub(super) enum Column {
    /// On the left-hand sides of rows, instant by instant; it changes evenly from one to the next.
    Force(Vec<(usize, Vec<f64>)>),
    /// By how much later an input acts, s.
    Delay(usize),
    /// On the readings of a sensor, instant by instant.
    Reading(usize, Vec<f64>),
}

/// What is known, beside the record, of where the linearisation is made.
#[derive(Clone, Debug)]
pub(super) struct Point {
    /// The states, instant by instant.
    pub(super) states: Vec<f64>,
    /// Values of all parameters.
    pub(super) theta: Vec<f64>,
    /// How much later every input acts than it is recorded, s.
    pub(super) delays: Vec<f64>,
    /// Largest size of every input that acts: more of it is cut off.
    pub(super) limits: Vec<f64>,
}

impl Point {
    /// The least delay of an input: what is held cannot act before it is commanded.
    pub(super) fn least_delay(&self, problem: &Problem<'_>) -> f64 {
        if problem.record.hold == Hold::Zoh { 0.0 } else { -LONGEST_LEAD }
    }
}

/// A model along a record.
#[derive(Clone)]
pub(super) struct Problem<'a> {
    pub(super) machine: Differentiable<'a>,
    pub(super) constants: &'a [f64],
    pub(super) record: &'a Record,
    pub(super) instants: Instants,
    /// Parameters that are estimated.
    pub(super) free: Vec<usize>,
    /// Coordinate and order of every state.
    pub(super) states: Vec<(usize, usize)>,
    /// State that every sensor reads.
    pub(super) sensors: Vec<usize>,
    /// Time in which the motion goes to and fro once, on the average, s.
    pub(super) typical_period: f64,
    /// Longest step of the integration, s.
    pub(super) longest_step: f64,
    /// Standard deviation of every switch's force as a multiple of half its jump, per transition. All ways to explain a record share it, so
    /// that their likelihoods can be compared.
    pub(super) loose: Vec<f64>,
}

/// Motion and inputs at a time.
struct Now {
    motion: Vec<f64>,
    inputs: Vec<f64>,
    forward: Vec<f64>,
    /// Where every input was asked for last.
    pieces: Vec<Piece>,
}

/// What the evaluation of a transition needs.
struct Scratch {
    now: Now,
    rows: Vec<f64>,
    model: Vec<f64>,
    jacobian: Vec<f64>,
    phi: Vec<f64>,
    map: Vec<f64>,
    switching: Vec<f64>,
    rates: [Vec<f64>; 4],
    stage: Vec<f64>,
    state: Vec<f64>,
    middle: Vec<f64>,
    right: Vec<f64>,
    mass: Vec<f64>,
    matrix: Vec<f64>,
    by_states: Vec<f64>,
    by_forcings: Vec<f64>,
    power: Vec<f64>,
    product: Vec<f64>,
    step_transition: Vec<f64>,
    step_forcing: Vec<f64>,
    parts: Vec<f64>,
}

impl<'a> Problem<'a> {
    /// The model along a record; `free` are the parameters that are estimated, `typical_period` the time in which the motion goes to and fro
    /// once, s.
    ///
    /// # Errors
    /// [`OutputErrorFault::NotSimulable`] when the rows do not determine the motion, or a sensor reads no state.
    pub(super) fn new(
        machine: Differentiable<'a>,
        constants: &'a [f64],
        record: &'a Record,
        free: Vec<usize>,
        typical_period: f64,
    ) -> Result<Self, OutputErrorFault> {
        let states = states(machine.model).ok_or(OutputErrorFault::NotSimulable)?;
        let place = |own: &Reading| states.iter().position(|state| *state == (own.coordinate, own.derivative));
        let sensors = record.sensors.iter().map(place).collect::<Option<_>>().ok_or(OutputErrorFault::NotSimulable)?;
        let instants = record.instants();
        let longest_step = instants.usual_step;
        let loose = vec![0.0; instants.len().saturating_sub(1) * machine.derivatives.switches()];
        Ok(Problem { machine, constants, record, instants, free, states, sensors, typical_period, longest_step, loose })
    }

    /// The sensor that reads a coordinate itself.
    pub(super) fn sensor(&self, coordinate: usize) -> Option<usize> {
        self.record.sensors.iter().position(|own| own.coordinate == coordinate && own.derivative == 0)
    }

    /// Place of a state in a motion.
    fn place(&self, (coordinate, derivative): (usize, usize)) -> usize {
        derivative * self.machine.model.dims().coordinates + coordinate
    }

    fn scratch(&self) -> Scratch {
        let (model, derivatives) = (self.machine.model, self.machine.derivatives);
        let (dims, n) = (model.dims(), self.states.len());
        Scratch {
            now: Now {
                motion: vec![0.0; dims.motion_len()],
                inputs: vec![0.0; dims.inputs],
                forward: vec![0.0; model.forward_workspace_len()],
                pieces: vec![Piece::default(); dims.inputs],
            },
            rows: vec![0.0; derivatives.workspace_len()],
            model: vec![0.0; model.workspace_len()],
            jacobian: vec![0.0; dims.rows * dims.motion_len()],
            phi: vec![0.0; dims.regressor_len()],
            map: vec![0.0; dims.input_map_len()],
            switching: vec![0.0; derivatives.switches() * (1 + dims.rows)],
            rates: std::array::from_fn(|_| vec![0.0; n]),
            stage: vec![0.0; n],
            state: vec![0.0; n],
            middle: vec![0.0; n],
            right: Vec::new(),
            mass: Vec::new(),
            matrix: Vec::new(),
            by_states: Vec::new(),
            by_forcings: Vec::new(),
            power: Vec::new(),
            product: Vec::new(),
            step_transition: Vec::new(),
            step_forcing: Vec::new(),
            parts: Vec::new(),
        }
    }

    /// An input as it acts at a time, and how fast it changes then.
    fn acting(&self, input: usize, point: &Point, (k, time): (usize, f64), piece: &mut Piece) -> (f64, f64) {
        let own = (input, &self.record.inputs[input]);
        let (value, rate) = self.instants.input(own, self.record.hold, (k, time - point.delays[input]), piece);
        let limit = point.limits[input];
        if value.abs() > limit { (value.clamp(-limit, limit), 0.0) } else { (value, rate) }
    }

    /// Takes a state and the inputs at a time after instant k, and solves the rows for the highest derivatives.
    fn at(&self, (k, time): (usize, f64), state: &[f64], point: &Point, now: &mut Now) -> Result<(), EvalError> {
        for i in 0..self.record.inputs.len() {
            now.inputs[i] = self.acting(i, point, (k, time), &mut now.pieces[i]).0;
        }
        for (&of, &value) in self.states.iter().zip(state) {
            now.motion[self.place(of)] = value;
        }
        self.machine.model.forward_dynamics(
            &mut now.motion,
            &point.theta,
            self.constants,
            &now.inputs,
            &mut now.forward,
        )
    }

    fn state<'t>(&self, point: &'t Point, k: usize) -> &'t [f64] {
        &point.states[k * self.states.len()..(k + 1) * self.states.len()]
    }

    /// The ends of the steps of integration after instant k, none longer than `longest`: stamps of held inputs are among them.
    fn steps(&self, k: usize, longest: f64, point: &Point, parts: &mut Vec<f64>) {
        let (from, to) = (self.instants.time[k], self.instants.time[k + 1]);
        parts.clear();
        parts.push(from);
        let nearest = SHORTEST_PART * (to - from);
        if self.record.hold == Hold::Zoh {
            for (i, input) in self.record.inputs.iter().enumerate() {
                let own = self.instants.switches((i, input), k, (from - point.delays[i], to - point.delays[i]));
                parts.extend(own.map(|(at, ..)| at + point.delays[i]));
            }
            parts.retain(|at| *at == from || (*at > from + nearest && *at < to - nearest));
            parts.sort_by(f64::total_cmp);
            parts.dedup_by(|a, b| *a - *b < nearest);
        }
        parts.push(to);
        let cuts = parts.len();
        for i in 1..cuts {
            let (a, b) = (parts[i - 1], parts[i]);
            let count = ((b - a) / longest - 1e-6).ceil().max(1.0) as usize;
            parts.extend((1..count).map(|step| a + (b - a) * step as f64 / count as f64));
        }
        parts.sort_by(f64::total_cmp);
    }

    /// One step of Runge and Kutta's rule on the state in `scratch`; the time within is kept off its ends, where a held input jumps.
    fn step(&self, k: usize, (from, to): (f64, f64), point: &Point, scratch: &mut Scratch) -> Result<(), EvalError> {
        let h = to - from;
        let coordinates = self.machine.model.dims().coordinates;
        let held = self.record.hold == Hold::Zoh;
        let Scratch { now, rates, stage, state, .. } = scratch;
        for (turn, reach) in [0.0, 0.5, 0.5, 1.0].into_iter().enumerate() {
            for (i, value) in stage.iter_mut().enumerate() {
                let before = if turn > 0 { rates[turn - 1][i] } else { 0.0 };
                *value = state[i] + reach * h * before;
            }
            let time = from + h * if held { 0.5 } else { reach };
            self.at((k, time), stage, point, now)?;
            for (rate, &of) in rates[turn].iter_mut().zip(&self.states) {
                *rate = now.motion[self.place(of) + coordinates];
            }
        }
        for (i, value) in state.iter_mut().enumerate() {
            let [a, b, c, d] = &*rates;
            *value += h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
        }
        Ok(())
    }

    fn advance(
        &self,
        k: usize,
        state: &[f64],
        longest: f64,
        point: &Point,
        scratch: &mut Scratch,
    ) -> Result<(), EvalError> {
        let mut parts = std::mem::take(&mut scratch.parts);
        self.steps(k, longest, point, &mut parts);
        scratch.state.copy_from_slice(state);
        for pair in parts.windows(2) {
            self.step(k, (pair[0], pair[1]), point, scratch)?;
        }
        scratch.parts = parts;
        Ok(())
    }

    /// The longest step of integration that leaves no error that matters.
    ///
    /// # Errors
    /// [`EvalError`] when the model cannot be evaluated.
    pub(super) fn needed_step(&self, point: &Point) -> Result<f64, EvalError> {
        let usual = self.instants.usual_step;
        let transitions: Vec<usize> = (0..self.instants.len()).filter(|&k| self.instants.goes_on(k)).collect();
        let mut scratch = self.scratch();
        let state = |k: usize| self.state(point, k);
        let steps = needed_steps(&transitions, self.machine.derivatives.switches() > 0, state, |k, steps, to| {
            self.advance(k, state(k), usual / steps as f64, point, &mut scratch)?;
            to.copy_from_slice(&scratch.state);
            Ok(())
        })?;
        Ok(usual / steps as f64)
    }

    /// Linearises the record about a point, with values of the columns.
    ///
    /// # Errors
    /// [`EvalError`] when the model cannot be evaluated.
    pub(super) fn linearise(&self, point: &Point, columns: &[Column], values: &[f64]) -> Result<Chain, EvalError> {
        let dims = self.machine.model.dims();
        let (n, instants) = (self.states.len(), self.instants.len());
        let switches = self.machine.derivatives.switches();
        let p = self.free.len() + columns.len();
        let width = p + dims.rows + switches;
        let transitions = instants.saturating_sub(1);
        let mut chain = Chain {
            order: n,
            columns: p,
            rows: dims.rows,
            switches,
            time: self.instants.time.clone(),
            begins: self.instants.begins.clone(),
            transition: vec![0.0; transitions * n * n],
            forcing: vec![0.0; transitions * n * width],
            defect: vec![0.0; transitions * n],
            loose: self.loose.clone(),
            ..Chain::default()
        };
        let parts = (chain.transition.par_chunks_mut(n * n * TRANSITIONS_PER_TASK))
            .zip(chain.forcing.par_chunks_mut((n * width).max(1) * TRANSITIONS_PER_TASK))
            .zip(chain.defect.par_chunks_mut(n * TRANSITIONS_PER_TASK))
            .enumerate();
        parts.try_for_each(|(task, ((transition, forcing), defect))| {
            let mut scratch = self.scratch();
            let parts = transition.chunks_exact_mut(n * n).zip(forcing.chunks_exact_mut(n * width));
            for (i, ((transition, forcing), defect)) in parts.zip(defect.chunks_exact_mut(n)).enumerate() {
                let k = task * TRANSITIONS_PER_TASK + i;
                if self.instants.goes_on(k) {
                    self.transition(k, point, columns, &mut scratch, (transition, forcing))?;
                    let to = self.state(point, k + 1);
                    defect.iter_mut().zip(&scratch.state).zip(to).for_each(|((defect, own), to)| *defect = own - to);
                }
            }
            Ok(())
        })?;
        for (defect, forcing) in chain.defect.iter_mut().zip(chain.forcing.chunks_exact(width)) {
            for (value, forced) in values.iter().zip(&forcing[self.free.len()..]) {
                *defect += value * forced;
            }
        }
        self.read(point, columns, values, &mut chain);
        Ok(chain)
    }

    /// The readings, linearised.
    fn read(&self, point: &Point, columns: &[Column], values: &[f64], chain: &mut Chain) {
        let (n, fixed) = (self.states.len(), self.free.len());
        let of_readings: Vec<(usize, usize, &Vec<f64>)> = columns
            .iter()
            .enumerate()
            .filter_map(|(j, column)| match column {
                Column::Reading(sensor, own) => Some((j, *sensor, own)),
                _ => None,
            })
            .collect();
        for (k, readings) in self.instants.readings.iter().enumerate() {
            chain.first_read.push(chain.reads.len());
            for at in readings {
                let state = self.sensors[at.sensor];
                let mut error = at.value - point.states[k * n + state];
                if !of_readings.is_empty() {
                    let mut row = vec![0.0; chain.columns];
                    for (j, _, own) in of_readings.iter().filter(|(_, sensor, _)| *sensor == at.sensor) {
                        row[fixed + j] = own[k];
                        error -= values.get(*j).copied().unwrap_or(0.0) * own[k];
                    }
                    chain.read_columns.extend(row);
                }
                chain.reads.push(Read { sensor: at.sensor, state, error, variance: at.variance });
            }
        }
        chain.first_read.push(chain.reads.len());
        let spread = |s: usize| {
            let own = || point.states.iter().skip(s).step_by(n).copied();
            let mean = own().sum::<f64>() / self.instants.len().max(1) as f64;
            (UNKNOWN * root_mean_square(own().map(|x| x - mean))).powi(2).max(f64::MIN_POSITIVE)
        };
        chain.unknown = (0..n).map(spread).collect();
    }

    /// The transition after instant k, with the state at its end in `scratch`: step by step `exp(J h)` and its integral, to the fourth
    /// order.
    fn transition(
        &self,
        k: usize,
        point: &Point,
        columns: &[Column],
        scratch: &mut Scratch,
        (transition, forcing): (&mut [f64], &mut [f64]),
    ) -> Result<(), EvalError> {
        let n = self.states.len();
        let dims = self.machine.model.dims();
        let switches = self.machine.derivatives.switches();
        let width = self.free.len() + columns.len() + dims.rows + switches;
        let mut parts = std::mem::take(&mut scratch.parts);
        self.steps(k, self.longest_step, point, &mut parts);
        scratch.state.copy_from_slice(self.state(point, k));
        transition.fill(0.0);
        (0..n).for_each(|s| transition[s * n + s] = 1.0);
        forcing.fill(0.0);
        for pair in parts.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            scratch.middle.copy_from_slice(&scratch.state);
            self.step(k, (from, to), point, scratch)?;
            let Scratch { middle, state, .. } = scratch;
            middle.iter_mut().zip(&*state).for_each(|(middle, state)| *middle = 0.5 * (*middle + state));
            self.slopes((k, from, to), point, columns, scratch)?;
            let Scratch { by_states, by_forcings, power, product, step_transition, step_forcing, .. } = scratch;
            integral(by_states, n, to - from, power, product);
            step_transition.clear();
            step_transition.resize(n * n, 0.0);
            multiply(by_states, power, n, n, step_transition);
            (0..n).for_each(|s| step_transition[s * n + s] += 1.0);
            product.clear();
            product.resize(n * n, 0.0);
            multiply(step_transition, transition, n, n, product);
            transition.copy_from_slice(product);
            step_forcing.clear();
            step_forcing.resize(n * width, 0.0);
            multiply(step_transition, forcing, n, width, step_forcing);
            multiply(power, by_forcings, n, width, step_forcing);
            forcing.copy_from_slice(step_forcing);
        }
        scratch.parts = parts;
        Ok(())
    }

    /// Rates of the states by the states and by the forcings, at the state in the middle of a step.
    fn slopes(
        &self,
        (k, from, to): (usize, f64, f64),
        point: &Point,
        columns: &[Column],
        scratch: &mut Scratch,
    ) -> Result<(), EvalError> {
        let (model, derivatives) = (self.machine.model, self.machine.derivatives);
        let dims = model.dims();
        let (n, rows, fixed) = (self.states.len(), dims.rows, self.free.len());
        let switches = derivatives.switches();
        let p = fixed + columns.len();
        let width = p + rows + switches;
        let (time, h) = (0.5 * (from + to), to - from);
        let middle = std::mem::take(&mut scratch.middle);
        self.at((k, time), &middle, point, &mut scratch.now)?;
        scratch.middle = middle;
        let Now { motion, inputs, .. } = &scratch.now;
        derivatives.rows(motion, &point.theta, self.constants, inputs, &mut scratch.rows, &mut scratch.jacobian)?;
        model.sensitivity(motion, &point.theta, self.constants, &mut scratch.model, &mut scratch.phi)?;
        model.input_map(motion, self.constants, &mut scratch.model, &mut scratch.map)?;
        if switches > 0 {
            let own = &mut scratch.switching;
            derivatives.switching(motion, &point.theta, self.constants, inputs, &mut scratch.rows, own)?;
        }
        // Right-hand sides of M x = -dr/d(state), -phi, ..., unit forces, -jump: one row of `right` per column.
        let motion_len = dims.motion_len();
        let share = (time - self.instants.time[k]) / self.instants.after(k);
        let Scratch { jacobian, phi, map, switching, right, mass, matrix, .. } = scratch;
        right.clear();
        right.resize((n + width) * rows, 0.0);
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
                match column {
                    Column::Force(own) => {
                        for (_, values) in own.iter().filter(|(of, _)| *of == row) {
                            put(n + fixed + j, -(values[k] + share * (values[k + 1] - values[k])));
                        }
                    }
                    Column::Delay(input) => {
                        let slower = self.later(*input, point, (k, from, to), h);
                        put(n + fixed + j, map[row * dims.inputs + input] * slower);
                    }
                    Column::Reading(..) => {}
                }
            }
            put(n + p + row, 1.0);
            for s in 0..switches {
                put(n + p + rows + s, -switching[s * (1 + rows) + 1 + row]);
            }
            mass.extend(
                (0..rows).map(|c| jacobian[row * motion_len + model.coordinate_order(c) * dims.coordinates + c]),
            );
        }
        for column in right.chunks_exact_mut(rows) {
            if column.iter().all(|value| *value == 0.0) {
                continue;
            }
            matrix.clear();
            matrix.extend_from_slice(mass);
            let solved = linear::solve_in_place(matrix, column);
            solved.map_err(|coordinate| EvalError::Singular { coordinate })?;
        }
        let Scratch { right, by_states, by_forcings, .. } = scratch;
        by_states.clear();
        by_states.resize(n * n, 0.0);
        by_forcings.clear();
        by_forcings.resize(n * width, 0.0);
        for (s, &(c, d)) in self.states.iter().enumerate() {
            if d + 1 < model.coordinate_order(c) {
                by_states[s * n + s + 1] = 1.0;
            } else {
                (0..n).for_each(|j| by_states[s * n + j] = right[j * rows + c]);
                (0..width).for_each(|j| by_forcings[s * width + j] = right[(n + j) * rows + c]);
            }
        }
        Ok(())
    }

    /// By how much an input is less, on the average of a step of length `h`, when it acts later, per s.
    fn later(&self, input: usize, point: &Point, (k, from, to): (usize, f64, f64), h: f64) -> f64 {
        if self.record.hold == Hold::None {
            return -self.acting(input, point, (k, 0.5 * (from + to)), &mut Piece::default()).1;
        }
        // A held input that jumps at the begin of the step keeps its old value a little longer. Jumps within a transition are at begins.
        let own = (input, &self.record.inputs[input]);
        let late = point.delays[input];
        let near = SHORTEST_PART.max(1e-6) * h;
        let limit = point.limits[input];
        let clamped = |value: f64| value.clamp(-limit, limit);
        let jumps = self.instants.switches(own, k, (from - late - near, from - late + near));
        jumps.map(|(_, before, after)| (clamped(before) - clamped(after)) / h).sum()
    }

    /// Arguments of all switches at every instant.
    fn arguments(&self, point: &Point) -> Result<Vec<f64>, EvalError> {
        let (switches, rows) = (self.machine.derivatives.switches(), self.machine.model.dims().rows);
        let mut values = vec![0.0; self.instants.len() * switches];
        values.par_chunks_mut(switches.max(1) * TRANSITIONS_PER_TASK).enumerate().try_for_each(|(task, values)| {
            let mut scratch = self.scratch();
            for (i, values) in values.chunks_exact_mut(switches).enumerate() {
                let k = task * TRANSITIONS_PER_TASK + i;
                self.at((k, self.instants.time[k]), self.state(point, k), point, &mut scratch.now)?;
                let Now { motion, inputs, .. } = &scratch.now;
                let own = &mut scratch.switching;
                let derivatives = self.machine.derivatives;
                derivatives.switching(motion, &point.theta, self.constants, inputs, &mut scratch.rows, own)?;
                let arguments = own.iter().step_by(1 + rows);
                values.iter_mut().zip(arguments).for_each(|(value, argument)| *value = *argument);
            }
            Ok(())
        })?;
        Ok(values)
    }

    /// The highest derivatives, and the rows' shares of every input, at every instant: instant by instant the accelerations of all
    /// coordinates, then the input map, then the inputs and their rates.
    pub(super) fn along(&self, point: &Point) -> Result<Along, EvalError> {
        let dims = self.machine.model.dims();
        let width = dims.coordinates + dims.input_map_len() + 2 * dims.inputs + dims.rows;
        let mut values = vec![0.0; self.instants.len() * width];
        values.par_chunks_mut(width * TRANSITIONS_PER_TASK).enumerate().try_for_each(|(task, values)| {
            let mut scratch = self.scratch();
            for (i, values) in values.chunks_exact_mut(width).enumerate() {
                let k = task * TRANSITIONS_PER_TASK + i;
                let time = self.instants.time[k];
                self.at((k, time), self.state(point, k), point, &mut scratch.now)?;
                let model = self.machine.model;
                let (accelerations, rest) = values.split_at_mut(dims.coordinates);
                for (c, value) in accelerations.iter_mut().enumerate() {
                    *value = scratch.now.motion[model.coordinate_order(c) * dims.coordinates + c];
                }
                let (map, rest) = rest.split_at_mut(dims.input_map_len());
                model.input_map(&scratch.now.motion, self.constants, &mut scratch.model, map)?;
                let (inputs, rest) = rest.split_at_mut(2 * dims.inputs);
                for i in 0..dims.inputs {
                    let piece = &mut scratch.now.pieces[i];
                    (inputs[i], inputs[dims.inputs + i]) = self.acting(i, point, (k, time), piece);
                }
                model.known(&scratch.now.motion, self.constants, &mut scratch.model, rest)?;
            }
            Ok(())
        })?;
        Ok(Along { coordinates: dims.coordinates, inputs: dims.inputs, rows: dims.rows, width, values })
    }

    /// What an input's limit does to the rows where it is reached.
    ///
    /// # Errors
    /// [`EvalError`] when the model cannot be evaluated.
    pub(super) fn edge(&self, point: &Point, input: usize) -> Result<Column, EvalError> {
        let along = self.along(point)?;
        let limit = point.limits[input];
        let of = |row: usize| {
            let pairs = along.series(along.factor(row, input)).zip(along.series(along.first_input() + input));
            let values = pairs.map(|(factor, u)| if u.abs() >= limit { -factor * u.signum() } else { 0.0 });
            (row, values.collect::<Vec<f64>>())
        };
        Ok(Column::Force((0..self.machine.model.dims().rows).filter(|&row| along.acts(row, input)).map(of).collect()))
    }

    /// How loose every switch's force is in every transition, as a multiple of half its jump.
    pub(super) fn found_loose(&self, point: &Point) -> Result<Vec<f64>, EvalError> {
        let switches = self.machine.derivatives.switches();
        if switches == 0 {
            return Ok(Vec::new());
        }
        let usual = self.instants.usual_step.max(f64::MIN_POSITIVE);
        let shortest_passage = (self.typical_period * SHORTEST_PASSAGE / usual) as usize;
        Ok(loose(&self.arguments(point)?, switches, shortest_passage, self.record.hold))
    }
}

/// What the rows have at every instant of a motion.
pub(super) struct Along {
    coordinates: usize,
    inputs: usize,
    rows: usize,
    width: usize,
    values: Vec<f64>,
}

impl Along {
    fn series(&self, at: usize) -> impl Iterator<Item = f64> + '_ {
        self.values.iter().skip(at).step_by(self.width.max(1)).copied()
    }

    /// The highest derivative of a coordinate.
    pub(super) fn accelerations(&self, coordinate: usize) -> Vec<f64> {
        self.series(coordinate).collect()
    }

    fn factor(&self, row: usize, input: usize) -> usize {
        self.coordinates + row * self.inputs + input
    }

    fn first_input(&self) -> usize {
        self.coordinates + self.rows * self.inputs
    }

    /// Whether an input acts in a row.
    pub(super) fn acts(&self, row: usize, input: usize) -> bool {
        self.series(self.factor(row, input)).any(|factor| factor != 0.0)
    }

    /// What an input makes beyond a share of its largest size.
    pub(super) fn beyond(&self, input: usize, share: f64) -> Vec<(usize, Vec<f64>)> {
        let largest = self.series(self.first_input() + input).fold(0.0, |most: f64, u| most.max(u.abs()));
        let limit = share * largest;
        let of = |row: usize| {
            let pairs = self.series(self.factor(row, input)).zip(self.series(self.first_input() + input));
            (row, pairs.map(|(factor, u)| factor * (u - u.clamp(-limit, limit))).collect())
        };
        (0..self.rows).filter(|&row| self.acts(row, input)).map(of).collect()
    }

    /// The forces of all inputs in a row, less what is known of it.
    pub(super) fn right(&self, row: usize) -> Vec<f64> {
        let known = self.first_input() + 2 * self.inputs + row;
        let mut sum: Vec<f64> = self.series(known).map(|known| -known).collect();
        for i in 0..self.inputs {
            let force = self.series(self.factor(row, i)).zip(self.series(self.first_input() + i));
            sum.iter_mut().zip(force).for_each(|(sum, (factor, input))| *sum += factor * input);
        }
        sum
    }
}
