//! The source of a log's columns: a file, or memory.

use crate::columns::{ColumnName, Columns};
use crate::error::LogError;
use crate::fingerprint::{FingerprintReader, fingerprint_of};
use crate::format::{open_columns, open_file};
use crate::stored::{Stored, StoredColumn};
use std::borrow::Cow;
use std::io::Read;
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

    /// Its columns, as those of a file; messages call it `name`.
    fn columns(&self, name: &str) -> Stored<'_> {
        let columns = self.columns.iter().map(|(name, values)| StoredColumn {
            name: ColumnName::new(name),
            values: Cow::Borrowed(values.as_slice()),
            stamp: false,
        });
        Stored::new(name, columns.collect())
    }

    /// Fingerprint of the names and values of all columns.
    fn fingerprint(&self) -> String {
        fingerprint_of(self.columns.iter().flat_map(|(name, values)| {
            let name = name.bytes().chain(iter::once(0));
            name.chain(values.iter().flat_map(|value| value.to_le_bytes()))
        }))
    }
}

/// A log in memory. Copies share what it holds.
#[derive(Clone, Debug, PartialEq)]
pub enum InMemory {
    /// Its columns.
    Samples(Samples),
    /// The bytes of a file of any format, where whoever runs the program has read the file: as a page for a browser does.
    Bytes(Arc<Vec<u8>>),
}

/// The source of a log's columns.
#[derive(Clone, Copy, Debug)]
pub enum LogSource<'a> {
    /// In a file of any format.
    File(&'a Path),
    /// In memory, with the name that messages call it by.
    Memory(&'a Path, &'a InMemory),
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

    /// The bytes or samples of the source; their format is not known yet.
    fn open(self) -> Result<Opened<'a>, LogError> {
        Ok(match self {
            LogSource::File(path) => Opened::Bytes(Box::new(open_file(path)?)),
            LogSource::Memory(_, InMemory::Bytes(bytes)) => Opened::Bytes(Box::new(bytes.as_slice())),
            LogSource::Memory(_, InMemory::Samples(samples)) => Opened::Samples(samples),
        })
    }

    /// Its columns.
    ///
    /// # Errors
    /// [`LogError`] when a file cannot be read.
    pub(super) fn columns(self) -> Result<Box<dyn Columns + 'a>, LogError> {
        match self.open()? {
            Opened::Bytes(bytes) => open_columns(bytes, &self.name()),
            Opened::Samples(samples) => Ok(Box::new(samples.columns(&self.name()))),
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
        match self.open()? {
            Opened::Bytes(bytes) => {
                let mut file = FingerprintReader::new(bytes);
                let found = read(&mut *open_columns(&mut file, &name)?, &name)?;
                Ok((found, self.rest(file)?))
            }
            Opened::Samples(samples) => Ok((read(&mut samples.columns(&name), &name)?, samples.fingerprint())),
        }
    }

    /// Fingerprint of the file's bytes, or of the samples in memory.
    ///
    /// # Errors
    /// [`LogError::Io`] when a file cannot be read.
    pub fn fingerprint(self) -> Result<String, LogError> {
        match self.open()? {
            Opened::Bytes(bytes) => self.rest(FingerprintReader::new(bytes)),
            Opened::Samples(samples) => Ok(samples.fingerprint()),
        }
    }

    /// The fingerprint of a file of which a part was read: it includes the bytes at the end that a reader leaves unread.
    fn rest(self, mut file: FingerprintReader<impl Read>) -> Result<String, LogError> {
        std::io::copy(&mut file, &mut std::io::sink()).map_err(|source| LogError::Io { path: self.name(), source })?;
        Ok(file.fingerprint())
    }
}

/// A source whose columns can be read.
enum Opened<'a> {
    Bytes(Box<dyn Read + 'a>),
    Samples(&'a Samples),
}

#[cfg(test)]
mod tests {
    use super::{InMemory, LogSource, Samples};
    use crate::{ReadingSettings, Recording, Why};
    use std::path::Path;
    use std::sync::Arc;
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
        let samples = InMemory::Samples(Samples::new(columns));
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
    fn the_bytes_of_a_file_are_read_as_the_file_is() {
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        // The fingerprint is that of all bytes, also of those behind the last row, which no reader asks for.
        let text = run().1 + "\n\n";
        std::fs::write(file.path(), &text).expect("writable");
        let held = InMemory::Bytes(Arc::new(text.into_bytes()));
        let [own, other] = [LogSource::File(file.path()), LogSource::Memory(file.path(), &held)]
            .map(|source| Recording::open(source, &MassSpringDrag, &ReadingSettings::default()).expect("sound"));
        assert_eq!(own.segments[0].channels, other.segments[0].channels);
        assert_eq!(own.fingerprint, other.fingerprint);
        assert_eq!(LogSource::Memory(file.path(), &held).fingerprint().expect("held"), own.fingerprint);
    }

    #[test]
    fn samples_in_memory_are_checked_as_those_of_a_file() {
        let mut columns = run().0;
        columns[1].1[100] = f64::NAN;
        let read = open(columns.clone()).expect("one reading is missing");
        assert!(matches!(read.report.left_out[0].why, Why::Missing { .. }), "{:?}", read.report);
        columns[2].1.pop();
        let message = open(columns.clone()).expect_err("one is shorter");
        assert!(message.contains("`u` has 299"), "{message}");
        columns.truncate(2);
        let message = open(columns).expect_err("one is missing");
        assert!(message.contains("no column `u`"), "{message}");
    }
}
