//! Identification in three lines: from a log, on a simulated machine, on a machine of one's own.
//!
//! ```no_run
//! use tpm_session::{self as session, DeclaredModel};
//!
//! # fn main() -> Result<(), session::SessionError> {
//! let model = DeclaredModel::open("models/emps.tpm")?;
//! let result = session::from_log(&model, "run.csv")?;
//! println!("{result}");
//! # Ok(())
//! # }
//! ```
//!
//! Whatever the data are, the result is one [`Identification`]: parameters with standard deviations, the physical parameters
//! behind lumped ones, what the data do not show, warnings, and what has to be the same for the result to come out the same again.
//! [`from_log`] takes a log, [`on_simulated_plant`] an experiment with a simulated machine, [`on_machine`] an experiment and whoever
//! plays its runs; a [`Session`] is for those who want the steps one by one. [`inspect`](fn@inspect) and [`inspect_for`] look at a log before
//! anything is identified from it.

#[cfg(test)]
mod actuator_tests;
mod against_prior;
mod agreeing;
#[cfg(test)]
mod arm_log;
mod between_stamps;
#[cfg(test)]
mod by_limits_tests;
#[cfg(test)]
mod calibration_tests;
mod campaign;
mod compare;
mod completed;
#[cfg(test)]
mod completed_tests;
mod completing;
#[cfg(test)]
mod contradiction_tests;
mod entry;
mod error;
mod excerpt;
mod excite;
#[cfg(test)]
mod experiment_tests;
#[cfg(test)]
mod fault_tests;
mod folder;
mod found;
mod frames;
mod friction;
mod identification;
mod identify;
#[cfg(test)]
mod input_function_tests;
mod inspect;
mod judge;
mod lines_log;
#[cfg(test)]
mod lines_log_tests;
mod live;
mod log;
mod log_fault;
mod log_report;
mod machine;
mod meaning;
mod method_report;
mod model;
mod options;
#[cfg(test)]
mod other_model_tests;
mod periodic_log;
mod play;
mod pooled_logs;
mod prediction;
mod reading;
mod record;
mod recorded_log;
#[cfg(test)]
mod recorded_log_tests;
mod refine;
mod refine_campaign;
#[cfg(test)]
mod refine_tests;
mod refinement_report;
mod regression;
mod rows;
mod run_lines;
mod sample;
mod samples_log;
#[cfg(test)]
mod samples_log_tests;
mod separable;
#[cfg(test)]
mod separable_tests;
mod settings;
mod simulation;
mod simulation_figure;
mod spelling;
mod summary;
#[cfg(test)]
mod synthetic_tests;
mod templates;
mod term_words;
mod text;
mod tracks;
mod truth;
#[cfg(test)]
mod unseen_tests;
mod validate;
mod warning;
mod whiteness;

pub use self::log::{LogRequest, from_log, from_logs};
pub use agreeing::{Agreeing, AgreeingError, OpenDirection, agreeing};
pub use between_stamps::{BetweenStamps, SensorFollowed};
pub use campaign::{ExperimentRequest, Session, SimulatedMachine, on_machine, on_simulated_plant};
pub use compare::{
    CompareError, Comparison, Difference, Direction, Family, Joint, Side, StoredFault, StoredResult, Verdict, compare,
};
pub use completed::completed;
pub use error::{MachineError, SessionError, Setting};
pub use excite::{ExcitationRequest, ExciteError, ExcitedRun};
pub use folder::{CampaignFolder, NextRun, NextStep, Submission};
pub use frames::{DriveTerms, Frame, Movement};
pub use friction::FrictionCourse;
pub use identification::{Identification, LogFingerprint, Provenance, READABLE_SCHEMAS, SCHEMA, Source};
pub use identify::identify_log;
pub use inspect::{
    ChannelReport, End, Finding, Inspection, Lone, Plateau, Relation, RelationKind, Repeats, Rest, Sampling, inspect,
    inspect_for,
};
pub use log_fault::LogFault;
pub use log_report::{
    ActuatorReport, Calibration, HoldResiduals, LogReport, PeriodicReport, PoolReport, PooledLog, RecordedReport,
    SamplesReport, SensorReport, SpectralReport, UnseenFaultReport, UntestedReport, Way,
};
pub use machine::Machine;
pub use meaning::{About, Concern, Meaning, Severity};
pub use method_report::{
    MethodEntry, MethodLine, MethodReport, MethodRun, MethodSignal, MethodUpdate, ParameterUpdate, Phasor,
};
pub use model::{DeclaredModel, FreeNames, Identifiable, ModelFault, other_kind};
pub use options::LogOptions;
pub use play::{Watch, identify_simulated, play_campaign, play_simulated};
pub use prediction::{Completed, LeftOfForces, Prediction};
pub use reading::RecordSettings;
pub use refinement_report::{LongSimulation, MissingTerm, NotRefined, RateReport, RefinementReport};
pub use regression::{Check, CheckOutcome, Regression, RegressionError, check_against};
pub use sample::{SAMPLE_EXPERIMENT, SAMPLE_MODEL};
pub use settings::{EstimationSettings, USUAL_TIME};
pub use simulation::{ChannelSimulation, Fit, InputNoise, InputTest, Leaving, Simulation};
pub use spelling::{Given, Spelling};
pub use summary::of_campaign;
pub use templates::{Placed, Proposal, Quantity, TEMPLATES, Template, proposals};
pub use text::closed_loop;
pub use validate::{RowCourse, RowPrediction, RowUnpredicted, Validation, evidence, validate, validate_log};
pub use warning::{Data, Exchange, Warning};
pub use whiteness::{CorrelationTest, FALSE_ALARM, LAGS};
