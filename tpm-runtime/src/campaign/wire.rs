//! The files that a machine's user exchanges with a campaign.
//!
//! A run goes out as two files: its samples (CSV, one row per sample: time, reference with its derivatives, feed-forward) and,
//! beside them, its terms ([`RunFile`], JSON): feedback, limits, timing. What the machine did comes back as a log.
//!
//! ```text
//! u[n] = u_ff[n] - sum over paths ( kp e[n] + kd v[n] ),      e[n] = q[n] - q_ref[n]
//! ```
//!
//! Invariant: numbers are written with enough digits to be read back exactly, so that a run that goes through files
//! equals one that stays in memory.

use crate::campaign::store::GainManifest;
use crate::run::smoothing::Smoothing;
use crate::run::{Trial, Velocity};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::format;
use std::path::Path;
use std::string::{String, ToString};
use std::vec;
use std::vec::Vec;
use tpm_core::control::{Differentiator, Gain};
use tpm_core::model::Model;

/// Schema of the terms of a run as they are written.
pub const RUN_FILE: &str = "tpm.play/2";
/// The earlier schema, without [`Law`] and [`Timing`]; files of it can still be read.
const EARLIER_RUN_FILE: &str = "tpm.play/1";

/// The terms of a run: its timing, the law of the feedback, and the limits and bounds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// `tpm.play/2`.
    pub schema: String,
    /// Name of the model.
    pub model: String,
    /// Number of the run, from 1.
    pub run: usize,
    /// Time between samples, s.
    pub sample_time: f64,
    /// Samples in a period.
    pub samples_per_period: usize,
    /// Whole periods that the run plays.
    pub periods: usize,
    /// Paths of the feedback.
    pub feedback: Vec<GainManifest>,
    /// Time constant of the filtered difference that forms the rate of the tracking error, s; nothing where the rate is
    /// measured or a polynomial is fitted.
    pub derivative_filter: Option<f64>,
    /// Least-squares smoothing of the tracking error and its rate, where there is any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<Smoothing>,
    /// Largest magnitude by input, for inputs with a limit: the controller cuts the sum of feed-forward and feedback
    /// there.
    pub limits: BTreeMap<String, f64>,
    /// Largest magnitude of the tracking error by coordinate, for coordinates with a bound: the run stops beyond it.
    pub tracking: BTreeMap<String, f64>,
    /// Least and largest position by coordinate, for coordinates with bounds: the run stops beyond them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub positions: BTreeMap<String, [f64; 2]>,
    /// Largest magnitude of the velocity by coordinate, for coordinates with a bound: the run stops beyond it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub velocities: BTreeMap<String, f64>,
    /// Which sample each row belongs to, and how the run begins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timing: Option<Timing>,
    /// The law of the feedback.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<Law>,
}

/// Which sample each row belongs to, how long each value of an input is applied, and how a run begins.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Timing {
    /// Rows of the samples' file, and samples that the log must hold.
    pub samples: usize,
    /// Fewest periods at the start that pass before anything is measured.
    pub settle_periods: usize,
    /// `zero-order`: the drive applies each value of an input until the next sample.
    pub hold: String,
    /// Time for which each value of an input is applied, s.
    pub hold_time: f64,
    /// What row n holds, and which sample of the log it belongs to.
    pub rows: String,
    /// Where the machine is when the run begins.
    pub start: String,
}

/// The law of the feedback, sample by sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Law {
    /// The input from feed-forward and feedback, with its sign.
    pub input: String,
    /// The tracking error, with its sign.
    pub error: String,
    /// The rate of the tracking error.
    pub rate: Rate,
    /// What the controller does with a sum beyond the limit of an input.
    pub saturation: String,
}

/// How the rate of the tracking error is formed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "from", rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum Rate {
    /// The rate is measured.
    Sensor {
        /// The rate in symbols.
        equation: String,
    },
    /// The rate is a filtered difference of the tracking error.
    Difference {
        /// The difference equation in symbols, with its start.
        equation: String,
        /// The pole a.
        a: f64,
        /// The factor b, 1/s.
        b: f64,
    },
    /// The rate is the slope of a polynomial fitted to the last errors. The value of the polynomial is fed back in
    /// place of the error itself.
    Polynomial {
        /// What is fitted, in words.
        equation: String,
        /// Samples that the polynomial is fitted to.
        samples: usize,
        /// Degree of the polynomial.
        degree: usize,
    },
}

