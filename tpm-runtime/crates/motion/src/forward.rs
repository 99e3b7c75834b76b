//! A plant that obeys a model with known parameters, integrated in fixed steps.
//!
//! Invariant: the state is the motion of every coordinate below its highest derivative; the highest ones follow from the
//! rows. The classical fourth-order Runge-Kutta rule advances it under inputs that are constant over a step, in memory that
//! was reserved at the start: stepping allocates nothing. Where a coordinate with dry friction comes to rest a step ends and the
//! next begins, since the rule is of the fourth order only where the rows do not jump.

use crate::friction::{Forces, Friction};
use tpm_controller::model::{Buffer, EvalError, Model, require_len};
use tpm_numerics::Iteration;

/// Magnitude of a state beyond which the terms of a model are taken to overflow.
const LARGEST_STATE: f64 = 1e50;
/// Most divisions of a step at instants at which a coordinate with dry friction comes to rest. The rest of the step is
/// then taken undivided.
const MOST_RESTS: usize = 16;
/// The search for the instant at which a velocity passes through zero, until it is a small share of the larger velocity at the ends of its
/// interval.
const REST_SEARCH: Iteration = Iteration { most: 12, settled: 1e-9 };
/// Shortest part of a step, as a share of it, that is integrated on its own.
const SHORTEST_PART: f64 = 1e-9;

/// Why a plant could not be advanced.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// The model could not be evaluated.
    #[error(transparent)]
    Evaluation(#[from] EvalError),
    /// The motion is no longer finite.
    #[error(
        "the simulated plant diverged after {time} s in coordinate {coordinate}: reduce gains, amplitude or frequency, or take more sub-steps per sample"
    )]
    Diverged {
        /// Time since the start, s.
        time: f64,
        /// Coordinate at fault.
        coordinate: usize,
    },
}

/// The instant of a step at which the rates of the state are evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instant {
    /// At its beginning.
    Start = 0,
    /// Halfway.
    Middle = 1,
    /// At its end.
    End = 2,
}

/// A control law: writes the inputs that follow from the motion at an instant of a step.
pub(super) type Law<'l> = dyn FnMut(Instant, &[f64], &mut [f64]) -> Result<(), EvalError> + 'l;

/// A simulated machine.
#[derive(Clone)]
pub struct Plant<'m> {
    model: &'m dyn Model<f64>,
    parameters: Vec<f64>,
    constants: Vec<f64>,
    coordinates: usize,
    /// Slots of a motion that are states; the rate of state s is in slot `slots[s] + coordinates`.
    slots: Vec<usize>,
    state: Vec<f64>,
    start: Vec<f64>,
    rate: Vec<f64>,
    sum: Vec<f64>,
    motion: Vec<f64>,
    workspace: Vec<f64>,
    friction: Friction,
    /// Inputs at an instant within a step.
    inputs: Vec<f64>,
    /// Inputs at the start, the middle and the end of a step.
    given: [Vec<f64>; 3],
    time: f64,
}

impl std::fmt::Debug for Plant<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Plant")
            .field("model", &self.model.name())
            .field("time", &self.time)
            .field("state", &self.state)
            .finish_non_exhaustive()
    }
}

impl<'m> Plant<'m> {
    /// A plant at rest at zero.
    ///
    /// # Errors
    /// [`EvalError::Length`] when the numbers of parameters or constants do not fit the model,
    /// [`EvalError::NotSquare`] when the rows do not determine the motion.
    pub fn new(model: &'m dyn Model<f64>, parameters: &[f64], constants: &[f64]) -> Result<Self, EvalError> {
        let dims = model.dims();
        require_len(Buffer::Parameters, parameters.len(), dims.parameters)?;
        require_len(Buffer::Constants, constants.len(), dims.constants)?;
        if dims.rows != dims.coordinates {
            return Err(EvalError::NotSquare { rows: dims.rows, coordinates: dims.coordinates });
        }
        let n = dims.coordinates;
        let slots: Vec<usize> =
            (0..n).flat_map(|c| (0..model.coordinate_order(c)).map(move |order| order * n + c)).collect();
        let states = slots.len();
        Ok(Plant {
            model,
            parameters: parameters.to_vec(),
            constants: constants.to_vec(),
            coordinates: n,
            slots,
            state: vec![0.0; states],
            start: vec![0.0; states],
            rate: vec![0.0; states],
            sum: vec![0.0; states],
            motion: vec![0.0; dims.motion_len()],
            workspace: vec![0.0; model.forward_workspace_len()],
            friction: Friction::new(model, parameters, constants)?,
            inputs: vec![0.0; dims.inputs],
            given: std::array::from_fn(|_| vec![0.0; dims.inputs]),
            time: 0.0,
        })
    }

