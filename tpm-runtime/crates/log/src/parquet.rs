//! Parquet files.
//!
//! Every column of numbers at the top of the schema or in a group is a column of the log; a nested one is named by its
//! path (`joint.position`). Lists and texts are not read. Timestamps are in the unit that the schema states. Row groups
//! are read one after the other, and of each the selected columns alone.

use crate::assumption::Assumption;
use crate::columns::{ColumnName, Columns};
use crate::error::LogError;
use bytes::Bytes;
use parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Rows that are decoded at a time.
const BATCH_ROWS: usize = 1 << 16;

/// Most rows of a row group: a few bytes may state that one value is repeated for more rows than the memory holds.
const MOST_ROWS: usize = 1 << 25;

/// A Parquet file.
pub(super) struct Parquet {
    path: String,
    reader: SerializedFileReader<Bytes>,
    header: Vec<ColumnName>,
    /// Column of the file by column of the header.
    places: Vec<usize>,
    wanted: Vec<usize>,
    /// The selected columns of the current row group.
    values: Vec<Vec<f64>>,
    /// Index of the next row group.
    next_group: usize,
    /// Index of the next row in the current group.
    next_row: usize,
    /// Rows that were taken in all.
    rows: u64,
}

/// A column as it is read here; nothing for one that holds no single numbers.
fn name(column: &ColumnDescriptor) -> Option<ColumnName> {
    let numeric =
        matches!(column.physical_type(), Type::BOOLEAN | Type::INT32 | Type::INT64 | Type::FLOAT | Type::DOUBLE);
    let decimal = column.converted_type() == ConvertedType::DECIMAL
        || matches!(column.logical_type_ref(), Some(LogicalType::Decimal(_)));
    if !numeric || decimal || column.max_rep_level() > 0 {
        return None;
    }
    let unit = match (column.logical_type_ref(), column.converted_type()) {
        (Some(LogicalType::Timestamp(stamp) | LogicalType::Time(stamp)), _) => Some(match stamp.unit {
            TimeUnit::MILLIS => "ms",
            TimeUnit::MICROS => "us",
            TimeUnit::NANOS => "ns",
        }),
        (_, ConvertedType::TIMESTAMP_MILLIS | ConvertedType::TIME_MILLIS) => Some("ms"),
        (_, ConvertedType::TIMESTAMP_MICROS | ConvertedType::TIME_MICROS) => Some("us"),
        _ => None,
    };
    Some(ColumnName { unit: unit.map(String::from), ..ColumnName::new(column.path().string()) })
}

/// The numbers of a column in a row group, NaN where there is none.
fn numbers<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    deepest: i16,
    number: impl Fn(&T::T) -> f64,
) -> Result<Vec<f64>, ParquetError> {
    let mut column = Vec::new();
    loop {
        let (mut levels, mut values) = (Vec::new(), Vec::new());
        let (records, ..) = reader.read_records(BATCH_ROWS, (deepest > 0).then_some(&mut levels), None, &mut values)?;
        if records == 0 {
            return Ok(column);
        }
        let mut present = values.iter().map(&number);
        if deepest > 0 {
            let value = |level: &i16| if *level == deepest { present.next().unwrap_or(f64::NAN) } else { f64::NAN };
            column.extend(levels.iter().map(value));
        } else {
            column.extend(present);
        }
        if column.len() > MOST_ROWS {
            return Err(too_many_rows());
        }
    }
}

impl Parquet {
    /// Reads the schema of a Parquet file; messages call it `path`.
    ///
    /// # Errors
    /// [`LogError`] when the file cannot be read or is damaged.
    pub(super) fn new(mut input: impl Read, path: &str) -> Result<Self, LogError> {
        let mut bytes = Vec::new();
        input.read_to_end(&mut bytes).map_err(|source| LogError::Io { path: path.into(), source })?;
        let reader = guarded(path, || SerializedFileReader::new(Bytes::from(bytes)))?;
        let schema = reader.metadata().file_metadata().schema_descr_ptr();
        let named = schema.columns().iter().enumerate().filter_map(|(place, column)| Some((place, name(column)?)));
        let (places, header) = named.unzip();
        Ok(Parquet {
            path: path.into(),
            reader,
            header,
            places,
            wanted: Vec::new(),
            values: Vec::new(),
            next_group: 0,
            next_row: 0,
            rows: 0,
        })
    }

