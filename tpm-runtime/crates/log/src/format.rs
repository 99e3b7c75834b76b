//! Formats of logs, recognised by the first bytes of a file.

use crate::columns::Columns;
use crate::csv::{Csv, HEAD_BYTES, Lines};
use crate::error::LogError;
use crate::long::Long;
use crate::paired::Paired;
use crate::recorders::Recorder;
use crate::{json, npy, recorders, rosbag, sqlite, wpilog};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Share of control characters beyond which bytes are no text.
const MOST_CONTROL_CHARACTERS: f64 = 0.05;
/// Bytes at the beginning of a text whose lines tell its format.
const MOST_TOLD_BYTES: usize = 4096;

/// The format of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Text,
    Recorder(Recorder),
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
    /// A format that is recognised but not read: its description, and the remedy, in which FILE is the file.
    Other(&'static str, &'static str),
}

/// By what a format is recognised.
enum Mark {
    /// The first bytes.
    Bytes(&'static [u8]),
    /// The first bytes, by a rule.
    Head(fn(&[u8]) -> bool),
    /// The first lines of a text that are not blank.
    Lines(fn(&[&str]) -> bool),
}

const SAVE: &str = "save the table as UTF-8 text in columns (CSV)";
const MESSAGES: &str =
    "write the messages that are needed as CSV: `mavlogdump.py --format csv --types ATT FILE > run.csv`";

/// The remedy where a format is not built in.
#[cfg(not(all(feature = "mcap", feature = "parquet")))]
const SAVE_CSV: &str = "save the table as CSV";
#[cfg(not(feature = "mat73"))]
const RESAVE: &str = "save it with `save -v7` in MATLAB, or the table as CSV";

/// What formats are recognised by; the first that fits counts.
const KNOWN: [(Mark, Format); 41] = {
    use Format::*;
    use Mark::*;
    [
        (Bytes(b"\x89MCAP0\r\n"), Mcap),
        (Bytes(b"PAR1"), Parquet),
        (Bytes(b"MATLAB 5.0 MAT-file"), Mat),
        (Bytes(b"MATLAB 7.3 MAT-file"), Hdf5),
        (Bytes(b"\x89HDF\r\n\x1a\n"), Hdf5),
        (Bytes(npy::MAGIC), Npy),
        (Bytes(b"PK\x03\x04"), Zip),
        (Bytes(wpilog::MAGIC), Wpilog),
        (Bytes(sqlite::MAGIC), Sqlite),
        (Head(json::is_json), Json),
        (Lines(recorders::is_scope), Recorder(recorders::Recorder::TwinCat)),
        (Lines(recorders::is_trace), Recorder(recorders::Recorder::Codesys)),
        (Lines(recorders::is_measurement), Recorder(recorders::Recorder::LabView)),
        (Lines(recorders::is_messages), Recorder(recorders::Recorder::ArduPilot)),
        (Bytes(b"\x1f\x8b"), Other("the file is compressed (gzip)", "unpack it first: `gunzip -k FILE`")),
        (Bytes(b"\x28\xb5\x2f\xfd"), Other("the file is compressed (zstd)", "unpack it first: `unzstd FILE`")),
        (Bytes(b"\xfd7zXZ\x00"), Other("the file is compressed (xz)", "unpack it first: `unxz -k FILE`")),
        (Bytes(b"BZh"), Other("the file is compressed (bzip2)", "unpack it first: `bunzip2 -k FILE`")),
        (
            Bytes(b"#ROSBAG V"),
            Other("the file is a ROS 1 bag", "convert it: `mcap convert FILE run.mcap`, or save the table as CSV"),
        ),
        (Bytes(b"ULog\x01\x12\x35"), Other("the file is a ULog of PX4", "convert it to CSV: `ulog2csv FILE`")),
        (Bytes(b"\xa3\x95\x80"), Other("the file is a binary log of ArduPilot", MESSAGES)),
        (Bytes(b"MDF     "), Other("the file is an MDF recording", MDF)),
        (Bytes(b"UnFinMF "), Other("the file is an MDF recording that was not finished", MDF)),
        (
            Bytes(b"TDSm"),
            Other(
                "the file is a TDMS recording of LabVIEW",
                "export it as CSV: `python -c \"import sys, nptdms; nptdms.TdmsFile.read(sys.argv[1]).as_dataframe(time_index=True).to_csv('run.csv')\" FILE`",
            ),
        ),
        (Bytes(b"LOGG"), Other("the file is a BLF recording of a bus", DECODE)),
        (Bytes(b"\x80\x04\x95"), Other("the file is a pickle of Python", PICKLE)),
        (Bytes(b"\x80\x05\x95"), Other("the file is a pickle of Python", PICKLE)),
        (
            Bytes(b"ARROW1"),
            Other(
                "the file is an Arrow file",
                "save it as CSV: `python -c \"import sys, pandas; pandas.read_feather(sys.argv[1]).to_csv('run.csv')\" FILE`",
            ),
        ),
        (Bytes(b"\xd0\xcf\x11\xe0"), Other("the file is a spreadsheet", SAVE)),
        (Bytes(b"\xff\xfe"), Other("the text is UTF-16", UTF16)),
        (Bytes(b"\xfe\xff"), Other("the text is UTF-16", UTF16)),
        (Lines(is_candump), Other("the file is a log of candump: raw frames of a CAN bus", DECODE)),
        (
            Lines(
                |lines| matches!(lines, [first, second, ..] if first.starts_with("date ") && second.starts_with("base ")),
            ),
            Other("the file is a log of Vector (ASC): raw frames of a bus", DECODE),
        ),
        (
            Lines(|lines| lines.first().is_some_and(|line| line.starts_with(";$FILEVERSION"))),
            Other("the file is a trace of PEAK (TRC): raw frames of a CAN bus", DECODE),
        ),
        (
            Lines(|lines| {
                lines.first().is_some_and(|line| line.contains(": ") && line.contains(" {") && line.contains(" : "))
            }),
            Other("the file is what mavlogdump prints of a log of ArduPilot", MESSAGES),
        ),
        (
            Bytes(b"H Product:Blackbox"),
            Other("the file is a blackbox log of Betaflight", "write it as CSV: `blackbox_decode FILE`"),
        ),
        (
            Lines(|lines| {
                lines.first() == Some(&"header:") && lines.contains(&"---")
                    || lines.get(1).is_some_and(|line| line.starts_with("  seq:")) && lines[0] == "header:"
            }),
            Other("the file is what ROS prints of a topic", "print it as CSV: `ros2 topic echo --csv TOPIC > run.csv`"),
        ),
        (
            Bytes(b"version https://git-lfs"),
            Other("the file is a pointer of Git LFS, without the data", "fetch the file itself: `git lfs pull`"),
        ),
        (
            Bytes(b"<?xml"),
            Other(
                "the file is XML, such as a project of TwinCAT Scope or a .trace of CODESYS",
                "export the record as CSV from the program that wrote it",
            ),
        ),
        (Bytes(b"<!DOCTYPE"), Other("the file is a web page", "download the data itself")),
        (Bytes(b"<html"), Other("the file is a web page", "download the data itself")),
    ]
};

const DECODE: &str = "decode it with the DBC of the bus and save the signals as CSV, with a column of the time: `cantools decode machine.dbc < FILE` prints them, asammdf exports them";
const MDF: &str =
    "export it as CSV: `python -c \"import sys, asammdf; asammdf.MDF(sys.argv[1]).export('csv', 'run.csv')\" FILE`";
const PICKLE: &str =
    "save it as CSV: `python -c \"import sys, pandas; pandas.read_pickle(sys.argv[1]).to_csv('run.csv')\" FILE`";
const UTF16: &str = "save it as UTF-8: `iconv -f UTF-16 -t UTF-8 FILE > run.csv`";

/// Whether lines are frames of a CAN bus, as candump logs (`(TIME) can0 201#0011`) or prints them (`can0  201   [2]  00 11`).
fn is_candump(lines: &[&str]) -> bool {
    let frame = |line: &&str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let stamped = usize::from(words.first().is_some_and(|word| word.starts_with('(') && word.ends_with(')')));
        let hex = |text: &str| !text.is_empty() && text.chars().all(|sign| sign.is_ascii_hexdigit());
        match words[stamped.min(words.len())..] {
            [_, frame, ..] if stamped == 1 && frame.contains('#') => hex(frame.split('#').next().unwrap_or("")),
            [_, id, size, ..] => hex(id) && size.starts_with('[') && size.ends_with(']'),
            _ => false,
        }
    };
    !lines.is_empty() && lines.iter().take(2).all(frame)
}

