//! The leaves (inputs) of the compiled programs of a model.

use tpm_controller::model::{Buffer, Dims, EvalError, require_len};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::ExactModel as Declared;
use tpm_symbolic::plan::evaluation::Evaluation;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::regressor::form::RegressorForm;

/// The sizes of a model, and the leaves of its programs in the order in which their values are given: motion (derivatives of the
/// coordinates, order by order), constants, parameters, inputs.
#[derive(Clone, Debug)]
pub(super) struct Leaves {
    pub(super) dims: Dims,
    list: Vec<Leaf>,
}

impl Leaves {
    /// The leaves of the programs of `form`; `evaluation` holds their plans.
    pub(super) fn new(evaluation: &Evaluation, form: &RegressorForm) -> Self {
        let dims = Dims {
            coordinates: evaluation.coordinates.len(),
            order: evaluation.order() as usize,
            inputs: evaluation.inputs.len(),
            rows: form.rows.len(),
            parameters: form.columns.len(),
            constants: evaluation.constants.len(),
        };
        let mut list: Vec<Leaf> = (0..=evaluation.order())
            .flat_map(|order| evaluation.coordinates.iter().map(move |(q, _)| Leaf::Motion(*q, order)))
            .collect();
        list.extend(evaluation.constants.iter().map(|&constant| Leaf::Symbol(constant)));
        list.extend((0..form.columns.len()).map(Leaf::Column));
        list.extend(evaluation.inputs.iter().map(|&input| Leaf::Symbol(input)));
        Self { dims, list }
    }

    /// The leaves of the programs of `form` when the nonlinear parameters of `model` count as parameters, which follow
    /// the linear ones, and no longer as constants.
    pub(super) fn separable(model: &Declared, evaluation: &Evaluation, form: &RegressorForm) -> Self {
        let constants: Vec<Symbol> = model.known_constants().collect();
        let motion = (0..=evaluation.order())
            .flat_map(|order| evaluation.coordinates.iter().map(move |(q, _)| Leaf::Motion(*q, order)));
        let list: Vec<Leaf> = motion
            .chain(constants.iter().map(|&constant| Leaf::Symbol(constant)))
            .chain((0..form.columns.len()).map(Leaf::Column))
            .chain(model.nonlinear.iter().map(|own| Leaf::Symbol(own.symbol)))
            .chain(evaluation.inputs.iter().map(|&input| Leaf::Symbol(input)))
            .collect();
        let dims = Dims {
            parameters: form.columns.len() + model.nonlinear.len(),
            constants: constants.len(),
            ..Self::new(evaluation, form).dims
        };
        Self { dims, list }
    }

    /// Motion, constants and inputs: the leaves of the regressor and the known terms where inputs do not stand alone.
    pub(super) fn without_parameters(&self) -> Vec<Leaf> {
        let inputs = self.list.len() - self.dims.inputs;
        self.of_motion().iter().chain(&self.list[inputs..]).copied().collect()
    }

    /// Motion and constants: the leaves of the input map and, where inputs stand alone, of the regressor and the known terms.
    pub(super) fn of_motion(&self) -> &[Leaf] {
        &self.list[..self.dims.motion_len() + self.dims.constants]
    }

    /// Motion, constants, parameters and inputs.
    pub(super) fn all(&self) -> &[Leaf] {
        &self.list
    }
}

/// Requires that motion and constants have the lengths of the model.
///
/// # Errors
/// [`EvalError::Length`] when a length differs.
pub(super) fn require_motion(dims: Dims, motion: &[f64], constants: &[f64]) -> Result<(), EvalError> {
    require_len(Buffer::Motion, motion.len(), dims.motion_len())?;
    require_len(Buffer::Constants, constants.len(), dims.constants)
}
