//! What a user may say of how a log is read.

use tpm_controller::harmonics::Hold;
use tpm_log::ReadingSettings;
use tpm_report::displayed;

/// How a log is read: its columns, which of its samples are used, and what its inputs do between them.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct RecordSettings {
    /// How its columns become signals.
    #[serde(flatten)]
    pub columns: ReadingSettings,
    /// First sample to use, from 0; found when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from_sample: Option<usize>,
    /// Period of the motion, s; found when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<f64>,
    /// What the inputs do between samples.
    #[serde(serialize_with = "displayed")]
    pub hold: Hold,
}
