//! The terms of a run, for a program that plays it without this library: feedback, limits, timing.
//!
//! ```text
//! u[n] = u_ff[n] - sum over paths ( kp e[n] + kd v[n] ),      e[n] = q[n] - q_ref[n]
//! ```

use crate::feedback::Velocity;
use crate::smoothing::Smoothing;
use crate::trial::Trial;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use tpm_controller::control::{Differentiator, Gain};
use tpm_controller::model::Model;

/// Schema of the terms of a run as they are written.
pub const RUN_FILE: &str = "tpm.play/2";

/// One path of the feedback of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct GainManifest {
    /// Name of the input that is driven.
    pub input: String,
    /// Name of the coordinate whose tracking error is fed back.
    pub coordinate: String,
    /// Proportional gain.
    pub kp: f64,
    /// Derivative gain.
    pub kd: f64,
}

impl GainManifest {
    /// The paths of the feedback, with inputs and coordinates by name.
    #[must_use]
    pub fn all(model: &dyn Model<f64>, gains: &[Gain<f64>]) -> Vec<Self> {
        let named = |gain: &Gain<f64>| GainManifest {
            input: model.input(gain.input).name.to_string(),
            coordinate: model.coordinate(gain.coordinate).name.to_string(),
            kp: gain.proportional,
            kd: gain.derivative,
        };
        gains.iter().map(named).collect()
    }
}

/// The terms of a run: its timing, the law of the feedback, and the limits and bounds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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
    /// Time constant of the low pass of positions before the feedback, s; nothing where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position_filter: Option<f64>,
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
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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

impl RunFile {
    /// The JSON schema of the terms of a run, with the meaning of every field.
    #[cfg(feature = "schema")]
    #[must_use]
    pub fn schema() -> serde_json::Value {
        schemars::schema_for!(RunFile).to_value()
    }

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
            position_filter: control.low_pass_time(),
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
                error: match control.position_pole() {
                    0.0 => "e[n] = q[n] - q_ref[n]".to_string(),
                    a => format!(
                        "e[n] = a e[n-1] + (1 - a) (q[n] - q_ref[n]) with a = {a}; e[-1] = q[0] - q_ref[0]; bounds hold for q[n] - q_ref[n]"
                    ),
                },
                rate: Rate::of(control.velocity, control.sample_time),
                saturation: "the sum is cut at the limit of its input; the log holds what was applied".to_string(),
            }),
        }
    }
}
