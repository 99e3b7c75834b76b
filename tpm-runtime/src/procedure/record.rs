//! What comes back from an experiment.

use super::{CampaignError, Trial};
use std::vec::Vec;

/// Relative difference of sample times that is rounding of a log's time column.
const SAME_RATE: f64 = 1e-6;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ending {
    /// All samples were played.
    Complete,
    /// The tracking error of a coordinate passed its bound, or was no number.
    TrackingBound {
        /// The coordinate.
        coordinate: usize,
        /// The last sample that was recorded.
        sample: usize,
        /// The error there.
        error: f64,
    },
    /// The plant's motion became infinite, or the model could not be evaluated.
    Diverged {
        /// The last sample that was recorded.
        sample: usize,
    },
}

/// Samples of one run, complete or not.
///
/// Invariant: all signals have the same length; sample n of an input was applied from n to n + 1 sample times, sample n of
/// a coordinate was measured at its start.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Time between samples, s.
    pub sample_time: f64,
    /// Measured values, per coordinate.
    pub coordinates: Vec<Vec<f64>>,
    /// Applied values, per input.
    pub inputs: Vec<Vec<f64>>,
    /// How the run ended.
    pub ending: Ending,
    /// Samples in which an input was cut at its limit.
    pub saturated: usize,
}

impl Record {
    /// The record of a trial from the samples that a machine gave: it ends where a tracking error passes its bound, and a
    /// sample in which an input stands at its limit counts as cut.
    ///
    /// # Errors
    /// [`CampaignError::SampleTime`], [`CampaignError::Mismatch`] when samples are missing although no bound was passed.
    pub fn of_samples(
        trial: &Trial,
        sample_time: f64,
        coordinates: Vec<Vec<f64>>,
        inputs: Vec<Vec<f64>>,
    ) -> Result<Self, CampaignError> {
        let needed = trial.control.sample_time;
        let off = (sample_time / needed - 1.0).abs();
        if off.is_nan() || off > SAME_RATE {
            return Err(CampaignError::SampleTime { needed, given: sample_time });
        }
        let mut record = Record { sample_time: needed, coordinates, inputs, ending: Ending::Complete, saturated: 0 };
        let width = trial.reference.len() / trial.samples_per_period.max(1);
        let error =
            |n: usize, c: usize| record.coordinates[c][n] - trial.reference[n % trial.samples_per_period * width + c];
        let played = record.len().min(trial.samples());
        let passes = |n: usize| {
            let beyond = |&c: &usize| error(n, c).is_nan() || error(n, c).abs() > trial.tracking_bounds[c];
            (0..record.coordinates.len()).find(beyond).map(|c| (n, c, error(n, c)))
        };
        let passed = (0..played).find_map(passes);
        let length = passed.map_or(played, |(n, _, _)| n + 1);
        if passed.is_none() && record.len() < trial.samples() {
            let given = record.len();
            return Err(CampaignError::Mismatch { what: "samples", needed: trial.samples(), given });
        }
        for channel in record.coordinates.iter_mut().chain(&mut record.inputs) {
            channel.truncate(length);
        }
        if let Some((sample, coordinate, error)) = passed {
            record.ending = Ending::TrackingBound { coordinate, sample, error };
        }
        let cut = |n: &usize| record.inputs.iter().zip(&trial.input_limits).any(|(u, limit)| u[*n].abs() >= *limit);
        record.saturated = (0..length).filter(cut).count();
        Ok(record)
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.coordinates.iter().chain(&self.inputs).map(Vec::len).min().unwrap_or(0)
    }

    /// No sample at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
