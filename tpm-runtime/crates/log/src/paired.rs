//! Tables in which every column has a column of time of its own beside it, as scopes write them: `time_u,u,time_x,x`.

use crate::columns::{ColumnName, Columns as _};
use crate::csv::Csv;
use crate::error::LogError;
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
    /// The pairs of a table that has nothing else, and two of them at least; nothing of another.
    pub(super) fn of(header: &[ColumnName]) -> Option<Self> {
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
        let column = |(_, value): &(usize, usize)| Timed { name: header[*value].text.clone(), readings: Vec::new() };
        let mut columns: Vec<Timed> = self.0.iter().map(column).collect();
        let both: Vec<usize> = self.0.iter().flat_map(|(time, value)| [*time, *value]).collect();
        table.select(&both);
        let mut values = vec![0.0; both.len()];
        while table.next_row(&mut values)?.is_some() {
            for (column, pair) in columns.iter_mut().zip(values.chunks_exact(2)) {
                if pair[0].is_finite() && !pair[1].is_nan() {
                    column.readings.push((pair[0], pair[1]));
                }
            }
        }
        Ok(OwnTimes::new(columns, ColumnName::new("time")).of_text(table.resolution(), table.assumptions()))
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
}
