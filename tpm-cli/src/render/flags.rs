//! Remedies and settings of the libraries as flags of this command line.

use tpm_runtime::experiment::ExperimentError;
use tpm_runtime::log::{Adjustment, LogError};
use tpm_runtime::machine::actuator::FileFault;
use tpm_runtime::report::{Remedy, number};
use tpm_runtime::session::{SessionError, Setting};

/// The flag for a remedy, as text that stands in brackets behind a message.
pub(crate) fn remedy(remedy: &Remedy) -> Option<String> {
    Some(match remedy {
        Remedy::MapColumn { signal } => format!("--map {signal}=COLUMN"),
        Remedy::Scale { signal } => format!("--scale {signal}=FACTOR"),
        Remedy::PeriodAndStart => "--period SECONDS, --from-sample N".to_owned(),
        Remedy::Period => "--period SECONDS".to_owned(),
        Remedy::FromSample => "--from-sample N".to_owned(),
        Remedy::Hold { hold } => format!("--hold {hold}"),
        Remedy::InputDelay { input, nanoseconds } => format!("--delay {input}={}", number(*nanoseconds as f64 * 1e-9)),
        Remedy::TimeDomain => "--domain time uses every sample instead".to_owned(),
        Remedy::HarmonicsOfOneStretch => "--domain harmonics uses the longest stretch that repeats instead".to_owned(),
        Remedy::Harmonics { highest } => format!("--harmonics {highest} takes them in"),
        Remedy::Simulation => "--refine output-error does it all the same".to_owned(),
        Remedy::DrivenCoordinate { input } => format!("--motion {input}=COORDINATE"),
        Remedy::Stopped => "--stopped".to_owned(),
        Remedy::HoldParameter { parameter } => format!("--freeze {parameter}=VALUE"),
        Remedy::Constants { names } => {
            names.iter().map(|name| format!("--constant {name}=VALUE")).collect::<Vec<_>>().join(" ")
        }
        _ => return None,
    })
}

/// A message with the flag that would help.
fn with(message: &str, found: Option<Remedy>) -> String {
    match found.as_ref().and_then(remedy) {
        Some(flag) => format!("{message} ({flag})"),
        None => message.to_owned(),
    }
}

/// The message of a log's fault, with the flag that caused it or would help.
pub(crate) fn log_error(error: &LogError) -> String {
    let flag = |adjustment: Adjustment| match adjustment {
        Adjustment::Column => "--map",
        Adjustment::Scale => "--scale",
        Adjustment::Offset => "--offset",
    };
    match error {
        LogError::UnknownName { adjustment, .. }
        | LogError::UnknownColumn { adjustment, .. }
        | LogError::Unusable { adjustment, .. } => {
            format!("{}: {error}", flag(*adjustment))
        }
        other => with(&other.to_string(), other.remedy()),
    }
}

/// The message of a fault in a motor file, with the flag that would help.
pub(crate) fn file_fault(fault: &FileFault) -> String {
    with(&fault.to_string(), fault.remedy.clone())
}

/// The message of an experiment's fault, with the flag that caused it.
pub(crate) fn experiment_error(error: &ExperimentError) -> String {
    match error {
        ExperimentError::Override { .. } => format!("--set {error}"),
        other => other.to_string(),
    }
}

/// The message of a session's fault, with the flag that caused it or would help.
pub(crate) fn error(error: &SessionError) -> String {
    match error {
        SessionError::Log(error) => log_error(error),
        SessionError::Experiment(error) => experiment_error(error),
        SessionError::UnknownName { setting, name, .. } | SessionError::OutsideInterval { setting, name, .. } => {
            let flag = match setting {
                Setting::Prior => "--prior",
                Setting::Frozen => "--freeze",
                Setting::Constant => "--constant",
                Setting::Actuator => "--delay or --low-pass",
                _ => "",
            };
            format!("{flag} {name}=...: {}", message_behind(&error.to_string()))
        }
        SessionError::ParameterAsConstant { name } => {
            with(&format!("--constant {name}=...: {}", message_behind(&error.to_string())), error.remedy())
        }
        SessionError::NothingLumped { name } => {
            format!("--bound {name}=...: {}", message_behind(&error.to_string()))
        }
        SessionError::NoExperiment { .. } => format!("{error} with --experiment FILE"),
        SessionError::NoCampaign { path } => format!("{error}; begin one with `tpm campaign start MODEL {path}`"),
        other => with(&other.to_string(), other.remedy()),
    }
}

/// The message without the leading setting and name.
fn message_behind(message: &str) -> &str {
    message.split_once(": ").map_or(message, |(_, rest)| rest)
}
