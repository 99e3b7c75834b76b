//! Experiment files: everything about a campaign that is not the model.
//!
//! Invariant: every field is documented here, and unknown fields are refused. Names of parameters, coordinates, inputs
//! and amplitudes are checked against the model when the experiment is resolved ([`Experiment::setup`],
//! [`Experiment::bench`]).
//! Values are in the units of the model; nothing is converted.

mod actuators;
mod error;
mod file;
mod names;
#[cfg(test)]
mod numerical_tests;
mod other;
mod overrides;
mod planned;
#[cfg(test)]
mod plant_tests;
mod prior;
mod resolve;
#[cfg(all(test, feature = "schema"))]
mod schema_tests;

pub use error::ExperimentError;
pub use file::{
    ActuatorSection, ArmSection, ControlSection, DropoutSection, Equations, Experiment, FeedbackSection, LimitsSection,
    MotorsSection, Named, OtherMachine, PlanSection, PlantModelSection, PlantSection, ScheduleSection, SensorSection,
    StabilitySection, StageSection, StrokeSection,
};
pub use overrides::written_value;
pub use planned::ByLimits;
pub use prior::prior_values;
/// Values and tables of an experiment file, with which [`Experiment::set_value`] changes it.
pub use toml::{Table, Value};
