//! A control loop with feed-forward, filters, motors and machine, in continuous time.
//!
//! ```text
//! common (Feng, Figure 6.3)   u = F(s) [f_MI + f_MD] + C(e)            or, with the feedback filtered, F(s) [f_MI + f_MD + C(e)]
//! split  (Feng, Figure 6.4)   u = F(s) f_MD + G(s) f_MI + C(e)         or F(s) [f_MD + C(e)] + G(s) f_MI, with G faster or none
//! ```
//!
//! and a motor converts u to a commanded current, which its voltage drives within the limits; the current gives the
//! force on the machine.
//!
//! Invariants: the state is the machine's (every derivative below the highest), then per input the states of three
//! filters, each as value and rate, then the current. The filters are those of the motion-dependent part, of the
//! motion-independent part and of the amplifier; the reference is periodic and known at every half step; nothing
//! allocates in a step unless the feed-forward is computed at the actual motion. Limits are ignored where the loop is
//! linearised.

use crate::actuator::demand::{Demand, Parts};
use crate::actuator::motor::{Limits, Motor};
use num_complex::Complex;
use tpm_controller::control::Gain;
use tpm_controller::linear;
use tpm_controller::model::EvalError;
use tpm_motion::trajectory::Trajectory;
use tpm_motion::{LowPass, TrialError};
use tpm_numerics::DMatrix;
use tpm_numerics::eigenvalues::eigenvalues;
use tpm_numerics::tolerance;

/// Number of states of one input: three filters of two states, and a current.
const STATES_PER_INPUT: usize = 7;
/// Largest product of an integration step and the magnitude of the fastest pole.
const MOST_STEP_OF_POLE: f64 = 0.35;
/// Fewest integration steps of a period.
const LEAST_STEPS: usize = 2000;
/// Most integration steps of a period.
const MOST_STEPS: usize = 400_000;
/// Multiple of the reference's largest magnitude (at least one unit) beyond which a coordinate has diverged.
const DIVERGED_RATIO: f64 = 1e6;

/// The structure of the loop: how feed-forward and feedback are filtered and added to the inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct Scheme {
    /// Feedback paths.
    pub gains: Vec<Gain<f64>>,
    /// Low pass of the motion-dependent part; of both parts where the feed-forward is not split.
    pub filter: Option<LowPass>,
    /// Whether the motion-independent part bypasses `filter` (Figure 6.4).
    pub split: bool,
    /// Low pass of the motion-independent part where the feed-forward is split.
    pub independent_filter: Option<LowPass>,
    /// Whether the feedback passes `filter` too.
    pub feedback_filtered: bool,
    /// Whether the feed-forward is computed at the actual positions and velocities, with the accelerations of the reference, instead of
    /// along the reference.
    pub at_actual_motion: bool,
}

/// Why a loop cannot be run.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DriveError {
    /// The reference or its feed-forward cannot be worked out.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// The machine cannot be evaluated.
    #[error("the machine cannot be evaluated: {0}")]
    Evaluation(#[from] EvalError),
    /// Rotor inertia on a coordinate without acceleration, or a singular sum of both.
    #[error("rotor and machine together do not determine the accelerations (input `{input}`)")]
    Rotor {
        /// The input.
        input: String,
    },
    /// The motion left all bounds.
    #[error("the loop diverged after {time} s")]
    Diverged {
        /// Time since the start, s.
        time: f64,
    },
}

/// Poles of the loop, linearised at rest at one configuration on the reference.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LoopPoles {
    /// Phase of the reference (rad) whose configuration has the pole farthest to the right.
    pub phase: f64,
    /// All poles there, rad/s, by decreasing real part.
    pub poles: Vec<Complex<f64>>,
}

