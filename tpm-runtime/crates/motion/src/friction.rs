//! Dry friction of a simulated machine: which coordinates stick, and the accelerations while they do.
//!
//! The rows of a model jump where the velocity of a coordinate with dry friction passes through zero, between those of either
//! direction. A coordinate at rest sticks while a force between the two holds it there (A. F. Filippov, 1960). With the
//! accelerations `a0` under the forces of the backward side, and their change `D_c` when coordinate c changes to its
//! forward side,
//!
//! ```text
//! a = a0 + sum_c D_c x_c,   0 <= x_c <= 1,   a_c = 0 for every c that sticks.
//! ```
//!
//! A coordinate whose x leaves this range slides, forwards beyond 1 and backwards below 0. Invariant: while a coordinate slides,
//! rows are evaluated on the side of its direction, even where a step of the integration overshoots its rest.

use crate::{CREEP, FrictionJump};
use tpm_controller::linear::solve_in_place;
use tpm_controller::model::{EvalError, Model};

/// The state of a coordinate with dry friction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Sticks,
    Forwards,
    Backwards,
}

impl State {
    fn creep(self) -> f64 {
        if self == State::Forwards { CREEP } else { -CREEP }
    }
}

/// The coordinates with dry friction, their states, and workspace for the accelerations.
#[derive(Clone, Debug)]
pub(super) struct Friction {
    dry: Vec<usize>,
    state: Vec<State>,
    /// Positions in `dry` of the coordinates that stick.
    stuck: Vec<usize>,
    velocities: Vec<f64>,
    base: Vec<f64>,
    /// Per coordinate that sticks: the change of all accelerations when this coordinate changes to its forward side.
    changes: Vec<f64>,
    matrix: Vec<f64>,
    shares: Vec<f64>,
}

/// A model with its parameters, constants and the inputs at an instant.
pub(super) struct Forces<'a> {
    pub(super) model: &'a dyn Model<f64>,
    pub(super) parameters: &'a [f64],
    pub(super) constants: &'a [f64],
    pub(super) inputs: &'a [f64],
}

impl Friction {
    /// The dry friction of a model, found by evaluating its rows on both sides of rest. This is done with all positions
    /// at zero and again where no position is zero, since friction may vanish at a point.
    ///
    /// # Errors
    /// [`EvalError`] when parameters or constants do not fit the model.
    pub(super) fn new(model: &dyn Model<f64>, parameters: &[f64], constants: &[f64]) -> Result<Self, EvalError> {
        let dims = model.dims();
        let n = dims.coordinates;
        let mut friction_jump = FrictionJump::new(model);
        let mut motion = vec![0.0; dims.motion_len()];
        let mut dry = Vec::new();
        for elsewhere in [false, true] {
            if elsewhere {
                for (c, position) in motion.iter_mut().take(n).enumerate() {
                    *position = 0.3 + 0.1 * c as f64;
                }
            }
            for c in 0..n {
                let moves = model.coordinate_order(c) == 2 && !dry.contains(&c);
                if moves && friction_jump.is_dry(model, &mut motion, c, parameters, constants)? {
                    dry.push(c);
                }
            }
        }
        let count = dry.len();
        Ok(Friction {
            dry,
            state: vec![State::Sticks; count],
            stuck: Vec::with_capacity(count),
            velocities: vec![0.0; count],
            base: vec![0.0; n],
            changes: vec![0.0; n * count],
            matrix: vec![0.0; count * count],
            shares: vec![0.0; count],
        })
    }

    /// Whether there is no dry friction.
    pub(super) fn is_none(&self) -> bool {
        self.dry.is_empty()
    }

    /// Decides at an instant which coordinates at rest stick, and in which direction the others slide.
    ///
    /// # Errors
    /// [`EvalError`] when the rows do not determine the accelerations.
    pub(super) fn settle(
        &mut self,
        forces: &Forces<'_>,
        motion: &mut [f64],
        workspace: &mut [f64],
    ) -> Result<(), EvalError> {
        let n = forces.model.dims().coordinates;
        for (state, &c) in self.state.iter_mut().zip(&self.dry) {
            let velocity = motion[n + c];
            *state = if velocity > 0.0 {
                State::Forwards
            } else if velocity < 0.0 {
                State::Backwards
            } else {
                State::Sticks
            };
        }
        loop {
            self.find_shares(forces, motion, workspace)?;
            let beyond = |share: f64| (share - 1.0).max(-share);
            let worst =
                (0..self.stuck.len()).max_by(|&a, &b| beyond(self.shares[a]).total_cmp(&beyond(self.shares[b])));
            match worst {
                Some(at) if beyond(self.shares[at]) > 0.0 => {
                    let forwards = self.shares[at] > 1.0;
                    self.state[self.stuck[at]] = if forwards { State::Forwards } else { State::Backwards };
                }
                _ => return Ok(()),
            }
        }
    }

