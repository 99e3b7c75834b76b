//! A track as Parquet.

use crate::error::LogError;
use crate::options::TIME;
use crate::track::signals::Track;
use parquet::basic::{Compression, Repetition, Type as Physical};
use parquet::data_type::DoubleType;
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::sync::Arc;

/// Rows of a group: readers hold a group of the columns they want at a time.
const GROUP_ROWS: usize = 1 << 20;

/// The bytes of a file with one column of numbers for the time and for every signal; a missing reading is null.
///
/// # Errors
/// [`LogError::Format`] for what cannot be written, such as two signals of one name.
pub(super) fn written(track: &Track) -> Result<Vec<u8>, LogError> {
    table(track).map_err(|error| LogError::Format {
        path: "the Parquet file".into(),
        what: format!("it cannot be written: {error}"),
        remedy: "write CSV".into(),
    })
}

fn table(track: &Track) -> Result<Vec<u8>, ParquetError> {
    let columns =
        || [(TIME, &track.time)].into_iter().chain(track.signals.iter().map(|(name, of)| (name.as_str(), of)));
    let field = |name| {
        let field = Type::primitive_type_builder(name, Physical::DOUBLE).with_repetition(Repetition::OPTIONAL);
        field.build().map(Arc::new)
    };
    let fields = columns().map(|(name, _)| field(name)).collect::<Result<_, _>>()?;
    let schema = Type::group_type_builder("schema").with_fields(fields).build()?;
    let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
    let mut bytes = Vec::new();
    let mut file = SerializedFileWriter::new(&mut bytes, Arc::new(schema), Arc::new(properties))?;
    for from in (0..track.time.len()).step_by(GROUP_ROWS) {
        let mut group = file.next_row_group()?;
        for (_, values) in columns() {
            let rows = &values[from..values.len().min(from + GROUP_ROWS)];
            let levels: Vec<i16> = rows.iter().map(|value| i16::from(!value.is_nan())).collect();
            let present: Vec<f64> = rows.iter().copied().filter(|value| !value.is_nan()).collect();
            let Some(mut column) = group.next_column()? else { break };
            column.typed::<DoubleType>().write_batch(&present, Some(&levels), None)?;
            column.close()?;
        }
        group.close()?;
    }
    file.close()?;
    Ok(bytes)
}