impl LoopPoles {
    /// The largest magnitude of a pole.
    #[must_use]
    pub fn fastest(&self) -> f64 {
        self.poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max)
    }

    /// Whether a pole lies in the right half plane.
    #[must_use]
    pub fn unstable(&self) -> bool {
        self.poles.first().is_some_and(|pole| pole.re > tolerance::DIFFERENCED_POLE * self.fastest())
    }
}

/// Tracking of a reference over one period.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Tracking {
    /// Times since the start of that period, s.
    pub times: Vec<f64>,
    /// Tracking errors e = q - q_r by coordinate.
    pub errors: Vec<Vec<f64>>,
    /// Force on every input.
    pub forces: Vec<Vec<f64>>,
    /// Root mean square error of every coordinate.
    pub rms: Vec<f64>,
    /// Largest magnitude of the error of every coordinate.
    pub peak: Vec<f64>,
    /// Root mean square error of every coordinate's velocity.
    pub rate_rms: Vec<f64>,
    /// Largest magnitude of the error of every coordinate's velocity.
    pub rate_peak: Vec<f64>,
    /// Shares of the period during which current, voltage and power were limited, by input.
    pub limited: Vec<[f64; 3]>,
}

/// Machine, motors and loop.
#[derive(Clone, Debug)]
pub struct Drive<'a> {
    demand: &'a Demand<'a>,
    plant: Vec<f64>,
    motors: Vec<Option<Motor>>,
    scheme: &'a Scheme,
    slots: Vec<usize>,
}

/// Workspace of one evaluation.
struct Scratch {
    motion: Vec<f64>,
    inputs: Vec<f64>,
    /// The motors' forces before the inertial forces of their rotors are subtracted.
    forces: Vec<f64>,
    workspace: Vec<f64>,
    columns: Vec<f64>,
    matrix: Vec<f64>,
    right: Vec<f64>,
    limited: Vec<[bool; 3]>,
}

/// Motion and feed-forward of the reference at one instant.
#[derive(Clone, Copy)]
struct Wanted<'a> {
    motion: &'a [f64],
    independent: &'a [f64],
    dependent: &'a [f64],
}

impl<'a> Drive<'a> {
    /// A machine whose true parameters are `plant`; the feed-forward uses those of `demand`.
    #[must_use]
    pub fn new(demand: &'a Demand<'a>, plant: &[f64], motors: &[Option<Motor>], scheme: &'a Scheme) -> Self {
        let model = demand.model();
        let dims = model.dims();
        let n = dims.coordinates;
        let slots = (0..n).flat_map(|c| (0..model.coordinate_order(c)).map(move |order| order * n + c)).collect();
        let mut motors = motors.to_vec();
        motors.resize(dims.inputs, None);
        Drive { demand, plant: plant.to_vec(), motors, scheme, slots }
    }

    fn scratch(&self) -> Scratch {
        let dims = self.demand.model().dims();
        let (n, inputs) = (dims.coordinates, dims.inputs);
        Scratch {
            motion: vec![0.0; dims.motion_len()],
            inputs: vec![0.0; inputs],
            forces: vec![0.0; inputs],
            workspace: vec![0.0; self.demand.model().forward_workspace_len()],
            columns: vec![0.0; n * (inputs + 1)],
            matrix: vec![0.0; inputs * inputs],
            right: vec![0.0; inputs],
            limited: vec![[false; 3]; inputs],
        }
    }

    fn len(&self) -> usize {
        self.slots.len() + STATES_PER_INPUT * self.motors.len()
    }

    /// Commanded current of a motor, A, for a command on its input, which includes the inertial force of the rotor.
    fn current(motor: &Motor, command: f64) -> f64 {
        command / (motor.torque_constant * motor.ratio)
    }

