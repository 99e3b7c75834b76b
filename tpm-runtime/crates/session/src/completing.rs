//! The text of a model with the forces that it lacks.

use crate::identification::Identification;
use crate::model::DeclaredModel;
use tpm_codegen::language::complete::{AddedForce, AddedLoads, CannotAdd, with_forces};
use tpm_numerics::singular::Singular;
use tpm_numerics::{DMatrix, DVector, tolerance};
use tpm_symbolic::mechanics::tree::mechanism::{Label, parameter_name};
use tpm_symbolic::mechanics::tree::{Body, Inertia, NAMES};
use tpm_symbolic::regressor::parameter_map::ParameterMap;

/// Share of the largest inertia below which one is a rounding of zero.
const ROUNDED: f64 = 1e-9;

/// The text of a model with the forces that it lacks on the logs of a result; nothing where none make it better.
///
/// # Errors
/// [`CannotAdd`].
pub(super) fn completed_text(declared: &DeclaredModel, result: &Identification) -> Result<Option<String>, CannotAdd> {
    let pooled = result.pool.iter().flat_map(|pool| &pool.logs).map(|part| &part.log);
    let mut forces: Vec<AddedForce> = Vec::new();
    let mut loads = AddedLoads::default();
    for log in result.log.iter().chain(pooled) {
        let Some(completed) = log.prediction().and_then(|own| own.completed.as_ref()) else { continue };
        for force in &completed.added {
            if !forces.iter().any(|own| own.is_like(force)) {
                forces.push(force.clone());
            }
        }
        for drive in &completed.loaded {
            if !loads.drives.contains(drive) {
                loads.drives.push(drive.clone());
            }
        }
        if !loads.drives.is_empty() && loads.near.is_empty() {
            loads.near = inertias(declared, &completed.forces.values);
        }
    }
    if forces.is_empty() && loads.drives.is_empty() {
        return Ok(None);
    }
    with_forces(declared.text(), &forces, &loads).map(Some)
}

/// Ten parameters of the inertia of every body of a mechanism which together have these values of the model's parameters. Which of all that
/// have them does not matter: they make the same load.
fn inertias(declared: &DeclaredModel, values: &[f64]) -> Vec<(String, Vec<f64>)> {
    let Some(mechanism) = &declared.parsed().mechanism else { return Vec::new() };
    let map = ParameterMap::new(declared.prepared());
    let known = map.evaluate(|_| 0.0);
    let columns = map.parameters().iter().map(|&symbol| {
        let with = map.evaluate(|own| f64::from(u8::from(own == symbol)));
        DVector::from_iterator(known.len(), with.iter().zip(&known).map(|(with, known)| with - known))
    });
    let matrix = DMatrix::from_columns(&columns.collect::<Vec<_>>());
    let wanted = DVector::from_iterator(known.len(), values.iter().zip(&known).map(|(value, known)| value - known));
    let singular = Singular::new(&matrix, tolerance::RANK);
    let along = singular.left.tr_mul(&wanted).component_div(&singular.values);
    let found = &singular.right * along;
    let least = ROUNDED * found.amax();
    let found = found.map(|value| if value.abs() > least { value } else { 0.0 });
    let names: Vec<&str> = map.parameters().iter().map(|&symbol| map.name(symbol)).collect();
    let of_body = |label: &Label| {
        let value = |own: &str| {
            let name = parameter_name(own, &label.name);
            names.iter().position(|other| *other == name).map_or(0.0, |at| found[at])
        };
        (label.name.clone(), NAMES.map(value).to_vec())
    };
    let unknown = |(body, _): &(&Body, &Label)| matches!(body.inertia, Inertia::Unknown);
    mechanism.tree.bodies().iter().zip(&mechanism.labels).filter(unknown).map(|(_, label)| of_body(label)).collect()
}
