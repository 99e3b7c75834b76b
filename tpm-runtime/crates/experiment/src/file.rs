//! The sections of an experiment file, and the reading and writing of its text.
//!
//! Invariant: every field has a doc comment, which becomes its description in the JSON schema, and unknown fields are
//! refused.

use crate::error::ExperimentError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use tpm_controller::model::Model;
use tpm_estimate::{Method, NumericalSettings, Refine, Weights};
use tpm_motion::HoldCompensation;
use tpm_motion::smoothing::Smoothing;

/// Values by name, in the units of the model.
pub type Named = BTreeMap<String, f64>;

/// An experiment file (TOML).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Name of the pattern; the model's first one when not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pattern: Option<String>,
    /// The estimator: measured-motion (default), error, hill, effort or numerical.
    #[serde(default)]
    pub estimator: Method,
    /// How much every equation counts in measured-motion: noise (default), or equal, for models that leave something out.
    #[serde(default)]
    pub weights: Weights,
    /// Whether the estimates of measured-motion are refined by simulating the model along the runs: auto (default) where that takes no
    /// long time, output-error however long it takes, none not at all.
    #[serde(default, skip_serializing_if = "Refine::is_default")]
    pub refine: Refine,
    /// How the estimator numerical uses its matrix.
    #[serde(default)]
    pub numerical: NumericalSettings,
    /// Highest harmonic to use; chosen from the spectrum (measured-motion) or the pattern when not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub harmonics: Option<usize>,
    /// Seed of the sensors' noise: the same seed gives the same result.
    #[serde(default)]
    pub seed: u64,
    /// The motors on the inputs: the path of a motor file beside the experiment, or its tables, `[motors.INPUT]`. The
    /// limits of the motors are limits of every run, and the dynamics of their amplifiers count as known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motors: Option<MotorsSection>,
    /// Values of the constants that are known at run time.
    #[serde(default)]
    pub constants: Named,
    /// Estimates before the first run; zero where not given.
    #[serde(default)]
    pub prior: Named,
    /// Parameters held at a value.
    #[serde(default)]
    pub frozen: Named,
    /// Known dynamics between the commanded input and the force, by input: corrected in the harmonics, undone in the
    /// feed-forward, and part of the loop whose stability is checked. Where not given, the dynamics that the motor file
    /// states.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub actuators: BTreeMap<String, ActuatorSection>,
    /// The coordinate that a motor's rotor turns with, by input; where not given, the coordinate that is fed back to
    /// that input.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub motion: BTreeMap<String, String>,
    /// The simulated machine.
    #[serde(default)]
    pub plant: PlantSection,
    /// Feedback and sampling.
    pub control: ControlSection,
    /// Which equations a model with eliminated coordinates is identified from: eliminated (default: the motion of the
    /// remaining coordinates) or own (all coordinates are measured, every equation is a row).
    #[serde(default)]
    pub equations: Equations,
    /// The range of parameters over which the loop must be stable before anything moves.
    #[serde(default)]
    pub stability: StabilitySection,
    /// Limits of the inputs, the tracking error and the motion.
    #[serde(default)]
    pub limits: LimitsSection,
    /// Amplitudes and frequencies, and when to move on.
    pub schedule: ScheduleSection,
    /// Lets the campaign choose its stages by itself within the limits, which are then needed; behind the listed stages, or from the first
    /// one on where none is listed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<PlanSection>,
}

/// What a campaign that chooses its stages by itself is to reach, and in what time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct PlanSection {
    /// Time for which the machine may move in all runs together, s.
    pub time: f64,
    /// Standard deviation that is wanted of a parameter as a share of its value, by name; the campaign ends when all are reached. Without
    /// any it uses its time for all parameters together.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub until: Named,
}

/// Where the motors are described.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum MotorsSection {
    /// In a motor file; whoever reads the experiment reads the motor file too ([`Experiment::set_motors`]).
    File(String),
    /// In the experiment itself, with the tables of a motor file.
    Tables(#[cfg_attr(feature = "schema", schemars(with = "BTreeMap<String, serde_json::Value>"))] toml::Table),
}