    /// Writes the time derivative of the state to `out`; the flags of the limits are left in `scratch`.
    fn rates(
        &self,
        wanted: Wanted<'_>,
        state: &[f64],
        limits: bool,
        scratch: &mut Scratch,
        out: &mut [f64],
    ) -> Result<(), DriveError> {
        let model = self.demand.model();
        let dims = model.dims();
        let n = dims.coordinates;
        let (machine, drives) = state.split_at(self.slots.len());
        for (&value, &slot) in machine.iter().zip(&self.slots) {
            scratch.motion[slot] = value;
        }
        // 1. The feed-forward, at the actual motion where the scheme asks for it.
        let parts = if self.scheme.at_actual_motion { Some(self.at_actual_motion(wanted, scratch)?) } else { None };
        let wanted = parts.as_ref().map_or(wanted, |parts| Wanted {
            motion: wanted.motion,
            independent: &parts.independent,
            dependent: &parts.dependent,
        });
        // 2. Per input: feedback, filters, and the motor.
        let (machine_out, drives_out) = out.split_at_mut(self.slots.len());
        let states = drives.chunks_exact(STATES_PER_INPUT).zip(drives_out.chunks_exact_mut(STATES_PER_INPUT));
        for (i, ((state, out), motor)) in states.zip(&self.motors).enumerate() {
            out.fill(0.0);
            let feedback: f64 = self
                .scheme
                .gains
                .iter()
                .filter(|gain| gain.input == i)
                .map(|gain| {
                    let error = |order: usize| {
                        let at = order * n + gain.coordinate;
                        scratch.motion.get(at).copied().unwrap_or(0.0) - wanted.motion.get(at).copied().unwrap_or(0.0)
                    };
                    -gain.proportional * error(0) - gain.derivative * error(1)
                })
                .sum();
            let (fast, direct) = (if self.scheme.split { wanted.independent[i] } else { 0.0 }, wanted.dependent[i]);
            let slow = direct
                + if self.scheme.split { 0.0 } else { wanted.independent[i] }
                + if self.scheme.feedback_filtered { feedback } else { 0.0 };
            let filtered = |filter: &Option<LowPass>, input: f64, at: usize, out: &mut [f64]| match filter {
                None => input,
                Some(filter) => {
                    (out[at], out[at + 1]) = filter.rates(input, state[at], state[at + 1]);
                    state[at]
                }
            };
            let command = filtered(&self.scheme.filter, slow, 0, out)
                + filtered(&self.scheme.independent_filter, fast, 2, out)
                + if self.scheme.feedback_filtered { 0.0 } else { feedback };
            scratch.limited[i] = [false; 3];
            scratch.inputs[i] = match (motor, self.demand.driven(i)) {
                (Some(motor), [coordinate]) => {
                    let motor = if limits { *motor } else { Motor { limits: Limits::default(), ..*motor } };
                    let current = state[6];
                    let speed = scratch.motion.get(n + coordinate).copied().unwrap_or(0.0);
                    let asked = filtered(&motor.amplifier.filter, Self::current(&motor, command), 4, out);
                    let (voltage, cut) = motor.drive(asked, current, speed);
                    scratch.limited[i] = cut;
                    out[6] = (voltage - motor.voltage(current, 0.0, speed)) / motor.inductance;
                    motor.force(current)
                }
                _ => command,
            };
        }
        // 3. The accelerations of the machine.
        self.accelerate(scratch)?;
        for (slot, &at) in machine_out.iter_mut().zip(&self.slots) {
            *slot = scratch.motion[at + n];
        }
        Ok(())
    }

    /// The feed-forward at the actual motion in `scratch`, with the highest derivatives of the reference.
    fn at_actual_motion(&self, wanted: Wanted<'_>, scratch: &Scratch) -> Result<Parts, DriveError> {
        let mut motion = wanted.motion.to_vec();
        for &slot in &self.slots {
            motion[slot] = scratch.motion[slot];
        }
        self.feed_forward(motion)
    }

