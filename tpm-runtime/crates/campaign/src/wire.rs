//! The files that the user of a machine exchanges with a campaign.
//!
//! A run is exported as two files: its samples (CSV, one row per sample: time, reference with its derivatives,
//! feed-forward) and, beside them, its terms ([`RunFile`], JSON): feedback, limits, timing. The user submits the
//! recorded motion as a log.
//!
//! Invariant: numbers are written with enough digits to be read back exactly, so that a run that goes through files
//! equals one that stays in memory.

use std::fmt::Write as _;
use std::path::Path;
use tpm_controller::control::Gain;
use tpm_controller::model::Model;
use tpm_motion::{GainManifest, RUN_FILE, RunFile, Trial, Velocity};

/// The earlier schema, which has neither feedback law nor timing. Files of this schema can still be read.
const EARLIER_RUN_FILE: &str = "tpm.play/1";

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

/// The feedback gains in a run's terms, with inputs and coordinates by index.
///
/// # Errors
/// [`WireError::Broken`] when a name is not one of the model's.
fn gains(terms: &RunFile, model: &dyn Model<f64>, path: &Path) -> Result<Vec<Gain<f64>>, WireError> {
    let dims = model.dims();
    let gain = |gain: &GainManifest| {
        let input = (0..dims.inputs).find(|&i| model.input(i).name == gain.input);
        let coordinate = (0..dims.coordinates).find(|&c| model.coordinate(c).name == gain.coordinate);
        let (Some(input), Some(coordinate)) = (input, coordinate) else {
            let reason = format!("feedback of {} to {}: the model has no such signals", gain.coordinate, gain.input);
            return Err(broken(path, reason));
        };
        Ok(Gain { input, coordinate, proportional: gain.kp, derivative: gain.kd })
    };
    terms.feedback.iter().map(gain).collect()
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

/// The samples of a trial as named columns: time (s), reference with its derivatives, feed-forward, in the units of the
/// model.
#[must_use]
pub fn trial_columns(model: &dyn Model<f64>, trial: &Trial) -> Vec<(String, Vec<f64>)> {
    let names = columns(model);
    let mut all: Vec<(String, Vec<f64>)> =
        names.into_iter().map(|name| (name, Vec::with_capacity(trial.samples()))).collect();
    for n in 0..trial.samples() {
        for ((_, column), value) in all.iter_mut().zip(sample(model, trial, n)) {
            column.push(value);
        }
    }
    all
}

/// The samples of a trial as CSV: time (s), reference with its derivatives, feed-forward, in the units of the model.
#[must_use]
pub fn trial_samples(model: &dyn Model<f64>, trial: &Trial) -> String {
    let mut text = columns(model).join(",");
    text.push('\n');
    for n in 0..trial.samples() {
        for (column, value) in sample(model, trial, n).enumerate() {
            let separator = if column == 0 { "" } else { "," };
            // Writing to a string cannot fail.
            let _ = write!(text, "{separator}{value}");
        }
        text.push('\n');
    }
    text
}

/// A sample of a trial, in the order of the columns.
fn sample<'a>(model: &dyn Model<f64>, trial: &'a Trial, n: usize) -> impl Iterator<Item = f64> + 'a {
    let (dims, at) = (model.dims(), n % trial.samples_per_period);
    let reference = &trial.reference[at * dims.motion_len()..(at + 1) * dims.motion_len()];
    let feed_forward = &trial.feed_forward[at * dims.inputs..(at + 1) * dims.inputs];
    std::iter::once(n as f64 * trial.control.sample_time).chain(reference.iter().chain(feed_forward).copied())
}

/// Reads the trial of a run that was written to files; its period is the whole run. The samples are read from `path`
/// and the terms from the file beside it that ends in `.json`. Whatever the files do not hold is taken from `template`,
/// a trial of the same campaign.
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
    trial.control.gains = gains(&terms, model, path)?;
    trial.control.velocity = match terms.smoothing {
        Some(smoothing) => Velocity::Fitted(smoothing),
        None => terms.derivative_filter.map_or(Velocity::Measured, Velocity::Filtered),
    };
    trial.control.position_filter = terms.position_filter.unwrap_or(0.0);
    for (c, bound) in trial.tracking_bounds.iter_mut().enumerate() {
        *bound = terms.tracking.get(model.coordinate(c).name).copied().unwrap_or(f64::INFINITY);
    }
    let names = || (0..dims.coordinates).map(|c| model.coordinate(c).name);
    let open = [f64::NEG_INFINITY, f64::INFINITY];
    trial.position_bounds = names().map(|name| terms.positions.get(name).copied().unwrap_or(open).into()).collect();
    trial.velocity_bounds = names().map(|name| terms.velocities.get(name).copied().unwrap_or(f64::INFINITY)).collect();
    Ok(trial)
}
