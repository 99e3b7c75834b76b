//! Options of an expansion, and its limits.

use crate::budget;
use crate::harmonic::error::ExpandError;
use crate::mechanics::model::TermId;
use std::ops::ControlFlow;

/// The highest harmonic kept of an infinite series when the caller names none.
pub const DEFAULT_HARMONICS: usize = 31;

/// Progress of an expansion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Number of finished steps.
    pub done: usize,
    /// Total number of steps, whose durations differ.
    pub total: usize,
}

/// Options of an expansion.
#[derive(Default)]
pub struct ExpandOptions<'a> {
    /// Whether to expand even when the table would pass [`ExpandOptions::DEFAULT_LIMIT`]. A table beyond the address
    /// space of machines is always refused.
    pub allow_large: bool,
    /// Called many times a second during long expansions; [`ControlFlow::Break`] ends the expansion.
    pub progress: Option<&'a mut dyn FnMut(Progress) -> ControlFlow<()>>,
    /// The highest harmonic kept of terms that have infinitely many (signs and absolute values);
    /// [`DEFAULT_HARMONICS`] when not given. Terms that have finitely many keep them all.
    pub harmonics: Option<usize>,
}

impl ExpandOptions<'_> {
    /// Tables estimated larger than this many bytes are refused unless `allow_large` is set, or the run's budget
    /// allows large tables.
    pub const DEFAULT_LIMIT: u128 = budget::TABLE_BYTES;

    /// Size in bytes beyond which a table is always refused, since it exceeds the memory of machines.
    pub(crate) const ADDRESSABLE: u128 = 1 << 46;

    /// The largest table in bytes.
    pub(crate) fn limit(&self) -> u128 {
        if self.allow_large || budget::allows_large() { Self::ADDRESSABLE } else { Self::DEFAULT_LIMIT }
    }

    /// Refuses estimates beyond the limit, and names the term that contributes most.
    pub(crate) fn refuse_beyond(&self, term: Option<TermId>, entries: f64, bytes: f64) -> Result<(), ExpandError> {
        // Nearly every table is far below every limit, and converting 128 bits to a float is slow.
        if bytes <= 1e6 {
            return Ok(());
        }
        let limit = self.limit();
        match term {
            Some(term) if bytes > limit as f64 => {
                Err(ExpandError::TooLarge { term, entries: entries as u128, bytes: bytes as u128, limit })
            }
            _ => Ok(()),
        }
    }

    /// Reports the progress of the expansion of `term` to the caller.
    ///
    /// # Errors
    /// [`ExpandError::Stopped`] when the caller requests a stop.
    pub(crate) fn report(&mut self, done: usize, total: usize, term: TermId) -> Result<(), ExpandError> {
        let stop = self.progress.as_mut().is_some_and(|progress| progress(Progress { done, total }).is_break());
        if stop { Err(ExpandError::Stopped { term }) } else { Ok(()) }
    }
}