    /// Solves the rows for the accelerations under `scratch.inputs`, rotors included: with a = a0 + A u and the force
    /// u = u_m - D a of motors with rotors, (1 + D A) u = u_m - D a0.
    fn accelerate(&self, scratch: &mut Scratch) -> Result<(), DriveError> {
        let model = self.demand.model();
        let dims = model.dims();
        let (n, inputs) = (dims.coordinates, dims.inputs);
        let constants = self.demand.constants();
        let rotor = |i: usize| {
            let motor = self.motors[i].as_ref().filter(|motor| motor.rotor_inertia > 0.0)?;
            let [coordinate] = self.demand.driven(i) else { return None };
            (model.coordinate_order(*coordinate) == 2).then(|| (*coordinate, motor.rotor_inertia * motor.ratio.powi(2)))
        };
        if (0..inputs).any(|i| rotor(i).is_some()) {
            scratch.forces.copy_from_slice(&scratch.inputs);
            for column in 0..=inputs {
                scratch.inputs.fill(0.0);
                if column < inputs {
                    scratch.inputs[column] = 1.0;
                }
                model.forward_dynamics(
                    &mut scratch.motion,
                    &self.plant,
                    constants,
                    &scratch.inputs,
                    &mut scratch.workspace,
                )?;
                for c in 0..n {
                    scratch.columns[column * n + c] = scratch.motion[model.coordinate_order(c) * n + c];
                }
            }
            for i in 0..inputs {
                let of = |column: usize| {
                    rotor(i).map_or(0.0, |(c, inertia)| {
                        let at_rest = scratch.columns[inputs * n + c];
                        let value = scratch.columns[column * n + c];
                        inertia * if column == inputs { at_rest } else { value - at_rest }
                    })
                };
                scratch.right[i] = scratch.forces[i] - of(inputs);
                for j in 0..inputs {
                    scratch.matrix[i * inputs + j] = of(j) + if i == j { 1.0 } else { 0.0 };
                }
            }
            linear::solve_in_place(&mut scratch.matrix, &mut scratch.right)
                .map_err(|input| DriveError::Rotor { input: model.input(input).name.into() })?;
            scratch.inputs.copy_from_slice(&scratch.right);
        }
        model.forward_dynamics(&mut scratch.motion, &self.plant, constants, &scratch.inputs, &mut scratch.workspace)?;
        Ok(())
    }

    /// Feed-forward at motions: the two parts, with the inertial forces of the rotors in the motion-dependent one.
    fn feed_forward(&self, motions: Vec<f64>) -> Result<Parts, DriveError> {
        let dims = self.demand.model().dims();
        let mut parts = self.demand.at(motions)?;
        for (i, motor) in self.motors.iter().enumerate() {
            if let (Some(motor), [coordinate], true) = (motor, self.demand.driven(i), dims.order >= 2) {
                let inertia = motor.rotor_inertia * motor.ratio.powi(2);
                let accelerations =
                    parts.motions.iter().skip(2 * dims.coordinates + coordinate).step_by(dims.motion_len());
                for (slot, acceleration) in parts.dependent.iter_mut().skip(i).step_by(dims.inputs).zip(accelerations) {
                    *slot += inertia * acceleration;
                }
            }
        }
        Ok(parts)
    }

    /// State of machine, filters and currents that matches a reference at an instant at which it rests.
    fn start(&self, wanted: Wanted<'_>) -> Vec<f64> {
        let mut state: Vec<f64> = self.slots.iter().map(|&slot| wanted.motion[slot]).collect();
        for (i, motor) in self.motors.iter().enumerate() {
            let (independent, dependent) = (wanted.independent[i], wanted.dependent[i]);
            let (slow, fast) =
                if self.scheme.split { (dependent, independent) } else { (independent + dependent, 0.0) };
            let current = motor.as_ref().map_or(0.0, |motor| Self::current(motor, independent + dependent));
            state.extend([slow, 0.0, fast, 0.0, current, 0.0, current]);
        }
        state
    }

