//! Why a record cannot be fitted sample by sample.

use tpm_controller::model::EvalError;

/// Why a record was not fitted sample by sample.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OutputErrorFault {
    /// The rows do not determine the motion.
    #[error(
        "the motion does not follow from the inputs: the model has not as many rows with derivatives as coordinates"
    )]
    NotSimulable,
    /// The model could not be evaluated.
    #[error("the model could not be simulated: {0}")]
    Evaluation(#[from] EvalError),
    /// The record does not show all parameters.
    #[error("the parameters do not show one by one when the record is simulated")]
    Singular,
    /// The simulated motion leaves all bounds from one sample to the next.
    #[error("the simulated motion leaves all bounds from one sample to the next")]
    Unbounded,
    /// Whoever waits for the result did not wait so long.
    #[error("the time that it was given was over before it had settled")]
    Ended,
    /// Gauss-Newton steps did not become small.
    #[error("the simulation did not settle on parameters in {steps} steps")]
    NotConverged {
        /// Steps that were made.
        steps: usize,
    },
}
