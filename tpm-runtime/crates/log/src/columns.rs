//! The interface that all formats of logs share: named columns of numbers, row by row.

use crate::assumption::Assumption;
use crate::error::LogError;
use crate::stamps::Resolution;
use std::collections::HashMap;

/// Fewest steps by which numbers are told to be stamps.
const LEAST_STEPS: usize = 8;

/// Name of a column as the file states it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ColumnName {
    /// The name, trimmed; it may end in a unit.
    pub(super) text: String,
    /// The unit, where the format states it apart from the name.
    pub(super) unit: Option<String>,
    /// Whether the name is an expression over others, which holds no unit.
    pub(super) computed: bool,
    /// Whether several columns of the file have the name, which a number tells apart.
    pub(super) repeated: bool,
    /// What the first readings say of the column, whatever its name is.
    pub(super) holds: Holds,
}

/// What readings say of a column.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Holds {
    #[default]
    Readings,
    /// The time: dates, or what the format says is the time.
    Time,
    /// Numbers of which each is larger than the one before by about as much, as stamps are.
    Rising,
    /// So few readings that it is a setting.
    Few,
    /// One number in the first row alone, as a sample time may stand beside columns.
    One(f64),
}

impl Holds {
    /// Of readings in the order of the rows.
    pub(super) fn of(readings: &[f64]) -> Self {
        let steps: Vec<f64> = readings.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let mut sorted = steps.clone();
        sorted.sort_by(f64::total_cmp);
        match readings {
            [one, rest @ ..] if one.is_finite() && !rest.is_empty() && rest.iter().all(|value| value.is_nan()) => {
                Holds::One(*one)
            }
            _ if steps.len() >= LEAST_STEPS
                && steps.iter().all(|step| *step > 0.0)
                && sorted[sorted.len() * 9 / 10] < 2.0 * sorted[sorted.len() / 2] =>
            {
                Holds::Rising
            }
            _ => Holds::Readings,
        }
    }
}

impl ColumnName {
    /// A name without a unit beside it.
    pub(super) fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), ..Self::default() }
    }
}

/// Gives names that occur several times a number, `x`, `x.2`, `x.3`, and says which they are. Columns without a name have none.
pub(super) fn distinct(header: &mut [ColumnName]) -> Vec<Assumption> {
    let mut counts: HashMap<String, usize> = HashMap::new();
    for column in header.iter_mut().filter(|column| !column.text.is_empty()) {
        let count = counts.entry(column.text.clone()).or_default();
        *count += 1;
        if *count > 1 {
            column.text = format!("{}.{count}", column.text);
        }
    }
    header.iter_mut().for_each(|column| column.repeated = counts.get(&column.text).is_some_and(|count| *count > 1));
    let mut repeated: Vec<(String, usize)> = counts.into_iter().filter(|(_, count)| *count > 1).collect();
    repeated.sort();
    repeated.into_iter().map(|(column, count)| Assumption::RepeatedName { column, count }).collect()
}

/// A text where a number belongs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct NotedText {
    /// Place of its column among the selected ones.
    pub(super) field: usize,
    /// Line of the text.
    pub(super) line: u64,
    pub(super) text: String,
}

/// A table of numbers in a file, whatever its format is.
///
/// Names and units are settled by the caller, who then selects the columns that it needs, and takes them row by row.
pub(super) trait Columns {
    /// The columns of the file.
    fn header(&self) -> &[ColumnName];

    /// Line of the header, for messages.
    fn header_line(&self) -> u64;

    /// What the file is, for messages.
    fn kind(&self) -> String {
        "a table".to_owned()
    }

    /// Line of the units of the columns, for messages: that of the header where they have no row of their own.
    fn units_line(&self) -> u64 {
        self.header_line()
    }

    /// Says which columns [`next_row`](Self::next_row) delivers, in this order. The first of them is the time.
    fn select(&mut self, wanted: &[usize]);

    /// Number of readings of a column, where a file holds every column by itself and they may differ.
    fn readings(&self, _column: usize) -> Option<usize> {
        None
    }

    /// Fills in the selected fields of the next row, NaN or infinite where one is missing, and returns its line in the file (or its
    /// number, where a file has no lines), from 1. Returns nothing at the end.
    ///
    /// # Errors
    /// [`LogError`] when the row cannot be read.
    fn next_row(&mut self, values: &mut [f64]) -> Result<Option<u64>, LogError>;

    /// From now on a text where a number belongs is a missing reading that is noted, not a fault, in the selected columns from this place
    /// on. Formats whose columns hold nothing but numbers have none.
    fn note_texts(&mut self, _from: usize) {}

    /// What was noted so far: the first text of each selected column that has one.
    fn noted_texts(&self) -> Vec<NotedText> {
        Vec::new()
    }

    /// Text of a selected field of the last row, for messages.
    fn text(&self, field: usize) -> String;

    /// Whether the stamps read so far are dates, counted in seconds from the first one.
    fn dated(&self) -> bool {
        false
    }

    /// The digits to which the stamps read so far were printed.
    fn resolution(&self) -> Resolution {
        Resolution::default()
    }

    /// What was assumed about the file so far.
    fn assumptions(&self) -> Vec<Assumption>;
}
