//! What comes back from an experiment.

use std::vec::Vec;

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
