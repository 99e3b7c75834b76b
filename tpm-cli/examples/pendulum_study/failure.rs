//! Why the study could not be made.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// A fault of what the study was given, or of what it found.
#[derive(Debug, Error)]
pub(super) enum Failure {
    /// Diagnostics of a model, rendered with their places.
    #[error("{0}")]
    Model(String),
    /// A file could not be read.
    #[error("error: cannot read {path}: {source}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file could not be written.
    #[error("error: cannot write {path}: {source}", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Anything else that is wrong with what was given.
    #[error("error: {0}")]
    Input(String),
    /// The report was written, but not every identification or balance succeeded.
    #[error("{0}")]
    Incomplete(String),
}

impl Failure {
    /// A file that could not be written.
    pub(super) fn write(path: &Path, source: std::io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    /// The process's exit code: 1 for an incomplete study, 2 for bad input.
    pub(super) const fn exit_code(&self) -> u8 {
        match self {
            Self::Incomplete(_) => 1,
            Self::Model(_) | Self::Read { .. } | Self::Write { .. } | Self::Input(_) => 2,
        }
    }
}