impl Rate {
    fn of(velocity: Velocity, sample_time: f64) -> Self {
        match velocity {
            Velocity::Measured => Rate::Sensor { equation: "v[n] = dot(q)[n] - dot(q_ref)[n]".to_string() },
            Velocity::Filtered(time_constant) => {
                let a = Differentiator::new(sample_time, time_constant).pole();
                let equation = "v[n] = a v[n-1] + b (e[n] - e[n-1]); v[0] = 0".to_string();
                Rate::Difference { equation, a, b: (1.0 - a) / sample_time }
            }
            Velocity::Fitted(Smoothing { samples, degree }) => Rate::Polynomial {
                equation: format!(
                    "value and slope, at the last of them, of the polynomial of degree {degree} fitted by least squares to the last {samples} errors; before there are so many, the first error stands for those that are missing"
                ),
                samples,
                degree,
            },
        }
    }
}

/// Why a file of a run cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WireError {
    /// The file cannot be read.
    #[error("cannot read {path}: {reason}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        reason: String,
    },
    /// The file does not have the content that it must have.
    #[error("{path}: {reason}")]
    Broken {
        /// The file.
        path: String,
        /// What is wrong, and where.
        reason: String,
    },
}

fn broken(path: &Path, reason: impl Into<String>) -> WireError {
    WireError::Broken { path: path.display().to_string(), reason: reason.into() }
}

fn read(path: &Path) -> Result<String, WireError> {
    std::fs::read_to_string(path)
        .map_err(|error| WireError::Read { path: path.display().to_string(), reason: error.to_string() })
}

impl RunFile {
    /// The terms of a trial, of which at least `settle_periods` periods pass before anything is measured.
    #[must_use]
    pub fn new(model: &dyn Model<f64>, trial: &Trial, settle_periods: usize) -> Self {
        let coordinate = |c: usize| model.coordinate(c).name.to_string();
        let finite = |values: &[f64], name: &dyn Fn(usize) -> String| {
            let finite = values.iter().enumerate().filter(|(_, value)| value.is_finite());
            finite.map(|(i, value)| (name(i), *value)).collect()
        };
        let control = &trial.control;
        RunFile {
            schema: RUN_FILE.to_string(),
            model: model.name().to_string(),
            run: trial.run + 1,
            sample_time: control.sample_time,
            samples_per_period: trial.samples_per_period,
            periods: trial.periods,
            feedback: GainManifest::all(model, &control.gains),
            derivative_filter: control.velocity.time_constant(),
            smoothing: control.velocity.smoothing(),
            limits: finite(&trial.input_limits, &|i| model.input(i).name.to_string()),
            tracking: finite(&trial.tracking_bounds, &coordinate),
            positions: (trial.position_bounds.iter().enumerate())
                .filter(|(_, (low, high))| low.is_finite() || high.is_finite())
                .map(|(c, &(low, high))| (coordinate(c), [low, high]))
                .collect(),
            velocities: finite(&trial.velocity_bounds, &coordinate),
            timing: Some(Timing {
                samples: trial.samples(),
                settle_periods,
                hold: "zero-order".to_string(),
                hold_time: control.sample_time,
                rows: "row n (from 0) holds reference and feed-forward at the time n sample_time; coordinates of row n of the log are measured at that time, inputs of row n are applied from then until the next row".to_string(),
                start: "at rest at the reference of row 0".to_string(),
            }),
            law: Some(Law {
                input: "u[n] = u_ff[n] - sum of kp e[n] + kd v[n] over the paths of the feedback".to_string(),
                error: "e[n] = q[n] - q_ref[n]".to_string(),
                rate: Rate::of(control.velocity, control.sample_time),
                saturation: "the sum is cut at the limit of its input; the log holds what was applied".to_string(),
            }),
        }
    }

    /// The feedback with inputs and coordinates by index; every name must be one of the model's.
    fn gains(&self, model: &dyn Model<f64>, path: &Path) -> Result<Vec<Gain<f64>>, WireError> {
        let dims = model.dims();
        let gain = |gain: &GainManifest| {
            let input = (0..dims.inputs).find(|&i| model.input(i).name == gain.input);
            let coordinate = (0..dims.coordinates).find(|&c| model.coordinate(c).name == gain.coordinate);
            let (Some(input), Some(coordinate)) = (input, coordinate) else {
                let reason =
                    format!("feedback of {} to {}: the model has no such signals", gain.coordinate, gain.input);
                return Err(broken(path, reason));
            };
            Ok(Gain { input, coordinate, proportional: gain.kp, derivative: gain.kd })
        };
        self.feedback.iter().map(gain).collect()
    }
}

