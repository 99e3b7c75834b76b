//! Assumptions that were made in reading a log.

use serde::Serialize;
use std::fmt;
use tpm_report::number;

/// The separator between the fields of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Separator {
    /// A comma.
    Comma,
    /// A semicolon.
    Semicolon,
    /// A tabulator.
    Tab,
    /// Any number of blanks and tabulators.
    Space,
}

impl fmt::Display for Separator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Separator::Comma => "commas",
            Separator::Semicolon => "semicolons",
            Separator::Tab => "tabulators",
            Separator::Space => "blanks",
        })
    }
}

/// An assumption about a file: something that it does not state, or that differs from the plainest format, and how it
/// was read.
///
/// The plainest format separates fields by commas. It has a column `t_s` in seconds and a column for every signal, with
/// the signal's name and in the model's unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Assumption {
    /// Fields are not separated by commas.
    Separator {
        /// The separator.
        separator: Separator,
    },
    /// Fractions begin with a comma.
    DecimalComma,
    /// Lines of comment.
    Comments {
        /// How many there are.
        count: u64,
        /// Line of the first.
        first: u64,
    },
    /// Lines of text above the header that are no comments.
    Preamble {
        /// How many there are.
        count: u64,
        /// Line of the header.
        header: u64,
    },
    /// The names of the columns stand in a comment.
    HeaderInComment {
        /// Its line.
        line: u64,
    },
    /// The file has no header: columns are named by their number.
    NumberedColumns {
        /// How many there are.
        columns: usize,
    },
    /// The header is not UTF-8, and was read as Latin-1.
    Latin1Header {
        /// Its line.
        line: u64,
    },
    /// A row below the header has the units of the columns.
    UnitsRow {
        /// Its line.
        line: u64,
    },
    /// The last line was cut short while it was written.
    CutLine {
        /// The line.
        line: u64,
    },
    /// Lines of text between rows, which are left out.
    TextBetweenRows {
        /// How many there are.
        count: u64,
        /// Line of the first.
        first: u64,
    },
    /// Rows have fewer fields than the header.
    ShortRows {
        /// How many there are.
        count: u64,
        /// Line of the first.
        first: u64,
    },
    /// Lines of a recorder that are of no kind which is known.
    NotRead {
        /// What the file is.
        recorder: &'static str,
        /// How many there are.
        count: u64,
        /// Line of the first.
        first: u64,
    },
    /// Columns of one name, which are told apart by a number.
    RepeatedName {
        /// The name.
        column: String,
        /// How many columns have it.
        count: usize,
    },
    /// The stamps are dates with times of day.
    Dates {
        /// The column.
        column: String,
    },
    /// The file has no time: rows are taken as evenly spaced by a stated time.
    SampleTime {
        /// Time from row to row, s.
        seconds: f64,
    },
    /// The file has no column of time, and one with the time from row to row.
    Step {
        /// The column.
        column: String,
        /// Time from row to row, s.
        seconds: f64,
    },
    /// A column of whole numbers was taken for counts by the rate beside it.
    Counts {
        /// The signal.
        signal: String,
        /// The column.
        column: String,
        /// One count, in the signal's unit.
        factor: f64,
    },
    /// The file has no time, which what is read does not depend on.
    Timeless,
    /// A signal was found in a column of another name, or converted.
    Column {
        /// The signal.
        signal: String,
        /// The column.
        column: String,
        /// Unit of the column, where it states one.
        unit: Option<String>,
        /// Unit of the signal in the model, where it has one.
        model_unit: Option<String>,
        /// Factor from the column to the signal.
        factor: f64,
    },
    /// A stated factor replaces the unit of a column.
    FactorForUnit {
        /// The signal.
        signal: String,
        /// The column.
        column: String,
        /// Unit of the column, which was not converted.
        unit: String,
        /// The stated factor.
        factor: f64,
    },
    /// The time is not a column `t_s` in seconds.
    Time {
        /// The column, or both columns.
        column: String,
        /// The unit.
        unit: String,
        /// Whether the file states the unit; otherwise it was inferred from the size of the stamps and of their steps.
        stated: bool,
    },
    /// Channels were recorded at times of their own.
    OwnTimes {
        /// The column whose rows are used.
        reference: String,
        /// Columns that stay at their last reading; the others are interpolated.
        held: Vec<String>,
    },
    /// Stamps repeat the one before, and the next one comes so much later that the rows were written evenly.
    StaleStamps {
        /// How many there are.
        count: usize,
        /// Line of the first.
        first: u64,
    },
    /// Fields of a measured rate are missing in a stretch of the record, where the rate is not used.
    RateLeftOut {
        /// The rate.
        signal: String,
        /// First line of the stretch.
        from_line: u64,
        /// Last line of the stretch.
        to_line: u64,
    },
}

