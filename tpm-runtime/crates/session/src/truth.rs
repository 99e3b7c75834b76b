//! True values of a simulated machine's parameters, beside which a result of its runs can be judged.
//!
//! Invariant: only results of simulated machines have true values. A value is given where the simulated machine has a parameter
//! of that name, or where all physical parameters behind a lumped one are its own; a parameter that drifts has none.

use crate::identification::Identification;
use std::collections::BTreeMap;
use tpm_experiment::Experiment;
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::Prepared;

/// True values by the names of parameters.
pub(super) struct Truth(BTreeMap<String, f64>);

impl Truth {
    /// The values that an experiment states of its simulated machine; none where that machine does not obey the model.
    pub(super) fn stated(experiment: &Experiment) -> Self {
        let plant = &experiment.plant;
        if plant.closed_loop_arm.is_some() {
            return Self(BTreeMap::new());
        }
        let fixed = plant.parameters.iter().filter(|(name, _)| !plant.drift.contains_key(*name));
        Self(fixed.map(|(name, value)| (name.clone(), *value)).collect())
    }

    /// The stated values, and those of the lumped parameters of a model that follow from them.
    pub(super) fn of_model(experiment: &Experiment, prepared: &Prepared) -> Self {
        let Self(mut values) = Self::stated(experiment);
        if values.is_empty() {
            return Self(values);
        }
        let map = ParameterMap::new(prepared);
        let known = |symbol| {
            let name = prepared.model.quantity(symbol).name.as_str();
            values.get(name).or_else(|| experiment.constants.get(name)).copied().unwrap_or(f64::NAN)
        };
        let lumped = map.evaluate(known);
        for (column, value) in map.columns().iter().zip(lumped) {
            if value.is_finite() {
                values.entry(column.to_string()).or_insert(value);
            }
        }
        Self(values)
    }

    /// Puts the true values beside the identified ones.
    pub(super) fn complete(&self, result: &mut Identification) {
        for parameter in result.parameters.iter_mut().chain(&mut result.physical) {
            parameter.truth = self.0.get(&parameter.name).copied();
        }
        for shown in &mut result.combinations {
            let part = |(name, weight): (&String, &String)| Some(weight.parse::<f64>().ok()? * self.0.get(name)?);
            shown.truth = shown.terms.iter().map(part).sum();
        }
    }
}