    /// Whether dry friction acts on a coordinate, so that it may stick.
    #[must_use]
    pub fn rubs(&self) -> bool {
        !self.friction.is_none()
    }

    /// Sets the state from a motion (derivatives above the state are ignored) and the time to zero.
    ///
    /// # Errors
    /// [`EvalError::Length`] when the motion has another length than the model's.
    pub fn reset(&mut self, motion: &[f64]) -> Result<(), EvalError> {
        require_len(Buffer::Motion, motion.len(), self.motion.len())?;
        for (value, &slot) in self.state.iter_mut().zip(&self.slots) {
            *value = motion[slot];
        }
        self.motion.copy_from_slice(motion);
        self.time = 0.0;
        Ok(())
    }

    /// The motion at the present time; derivatives above the state are those of the last evaluation of the rows.
    #[must_use]
    pub fn motion(&self) -> &[f64] {
        &self.motion
    }

    /// Time since the last [`reset`](Self::reset), s.
    #[must_use]
    pub const fn time(&self) -> f64 {
        self.time
    }

    /// Advances by `steps` steps of `duration / steps` seconds under constant inputs.
    ///
    /// # Errors
    /// [`PlantError`]; the motion is then the one at which it occurred.
    pub fn advance(&mut self, inputs: &[f64], duration: f64, steps: usize) -> Result<(), PlantError> {
        self.advance_by(duration, steps, &mut |plant, step| plant.step([inputs; 3], step))
    }

    /// Advances by `steps` steps of `duration / steps` seconds under inputs that change on the way: `at` writes those at a share of the
    /// duration, from 0 to 1.
    ///
    /// # Errors
    /// [`PlantError`]; the motion is then the one at which it occurred.
    pub fn advance_under(
        &mut self,
        duration: f64,
        steps: usize,
        at: &mut dyn FnMut(f64, &mut [f64]),
    ) -> Result<(), PlantError> {
        let mut given = std::mem::take(&mut self.given);
        let mut done = 0.0;
        let advanced = self.advance_by(duration, steps, &mut |plant, step| {
            for (inputs, half) in given.iter_mut().zip([0.0, 0.5, 1.0]) {
                at((done + half) / steps.max(1) as f64, inputs);
            }
            done += 1.0;
            plant.step(given.each_ref().map(Vec::as_slice), step)
        });
        self.given = given;
        advanced
    }

    /// Advances by `steps` calls of `one`, each with the length of a step in seconds; `one` provides the inputs.
    pub fn advance_by(
        &mut self,
        duration: f64,
        steps: usize,
        one: &mut dyn FnMut(&mut Self, f64) -> Result<(), EvalError>,
    ) -> Result<(), PlantError> {
        let step = duration / steps.max(1) as f64;
        for _ in 0..steps.max(1) {
            if let Err(fault) = one(self, step) {
                // A motion that overflows in a product shows first as a mass matrix that is not finite.
                return Err(
                    match self.state.iter().position(|value| !value.is_finite() || value.abs() > LARGEST_STATE) {
                        Some(at) => PlantError::Diverged {
                            time: self.time + duration,
                            coordinate: self.slots[at] % self.coordinates,
                        },
                        None => fault.into(),
                    },
                );
            }
        }
        // Written once per call: the sum of many small steps would drift away from n times the sample time.
        self.time += duration;
        for (&value, &slot) in self.state.iter().zip(&self.slots) {
            self.motion[slot] = value;
            if !value.is_finite() {
                return Err(PlantError::Diverged { time: self.time, coordinate: slot % self.coordinates });
            }
        }
        Ok(())
    }

