//! MCAP files with `sensor_msgs/msg/JointState` of ROS 2.
//!
//! A file is a list of records, each an operation code, a length and its content; chunks hold such lists, compressed or not.

use crate::cursor::Cursor;
use crate::error::LogError;
use crate::joint_state::{CDR, JOINT_STATE, Topic};
use crate::packed::{MOST_UNPACKED, Room};
use crate::stored::Stored;
use std::collections::BTreeMap;
use std::io::Read;

/// Bytes at the beginning of a file.
const MAGIC: usize = 8;
/// Operation codes of records.
const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0f;

/// The contents of a file that were read so far.
#[derive(Default)]
struct File {
    /// Types by number.
    schemas: BTreeMap<u16, String>,
    /// Topics by the number of their channel, with the type and the encoding of their messages.
    channels: BTreeMap<u16, (String, String, String)>,
    topics: BTreeMap<u16, Topic>,
}

impl File {
    /// Takes in a record that is no chunk; nothing where it is damaged.
    fn record(&mut self, code: u8, content: &[u8]) -> Option<()> {
        let mut cursor = Cursor::new(content);
        match code {
            SCHEMA => {
                let (id, name) = (cursor.u16()?, cursor.text()?);
                self.schemas.insert(id, name);
            }
            CHANNEL => {
                let (id, schema, topic, encoding) = (cursor.u16()?, cursor.u16()?, cursor.text()?, cursor.text()?);
                let kind = self.schemas.get(&schema).cloned().unwrap_or_default();
                self.channels.insert(id, (topic, kind, encoding));
            }
            MESSAGE => {
                let (channel, _, log_time, _) =
                    (cursor.u16()?, cursor.u32()?, cursor.unsigned(8)?, cursor.unsigned(8)?);
                let (topic, kind, encoding) = self.channels.get(&channel)?;
                if kind == JOINT_STATE && encoding == CDR {
                    let own = self.topics.entry(channel).or_insert_with(|| Topic::new(topic));
                    own.push(cursor.rest(), log_time)?;
                }
            }
            _ => {}
        }
        Some(())
    }

    /// Takes in the records of a chunk.
    fn records(&mut self, records: &[u8]) -> Option<()> {
        let mut cursor = Cursor::new(records);
        while !cursor.rest().is_empty() {
            let code = cursor.u8()?;
            let length = usize::try_from(cursor.unsigned(8)?).ok()?;
            self.record(code, cursor.take(length)?)?;
        }
        Some(())
    }
}

/// Why a chunk could not be unpacked.
enum Unread {
    Damaged,
    /// It is compressed in this way.
    Compression(String),
    /// It unpacks to more than [`MOST_UNPACKED`].
    TooLong,
}

/// The records of a chunk, unpacked.
fn unpacked(content: &[u8]) -> Result<Vec<u8>, Unread> {
    let mut cursor = Cursor::new(content);
    let mut parts = || {
        cursor.take(8 + 8)?;
        let size = cursor.unsigned(8)?;
        cursor.u32()?;
        let compression = cursor.text()?;
        let length = usize::try_from(cursor.unsigned(8)?).ok()?;
        Some((size, compression, cursor.take(length)?))
    };
    let (size, compression, packed) = parts().ok_or(Unread::Damaged)?;
    let mut room = Room::new();
    let read = match compression.as_str() {
        "" => return Ok(packed.to_vec()),
        "lz4" => room.unpack(lz4_flex::frame::FrameDecoder::new(packed).take(size)),
        "zstd" => {
            let decoder = ruzstd::decoding::StreamingDecoder::new(packed).map_err(|_| Unread::Damaged)?;
            room.unpack(decoder.take(size))
        }
        other => return Err(Unread::Compression(other.to_string())),
    };
    read.map_err(|_| Unread::Damaged)?.ok_or(Unread::TooLong)
}

