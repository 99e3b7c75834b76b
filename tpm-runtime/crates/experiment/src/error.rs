//! Why an experiment cannot be carried out.

use tpm_campaign::{CampaignError, StoreError};
use tpm_controller::model::EvalError;
use tpm_estimate::EstimateError;
use tpm_plant::stability::StabilityError;
use tpm_report::number;

/// A value with at most a readable number of digits.
fn shown(value: f64) -> String {
    if value != 0.0 && !(1e-9..1e15).contains(&value.abs()) { format!("{value:e}") } else { format!("{value}") }
}

/// Why an experiment cannot be carried out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExperimentError {
    /// The file is not an experiment.
    #[error("{message}")]
    Syntax {
        /// Place and fault.
        message: String,
    },
    /// An override has a key that does not exist, or a value that does not fit.
    #[error("{key}: {reason}{}", alternatives(.near))]
    Override {
        /// The key as given.
        key: String,
        /// What is wrong.
        reason: String,
        /// Similar keys.
        near: Vec<String>,
    },
    /// The model does not have the name.
    #[error("{place}: the model has no {kind} `{name}`; it has {}{}", .available.join(", "), alternatives(.near))]
    UnknownName {
        /// Table of the experiment.
        place: String,
        /// parameter, coordinate, input, constant, or amplitude or frequency.
        kind: &'static str,
        /// The name.
        name: String,
        /// Names of this kind in the model.
        available: Vec<String>,
        /// Similar names.
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
    #[error("{key} = {}: {must}", shown(*.value))]
    Invalid {
        /// Key of the value.
        key: String,
        /// The value.
        value: f64,
        /// Condition that the value must meet.
        must: &'static str,
    },
    /// A nonlinear parameter is given a value outside its interval.
    #[error("{key} = {}: the model looks for this nonlinear parameter from {} to {}; change one of them", number(*.value), number(.interval[0]), number(.interval[1]))]
    OutsideInterval {
        /// Key of the value.
        key: String,
        /// The value.
        value: f64,
        /// The interval.
        interval: [f64; 2],
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
        /// Its position, velocity or acceleration where it passes the limit.
        value: f64,
        /// `positions`, `velocities` or `accelerations`.
        limit: &'static str,
    },
    /// A stroke does not go on into the rest or the stroke after it.
    #[error(
        "{place}: `{name}` ends with the {what} {}, and {} {}; {}",
        number(*value),
        if *rests { "a rest follows, or a stroke that begins with" } else { "the next stroke begins with" },
        number(*next),
        if *rests && *order > 0 {
            "let the stroke end where the pattern rests, or leave the rest out and let a stroke follow that begins so"
        } else {
            "let a stroke follow that begins so; the first follows the last"
        }
    )]
    Broken {
        /// The stroke in the experiment.
        place: String,
        /// The coordinate.
        name: String,
        /// Position, velocity or acceleration.
        what: &'static str,
        /// Order of the derivative: 0 for the position.
        order: usize,
        /// Its value at the end of the stroke.
        value: f64,
        /// Its value where the motion goes on.
        next: f64,
        /// Whether a rest follows.
        rests: bool,
    },
    /// A stroke's pattern has other amplitudes than the stage's, or leaves other coordinates open.
    #[error(
        "{place}: the pattern `{pattern}` of this stroke takes {own} from the stage, the stage's own pattern takes {wanted}; declare the same in both"
    )]
    StrokePattern {
        /// The stroke in the experiment.
        place: String,
        /// Name of its pattern.
        pattern: String,
        /// Amplitudes and frequency of its pattern, and coordinates that it leaves open.
        own: String,
        /// Amplitudes and frequency of the stage's pattern, and coordinates that it leaves open.
        wanted: String,
    },
    /// The simulated machine does not obey the model, and its signals are not those of the model.
    #[error("plant.closed_loop_arm: this machine has two angles and two torques, the model has others")]
    Machine,
    /// The model of the simulated machine does not fit.
    #[error("plant.model: {message}")]
    PlantModel {
        /// What does not fit, and what to do.
        message: String,
    },
    /// A value for a simulated machine that obeys the model, although the experiment simulates another machine.
    #[error(
        "{key}: the machine of plant.closed_loop_arm has no such value; leave it out, or change the arm's own there"
    )]
    NotOfMachine {
        /// Key of the value.
        key: String,
    },
    /// Equal weights of the equations are asked of an estimator that does not have them.
    #[error(
        "weights = \"equal\" is for the estimator measured-motion on the machine's own equations; leave it out, or set estimator = \"measured-motion\" (and equations = \"own\" where the model eliminates coordinates)"
    )]
    Weights,
    /// The motors of the experiment do not fit.
    #[error("motors: {message}")]
    Motors {
        /// The fault, with what to do.
        message: String,
    },
    /// A campaign's folder cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The loop is not stable.
    #[error(transparent)]
    Stability(#[from] StabilityError),
    /// The campaign cannot go on.
    #[error(transparent)]
    Campaign(#[from] CampaignError),
    /// A campaign is to choose its stages, and a limit of them is missing.
    #[error("a campaign that chooses its motions needs a limit of {name}: state limits.{limit}.{name} in the experiment, or `{}` among the limits that are given by name", if *.limit == "velocities" { format!("dot({name})") } else { name.clone() })]
    NeedsLimit {
        /// The coordinate or input.
        name: String,
        /// `positions`, `velocities` or `inputs`.
        limit: &'static str,
    },
    /// A campaign that chooses its stages has another estimator than measured-motion.
    #[error(
        "plan: a campaign that chooses its motions needs estimator = \"measured-motion\", whose deviations contain what is not known; leave the estimator out, or list stages and leave [plan] out"
    )]
    PlanMethod,
    /// The limits of the motion leave no room about the place where the pattern rests.
    #[error(
        "plan: the pattern without amplitudes rests outside limits.positions, or no amplitude moves a coordinate: state limits around that place, or choose another pattern"
    )]
    NoRoom,
    /// The schedule has no stage to design around.
    #[error("schedule.stages is empty: give a stage, around which candidates are tried")]
    NoStage,
    /// With these estimates the motion of no candidate can be predicted.
    #[error(
        "the rows do not determine the motion with the estimates {}; give prior values that do", .estimates.join(", ")
    )]
    Unpredictable {
        /// Names and values of the estimates.
        estimates: Vec<String>,
    },
    /// Nothing was estimated.
    #[error(transparent)]
    Estimate(#[from] EstimateError),
}

fn alternatives(near: &[String]) -> String {
    if near.is_empty() { String::new() } else { format!("; did you mean {}?", near.join(" or ")) }
}
