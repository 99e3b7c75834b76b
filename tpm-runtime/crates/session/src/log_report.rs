//! What was found about a log on the way to its parameters.

use crate::prediction::Prediction;
use crate::refinement_report::{MissingTerm, RefinementReport};
use serde::Serialize;
use std::collections::BTreeMap;
use tpm_controller::harmonics::Hold;
use tpm_estimate::LineReport;
use tpm_log::ReadingReport;
use tpm_report::{digits, number};

/// Residuals with either choice of hold, as shares of the force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HoldResiduals {
    /// Inputs as recorded.
    pub none: Option<f64>,
    /// Inputs held between samples.
    pub zoh: Option<f64>,
}

impl HoldResiduals {
    /// The residual with the hold that is stated, and with the other one.
    pub(super) const fn of(stated: Hold, residual: f64, other: Option<f64>) -> Self {
        match stated {
            Hold::None => HoldResiduals { none: Some(residual), zoh: other },
            Hold::Zoh => HoldResiduals { none: other, zoh: Some(residual) },
        }
    }

    /// The residual with this hold.
    pub(super) const fn with(self, hold: Hold) -> Option<f64> {
        match hold {
            Hold::None => self.none,
            Hold::Zoh => self.zoh,
        }
    }
}

/// How a log was used, and what was found on the way.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "domain", rename_all = "snake_case")]
pub enum Way {
    /// By the harmonics of the part that repeats.
    Harmonics(PeriodicReport),
    /// Sample by sample.
    Samples(SamplesReport),
    /// By the lines of the rows along the smoothed motion.
    Spectral(SpectralReport),
    /// By simulating the model between the stamps.
    Recorded(RecordedReport),
}

/// What was found about a log by simulating the model between its stamps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecordedReport {
    /// Readings that the simulation was compared with.
    pub readings: usize,
    /// Readings in the log.
    pub of: usize,
    /// Blocks that were simulated, each from a state of its own.
    pub blocks: usize,
    /// Duration of the longest block, s.
    pub duration: f64,
    /// What is left of every sensor.
    pub sensors: Vec<SensorReport>,
    /// Coordinates that no sensor measures.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unmeasured: Vec<String>,
}

/// What a simulation leaves of the readings of a sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorReport {
    /// What it reads: a coordinate, or `dot(q)`.
    pub signal: String,
    /// Its readings in the log.
    pub readings: usize,
    /// Standard deviation of what is left, unit of the signal.
    pub left: f64,
    /// The same as a share of the signal's own deviation.
    pub share: f64,
    /// By how much its stamps are late against those of the inputs, s, where it has stamps of its own; estimated with the parameters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late: Option<f64>,
    /// Standard deviation of that, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late_std: Option<f64>,
}

/// What was found about a log sample by sample.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SamplesReport {
    /// Samples that were used.
    pub samples: usize,
}

/// What was found about a log by the lines of its rows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpectralReport {
    /// The lines.
    #[serde(flatten)]
    pub lines: LineReport,
    /// Period of the motion, s, where whole periods were used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<f64>,
    /// Terms that the model lacks, the clearest first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<MissingTerm>,
    /// How well the model predicts forces, as it stands and with these terms; nothing where it lacks none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prediction: Option<Box<Prediction>>,
}

/// A fault of a sensor, or something else of the machine, that a log would not show for certain, though it would move parameters by more than
/// their deviations.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UnseenFaultReport {
    /// The input, the coordinate, or both coordinates.
    pub signal: String,
    /// What would be off.
    pub quantity: Calibration,
    /// By how much: a share of the gain, of the force or of the inertias, or a distance in the unit of the coordinate.
    pub size: f64,
    /// Standard deviation with which the log tells it, in the same unit; nothing where no log of this input tells it.
    pub std: Option<f64>,
    /// Unit of the coordinate whose zero it is.
    pub unit: Option<String>,
    /// Largest change of a parameter, in its standard deviations.
    pub deviations: f64,
}

/// What a sensor must know of itself, and what a machine may have besides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Calibration {
    /// The factor from its reading to the force.
    Gain,
    /// Where its reading is zero.
    Zero,
    /// How much an input must be before it acts.
    DeadZone,
    /// An inertia between two coordinates.
    Inertia,
}

/// What was found about a log that repeats.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PeriodicReport {
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
    /// Parameters that the log does not test: a force that the model lacks changes them, and nothing shows it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub untested: Vec<UntestedReport>,
}

