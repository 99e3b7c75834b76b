//! Whether an estimator has a meaning for a campaign, before anything moves.

use crate::error::EstimateError;
use tpm_controller::model::Model;
use tpm_motion::{Driven, Trial};

/// An estimator from the feedback's effort needs an input in every row.
///
/// # Errors
/// [`EstimateError::NoEffort`] when a row has none.
pub(super) fn check_inputs(model: &dyn Model<f64>, first: &Trial) -> Result<(), EstimateError> {
    let mut driven = Driven::new(model);
    for motion in first.reference.chunks_exact(model.dims().motion_len()) {
        driven.see(model, motion, &first.constants)?;
    }
    let rows: Vec<String> = driven.without_input().into_iter().map(|row| model.row(row).name.into()).collect();
    if rows.is_empty() { Ok(()) } else { Err(EstimateError::NoEffort { rows }) }
}

/// An estimator that is linearised about the reference needs a reference in which every coordinate moves.
///
/// # Errors
/// [`EstimateError::NoReference`] when the first estimates leave open coordinates at rest.
pub(super) fn check_reference(
    model: &dyn Model<f64>,
    first: &Trial,
    estimator: &'static str,
) -> Result<(), EstimateError> {
    let rests = |&&c: &&usize| first.trajectory.coordinates[c].highest_harmonic() == 0;
    let coordinates: Vec<String> = first.open.iter().filter(rests).map(|&c| model.coordinate(c).name.into()).collect();
    if coordinates.is_empty() { Ok(()) } else { Err(EstimateError::NoReference { estimator, coordinates }) }
}

/// A matrix by differences needs a run for every unknown, and one to compare them with.
///
/// # Errors
/// [`EstimateError::FewRuns`] when the campaign has fewer.
pub(super) const fn check_runs(needed: usize, given: usize) -> Result<(), EstimateError> {
    if given >= needed { Ok(()) } else { Err(EstimateError::FewRuns { needed, given }) }
}
