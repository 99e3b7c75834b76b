//! The trait of estimators, each of which pools the runs of a campaign.
//!
//! A run is taken in by two steps. [`Estimator::reduce`] needs the record: it works out harmonics, the rows along the motion
//! and the noise in what is formed of them, read bin by bin at a first estimate; it takes as long as the record does.
//! [`Estimator::update`] goes from there to new parameters and needs harmonics alone.

use crate::consistency::LeftOut;
use crate::error::EstimateError;
use crate::physical_remark::PhysicalRemark;
use crate::result::Estimate;
use crate::run::Run;
use tpm_controller::model::Model;
use tpm_motion::Trial;

/// Learns parameters from the runs of a campaign.
pub trait Estimator: Send {
    /// The name in experiment files and reports.
    fn name(&self) -> &'static str;

    /// Checks that the estimator has a meaning for a campaign that begins with a trial and has at most so many runs.
    ///
    /// # Errors
    /// [`EstimateError`] that says why it has none.
    fn check(&self, _model: &dyn Model<f64>, _first: &Trial, _runs: usize) -> Result<(), EstimateError> {
        Ok(())
    }

    /// The parameters that the next run's feed-forward uses, given the present estimates.
    fn play(&self, current: &[f64]) -> Vec<f64> {
        current.to_vec()
    }

    /// Called when the run with the parameters of [`play`](Self::play) could not be played whole: the next one goes less far from the last run
    /// that could. Says whether it does.
    fn take_back(&mut self) -> bool {
        false
    }

    /// Whether the last estimate is one to end with: the next run goes all the way to it, and its deviations are those of noise. An
    /// estimate whose deviations are those of a linearisation gets better by another run.
    fn is_final(&self) -> bool {
        true
    }

    /// The parameters about which the last estimate is linear, where its deviations do not contain what the linearisation leaves out: how
    /// far the estimate is from them is not confirmed by any run. Nothing for the other estimators.
    fn linear_about(&self) -> Option<&[f64]> {
        None
    }

    /// Reduces a run to harmonics, with the noise in the equations that are formed of them.
    ///
    /// # Errors
    /// [`EstimateError`] when the run cannot be used; what was learnt before is kept.
    fn reduce(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError>;

    /// The estimate from all runs that were reduced, or nothing while further runs are needed for it. A second call without a
    /// run in between gives the same estimate.
    ///
    /// # Errors
    /// [`EstimateError`] when the equations cannot be solved; the last run is then forgotten.
    fn update(&mut self) -> Result<Option<Estimate>, EstimateError>;

    /// Takes in a run: reduces it and updates.
    ///
    /// # Errors
    /// [`EstimateError`] when the run cannot be used; what was learnt before is kept.
    fn take(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<Option<Estimate>, EstimateError> {
        self.reduce(model, run)?;
        self.update()
    }

    /// Highest harmonic used in the last run.
    fn harmonics(&self) -> usize;

    /// The lumped parameters behind the last estimate, with the form of the model that has them; nothing for estimators of models
    /// without eliminated coordinates.
    fn lumped(&self) -> Option<(&dyn Model<f64>, &Estimate)> {
        None
    }

    /// The runs that the last estimate leaves out, since they contradict the runs that are pooled. Only `measured-motion` judges
    /// runs so: the linearisation error of the other estimators shrinks from run to run, and is no contradiction. Models with
    /// eliminated coordinates are not judged either, since one run alone does not show their parameters.
    fn left_out(&self) -> &[LeftOut] {
        &[]
    }

    /// What the user should know about the last estimate.
    fn remarks(&self) -> &[PhysicalRemark] {
        &[]
    }
}