    /// Poles of the loop, linearised at rest at that one of several configurations on the reference where the rightmost
    /// pole has the largest real part. Motors are included, their limits are not.
    ///
    /// # Errors
    /// [`DriveError`] when the machine cannot be evaluated there.
    pub fn stability(&self, reference: &Trajectory, configurations: usize) -> Result<LoopPoles, DriveError> {
        let dims = self.demand.model().dims();
        let n = dims.coordinates;
        let mut worst: Option<LoopPoles> = None;
        let mut scratch = self.scratch();
        for k in 0..configurations.max(1) {
            let phase = std::f64::consts::TAU * k as f64 / configurations.max(1) as f64;
            let mut motion = vec![0.0; dims.motion_len()];
            reference.motion(phase, &mut motion);
            motion[n..].fill(0.0);
            let parts = self.feed_forward(motion)?;
            let wanted =
                Wanted { motion: &parts.motions, independent: &parts.independent, dependent: &parts.dependent };
            let start = self.start(wanted);
            let len = self.len();
            let mut jacobian = DMatrix::zeros(len, len);
            let (mut above, mut below, mut state) = (vec![0.0; len], vec![0.0; len], start.clone());
            for j in 0..len {
                let step = 1e-5 * start[j].abs().max(1.0);
                state[j] = start[j] + step;
                self.rates(wanted, &state, false, &mut scratch, &mut above)?;
                state[j] = start[j] - step;
                self.rates(wanted, &state, false, &mut scratch, &mut below)?;
                state[j] = start[j];
                for i in 0..len {
                    jacobian[(i, j)] = (above[i] - below[i]) / (2.0 * step);
                }
            }
            // States of filters and motors that are absent are removed.
            let used: Vec<usize> = (0..len).filter(|&j| self.is_used(j)).collect();
            let jacobian = DMatrix::from_fn(used.len(), used.len(), |r, c| jacobian[(used[r], used[c])]);
            let mut poles = eigenvalues(&jacobian);
            poles.sort_by(|a, b| b.re.total_cmp(&a.re).then(b.im.total_cmp(&a.im)));
            let right = |stability: &LoopPoles| stability.poles.first().map_or(f64::NEG_INFINITY, |pole| pole.re);
            let found = LoopPoles { phase, poles };
            // In this order poles that are not numbers count as farther to the right than all others.
            if worst.as_ref().is_none_or(|worst| right(&found).total_cmp(&right(worst)).is_gt()) {
                worst = Some(found);
            }
        }
        Ok(worst.unwrap_or(LoopPoles { phase: 0.0, poles: Vec::new() }))
    }

    fn is_used(&self, state: usize) -> bool {
        let Some(at) = state.checked_sub(self.slots.len()) else { return true };
        let motor = self.motors[at / STATES_PER_INPUT].as_ref();
        match at % STATES_PER_INPUT {
            0 | 1 => self.scheme.filter.is_some(),
            2 | 3 => self.scheme.independent_filter.is_some(),
            4 | 5 => motor.is_some_and(|motor| motor.amplifier.filter.is_some()),
            _ => motor.is_some(),
        }
    }