impl fmt::Display for Assumption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Assumption::Separator { separator } => write!(f, "fields are separated by {separator}"),
            Assumption::DecimalComma => f.write_str("decimal commas"),
            Assumption::Comments { count: 1, first } => write!(f, "line {first} is a comment"),
            Assumption::Comments { count, first } => write!(f, "{count} lines are comments, the first is line {first}"),
            Assumption::Preamble { count, header } => {
                write!(f, "the header is line {header}; {count} lines of text above it are not used")
            }
            Assumption::HeaderInComment { line } => write!(f, "the comment in line {line} names the columns"),
            Assumption::NumberedColumns { columns } => {
                write!(f, "there is no header; columns are called 1 to {columns}")
            }
            Assumption::Latin1Header { line } => write!(f, "the header in line {line} is not UTF-8, read as Latin-1"),
            Assumption::UnitsRow { line } => write!(f, "line {line} has the units of the columns"),
            Assumption::CutLine { line } => {
                write!(f, "line {line}, the last one, was cut short while it was written, and is not used")
            }
            Assumption::TextBetweenRows { count: 1, first } => {
                write!(f, "line {first} is text between rows; it is left out, and the record is split there")
            }
            Assumption::TextBetweenRows { count, first } => write!(
                f,
                "{count} lines are text between rows, the first is line {first}; they are left out, and the record is split there"
            ),
            Assumption::ShortRows { count: 1, first } => {
                write!(
                    f,
                    "line {first} has fewer fields than the header; it is left out, and the record is split there"
                )
            }
            Assumption::ShortRows { count, first } => write!(
                f,
                "{count} rows have fewer fields than the header, the first is line {first}: in rows that go on so the last columns are blank, others are left out, and the record is split there"
            ),
            Assumption::NotRead { recorder, count: 1, first } => {
                write!(f, "line {first} is not read: it has no form that {recorder} has")
            }
            Assumption::NotRead { recorder, count, first } => {
                write!(
                    f,
                    "{count} lines are not read, the first is line {first}: they have no form that {recorder} has"
                )
            }
            Assumption::RepeatedName { column, count } => {
                write!(
                    f,
                    "{count} columns are called `{column}`; from left to right they are `{column}`, `{column}.2`"
                )?;
                if *count > 2 { write!(f, " up to `{column}.{count}`") } else { Ok(()) }
            }
            Assumption::Dates { column } => {
                write!(f, "time is column `{column}`, dates and times of day; it is counted from the first one")
            }
            Assumption::SampleTime { seconds } => {
                write!(f, "rows are taken as {} s apart, as stated; no column of time is read", number(*seconds))
            }
            Assumption::Step { column, seconds } => {
                write!(f, "rows are taken as {} s apart: `{column}` is one number in the first row", number(*seconds))
            }
            Assumption::Counts { signal, column, factor } => write!(
                f,
                "`{signal}` is column `{column}`, whole numbers without a unit: taken as counts of {} each, by the rate beside it",
                number(*factor)
            ),
            Assumption::Timeless => {
                f.write_str("no column of time is read: the model has no derivative, so that rows stand for themselves")
            }
            Assumption::Column { signal, column, unit, model_unit, factor } => {
                write!(f, "`{signal}` is column `{column}`")?;
                match (unit, model_unit) {
                    (Some(unit), Some(own)) if *factor != 1.0 => {
                        write!(f, ", converted from {unit} to {own}: times {}", number(*factor))
                    }
                    (None, Some(own)) if *factor == 1.0 => write!(f, ", which states no unit: taken as {own}"),
                    (Some(unit), None) => write!(f, " in {unit}, not converted: `{signal}` has no unit in the model"),
                    _ => Ok(()),
                }
            }
            Assumption::FactorForUnit { signal, column, unit, factor } => write!(
                f,
                "`{signal}` is column `{column}` times the stated factor {}, which stands in place of its unit {unit}",
                number(*factor)
            ),
            Assumption::Time { column, unit, stated: true } => write!(f, "time is column `{column}` in {unit}"),
            Assumption::Time { column, unit, stated: false } => {
                write!(
                    f,
                    "time is column `{column}`, which states no unit: read as {unit} by its steps; if it is in another, state the factor to seconds"
                )
            }
            Assumption::OwnTimes { reference, held } => {
                write!(f, "columns have times of their own: rows are those of `{reference}`, ")?;
                if !held.is_empty() {
                    let names: Vec<String> = held.iter().map(|name| format!("`{name}`")).collect();
                    write!(f, "{} at the last reading, ", names.join(", "))?;
                }
                f.write_str("other columns interpolated between their readings")
            }
            Assumption::StaleStamps { count, first } => write!(
                f,
                "{count} time stamps, the first in line {first}, repeat the one before, and the next one comes so many steps later: these rows are taken as evenly spaced up to it"
            ),
            Assumption::RateLeftOut { signal, from_line, to_line } => {
                write!(f, "`{signal}` has empty fields in lines {from_line} to {to_line}, where it is not used")
            }
        }
    }
}
