//! Tables in which columns have a column of time of their own, as scopes write them: each beside it, `time_u,u,time_x,x`, or the time again
//! before every group of one rate, `time,x,u,time,temperature`.

use crate::columns::{ColumnName, Columns as _};
use crate::csv::Csv;
use crate::error::LogError;
use crate::names::is_time_name;
use crate::own_times::{OwnTimes, Timed};
use std::io::Read;

/// Words for the time, before a column's name or behind it, in small letters.
const TIMES: [&str; 4] = ["time", "t", "timestamp", "stamp"];

/// Whether a column is the time of another one: `time_u`, `t_u` or `u_time` of `u`.
fn is_time_of(time: &str, column: &str) -> bool {
    let time = time.to_ascii_lowercase();
    let column = column.to_ascii_lowercase();
    let rest = |side: Option<&str>| side.is_some_and(|rest| TIMES.contains(&rest.trim_matches(['_', '.', '/', ' '])));
    let apart = time.len() > column.len() + 1;
    apart && (rest(time.strip_suffix(column.as_str())) || rest(time.strip_prefix(column.as_str())))
}

/// The columns of such a table: pairs of a time and what was read then.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Paired(Vec<(usize, usize)>);

impl Paired {
    /// The pairs of a table that has nothing else, and two times at least; nothing of another.
    pub(super) fn of(header: &[ColumnName]) -> Option<Self> {
        // A time of the first one's name begins a group.
        let first = header.first().filter(|column| column.repeated && is_time_name(&column.text));
        if let Some(first) = first {
            let is_time = |column: &ColumnName| {
                let rest = column.text.strip_prefix(first.text.as_str());
                rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            };
            let (mut time, mut pairs) = (0, Vec::new());
            for (k, column) in header.iter().enumerate() {
                if is_time(column) { time = k } else { pairs.push((time, k)) }
            }
            return Some(Paired(pairs));
        }
        if header.len() < 4 || !header.len().is_multiple_of(2) {
            return None;
        }
        // Pairs stand beside each other.
        let pair = |k: usize| {
            let (first, second) = (header[k].text.as_str(), header[k + 1].text.as_str());
            if is_time_of(first, second) { Some((k, k + 1)) } else { is_time_of(second, first).then_some((k + 1, k)) }
        };
        (0..header.len()).step_by(2).map(pair).collect::<Option<_>>().map(Paired)
    }

    /// The columns; a line may lack some of the pairs.
    ///
    /// # Errors
    /// [`LogError`] when a line cannot be read.
    pub(super) fn read(self, mut table: Csv<impl Read>) -> Result<OwnTimes, LogError> {
        let header = table.header();
        let name = |(_, value): &(usize, usize)| header[*value].clone();
        let mut columns: Vec<Timed> =
            self.0.iter().map(|pair| Timed { name: name(pair), readings: Vec::new() }).collect();
        // The time of a group states its unit, in its name or in a row of units.
        let time = header[self.0.first().map_or(0, |(time, _)| *time)].clone();
        let time = if time.repeated { time } else { ColumnName::new("time") };
        let both: Vec<usize> = self.0.iter().flat_map(|(time, value)| [*time, *value]).collect();
        table.select(&both);
        let mut values = vec![0.0; both.len()];
        while table.next_row(&mut values)?.is_some() {
            for (column, pair) in columns.iter_mut().zip(values.chunks_exact(2)) {
                // Where a group is slower than the others its last row may be repeated.
                let is_new = column.readings.last().is_none_or(|last| last.0 != pair[0]);
                if is_new && pair[0].is_finite() && !pair[1].is_nan() {
                    column.readings.push((pair[0], pair[1]));
                }
            }
        }
        Ok(OwnTimes::new(columns, ColumnName { repeated: false, ..time })
            .of_text(table.resolution(), table.assumptions()))
    }
}

#[cfg(test)]
mod tests {
    use super::Paired;
    use crate::columns::ColumnName;
    use crate::{ReadingSettings, Recording};
    use tpm_test_support::models::MassSpringDrag;

    #[test]
    fn columns_beside_their_times_are_one_record() {
        let mut text = String::from("time_u,u,time_x,x\n");
        for k in 0..100 {
            let (t, later) = (0.02 * f64::from(k), 0.02 * f64::from(k) + 0.004);
            let position = if k < 90 { format!("{later:.3},{}", (3.0 * later).sin()) } else { ",".to_owned() };
            text.push_str(&format!("{t:.3},{},{position}\n", k / 7 % 3));
        }
        let read = Recording::read(text.as_bytes(), "scope.csv", &MassSpringDrag, &ReadingSettings::default());
        let [log] = &read.expect("sound").segments[..] else { panic!("one segment") };
        assert!((85..=90).contains(&log.len()), "{}", log.len());
        assert!((log.sample_time - 0.02).abs() < 1e-9);
    }

    #[test]
    fn other_tables_are_left_alone() {
        let header = |names: &[&str]| -> Vec<ColumnName> { names.iter().map(|name| ColumnName::new(*name)).collect() };
        let pairs = Paired::of(&header(&["time_u", "u", "x", "x_time"]));
        assert_eq!(pairs, Some(Paired(vec![(0, 1), (3, 2)])));
        for names in [&["t", "x", "t_u", "u"][..], &["time_u", "u"], &["t_s", "x", "u", "i"], &["tu", "u", "tx", "x"]] {
            assert_eq!(Paired::of(&header(names)), None, "{names:?}");
        }
    }

    #[test]
    fn a_time_that_is_written_again_begins_a_group() {
        let mut text = String::from("Time [ms];x;u;Time [ms];temperature\n");
        for k in 0..100 {
            let t = 10.0 * f64::from(k);
            let slow = if k < 20 { format!("{};20,5", 5.0 * t) } else { ";".to_owned() };
            text.push_str(&format!("{t};{};{};{slow}\n", (0.003 * t).sin(), k / 7 % 3).replace('.', ","));
        }
        let read = Recording::read(text.as_bytes(), "scope.csv", &MassSpringDrag, &ReadingSettings::default());
        let [log] = &read.expect("sound").segments[..] else { panic!("one segment") };
        assert_eq!((log.len(), log.sample_time), (100, 0.01));
    }
}
