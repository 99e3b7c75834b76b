//! The record of a run: its samples and how it ended.

use crate::trial::Trial;
use serde::{Deserialize, Serialize};
use tpm_numerics::tolerance;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ending {
    /// All samples were played.
    Complete,
    /// The tracking error of a coordinate passed its bound.
    TrackingBound {
        /// The coordinate.
        coordinate: usize,
        /// The last sample that was recorded.
        sample: usize,
        /// The error there.
        error: f64,
    },
    /// A coordinate left the range that its position must keep within.
    PositionBound {
        /// The coordinate.
        coordinate: usize,
        /// The last sample that was recorded.
        sample: usize,
        /// The position there.
        position: f64,
    },
    /// A coordinate's velocity passed its bound.
    VelocityBound {
        /// The coordinate.
        coordinate: usize,
        /// The last sample that was recorded.
        sample: usize,
        /// The velocity there.
        velocity: f64,
    },
    /// The machine, or whoever stood beside it, stopped the run.
    Stopped {
        /// The last sample that was recorded.
        sample: usize,
    },
    /// A coordinate's sensor gave no number.
    SensorLost {
        /// The coordinate.
        coordinate: usize,
        /// The last sample that was recorded, the one without a number.
        sample: usize,
    },
    /// The plant's motion became infinite, or the model could not be evaluated.
    Diverged {
        /// The last sample that was recorded.
        sample: usize,
    },
}

impl Ending {
    /// The ending of a run whose tracking error at a sample is not a number, or beyond its bound; nothing when the run goes on.
    #[must_use]
    pub fn of_error(coordinate: usize, sample: usize, error: f64, bound: f64) -> Option<Self> {
        if error.is_nan() {
            return Some(Ending::SensorLost { coordinate, sample });
        }
        (error.abs() > bound).then_some(Ending::TrackingBound { coordinate, sample, error })
    }

    /// The ending of a run in which a coordinate's position or velocity at a sample is beyond its bound; nothing when the run goes
    /// on. Bounds beyond the last one given are infinite.
    #[must_use]
    pub fn of_motion(
        trial: &Trial,
        coordinate: usize,
        sample: usize,
        position: f64,
        velocity: Option<f64>,
    ) -> Option<Self> {
        if trial.position_bounds.get(coordinate).is_some_and(|&(low, high)| position < low || position > high) {
            return Some(Ending::PositionBound { coordinate, sample, position });
        }
        let bound = trial.velocity_bounds.get(coordinate).copied().unwrap_or(f64::INFINITY);
        let velocity = velocity.filter(|velocity| velocity.abs() > bound)?;
        Some(Ending::VelocityBound { coordinate, sample, velocity })
    }

    /// The kind of ending, without coordinate, sample and error.
    #[must_use]
    pub const fn kind(&self) -> RunEnding {
        match self {
            Ending::Complete => RunEnding::Complete,
            Ending::TrackingBound { .. } => RunEnding::TrackingBound,
            Ending::PositionBound { .. } => RunEnding::PositionBound,
            Ending::VelocityBound { .. } => RunEnding::VelocityBound,
            Ending::Stopped { .. } => RunEnding::Stopped,
            Ending::SensorLost { .. } => RunEnding::SensorLost,
            Ending::Diverged { .. } => RunEnding::Diverged,
        }
    }
}

/// How a run ended, as reports and manifests state it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunEnding {
    /// All samples were played.
    Complete,
    /// The tracking error passed its bound.
    TrackingBound,
    /// A position left its range.
    PositionBound,
    /// A velocity passed its bound.
    VelocityBound,
    /// The machine, or whoever stood beside it, stopped the run.
    Stopped,
    /// A sensor gave no number.
    SensorLost,
    /// The motion became infinite.
    Diverged,
    /// All samples were played, but the motion had not settled.
    Unsettled,
    /// All samples were played, but the machine hardly moved as it was to.
    Unfollowed,
}

impl std::fmt::Display for RunEnding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            RunEnding::Complete => "complete",
            RunEnding::TrackingBound => "tracking bound",
            RunEnding::PositionBound => "position bound",
            RunEnding::VelocityBound => "velocity bound",
            RunEnding::Stopped => "stopped",
            RunEnding::SensorLost => "sensor lost",
            RunEnding::Diverged => "diverged",
            RunEnding::Unsettled => "unsettled",
            RunEnding::Unfollowed => "not followed",
        })
    }
}

/// Why samples are no record of a trial.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The samples were taken at another rate.
    #[error("the record has a sample every {given} s, the trial one every {needed} s")]
    SampleTime {
        /// Sample time of the trial, s.
        needed: f64,
        /// Sample time of the record, s.
        given: f64,
    },
    /// The samples end before the trial, and show no bound that was passed.
    #[error("the record has {given} samples, the trial has {needed}; if the machine stopped the run, say so")]
    TooShort {
        /// Samples of the trial.
        needed: usize,
        /// Samples given.
        given: usize,
    },
}

