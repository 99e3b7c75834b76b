//! Messages `sensor_msgs/msg/JointState` of ROS 2 as columns.
//!
//! A message of joint states is a row: columns `position.NAME`, `velocity.NAME` and `effort.NAME` for every joint, `stamp.sec` and
//! `stamp.nanosec` from its header, and `log_time` in nanoseconds. Velocity and effort may be empty. Where several topics have joint
//! states, the topic stands before the column: `/left/joint_states:position.elbow`. Where no header is stamped, `time` is the time at
//! which messages were logged.

use crate::columns::ColumnName;
use crate::cursor::Cursor;
use crate::stored::StoredColumn;
use std::collections::HashMap;

/// The type that is read.
pub(super) const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
/// The encoding of its messages.
pub(super) const CDR: &str = "cdr";
/// Groups of readings of a joint, in the order of the message.
const GROUPS: [&str; 3] = ["position", "velocity", "effort"];

/// Common data representation: numbers are aligned to their size behind four bytes that state the order of bytes.
struct Cdr<'a> {
    body: Cursor<'a>,
    big: bool,
}

impl<'a> Cdr<'a> {
    fn new(message: &'a [u8]) -> Option<Self> {
        Some(Cdr { big: *message.get(1)? & 1 == 0, body: Cursor::new(message.get(4..)?) })
    }

    fn align(&mut self, size: usize) -> Option<()> {
        let padding = self.body.at().next_multiple_of(size) - self.body.at();
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
pub(super) struct Topic {
    name: String,
    /// Seconds, nanoseconds and log time of every message.
    stamps: [Vec<f64>; 3],
    /// Readings by group and joint, in the order in which joints appear.
    joints: Vec<(usize, String, Vec<f64>)>,
    index: HashMap<(usize, String), usize>,
}

impl Topic {
    /// A topic without a message.
    pub(super) fn new(name: &str) -> Self {
        Topic { name: name.to_owned(), ..Topic::default() }
    }

    /// Takes in a message that was logged at a time in nanoseconds; nothing where it is damaged.
    pub(super) fn push(&mut self, message: &[u8], log_time: u64) -> Option<()> {
        let state = JointState::read(message)?;
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
        Some(())
    }

    /// The columns of all topics of a file.
    pub(super) fn columns_of_all(topics: Vec<Topic>) -> Vec<StoredColumn<'static>> {
        let several = topics.len() > 1;
        let columns = topics.into_iter().flat_map(|topic| {
            let prefix = if several { format!("{}:", topic.name) } else { String::new() };
            topic.columns(&prefix)
        });
        columns.collect()
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
            StoredColumn::of(format!("{prefix}{}.{name}", GROUPS[group]), values)
        }));
        columns
    }
}
