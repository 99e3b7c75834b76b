//! What is asked of a search, and why it can fail.

use super::criterion::Criterion;
use tpm_controller::model::EvalError;
use tpm_experiment::ExperimentError;
use tpm_symbolic::plan::base::BasePlanError;

/// Highest harmonic when none is stated.
pub const HARMONICS: u32 = 5;
/// Starts when their number is not stated.
pub const STARTS: usize = 48;

/// How an excitation is sought.
#[derive(Clone, Debug, PartialEq)]
pub struct ExcitationSettings {
    /// What the motion is chosen for.
    pub criterion: Criterion,
    /// Highest harmonic of every coordinate, at least 2.
    pub harmonics: u32,
    /// The period, s; that of the experiment's last stage when not given. It is rounded to whole samples.
    pub period: Option<f64>,
    /// How many random motions the search begins with.
    pub starts: usize,
    /// Seed of these motions.
    pub seed: u64,
    /// Time after which the search ends, s; when not given, it ends with its last start, and gives the same result every time.
    pub seconds: Option<f64>,
}

impl Default for ExcitationSettings {
    fn default() -> Self {
        Self {
            criterion: Criterion::default(),
            harmonics: HARMONICS,
            period: None,
            starts: STARTS,
            seed: 0,
            seconds: None,
        }
    }
}

/// Why there is no excitation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExcitationError {
    /// The experiment does not fit the model.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The model has no base parameters with exact factors.
    #[error(transparent)]
    Base(#[from] BasePlanError),
    /// The rows cannot be evaluated.
    #[error(transparent)]
    Evaluation(#[from] EvalError),
    /// The rows are not those of a mechanism alone.
    #[error("{0}")]
    Rows(&'static str),
    /// Nothing keeps a coordinate from moving ever faster.
    #[error(
        "`{coordinate}` has no limit of its velocity or acceleration; state limits.velocities.{coordinate} in the experiment"
    )]
    NoLimit {
        /// The coordinate.
        coordinate: String,
    },
    /// A position is limited to one side.
    #[error("the position of `{coordinate}` is limited to one side only; state both in limits.positions.{coordinate}")]
    OneSided {
        /// The coordinate.
        coordinate: String,
    },
    /// A setting has no meaning.
    #[error("the {setting} {value} cannot be used: {must}")]
    Setting {
        /// Name of the setting.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// No start could be brought within the limits.
    #[error(
        "none of {starts} motions could be brought within the limits; the limits of positions, velocities and inputs leave no motion that shows \
         every base parameter: raise them, make the period longer, or check the prior from which the inputs are predicted"
    )]
    NoMotion {
        /// Starts that were tried.
        starts: usize,
    },
    /// The search was ended before anything was found.
    #[error("the search ended before a motion was found; give it more time")]
    TooShort,
}
