//! Whether an estimator has a meaning for a campaign, before anything moves.

use crate::estimate::error::EstimateError;
use crate::run::Trial;
use std::string::String;
use std::vec;
use std::vec::Vec;
use tpm_core::model::Model;

/// Rows without an input along the reference of a trial.
fn rows_without_input(model: &dyn Model<f64>, trial: &Trial) -> Result<Vec<usize>, EstimateError> {
    let dims = model.dims();
    let mut driven = vec![false; dims.rows];
    let mut map = vec![0.0; dims.input_map_len()];
    let mut scratch = vec![0.0; model.workspace_len()];
    for motion in trial.reference.chunks_exact(dims.motion_len()) {
        model.input_map(motion, &trial.constants, &mut scratch, &mut map)?;
        for (driven, row) in driven.iter_mut().zip(map.chunks_exact(dims.inputs.max(1))) {
            *driven |= row.iter().any(|factor| factor.abs() > 0.0);
        }
    }
    Ok((0..dims.rows).filter(|&row| !driven[row]).collect())
}

/// An estimator from the feedback's effort needs an input in every row.
///
/// # Errors
/// [`EstimateError::NoEffort`] when a row has none.
pub(super) fn check_inputs(model: &dyn Model<f64>, first: &Trial) -> Result<(), EstimateError> {
    let rows: Vec<String> =
        rows_without_input(model, first)?.into_iter().map(|row| model.row(row).name.into()).collect();
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
