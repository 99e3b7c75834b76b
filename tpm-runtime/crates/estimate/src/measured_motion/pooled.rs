//! `measured-motion` over the runs of a campaign that agree with each other.

use crate::consistency::LeftOut;
use crate::designs::Designs;
use crate::error::EstimateError;
use crate::estimator::Estimator;
use crate::measured_motion::fit::estimate_measured_motion;
use crate::measured_motion::record::MeasuredMotion;
use crate::measured_motion::records::Records;
use crate::measured_motion::refine::refine_last;
use crate::result::Estimate;
use crate::run::{Run, reach};
use crate::settings::Settings;
use tpm_controller::model::Model;
use tpm_motion::trajectory::Trajectory;

/// The estimator `measured-motion`, over all runs that agree.
pub(crate) struct PooledMotion {
    settings: Settings,
    records: Records,
    /// What the reference of every run shows.
    designs: Designs,
}

impl PooledMotion {
    /// The estimator before any run.
    pub(crate) fn new(settings: &Settings) -> Self {
        PooledMotion { settings: settings.clone(), records: Records::new(settings), designs: Designs::default() }
    }

    /// [`Estimator::reduce`] of a run whose design stands in the list already.
    fn reduce_last(&mut self, model: &dyn Model<f64>, run: &Run<'_>, motion: &Trajectory) -> Result<(), EstimateError> {
        let last = self.designs.len() - 1;
        let own = Settings { reach: reach(motion), ..self.designs.hidden(&self.settings, |run| run == last)? };
        let record = MeasuredMotion::new(model, &run.trial.constants, run.spectra, run.hold, &own)?;
        let refine = |records: &mut [MeasuredMotion], settings: &Settings| {
            let mut first = |records: &mut [MeasuredMotion]| Ok(estimate_measured_motion(records, settings)?.values);
            refine_last(records, model, &run.trial.constants, run.spectra, run.hold, &mut first)
        };
        if self.records.judges() {
            let mut alone = [record.clone()];
            refine(&mut alone, &own)?;
            let estimate = estimate_measured_motion(&mut alone, &own)?;
            let [alone] = alone;
            if !self.records.joins(alone, estimate, run.alone) {
                return Ok(());
            }
        }
        let hidden = self.designs.hidden(&self.settings, |run| self.records.pools(run))?;
        let settings = Settings { reach: own.reach, ..hidden };
        self.records.replace(record, |records| refine(records, &settings))
    }
}

impl Estimator for PooledMotion {
    fn name(&self) -> &'static str {
        "measured-motion"
    }

    fn reduce(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError> {
        let motion = run.judged_motion();
        self.designs.push(model, &run.trial.constants, &motion, &self.settings)?;
        let reduced = self.reduce_last(model, run, &motion);
        self.designs.truncate(self.records.len());
        reduced
    }

    fn update(&mut self) -> Result<Option<Estimate>, EstimateError> {
        let settings = self.designs.hidden(&self.settings, |run| self.records.pools(run))?;
        let estimate = self.records.pooled(|records| estimate_measured_motion(records, &settings));
        if estimate.is_err() {
            self.records.pop();
            self.designs.truncate(self.records.len());
        }
        estimate.map(Some)
    }

    fn harmonics(&self) -> usize {
        self.records.harmonics()
    }

    fn left_out(&self) -> &[LeftOut] {
        self.records.left_out()
    }
}
