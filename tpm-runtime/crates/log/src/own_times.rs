//! Columns that were recorded at times of their own, such as the entries of a data log or the topics of a robot.
//!
//! A row is a stamp at which any of the selected columns has a reading; the others have none there.

use crate::assumption::Assumption;
use crate::columns::{ColumnName, Columns, distinct};
use crate::error::LogError;
use crate::stamps::Resolution;

/// Readings of one quantity, each with its stamp, in the order of the file.
#[derive(Clone, Debug, Default)]
pub(super) struct Timed {
    pub(super) name: ColumnName,
    pub(super) readings: Vec<(f64, f64)>,
}

/// Columns with times of their own; the first is the time.
pub(super) struct OwnTimes {
    header: Vec<ColumnName>,
    columns: Vec<Timed>,
    resolution: Resolution,
    assumptions: Vec<Assumption>,
    /// The selected columns; nothing for the time.
    wanted: Vec<Option<usize>>,
    /// Readings of each column that were delivered.
    delivered: Vec<usize>,
    row: u64,
    texts: Vec<f64>,
    kind: &'static str,
}

impl OwnTimes {
    /// Columns with the name of their time.
    pub(super) fn new(columns: Vec<Timed>, time: ColumnName) -> Self {
        let names = columns.iter().map(|column| column.name.clone());
        let mut header: Vec<ColumnName> = [time].into_iter().chain(names).collect();
        let repeated = distinct(&mut header);
        OwnTimes {
            header,
            delivered: vec![0; columns.len()],
            columns,
            resolution: Resolution::default(),
            assumptions: repeated,
            wanted: Vec::new(),
            row: 0,
            texts: Vec::new(),
            kind: "a table whose columns have times of their own",
        }
    }

    /// The columns of a text, with what is known of its stamps and was assumed of it.
    pub(super) fn of_text(self, resolution: Resolution, assumptions: Vec<Assumption>) -> Self {
        let assumptions = assumptions.into_iter().chain(self.assumptions).collect();
        OwnTimes { resolution, assumptions, ..self }
    }

    /// The columns of a file that messages call so.
    pub(super) fn of_kind(self, kind: &'static str) -> Self {
        OwnTimes { kind, ..self }
    }

    /// The next reading of a column.
    fn next(&self, column: usize) -> Option<(f64, f64)> {
        self.columns[column].readings.get(self.delivered[column]).copied()
    }
}

impl Columns for OwnTimes {
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
        self.wanted = wanted.iter().map(|column| column.checked_sub(1)).collect();
        self.delivered.fill(0);
        self.row = 0;
    }

    fn next_row(&mut self, values: &mut [f64]) -> Result<Option<u64>, LogError> {
        let stamps = self.wanted.iter().flatten().filter_map(|column| Some(self.next(*column)?.0));
        let Some(stamp) = stamps.min_by(f64::total_cmp) else { return Ok(None) };
        let mut taken = Vec::new();
        for (value, wanted) in values.iter_mut().zip(&self.wanted) {
            *value = match wanted {
                None => stamp,
                Some(column) => match self.next(*column) {
                    Some((own, reading)) if own == stamp => {
                        taken.push(*column);
                        reading
                    }
                    _ => f64::NAN,
                },
            };
        }
        // A column that is selected twice is delivered once.
        taken.sort_unstable();
        taken.dedup();
        taken.into_iter().for_each(|column| self.delivered[column] += 1);
        self.texts = values.to_vec();
        self.row += 1;
        Ok(Some(self.row))
    }

    fn text(&self, field: usize) -> String {
        // A column without a reading has an empty field.
        self.texts.get(field).filter(|value| !value.is_nan()).map(f64::to_string).unwrap_or_default()
    }

    fn resolution(&self) -> Resolution {
        self.resolution.clone()
    }

    fn assumptions(&self) -> Vec<Assumption> {
        self.assumptions.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::{OwnTimes, Timed};
    use crate::columns::{ColumnName, Columns as _};

    #[test]
    fn rows_are_the_stamps_of_the_selected_columns() {
        let column =
            |name: &str, readings: &[(f64, f64)]| Timed { name: ColumnName::new(name), readings: readings.to_vec() };
        let mut file = OwnTimes::new(
            vec![
                column("a", &[(0.0, 1.0), (20.0, 2.0)]),
                column("b", &[(10.0, 4.0), (20.0, 5.0)]),
                column("c", &[(5.0, 7.0)]),
            ],
            ColumnName::new("time"),
        );
        file.select(&[0, 2, 1]);
        let mut values = [0.0; 3];
        let mut rows = Vec::new();
        while let Some(row) = file.next_row(&mut values).expect("sound") {
            rows.push((row, values.map(|value| if value.is_nan() { None } else { Some(value) })));
        }
        let expected = [
            (1, [Some(0.0), None, Some(1.0)]),
            (2, [Some(10.0), Some(4.0), None]),
            (3, [Some(20.0), Some(5.0), Some(2.0)]),
        ];
        assert_eq!(rows, expected);
    }
}
