//! Why a session cannot identify anything.

use crate::log_fault::LogFault;
use crate::model::ModelFault;
use std::fmt;
use tpm_campaign::{CampaignError, StoreError, WireError};
use tpm_codegen::language::complete::CannotAdd;
use tpm_estimate::EstimateError;
use tpm_experiment::ExperimentError;
use tpm_log::LogError;
use tpm_motion::trajectory::PatternError;
use tpm_motion::{BenchError, RecordError};
use tpm_physical::{EliminatedError, PhysicalError};
use tpm_report::{Remedy, number};
use tpm_symbolic::regressor::prepare::PrepareError;

/// What a name was given for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Setting {
    /// A value known before.
    Prior,
    /// A value that is held.
    Frozen,
    /// The value of a constant that is known at run time.
    Constant,
    /// Known dynamics behind an input.
    Actuator,
    /// How well a sensor is calibrated.
    Calibration,
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Setting::Prior => "prior",
            Setting::Frozen => "frozen value",
            Setting::Constant => "constant",
            Setting::Actuator => "actuator",
            Setting::Calibration => "calibration",
        })
    }
}

/// Why a model is no machine.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MachineError {
    /// No sensor measures a coordinate, and a campaign follows all of them.
    #[error(
        "`{coordinate}` is unmeasured, and a campaign measures every coordinate; identify the parameters from a log, or declare it as `coordinate`"
    )]
    Unmeasured {
        /// The coordinate.
        coordinate: String,
    },
    /// Friction builds up after reversals.
    #[error(
        "`{coordinate}` is friction that builds up after a reversal, which no simulated machine has; take the model without it, logs identify and predict with it"
    )]
    BuildsUp {
        /// The coordinate that says how far it has built up.
        coordinate: String,
    },
    /// An input does not stand alone, or there is none.
    #[error("no campaign drives this model: {0}")]
    Inputs(PrepareError),
    /// Its own equations have no regressor form.
    #[error("before coordinates are eliminated: {0}")]
    Own(#[from] PrepareError),
    /// The eliminated form does not fit.
    #[error(transparent)]
    Eliminated(#[from] EliminatedError),
    /// The pattern cannot be played.
    #[error(transparent)]
    Pattern(#[from] PatternError),
}

/// Why a session cannot identify anything. [`remedy`](Self::remedy) says which setting would help.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// What a model lacks cannot be written into its text.
    #[error("what the model lacks is not written into it: {0}")]
    Completing(CannotAdd),
    /// There is no log.
    #[error("there is no log to identify from")]
    NoLog,
    /// The same log was given twice.
    #[error("{path} is the same log as {other}: what it shows would count twice; leave one of them out")]
    LogTwice {
        /// The log.
        path: String,
        /// The other one.
        other: String,
    },
    /// The model.
    #[error(transparent)]
    Model(#[from] ModelFault),
    /// The model and the experiment make no machine.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// The experiment.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The log.
    #[error(transparent)]
    Log(#[from] LogFault),
    /// The physical parameters behind lumped ones.
    #[error(transparent)]
    Physical(#[from] PhysicalError),
    /// A file that is exchanged with a machine's user.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// A file cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A fault of a file, with its place.
    #[error("{path}: {message}")]
    File {
        /// The file.
        path: String,
        /// The fault.
        message: String,
    },
    /// The experiment does not fit the model, or is no experiment.
    #[error("{place}: {source}")]
    InExperiment {
        /// The file of the experiment, and whether values were changed after it was read.
        place: String,
        /// The fault.
        source: Box<SessionError>,
    },
    /// The log of a run is no record of it.
    #[error("{path}: {source}")]
    Record {
        /// The log.
        path: String,
        /// What does not fit.
        source: RecordError,
    },
    /// A log holds the samples of a run that the campaign has already; they would count twice.
    #[error(
        "{path} holds the samples of run {run}, which the campaign has already, and a run counts once: play run {next}, and submit what is recorded then"
    )]
    SameLog {
        /// The log.
        path: String,
        /// Number of the run that has the samples, from 1.
        run: usize,
        /// Number of the run that comes next.
        next: usize,
    },
    /// A setting names something that the model does not have.
    #[error("{setting} `{name}`: the model has no such name; {}", listed(.known))]
    UnknownName {
        /// What it was given for.
        setting: Setting,
        /// The name.
        name: String,
        /// What the model has.
        known: Vec<String>,
    },
    /// A parameter was given as a constant.
    #[error(
        "constant `{name}`: this is a parameter of the model, which the log identifies; to keep it at a value, hold it there"
    )]
    ParameterAsConstant {
        /// The parameter.
        name: String,
    },
    /// A nonlinear parameter is held outside its interval.
    #[error("{setting} `{name}`: {} lies outside the interval of this nonlinear parameter, {} to {}; change one of them", number(*.value), number(.interval[0]), number(.interval[1]))]
    OutsideInterval {
        /// What the value was given for.
        setting: Setting,
        /// The parameter.
        name: String,
        /// The value.
        value: f64,
        /// Its interval.
        interval: [f64; 2],
    },
    /// A deviation of a sensor's calibration that is none.
    #[error("calibration of `{name}`: {} is no standard deviation; it is a finite number, zero or more", number(*.value))]
    Deviation {
        /// The coordinate or input.
        name: String,
        /// What was given.
        value: f64,
    },
    /// Deviations of calibrations of several logs together.
    #[error(
        "a stated calibration is an error that all logs have in common, and several logs are pooled as if their errors were independent; identify \
         each log by itself, or join them to one"
    )]
    CalibrationOfLogs,
    /// Constants without a value.
    #[error("the model has constants that are known at run time only, and no value was given for {}", .names.join(", "))]
    Constants {
        /// Their names.
        names: Vec<String>,
    },
    /// Bounds, although the model is linear in its parameters as they are.
    #[error(
        "bounds of `{name}`: the model is linear in its parameters as they are; bounds are for physical parameters behind lumped ones"
    )]
    NothingLumped {
        /// The name that was given.
        name: String,
    },
    /// There is no experiment beside the model.
    #[error("there is no experiment {path} beside the model; write one, or name another")]
    NoExperiment {
        /// Where it was looked for.
        path: String,
    },
    /// Limits alone do not say how often the machine is sampled.
    #[error(
        "how often the machine is sampled is not known, since there is no experiment beside the model: state the sample time"
    )]
    NoSampleTime,
    /// The folder holds no campaign.
    #[error("{path} holds no campaign")]
    NoCampaign {
        /// The folder.
        path: String,
    },
    /// A record came although the campaign had ended.
    #[error("the campaign has ended; no log is expected")]
    Ended,
    /// A parameter has no value.
    #[error("`{name}` was not identified, so there is nothing to predict with")]
    NotIdentified {
        /// The parameter.
        name: String,
    },
    /// The experiment has no run to play.
    #[error("the experiment has no run to play")]
    NothingToPlay,
    /// The machine behind a [`Bench`](tpm_motion::Bench) failed.
    #[error("the machine: {0}")]
    Bench(BenchError),
}

