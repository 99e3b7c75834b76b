//! MCAP files with `sensor_msgs/msg/JointState` of ROS 2.
//!
//! A file is a list of records, each an operation code, a length and its content; chunks hold such lists, compressed or not. A message
//! of joint states is a row: columns `position.NAME`, `velocity.NAME` and `effort.NAME` for every joint, `stamp.sec` and
//! `stamp.nanosec` from its header, and `log_time` in nanoseconds. Velocity and effort may be empty. Where several topics have joint
//! states, the topic stands before the column: `/left/joint_states:position.elbow`. Where no header is stamped, `time` is the time at
//! which messages were logged.

use crate::columns::ColumnName;
use crate::error::LogError;
use crate::packed::{MOST_UNPACKED, Room};
use crate::stored::{Stored, StoredColumn};
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
/// The type that is read.
const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
/// The encoding of its messages.
const CDR: &str = "cdr";
/// Groups of readings of a joint, in the order of the message.
const GROUPS: [&str; 3] = ["position", "velocity", "effort"];

/// A cursor over bytes; every method gives nothing where the bytes end too soon.
struct Taken<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Taken<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let part = self.bytes.get(self.at..self.at.checked_add(length)?)?;
        self.at += length;
        Some(part)
    }

    fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(self.take(2)?.try_into().ok()?))
    }

    fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.take(4)?.try_into().ok()?))
    }

    fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.take(8)?.try_into().ok()?))
    }

    fn text(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        Some(String::from_utf8_lossy(self.take(length)?).into_owned())
    }

    fn rest(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }
}

/// Common data representation: numbers are aligned to their size behind four bytes that state the order of bytes.
struct Cdr<'a> {
    body: Taken<'a>,
    big: bool,
}

impl<'a> Cdr<'a> {
    fn new(message: &'a [u8]) -> Option<Self> {
        Some(Cdr { big: *message.get(1)? & 1 == 0, body: Taken::new(message.get(4..)?) })
    }

    fn align(&mut self, size: usize) -> Option<()> {
        let padding = self.body.at.next_multiple_of(size) - self.body.at;
        self.body.take(padding).map(|_| ())
    }

    fn u32(&mut self) -> Option<u32> {
        self.align(4)?;
        let value = self.body.u32()?;
        Some(if self.big { value.swap_bytes() } else { value })
    }

    fn text(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        let text = String::from_utf8_lossy(self.body.take(length)?).into_owned();
        Some(text.trim_end_matches('\0').into())
    }

