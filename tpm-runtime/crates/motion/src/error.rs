//! Why a run cannot be prepared.

use crate::completion::OpenReason;
use tpm_controller::model::EvalError;

/// Why an experiment cannot be played.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrialError {
    /// The model could not be evaluated along the reference.
    #[error("the model cannot be evaluated along the reference: {0}")]
    Evaluation(#[from] EvalError),
    /// A period has too few samples.
    #[error(
        "a period of {frequency} rad/s has {samples} samples of {sample_time} s; harmonic {harmonic} needs more: sample faster or move slower"
    )]
    TooCoarse {
        /// Frequency asked for, rad/s.
        frequency: f64,
        /// Samples in its period.
        samples: f64,
        /// Time between samples, s.
        sample_time: f64,
        /// Highest harmonic of the reference.
        harmonic: u32,
    },
    /// The inputs cannot be solved for.
    #[error("the feed-forward is not determined: input `{input}` acts on no row, or on the same rows as another one")]
    Inputs {
        /// The input.
        input: String,
    },
    /// The pattern leaves a coordinate open, and the rows do not determine its motion.
    #[error("the pattern gives {} no motion: {reason}", .coordinates.join(" and "))]
    Open {
        /// The coordinates.
        coordinates: Vec<String>,
        /// Why their motion does not follow.
        reason: OpenReason,
    },
    /// The feed-forward is not a number.
    #[error("the feed-forward of `{input}` is not finite at sample {sample} of the period")]
    NotFinite {
        /// The input.
        input: String,
        /// Sample of the period.
        sample: usize,
    },
}