/// A parameter that a small force at one harmonic, which the model lacks, would change beyond its deviation while the residual stays as
/// small as it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UntestedReport {
    /// The parameter.
    pub parameter: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Row of the model on which the force acts.
    pub row: String,
    /// Harmonic at which it acts.
    pub harmonic: usize,
    /// Its root mean square as a share of the force of the row.
    pub share: f64,
    /// How far it changes the parameter, unit of the parameter.
    pub change: f64,
    /// The same in standard deviations of the parameter.
    pub deviations: f64,
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
    /// How they were used.
    #[serde(flatten)]
    pub way: Way,
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
    /// What a wrong gain of the only input does, which no log of it shows; nothing where something that is known tells the scale.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unseen_gain: Option<UnseenFaultReport>,
}

/// One of several logs that were used together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PooledLog {
    /// Share of the information about all parameters that comes from this log.
    pub share: f64,
    /// Whether the log contradicts a majority of logs that agree, and is left out of the result.
    pub left_out: bool,
    /// Residual of the log alone, as a share: of the force, or where it was refined of the motion or of the inputs, whichever is larger.
    pub residual: f64,
    /// Values by this log alone; nothing where it does not show a parameter.
    pub alone: BTreeMap<String, Option<(f64, f64)>>,
    /// Difference of every parameter from the other logs together, in deviations of that difference; nothing where either does not show
    /// it.
    pub deviations: BTreeMap<String, Option<f64>>,
    /// What was found about it.
    pub log: LogReport,
}

/// What was found about several logs that were used together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoolReport {
    /// The logs.
    pub logs: Vec<PooledLog>,
    /// Weighted sum of the squares of all differences between the logs.
    pub chi_squared: f64,
    /// Its degrees of freedom.
    pub freedom: usize,
    /// Factor on all variances because the logs differ by more than their deviations; one where they agree.
    pub inflation: f64,
}

impl PeriodicReport {
    /// What a reader should know of the parameters that the log does not test; nothing where it tests all.
    #[must_use]
    pub fn untested_remark(&self) -> Option<String> {
        let share = self.untested.first()?.share;
        let names: Vec<&str> = self.untested.iter().map(|own| own.parameter.as_str()).collect();
        let change = |own: &UntestedReport| {
            let unit = own.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
            let (parameter, change, deviations) = (&own.parameter, digits(own.change, 2), digits(own.deviations, 2));
            format!(
                "{parameter} by {change}{unit} ({deviations} deviations, at harmonic {} of {})",
                own.harmonic, own.row
            )
        };
        Some(format!(
            "this log does not test {}: a force that the model lacks, of {} % of the force and at one harmonic, would change {}, and the residual would stay as it is; what tests them is a motion with more harmonics, or another log at another frequency",
            names.join(", "),
            number(100.0 * share),
            self.untested.iter().map(change).collect::<Vec<_>>().join(", "),
        ))
    }
}

impl LogReport {
    /// What a reader should know of what this log cannot show, whatever the model.
    #[must_use]
    pub fn limits(&self) -> Vec<String> {
        let gain = self.unseen_gain.as_ref().map(|own| {
            let UnseenFaultReport { signal, size, deviations, .. } = own;
            format!(
                "no log of one input shows a wrong gain of {signal}: {} % of it move a parameter by up to {deviations:.0} of its deviations",
                number(100.0 * size)
            )
        });
        self.periodic().and_then(PeriodicReport::untested_remark).into_iter().chain(gain).collect()
    }

    /// What was found about the part that repeats; nothing where harmonics were not used.
    #[must_use]
    pub const fn periodic(&self) -> Option<&PeriodicReport> {
        match &self.way {
            Way::Harmonics(periodic) => Some(periodic),
            Way::Samples(_) | Way::Spectral(_) | Way::Recorded(_) => None,
        }
    }

    /// How well a model that lacks something predicts the forces of the log, where the lines of its rows told so.
    #[must_use]
    pub fn prediction(&self) -> Option<&Prediction> {
        if let Way::Spectral(own) = &self.way { own.prediction.as_deref() } else { None }
    }

    /// Terms that the record shows the model to lack, whichever way they were found.
    #[must_use]
    pub fn missing(&self) -> &[MissingTerm] {
        match (&self.way, &self.refinement) {
            (Way::Spectral(own), _) if !own.missing.is_empty() => &own.missing,
            (_, Some(refinement)) => &refinement.missing,
            _ => &[],
        }
    }
}

/// What was known to lie between an input and its force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ActuatorReport {
    /// Delay, s.
    pub delay: f64,
    /// Whether the delay was found with the parameters.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub fitted: bool,
    /// Its standard deviation, s; nothing where it was stated, or where the record shows none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delay_std: Option<f64>,
    /// Natural frequency (rad/s) and quality factor of a low pass.
    pub low_pass: Option<(f64, f64)>,
    /// Bandwidth of the current loop, rad/s.
    pub bandwidth: Option<f64>,
}