    /// Simulates the loop along the reference for `settle` periods, and records one more.
    ///
    /// The classical Runge-Kutta rule takes steps that resolve the fastest of `poles`.
    ///
    /// # Errors
    /// [`DriveError`] when the machine cannot be evaluated, rotor and machine do not determine the accelerations, or the motion
    /// diverges.
    pub fn track(&self, reference: &Trajectory, settle: usize, poles: &LoopPoles) -> Result<Tracking, DriveError> {
        // 1. Steps that resolve the poles and the harmonics of the reference.
        let dims = self.demand.model().dims();
        let (n, inputs) = (dims.coordinates, dims.inputs);
        let period = std::f64::consts::TAU / reference.frequency;
        let asked = (period * poles.fastest() / MOST_STEP_OF_POLE).ceil();
        let asked = if asked.is_finite() { asked as usize } else { MOST_STEPS };
        let steps = asked.max(200 * reference.highest_harmonic() as usize).clamp(LEAST_STEPS, MOST_STEPS);
        let h = period / steps as f64;
        // 2. Reference and feed-forward at every half step.
        let width = dims.motion_len();
        let mut motions = vec![0.0; 2 * steps * width];
        for (k, motion) in motions.chunks_exact_mut(width).enumerate() {
            reference.motion_at(k, 2 * steps, 0.0, motion);
        }
        let parts = self.feed_forward(motions)?;
        let at = |half: usize| {
            let k = half % (2 * steps);
            Wanted {
                motion: &parts.motions[k * width..(k + 1) * width],
                independent: &parts.independent[k * inputs..(k + 1) * inputs],
                dependent: &parts.dependent[k * inputs..(k + 1) * inputs],
            }
        };
        let sizes: Vec<f64> = (0..n)
            .map(|c| parts.motions.iter().skip(c).step_by(width).fold(1.0, |size: f64, q| size.max(q.abs())))
            .collect();
        let len = self.len();
        let mut state = self.start(at(0));
        let (mut rate, mut sum, mut shifted) = (vec![0.0; len], vec![0.0; len], vec![0.0; len]);
        let mut scratch = self.scratch();
        let mut found = Tracking {
            times: Vec::with_capacity(steps),
            errors: vec![Vec::with_capacity(steps); n],
            forces: vec![Vec::with_capacity(steps); inputs],
            rms: vec![0.0; n],
            peak: vec![0.0; n],
            rate_rms: vec![0.0; n],
            rate_peak: vec![0.0; n],
            limited: vec![[0.0; 3]; inputs],
        };
        // 3. The integration; the last period is recorded.
        for step in 0..(settle + 1) * steps {
            let half = 2 * (step % steps);
            self.rates(at(half), &state, true, &mut scratch, &mut rate)?;
            if step >= settle * steps {
                found.times.push((step - settle * steps) as f64 * h);
                for (c, errors) in found.errors.iter_mut().enumerate() {
                    errors.push(scratch.motion[c] - at(half).motion[c]);
                }
                for c in 0..n {
                    let [actual, wanted] = [&scratch.motion[..], at(half).motion].map(|motion| motion.get(n + c));
                    let error = actual.zip(wanted).map_or(0.0, |(actual, wanted)| actual - wanted);
                    found.rate_rms[c] += error * error / steps as f64;
                    found.rate_peak[c] = found.rate_peak[c].max(error.abs());
                }
                for (forces, &force) in found.forces.iter_mut().zip(&scratch.inputs) {
                    forces.push(force);
                }
                for (share, cut) in found.limited.iter_mut().zip(&scratch.limited) {
                    for (share, &cut) in share.iter_mut().zip(cut) {
                        *share += if cut { 1.0 / steps as f64 } else { 0.0 };
                    }
                }
            }
            sum.copy_from_slice(&rate);
            for (advance, shift, weight) in [(1, 0.5 * h, 2.0), (1, 0.5 * h, 2.0), (2, h, 1.0)] {
                for ((shifted, state), rate) in shifted.iter_mut().zip(&state).zip(&rate) {
                    *shifted = state + shift * rate;
                }
                self.rates(at(half + advance), &shifted, true, &mut scratch, &mut rate)?;
                sum.iter_mut().zip(&rate).for_each(|(sum, rate)| *sum += weight * rate);
            }
            for (state, sum) in state.iter_mut().zip(&sum) {
                *state += h / 6.0 * sum;
            }
            let beyond = |(&slot, value): (&usize, &f64)| {
                !value.is_finite() || (slot < n && value.abs() > DIVERGED_RATIO * sizes[slot])
            };
            if self.slots.iter().zip(&state).any(beyond) {
                return Err(DriveError::Diverged { time: step as f64 * h });
            }
        }
        // 4. The tracking errors of this period.
        found.rate_rms.iter_mut().for_each(|square| *square = square.sqrt());
        for (c, errors) in found.errors.iter().enumerate() {
            found.rms[c] = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len().max(1) as f64).sqrt();
            found.peak[c] = errors.iter().fold(0.0, |peak, e| peak.max(e.abs()));
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::{Drive, DriveError, Scheme};
    use crate::actuator::demand::Demand;
    use crate::actuator::demand::tests::feng_6_8;
    use crate::actuator::motor::Motor;
    use crate::actuator::motor::tests::feng;
    use crate::actuator::tests::{CartPendulum, FENG};
    use tpm_controller::control::Gain;
    use tpm_motion::LowPass;

    fn scheme(split: bool) -> Scheme {
        let gain = |i: usize| Gain { input: i, coordinate: i, proportional: 1000.0, derivative: 100.0 };
        Scheme {
            gains: vec![gain(0), gain(1)],
            filter: Some(LowPass { natural_frequency: 100.0, quality: 1.0 }),
            split,
            independent_filter: None,
            feedback_filtered: false,
            at_actual_motion: false,
        }
    }

    fn demand() -> Demand<'static> {
        Demand::new(&CartPendulum, &FENG, &[], &[vec![0], vec![1]])
    }

