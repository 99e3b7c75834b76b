//! A survey of all channels of a file, to inspect a record before it is used.
//!
//! With a model, the channels are its coordinates, its inputs and the measured rates that are there; without one, every column of
//! numbers. Invariant: a channel that never changes is no fault here; it is a finding.

use crate::error::LogError;
use crate::options::ReadingSettings;
use crate::read::{rate_signals, signals};
use crate::recording::Recording;
use crate::source::LogSource;
use crate::table::{Table, Unread};
use serde::Serialize;
use tpm_controller::model::{Model, moving};

/// The role of a channel in a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// A measured coordinate.
    Coordinate,
    /// A recorded input.
    Input,
    /// The measured rate of a coordinate.
    Rate,
    /// A column of the file, without a model.
    Column,
}

/// A channel of a record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Surveyed {
    /// Its name: the model's, or that of its column.
    pub name: String,
    /// Its unit, where one is known.
    pub unit: Option<String>,
    /// Its role in the model.
    pub role: Role,
}

/// A record and the roles of its channels.
#[derive(Debug)]
pub struct Survey {
    /// The record. With a model it holds the measured rates apart from the channels; without one every column is a
    /// channel.
    pub recording: Recording,
    /// The channels, then the rates, one for every coordinate of a model.
    pub channels: Vec<Surveyed>,
    /// Least and largest reading of every channel in the file, before anything is resampled; no numbers where it has none.
    pub extremes: Vec<[f64; 2]>,
    /// Columns that are not read; none with a model, which names what it needs.
    pub unread: Vec<Unread>,
}

impl Survey {
    /// Surveys the signals of a model in a log.
    ///
    /// # Errors
    /// Those of [`Recording::open`], but for a channel that never changes.
    pub fn of_model<'a>(
        source: impl Into<LogSource<'a>>,
        model: &dyn Model<f64>,
        options: &ReadingSettings,
    ) -> Result<Self, LogError> {
        let source: LogSource<'_> = source.into();
        let name = source.name();
        let (needed, rates) = (signals(model), rate_signals(model));
        let mut columns = source.columns()?;
        let mut table = Table::read(&mut *columns, &name, &needed, &rates, options)?;
        drop(columns);
        table.tell_all_steps();
        let extremes = table.extremes();
        let recording = Recording::of(table, (&needed[..moving(model)], &rates), |_| Ok(()))?;
        let dims = model.dims();
        let channels = needed.into_iter().chain(rates).enumerate().map(|(at, signal)| {
            let role = match at {
                at if at < moving(model) => Role::Coordinate,
                at if at < moving(model) + dims.inputs => Role::Input,
                _ => Role::Rate,
            };
            Surveyed { name: signal.name, unit: signal.unit, role }
        });
        Ok(Survey { recording, channels: channels.collect(), extremes, unread: Vec::new() })
    }

    /// Surveys all columns of numbers in a log besides its time. Columns of text, and columns that are empty in most
    /// rows, are listed as unread.
    ///
    /// # Errors
    /// [`LogError`] when the file cannot be read, its time is not known, or no stretch is long enough.
    pub fn of_all<'a>(source: impl Into<LogSource<'a>>, options: &ReadingSettings) -> Result<Self, LogError> {
        let source: LogSource<'_> = source.into();
        let name = source.name();
        let mut columns = source.columns()?;
        let (mut table, signals, unread) = Table::read_all(&mut *columns, &name, options)?;
        drop(columns);
        table.tell_all_steps();
        let channels = signals.into_iter().map(|of| Surveyed { name: of.name, unit: of.unit, role: Role::Column });
        let extremes = table.extremes();
        let recording = Recording::of(table, (&[], &[]), |_| Ok(()))?;
        Ok(Survey { recording, channels: channels.collect(), extremes, unread })
    }
}

#[cfg(test)]
mod tests {
    use super::{Role, Survey};
    use crate::options::ReadingSettings;

    #[test]
    fn every_column_of_numbers_is_a_channel() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("run.csv");
        let mut text = String::from("t_s,q [deg],mode,spare,u_V\n");
        for i in 0..60 {
            let q = if i == 30 { "nan".into() } else { format!("{}", 0.1 * f64::from(i)) };
            text += &format!("{:.3},{q},{},,{}\n", 0.01 * f64::from(i), if i < 20 { "idle" } else { "run" }, i % 7);
        }
        std::fs::write(&path, text).expect("writable");
        let survey = Survey::of_all(path.as_path(), &ReadingSettings::default()).expect("readable");
        let names: Vec<(&str, Option<&str>)> =
            survey.channels.iter().map(|of| (of.name.as_str(), of.unit.as_deref())).collect();
        assert_eq!(names, [("q [deg]", Some("deg")), ("u_V", Some("V"))]);
        assert!(survey.channels.iter().all(|of| of.role == Role::Column));
        let unread: Vec<&str> = survey.unread.iter().map(|of| of.column.as_str()).collect();
        assert_eq!(unread, ["mode", "spare"]);
        // The row without a reading is bridged.
        let samples: Vec<usize> = survey.recording.segments.iter().map(crate::Log::len).collect();
        assert_eq!(samples, [60]);
        assert_eq!(survey.recording.report.left_out[0].from_line, 32);
        assert_eq!(survey.recording.segments[0].channels[1][31], f64::from(31 % 7));
    }
}