/// Dynamics between a commanded input and the force.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct ActuatorSection {
    /// Time by which the command lags, s.
    pub delay: f64,
    /// Undamped natural frequency of a low pass of second order, rad/s; none when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub natural_frequency: Option<f64>,
    /// Quality factor of the low pass; 1/sqrt(2) when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<f64>,
    /// Bandwidth of a current loop, a lag of first order, rad/s; none when not given. A run whose force needs higher harmonics passes
    /// this limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bandwidth: Option<f64>,
    /// Largest magnitude of the force, unit of the input; without a limit when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<f64>,
    /// Largest magnitude of the speed of the coordinate that the actuator moves, unit of the coordinate per second; the actuator drives no
    /// faster. Without a limit when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Largest power into the machine, force times speed; without a limit when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub power: Option<f64>,
}

/// The simulated machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct PlantSection {
    /// True values of all parameters. A model with lumped parameters may be given the physical ones instead
    /// (`Experiment::lumped`).
    pub parameters: Named,
    /// Relative change of a parameter from each run to the next, by name.
    pub drift: Named,
    /// Integration steps per sample.
    pub sub_steps: usize,
    /// Sensors by coordinate; exact where not given.
    pub sensors: BTreeMap<String, SensorSection>,
    /// Step to which the commanded value is rounded by input, unit of the input; continuous where not given.
    pub input_steps: Named,
    /// True dynamics of the actuators by input; the known ones where not given.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub actuators: BTreeMap<String, ActuatorSection>,
    /// The model that the machine obeys, where it is another than the one that is identified: the path of a model file beside the
    /// experiment, or the text of one, `model.text`. It has the same coordinates and inputs in the same order. `parameters` and `drift`
    /// are then of this model.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<PlantModelSection>,
    /// Values of constants that only this model has, or has another value of; the other ones are those of the experiment.
    #[serde(skip_serializing_if = "Named::is_empty")]
    pub constants: Named,
    /// The same model, evaluated.
    #[serde(skip)]
    #[cfg_attr(feature = "schema", schemars(skip))]
    pub(super) machine: Option<OtherMachine>,
    /// The closed-loop arm of Feng, chapter 5, in place of a machine that obeys the model itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closed_loop_arm: Option<ArmSection>,
}

/// Another model with the true values by the names of its own parameters.
#[derive(Clone)]
pub struct OtherMachine {
    pub(super) model: Arc<dyn Model<f64>>,
    pub(super) parameters: Named,
}

impl fmt::Debug for OtherMachine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OtherMachine").field("model", &self.model.name()).field("parameters", &self.parameters).finish()
    }
}

impl PartialEq for OtherMachine {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.model, &other.model) && self.parameters == other.parameters
    }
}

/// The model of a simulated machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum PlantModelSection {
    /// In a model file; whoever reads the experiment puts its text in its place.
    File(String),
    /// In the experiment itself.
    Text {
        /// The text of the model file.
        text: String,
    },
}

/// The links of a closed-loop arm, SI units (Feng, Figure 5.1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ArmSection {
    /// l1 to l5, m.
    pub lengths: [f64; 5],
    /// m12, m3, m4, m56, kg.
    pub masses: [f64; 4],
    /// r1, r3, r4, r5, m.
    pub centroids: [f64; 4],
    /// I12, I3, I4, I56, kg m^2.
    pub inertias: [f64; 4],
    /// Commanded units per N m.
    pub torque_scale: f64,
}

impl Default for PlantSection {
    fn default() -> Self {
        PlantSection {
            parameters: Named::new(),
            drift: Named::new(),
            sub_steps: 1,
            sensors: BTreeMap::new(),
            input_steps: Named::new(),
            actuators: BTreeMap::new(),
            model: None,
            constants: Named::new(),
            machine: None,
            closed_loop_arm: None,
        }
    }
}

/// The sensor of one coordinate.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SensorSection {
    /// Standard deviation of the white noise on every sample, unit of the coordinate.
    pub noise: f64,
    /// Counts of an encoder per turn, of a coordinate that is an angle; zero for none.
    pub counts: f64,
    /// Step of a linear encoder, unit of the coordinate; zero for none. Cannot be combined with `counts`.
    pub step: f64,
    /// Samples by which the measured value lags.
    pub delay: usize,
    /// Standard deviation of the sampling instant, s.
    pub jitter: f64,
    /// Largest magnitude that the sensor reads; zero for no limit.
    pub range: f64,
    /// Standard deviation of the white noise on the rate, unit of the coordinate per second, where a tachometer
    /// measures the rate; no tachometer when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_noise: Option<f64>,
    /// When the sensor drops out; never when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dropout: Option<DropoutSection>,
}

