//! Logs of real machines: reading, finding the periodic part, identifying from it.
//!
//! Invariant: nothing about a log is assumed silently. Columns, sample time, period, steady part, hold and harmonics are
//! read or found, checked, and reported with the result; what is not right is an error that names the line.

mod error;
mod identify;
#[cfg(test)]
mod measured_tests;
mod periodic;
mod read;
#[cfg(test)]
mod synthetic_tests;
mod validate;

pub use error::LogError;
pub use identify::{ActuatorReport, HoldResiduals, Identification, LogReport, identify_log};
pub use periodic::{Periodic, find_periodic};
pub(crate) use read::rate_column;
pub use read::{Log, LogOptions, Rates};
pub use validate::{RowPrediction, Validation, validate_log};
