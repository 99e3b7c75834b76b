//! Faults in the words of a front end: which of its options caused one, and which would help.

use crate::error::{SessionError, Setting};
use crate::log_fault::LogFault;
use tpm_experiment::ExperimentError;
use tpm_log::{Adjustment, LogError};
use tpm_report::Remedy;

/// Something that a user gives, which a fault may be about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Given {
    /// The column of a signal.
    Column,
    /// The factor of a column.
    Scale,
    /// What is added to a column.
    Offset,
    /// A changed value of an experiment.
    Change,
    /// A value known before, a held value, a constant, or known dynamics behind an input.
    Setting(Setting),
    /// Bounds of a physical parameter.
    Bound,
}

/// The words of a front end. The library says what is wrong and what would help; a front end knows what its user types.
pub trait Spelling {
    /// What the user gives to follow a remedy; nothing where the front end has no option for it.
    fn remedy(&self, remedy: &Remedy) -> Option<String>;

    /// What the user gave, by its name in the front end; with the name of the model's quantity that it was given for, if it is about one.
    fn given(&self, given: Given, name: Option<&str>) -> String;

    /// A message, with what the user gives to follow a remedy behind it.
    fn with(&self, message: &str, found: Option<&Remedy>) -> String {
        match found.and_then(|remedy| self.remedy(remedy)) {
            Some(words) => format!("{message} ({words})"),
            None => message.to_string(),
        }
    }

    /// The fault of a log.
    fn log_error(&self, error: &LogError) -> String {
        let given = match error {
            LogError::UnknownName { adjustment, .. }
            | LogError::UnknownColumn { adjustment, .. }
            | LogError::Unusable { adjustment, .. } => match adjustment {
                Adjustment::Column => Given::Column,
                Adjustment::Scale => Given::Scale,
                Adjustment::Offset => Given::Offset,
            },
            other => return self.with(&other.to_string(), other.remedy().as_ref()),
        };
        format!("{}: {error}", self.given(given, None))
    }

    /// The fault of an experiment.
    fn experiment_error(&self, error: &ExperimentError) -> String {
        match error {
            ExperimentError::Override { .. } => format!("{} {error}", self.given(Given::Change, None)),
            other => other.to_string(),
        }
    }

    /// The fault of a session.
    fn session_error(&self, error: &SessionError) -> String {
        let (given, name) = match error {
            SessionError::Log(LogFault::Reading(error)) => return self.log_error(error),
            SessionError::Log(fault) => return self.with(&fault.to_string(), fault.remedy().as_ref()),
            SessionError::Experiment(error) => return self.experiment_error(error),
            SessionError::InExperiment { place, source } => return format!("{place}: {}", self.session_error(source)),
            SessionError::UnknownName { setting, name, .. } | SessionError::OutsideInterval { setting, name, .. } => {
                (Given::Setting(*setting), name)
            }
            SessionError::ParameterAsConstant { name } => (Given::Setting(Setting::Constant), name),
            SessionError::NothingLumped { name } => (Given::Bound, name),
            other => return self.with(&other.to_string(), other.remedy().as_ref()),
        };
        let message = error.to_string();
        // What stands before the colon are the library's words for what was given.
        let behind = message.split_once(": ").map_or(message.as_str(), |(_, behind)| behind);
        self.with(&format!("{}: {behind}", self.given(given, Some(name))), error.remedy().as_ref())
    }
}
