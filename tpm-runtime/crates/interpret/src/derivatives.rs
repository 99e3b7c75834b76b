//! The derivatives of a model's rows as numbers.

use crate::leaves::{Leaves, require_motion};
use crate::program::Program;
use tpm_controller::derivatives::RowDerivatives;
use tpm_controller::model::{Buffer, Dims, EvalError, require_len, split_workspace};
use tpm_symbolic::mechanics::model::ExactModel as Declared;
use tpm_symbolic::plan::derivatives::Derivatives;
use tpm_symbolic::plan::evaluation::Evaluation;
use tpm_symbolic::regressor::form::RegressorForm;

/// The derivatives of a declared model's rows, ready to be evaluated.
#[derive(Clone, Debug)]
pub struct InterpretedDerivatives {
    dims: Dims,
    /// Index in the motion of every slot of the program.
    places: Vec<usize>,
    switches: usize,
    rows: Program,
    switching: Program,
}

impl InterpretedDerivatives {
    /// Compiles the derivatives of a model's rows for evaluation; `form` is the regressor form of `model`.
    #[must_use]
    pub fn new(model: &Declared, form: &RegressorForm) -> Self {
        let (evaluation, derivatives) = Evaluation::with_derivatives(model, form);
        let leaves = Leaves::new(&evaluation, form);
        Self::of(&evaluation, &derivatives, &leaves)
    }

    /// Compiles the derivatives of the rows of a model with nonlinear parameters. These parameters follow the linear
    /// ones, as in [`Separable`](crate::Separable).
    #[must_use]
    pub fn separable(model: &Declared, form: &RegressorForm) -> Self {
        let (evaluation, derivatives) = Evaluation::with_derivatives(model, form);
        let leaves = Leaves::separable(model, &evaluation, form);
        Self::of(&evaluation, &derivatives, &leaves)
    }

    fn of(evaluation: &Evaluation, derivatives: &Derivatives, leaves: &Leaves) -> Self {
        let n = evaluation.coordinates.len();
        let position = |q| evaluation.coordinates.iter().position(|(present, _)| *present == q);
        let place = |&(q, order): &(_, u32)| {
            let coordinate = position(q).expect("invariant: a slot belongs to a coordinate of the rows");
            order as usize * n + coordinate
        };
        Self {
            dims: leaves.dims,
            places: derivatives.slots.iter().map(place).collect(),
            switches: derivatives.switches,
            rows: Program::new(&derivatives.rows, leaves.all()),
            switching: Program::new(&derivatives.switching, leaves.all()),
        }
    }

    fn check(&self, motion: &[f64], parameters: &[f64], constants: &[f64], inputs: &[f64]) -> Result<(), EvalError> {
        require_motion(self.dims, motion, constants)?;
        require_len(Buffer::Parameters, parameters.len(), self.dims.parameters)?;
        require_len(Buffer::Inputs, inputs.len(), self.dims.inputs)
    }
}

impl RowDerivatives<f64> for InterpretedDerivatives {
    fn workspace_len(&self) -> usize {
        self.rows.workspace_len.max(self.switching.workspace_len) + self.rows.output_len()
    }

    fn rows(
        &self,
        motion: &[f64],
        parameters: &[f64],
        constants: &[f64],
        inputs: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        self.check(motion, parameters, constants, inputs)?;
        let width = self.dims.motion_len();
        require_len(Buffer::Output, out.len(), self.dims.rows * width)?;
        let (results, scratch) = split_workspace(workspace, self.rows.output_len())?;
        let (scratch, _) = split_workspace(scratch, self.rows.workspace_len)?;
        self.rows.run(&[motion, constants, parameters, inputs], scratch, results);
        out.fill(0.0);
        let slots = self.places.len();
        for (row, results) in results.chunks_exact(slots.max(1)).enumerate() {
            for (&place, &value) in self.places.iter().zip(results) {
                out[row * width + place] = value;
            }
        }
        Ok(())
    }

    fn switches(&self) -> usize {
        self.switches
    }

    fn switching(
        &self,
        motion: &[f64],
        parameters: &[f64],
        constants: &[f64],
        inputs: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        self.check(motion, parameters, constants, inputs)?;
        require_len(Buffer::Output, out.len(), self.switching.output_len())?;
        let (scratch, _) = split_workspace(workspace, self.switching.workspace_len)?;
        self.switching.run(&[motion, constants, parameters, inputs], scratch, out);
        Ok(())
    }
}
