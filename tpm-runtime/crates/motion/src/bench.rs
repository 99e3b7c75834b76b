//! The interface to whatever plays a trial: a simulated plant, a process, or a person at a machine.

use crate::record::Record;
use crate::trial::Trial;

/// Why a trial was not played. A run that was cut short by a bound is no error: its record says how it ended.
pub type BenchError = Box<dyn std::error::Error + Send + Sync>;

/// Plays trials on a machine.
pub trait Bench {
    /// Plays a trial from rest at the start of its reference, and returns what was recorded.
    ///
    /// # Errors
    /// Whatever keeps the machine from playing the trial.
    fn play(&mut self, trial: &Trial) -> Result<Record, BenchError>;
}