    /// Reads the selected columns of the next row group.
    fn read_group(&mut self) -> Result<(), ParquetError> {
        let group = self.reader.get_row_group(self.next_group)?;
        let schema = self.reader.metadata().file_metadata().schema_descr_ptr();
        self.values.clear();
        for &column in &self.wanted {
            let place = self.places[column];
            let deepest = schema.column(place).max_def_level();
            self.values.push(match group.get_column_reader(place)? {
                ColumnReader::BoolColumnReader(reader) => {
                    numbers(reader, deepest, |value| f64::from(u8::from(*value)))?
                }
                ColumnReader::Int32ColumnReader(reader) => numbers(reader, deepest, |value| f64::from(*value))?,
                ColumnReader::Int64ColumnReader(reader) => numbers(reader, deepest, |value| *value as f64)?,
                ColumnReader::FloatColumnReader(reader) => numbers(reader, deepest, |value| f64::from(*value))?,
                ColumnReader::DoubleColumnReader(reader) => numbers(reader, deepest, |value| *value)?,
                _ => match usize::try_from(group.metadata().num_rows()) {
                    Ok(rows) if rows <= MOST_ROWS => vec![f64::NAN; rows],
                    _ => return Err(too_many_rows()),
                },
            });
        }
        self.next_group += 1;
        self.next_row = 0;
        Ok(())
    }
}

fn too_many_rows() -> ParquetError {
    ParquetError::General(format!("a row group has more than {MOST_ROWS} rows; write more groups"))
}

/// Reads a part of a file. The crate `parquet` panics on some damaged files; that is a fault of the file here.
fn guarded<T>(path: &str, read: impl FnOnce() -> Result<T, ParquetError>) -> Result<T, LogError> {
    match catch_unwind(AssertUnwindSafe(read)) {
        Ok(read) => read.map_err(|error| fault(path, &error)),
        Err(_) => Err(fault(path, &ParquetError::General("it is damaged".into()))),
    }
}

fn fault(path: &str, error: &ParquetError) -> LogError {
    LogError::Format {
        path: path.into(),
        what: format!("the Parquet file cannot be read: {error}"),
        remedy: "write it once more, packed with snappy or lz4 or not at all, or save the table as CSV".into(),
    }
}

impl Columns for Parquet {
    fn header(&self) -> &[ColumnName] {
        &self.header
    }

    fn header_line(&self) -> u64 {
        1
    }

    fn select(&mut self, wanted: &[usize]) {
        self.wanted = wanted.to_vec();
    }

    fn next_row(&mut self, values: &mut [f64]) -> Result<Option<u64>, LogError> {
        loop {
            let present = self.values.iter().all(|column| self.next_row < column.len());
            if present && !self.values.is_empty() {
                for (value, column) in values.iter_mut().zip(&self.values) {
                    *value = column[self.next_row];
                }
                self.next_row += 1;
                self.rows += 1;
                return Ok(Some(self.rows));
            }
            if self.next_group == self.reader.num_row_groups() {
                return Ok(None);
            }
            let path = self.path.clone();
            guarded(&path, || self.read_group())?;
        }
    }

    fn text(&self, field: usize) -> String {
        let row = self.next_row.checked_sub(1);
        row.and_then(|row| self.values[field].get(row)).map(f64::to_string).unwrap_or_default()
    }

    fn assumptions(&self) -> Vec<Assumption> {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::Parquet;
    use crate::columns::Columns as _;

    #[test]
    fn damaged_files_are_refused() {
        let fixture: &[u8] = include_bytes!("../../../../tests/fixtures/logs/slider.parquet");
        assert_eq!(Parquet::new(fixture, "run.parquet").expect("sound").header().len(), 4);
        for length in [0, 4, 100, fixture.len() - 1] {
            assert!(Parquet::new(&fixture[..length], "run.parquet").is_err(), "{length}");
        }
        let mut damaged = fixture.to_vec();
        for at in (0..fixture.len()).step_by(5) {
            damaged[at] ^= 0x55;
            if let Ok(mut file) = Parquet::new(&damaged[..], "run.parquet") {
                let columns = file.header().len();
                file.select(&(0..columns).collect::<Vec<_>>());
                let mut values = vec![0.0; columns];
                while let Ok(Some(_)) = file.next_row(&mut values) {}
            }
            damaged[at] ^= 0x55;
        }
    }
}
