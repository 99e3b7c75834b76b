//! Why there is no estimate.

use std::string::String;
use tpm_core::model::EvalError;

/// Why an estimator gave no estimate.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EstimateError {
    /// The model refused an evaluation.
    #[error("the model cannot be evaluated: {0}")]
    Model(#[from] EvalError),
    /// Spectra and model do not have the same number of signals.
    #[error("the model has {needed} coordinates and inputs, the record has {given} signals")]
    Channels {
        /// Coordinates plus inputs.
        needed: usize,
        /// Signals in the record.
        given: usize,
    },
    /// A term is not finite along the motion.
    #[error(
        "row {row} is not finite on the measured motion ({what}); is a square root taken of a negative number, or a scale wrong?"
    )]
    NotFinite {
        /// Name of the row.
        row: String,
        /// The term.
        what: String,
    },
    /// No harmonic stands out of the noise.
    #[error(
        "no harmonic of the inputs or of the motion stands out of the noise; excite the machine more, or record longer"
    )]
    NoSignal,
    /// A frozen parameter does not exist.
    #[error("there is no parameter number {0} to freeze")]
    Frozen(usize),
    /// Every parameter is frozen.
    #[error("all parameters are frozen; there is nothing to identify")]
    AllFrozen,
}
