//! What the references of a campaign's runs show of the parameters, whatever is measured.
//!
//! Invariant: a direction that changes no row of the model along any reference is hidden, and no estimator moves along it. It cannot be
//! read from data, since noise makes any equations look as if they determined every parameter.

use crate::along::Along;
use crate::error::EstimateError;
use crate::information::Information;
use crate::run::reach;
use crate::settings::Settings;
use tpm_controller::model::Model;
use tpm_motion::Trial;
use tpm_motion::trajectory::Trajectory;

/// What each of several references shows.
#[derive(Default)]
pub(super) struct Designs {
    runs: Vec<Information>,
    /// The number of the model's parameters.
    parameters: usize,
}

impl Designs {
    /// Adds a reference.
    ///
    /// # Errors
    /// [`EstimateError`] when the rows cannot be evaluated along it, or all parameters are held.
    pub(super) fn push(
        &mut self,
        model: &dyn Model<f64>,
        constants: &[f64],
        motion: &Trajectory,
        settings: &Settings,
    ) -> Result<(), EstimateError> {
        self.parameters = model.dims().parameters;
        let free = settings.free(self.parameters)?;
        self.runs.push(Along::design(model, constants, motion, reach(motion).max(1), &free.indices)?);
        Ok(())
    }

    /// Adds the reference of a trial, and gives the settings with the directions that no reference shows so far.
    ///
    /// # Errors
    /// Those of [`push`](Self::push).
    pub(super) fn take(
        &mut self,
        model: &dyn Model<f64>,
        trial: &Trial,
        settings: &Settings,
    ) -> Result<Settings, EstimateError> {
        self.push(model, &trial.constants, &trial.trajectory, settings)?;
        self.hidden(settings, |_| true)
    }

    /// Number of references.
    pub(super) fn len(&self) -> usize {
        self.runs.len()
    }

    /// Keeps the first references.
    pub(super) fn truncate(&mut self, count: usize) {
        self.runs.truncate(count);
    }

    /// Settings with the directions that some of the references do not show together.
    ///
    /// # Errors
    /// [`EstimateError`] when parameters are held that do not exist, or all.
    pub(super) fn hidden(&self, settings: &Settings, runs: impl Fn(usize) -> bool) -> Result<Settings, EstimateError> {
        let free = settings.free(self.parameters)?;
        let shown = self.runs.iter().enumerate().filter(|(run, _)| runs(*run)).map(|(_, own)| own.clone());
        let whole = shown.reduce(|whole, own| whole.pool(&own));
        let found = whole.map_or_else(Vec::new, |whole| whole.solve(&vec![0.0; free.indices.len()], None).unobservable);
        let hidden = found.iter().map(|direction| free.spread(direction)).collect();
        Ok(Settings { hidden, ..settings.clone() })
    }
}
