//! A result on standard output, or in a file.

use crate::failure::Failure;
use crate::output::file;
use crate::render::flags;
use std::path::Path;
use tpm_runtime::session::Identification;

/// Prints a result, as text or as JSON.
pub(crate) fn print(result: &Identification, json: bool, target: Option<&Path>) -> Result<(), Failure> {
    file::emit(target, &if json { file::json(result)? } else { result.text(&flags::remedy) })
}
