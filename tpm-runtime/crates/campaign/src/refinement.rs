//! Refinement of a campaign's estimates by the samples of its runs.

use crate::steady::SteadyRun;
use std::fmt::{Debug, Formatter};
use tpm_estimate::{Alone, Estimate, OwnEstimate};

/// Refines an estimate by the samples of the runs that it comes from.
pub trait Refinement {
    /// The estimate that fits the samples of the runs, starting from `estimate`, which comes from their harmonics;
    /// nothing where the search finds none.
    fn refined(&self, runs: &[&SteadyRun], estimate: &Estimate) -> Option<Estimate>;
}

/// The refinement of an estimate by the samples of a single run.
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
        // A run has thousands of samples, so the exact number of degrees of freedom hardly matters.
        let readings = self.run.samples() * self.run.highest.len();
        Some(OwnEstimate { residuals: readings.saturating_sub(estimate.rank), estimate })
    }
}