    fn numbers(&mut self) -> Option<Vec<f64>> {
        let count = self.u32()? as usize;
        if count == 0 {
            return Some(Vec::new());
        }
        self.align(8)?;
        let bytes = self.body.take(count.checked_mul(8)?)?;
        let number = |chunk: &[u8]| {
            let bytes: [u8; 8] = chunk.try_into().ok()?;
            Some(if self.big { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
        };
        bytes.chunks_exact(8).map(number).collect()
    }
}

/// One message of joint states.
struct JointState {
    sec: i32,
    nanosec: u32,
    names: Vec<String>,
    /// Positions, velocities, efforts: each empty or by joint.
    groups: [Vec<f64>; 3],
}

impl JointState {
    fn read(message: &[u8]) -> Option<Self> {
        let mut cdr = Cdr::new(message)?;
        let (sec, nanosec) = (cdr.u32()? as i32, cdr.u32()?);
        cdr.text()?;
        let count = cdr.u32()?;
        let names = (0..count).map(|_| cdr.text()).collect::<Option<_>>()?;
        let groups = [cdr.numbers()?, cdr.numbers()?, cdr.numbers()?];
        Some(JointState { sec, nanosec, names, groups })
    }
}

/// The rows of one topic.
#[derive(Default)]
struct Topic {
    name: String,
    /// Seconds, nanoseconds and log time of every message.
    stamps: [Vec<f64>; 3],
    /// Readings by group and joint, in the order in which joints appear.
    joints: Vec<(usize, String, Vec<f64>)>,
    index: BTreeMap<(usize, String), usize>,
}

impl Topic {
    fn push(&mut self, state: JointState, log_time: u64) {
        let row = self.stamps[0].len();
        for (stamps, value) in
            self.stamps.iter_mut().zip([f64::from(state.sec), f64::from(state.nanosec), log_time as f64])
        {
            stamps.push(value);
        }
        for (group, values) in state.groups.iter().enumerate() {
            for (name, value) in state.names.iter().zip(values) {
                let joints = &mut self.joints;
                let at = *self.index.entry((group, name.clone())).or_insert_with(|| {
                    joints.push((group, name.clone(), Vec::new()));
                    joints.len() - 1
                });
                let column = &mut self.joints[at].2;
                column.resize(row, f64::NAN);
                column.push(*value);
            }
        }
    }

    fn columns(mut self, prefix: &str) -> Vec<StoredColumn<'static>> {
        let rows = self.stamps[0].len();
        let [seconds, nanoseconds, logged] = std::mem::take(&mut self.stamps);
        let stamped = seconds.iter().chain(&nanoseconds).any(|value| *value != 0.0);
        let stamp = |name: &str, values: Vec<f64>| StoredColumn {
            name: ColumnName::new(format!("{prefix}{name}")),
            values: values.into(),
            stamp: true,
        };
        let mut columns = if stamped {
            vec![stamp("stamp.sec", seconds), stamp("stamp.nanosec", nanoseconds), stamp("log_time", logged)]
        } else {
            let mut time = stamp("time", logged);
            time.name.unit = Some("ns".into());
            vec![time]
        };
        columns.extend(self.joints.into_iter().map(|(group, name, mut values)| {
            values.resize(rows, f64::NAN);
            StoredColumn {
                name: ColumnName::new(format!("{prefix}{}.{name}", GROUPS[group])),
                values: values.into(),
                stamp: false,
            }
        }));
        columns
    }
}

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
        let mut taken = Taken::new(content);
        match code {
            SCHEMA => {
                let (id, name) = (taken.u16()?, taken.text()?);
                self.schemas.insert(id, name);
            }
            CHANNEL => {
                let (id, schema, topic, encoding) = (taken.u16()?, taken.u16()?, taken.text()?, taken.text()?);
                let kind = self.schemas.get(&schema).cloned().unwrap_or_default();
                self.channels.insert(id, (topic, kind, encoding));
            }
            MESSAGE => {
                let (channel, _, log_time, _) = (taken.u16()?, taken.u32()?, taken.u64()?, taken.u64()?);
                let (topic, kind, encoding) = self.channels.get(&channel)?;
                if kind == JOINT_STATE && encoding == CDR {
                    let state = JointState::read(taken.rest())?;
                    let own =
                        self.topics.entry(channel).or_insert_with(|| Topic { name: topic.clone(), ..Topic::default() });
                    own.push(state, log_time);
                }
            }
            _ => {}
        }
        Some(())
    }

    /// Takes in the records of a chunk.
    fn records(&mut self, records: &[u8]) -> Option<()> {
        let mut taken = Taken::new(records);
        while !taken.rest().is_empty() {
            let code = taken.take(1)?[0];
            let length = usize::try_from(taken.u64()?).ok()?;
            self.record(code, taken.take(length)?)?;
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
    let mut taken = Taken::new(content);
    let mut parts = || {
        taken.take(8 + 8)?;
        let size = taken.u64()?;
        taken.u32()?;
        let compression = taken.text()?;
        let length = usize::try_from(taken.u64()?).ok()?;
        Some((size, compression, taken.take(length)?))
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
        let mut head = Taken::new(&bytes);
        let (Some(code), Some(length)) = (head.take(1).map(|code| code[0]), head.u64()) else { return Err(cut()) };
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
    let several = file.topics.len() > 1;
    let columns = file.topics.into_values().flat_map(|topic| {
        let prefix = if several { format!("{}:", topic.name) } else { String::new() };
        topic.columns(&prefix)
    });
    Ok(Stored::new(path, columns.collect()))
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
