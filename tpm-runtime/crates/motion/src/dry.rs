//! Dry friction in a model's rows: their jump where the velocity of a coordinate passes through zero.
//!
//! Invariant: a row is evaluated on either side of rest at a velocity so small that only its sign has an effect.

use tpm_controller::model::{EvalError, Model};

/// Magnitude of a velocity, unit of the coordinate per second, so small that only its sign has an effect on a row; its
/// square is zero in floating point.
pub const CREEP: f64 = 1e-200;
/// Smallest difference of a row between the two sides of rest that counts as a jump. Viscous friction gives differences
/// of the size of [`CREEP`].
const LEAST_JUMP: f64 = 1e-100;

/// Workspace for evaluating a model's rows on both sides of rest.
#[derive(Clone, Debug)]
pub struct FrictionJump {
    scratch: Vec<f64>,
    /// Inputs of a model whose rows need them: friction that grows with an input is there where that is one.
    inputs: Vec<f64>,
    phi: Vec<f64>,
    forward: Vec<f64>,
    backward: Vec<f64>,
}

impl FrictionJump {
    pub(crate) fn new(model: &dyn Model<f64>) -> Self {
        let rows = model.dims().rows;
        let needs_inputs = model.needs_inputs();
        FrictionJump {
            scratch: vec![0.0; model.inverse_workspace_len()],
            inputs: vec![1.0; if needs_inputs { model.dims().inputs } else { 0 }],
            phi: vec![0.0; if needs_inputs { model.dims().regressor_len() } else { 0 }],
            forward: vec![0.0; rows],
            backward: vec![0.0; rows],
        }
    }

    /// Half the jump of every row where the velocity of `coordinate` passes through zero with the rest of the motion as it is: the
    /// force of dry friction that opposes a motion forwards. The motion is handed back as it was.
    ///
    /// # Errors
    /// [`EvalError`] when the slices do not fit the model.
    pub(crate) fn half_jump(
        &mut self,
        model: &dyn Model<f64>,
        motion: &mut [f64],
        coordinate: usize,
        parameters: &[f64],
        constants: &[f64],
    ) -> Result<impl Iterator<Item = f64> + '_, EvalError> {
        let slot = model.dims().coordinates + coordinate;
        let velocity = motion[slot];
        for (side, out) in [(CREEP, &mut self.forward), (-CREEP, &mut self.backward)] {
            motion[slot] = side;
            if model.needs_inputs() {
                let parts = (self.phi.as_mut_slice(), out.as_mut_slice());
                model.rows_under(motion, &self.inputs, constants, &mut self.scratch, parts)?;
                for (force, row) in out.iter_mut().zip(self.phi.chunks_exact(parameters.len().max(1))) {
                    *force += row.iter().zip(parameters).map(|(entry, value)| entry * value).sum::<f64>();
                }
            } else {
                model.inverse_dynamics(motion, parameters, constants, &mut self.scratch, out)?;
            }
        }
        motion[slot] = velocity;
        Ok(self.forward.iter().zip(&self.backward).map(|(forward, backward)| 0.5 * (forward - backward)))
    }

    /// Whether a row jumps where the velocity of `coordinate` passes through zero with the rest of the motion as it is.
    ///
    /// # Errors
    /// [`EvalError`] when the slices do not fit the model.
    pub(crate) fn is_dry(
        &mut self,
        model: &dyn Model<f64>,
        motion: &mut [f64],
        coordinate: usize,
        parameters: &[f64],
        constants: &[f64],
    ) -> Result<bool, EvalError> {
        if model.coordinate_order(coordinate) < 1 {
            return Ok(false);
        }
        Ok(self.half_jump(model, motion, coordinate, parameters, constants)?.any(|jump| jump.abs() > LEAST_JUMP))
    }
}

#[cfg(test)]
mod tests {
    use super::FrictionJump;
    use tpm_test_support::models::{MassSpringDrag, RubbingSpring};

    #[test]
    fn only_dry_friction_jumps() {
        let (rubbing, smooth) = ([2.0, 0.3, 8.0, 0.7], [2.0, 8.0, 0.7]);
        let mut motion = [0.1, 3.0, 0.5];
        let mut friction_jump = FrictionJump::new(&RubbingSpring);
        let jump: Vec<f64> =
            friction_jump.half_jump(&RubbingSpring, &mut motion, 0, &rubbing, &[]).expect("lengths fit").collect();
        assert!((jump[0] - 0.7).abs() < 1e-15 && motion == [0.1, 3.0, 0.5]);
        assert_eq!(friction_jump.is_dry(&RubbingSpring, &mut [0.0; 3], 0, &rubbing, &[]), Ok(true));
        let mut friction_jump = FrictionJump::new(&MassSpringDrag);
        for mut motion in [[0.0; 3], motion] {
            assert_eq!(friction_jump.is_dry(&MassSpringDrag, &mut motion, 0, &smooth, &[]), Ok(false));
        }
    }
}