    /// Evaluates the rows at the present state: the motion then has the highest derivatives under these inputs, which sensors of accelerations
    /// and of forces read.
    ///
    /// # Errors
    /// [`EvalError`] when the rows do not determine them.
    pub fn observe(&mut self, inputs: &[f64]) -> Result<(), EvalError> {
        if self.friction.is_none() {
            return self.evaluate(inputs);
        }
        self.place();
        let forces = Forces { model: self.model, parameters: &self.parameters, constants: &self.constants, inputs };
        self.friction.settle(&forces, &mut self.motion, &mut self.workspace)?;
        self.friction.accelerate(&forces, &mut self.motion, &mut self.workspace)
    }

    /// One step of length `h` under inputs given at its start, middle and end.
    pub fn step(&mut self, inputs: [&[f64]; 3], h: f64) -> Result<(), EvalError> {
        if self.friction.is_none() {
            self.runge_kutta(h, |plant, at| plant.evaluate(inputs[at as usize]))
        } else {
            let mut own = std::mem::take(&mut self.inputs);
            let stepped = self.step_with_friction(inputs, &mut own, h);
            self.inputs = own;
            stepped
        }
    }

    /// One step, divided at the instants at which coordinates with dry friction come to rest; `own` is workspace for
    /// the inputs.
    fn step_with_friction(&mut self, inputs: [&[f64]; 3], own: &mut [f64], h: f64) -> Result<(), EvalError> {
        let mut from = 0.0;
        for _ in 0..MOST_RESTS {
            within(inputs, from, own);
            self.place();
            let forces =
                Forces { model: self.model, parameters: &self.parameters, constants: &self.constants, inputs: own };
            self.friction.settle(&forces, &mut self.motion, &mut self.workspace)?;
            self.part(inputs, own, h, from, 1.0)?;
            let Some((state, share)) = self.first_rest() else { return Ok(()) };
            let (mut low, mut high) = ((from, self.start[state]), (1.0, self.state[state]));
            let mut to = from + share * (1.0 - from);
            if to - from < SHORTEST_PART {
                self.state[state] = 0.0;
                return Ok(());
            }
            let wanted = REST_SEARCH.settled * low.1.abs().max(high.1.abs());
            for _ in 0..REST_SEARCH.most {
                self.state.copy_from_slice(&self.start);
                self.part(inputs, own, h, from, to)?;
                let velocity = self.state[state];
                if velocity.abs() <= wanted {
                    break;
                }
                // The method of false position; the value at the end that stays is halved (the Illinois rule).
                if (velocity > 0.0) == (low.1 > 0.0) {
                    low = (to, velocity);
                    high.1 *= 0.5;
                } else {
                    high = (to, velocity);
                    low.1 *= 0.5;
                }
                to = low.0 + (high.0 - low.0) * low.1 / (low.1 - high.1);
            }
            self.state[state] = 0.0;
            from = to;
            if 1.0 - from < SHORTEST_PART {
                return Ok(());
            }
        }
        self.part(inputs, own, h, from, 1.0)
    }

    /// The part of a step between two shares of its length, from the state as it is.
    fn part(&mut self, inputs: [&[f64]; 3], own: &mut [f64], h: f64, from: f64, to: f64) -> Result<(), EvalError> {
        self.runge_kutta((to - from) * h, |plant, at| {
            within(inputs, from + 0.5 * f64::from(at as u8) * (to - from), own);
            plant.place();
            let forces =
                Forces { model: plant.model, parameters: &plant.parameters, constants: &plant.constants, inputs: own };
            plant.friction.accelerate(&forces, &mut plant.motion, &mut plant.workspace)?;
            plant.read_rates();
            Ok(())
        })
    }

