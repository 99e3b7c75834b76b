//! The source of a log's columns: a file, or memory.

use crate::columns::{ColumnName, Columns};
use crate::error::LogError;
use crate::fingerprint::{FingerprintReader, fingerprint_of};
use crate::format::{open_columns, open_file};
use crate::stored::{Stored, StoredColumn};
use std::borrow::Cow;
use std::iter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Columns of a log in memory, each with its name: the time and signals, called as the header of a file would call them. A reading
/// that is missing is not finite. Copies share the readings.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    columns: Arc<[(String, Vec<f64>)]>,
}

impl Samples {
    /// Columns by name. Those that are used together must be of one length.
    #[must_use]
    pub fn new(columns: Vec<(String, Vec<f64>)>) -> Self {
        Samples { columns: columns.into() }
    }

    /// Fingerprint of the names and values of all columns.
    fn fingerprint(&self) -> String {
        fingerprint_of(self.columns.iter().flat_map(|(name, values)| {
            let name = name.bytes().chain(iter::once(0));
            name.chain(values.iter().flat_map(|value| value.to_le_bytes()))
        }))
    }
}

/// The source of a log's columns.
#[derive(Clone, Copy, Debug)]
pub enum LogSource<'a> {
    /// In a file of any format.
    File(&'a Path),
    /// In memory, with the name that messages call them by.
    Memory(&'a Path, &'a Samples),
}

impl<'a> From<&'a Path> for LogSource<'a> {
    fn from(path: &'a Path) -> Self {
        LogSource::File(path)
    }
}

impl<'a> From<&'a PathBuf> for LogSource<'a> {
    fn from(path: &'a PathBuf) -> Self {
        LogSource::File(path)
    }
}

impl<'a> LogSource<'a> {
    /// Its name in messages.
    pub(super) fn name(self) -> String {
        let (LogSource::File(path) | LogSource::Memory(path, _)) = self;
        path.display().to_string()
    }

    /// Its columns.
    ///
    /// # Errors
    /// [`LogError`] when a file cannot be read.
    pub(super) fn columns(self) -> Result<Box<dyn Columns + 'a>, LogError> {
        match self {
            LogSource::File(path) => open_columns(open_file(path)?, &self.name()),
            LogSource::Memory(_, samples) => {
                let column = |(name, values): &'a (String, Vec<f64>)| StoredColumn {
                    name: ColumnName::new(name),
                    values: Cow::Borrowed(values),
                    stamp: false,
                };
                Ok(Box::new(Stored::new(&self.name(), samples.columns.iter().map(column).collect())))
            }
        }
    }

    /// What is read of its columns, and their fingerprint; a file is read and fingerprinted in one pass. `read` takes the columns and
    /// their name in messages.
    ///
    /// # Errors
    /// Those of `read`, and [`LogError`] when a file cannot be read.
    pub(super) fn read<T>(
        self,
        read: impl FnOnce(&mut dyn Columns, &str) -> Result<T, LogError>,
    ) -> Result<(T, String), LogError> {
        let name = self.name();
        let LogSource::File(path) = self else {
            let found = read(&mut *self.columns()?, &name)?;
            return Ok((found, self.fingerprint()?));
        };
        let mut file = FingerprintReader::new(open_file(path)?);
        let found = read(&mut *open_columns(&mut file, &name)?, &name)?;
        // The fingerprint includes the bytes at the end of the file that the reader leaves unread.
        std::io::copy(&mut file, &mut std::io::sink()).map_err(|source| LogError::Io { path: name, source })?;
        Ok((found, file.fingerprint()))
    }

    /// Fingerprint of the file's bytes, or of the samples in memory.
    ///
    /// # Errors
    /// [`LogError::Io`] when a file cannot be read.
    pub fn fingerprint(self) -> Result<String, LogError> {
        match self {
            LogSource::File(path) => {
                let mut file = FingerprintReader::new(open_file(path)?);
                std::io::copy(&mut file, &mut std::io::sink())
                    .map_err(|source| LogError::Io { path: self.name(), source })?;
                Ok(file.fingerprint())
            }
            LogSource::Memory(_, samples) => Ok(samples.fingerprint()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{LogSource, Samples};
    use crate::{Cut, ReadingSettings, Recording};
    use std::path::Path;
    use tpm_test_support::models::MassSpringDrag;

    /// Columns of a run, and its text.
    fn run() -> (Vec<(String, Vec<f64>)>, String) {
        let time: Vec<f64> = (0..300).map(|n| f64::from(n) * 2e-3).collect();
        let signal = |rate: f64| time.iter().map(|t| (rate * t).sin()).collect::<Vec<f64>>();
        let columns = [("t_s", time.clone()), ("x", signal(5.0)), ("u", signal(7.0))];
        let rows = (0..time.len()).map(|n| format!("{},{},{}\n", columns[0].1[n], columns[1].1[n], columns[2].1[n]));
        let text = format!("t_s,x,u\n{}", rows.collect::<String>());
        (columns.map(|(name, values)| (name.to_string(), values)).into(), text)
    }

    fn open(columns: Vec<(String, Vec<f64>)>) -> Result<Recording, String> {
        let samples = Samples::new(columns);
        let source = LogSource::Memory(Path::new("arrays"), &samples);
        Recording::open(source, &MassSpringDrag, &ReadingSettings::default()).map_err(|error| error.to_string())
    }

    #[test]
    fn samples_in_memory_are_those_of_a_file() {
        let (columns, text) = run();
        let read =
            Recording::read(text.as_bytes(), "run.csv", &MassSpringDrag, &ReadingSettings::default()).expect("sound");
        let held = open(columns).expect("sound");
        assert_eq!(held.segments[0].channels, read.segments[0].channels);
        assert_eq!(held.segments[0].sample_time.to_bits(), read.segments[0].sample_time.to_bits());
        assert_eq!(held.fingerprint.len(), 16);
    }

    #[test]
    fn samples_in_memory_are_checked_as_those_of_a_file() {
        let mut columns = run().0;
        columns[1].1[100] = f64::NAN;
        let split = open(columns.clone()).expect("two stretches");
        assert!(matches!(split.report.segments[1].cut, Some(Cut::Missing { rows: 1, .. })), "{:?}", split.report);
        columns[2].1.pop();
        let message = open(columns.clone()).expect_err("one is shorter");
        assert!(message.contains("`u` has 299"), "{message}");
        columns.truncate(2);
        let message = open(columns).expect_err("one is missing");
        assert!(message.contains("no column `u`"), "{message}");
    }
}
