//! The rows of a model in base parameters, with gradients in the motion and with bounds over a range of motions.
//!
//! Invariant: forces are Phi theta + known, as in [`Interpreted`](crate::Interpreted); the regressor has the columns that lead the base
//! parameters and nothing else, so that it has full rank along a motion that shows everything.

use crate::interval::Interval;
use crate::leaves::{Leaves, require_motion};
use crate::program::Program;
use tpm_controller::model::{Buffer, Dims, EvalError, require_len};
use tpm_symbolic::mechanics::model::ExactModel as Declared;
use tpm_symbolic::mechanics::tree::mechanism::Mechanism;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::base::{BasePlan, BasePlanError};
use tpm_symbolic::plan::evaluation::Evaluation;
use tpm_symbolic::plan::forces;
use tpm_symbolic::regressor::form::RegressorForm;

/// The rows of a model in base parameters, ready to be evaluated.
#[derive(Clone, Debug)]
pub struct BaseRows {
    dims: Dims,
    leading: Vec<usize>,
    /// Columns and factors of every base parameter, its leading column among them.
    combinations: Vec<Vec<(usize, f64)>>,
    regressor: Program,
    known: Program,
    /// Phi theta + known, by the recursion of a mechanism.
    forces: Option<Program>,
}

/// Memory in which rows are evaluated. Results stay until the next evaluation.
#[derive(Clone, Debug)]
pub struct RowsAt {
    /// Rows times base parameters, row by row.
    pub regressor: Vec<f64>,
    /// Terms without an unknown parameter, by row.
    pub known: Vec<f64>,
    of_regressor: Vec<f64>,
    of_known: Vec<f64>,
    adjoints: Vec<f64>,
}

impl BaseRows {
    /// Compiles the rows of a model; `form` is its regressor form, `mechanism` the mechanism from which it follows.
    ///
    /// # Errors
    /// [`BasePlanError`] when the base parameters have no exact factors, or there is none.
    pub fn new(model: &Declared, form: &RegressorForm, mechanism: Option<&Mechanism>) -> Result<Self, BasePlanError> {
        let evaluation = Evaluation::new(model, form);
        let base = BasePlan::new(model, form, &evaluation)?;
        let leaves = Leaves::new(&evaluation, form);
        let combination = |own: &tpm_symbolic::regressor::base_parameters::BaseParameter| {
            let others = own.others.iter().map(|(column, factor)| (*column, rational::to_f64(factor)));
            std::iter::once((own.column, 1.0)).chain(others).collect()
        };
        let forces = mechanism.and_then(|mechanism| forces::by_recursion(model, form, mechanism));
        Ok(Self {
            dims: leaves.dims,
            leading: base.parameters.iter().map(|own| own.column).collect(),
            combinations: base.parameters.iter().map(combination).collect(),
            regressor: Program::new(&base.regressor, leaves.of_motion()),
            known: Program::new(&evaluation.known, leaves.of_motion()),
            forces: forces.map(|plan| Program::new(&plan, leaves.all())),
        })
    }

    /// The sizes of the model.
    #[must_use]
    pub const fn dims(&self) -> Dims {
        self.dims
    }

    /// The leading column of every base parameter.
    #[must_use]
    pub fn leading(&self) -> &[usize] {
        &self.leading
    }

    /// The base parameters at values of all parameters.
    #[must_use]
    pub fn lumped(&self, parameters: &[f64]) -> Vec<f64> {
        let value = |own: &Vec<(usize, f64)>| own.iter().map(|(column, factor)| factor * parameters[*column]).sum();
        self.combinations.iter().map(value).collect()
    }

    /// Memory for the evaluation.
    #[must_use]
    pub fn memory(&self) -> RowsAt {
        let longest = self.regressor.workspace_len.max(self.known.workspace_len);
        RowsAt {
            regressor: vec![0.0; self.regressor.output_len()],
            known: vec![0.0; self.known.output_len()],
            of_regressor: vec![0.0; self.regressor.workspace_len],
            of_known: vec![0.0; self.known.workspace_len],
            adjoints: vec![0.0; longest],
        }
    }

    /// Evaluates regressor and known terms.
    ///
    /// # Errors
    /// [`EvalError::Length`] when motion or constants have another length than the model's.
    pub fn evaluate(&self, motion: &[f64], constants: &[f64], at: &mut RowsAt) -> Result<(), EvalError> {
        require_motion(self.dims, motion, constants)?;
        self.regressor.run(&[motion, constants], &mut at.of_regressor, &mut at.regressor);
        self.known.run(&[motion, constants], &mut at.of_known, &mut at.known);
        Ok(())
    }

    /// The gradient, with respect to the motion that was evaluated last, of the sum of the regressor's entries and of the known
    /// terms with these weights, into `gradient`. The jumps of dry friction do not count.
    ///
    /// # Errors
    /// [`EvalError::Length`] when the gradient is not as long as a motion.
    pub fn gradient(
        &self,
        weights: &[f64],
        of_known: &[f64],
        at: &mut RowsAt,
        gradient: &mut [f64],
    ) -> Result<(), EvalError> {
        require_len(Buffer::Output, gradient.len(), self.dims.motion_len())?;
        gradient.fill(0.0);
        self.regressor.pull_back(&at.of_regressor, weights, &mut at.adjoints, gradient);
        self.known.pull_back(&at.of_known, of_known, &mut at.adjoints, gradient);
        Ok(())
    }

    /// Bounds of the forces Phi theta + known, by row, for all motions within these intervals.
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has another length than the model's.
    pub fn forces_within(
        &self,
        motion: &[Interval],
        constants: &[f64],
        parameters: &[f64],
        workspace: &mut Vec<Interval>,
    ) -> Result<Vec<Interval>, EvalError> {
        require_len(Buffer::Motion, motion.len(), self.dims.motion_len())?;
        require_len(Buffer::Constants, constants.len(), self.dims.constants)?;
        require_len(Buffer::Parameters, parameters.len(), self.dims.parameters)?;
        let exact = |values: &[f64]| values.iter().map(|&value| Interval::around(value)).collect::<Vec<_>>();
        let constants = exact(constants);
        let of_motion = || motion.iter().chain(&constants).copied();
        if let Some(forces) = &self.forces {
            let inputs = std::iter::repeat_n(Interval::around(0.0), self.dims.inputs);
            return Ok(forces.enclose(of_motion().chain(exact(parameters)).chain(inputs), workspace));
        }
        let mut sums = self.known.enclose(of_motion(), workspace);
        let regressor = self.regressor.enclose(of_motion(), workspace);
        let base = exact(&self.lumped(parameters));
        for (sum, entries) in sums.iter_mut().zip(regressor.chunks_exact(base.len().max(1))) {
            for (&entry, &value) in entries.iter().zip(&base) {
                *sum = *sum + entry * value;
            }
        }
        Ok(sums)
    }
}
