//! MAT-files of MATLAB 7.3, which are HDF5, and other HDF5 files.
//!
//! A dataset of numbers at the root is a variable, as in MAT-files before: a column for every one of its columns, whose longer side is time.
//! MATLAB states its class in the attribute `MATLAB_class`; texts, logical arrays, and groups such as structures are not read.

use crate::error::LogError;
use crate::packed::MOST_UNPACKED;
use crate::stored::{Stored, StoredColumn};
use hdf5_reader::{Dataset, Datatype, Hdf5File, OpenOptions};
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Largest ratio of unpacked bytes to the bytes of the file: deflate unpacks one byte to 1032 at most. A damaged header
/// may state more than the memory holds.
const MOST_UNPACKING: usize = 1100;
/// Classes of MATLAB that are no signals, although they are stored as numbers.
const NO_SIGNALS: [&str; 3] = ["char", "logical", "cell"];

/// Reads the numeric variables of a MAT-file of MATLAB 7.3; messages call it `path`.
///
/// # Errors
/// [`LogError`] when the file cannot be read, is damaged, or has no numeric variables.
pub(super) fn read(mut input: impl Read, path: &str) -> Result<Stored<'static>, LogError> {
    let fault = |what: String| LogError::Format {
        path: path.into(),
        what,
        remedy: "save the signals once more, as vectors with `save -v7`, or as CSV".into(),
    };
    let mut bytes = Vec::new();
    input.read_to_end(&mut bytes).map_err(|source| LogError::Io { path: path.into(), source })?;
    // The reader may panic on a damaged file, which is reported as a fault of the file.
    let found = catch_unwind(AssertUnwindSafe(|| variables(bytes)));
    let (columns, others) = match found {
        Ok(Ok(found)) => found,
        Ok(Err(error)) => return Err(fault(format!("the HDF5 file cannot be read: {error}"))),
        Err(_) => return Err(fault("the HDF5 file is damaged".to_string())),
    };
    if columns.is_empty() {
        let found = if others.is_empty() { String::new() } else { format!(", only {}", others.join(", ")) };
        return Err(fault(format!("the HDF5 file has no vectors of real numbers at its root{found}")));
    }
    Ok(Stored::new(path, columns))
}

/// The columns of all numeric datasets at the root, and the names of everything else there.
fn variables(bytes: Vec<u8>) -> Result<(Vec<StoredColumn<'static>>, Vec<String>), hdf5_reader::error::Error> {
    let unpacked = usize::try_from(MOST_UNPACKED).unwrap_or(usize::MAX).max(bytes.len());
    let most = bytes.len().saturating_mul(MOST_UNPACKING).min(unpacked);
    let options = OpenOptions::default().with_max_read_bytes(most).with_max_chunk_bytes(most);
    let file = Hdf5File::from_vec_with_options(bytes, options)?;
    let (groups, mut datasets) = file.root_group()?.members()?;
    // References, with which MATLAB stores cells, are no variables.
    let names = groups.iter().map(|group| group.name().trim_start_matches('/').to_string());
    let mut others: Vec<String> = names.filter(|name| !name.starts_with('#')).collect();
    datasets.sort_by(|a, b| a.name().cmp(b.name()));
    let mut columns = Vec::new();
    for dataset in datasets {
        let name = dataset.name().trim_start_matches('/').to_string();
        match signal(&dataset) {
            Some((rows, wide)) => {
                let values = numbers(&dataset.read_native_bytes()?, dataset.dtype());
                match values.filter(|values| rows.checked_mul(wide) == Some(values.len())) {
                    Some(values) => columns.extend(StoredColumn::of_matrix(&name, values, rows, wide)),
                    None => others.push(name),
                }
            }
            None => others.push(name),
        }
    }
    Ok((columns, others))
}

/// Rows and columns of a dataset that may be a signal: MATLAB's dimensions are stored in reverse order. Nothing for a
/// dataset that is no matrix of numbers.
fn signal(dataset: &Dataset) -> Option<(usize, usize)> {
    let class = dataset.attribute("MATLAB_class").and_then(|class| class.read_string()).unwrap_or_default();
    let numeric = matches!(dataset.dtype(), Datatype::FixedPoint { .. } | Datatype::FloatingPoint { .. });
    if !numeric || NO_SIGNALS.contains(&class.trim_end_matches('\0')) {
        return None;
    }
    match *dataset.shape() {
        [rows] => Some((rows as usize, 1)),
        [columns, rows] => Some((rows as usize, columns as usize)),
        _ => None,
    }
}

/// Numbers from their bytes in the order of this machine; nothing for a kind that has no such number.
fn numbers(bytes: &[u8], kind: &Datatype) -> Option<Vec<f64>> {
    macro_rules! read {
        ($number:ty) => {{
            let chunks = bytes.chunks_exact(size_of::<$number>());
            chunks.map(|chunk| Some(<$number>::from_ne_bytes(chunk.try_into().ok()?) as f64)).collect()
        }};
    }
    match kind {
        Datatype::FloatingPoint { size: 8, .. } => read!(f64),
        Datatype::FloatingPoint { size: 4, .. } => read!(f32),
        Datatype::FixedPoint { size: 1, signed: true, .. } => read!(i8),
        Datatype::FixedPoint { size: 1, .. } => read!(u8),
        Datatype::FixedPoint { size: 2, signed: true, .. } => read!(i16),
        Datatype::FixedPoint { size: 2, .. } => read!(u16),
        Datatype::FixedPoint { size: 4, signed: true, .. } => read!(i32),
        Datatype::FixedPoint { size: 4, .. } => read!(u32),
        Datatype::FixedPoint { size: 8, signed: true, .. } => read!(i64),
        Datatype::FixedPoint { size: 8, .. } => read!(u64),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::read;
    use crate::columns::Columns as _;

    const FIXTURES: [&[u8]; 2] = [
        include_bytes!("../../../../tests/fixtures/logs/matlab73.mat"),
        include_bytes!("../../../../tests/fixtures/logs/slider.h5"),
    ];

    #[test]
    fn datasets_of_numbers_are_columns() {
        for fixture in FIXTURES {
            let file = read(fixture, "run.mat").expect("sound");
            let names: Vec<&str> = file.header().iter().map(|column| column.text.as_str()).collect();
            for name in ["t_s", "u", "both[1]", "both[2]"] {
                assert!(names.contains(&name), "{name}: {names:?}");
            }
            assert!(!names.contains(&"note") && !names.contains(&"setting"), "{names:?}");
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        for fixture in FIXTURES {
            for length in [0, 8, 512, 600, fixture.len() / 2] {
                assert!(read(&fixture[..length], "run.mat").is_err(), "{length}");
            }
            let mut damaged = fixture.to_vec();
            for at in (0..fixture.len()).step_by(11) {
                damaged[at] ^= 0x55;
                let _ = read(&damaged[..], "run.mat");
                damaged[at] ^= 0x55;
            }
        }
    }
}
