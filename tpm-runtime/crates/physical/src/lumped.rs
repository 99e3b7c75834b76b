//! Experiments written in physical parameters, for models whose parameters were lumped.
//!
//! Invariant: a lumped parameter that the experiment names keeps its given value. Any other lumped parameter is
//! computed from its physical parameters when values of all of them are given, and has no value otherwise.

use crate::physical::is_lumped;
use std::collections::BTreeSet;
use tpm_experiment::{Experiment, Named};
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::Prepared;

/// The experiment in the parameters in which the model is linear: true values and priors of physical parameters are
/// converted to those of the lumped parameters. Frozen values and priors of physical parameters are removed from the
/// experiment; [`physical`](crate::physical::physical) uses them.
#[must_use]
pub fn lumped(written: &Experiment, prepared: &Prepared) -> Experiment {
    let mut experiment = written.clone();
    // The plant of a model with eliminated coordinates obeys the equations before the elimination, in physical
    // parameters.
    if !is_lumped(prepared) || !prepared.model.eliminations.is_empty() {
        return experiment;
    }
    let map = ParameterMap::new(prepared);
    let columns: BTreeSet<&str> = map.columns().iter().map(String::as_str).collect();
    let physical: BTreeSet<&str> =
        map.parameters().iter().map(|&symbol| map.name(symbol)).filter(|name| !columns.contains(name)).collect();
    let translate = |given: &mut Named| {
        let value = |symbol| {
            let name = prepared.model.quantity(symbol).name.as_str();
            given.get(name).or_else(|| written.constants.get(name)).copied().unwrap_or(f64::NAN)
        };
        for (column, value) in map.columns().iter().zip(map.evaluate(value)) {
            if value.is_finite() && !given.contains_key(column) {
                given.insert(column.to_string(), value);
            }
        }
        given.retain(|name, _| !physical.contains(name.as_str()));
    };
    translate(&mut experiment.plant.parameters);
    translate(&mut experiment.prior);
    experiment.frozen.retain(|name, _| !physical.contains(name.as_str()));
    experiment
}
