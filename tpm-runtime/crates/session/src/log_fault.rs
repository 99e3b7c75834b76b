//! Why a log gives no estimate.

use tpm_estimate::{EstimateError, RecordedFault};
use tpm_log::{LogError, Mismatch};
use tpm_motion::SpectrumError;
use tpm_report::{Remedy, number};

/// Why a log gives no estimate, with the place and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogFault {
    /// The log cannot be read.
    #[error(transparent)]
    Reading(#[from] LogError),
    /// No stretch of the motion occurs twice.
    #[error(
        "{path}:{from}-{to}: the motion is not periodic within the log: no stretch of it occurs twice; run the machine on a periodic reference \
         and record at least two whole periods after it has settled, or state period and first sample"
    )]
    NoPeriod {
        /// The file.
        path: String,
        /// First data line.
        from: u64,
        /// Last data line.
        to: u64,
    },
    /// No two periods follow each other, or noise hides whether they do.
    #[error("{path}:{from}-{to}: {}", not_periodic(*.period, .mismatch))]
    NotPeriodic {
        /// The file.
        path: String,
        /// First data line of the part that was searched.
        from: u64,
        /// Last data line of the searched part.
        to: u64,
        /// Best period, s; it means nothing where noise explains the mismatch.
        period: f64,
        /// Difference of successive periods.
        mismatch: Mismatch,
    },
    /// The stated period or start does not fit the log.
    #[error("{path}: {what}; the log has {samples} samples of {sample_time} s")]
    BadRange {
        /// The file.
        path: String,
        /// What does not fit.
        what: String,
        /// The setting to change.
        remedy: Remedy,
        /// Samples in the log.
        samples: usize,
        /// Sample time, s.
        sample_time: f64,
    },
    /// A stated calibration that does not reach the parameters.
    #[error(
        "{path}: what an error in the calibration of `{signal}` does to the parameters is known from the lines of the rows of several \
         coordinates, which this log was not identified by; leave its deviation out, and widen those of the parameters by hand"
    )]
    Calibration {
        /// The file.
        path: String,
        /// The coordinate or input.
        signal: String,
    },
    /// The harmonics could not be computed.
    #[error("{path}: {source}")]
    Spectrum {
        /// The file.
        path: String,
        /// The reason.
        source: SpectrumError,
    },
    /// Constants of the model have no value.
    #[error("the model has {needed} constants known at run time ({}), {given} values were given", .names.join(", "))]
    Constants {
        /// Constants of the model.
        needed: usize,
        /// Values given.
        given: usize,
        /// Their names.
        names: Vec<String>,
    },
    /// A record is cut into pieces in which nothing is seen.
    #[error(
        "{path}:{from}-{to}: the record is cut into {segments} pieces, the longest of {longest} samples, too short to show anything; the first cut: {cut}; repair the recording"
    )]
    ShortSegments {
        /// The file.
        path: String,
        /// First line of the pieces.
        from: u64,
        /// Last line of the pieces.
        to: u64,
        /// Pieces.
        segments: usize,
        /// Samples of the longest piece.
        longest: usize,
        /// Why the record is cut there, with its line.
        cut: String,
    },
    /// Harmonics do not lead to values of nonlinear parameters.
    #[error(
        "{path}: harmonics lead the search for {} to no value, since the log hardly repeats; use it in the time domain", .parameters.join(", ")
    )]
    RunsAway {
        /// The file.
        path: String,
        /// The nonlinear parameters.
        parameters: Vec<String>,
    },
    /// The model could not be simulated between the stamps of a record.
    #[error("{path}: {source}")]
    Recorded {
        /// The file.
        path: String,
        /// The reason.
        source: RecordedFault,
    },
    /// What is asked for does not go with a simulation between stamps.
    #[error(
        "{path}: the model is simulated between the stamps of the whole record, since a coordinate is not measured; \
         dynamics of actuators, harmonics, a period or a first sample are not taken into account there; leave them out, or write them into the model"
    )]
    OnlySimulated {
        /// The file.
        path: String,
    },
    /// A coordinate that no sensor measures, and none feels.
    #[error(
        "`{coordinate}` is unmeasured, and no sensor of {path} feels it: {} would be the same whatever it does; measure `{coordinate}` or `dot({coordinate})`, or leave it out of the model",
        .sensors.join(", ")
    )]
    Unfelt {
        /// The file.
        path: String,
        /// The coordinate.
        coordinate: String,
        /// What is measured.
        sensors: Vec<String>,
    },
    /// The parameters could not be estimated.
    #[error("{path}: {source}")]
    Estimate {
        /// The file.
        path: String,
        /// The reason.
        source: EstimateError,
    },
}

/// Why two periods do not count as following each other, and what would help.
fn not_periodic(period: f64, mismatch: &Mismatch) -> String {
    match mismatch.noise {
        Some(noise) => format!(
            "the motion is not periodic as far as can be seen through its noise: {:.1} % (rms) of what was recorded is noise of single samples, \
             from which a motion that repeats cannot be told; state the period and record many, so that the noise is averaged, move further, or measure with less noise",
            100.0 * noise
        ),
        None => format!(
            "the motion is not periodic: the best period found, {} s, leaves {:.1} % between successive periods; run the machine on a periodic \
             reference, record at least two whole periods after it has settled, or state period and first sample",
            number(period),
            100.0 * mismatch.share
        ),
    }
}

impl LogFault {
    /// The setting that would help, when there is one.
    #[must_use]
    pub fn remedy(&self) -> Option<Remedy> {
        match self {
            LogFault::Reading(error) => error.remedy(),
            LogFault::NotPeriodic { .. } | LogFault::NoPeriod { .. } => Some(Remedy::PeriodAndStart),
            LogFault::BadRange { remedy, .. } => Some(remedy.clone()),
            LogFault::RunsAway { .. } => Some(Remedy::TimeDomain),
            LogFault::Constants { names, .. } => Some(Remedy::Constants { names: names.clone() }),
            _ => None,
        }
    }
}
