//! The model with the terms that it lacks, identified from the same logs.

use crate::completing::completed_text;
use crate::error::SessionError;
use crate::identification::Identification;
use crate::lines_log::is_told_by_lines;
use crate::log::{LogRequest, from_logs};
use crate::model::{DeclaredModel, Identifiable, ModelFault};
use tpm_codegen::source::Source;
use tpm_estimate::Weights;

/// The model with the forces that it lacks on some logs, identified from the same logs; nothing where it lacks none that make it better on
/// parts of a log that it was not taken from. Where the lines of the rows tell its parameters they are those with which it is nearest to the
/// forces: what it still lacks takes no part in what it predicts.
///
/// # Errors
/// [`ModelFault::NoText`] of a model without a text, [`SessionError::Completing`] where the forces cannot be written into it; otherwise as
/// [`from_logs`].
pub fn completed(
    model: &impl Identifiable,
    mut requests: Vec<LogRequest>,
    result: &Identification,
) -> Result<Option<(DeclaredModel, Identification)>, SessionError> {
    let declared =
        (model.declaration()?).ok_or_else(|| ModelFault::NoText { name: model.evaluated().name().to_string() })?;
    let Some(text) = completed_text(&declared, result).map_err(SessionError::Completing)? else { return Ok(None) };
    let whole = DeclaredModel::of_source(Source::new(declared.text().name(), text))?;
    if is_told_by_lines(whole.evaluated().dims()) {
        requests.iter_mut().for_each(|request| request.estimation.weights = Weights::Equal);
    }
    let found = from_logs(&whole, requests)?;
    Ok(Some((whole, found)))
}
