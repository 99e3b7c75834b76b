//! Why there is no estimate.

use tpm_controller::model::EvalError;

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
    /// `effort` does not apply to a model with rows without an input.
    #[error(
        "`effort` compares the feedback's effort with the equations along the reference, and no input acts in {}: no effort shows the parameters there; `measured-motion`, `error` and `hill` use the motion as well",
        .rows.join(", ")
    )]
    NoEffort {
        /// Names of the rows.
        rows: Vec<String>,
    },
    /// The first estimates give open coordinates no reference.
    #[error(
        "`{estimator}` compares the motion with its reference, and with these estimates the reference of {} rests; state estimates for the parameters of the equations without an input, or use `measured-motion`",
        .coordinates.join(", ")
    )]
    NoReference {
        /// Name of the estimator.
        estimator: &'static str,
        /// Names of the coordinates.
        coordinates: Vec<String>,
    },
    /// There are fewer runs than `numerical` needs for its matrix.
    #[error(
        "`numerical` needs {needed} runs for its matrix, one to compare with and one for every independent parameter; the campaign has {given}"
    )]
    FewRuns {
        /// Runs that are needed.
        needed: usize,
        /// Most runs of the campaign.
        given: usize,
    },
}
