//! Faults of a log that cannot be read.

use crate::options::{TIME, rate_of};
use std::fmt;
use tpm_report::{Remedy, number};

/// Most columns that a message lists.
const MOST_LISTED_COLUMNS: usize = 60;
/// Most characters of a name in that list.
const LONGEST_NAME: usize = 80;

/// A setting that a user may give for the column of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Adjustment {
    /// The column's name.
    Column,
    /// A factor on the column.
    Scale,
    /// A value that is added after the factor.
    Offset,
}

impl fmt::Display for Adjustment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Adjustment::Column => "column",
            Adjustment::Scale => "scale",
            Adjustment::Offset => "offset",
        })
    }
}

/// A unit that is not converted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "column `{column}` is in `{unit}`, and `{name}` in {expected}: {reason}; state the factor from one to the other"
)]
pub struct UnitMismatch {
    /// The column.
    pub column: String,
    /// Its unit, as the file writes it.
    pub unit: String,
    /// The signal of the model.
    pub name: String,
    /// Unit of the signal.
    pub expected: String,
    /// Why the one is not converted to the other.
    pub reason: &'static str,
}

/// A file in which a column was looked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LookedIn {
    /// What the file is.
    pub kind: String,
    /// Its columns.
    pub available: Vec<String>,
    /// Those of them that have the unit of the signal's rate.
    pub rates: Vec<String>,
    /// What may be meant.
    pub guess: Remedy,
}

impl LookedIn {
    /// What is asked for a signal before anything is known of its column.
    pub(super) fn no_guess(signal: &str) -> Remedy {
        Remedy::Columns { columns: vec![(signal.into(), String::new())], timeless: false }
    }
}

