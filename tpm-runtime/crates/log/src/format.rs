//! Formats of logs, recognised by the first bytes of a file.

use crate::columns::Columns;
use crate::csv::{Csv, HEAD_BYTES, Lines};
use crate::error::LogError;
use crate::long::Long;
use crate::paired::Paired;
use crate::{json, npy, rosbag, sqlite, wpilog};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Share of control characters beyond which bytes are no text.
const MOST_CONTROL_CHARACTERS: f64 = 0.05;

/// The format of a file, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Text,
    Mcap,
    Parquet,
    Mat,
    /// MATLAB 7.3, or HDF5 by any other name.
    Hdf5,
    Npy,
    /// A ZIP archive, of arrays or of something else.
    Zip,
    Json,
    Wpilog,
    Sqlite,
    /// A format that is recognised but not read: its description, and the remedy.
    Other(&'static str, &'static str),
}

const SAVE: &str = "save the table as UTF-8 text in columns (CSV)";
const UNPACK: &str = "unpack it first";
const EXPORT: &str = "export the signals as CSV or NPZ";

/// The remedy where a format is not built in.
#[cfg(not(all(feature = "mcap", feature = "parquet")))]
const SAVE_CSV: &str = "save the table as CSV";
#[cfg(not(feature = "mat73"))]
const RESAVE: &str = "save it with `save -v7` in MATLAB, or the table as CSV";

/// The first bytes of files, and the format of files that begin with them.
const MAGIC: [(&[u8], Format); 25] = [
    (b"\x89MCAP0\r\n", Format::Mcap),
    (b"PAR1", Format::Parquet),
    (b"MATLAB 5.0 MAT-file", Format::Mat),
    (b"MATLAB 7.3 MAT-file", Format::Hdf5),
    (b"\x89HDF\r\n\x1a\n", Format::Hdf5),
    (b"\x1f\x8b", Format::Other("the file is compressed (gzip)", UNPACK)),
    (b"\x28\xb5\x2f\xfd", Format::Other("the file is compressed (zstd)", UNPACK)),
    (b"\xfd7zXZ\x00", Format::Other("the file is compressed (xz)", UNPACK)),
    (b"BZh", Format::Other("the file is compressed (bzip2)", UNPACK)),
    (npy::MAGIC, Format::Npy),
    (b"PK\x03\x04", Format::Zip),
    (wpilog::MAGIC, Format::Wpilog),
    (sqlite::MAGIC, Format::Sqlite),
    (b"#ROSBAG V", Format::Other("the file is a ROS 1 bag", "convert it to MCAP, or save the table as CSV")),
    (b"ULog\x01\x12\x35", Format::Other("the file is a ULog of PX4", "convert it with `ulog2csv` to CSV")),
    (b"MDF     ", Format::Other("the file is an MDF recording", EXPORT)),
    (b"UnFinMF ", Format::Other("the file is an MDF recording that was not finished", EXPORT)),
    (b"TDSm\x0e\x00\x00\x00", Format::Other("the file is a TDMS recording of LabVIEW", EXPORT)),
    (b"LOGG\x90\x00\x00\x00", Format::Other("the file is a BLF recording of a bus", EXPORT)),
    (b"\x80\x04\x95", Format::Other("the file is a pickle of Python", EXPORT)),
    (b"\x80\x05\x95", Format::Other("the file is a pickle of Python", EXPORT)),
    (b"ARROW1", Format::Other("the file is an Arrow file", "save it as Parquet or as CSV")),
    (b"\xd0\xcf\x11\xe0", Format::Other("the file is a spreadsheet", SAVE)),
    (b"\xff\xfe", Format::Other("the text is UTF-16", SAVE)),
    (b"\xfe\xff", Format::Other("the text is UTF-16", SAVE)),
];

impl Format {
    fn of(head: &[u8]) -> Self {
        if let Some((_, format)) = MAGIC.iter().find(|(magic, _)| head.starts_with(magic)) {
            return *format;
        }
        if json::is_json(head) {
            return Format::Json;
        }
        let control = |byte: &&u8| byte.is_ascii_control() && !byte.is_ascii_whitespace();
        let controls = head.iter().filter(control).count();
        if head.contains(&0) || controls as f64 > MOST_CONTROL_CHARACTERS * head.len() as f64 {
            return Format::Other("the file is no text, and of no format that is read here", SAVE);
        }
        Format::Text
    }
}

/// The file of a log.
pub(super) fn open_file(path: &Path) -> Result<File, LogError> {
    File::open(path).map_err(|source| LogError::Io { path: path.display().to_string(), source })
}

