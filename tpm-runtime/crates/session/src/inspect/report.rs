//! What an inspection found, as data.

use crate::inspect::channel::ChannelReport;
use crate::inspect::finding::{Finding, with_texts};
use crate::inspect::period::Repeats;
use crate::inspect::relation::Relation;
use crate::log_report::LogReport;
use serde::Serialize;
use tpm_estimate::InputShift;
use tpm_log::{Jitter, ReadingReport};

/// How a record is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Sampling {
    /// Time between samples, s.
    pub sample_time: f64,
    /// Samples a second, Hz.
    pub rate: f64,
    /// Samples in all stretches.
    pub samples: usize,
    /// Time that they cover, s.
    pub duration: f64,
    /// Stretches without a gap.
    pub segments: usize,
    /// By how much the steps of the stamps are off the sample time.
    pub jitter: Jitter,
}

/// What a log holds; serialises as `tpm.inspection/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Inspection {
    /// `tpm.inspection/1`.
    pub schema: &'static str,
    /// Name of the log.
    pub log: String,
    /// Name of the model; nothing where none was given.
    pub model: Option<String>,
    /// What was assumed in reading the file, how the record was split, and what was left out.
    pub reading: ReadingReport,
    /// How it is sampled.
    pub sampling: Sampling,
    /// The channels: coordinates, inputs and measured rates of a model, or all columns of numbers.
    pub channels: Vec<ChannelReport>,
    /// The part that repeats.
    pub repeats: Option<Repeats>,
    /// Channels that follow from others.
    pub relations: Vec<Relation>,
    /// The time between inputs and motion; nothing without a model, or where it is not told.
    pub input_shift: Option<InputShift>,
    /// How identification would use the log; nothing without a model, or where it would refuse the log.
    pub identification: Option<LogReport>,
    /// What all this means, what needs attention first.
    #[serde(serialize_with = "serialized")]
    pub findings: Vec<Finding>,
}

// What serde calls takes a reference to the field.
#[allow(clippy::ptr_arg)]
fn serialized<S: serde::Serializer>(findings: &Vec<Finding>, serializer: S) -> Result<S::Ok, S::Error> {
    with_texts(findings, serializer)
}