    /// Writes the accelerations into their slots of the motion; those of coordinates that stick are zero.
    ///
    /// # Errors
    /// [`EvalError`] when the rows do not determine them.
    pub(super) fn accelerate(
        &mut self,
        forces: &Forces<'_>,
        motion: &mut [f64],
        workspace: &mut [f64],
    ) -> Result<(), EvalError> {
        let n = forces.model.dims().coordinates;
        self.find_shares(forces, motion, workspace)?;
        for (c, &base) in self.base.iter().enumerate() {
            let changes = self.changes.chunks_exact(n).zip(&self.shares);
            let added = changes.take(self.stuck.len()).map(|(change, share)| change[c] * share).sum::<f64>();
            motion[forces.model.coordinate_order(c) * n + c] = base + added;
        }
        for &at in &self.stuck {
            motion[2 * n + self.dry[at]] = 0.0;
        }
        Ok(())
    }

    /// The coordinates with dry friction that slide, each with the sign of its direction.
    pub(super) fn sliding(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.dry.iter().zip(&self.state).filter(|(_, state)| **state != State::Sticks).map(|(c, state)| {
            let sign = if *state == State::Forwards { 1.0 } else { -1.0 };
            (*c, sign)
        })
    }

    /// Evaluates the accelerations of the backward side and their changes to the forward side, and solves for the
    /// shares x that keep the coordinates that stick at rest.
    fn find_shares(&mut self, forces: &Forces<'_>, motion: &mut [f64], workspace: &mut [f64]) -> Result<(), EvalError> {
        let Forces { model, parameters, constants, inputs } = *forces;
        let n = model.dims().coordinates;
        // 1. Velocities on the side that each state prescribes, and the list of coordinates that stick.
        self.stuck.clear();
        for (at, (&c, state)) in self.dry.iter().zip(&self.state).enumerate() {
            let velocity = &mut motion[n + c];
            self.velocities[at] = *velocity;
            let beyond_rest = match state {
                State::Forwards => *velocity <= 0.0,
                State::Backwards => *velocity >= 0.0,
                State::Sticks => true,
            };
            if beyond_rest {
                *velocity = state.creep();
            }
            if *state == State::Sticks {
                self.stuck.push(at);
            }
        }
        // 2. Accelerations of the backward side, and their change for every coordinate that sticks.
        model.forward_dynamics(motion, parameters, constants, inputs, workspace)?;
        for (c, base) in self.base.iter_mut().enumerate() {
            *base = motion[model.coordinate_order(c) * n + c];
        }
        for (&at, change) in self.stuck.iter().zip(self.changes.chunks_exact_mut(n)) {
            let slot = n + self.dry[at];
            motion[slot] = CREEP;
            model.forward_dynamics(motion, parameters, constants, inputs, workspace)?;
            motion[slot] = -CREEP;
            for (c, (change, base)) in change.iter_mut().zip(&self.base).enumerate() {
                *change = motion[model.coordinate_order(c) * n + c] - base;
            }
        }
        for (&c, &velocity) in self.dry.iter().zip(&self.velocities) {
            motion[n + c] = velocity;
        }
        // 3. The shares at which the accelerations of these coordinates vanish.
        let count = self.stuck.len();
        for (row, &at) in self.stuck.iter().enumerate() {
            let c = self.dry[at];
            for column in 0..count {
                self.matrix[row * count + column] = self.changes[column * n + c];
            }
            self.shares[row] = -self.base[c];
        }
        if solve_in_place(&mut self.matrix[..count * count], &mut self.shares[..count]).is_err() {
            // Friction that vanishes at this position holds nothing: every coordinate slides in the direction of its
            // acceleration.
            for (share, &at) in self.shares.iter_mut().zip(&self.stuck) {
                *share = if self.base[self.dry[at]] > 0.0 { f64::INFINITY } else { f64::NEG_INFINITY };
            }
        }
        Ok(())
    }
}