/// Why a log cannot be read, with the place and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file cannot be read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file is not UTF-8 text in columns of CSV.
    #[error("{path}:{line}: {message}")]
    Csv {
        /// The file.
        path: String,
        /// Line in the file, from 1.
        line: u64,
        /// What is wrong.
        message: String,
    },
    /// A signal of the model has no column.
    #[error("{path}:{line}: {}; the file is {}, and {}{}", lacks(.name, .column), .file.kind, columns(&.file.available), of_rate(.name, &.file.rates))]
    MissingColumn {
        /// The file.
        path: String,
        /// Line of the header.
        line: u64,
        /// The signal of the model.
        name: String,
        /// The column that was looked for.
        column: String,
        /// What it was looked for in.
        file: Box<LookedIn>,
    },
    /// Several columns may be meant.
    #[error("{path}:{line}: {} may be {}; say which", if name == TIME { "the time".to_owned() } else { format!("`{name}`") }, .columns.iter().map(|column| format!("`{column}`")).collect::<Vec<_>>().join(" or "))]
    AmbiguousColumn {
        /// The file.
        path: String,
        /// Line of the header.
        line: u64,
        /// The signal of the model.
        name: String,
        /// The columns that may be meant.
        columns: Vec<String>,
        /// One way to say it, with the columns of all signals that have none.
        guess: Box<Remedy>,
    },
    /// A column has a unit that is not converted to that of its signal.
    #[error("{path}:{line}: {mismatch}")]
    Unit {
        /// The file.
        path: String,
        /// Line of the header.
        line: u64,
        /// The two units.
        mismatch: Box<UnitMismatch>,
    },
    /// A column is of counts, whose size nothing states.
    #[error(
        "{path}:{line}: column `{column}` states no unit and has whole numbers alone, from {} to {}, as counts of an encoder are; state the \
         factor from one to {unit}, such as 2*pi/4096, or 1 where it is in {unit}",
        number(.range[0]), number(.range[1])
    )]
    Counts {
        /// The file.
        path: String,
        /// Line of the header.
        line: u64,
        /// The column.
        column: String,
        /// The signal of the model.
        signal: String,
        /// Its unit.
        unit: String,
        /// Least and largest reading.
        range: [f64; 2],
    },
    /// The unit of the time stamps is not stated, and cannot be inferred.
    #[error(
        "{path}:{line}: column `{column}` states no unit, and time advances by {step} from row to row, which may be in several units; state the factor to seconds, such as 0.001 for milliseconds"
    )]
    TimeUnit {
        /// The file.
        path: String,
        /// Line of the header.
        line: u64,
        /// The column of the time.
        column: String,
        /// The usual step.
        step: f64,
    },
    /// The file is of a format that is not read.
    #[error("{path}: {what}; {remedy}")]
    Format {
        /// The file.
        path: String,
        /// What the file is.
        what: String,
        /// What to do.
        remedy: String,
    },
    /// No stretch of the record is long enough.
    #[error(
        "{path}:{from}-{to}: missing fields or jumps of time cut the {rows} rows into pieces, of which none has {needed}; the longest has {longest}; the first cut is at line {cut}: {why}"
    )]
    NoSegment {
        /// The file.
        path: String,
        /// First line of numbers.
        from: u64,
        /// Last line of numbers.
        to: u64,
        /// Rows in the file.
        rows: usize,
        /// Rows that a stretch needs.
        needed: usize,
        /// Rows of the longest stretch.
        longest: usize,
        /// Line of the first cut.
        cut: u64,
        /// What cuts the record there, and what to do.
        why: String,
    },
    /// A setting names something that the model does not have.
    #[error("{adjustment} of `{name}`: the model has no coordinate or input `{name}`; it has {}", .available.join(", "))]
    UnknownName {
        /// The setting that was given.
        adjustment: Adjustment,
        /// The unknown name.
        name: String,
        /// What the model has.
        available: Vec<String>,
    },
    /// A setting names a column that the file does not have, or renames one although there is no model.
    #[error("{adjustment} of `{name}`: without a model columns keep their names, and `t_s` is the time; {}", columns(.available))]
    UnknownColumn {
        /// The setting that was given.
        adjustment: Adjustment,
        /// The name.
        name: String,
        /// The columns of the file.
        available: Vec<String>,
    },
    /// A scale or an offset is not a usable number.
    #[error("{adjustment} of `{name}` = {value}: the value must be finite{}", if *.adjustment == Adjustment::Scale { " and not zero" } else { "" })]
    Unusable {
        /// The setting that was given.
        adjustment: Adjustment,
        /// The signal.
        name: String,
        /// The value given.
        value: f64,
    },
    /// A stated sample time is not usable.
    #[error("sample time of {seconds} s: the time from row to row must be finite and above zero")]
    SampleTime {
        /// The time that was given, s.
        seconds: f64,
    },
    /// A sample time is stated, and settings for a column of time too.
    #[error("a sample time is stated, so that no column of time is read, and settings of `t_s` too; state one of both")]
    TwoTimes,
    /// A date stands where a number is needed, or a factor is stated for dates.
    #[error("{path}:{line}: column `{column}` holds dates, which {why}")]
    Dates {
        /// The file.
        path: String,
        /// Line of the header.
        line: u64,
        /// The column.
        column: String,
        /// Why they are not read, and what to do.
        why: &'static str,
    },
    /// An input does not stand alone where rows are asked for without the inputs.
    #[error(
        "an input of the model stands in a function, beside the motion or with a gain of its own: {path} is read for its parameters and to validate them (`tpm identify`, `tpm validate`); what else is asked for needs inputs that stand alone"
    )]
    InputInside {
        /// The file.
        path: String,
    },
    /// A coordinate that no sensor measures stands where all have to be measured.
    #[error(
        "`{coordinate}` of the model is unmeasured: {path} is read for its parameters and to validate them (`tpm identify`, `tpm validate`); what else is asked for needs a column of every coordinate, declare it as `coordinate` for that"
    )]
    Unmeasured {
        /// The file.
        path: String,
        /// The coordinate.
        coordinate: String,
    },
    /// Friction builds up after reversals of a motion that is simulated between its stamps.
    #[error(
        "`{coordinate}` of the model is friction that builds up after a reversal, and {path} asks for a simulation between its stamps, which does not follow that: measure the position of every coordinate, or take the model without it"
    )]
    BuildsUp {
        /// The file.
        path: String,
        /// The coordinate.
        coordinate: String,
    },
    /// A column has no number at all.
    #[error(
        "{path}:{line}: the column of `{signal}` has no number in any row; name another column, or leave the signal out of the model"
    )]
    NoReading {
        /// The file.
        path: String,
        /// Line of the header.
        line: u64,
        /// The signal.
        signal: String,
    },
    /// Two signals were never read at the same time.
    #[error(
        "{path}:{line}: `{earlier}` and `{later}` share no time: the one ends {} s after the first stamp of the file, the other begins after {} s; \
         they are of two recordings, or their clocks differ: record both by one clock, or add the difference to one of the times",
        number(*.until), number(*.from)
    )]
    NoSharedTime {
        /// The file.
        path: String,
        /// Line of the header.
        line: u64,
        /// Column that ends first.
        earlier: String,
        /// Column that begins last.
        later: String,
        /// When the one ends, s after the first stamp.
        until: f64,
        /// When the other begins, s after the first stamp.
        from: f64,
    },
    /// A reading fills the range at which it may wrap, and moves too far in a sample for a wrap to be told from motion.
    #[error(
        "{path}:{line}: `{signal}` stays within {}, at which an angle wraps around, and moves by {} from one reading to the next: \
         whether that is a wrap or motion cannot be told from less than four readings a turn; read it more often, or record it without wraps",
        number(*.range), number(*.change)
    )]
    WrapUntold {
        /// The file.
        path: String,
        /// Line of a reading after such a change.
        line: u64,
        /// The signal.
        signal: String,
        /// The range.
        range: f64,
        /// The change, less whole ranges.
        change: f64,
    },
    /// Time goes back for good.
    #[error(
        "{path}:{line}: time goes back by {} s, so that another recording begins there or the clock was set; split the file there",
        number(*.seconds)
    )]
    BackForGood {
        /// The file.
        path: String,
        /// Line of the first stamp of the other recording.
        line: u64,
        /// By how much, s.
        seconds: f64,
    },
    /// A line has more or fewer fields than the header.
    #[error(
        "{path}:{line}: {found} fields, the header has {expected}; {}",
        if *.quote { "a quote is opened there and not closed" } else { "every line needs all columns" }
    )]
    FieldCount {
        /// The file.
        path: String,
        /// Line in the file.
        line: u64,
        /// Fields in the line.
        found: u64,
        /// Fields in the header.
        expected: u64,
        /// Whether a quote is opened in the line and not closed.
        quote: bool,
    },
    /// A field is empty: one column is shorter than the others.
    #[error(
        "{path}:{line}: column `{column}` is empty; columns of different lengths cannot be used, cut the log before this line"
    )]
    Empty {
        /// The file.
        path: String,
        /// Line in the file.
        line: u64,
        /// The column.
        column: String,
    },
    /// A field is not a finite number.
    #[error(
        "{path}:{line}: column `{column}` holds `{text}`, not a finite number; cut the log around it or repair the recording"
    )]
    NotANumber {
        /// The file.
        path: String,
        /// Line in the file.
        line: u64,
        /// The column.
        column: String,
        /// The text of the field.
        text: String,
    },
    /// Time does not advance evenly.
    #[error("{path}:{line}: {}", uneven(*.step, *.expected))]
    Jitter {
        /// The file.
        path: String,
        /// Line in the file.
        line: u64,
        /// Time from the line before, s.
        step: f64,
        /// Sample time, s.
        expected: f64,
    },
    /// Time stamps drift away from an even grid.
    #[error(
        "{path}:{line}: the time stamp is {deviation:e} s away from an even grid of {expected} s; the clock drifts, resample the log evenly first"
    )]
    Drift {
        /// The file.
        path: String,
        /// Line in the file.
        line: u64,
        /// Deviation, s.
        deviation: f64,
        /// Sample time, s.
        expected: f64,
    },
    /// The log has too few samples to be analysed.
    #[error(
        "{path}:{line}: the log ends after {samples} samples; {needed} are needed at least, record two whole periods or more"
    )]
    TooShort {
        /// The file.
        path: String,
        /// Last line in the file.
        line: u64,
        /// Samples in the log.
        samples: usize,
        /// Samples needed.
        needed: usize,
    },
    /// A signal never changes.
    #[error(
        "{path}:{from}-{to}: column `{column}` is {value} throughout; is it the right column, or was the sensor disconnected?"
    )]
    Constant {
        /// The file.
        path: String,
        /// First data line.
        from: u64,
        /// Last data line.
        to: u64,
        /// The signal of the model.
        signal: String,
        /// The column.
        column: String,
        /// Its value.
        value: f64,
    },
}

