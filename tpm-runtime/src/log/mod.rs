//! Logs of real machines: reading them, and finding the part that repeats.
//!
//! Invariant: nothing about a log is assumed silently. Columns, sample time, period, steady part, hold and harmonics
//! are read or found, checked, and reported with the result; every fault is an error that names the line.

mod error;
mod fingerprint;
mod lone;
mod periodic;
mod read;

pub use error::{Adjustment, LogError};
pub(crate) use fingerprint::FingerprintReader;
pub use fingerprint::fingerprint;
pub use periodic::{Mismatch, Periodic, PeriodicFault, find_periodic};
pub(crate) use read::rate_column;
pub use read::{Domain, Log, LogOptions, Rates, Refine};