/// Reads the joint states of an MCAP file; messages call it `path`.
///
/// # Errors
/// [`LogError`] when the file cannot be read, is damaged, or has no joint states.
pub(super) fn read(mut input: impl Read, path: &str) -> Result<Stored<'static>, LogError> {
    let io = |source| LogError::Io { path: path.into(), source };
    let fault = |what: String, remedy: &str| LogError::Format { path: path.into(), what, remedy: remedy.into() };
    let cut =
        || fault("the MCAP file is cut short or damaged".into(), "repair it with `mcap recover`, or record once more");
    let mut bytes = Vec::new();
    input.by_ref().take(MAGIC as u64).read_to_end(&mut bytes).map_err(io)?;
    let mut file = File::default();
    loop {
        bytes.clear();
        input.by_ref().take(9).read_to_end(&mut bytes).map_err(io)?;
        let mut head = Cursor::new(&bytes);
        let (Some(code), Some(length)) = (head.u8(), head.unsigned(8)) else { return Err(cut()) };
        if code == DATA_END || code == FOOTER {
            break;
        }
        bytes.clear();
        input.by_ref().take(length).read_to_end(&mut bytes).map_err(io)?;
        if bytes.len() as u64 != length {
            return Err(cut());
        }
        let taken = if code == CHUNK {
            let records = unpacked(&bytes).map_err(|reason| match reason {
                Unread::Compression(name) => fault(
                    format!("the MCAP file is compressed with {name}"),
                    "compress it with zstd, lz4, or not at all",
                ),
                Unread::TooLong => fault(
                    format!("a chunk of the MCAP file unpacks to more than {} MiB", MOST_UNPACKED >> 20),
                    "write it once more in smaller chunks (`mcap recover --chunk-size`)",
                ),
                Unread::Damaged => cut(),
            })?;
            file.records(&records)
        } else {
            file.record(code, &bytes)
        };
        taken.ok_or_else(cut)?;
    }
    if file.topics.is_empty() {
        let found: Vec<String> =
            file.channels.values().map(|(topic, kind, encoding)| format!("{topic} ({kind}, {encoding})")).collect();
        let found = if found.is_empty() { String::new() } else { format!(", only {}", found.join(", ")) };
        let what = format!("the MCAP file has no messages of {JOINT_STATE} in {CDR}{found}");
        return Err(fault(what, "record a topic of joint states, or save the signals as CSV"));
    }
    Ok(Stored::new(path, Topic::columns_of_all(file.topics.into_values().collect())))
}

#[cfg(test)]
mod tests {
    use super::read;
    use crate::columns::Columns as _;

    const FIXTURES: [&[u8]; 3] = [
        include_bytes!("../../../../tests/fixtures/logs/joint_states.mcap"),
        include_bytes!("../../../../tests/fixtures/logs/joint_states_lz4.mcap"),
        include_bytes!("../../../../tests/fixtures/logs/joint_states_zstd.mcap"),
    ];

    #[test]
    fn joints_are_columns() {
        for fixture in FIXTURES {
            let file = read(fixture, "run.mcap").expect("sound");
            let names: Vec<&str> = file.header().iter().map(|column| column.text.as_str()).collect();
            let expected =
                ["stamp.sec", "stamp.nanosec", "log_time", "position.slider", "position.idle", "effort.slider"];
            assert!(expected.iter().all(|name| names.contains(name)), "{names:?}");
            // Velocities are empty in these messages.
            assert!(!names.iter().any(|name| name.starts_with("velocity")), "{names:?}");
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        let fixture = FIXTURES[0];
        for length in [0, 7, 8, 12, 60, 400, fixture.len() / 2] {
            assert!(read(&fixture[..length], "run.mcap").is_err(), "{length}");
        }
        for fixture in FIXTURES {
            let mut damaged = fixture.to_vec();
            for at in (8..fixture.len()).step_by(7) {
                damaged[at] ^= 0x55;
                let _ = read(&damaged[..], "run.mcap");
                damaged[at] ^= 0x55;
            }
        }
    }
}
