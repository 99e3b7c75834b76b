//! The rows by which a model explains logs: those of the model as they are or, where it has nonlinear parameters, with these behind
//! the others.

use crate::identification::Identification;
use crate::identify::identify_segments;
use crate::log_fault::LogFault;
use crate::model::{DeclaredModel, Identifiable};
use crate::options::LogOptions;
use crate::separable;
use tpm_controller::model::{EvalError, Model};
use tpm_estimate::Differentiable;
use tpm_interpret::{InterpretedDerivatives, Separable};
use tpm_log::Log;

/// The rows of a model, and their derivatives where they are known.
pub(super) struct Rows<'a> {
    own: &'a dyn Model<f64>,
    separable: Option<Separable>,
    derivatives: Option<InterpretedDerivatives>,
}

impl<'a> Rows<'a> {
    /// The rows of a model; `declared` is its declaration.
    pub(super) fn new(model: &'a dyn Identifiable, declared: Option<&DeclaredModel>) -> Self {
        let separable = declared.and_then(DeclaredModel::separable);
        let derivatives = declared.map(|declared| match &separable {
            Some(_) => declared.separable_derivatives(),
            None => declared.derivatives(),
        });
        Self { own: model.evaluated(), separable, derivatives }
    }

    /// The rows as a model, whose parameters are all that a log identifies.
    pub(super) fn model(&self) -> &dyn Model<f64> {
        match &self.separable {
            Some(separable) => separable,
            None => self.own,
        }
    }

    /// The rows with their derivatives; nothing for a model that was written by hand.
    pub(super) fn machine(&self) -> Option<Differentiable<'_>> {
        let derivatives = self.derivatives.as_ref()?;
        Some(Differentiable { model: self.model(), derivatives })
    }

    /// These rows, linear about the given parameters, at which they are exact.
    ///
    /// # Errors
    /// [`EvalError::Length`] when there are not as many values as parameters.
    pub(super) fn about(self, parameters: &[f64]) -> Result<Self, EvalError> {
        let at = |separable: Separable| separable.at(parameters.to_vec());
        Ok(Self { separable: self.separable.map(at).transpose()?, ..self })
    }

    /// Identifies the parameters from the segments of one record.
    ///
    /// # Errors
    /// [`LogFault`].
    pub(super) fn identify(&self, segments: &[&Log], options: &LogOptions) -> Result<Identification, LogFault> {
        match (&self.separable, &self.derivatives) {
            (Some(model), Some(derivatives)) => separable::identify(model, derivatives, segments, options),
            _ => identify_segments(self.model(), self.machine(), segments, options),
        }
    }
}