/// When a sensor drops out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct DropoutSection {
    /// Number of the run, from 1.
    pub run: usize,
    /// Time in the run from which the sensor gives no value, s.
    pub time: f64,
}

/// Feedback and sampling.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ControlSection {
    /// Time between samples, s.
    pub sample_time: f64,
    /// Time constant of the filtered difference that forms the rate of the tracking error, s; when not given, the rate
    /// is measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub derivative_filter: Option<f64>,
    /// Time constant of a low pass of the first order that the positions pass before the feedback, s: what it lets through of the tracking
    /// error is fed back, and the rate is formed of it; when not given, there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position_filter: Option<f64>,
    /// How the feed-forward compensates the hold between samples: none, advance (half a sample) or exact (default).
    #[serde(default)]
    pub compensation: HoldCompensation,
    /// Least-squares smoothing in place of the filtered difference: the tracking error and its rate are value and slope
    /// of a polynomial fitted to the last samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<Smoothing>,
    /// Paths of the feedback.
    pub feedback: Vec<FeedbackSection>,
}

/// One path of the feedback: the input gets -kp e - kd e'.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct FeedbackSection {
    /// Input that is driven.
    pub input: String,
    /// Coordinate whose tracking error is fed back.
    pub coordinate: String,
    /// Proportional gain, positive against the error.
    pub kp: f64,
    /// Derivative gain, positive against the rate of the error.
    pub kd: f64,
}

/// Which equations a model with eliminated coordinates is identified from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum Equations {
    /// The equations that remain after the elimination.
    #[default]
    Eliminated,
    /// All equations of the machine, before the elimination.
    Own,
}

/// The range of parameters over which the loop must be stable before anything moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct StabilitySection {
    /// Least and largest value by parameter; a parameter without a range keeps its prior.
    pub range: BTreeMap<String, [f64; 2]>,
    /// Number of random points checked inside the box of these ranges, besides its vertices and edges.
    pub points: usize,
}

impl Default for StabilitySection {
    fn default() -> Self {
        StabilitySection { range: BTreeMap::new(), points: 1000 }
    }
}

/// Limits of the inputs, the tracking error and the motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct LimitsSection {
    /// Largest magnitude by input, at which the simulated drive cuts the command. None where not given.
    pub inputs: Named,
    /// Largest tracking error by coordinate; a run that passes it is aborted. None where not given.
    pub tracking: Named,
    /// Least and largest position by coordinate; no reference passes them, and a run that does is aborted. None where not given.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub positions: BTreeMap<String, [f64; 2]>,
    /// Largest magnitude of the velocity by coordinate; no reference passes it, and a run that does is aborted. None where not
    /// given.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub velocities: Named,
    /// Largest magnitude of the acceleration by coordinate; no reference passes it. None where not given.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub accelerations: Named,
    /// Share of an input's limit at which the campaign ends (Feng uses 0.7).
    pub effort_share: f64,
    /// Factor on the amplitudes after an aborted run.
    pub back_off: f64,
    /// Most aborted runs in succession.
    pub max_aborts: usize,
}

impl Default for LimitsSection {
    fn default() -> Self {
        LimitsSection {
            inputs: Named::new(),
            tracking: Named::new(),
            positions: BTreeMap::new(),
            velocities: Named::new(),
            accelerations: Named::new(),
            effort_share: 0.7,
            back_off: 0.5,
            max_aborts: 3,
        }
    }
}

/// One stage of the schedule: a value for every amplitude of its pattern and for its frequency (rad/s), by name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct StageSection {
    /// Name of the stage's pattern in the model; the experiment's pattern when not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pattern: Option<String>,
    /// Multiple of the frequency by coordinate; the schedule's multiple where not given.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub multiples: BTreeMap<String, u32>,
    /// Rest after every stroke, s; none when not given. Where no strokes are listed they are the two halves of the pattern.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dwell: Option<f64>,
    /// Strokes that are played one after the other, over and over; the pattern itself when empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub strokes: Vec<StrokeSection>,
    /// Amplitudes and frequency.
    #[serde(flatten)]
    pub values: Named,
}

