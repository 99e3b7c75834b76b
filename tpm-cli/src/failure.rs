//! Why a command did not succeed, and the exit code that says so.

use crate::output::terminal;
use crate::render::flags;
use std::path::{Path, PathBuf};
use thiserror::Error;
use tpm_codegen::diagnostic::with_short_numbers;
use tpm_runtime::log::LogError;
use tpm_runtime::session::LogFault;
use tpm_runtime::session::{ModelFault, SessionError};
use tpm_symbolic::budget::Halted;

/// What a command gives back: success, or a failure with its exit code.
pub(crate) type Outcome = Result<(), Failure>;

/// A failure of a command.
#[derive(Debug, Error)]
pub(crate) enum Failure {
    /// Diagnostics of a model, already rendered with their places.
    #[error("{0}")]
    Model(String),
    /// A file could not be read.
    #[error("error: cannot read {path}: {source}{help}", path = path.display(), help = help(path, source))]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file could not be written; no partial file was left behind.
    #[error("error: cannot write {path}: {source}; no partial file was left{help}", path = path.display(), help = write_help(source))]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Anything else that is wrong with the input.
    #[error("error: {0}")]
    Input(String),
    /// The result was printed, but it is not complete.
    #[error("{0}")]
    Incomplete(String),
    /// The user interrupted the command.
    #[error("interrupted")]
    Interrupted,
}

/// What helps where a file is not there.
fn help(path: &Path, source: &std::io::Error) -> &'static str {
    match source.kind() {
        std::io::ErrorKind::NotFound if path.extension().is_some_and(|own| own == "tpm") => {
            "; type the path of a file that is there (`tpm init NAME` writes a first model)"
        }
        std::io::ErrorKind::NotFound => "; type the path of a file that is there",
        std::io::ErrorKind::IsADirectory => "; type the path of a file in it",
        _ => "",
    }
}

/// What helps where a file cannot be written.
fn write_help(source: &std::io::Error) -> &'static str {
    match source.kind() {
        std::io::ErrorKind::IsADirectory => "; type the name of a file, not that of a folder",
        std::io::ErrorKind::NotFound => "; type a path in a folder that is there",
        std::io::ErrorKind::AlreadyExists | std::io::ErrorKind::NotADirectory => {
            "; a file is in the way of a folder: type another path"
        }
        std::io::ErrorKind::PermissionDenied | std::io::ErrorKind::ReadOnlyFilesystem => {
            "; type a path where you may write"
        }
        std::io::ErrorKind::FileTooLarge => "; raise the limit of the size of files (ulimit -f), or write less",
        _ => "",
    }
}

impl Failure {
    /// The failure of reading a file.
    pub(crate) fn read(path: &Path, source: std::io::Error) -> Self {
        Self::Read { path: path.to_owned(), source }
    }

    /// The failure of writing a file.
    pub(crate) fn write(path: &Path, source: std::io::Error) -> Self {
        // A message about a temporary file beside the result would name a path that nobody typed.
        let kind = source.kind();
        let source = match path.parent() {
            Some(folder)
                if kind == std::io::ErrorKind::NotFound && !folder.as_os_str().is_empty() && !folder.exists() =>
            {
                std::io::Error::new(kind, format!("there is no folder {}", folder.display()))
            }
            _ => source,
        };
        Self::Write { path: path.to_owned(), source }
    }

    /// The process's exit code.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::Model(_) | Self::Read { .. } | Self::Write { .. } | Self::Input(_) => 2,
            Self::Incomplete(_) => 1,
            Self::Interrupted => 130,
        }
    }

    /// Prints the message to standard error. A closed standard error is no reason to fail differently.
    pub(crate) fn report(&self) {
        terminal::tell(&with_short_numbers(self.to_string().trim_end()));
    }
}

impl From<ModelFault> for Failure {
    fn from(fault: ModelFault) -> Self {
        match fault {
            ModelFault::Read { path, source } => Self::read(Path::new(&path), source),
            ModelFault::Text { diagnostics } => Self::Model(diagnostics),
            other => Self::Input(other.to_string()),
        }
    }
}

/// A run of the engine that ended, with the flag that would help.
impl From<Halted> for Failure {
    fn from(halted: Halted) -> Self {
        match halted {
            Halted::Stopped => Self::Interrupted,
            other => Self::Input(format!("{other}: --allow-large")),
        }
    }
}

/// The failure of a session, with the flag that would help.
impl From<SessionError> for Failure {
    fn from(error: SessionError) -> Self {
        match error {
            SessionError::Model(fault) => fault.into(),
            SessionError::Read { path, source }
            | SessionError::Log(LogFault::Reading(LogError::Io { path, source })) => {
                Self::read(Path::new(&path), source)
            }
            other => Self::Input(flags::error(&other)),
        }
    }
}
