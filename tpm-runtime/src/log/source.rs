//! Where the columns of a log are: in a file, or in memory.

use crate::log::columns::{ColumnName, Columns};
use crate::log::error::LogError;
use crate::log::fingerprint::{FingerprintReader, fingerprint_of};
use crate::log::format::open_columns;
use crate::log::read::open_file;
use crate::log::stored::{Stored, StoredColumn};
use std::borrow::Cow;
use std::boxed::Box;
use std::iter;
use std::path::{Path, PathBuf};
use std::string::{String, ToString as _};
use std::sync::Arc;
use std::vec::Vec;

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

    /// What tells these samples from others.
    fn fingerprint(&self) -> String {
        let bytes = |value: &f64| value.to_le_bytes();
        fingerprint_of(self.columns.iter().flat_map(|(name, values)| {
            let name = name.bytes().chain(iter::once(0));
            name.chain(values.iter().flat_map(move |value| bytes(value)))
        }))
    }
}

/// Where the columns of a log are.
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

    /// What tells it from others.
    ///
    /// # Errors
    /// [`LogError::Io`] when a file cannot be read.
    pub(crate) fn fingerprint(self) -> Result<String, LogError> {
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