    /// Among the velocities of coordinates with dry friction, the state that passes through zero first, and the share
    /// of the last step at which it does so.
    fn first_rest(&self) -> Option<(usize, f64)> {
        let passed = self.friction.sliding().filter_map(|(c, side)| {
            let state = self.slots.iter().position(|slot| *slot == self.coordinates + c)?;
            let (start, end) = (self.start[state].abs(), side * self.state[state]);
            (end < 0.0).then(|| (state, start / (start - end)))
        });
        passed.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// One step of length `h` under inputs that a control law computes from the motion at the start, the middle and the
    /// end of the step; `inputs` is workspace.
    pub fn step_under(&mut self, inputs: &mut [f64], h: f64, law: &mut Law<'_>) -> Result<(), EvalError> {
        self.runge_kutta(h, |plant, at| {
            plant.place();
            law(at, &plant.motion, inputs)?;
            plant.evaluate(inputs)
        })
    }

    fn runge_kutta(
        &mut self,
        h: f64,
        mut evaluate: impl FnMut(&mut Self, Instant) -> Result<(), EvalError>,
    ) -> Result<(), EvalError> {
        self.start.copy_from_slice(&self.state);
        evaluate(self, Instant::Start)?;
        self.sum.copy_from_slice(&self.rate);
        for (shift, weight, at) in
            [(0.5 * h, 2.0, Instant::Middle), (0.5 * h, 2.0, Instant::Middle), (h, 1.0, Instant::End)]
        {
            for ((value, start), rate) in self.state.iter_mut().zip(&self.start).zip(&self.rate) {
                *value = start + shift * rate;
            }
            evaluate(self, at)?;
            for (sum, rate) in self.sum.iter_mut().zip(&self.rate) {
                *sum += weight * rate;
            }
        }
        for ((value, start), sum) in self.state.iter_mut().zip(&self.start).zip(&self.sum) {
            *value = start + h / 6.0 * sum;
        }
        Ok(())
    }

    /// Copies the state into the motion.
    fn place(&mut self) {
        for (&value, &slot) in self.state.iter().zip(&self.slots) {
            self.motion[slot] = value;
        }
    }

    /// Rates of the state under the inputs.
    fn evaluate(&mut self, inputs: &[f64]) -> Result<(), EvalError> {
        self.place();
        self.model.forward_dynamics(
            &mut self.motion,
            &self.parameters,
            &self.constants,
            inputs,
            &mut self.workspace,
        )?;
        self.read_rates();
        Ok(())
    }

    /// Copies the rates of the state from the motion.
    fn read_rates(&mut self) {
        for (rate, &slot) in self.rate.iter_mut().zip(&self.slots) {
            *rate = self.motion[slot + self.coordinates];
        }
    }
}

/// Inputs at a share of a step, on the parabola through those at its start, middle and end.
fn within(inputs: [&[f64]; 3], share: f64, out: &mut [f64]) {
    let weights = [(1.0 - share) * (1.0 - 2.0 * share), 4.0 * share * (1.0 - share), share * (2.0 * share - 1.0)];
    for (i, out) in out.iter_mut().enumerate() {
        *out = (0..3).map(|at| weights[at] * inputs[at][i]).sum();
    }
}

#[cfg(test)]
mod tests {
    use super::{Plant, PlantError};
    use ode_solvers::dop_shared::OutputType;
    use ode_solvers::{Dop853, SVector, System};
    use tpm_controller::model::EvalError;
    use tpm_test_support::models::{MassSpringDrag, RubbingSpring, TwoCarts};

    const CHAIN: [f64; 5] = [2.0, 1.0, 40.0, 300.0, 200.0];
    const FORCE: f64 = 30.0;

    /// The two carts written out by hand, for a library's adaptive integrator.
    struct ByHand;
    impl System<f64, SVector<f64, 4>> for ByHand {
        fn system(&self, _: f64, y: &SVector<f64, 4>, dy: &mut SVector<f64, 4>) {
            let [m1, m2, k1, k2, k3] = CHAIN;
            dy[0] = y[2];
            dy[1] = y[3];
            dy[2] = (FORCE - k1 * y[0] - k2 * y[0].powi(3) - k3 * (y[0] - y[1])) / m1;
            dy[3] = -k3 * (y[1] - y[0]) / m2;
        }
    }

