//! Output of an identification.

use crate::failure::Failure;
use crate::output::file;
use crate::render::flags;
use crate::render::method::{Style, tables};
use std::path::Path;
use tpm_runtime::session::Identification;

/// Prints an identification as text or JSON, to a file or to standard output.
pub(crate) fn print(result: &Identification, json: bool, target: Option<&Path>) -> Result<(), Failure> {
    print_with_method(result, json, Style::Text, target)
}

/// Prints an identification with its report of the method, where it has one; `style` is that of the report's tables in text.
pub(crate) fn print_with_method(
    result: &Identification,
    json: bool,
    style: Style,
    target: Option<&Path>,
) -> Result<(), Failure> {
    if json {
        return file::emit(target, &file::json(result)?);
    }
    let method = result.method.as_ref().map(|report| tables(report, style)).unwrap_or_default();
    file::emit(target, &(result.text(&flags::remedy) + &method))
}
