//! A model as a machine: its own equations for plant, reference and feed-forward, and the form that is identified.
//!
//! Invariant: the plant's parameters are those of the model's own equations. With coordinates eliminated they are the
//! physical parameters behind the lumped ones, and the estimator gives them.

use crate::campaign::Store;
use crate::campaign::{Campaign, RunReport, Setup};
use crate::estimate::physical::PhysicalSettings;
use crate::estimate::{Eliminated, EliminatedError, Method, Weights};
use crate::experiment::{Equations, Experiment, ExperimentError, StageSection};
use crate::interpret::Interpreted;
use crate::run::trajectory::{Pattern, PatternError};
use crate::session::simulated::{CampaignIdentification, Watch, play_campaign};
use std::collections::BTreeMap;
use std::string::String;
use std::sync::Arc;
use std::vec;
use std::vec::Vec;
use tpm_core::model::Model as _;
use tpm_symbolic::regressor::prepare::{PrepareError, Prepared, prepare};

/// Why a model is no machine.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MachineError {
    /// Its own equations have no regressor form.
    #[error("before coordinates are eliminated: {0}")]
    Own(#[from] PrepareError),
    /// The eliminated form does not fit.
    #[error(transparent)]
    Eliminated(#[from] EliminatedError),
    /// The pattern cannot be played.
    #[error(transparent)]
    Pattern(#[from] PatternError),
}

/// A model as a machine.
#[derive(Clone, Debug)]
pub struct Machine {
    plant: Interpreted,
    pattern: Pattern,
    eliminated: Option<Arc<Eliminated>>,
}

impl Machine {
    /// The machine of a model that moves along one of its patterns, with the experiment's constants and prior. `bounds`
    /// are those of physical parameters behind lumped ones.
    ///
    /// # Errors
    /// [`MachineError`].
    pub fn new(
        prepared: &Prepared,
        pattern: &tpm_symbolic::mechanics::pattern::Pattern,
        experiment: &Experiment,
        bounds: &BTreeMap<String, (f64, f64)>,
    ) -> Result<Self, MachineError> {
        let own;
        let whole = if prepared.model.eliminations.is_empty() {
            prepared
        } else {
            let mut model = prepared.model.clone();
            model.eliminations.clear();
            own = prepare(model)?;
            &own
        };
        let plant = Interpreted::new(&whole.model, &whole.form);
        let constant = |name: &str| experiment.constants.get(name).copied();
        let of_rows = |pattern| Pattern::of_rows(pattern, &whole.model, &whole.form, constant);
        let mut others = Vec::new();
        for other in prepared.model.patterns.iter().filter(|other| other.name.is_some() && other.name != pattern.name) {
            let named = |stage: &StageSection| stage.pattern.as_deref() == other.name.as_deref();
            match of_rows(other) {
                Ok(other) => others.push(other),
                Err(fault) if experiment.schedule.stages.iter().any(named) => return Err(fault.into()),
                // It needs a value that this experiment does not state, and is not played.
                Err(_) => {}
            }
        }
        let pattern = Pattern { others, ..of_rows(pattern)? };
        let eliminated = if prepared.model.eliminations.is_empty() {
            None
        } else {
            let settings = PhysicalSettings {
                prior: experiment.prior.clone(),
                frozen: experiment.frozen.clone(),
                bounds: bounds.clone(),
                constants: experiment.constants.clone(),
            };
            Some(Arc::new(Eliminated::new(prepared, &plant, &settings)?))
        };
        Ok(Machine { plant, pattern, eliminated })
    }

    /// The machine's own equations.
    #[must_use]
    pub const fn plant(&self) -> &Interpreted {
        &self.plant
    }

    /// Its motion; coordinates that the model's pattern leaves open are open.
    #[must_use]
    pub const fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// The form with coordinates eliminated, when there is one.
    #[must_use]
    pub fn eliminated(&self) -> Option<&Eliminated> {
        self.eliminated.as_deref()
    }

    /// A campaign on this machine.
    ///
    /// # Errors
    /// [`ExperimentError`].
    pub fn campaign(&self, experiment: &Experiment, setup: Setup) -> Result<Campaign<'_>, ExperimentError> {
        let campaign = match &self.eliminated {
            Some(form) if setup.method == Method::MeasuredMotion && experiment.equations == Equations::Eliminated => {
                if setup.estimation.weights == Weights::Equal {
                    return Err(ExperimentError::Weights);
                }
                let estimator = form.estimator(&setup.estimation);
                Campaign::with_estimator(&self.plant, setup, estimator)
            }
            _ => Campaign::new(&self.plant, setup),
        };
        Ok(campaign?)
    }
}