fn listed(known: &[String]) -> String {
    if known.is_empty() { "it has none".into() } else { format!("there are {}", known.join(", ")) }
}

impl From<LogError> for SessionError {
    fn from(error: LogError) -> Self {
        SessionError::Log(error.into())
    }
}

impl SessionError {
    /// The fault with the place of the experiment, where it is one of the experiment.
    pub(crate) fn in_experiment(self, place: Option<&str>) -> Self {
        let of_experiment = matches!(
            self,
            Self::Experiment(_)
                | Self::Physical(_)
                | Self::Machine(MachineError::Eliminated(EliminatedError::Physical(_)))
        );
        match place.filter(|_| of_experiment) {
            Some(place) => Self::InExperiment { place: place.into(), source: Box::new(self) },
            None => self,
        }
    }

    /// The setting that would help, when there is one.
    #[must_use]
    pub fn remedy(&self) -> Option<Remedy> {
        match self {
            SessionError::Log(error) => error.remedy(),
            SessionError::InExperiment { source, .. } => source.remedy(),
            SessionError::Record { source: RecordError::TooShort { .. }, .. } => Some(Remedy::Stopped),
            SessionError::ParameterAsConstant { name } => Some(Remedy::HoldParameter { parameter: name.clone() }),
            SessionError::NoExperiment { .. } => Some(Remedy::Experiment),
            SessionError::NoSampleTime => Some(Remedy::SampleTime),
            SessionError::NoCampaign { path } => Some(Remedy::BeginCampaign { folder: path.clone() }),
            SessionError::Constants { names } => Some(Remedy::Constants { names: names.clone() }),
            _ => None,
        }
    }
}

macro_rules! by_way_of_experiment {
    ($($error:ty),*) => {$(
        impl From<$error> for SessionError {
            fn from(error: $error) -> Self {
                SessionError::Experiment(error.into())
            }
        }
    )*};
}
by_way_of_experiment!(CampaignError, StoreError, EstimateError);
