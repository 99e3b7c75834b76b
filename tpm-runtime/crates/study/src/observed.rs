//! What the sensors of a model with unmeasured coordinates can show of its parameters.

use crate::shown::{ShownError, located, nonlinear};
use serde::Serialize;
use tpm_codegen::Parsed;
use tpm_symbolic::expr::graph::Coordinate;
use tpm_symbolic::plan::observability;
use tpm_symbolic::regressor::prepare::prepare_any;

/// What sensors show while initial states are unknown. It serialises as `tpm.observed/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Observed {
    /// Name and version of the file format.
    pub schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// Coordinates that are measured.
    pub sensors: Vec<String>,
    /// Coordinates that are not.
    pub unmeasured: Vec<String>,
    /// The parameters that the model is linear in.
    pub parameters: Vec<String>,
    /// Independent combinations of them that the sensors show.
    pub rank: usize,
    /// Parameters that the sensors show only together: one list for every direction that is not shown.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub together: Vec<Vec<String>>,
    /// Unmeasured coordinates that no sensor feels.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unfelt: Vec<String>,
    /// Nonlinear parameters, which count as constants here.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub nonlinear: Vec<String>,
}

/// What sensors of the measured coordinates of a model show of its parameters, whatever the motion is.
///
/// # Errors
/// [`ShownError`] where the model has no form that is linear in parameters, or its motion does not follow from its rows.
pub fn observed(parsed: &Parsed) -> Result<Observed, ShownError> {
    let prepared = prepare_any(parsed.model.clone()).map_err(|error| located(parsed, &error))?;
    let model = &prepared.model;
    let all = || (0..).map(Coordinate).zip(&model.coordinates);
    let measured: Vec<(Coordinate, u32)> =
        all().filter(|(_, own)| !own.unmeasured).map(|(coordinate, _)| (coordinate, 0)).collect();
    let found = observability::shown(model, &prepared.form, &measured, &[]).ok_or_else(|| {
        ShownError::Asked(
            "what the sensors show is not found exactly: the rows must be as many as the coordinates, determine their highest derivatives linearly, and have no more than 48 parameters and states"
                .into(),
        )
    })?;
    let parameters: Vec<String> = prepared.form.columns.iter().map(|column| column.name.to_string()).collect();
    let names = |unmeasured: bool| -> Vec<String> {
        all().filter(|(_, own)| own.unmeasured == unmeasured).map(|(_, own)| own.name.clone()).collect()
    };
    let together = found.together.iter().map(|columns| columns.iter().map(|&j| parameters[j].clone()).collect());
    Ok(Observed {
        schema: "tpm.observed/1",
        model: model.name.clone(),
        sensors: names(false),
        unmeasured: names(true),
        rank: found.rank,
        together: together.collect(),
        unfelt: (found.unfelt.iter())
            .map(|own| &model.coordinates[own.0 as usize])
            .filter(|own| own.unmeasured)
            .map(|own| own.name.clone())
            .collect(),
        nonlinear: nonlinear(parsed),
        parameters,
    })
}