    fn followed(scheme: &Scheme, motors: &[Option<Motor>]) -> super::Tracking {
        let demand = demand();
        let drive = Drive::new(&demand, &FENG, motors, scheme);
        let poles = drive.stability(&feng_6_8(), 16).expect("regular");
        assert!(!poles.unstable(), "{poles:?}");
        drive.track(&feng_6_8(), 4, &poles).expect("stable")
    }

    #[test]
    fn feng_6_5_common_against_split() {
        let common = followed(&scheme(false), &[]);
        let split = followed(&scheme(true), &[]);
        let millimetres = |found: &super::Tracking| (1e3 * found.rms[0], 1e3 * found.peak[0]);
        let ((common_rms, common_peak), (split_rms, split_peak)) = (millimetres(&common), millimetres(&split));
        assert!((common_rms - 2.40).abs() < 0.05 * 2.40, "{common_rms} mm");
        assert!((split_rms - 0.735).abs() < 0.05 * 0.735, "{split_rms} mm");
        assert!(common_rms / split_rms >= 3.0, "{}", common_rms / split_rms);
        assert!(common_peak / split_peak >= 2.5, "{common_peak} {split_peak}");
        assert!((common_peak - 4.11).abs() < 0.05 * 4.11 && (split_peak - 1.39).abs() < 0.05 * 1.39);
        // Errors of the velocities: the split scheme is better for the cart, and worse for the pendulum.
        let rate_ratio = |c: usize| common.rate_rms[c] / split.rate_rms[c];
        assert!(rate_ratio(0) > 1.5 && common.rms[1] < split.rms[1], "{} {}", rate_ratio(0), rate_ratio(1));
        // Without any filter only the error of the integration remains, wherever the feed-forward is computed.
        let at_actual = followed(&Scheme { filter: None, at_actual_motion: true, ..scheme(false) }, &[]);
        assert!(at_actual.rms.iter().chain(&at_actual.rate_rms).all(|rms| *rms < 1e-6), "{:?}", at_actual.rms);
        let exact = followed(&Scheme { filter: None, ..scheme(false) }, &[]);
        assert!(exact.rms.iter().all(|rms| *rms < 1e-8), "{:?}", exact.rms);
        // The higher the cut-off, the smaller the error; a faster filter on the independent part costs little.
        for (frequency, bound) in [(30.0, 3.0), (400.0, 3.0)] {
            let filter = Some(LowPass { natural_frequency: frequency, quality: 1.0 });
            let ratio = followed(&Scheme { filter, ..scheme(false) }, &[]).rms[0]
                / followed(&Scheme { filter, ..scheme(true) }, &[]).rms[0];
            assert!(ratio > bound, "{frequency}: {ratio}");
        }
        let fast = Some(LowPass { natural_frequency: 2000.0, quality: 1.0 });
        let faster = followed(&Scheme { independent_filter: fast, ..scheme(true) }, &[]);
        assert!(1e3 * faster.rms[0] < 1.2 * split_rms);
    }