/// Samples of one run, complete or not.
///
/// Invariant: all signals have the same length, rates at least that; sample n of an input was applied from n to n + 1 sample
/// times, sample n of a coordinate was measured at its start.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Time between samples, s.
    pub sample_time: f64,
    /// Measured values, per coordinate.
    pub coordinates: Vec<Vec<f64>>,
    /// Applied values, per input.
    pub inputs: Vec<Vec<f64>>,
    /// Measured rates, per coordinate: none where no sensor measures one, and empty when there is no such sensor at all.
    pub rates: Vec<Option<Vec<f64>>>,
    /// How the run ended.
    pub ending: Ending,
    /// Number of samples in which an input was cut at its limit.
    pub saturated: usize,
}

impl Record {
    /// The record of a run from samples of the coordinates and of the applied inputs, one list each, taken every `sample_time`
    /// seconds; no rate was measured, and no input was cut at a limit.
    #[must_use]
    pub const fn new(sample_time: f64, coordinates: Vec<Vec<f64>>, inputs: Vec<Vec<f64>>, ending: Ending) -> Self {
        Record { sample_time, coordinates, inputs, rates: Vec::new(), ending, saturated: 0 }
    }

    /// The record of a trial from the samples that a machine gave. The record ends where a tracking error, a position or a measured
    /// velocity passes its bound, or an error is not a number; a sample in which an input stands at its limit counts as saturated.
    /// Samples may end before the trial only if the machine stopped the run, as `stopped` states or as an input at its
    /// limit in the last sample shows.
    ///
    /// # Errors
    /// [`RecordError::SampleTime`] when the samples were taken at another rate than the trial's, [`RecordError::TooShort`] when
    /// samples are missing for no known reason.
    pub fn of_samples(
        trial: &Trial,
        sample_time: f64,
        coordinates: Vec<Vec<f64>>,
        inputs: Vec<Vec<f64>>,
        rates: Vec<Option<Vec<f64>>>,
        stopped: bool,
    ) -> Result<Self, RecordError> {
        let needed = trial.control.sample_time;
        let off = (sample_time / needed - 1.0).abs();
        if off.is_nan() || off > tolerance::TIME_STAMP {
            return Err(RecordError::SampleTime { needed, given: sample_time });
        }
        let mut record =
            Record { sample_time: needed, coordinates, inputs, rates, ending: Ending::Complete, saturated: 0 };
        // 1. The first sample at which a bound is passed, among those that the trial plays.
        let width = trial.reference.len() / trial.samples_per_period.max(1);
        let error =
            |n: usize, c: usize| record.coordinates[c][n] - trial.reference[n % trial.samples_per_period * width + c];
        let played = record.len().min(trial.samples());
        let passes = |n: usize| {
            let velocity = |c: usize| record.rates.get(c)?.as_ref()?.get(n).copied();
            let ending = |c: usize| {
                Ending::of_error(c, n, error(n, c), trial.tracking_bounds[c])
                    .or_else(|| Ending::of_motion(trial, c, n, record.coordinates[c][n], velocity(c)))
            };
            (0..record.coordinates.len()).find_map(ending).map(|ending| (n, ending))
        };
        let passed = (0..played).find_map(passes);
        let length = passed.map_or(played, |(n, _)| n + 1);
        // 2. Samples that are missing at the end need a reason.
        if passed.is_none() && record.len() < trial.samples() {
            match record.len().checked_sub(1).filter(|last| stopped || record.saturates(trial, *last)) {
                Some(sample) => record.ending = Ending::Stopped { sample },
                None => return Err(RecordError::TooShort { needed: trial.samples(), given: record.len() }),
            }
        }
        // 3. The record ends at that sample, and saturated samples are counted.
        let rates = record.rates.iter_mut().flatten();
        for channel in record.coordinates.iter_mut().chain(&mut record.inputs).chain(rates) {
            channel.truncate(length);
        }
        if let Some((_, ending)) = passed {
            record.ending = ending;
        }
        record.saturated = (0..length).filter(|n| record.saturates(trial, *n)).count();
        Ok(record)
    }

    /// Whether an input is at its limit in a sample.
    fn saturates(&self, trial: &Trial, sample: usize) -> bool {
        self.inputs.iter().zip(&trial.input_limits).any(|(input, limit)| input[sample].abs() >= *limit)
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.coordinates.iter().chain(&self.inputs).map(Vec::len).min().unwrap_or(0)
    }

    /// Whether there is no sample at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