/// Names of the columns of a run's samples: time, reference with its derivatives, feed-forward.
fn columns(model: &dyn Model<f64>) -> Vec<String> {
    let dims = model.dims();
    let mut names = vec!["t_s".to_string()];
    for order in 0..=dims.order {
        for c in 0..dims.coordinates {
            let name = model.coordinate(c).name;
            names.push(if order == 0 { format!("{name}_ref") } else { format!("{name}_ref_d{order}") });
        }
    }
    names.extend((0..dims.inputs).map(|i| format!("{}_ff", model.input(i).name)));
    names
}

/// The samples of a trial as CSV: time (s), reference with its derivatives, feed-forward, in the units of the model.
#[must_use]
pub fn trial_samples(model: &dyn Model<f64>, trial: &Trial) -> String {
    let dims = model.dims();
    let mut text = columns(model).join(",");
    text.push('\n');
    for n in 0..trial.samples() {
        let at = n % trial.samples_per_period;
        // Writing to a string cannot fail.
        let _ = write!(text, "{}", n as f64 * trial.control.sample_time);
        let reference = &trial.reference[at * dims.motion_len()..(at + 1) * dims.motion_len()];
        for value in reference.iter().chain(&trial.feed_forward[at * dims.inputs..(at + 1) * dims.inputs]) {
            let _ = write!(text, ",{value}");
        }
        text.push('\n');
    }
    text
}

/// Reads the trial of a run that was written to files; its period is the whole run. The samples come from `path`, the
/// terms from the file beside it that ends in `.json`, and what the files do not hold from `template`, a trial of the
/// same campaign.
///
/// # Errors
/// [`WireError`] when a file cannot be read or does not fit the model, with its path and what is wrong.
pub fn read_trial(path: &Path, model: &dyn Model<f64>, template: &Trial) -> Result<Trial, WireError> {
    let beside = path.with_extension("json");
    let terms: RunFile = serde_json::from_str(&read(&beside)?).map_err(|error| broken(&beside, error.to_string()))?;
    let dims = model.dims();
    if ![RUN_FILE, EARLIER_RUN_FILE].contains(&terms.schema.as_str()) || terms.model != model.name() {
        let reason = format!("this run belongs to the model {}, not to {}", terms.model, model.name());
        return Err(broken(path, reason));
    }
    let text = read(path)?;
    let mut lines = text.lines();
    if lines.next().unwrap_or_default() != columns(model).join(",") {
        return Err(broken(path, format!("the columns must be {}", columns(model).join(","))));
    }
    let mut trial = template.clone();
    trial.reference.clear();
    trial.feed_forward.clear();
    for (n, line) in lines.enumerate() {
        let values = line.split(',').skip(1).map(str::parse::<f64>).collect::<Result<Vec<f64>, _>>();
        match values {
            Ok(values) if values.len() == dims.motion_len() + dims.inputs => {
                trial.reference.extend_from_slice(&values[..dims.motion_len()]);
                trial.feed_forward.extend_from_slice(&values[dims.motion_len()..]);
            }
            _ => {
                let needed = dims.motion_len() + dims.inputs + 1;
                return Err(broken(path, format!("line {}: {needed} numbers are needed", n + 2)));
            }
        }
    }
    trial.run = terms.run.saturating_sub(1);
    trial.samples_per_period = trial.feed_forward.len() / dims.inputs.max(1);
    trial.periods = 1;
    trial.control.sample_time = terms.sample_time;
    trial.control.gains = terms.gains(model, path)?;
    trial.control.velocity = match terms.smoothing {
        Some(smoothing) => Velocity::Fitted(smoothing),
        None => terms.derivative_filter.map_or(Velocity::Measured, Velocity::Filtered),
    };
    for (c, bound) in trial.tracking_bounds.iter_mut().enumerate() {
        *bound = terms.tracking.get(model.coordinate(c).name).copied().unwrap_or(f64::INFINITY);
    }
    let names = || (0..dims.coordinates).map(|c| model.coordinate(c).name);
    let open = [f64::NEG_INFINITY, f64::INFINITY];
    trial.position_bounds = names().map(|name| terms.positions.get(name).copied().unwrap_or(open).into()).collect();
    trial.velocity_bounds = names().map(|name| terms.velocities.get(name).copied().unwrap_or(f64::INFINITY)).collect();
    Ok(trial)
}