    #[test]
    fn converges_with_the_fourth_order_to_an_adaptive_integrator() {
        let start = SVector::<f64, 4>::from_column_slice(&[0.3, -0.1, 0.0, 0.5]);
        // Only the integrator's own steps are read: its interpolation between them is far less exact than its tolerance.
        let sparse = OutputType::Sparse;
        let mut reference = Dop853::from_param(
            ByHand, 0.0, 1.0, 1.0, start, 1e-13, 1e-13, 0.9, 0.0, 0.333, 6.0, 0.1, 0.0, 100_000, 1000, sparse,
        );
        reference.integrate().expect("smooth");
        assert!((reference.x_out().last().expect("end point") - 1.0).abs() < 1e-15);
        let expected = reference.y_out().last().expect("end point");
        let error = |steps: usize| {
            let mut plant = Plant::new(&TwoCarts, &CHAIN, &[]).expect("square");
            plant.reset(&[0.3, -0.1, 0.0, 0.5, 0.0, 0.0]).expect("six entries");
            plant.advance(&[FORCE], 1.0, steps).expect("stable");
            assert!((plant.time() - 1.0).abs() < 1e-15);
            (0..4).map(|i| (plant.motion()[i] - expected[i]).abs()).fold(0.0, f64::max)
        };
        let errors = [error(200), error(400), error(800)];
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!((order - 4.0).abs() < 0.1, "order {order}, errors {errors:?}");
        }
        let finest = error(12_000);
        assert!(finest < 1e-11, "{finest:e} {errors:?}");
    }

    /// A mass on a spring with dry friction: from every reversal it swings about the point where spring and friction
    /// balance, and it sticks where the spring no longer overcomes the friction.
    #[test]
    fn dry_friction_stops_a_mass_where_it_must() {
        let (m, k, fc) = (2.0, 50.0, 6.0);
        let omega = f64::sqrt(k / m);
        let half = std::f64::consts::PI / omega;
        let mut plant = Plant::new(&RubbingSpring, &[m, 0.0, k, fc], &[]).expect("square");
        plant.reset(&[1.0, 0.0, 0.0]).expect("three entries");
        // Reversals at 1, -.76, .52, -.28, .04; the last lies within the band of .12 in which the mass sticks.
        let exact = |t: f64| {
            let (swing, within) = ((t / half).floor(), t % half);
            if swing >= 4.0 {
                return 0.04;
            }
            let side = if swing % 2.0 == 0.0 { 1.0 } else { -1.0 };
            let centre = side * fc / k;
            let amplitude = 1.0 - 2.0 * fc / k * swing - fc / k;
            centre + side * amplitude * (omega * within).cos()
        };
        for n in 1..=400 {
            plant.advance(&[0.0], 0.01, 1).expect("regular");
            let t = 0.01 * f64::from(n);
            assert!((plant.motion()[0] - exact(t)).abs() < 1e-6, "{t}: {} {}", plant.motion()[0], exact(t));
        }
        assert_eq!(plant.motion()[1], 0.0);
        // A force below the friction's limit moves nothing, one above it does.
        let before = plant.motion()[0];
        plant.advance(&[k * before + 0.99 * fc], 0.5, 50).expect("regular");
        assert_eq!(plant.motion()[0], before);
        plant.advance(&[k * before + 1.01 * fc], 0.5, 50).expect("regular");
        assert!(plant.motion()[0] > before);
    }

    #[test]
    fn divergence_and_wrong_sizes_are_named() {
        let mut plant = Plant::new(&MassSpringDrag, &[2.0, -4e4, 1.5], &[]).expect("square");
        plant.reset(&[1.0, 0.0, 0.0]).expect("three entries");
        let mut result = Ok(());
        for _ in 0..10_000 {
            result = plant.advance(&[0.0], 1.0, 1);
            if result.is_err() {
                break;
            }
        }
        assert!(matches!(result, Err(PlantError::Diverged { coordinate: 0, .. })));
        assert!(matches!(Plant::new(&MassSpringDrag, &[2.0], &[]), Err(EvalError::Length { .. })));
        let mut massless = Plant::new(&MassSpringDrag, &[0.0, 1.0, 1.0], &[]).expect("square");
        assert!(matches!(
            massless.advance(&[0.0], 1.0, 1),
            Err(PlantError::Evaluation(EvalError::Singular { coordinate: 0 }))
        ));
    }
}