    #[test]
    fn steps_allocate_nothing() {
        let motors: Vec<Option<Motor>> = vec![Some(Motor { ratio: 50.0, rotor_inertia: 1e-5, ..feng() }), None];
        let (demand, split) = (demand(), scheme(true));
        let drive = Drive::new(&demand, &FENG, &motors, &split);
        let poles = drive.stability(&feng_6_8(), 4).expect("regular");
        let allocations = |settle: usize| {
            allocation_counter::measure(|| drop(drive.track(&feng_6_8(), settle, &poles).expect("stable"))).count_total
        };
        assert_eq!(allocations(0), allocations(1), "periods more are steps more, and nothing else");
    }

    #[test]
    fn feedback_inside_the_filter_is_unstable_before_it_is_run() {
        let demand = demand();
        let inside = Scheme { feedback_filtered: true, ..scheme(false) };
        let drive = Drive::new(&demand, &FENG, &[], &inside);
        let poles = drive.stability(&feng_6_8(), 16).expect("regular");
        assert!(poles.unstable(), "{:?}", poles.poles);
        assert!(matches!(drive.track(&feng_6_8(), 4, &poles), Err(DriveError::Diverged { .. })));
        // Poles with the feedback outside: 11 and 0.16 with 1000/100 coupled by m L cos theta; the filters' own 100 rad/s.
        let outside = scheme(false);
        let drive = Drive::new(&demand, &FENG, &[], &outside);
        let found = drive.stability(&feng_6_8(), 1).expect("regular");
        let filter = found.poles.iter().filter(|pole| (pole.norm() - 100.0).abs() < 1e-3).count();
        assert_eq!((found.poles.len(), filter), (8, 4), "{:?}", found.poles);
    }

    #[test]
    fn with_motors_the_common_controller_meets_the_current_limit_and_the_split_one_does_not() {
        let motors: Vec<Option<Motor>> = [(50.0, 0.0), (28.0, 0.35e-4)]
            .map(|(ratio, rotor_inertia)| Some(Motor { ratio, rotor_inertia, ..feng() }))
            .to_vec();
        let common = followed(&scheme(false), &motors);
        let split = followed(&scheme(true), &motors);
        let current = |found: &super::Tracking| found.limited[0][0].max(found.limited[1][0]);
        assert!((current(&common) - 0.06).abs() < 0.01, "{}", current(&common));
        assert!(current(&split) < 0.005, "{}", current(&split));
        assert!(common.rms[0] > 2.5 * split.rms[0]);
    }

    #[test]
    fn a_rotor_outside_the_model_is_as_good_as_one_inside() {
        // J r^2 added to M in the model, or given with the motor: the same motion.
        let inertia = 2e-4;
        let bare = Motor { ratio: 50.0, ..feng() };
        let carried = [Some(Motor { rotor_inertia: inertia, ..bare }), Some(Motor { ratio: 28.0, ..feng() })];
        let inside = [Some(bare), Some(Motor { ratio: 28.0, ..feng() })];
        let heavier = [FENG[0] + inertia * 2500.0, FENG[1], FENG[2]];
        let split = scheme(true);
        let with = followed(&split, &carried);
        let demand = Demand::new(&CartPendulum, &heavier, &[], &[vec![0], vec![1]]);
        let drive = Drive::new(&demand, &heavier, &inside, &split);
        let poles = drive.stability(&feng_6_8(), 16).expect("regular");
        let without = drive.track(&feng_6_8(), 4, &poles).expect("stable");
        for (a, b) in with.rms.iter().zip(&without.rms) {
            assert!((a - b).abs() < 1e-9 * b, "{a} {b}");
        }
    }
}
