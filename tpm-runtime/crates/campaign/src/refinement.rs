//! Estimates of a campaign that are refined by the samples of its runs.

use crate::steady::SteadyRun;
use std::fmt::{Debug, Formatter};
use tpm_estimate::{Alone, Estimate, OwnEstimate};

/// Refines an estimate by the samples of the runs that it comes from.
pub trait Refinement {
    /// The estimate that explains the samples of the runs, beginning with that of their harmonics; nothing where there is none.
    fn refined(&self, runs: &[&SteadyRun], estimate: &Estimate) -> Option<Estimate>;
}

/// One run, which is refined by itself.
pub(super) struct OneRun<'a> {
    pub(super) refinement: &'a dyn Refinement,
    pub(super) run: &'a SteadyRun,
}

impl Debug for OneRun<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OneRun").field("run", &self.run.run).finish_non_exhaustive()
    }
}

impl Alone for OneRun<'_> {
    fn refined(&self, estimate: &Estimate) -> Option<OwnEstimate> {
        let estimate = self.refinement.refined(&[self.run], estimate)?;
        // Thousands of samples leave so many residuals that their number hardly matters.
        let readings = self.run.samples() * self.run.highest.len();
        Some(OwnEstimate { residuals: readings.saturating_sub(estimate.rank), estimate })
    }
}
