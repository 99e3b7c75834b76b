//! Tables with one reading a line: its time, the name of what was read, and its value.

use crate::columns::{ColumnName, Columns as _};
use crate::csv::Csv;
use crate::error::LogError;
use crate::own_times::{OwnTimes, Timed};
use std::collections::HashMap;
use std::io::Read;

/// Names of the column with names, in small letters.
const NAMES: [&str; 9] = ["name", "signal", "topic", "variable", "channel", "series", "field", "tag", "sensor"];
/// Names of the column with readings, in small letters.
const VALUES: [&str; 3] = ["value", "reading", "val"];

/// The columns of a long table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Long {
    time: usize,
    name: usize,
    value: usize,
}

impl Long {
    /// The columns of a table that has three, a time, names and values, by their names; nothing of another.
    pub(super) fn of(header: &[ColumnName]) -> Option<Self> {
        let place = |names: &[&str]| {
            header.iter().position(|column| names.iter().any(|name| name.eq_ignore_ascii_case(&column.text)))
        };
        let (name, value) = (place(&NAMES)?, place(&VALUES)?);
        (header.len() == 3).then(|| Long { time: 3 - name - value, name, value })
    }

    /// The columns of all names.
    ///
    /// # Errors
    /// [`LogError`] when a line cannot be read.
    pub(super) fn read(self, mut table: Csv<impl Read>) -> Result<OwnTimes, LogError> {
        table.select(&[self.time, self.value]);
        let mut columns: Vec<Timed> = Vec::new();
        let mut index: HashMap<String, usize> = HashMap::new();
        let mut values = [0.0; 2];
        while table.next_row(&mut values)?.is_some() {
            let [stamp, reading] = values;
            if !stamp.is_finite() || reading.is_nan() {
                continue;
            }
            let name = table.field_of(self.name);
            let at = match index.get(&*name) {
                Some(at) => *at,
                None => {
                    columns.push(Timed { name: ColumnName::new(&*name), readings: Vec::new() });
                    index.insert(name.into_owned(), columns.len() - 1);
                    columns.len() - 1
                }
            };
            columns[at].readings.push((stamp, reading));
        }
        let mut time = table.header()[self.time].clone();
        if table.dated() {
            time.unit = Some("s".to_owned());
        }
        Ok(OwnTimes::new(columns, time).of_text(table.resolution(), table.assumptions()))
    }
}

#[cfg(test)]
mod tests {
    use super::Long;
    use crate::columns::ColumnName;
    use crate::format::open_columns;
    use crate::{Log, ReadingSettings};
    use tpm_test_support::models::MassSpringDrag;

    #[test]
    fn a_reading_a_line_is_the_table_of_their_names() {
        let wide = |k: i32| (f64::from(k) * 0.01, f64::from(k).sin(), k * k);
        let rows: String = (0..40).map(wide).map(|(t, x, u)| format!("{t:.2},{x},{u}\n")).collect();
        let lines: String = (0..40)
            .map(wide)
            .map(|(t, x, u)| format!("{t:.2},x,{x}\n{t:.2},\"drive, left\",{u}\n{t:.2},state,\n"))
            .collect();
        let mut options = ReadingSettings::default();
        let read = |text: String, options: &ReadingSettings| {
            Log::read(text.as_bytes(), "run.csv", &MassSpringDrag, options).expect("sound")
        };
        let expected = read(format!("time,x,u\n{rows}"), &options);
        options.map.insert("u".into(), "drive, left".into());
        let long = read(format!("time,name,value\n{lines}"), &options);
        assert_eq!((long.channels, long.sample_time), (expected.channels, expected.sample_time));
    }

    #[test]
    fn a_blank_value_is_no_row() {
        let text = "time,name,value\n0,x,1\n0.5,x,\n1,x,2\n";
        let mut table = open_columns(text.as_bytes(), "run.csv").expect("sound");
        table.select(&[0, 1]);
        let (mut values, mut stamps) = ([0.0; 2], Vec::new());
        while table.next_row(&mut values).expect("sound").is_some() {
            stamps.push(values[0]);
        }
        assert_eq!(stamps, [0.0, 1.0]);
    }

    #[test]
    fn other_tables_are_left_alone() {
        let header = |names: &[&str]| -> Vec<ColumnName> { names.iter().map(|name| ColumnName::new(*name)).collect() };
        let place = Long { time: 1, name: 2, value: 0 };
        assert_eq!(Long::of(&header(&["Value", "stamp", "Topic"])), Some(place));
        assert_eq!(Long::of(&header(&["t_s", "x", "value"])), None);
        assert_eq!(Long::of(&header(&["t_s", "name", "value", "u"])), None);
    }
}