/// What a file lacks.
fn lacks(name: &str, column: &str) -> String {
    match (name == TIME, name == column) {
        (true, true) => "no column is recognised as the time".into(),
        (true, false) => format!("there is no column `{column}` for the time"),
        (false, true) => format!("there is no column `{name}`"),
        (false, false) => format!("there is no column `{column}` for `{name}`"),
    }
}

/// The columns of a file, as a message lists them.
fn columns(available: &[String]) -> String {
    if available.iter().all(String::is_empty) {
        return "it has no columns, is it the right one?".into();
    }
    let mut shown: Vec<String> =
        available.iter().take(MOST_LISTED_COLUMNS).map(|name| name.chars().take(LONGEST_NAME).collect()).collect();
    if available.len() > shown.len() {
        shown.push(format!("and {} more", available.len() - shown.len()));
    }
    format!("the columns are {}; name the right one", shown.join(", "))
}

/// Columns that may be the rate of a signal that has none of its own.
fn of_rate(name: &str, rates: &[String]) -> String {
    if rates.is_empty() {
        return String::new();
    }
    let shown: Vec<String> = rates.iter().take(MOST_LISTED_COLUMNS).map(|column| format!("`{column}`")).collect();
    format!(", or that of its rate, `{}`, which {} may be", rate_of(name), shown.join(" or "))
}

