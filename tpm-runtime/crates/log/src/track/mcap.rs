//! Tracks as the topics of an MCAP file.
//!
//! A stamp with its readings is a message of joint states of ROS 2, which viewers plot without being told anything. The names of the joints
//! are those of the signals, with their units; the positions are the readings, whatever they are. A message names the signals that were read
//! at its stamp, so that each keeps the times at which it was recorded; one that never was is named once, without a number.

use crate::error::LogError;
use crate::joint_state::{CDR, JOINT_STATE};
use crate::track::signals::Track;
use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions};
use std::collections::BTreeMap;
use std::io::Cursor;

/// The definition of the messages, with those that it refers to.
const DEFINITION: &str = "std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// A stamp as whole seconds and nanoseconds.
#[derive(Clone, Copy)]
struct Stamp {
    sec: i32,
    nanosec: u32,
}

impl Stamp {
    fn of(seconds: f64) -> Result<Self, LogError> {
        let mut whole = seconds.floor();
        let mut nanosec = ((seconds - whole) * 1e9).round();
        if nanosec >= 1e9 {
            (whole, nanosec) = (whole + 1.0, 0.0);
        }
        if !(whole >= f64::from(i32::MIN) && whole <= f64::from(i32::MAX)) {
            return Err(LogError::Format {
                path: "the MCAP file".into(),
                what: format!("a stamp is {seconds} s, and its messages hold up to {} s", i32::MAX),
                remedy: "count time from the beginning of the record, or write CSV".into(),
            });
        }
        Ok(Stamp { sec: whole as i32, nanosec: nanosec as u32 })
    }

    /// Nanoseconds since another stamp; none before it.
    fn since(self, origin: i64) -> u64 {
        let seconds = i64::from(self.sec) - origin;
        u64::try_from(seconds * 1_000_000_000 + i64::from(self.nanosec)).unwrap_or(0)
    }
}

/// The bytes of a file with tracks as its topics.
///
/// # Errors
/// [`LogError::Format`] for a stamp that its messages cannot hold.
pub(super) fn written(tracks: &[Track]) -> Result<Vec<u8>, LogError> {
    let stamps = |track: &Track| track.time.iter().map(|seconds| Stamp::of(*seconds)).collect::<Result<Vec<_>, _>>();
    let stamps = tracks.iter().map(stamps).collect::<Result<Vec<_>, _>>()?;
    recording(tracks, &stamps).map_err(|error| LogError::Format {
        path: "the MCAP file".into(),
        what: format!("it cannot be written: {error}"),
        remedy: "write CSV".into(),
    })
}

fn recording(tracks: &[Track], stamps: &[Vec<Stamp>]) -> Result<Vec<u8>, McapError> {
    let mut bytes = Cursor::new(Vec::new());
    let library = concat!("tpm ", env!("CARGO_PKG_VERSION"));
    let options = WriteOptions::new().compression(None).profile("ros2").library(library);
    let mut file = options.create(&mut bytes)?;
    let schema = file.add_schema(JOINT_STATE, "ros2msg", DEFINITION.as_bytes())?;
    // Times at which messages were logged are not negative.
    let origin = stamps.iter().flatten().map(|stamp| i64::from(stamp.sec)).min().unwrap_or(0).min(0);
    let unread = |track: &Track| -> Vec<usize> {
        let signals = track.signals.iter().enumerate();
        signals.filter(|(_, (_, readings))| readings.iter().all(|value| value.is_nan())).map(|(s, _)| s).collect()
    };
    let unread: Vec<Vec<usize>> = tracks.iter().map(unread).collect();
    let mut order: Vec<(u64, usize, usize)> = Vec::new();
    let mut channels = Vec::new();
    for (t, (track, own)) in tracks.iter().zip(stamps).enumerate() {
        channels.push(file.add_channel(schema, &format!("/{}", track.name), CDR, &BTreeMap::new())?);
        order.extend(own.iter().enumerate().map(|(row, stamp)| (stamp.since(origin), t, row)));
    }
    // As they would have been recorded; stamps that go back stay behind those before them within their topic's sequence.
    order.sort_by_key(|&(time, ..)| time);
    for (log_time, t, row) in order {
        let header = MessageHeader {
            channel_id: channels[t],
            sequence: u32::try_from(row).unwrap_or(u32::MAX),
            log_time,
            publish_time: log_time,
        };
        let named: &[usize] = if row == 0 { &unread[t] } else { &[] };
        file.write_to_known_channel(&header, &message(&tracks[t], stamps[t][row], row, named))?;
    }
    file.finish()?;
    drop(file);
    Ok(bytes.into_inner())
}

/// A message in the common data representation: numbers are aligned to their size behind four bytes that state the order of bytes. It has the
/// signals with a reading in this row, and those that are to be `named` without one.
fn message(track: &Track, stamp: Stamp, row: usize, named: &[usize]) -> Vec<u8> {
    let is_there = |(s, (_, readings)): &(usize, &(String, Vec<f64>))| !readings[row].is_nan() || named.contains(s);
    let read: Vec<&(String, Vec<f64>)> =
        track.signals.iter().enumerate().filter(is_there).map(|(_, own)| own).collect();
    let mut body = Body(Vec::new());
    body.number(stamp.sec.to_le_bytes());
    body.number(stamp.nanosec.to_le_bytes());
    body.text("");
    body.count(read.len());
    read.iter().for_each(|(name, _)| body.text(name));
    body.count(read.len());
    read.iter().for_each(|(_, readings)| body.number(readings[row].to_le_bytes()));
    // No velocities, no efforts.
    body.count(0);
    body.count(0);
    [0, 1, 0, 0].into_iter().chain(body.0).collect()
}

/// What follows the order of bytes.
struct Body(Vec<u8>);

impl Body {
    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        self.0.resize(self.0.len().next_multiple_of(N), 0);
        self.0.extend(bytes);
    }

    fn count(&mut self, count: usize) {
        self.number((count as u32).to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.count(text.len() + 1);
        self.0.extend(text.bytes());
        self.0.push(0);
    }
}
