//! `measured-motion` over all runs of a campaign.

use crate::estimate::along::Along;
use crate::estimate::error::EstimateError;
use crate::estimate::estimator::Estimator;
use crate::estimate::information::Information;
use crate::estimate::measured_motion::fit::estimate_measured_motion;
use crate::estimate::measured_motion::record::MeasuredMotion;
use crate::estimate::measured_motion::refine::refine_last;
use crate::estimate::result::Estimate;
use crate::estimate::run::{Run, reach};
use crate::estimate::settings::Settings;
use crate::run::trajectory::Trajectory;
use std::vec;
use std::vec::Vec;
use tpm_core::model::Model;

/// The estimator `measured-motion`, over all runs.
pub(in crate::estimate) struct PooledMotion {
    settings: Settings,
    records: Vec<MeasuredMotion>,
    /// Per run, what the references up to it show, and the directions that they do not show.
    design: Vec<(Information, Vec<Vec<f64>>)>,
}

impl PooledMotion {
    /// The estimator before any run.
    pub(in crate::estimate) fn new(settings: &Settings) -> Self {
        PooledMotion { settings: settings.clone(), records: Vec::new(), design: Vec::new() }
    }

    /// What the earlier references and this motion show together, and the directions that they do not show.
    fn design(
        &self,
        model: &dyn Model<f64>,
        constants: &[f64],
        motion: &Trajectory,
    ) -> Result<(Information, Vec<Vec<f64>>), EstimateError> {
        let free = self.settings.free(model.dims().parameters)?;
        let own = Along::design(model, constants, motion, reach(motion).max(1), &free.indices)?;
        let whole = self.design.last().map_or_else(|| own.clone(), |(before, _)| before.pool(&own));
        let found = whole.solve(&vec![0.0; free.indices.len()], None).unobservable;
        let hidden = found.iter().map(|direction| free.spread(direction)).collect();
        Ok((whole, hidden))
    }

    /// The settings with directions that the references do not show.
    fn with(&self, hidden: &[Vec<f64>]) -> Settings {
        Settings { hidden: hidden.to_vec(), ..self.settings.clone() }
    }
}

impl Estimator for PooledMotion {
    fn name(&self) -> &'static str {
        "measured-motion"
    }

    fn reduce(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError> {
        let motion = run.judged_motion();
        let design = self.design(model, &run.trial.constants, &motion)?;
        let settings = Settings { reach: reach(&motion), ..self.with(&design.1) };
        let record = MeasuredMotion::new(model, &run.trial.constants, run.spectra, run.hold, &settings)?;
        self.records.push(record);
        let mut first = |records: &mut [MeasuredMotion]| Ok(estimate_measured_motion(records, &settings)?.values);
        let refined = refine_last(&mut self.records, model, &run.trial.constants, run.spectra, run.hold, &mut first);
        if refined.is_err() {
            self.records.pop();
        } else {
            self.design.push(design);
        }
        refined
    }

    fn update(&mut self) -> Result<Option<Estimate>, EstimateError> {
        let settings = self.with(self.design.last().map_or(&[], |(_, hidden)| hidden));
        let estimate = estimate_measured_motion(&mut self.records, &settings);
        if estimate.is_err() {
            self.records.pop();
            self.design.pop();
        }
        estimate.map(Some)
    }

    fn harmonics(&self) -> usize {
        self.records.last().map_or(0, MeasuredMotion::harmonics)
    }
}