/// One stroke of a stage: a part of a pattern, and a rest after it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct StrokeSection {
    /// Name of the stroke's pattern, with the amplitudes and the frequency of the stage's; the stage's pattern when not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pattern: Option<String>,
    /// Phase at which it starts, in multiples of pi; 0 when not given.
    #[serde(default)]
    pub start: f64,
    /// Phase at which it ends, in multiples of pi; 1 when not given.
    #[serde(default = "half_a_period")]
    pub end: f64,
    /// Rest after it, s; that of the stage when not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dwell: Option<f64>,
}

const fn half_a_period() -> f64 {
    1.0
}

/// Amplitudes and frequencies, and when to move on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ScheduleSection {
    /// Multiple of the frequency at which a coordinate plays its pattern; one where not given.
    #[serde(default)]
    pub multiples: BTreeMap<String, u32>,
    /// Stages, growing; none where the campaign is to choose all of them by itself (`plan`).
    #[serde(default)]
    pub stages: Vec<StageSection>,
    /// Factor on all gains of the feedback, stage by stage; one where not given. Lower gains make the tracking error
    /// larger, and with it the information that the error carries (Feng, 3.2.2). The loop must be stable with every
    /// factor.
    #[serde(default)]
    pub gains: Vec<f64>,
    /// Factor by which every new run multiplies the weight of all earlier runs, for parameters that drift slowly. Below
    /// one the campaign does not end when its last stage has converged, but follows the parameters until its runs are
    /// used.
    #[serde(default = "forgetting")]
    pub forgetting: f64,
    /// Fewest periods that pass before anything is measured; whether the motion has settled is tested as well.
    #[serde(default = "settle_periods")]
    pub settle_periods: usize,
    /// Time measured in every run, s; rounded up to whole periods, four at least.
    pub measure_time: f64,
    /// Most updates in one stage.
    #[serde(default = "updates_per_stage")]
    pub updates_per_stage: usize,
    /// Most runs in the campaign.
    #[serde(default = "max_runs")]
    pub max_runs: usize,
    /// A stage is done when no parameter changed by more than this share, or by more than noise explains.
    #[serde(default = "tolerance")]
    pub tolerance: f64,
    /// Whether a run is played at a lower frequency, down to three quarters, where a harmonic of it would lie near a natural
    /// mode of the estimates (Feng, 3.2.1).
    #[serde(default)]
    pub avoid_modes: bool,
    /// A stage is also done when no harmonic of the tracking error exceeds this, by coordinate.
    #[serde(default)]
    pub error: Named,
}

const fn forgetting() -> f64 {
    1.0
}

const fn settle_periods() -> usize {
    3
}

const fn updates_per_stage() -> usize {
    4
}

const fn max_runs() -> usize {
    40
}

const fn tolerance() -> f64 {
    1e-3
}

impl Experiment {
    /// The JSON schema of an experiment file: what the reader accepts, with the meaning of every field.
    #[cfg(feature = "schema")]
    #[must_use]
    pub fn schema() -> serde_json::Value {
        schemars::schema_for!(Experiment).to_value()
    }

    /// Reads an experiment file's text.
    ///
    /// # Errors
    /// [`ExperimentError::Syntax`] with line and column when the text is no experiment file.
    pub fn parse(text: &str) -> Result<Self, ExperimentError> {
        toml::from_str(text).map_err(|fault: toml::de::Error| {
            let message = std::string::ToString::to_string(&fault);
            let missing = fault.message().strip_prefix("missing field `").and_then(|rest| rest.split('`').next());
            let remedy = match missing {
                None if text.parse::<toml::Table>().is_err() => {
                    "an experiment is TOML, lines such as `sample_time = 0.001` below tables such as [control]".into()
                }
                None => return ExperimentError::Syntax { message },
                Some("control") => {
                    "add [control] with sample_time = SECONDS and feedback = [{ input = \"..\", coordinate = \"..\", kp = .., kd = .. }]".into()
                }
                Some("schedule") => {
                    "add [schedule] with measure_time = SECONDS and stages = [{ AMPLITUDE = .., FREQUENCY = .. }]".into()
                }
                Some(field) => format!("add `{field} = ...` to this table"),
            };
            ExperimentError::Syntax { message: format!("{}; {remedy}", message.trim_end()) }
        })
    }

    /// The text of the experiment as a file, with all defaults written out.
    ///
    /// # Errors
    /// [`ExperimentError::Syntax`] when a value cannot be written in TOML.
    pub fn text(&self) -> Result<String, ExperimentError> {
        toml::to_string(self)
            .map_err(|fault| ExperimentError::Syntax { message: std::string::ToString::to_string(&fault) })
    }
}
