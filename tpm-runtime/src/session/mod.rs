//! Identification from a log, and on a simulated machine.

mod log;
#[cfg(feature = "interpret")]
mod machine;
#[cfg(test)]
mod measured_tests;
mod simulated;
#[cfg(test)]
mod synthetic_tests;
mod validate;

pub use self::log::{ActuatorReport, HoldResiduals, Identification, LogReport, identify_log};
#[cfg(feature = "interpret")]
pub use machine::{Machine, MachineError};
pub use simulated::{CampaignIdentification, Watch, identify_simulated, play_campaign, summary};
pub use validate::{RowPrediction, Validation, validate_log};
