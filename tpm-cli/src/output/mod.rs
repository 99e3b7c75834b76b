//! Where results go: standard output, files that are written whole or not at all, figures, progress.

pub(crate) mod file;
pub(crate) mod picture;
pub(crate) mod progress;
pub(crate) mod recording;
pub(crate) mod report;
pub(crate) mod terminal;

use crate::failure::{Failure, Outcome};
use std::io::ErrorKind;
use std::path::Path;

/// What can be said of the places of results before anything is computed, which may take hours: the file of `--output` is no folder and
/// lies in one, and the folder of `--report` is no file.
pub(crate) fn writable(output: Option<&Path>, report: Option<&Path>) -> Outcome {
    if let Some(path) = file::named(output) {
        if path.is_dir() {
            return Err(Failure::write(path, ErrorKind::IsADirectory.into()));
        }
        if path.parent().is_some_and(|folder| !folder.as_os_str().is_empty() && !folder.exists()) {
            return Err(Failure::write(path, ErrorKind::NotFound.into()));
        }
    }
    match report {
        Some(path) if path.exists() && !path.is_dir() => Err(Failure::Input(format!(
            "--report {}: this is a file; type the name of a folder, which is made where there is none",
            path.display()
        ))),
        _ => Ok(()),
    }
}