/// What is wrong with a step of the time, and what to do.
fn uneven(step: f64, expected: f64) -> String {
    if expected > 0.0 {
        let off = 100.0 * (step / expected - 1.0);
        return format!(
            "time advances by {step} s here, by {expected} s elsewhere ({off:.3} % off); resample the log evenly with its true time stamps first"
        );
    }
    if expected < 0.0 {
        return "time goes back from row to row; sort the rows by time, or name the right column of the time".into();
    }
    "time stands still from row to row; name the right column of the time".into()
}

impl LogError {
    /// The setting that would help, when there is one.
    #[must_use]
    pub fn remedy(&self) -> Option<Remedy> {
        match self {
            LogError::MissingColumn { file, .. } => Some(file.guess.clone()),
            LogError::AmbiguousColumn { guess, .. } => Some((**guess).clone()),
            LogError::Constant { signal, .. } | LogError::NoReading { signal, .. } => {
                Some(Remedy::MapColumn { signal: signal.clone() })
            }
            LogError::Counts { signal, .. } => Some(Remedy::Scale { signal: signal.clone() }),
            LogError::Unit { mismatch, .. } => Some(Remedy::Scale { signal: mismatch.name.clone() }),
            LogError::Jitter { expected, .. } if *expected <= 0.0 => Some(Remedy::MapColumn { signal: "t_s".into() }),
            LogError::TimeUnit { .. } => Some(Remedy::Scale { signal: "t_s".into() }),
            _ => None,
        }
    }
}