/// The columns of a file of any format; messages call it `path`.
///
/// # Errors
/// [`LogError`] when the file cannot be read, or is of a format that is not read.
pub(super) fn open_columns<'a>(input: impl Read + 'a, path: &str) -> Result<Box<dyn Columns + 'a>, LogError> {
    let mut lines = Lines::new(input);
    let head = lines.fill(HEAD_BYTES).map_err(|source| LogError::Io { path: path.into(), source })?;
    let fault =
        |what: &str, remedy: &str| LogError::Format { path: path.into(), what: what.into(), remedy: remedy.into() };
    match Format::of(head) {
        Format::Text => {
            let table = Csv::new(path, lines)?;
            match (Long::of(table.header()), Paired::of(table.header())) {
                (Some(long), _) => Ok(Box::new(long.read(table)?)),
                (_, Some(paired)) => Ok(Box::new(paired.read(table)?)),
                (None, None) => Ok(Box::new(table)),
            }
        }
        Format::Json => Ok(Box::new(json::read(lines.into_rest(), path)?)),
        Format::Npy => Ok(Box::new(npy::read(lines.into_rest(), path)?)),
        Format::Zip => Ok(Box::new(npy::read_archive(lines.into_rest(), path)?)),
        Format::Wpilog => Ok(Box::new(wpilog::read(lines.into_rest(), path)?)),
        Format::Sqlite => Ok(Box::new(rosbag::read(lines.into_rest(), path)?)),
        Format::Mat => Ok(Box::new(crate::mat::read(lines.into_rest(), path)?)),
        #[cfg(feature = "mcap")]
        Format::Mcap => Ok(Box::new(crate::mcap::read(lines.into_rest(), path)?)),
        #[cfg(not(feature = "mcap"))]
        Format::Mcap => Err(without(path, "MCAP", "mcap", SAVE_CSV)),
        #[cfg(feature = "parquet")]
        Format::Parquet => Ok(Box::new(crate::parquet::Parquet::new(lines.into_rest(), path)?)),
        #[cfg(not(feature = "parquet"))]
        Format::Parquet => Err(without(path, "Parquet", "parquet", SAVE_CSV)),
        #[cfg(feature = "mat73")]
        Format::Hdf5 => Ok(Box::new(crate::mat73::read(lines.into_rest(), path)?)),
        #[cfg(not(feature = "mat73"))]
        Format::Hdf5 => Err(without(path, "HDF5, such as a MAT-file of MATLAB 7.3", "mat73", RESAVE)),
        Format::Other(what, remedy) => match lone_zero(head) {
            Some(line) => Err(LogError::Csv {
                path: path.into(),
                line,
                message: "the text holds a byte of value zero; cut the log around it or repair the recording".into(),
            }),
            None => Err(fault(what, remedy)),
        },
    }
}

/// Line of the first zero byte in a file that is text up to there, such as a log that was damaged while it was written.
fn lone_zero(head: &[u8]) -> Option<u64> {
    let at = head.iter().position(|byte| *byte == 0)?;
    let text = |byte: &u8| *byte != 0 && (!byte.is_ascii_control() || byte.is_ascii_whitespace());
    let lines = head[..at].iter().filter(|byte| **byte == b'\n').count() as u64;
    let is_text = lines > 0 && head[..at].iter().all(text) && std::str::from_utf8(&head[..at]).is_ok();
    is_text.then_some(lines + 1)
}

/// The fault of a format that this build does not read.
#[cfg(not(all(feature = "mat73", feature = "mcap", feature = "parquet")))]
fn without(path: &str, what: &str, feature: &str, otherwise: &str) -> LogError {
    LogError::Format {
        path: path.into(),
        what: format!("the file is {what}, which is read with the feature `{feature}` only"),
        remedy: format!("build with it (`cargo build --release -p tpm-cli --features {feature}`), or {otherwise}"),
    }
}

#[cfg(test)]
mod tests {
    use super::Format;

    #[test]
    fn formats_are_told_by_their_first_bytes() {
        assert_eq!(Format::of(b"t_s,x,u\n0,1,2\n"), Format::Text);
        assert_eq!(Format::of("t_s,q [°]\n".as_bytes()), Format::Text);
        assert_eq!(Format::of(b"PAR1\x15\x00"), Format::Parquet);
        assert_eq!(Format::of(b"MATLAB 5.0 MAT-file, Platform"), Format::Mat);
        assert!(matches!(Format::of(b"a,b\n1,\x002\n"), Format::Other(..)));
        assert!(matches!(Format::of(b"\xff\xfet\x00"), Format::Other("the text is UTF-16", _)));
        assert_eq!(Format::of(b""), Format::Text);
        assert_eq!(Format::of(b"\x93NUMPY\x01\x00"), Format::Npy);
        assert_eq!(Format::of(b"{\"t\": [0, 1]}"), Format::Json);
        assert!(matches!(Format::of(b"ULog\x01\x12\x35\x01"), Format::Other("the file is a ULog of PX4", _)));
    }
}
