//! What was found about a log on the way to its parameters.

use crate::log::ReadingReport;
use crate::session::refinement_report::RefinementReport;
use serde::Serialize;
use std::collections::BTreeMap;
use std::string::String;
use std::vec::Vec;

/// Residuals with either choice of hold, as shares of the force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HoldResiduals {
    /// Inputs as recorded.
    pub none: Option<f64>,
    /// Inputs held between samples.
    pub zoh: Option<f64>,
}

/// What was found about a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogReport {
    /// The file.
    pub path: String,
    /// What was assumed in reading the file, how the record was split, and what was left out.
    #[serde(skip_serializing_if = "ReadingReport::is_plain")]
    pub reading: ReadingReport,
    /// Samples in the log.
    pub samples: usize,
    /// Time between samples, s.
    pub sample_time: f64,
    /// First sample of the part that repeats, from 0.
    pub steady_from_sample: usize,
    /// First sample used, from 0.
    pub from_sample: usize,
    /// Its line in the file.
    pub from_line: u64,
    /// Period, s.
    pub period: f64,
    /// Period in samples.
    pub samples_per_period: f64,
    /// Whole periods used.
    pub periods: usize,
    /// Difference between the last two periods as a share of the motion.
    pub mismatch: f64,
    /// Window on the samples.
    pub window: String,
    /// Harmonics used, per row of the model.
    pub lines: Vec<Vec<usize>>,
    /// Highest harmonic of the motion from which regressors were built.
    pub motion_harmonics: usize,
    /// Residual per row, as a share of its force.
    pub row_residuals: Vec<f64>,
    /// Known dynamics of the actuators, by input, that were corrected.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub actuators: BTreeMap<String, ActuatorReport>,
    /// Residual with either hold.
    pub hold_residuals: HoldResiduals,
    /// What simulating the model sample by sample did; nothing where it was not asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refinement: Option<RefinementReport>,
}

/// What was known to lie between an input and its force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ActuatorReport {
    /// Delay, s.
    pub delay: f64,
    /// Natural frequency (rad/s) and quality factor of a low pass.
    pub low_pass: Option<(f64, f64)>,
    /// Bandwidth of the current loop, rad/s.
    pub bandwidth: Option<f64>,
}
