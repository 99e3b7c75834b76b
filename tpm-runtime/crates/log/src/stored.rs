//! Columns that a reader holds in memory.

use crate::assumption::Assumption;
use crate::columns::{ColumnName, Columns, Holds, distinct};
use crate::error::LogError;
use crate::options::LEAST_SAMPLES;
use std::borrow::Cow;

/// A column and its readings.
#[derive(Debug, Default)]
pub(super) struct StoredColumn<'a> {
    pub(super) name: ColumnName,
    /// Readings, NaN where one is missing.
    pub(super) values: Cow<'a, [f64]>,
    /// Whether this is a column of stamps; a row with stamps alone is skipped.
    pub(super) stamp: bool,
}

/// Readings at the beginning of a column that say what it holds.
const MOST_JUDGED: usize = 4096;
/// Most columns of one variable.
const MOST_COLUMNS: usize = 4096;

impl StoredColumn<'static> {
    /// A column of readings without a unit.
    pub(super) fn of(name: impl Into<String>, values: Vec<f64>) -> Self {
        StoredColumn { name: ColumnName::new(name), values: values.into(), stamp: false }
    }

    /// The columns of a matrix whose numbers are stored column by column; its longer side is time. The k-th is called `NAME[k]`, a vector
    /// by its name alone. A single number is a setting, no signal.
    pub(super) fn of_matrix(name: &str, values: Vec<f64>, rows: usize, columns: usize) -> Vec<Self> {
        let (length, width) = (rows.max(columns), rows.min(columns));
        if length < 2 || width == 0 || width > MOST_COLUMNS {
            return Vec::new();
        }
        if width == 1 {
            return vec![StoredColumn::of(name, values)];
        }
        let column = |k: usize| {
            let values = if rows >= columns {
                values[k * rows..(k + 1) * rows].to_vec()
            } else {
                values.iter().skip(k).step_by(rows).copied().collect()
            };
            StoredColumn::of(format!("{name}[{}]", k + 1), values)
        };
        (0..width).map(column).collect()
    }
}

/// Columns in memory. They may have different lengths; those that are selected may not.
pub(super) struct Stored<'a> {
    path: String,
    header: Vec<ColumnName>,
    columns: Vec<StoredColumn<'a>>,
    assumptions: Vec<Assumption>,
    wanted: Vec<usize>,
    row: usize,
    kind: &'static str,
}

impl<'a> Stored<'a> {
    /// The columns of a file, which messages call `path`.
    pub(super) fn new(path: &str, columns: Vec<StoredColumn<'a>>) -> Self {
        let mut header: Vec<ColumnName> = columns.iter().map(|column| column.name.clone()).collect();
        for (name, column) in header.iter_mut().zip(&columns) {
            name.holds = match column.values.len() {
                ..LEAST_SAMPLES => Holds::Few,
                length => Holds::of(&column.values[..length.min(MOST_JUDGED)]),
            };
        }
        let assumptions = distinct(&mut header);
        Stored { path: path.into(), header, columns, assumptions, wanted: Vec::new(), row: 0, kind: "a table" }
    }

    /// The columns of a file that names none of them: they are called by their number.
    pub(super) fn numbered(path: &str, mut columns: Vec<StoredColumn<'a>>) -> Self {
        for (k, column) in columns.iter_mut().enumerate() {
            column.name.text = (k + 1).to_string();
        }
        let assumptions = vec![Assumption::NumberedColumns { columns: columns.len() }];
        Stored { assumptions, ..Stored::new(path, columns) }
    }

    /// The columns of a file that messages call so.
    pub(super) fn of_kind(self, kind: &'static str) -> Self {
        Stored { kind, ..self }
    }

    /// Whether the selected columns are of one length.
    fn check_lengths(&self) -> Result<(), LogError> {
        let Some(&first) = self.wanted.first() else { return Ok(()) };
        let length = |column: usize| self.columns[column].values.len();
        match self.wanted.iter().find(|&&column| length(column) != length(first)) {
            None => Ok(()),
            Some(&other) => Err(LogError::Format {
                path: self.path.clone(),
                what: format!(
                    "`{}` has {} values and `{}` has {}",
                    self.header[first].text,
                    length(first),
                    self.header[other].text,
                    length(other)
                ),
                remedy: "name columns that were recorded together".into(),
            }),
        }
    }
}

impl Columns for Stored<'_> {
    fn header(&self) -> &[ColumnName] {
        &self.header
    }

    fn header_line(&self) -> u64 {
        1
    }

    fn kind(&self) -> String {
        self.kind.to_owned()
    }

    fn select(&mut self, wanted: &[usize]) {
        self.wanted = wanted.to_vec();
        self.row = 0;
    }

    fn readings(&self, column: usize) -> Option<usize> {
        Some(self.columns[column].values.len())
    }

    fn next_row(&mut self, values: &mut [f64]) -> Result<Option<u64>, LogError> {
        if self.row == 0 {
            self.check_lengths()?;
        }
        loop {
            let row = self.row;
            let mut says = false;
            for (value, &column) in values.iter_mut().zip(&self.wanted) {
                let column = &self.columns[column];
                let Some(&read) = column.values.get(row) else { return Ok(None) };
                *value = read;
                says |= !column.stamp && !read.is_nan();
            }
            self.row += 1;
            // A message about other joints is skipped; it is no row with missing readings.
            let stamped = self.wanted.iter().any(|&column| self.columns[column].stamp);
            if says || !stamped {
                return Ok(Some(row as u64 + 1));
            }
        }
    }

    fn text(&self, field: usize) -> String {
        let column = &self.columns[self.wanted[field]];
        self.row.checked_sub(1).and_then(|row| column.values.get(row)).map(f64::to_string).unwrap_or_default()
    }

    fn assumptions(&self) -> Vec<Assumption> {
        self.assumptions.clone()
    }
}
