//! The records of a campaign's runs, of which those are pooled that agree with each other.
//!
//! Invariant: a run that contradicts the pool changes no record of the pool. It is refined and judged alone first, and meets the
//! other records only where it agrees.

use crate::consistency::{Consistency, LeftOut};
use crate::measured_motion::record::MeasuredMotion;
use crate::result::Estimate;
use crate::run::Alone;
use crate::settings::Settings;

/// The records of a campaign's runs.
pub(super) struct Records {
    all: Vec<MeasuredMotion>,
    /// Nothing where parameters are followed as they drift: they differ from run to run, and all runs are pooled by their age.
    consistency: Option<Consistency>,
}

impl Records {
    /// No records.
    pub(super) fn new(settings: &Settings) -> Self {
        Records { all: Vec::new(), consistency: (!settings.forgets()).then(Consistency::default) }
    }

    /// Number of runs.
    pub(super) const fn len(&self) -> usize {
        self.all.len()
    }

    /// Whether runs are judged before they are pooled.
    pub(super) const fn judges(&self) -> bool {
        self.consistency.is_some()
    }

    /// Whether a run is pooled.
    pub(super) fn pools(&self, run: usize) -> bool {
        self.consistency.as_ref().is_none_or(|judged| judged.members().get(run).copied().unwrap_or(false))
    }

    /// Takes in the record of a further run, refined alone, with the estimate that its harmonics give, and judges the run by what its
    /// samples say where they say more. Whether the run agrees with earlier ones, together with which it is to be refined.
    pub(super) fn joins(&mut self, alone: MeasuredMotion, estimate: Estimate, samples: Option<&dyn Alone>) -> bool {
        if let Some(consistency) = &mut self.consistency {
            match samples.and_then(|samples| samples.refined(&estimate)) {
                Some(own) => consistency.push(own.estimate, own.residuals),
                None => {
                    let equations: usize = alone.used.iter().flatten().map(|&k| if k == 0 { 1 } else { 2 }).sum();
                    let residuals = equations.saturating_sub(estimate.rank);
                    consistency.push(estimate, residuals);
                }
            }
        }
        self.all.push(alone);
        let last = self.all.len() - 1;
        self.pools(last) && (0..last).any(|run| self.pools(run))
    }

    /// Puts a record in place of the last run's, or behind the records where runs are not judged, and refines it as the last of
    /// those that are pooled.
    ///
    /// # Errors
    /// That of the refinement; the last run is then forgotten.
    pub(super) fn replace<E>(
        &mut self,
        record: MeasuredMotion,
        refine: impl FnOnce(&mut [MeasuredMotion]) -> Result<(), E>,
    ) -> Result<(), E> {
        if self.judges() {
            self.all.pop();
        }
        self.all.push(record);
        let refined = self.pooled(refine);
        if refined.is_err() {
            self.pop();
        }
        refined
    }

    /// Gives the records that are pooled, in their order.
    pub(super) fn pooled<T>(&mut self, of: impl FnOnce(&mut [MeasuredMotion]) -> T) -> T {
        let pools: Vec<bool> = (0..self.all.len()).map(|run| self.pools(run)).collect();
        if pools.iter().all(|pools| *pools) {
            return of(&mut self.all);
        }
        let (mut inside, mut outside) = (Vec::new(), Vec::new());
        for (record, pools) in self.all.drain(..).zip(&pools) {
            if *pools { inside.push(record) } else { outside.push(record) }
        }
        let result = of(&mut inside);
        let (mut inside, mut outside) = (inside.into_iter(), outside.into_iter());
        self.all.extend(pools.iter().filter_map(|pools| if *pools { inside.next() } else { outside.next() }));
        result
    }

    /// Forgets the last run.
    pub(super) fn pop(&mut self) {
        self.all.pop();
        if let Some(consistency) = &mut self.consistency {
            consistency.truncate(self.all.len());
        }
    }

    /// Highest harmonic used in the last run.
    pub(super) fn harmonics(&self) -> usize {
        self.all.last().map_or(0, MeasuredMotion::harmonics)
    }

    /// The runs that are not pooled.
    pub(super) fn left_out(&self) -> &[LeftOut] {
        self.consistency.as_ref().map_or(&[], Consistency::left_out)
    }
}
