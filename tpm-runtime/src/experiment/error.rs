//! Why an experiment cannot be done.

use crate::campaign::{CampaignError, StoreError};
use crate::estimate::EstimateError;
use crate::machine::stability::StabilityError;
use std::string::String;
use std::vec::Vec;
use tpm_core::model::EvalError;

/// Why an experiment cannot be done.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExperimentError {
    /// The file is not an experiment.
    #[error("{message}")]
    Syntax {
        /// Place and fault.
        message: String,
    },
    /// An override names nothing, or its value does not fit.
    #[error("{key}: {reason}{}", alternatives(.near))]
    Override {
        /// The key as given.
        key: String,
        /// What is wrong.
        reason: String,
        /// Keys that are like it.
        near: Vec<String>,
    },
    /// A name is not one of the model's.
    #[error("{place}: the model has no {kind} `{name}`; it has {}{}", .available.join(", "), alternatives(.near))]
    UnknownName {
        /// Table of the experiment.
        place: String,
        /// parameter, coordinate, input, constant, or amplitude or frequency.
        kind: &'static str,
        /// The name.
        name: String,
        /// What the model has.
        available: Vec<String>,
        /// The names that are like it.
        near: Vec<String>,
    },
    /// A value is missing.
    #[error("{place}: a value for `{name}` is missing")]
    Missing {
        /// Table of the experiment.
        place: String,
        /// What has no value.
        name: String,
    },
    /// A value makes no sense.
    #[error("{key} = {value}: {must}")]
    Invalid {
        /// Its key.
        key: String,
        /// The value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// The simulated machine cannot be evaluated.
    #[error("the simulated machine: {0}")]
    Plant(#[from] EvalError),
    /// A reference would pass a limit.
    #[error(
        "schedule.stages.{stage}: the reference of `{name}` reaches {value}, beyond limits.{limit}.{name}; lower its amplitude or its frequency"
    )]
    BeyondLimit {
        /// Stage of the schedule, from 0.
        stage: usize,
        /// The coordinate.
        name: String,
        /// Its position or velocity.
        value: f64,
        /// positions or velocities.
        limit: &'static str,
    },
    /// Another machine than the model's is simulated, with other signals.
    #[error("plant.closed_loop_arm: this machine has two angles and two torques, the model has others")]
    Machine,
    /// A value for a machine that obeys the model, although another one is simulated.
    #[error(
        "{key}: the machine of plant.closed_loop_arm has no such value; leave it out, or change the arm's own there"
    )]
    NotOfMachine {
        /// Its key.
        key: String,
    },
    /// Equations that count alike are for one estimator.
    #[error(
        "weights = \"equal\" is for the estimator measured-motion on the machine's own equations; leave it out, or set estimator = \"measured-motion\" (and equations = \"own\" where the model eliminates coordinates)"
    )]
    Weights,
    /// A motor of the experiment.
    #[error("motors: {message}")]
    Motors {
        /// The fault, with what to do.
        message: String,
    },
    /// A campaign's folder cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The loop must not be closed.
    #[error(transparent)]
    Stability(#[from] StabilityError),
    /// The campaign cannot go on.
    #[error(transparent)]
    Campaign(#[from] CampaignError),
    /// The schedule has no stage to design around.
    #[error("schedule.stages is empty: give a stage, around which candidates are tried")]
    NoStage,
    /// With these estimates no candidate's motion can be predicted.
    #[error(
        "the rows do not determine the motion with the estimates {}; give prior values that do", .estimates.join(", ")
    )]
    Unpredictable {
        /// Names and values.
        estimates: Vec<String>,
    },
    /// Nothing was estimated.
    #[error(transparent)]
    Estimate(#[from] EstimateError),
}

fn alternatives(near: &[String]) -> String {
    if near.is_empty() { String::new() } else { std::format!("; did you mean {}?", near.join(" or ")) }
}
