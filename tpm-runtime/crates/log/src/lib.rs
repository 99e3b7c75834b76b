//! Logs of real machines: reading them, splitting them where they have gaps, and finding the part that repeats.
//!
//! A file of any format is a table of named columns (`columns`). The columns are assigned to signals in one place
//! (`names`), and the rows become a [`Recording`] of evenly sampled segments, each a [`Log`].
//!
//! Invariant: nothing about a log is assumed silently. Columns, sample time, period, steady part, hold and harmonics
//! are read or found, checked, and reported with the result; every fault is an error that names the line.

mod answers;
mod as_recorded;
mod assumption;
mod columns;
mod computed;
mod csv;
mod cursor;
mod dates;
mod dialect;
mod error;
mod expression;
mod fingerprint;
mod format;
mod guess;
mod joins;
mod joint_state;
mod json;
mod lone;
mod long;
mod mat;
#[cfg(feature = "mat73")]
mod mat73;
#[cfg(feature = "mcap")]
mod mcap;
mod names;
mod npy;
mod options;
mod own_times;
mod packed;
mod paired;
#[cfg(feature = "parquet")]
mod parquet;
mod paths;
mod periodic;
mod read;
#[cfg(test)]
mod reading_tests;
#[cfg(test)]
mod recorded_tests;
mod recorders;
mod recording;
mod refill;
mod repeated;
mod report;
mod resample;
mod rosbag;
mod shared_rows;
mod source;
mod sqlite;
mod stamps;
mod steps;
mod stored;
mod survey;
mod table;
mod times;
mod track;
mod unit;
mod wpilog;
mod wraps;

pub use as_recorded::{AsRecorded, ChannelReadings, Lone};
pub use assumption::{Assumption, Separator};
pub use error::{Adjustment, LogError, LookedIn, UnitMismatch};
pub use fingerprint::fingerprint;
pub use lone::lone_readings;
pub use options::ReadingSettings;
pub use periodic::differs;
pub use periodic::{Mismatch, Periodic, PeriodicFault, find_periodic};
pub use read::{Log, Rates};
pub use read::{acceleration_column, rate_column, rates_alone};
pub use recording::Recording;
pub use refill::InterpolationError;
pub use report::{Bridged, Cut, Jitter, LeftOut, ReadingReport, Repeated, SegmentReport, Unevenness, Why, Wrapped};

pub use source::{InMemory, LogSource, Samples};
pub use steps::Steps;
pub use survey::{Role, Survey, Surveyed};
pub use table::Unread;
pub use track::{Track, TrackFormat};
pub use unit::unit_of;
