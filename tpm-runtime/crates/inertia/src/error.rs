//! Why inertias cannot be found.

use thiserror::Error;
use tpm_codegen::import::SplitError;

/// Why possible inertias, or those of a load, cannot be found.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum InertiaError {
    /// The result belongs to another model.
    #[error(
        "the result is of the model `{found}`, not of `{expected}`; identify with this model, or give the one that was used"
    )]
    Model {
        /// The model of the result.
        found: String,
        /// The model that was given.
        expected: String,
    },
    /// The result has a parameter that the model does not have.
    #[error(
        "the result has the parameter `{0}`, which the model does not; give the model with which it was identified"
    )]
    Parameter(String),
    /// A column is no sum of parameters times numbers.
    #[error(
        "the parameters do not enter this model linearly, or with constants that have no value; give the constants values in the model"
    )]
    Nonlinear,
    /// A body of the model does not move in the description, or the other way round.
    #[error(
        "the model has no parameter of the link `{link}`, whose inertia would end in `_{body}`; read the description with the options with \
         which the model was imported"
    )]
    Body {
        /// The link in the description.
        link: String,
        /// The body's name in the model.
        body: String,
    },
    /// No body of the model has this name.
    #[error("the model has no body `{name}` with unknown inertia; its bodies are {}", .known.join(", "))]
    NoBody {
        /// The name.
        name: String,
        /// The bodies.
        known: Vec<String>,
    },
    /// The model has no body.
    #[error("the model has no body with unknown inertia; a load is found on an arm whose model has a mechanism")]
    NoMechanism,
    /// The result shows nothing.
    #[error("the result shows no parameter and no combination; identify from a log in which the joints move")]
    Nothing,
    /// The covariance is not one.
    #[error(
        "the covariance of the result is not positive definite; identify again from a log that shows more, or hold fewer parameters"
    )]
    Covariance,
    /// A stated weight or value cannot be used.
    #[error("{name} is {value}, which must be a positive number")]
    NotPositive {
        /// What was stated.
        name: String,
        /// Its value.
        value: f64,
    },
    /// A stated name is none of a parameter.
    #[error(
        "`{0}` is no parameter of the model or of its links; inertias end in the name of a link, such as `m_forearm`, losses in that of a joint"
    )]
    Unknown(String),
    /// The method ended without a minimum.
    #[error(
        "no possible inertias were found: numbers overflow; check the units of log and description (kg, m, rad, N m)"
    )]
    NoMinimum,
    /// Inertias cannot be written.
    #[error("{0}")]
    Split(#[from] SplitError),
}
