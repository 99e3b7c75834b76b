//! Output of an identification.

use crate::failure::Failure;
use crate::output::file;
use crate::render::flags;
use std::path::Path;
use tpm_runtime::session::Identification;

/// Prints an identification as text or JSON, to a file or to standard output.
pub(crate) fn print(result: &Identification, json: bool, target: Option<&Path>) -> Result<(), Failure> {
    file::emit(target, &if json { file::json(result)? } else { result.text(&flags::remedy) })
}
