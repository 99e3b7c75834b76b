//! `error`, `effort` and `hill` over all runs of a campaign.

use crate::estimate::along::Along;
use crate::estimate::designs::Designs;
use crate::estimate::error::EstimateError;
use crate::estimate::estimator::Estimator;
use crate::estimate::first_order::reduce::{FirstOrder, Reduced};
use crate::estimate::noise::noise_along;
use crate::estimate::pool::{Pool, Pools, pool_run};
use crate::estimate::result::Estimate;
use crate::estimate::run::Run;
use crate::estimate::settings::Settings;
use crate::estimate::table::LineTable;
use crate::run::Trial;
use crate::run::trajectory::Trajectory;
use std::sync::Arc;
use std::vec::Vec;
use tpm_core::model::Model;

/// One of the estimators `error`, `effort` and `hill`, over all runs.
pub(in crate::estimate) struct Linearised {
    kind: FirstOrder,
    /// Nothing moves along the directions that are hidden here, those that no reference shows so far.
    settings: Settings,
    designs: Designs,
    table: Option<Arc<dyn LineTable>>,
    pools: Pools,
    /// The last run, reduced.
    last: Option<Reduced>,
    /// The rows along the reference of the last run, which is often that of the next run too.
    reference: Option<Reference>,
    harmonics: usize,
}

impl Linearised {
    /// The estimator before any run.
    pub(in crate::estimate) fn new(kind: FirstOrder, settings: &Settings, table: Option<Arc<dyn LineTable>>) -> Self {
        let (settings, pools, designs) = (settings.clone(), Pools::default(), Designs::default());
        Linearised { kind, settings, designs, table, pools, last: None, reference: None, harmonics: 0 }
    }
}

/// The rows along a reference, up to a harmonic.
struct Reference {
    trajectory: Trajectory,
    constants: Vec<f64>,
    highest: usize,
    along: Along,
}

impl Reference {
    fn new(
        model: &dyn Model<f64>,
        trial: &Trial,
        highest: usize,
        table: Option<&dyn LineTable>,
    ) -> Result<Self, EstimateError> {
        let along = Along::of_trial(model, trial, highest, table)?;
        let (trajectory, constants) = (trial.trajectory.clone(), trial.constants.clone());
        Ok(Reference { trajectory, constants, highest, along })
    }

    fn is_of(&self, trial: &Trial, highest: usize) -> bool {
        self.highest == highest && self.trajectory == trial.trajectory && self.constants == trial.constants
    }
}

impl Estimator for Linearised {
    fn name(&self) -> &'static str {
        match self.kind {
            FirstOrder::Error => "error",
            FirstOrder::Effort => "effort",
            FirstOrder::Hill => "hill",
        }
    }

    fn reduce(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError> {
        self.pools.close();
        self.last = None;
        let highest = run.highest_harmonic(&self.settings);
        let reference = match self.reference.take().filter(|reference| reference.is_of(run.trial, highest)) {
            Some(reference) => reference,
            None => {
                let reference = Reference::new(model, run.trial, highest, self.table.as_deref())?;
                self.designs.push(model, &run.trial.constants, &run.trial.trajectory, &self.settings)?;
                self.settings = self.designs.hidden(&self.settings, |_| true)?;
                reference
            }
        };
        let along = &self.reference.insert(reference).along;
        let mut reduced = match run.rates {
            None => self.kind.reduce(run.trial, along, run.spectra, run.hold, highest)?,
            Some(_) => self.kind.reduce_applied(run.trial, along, run.spectra, run.hold, (0, highest))?,
        };
        let own = reduced.equations.len();
        // `effort` does not use the error, so that an error from rates adds no equation.
        if let Some(rates) = run.rates.filter(|_| self.kind != FirstOrder::Effort) {
            reduced.append(self.kind.reduce_applied(run.trial, along, rates, run.hold, (1, highest))?);
        }
        self.harmonics = highest;
        // Noise is worked out at a first estimate: the parameters say how strongly the rows feel it, and how far it shifts the mean
        // of a term that is even in the velocity.
        let first = reduced.update(self.pools.before.as_ref(), &self.settings)?.0.values;
        if let Some(noise) = noise_along(model, run, along, &first, highest)? {
            if self.kind != FirstOrder::Effort {
                reduced.equations.set_variance(own, &noise.variance);
            }
            if let Some((shifts, uncertainty)) = &noise.shifts {
                reduced.shift_means(shifts, &first, *uncertainty);
            }
        }
        self.last = Some(reduced);
        Ok(())
    }

    fn update(&mut self) -> Result<Option<Estimate>, EstimateError> {
        let Some(reduced) = &mut self.last else { return Ok(None) };
        match reduced.update(self.pools.before.as_ref(), &self.settings) {
            Ok((estimate, pool)) => {
                self.pools.after = Some(pool);
                Ok(Some(estimate))
            }
            Err(error) => {
                self.last = None;
                Err(error)
            }
        }
    }

    fn harmonics(&self) -> usize {
        self.harmonics
    }
}

impl Reduced {
    /// The estimate from these equations beside a pool, and the pool with them.
    fn update(&mut self, before: Option<&Pool>, settings: &Settings) -> Result<(Estimate, Pool), EstimateError> {
        self.complete();
        pool_run(before, &self.equations, settings, &self.parameters)
    }
}