impl Format {
    fn of(head: &[u8]) -> Self {
        let text = String::from_utf8_lossy(&head[..head.len().min(MOST_TOLD_BYTES)]);
        let text = text.trim_start_matches('\u{feff}');
        let lines: Vec<&str> = text.lines().map(str::trim_end).filter(|line| !line.is_empty()).collect();
        let fits = |mark: &Mark| match mark {
            Mark::Bytes(bytes) => head.starts_with(bytes),
            Mark::Head(rule) => rule(head),
            Mark::Lines(rule) => rule(&lines),
        };
        if let Some((_, format)) = KNOWN.iter().find(|(mark, _)| fits(mark)) {
            return *format;
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
    let named = if path.contains([' ', '"', '\'', '$']) { format!("'{path}'") } else { path.to_owned() };
    let fault = |what: &str, remedy: &str| LogError::Format {
        path: path.into(),
        what: what.into(),
        remedy: remedy.replace("FILE", &named),
    };
    match Format::of(head) {
        Format::Text => {
            let table = Csv::new(path, lines)?;
            match (Long::of(table.header()), Paired::of(table.header())) {
                (Some(long), _) => Ok(Box::new(long.read(table)?)),
                (_, Some(paired)) => Ok(Box::new(paired.read(table)?)),
                (None, None) => Ok(Box::new(table)),
            }
        }
        Format::Recorder(recorder) => Ok(Box::new(recorder.read(lines.into_rest(), path)?)),
        Format::Json => Ok(Box::new(json::read(lines.into_rest(), path)?.of_kind("JSON"))),
        Format::Npy => Ok(Box::new(npy::read(lines.into_rest(), path)?.of_kind("an array of NumPy"))),
        Format::Zip => Ok(Box::new(npy::read_archive(lines.into_rest(), path)?.of_kind("an archive of NumPy"))),
        Format::Wpilog => Ok(Box::new(wpilog::read(lines.into_rest(), path)?)),
        Format::Sqlite => Ok(Box::new(rosbag::read(lines.into_rest(), path)?.of_kind("a ROS 2 bag of joint states"))),
        Format::Mat => Ok(Box::new(crate::mat::read(lines.into_rest(), path)?.of_kind("a MAT-file"))),
        #[cfg(feature = "mcap")]
        Format::Mcap => {
            Ok(Box::new(crate::mcap::read(lines.into_rest(), path)?.of_kind("an MCAP file of joint states")))
        }
        #[cfg(not(feature = "mcap"))]
        Format::Mcap => Err(without(path, "MCAP", "mcap", SAVE_CSV)),
        #[cfg(feature = "parquet")]
        Format::Parquet => Ok(Box::new(crate::parquet::Parquet::new(lines.into_rest(), path)?)),
        #[cfg(not(feature = "parquet"))]
        Format::Parquet => Err(without(path, "Parquet", "parquet", SAVE_CSV)),
        #[cfg(feature = "mat73")]
        Format::Hdf5 => {
            Ok(Box::new(crate::mat73::read(lines.into_rest(), path)?.of_kind("a MAT-file of MATLAB 7.3, or HDF5")))
        }
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
        for (text, part) in [
            ("(1700000000.000000) can0 201#0011AABB\n(1700000000.010000) can0 201#0011\n", "candump"),
            ("(1700000000.000000) vcan1 18FEF100##1AABB\n", "candump"),
            ("  can0  201   [4]  00 11 22 33\n  can0  1F0   [0]\n", "candump"),
            (" (010.5)  can0  201   [4]  00 11 22 33\n", "candump"),
            ("date Mon Jan 1 10:00:00 2024\nbase hex  timestamps absolute\n", "Vector"),
            (";$FILEVERSION=1.1\n;\n", "PEAK"),
            ("2024-01-01 10:00:00.00: ATT {TimeUS : 1, Roll : 0.5}\n", "mavlogdump"),
            ("header:\n  seq: 1\n", "ROS"),
        ] {
            assert!(matches!(Format::of(text.as_bytes()), Format::Other(what, _) if what.contains(part)), "{text}");
        }
        for text in ["Name,Value\na,1\n", "Name;x\nCart;1\n", "can0,201\n1,2\n", "t,FMT\n1,2\n", "key,value\n1,2\n"] {
            assert_eq!(Format::of(text.as_bytes()), Format::Text, "{text}");
        }
    }

    #[test]
    fn a_format_that_is_not_read_says_a_command_for_the_file() {
        let error =
            super::open_columns(&b"ULog\x01\x12\x35\x01"[..], "my run.ulg").err().expect("not read").to_string();
        assert_eq!(error, "my run.ulg: the file is a ULog of PX4; convert it to CSV: `ulog2csv 'my run.ulg'`");
    }
}
