//! Data logs of WPILib (`.wpilog`).
//!
//! A file is a header and a list of records, each the number of an entry, a stamp in microseconds and a payload, in as many bytes as they
//! need. Records of entry 0 say which name and type an entry has. Entries of numbers and truths are columns, those of lists of numbers
//! one for every place, `NAME[k]`; each has times of its own. Texts and structures are not read.

use crate::columns::ColumnName;
use crate::cursor::Cursor;
use crate::error::LogError;
use crate::own_times::{OwnTimes, Timed};
use std::collections::BTreeMap;
use std::io::Read;

/// The first bytes of a file.
pub(super) const MAGIC: &[u8] = b"WPILOG";
/// The major version that is read.
const VERSION: u16 = 1;
/// Records about entries: the beginning of one, its end, and what else is known of it.
const START: u8 = 0;
const FINISH: u8 = 1;
const METADATA: u8 = 2;
/// Most columns of one entry.
const MOST_PLACES: usize = 4096;

/// What the payload of an entry means.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Truth,
    Integer,
    Single,
    Double,
}

impl Kind {
    /// A type by its name, and whether it is a list.
    fn of(name: &str) -> Option<(Self, bool)> {
        let list = name.ends_with("[]");
        let kind = match name.trim_end_matches("[]") {
            "boolean" => Kind::Truth,
            "int64" => Kind::Integer,
            "float" => Kind::Single,
            "double" => Kind::Double,
            _ => return None,
        };
        Some((kind, list))
    }

    const fn bytes(self) -> usize {
        match self {
            Kind::Truth => 1,
            Kind::Single => 4,
            Kind::Integer | Kind::Double => 8,
        }
    }

    /// The number in a payload; nothing where its length is another.
    fn number(self, payload: &[u8]) -> Option<f64> {
        Some(match self {
            Kind::Truth => f64::from(payload[0]),
            Kind::Integer => i64::from_le_bytes(payload.try_into().ok()?) as f64,
            Kind::Single => f64::from(f32::from_le_bytes(payload.try_into().ok()?)),
            Kind::Double => f64::from_le_bytes(payload.try_into().ok()?),
        })
    }
}

/// An entry that was begun.
struct Entry {
    name: String,
    kind: Option<(Kind, bool)>,
}

/// The contents of a file that were read so far.
#[derive(Default)]
struct Log {
    /// Entries by number; a number may be used again when its entry has ended.
    entries: BTreeMap<u64, Entry>,
    columns: Vec<Timed>,
    /// The first stamp of a reading, from which stamps are counted, so that no digit is lost.
    first: Option<i64>,
    /// Columns by the name of their entry and their place in a list.
    index: BTreeMap<(String, Option<usize>), usize>,
    /// Entries that hold no numbers, with their types.
    others: BTreeMap<String, String>,
}

impl Log {
    /// Takes in a record; nothing where it is damaged.
    fn record(&mut self, cursor: &mut Cursor<'_>) -> Option<()> {
        let lengths = usize::from(cursor.u8()?);
        let entry = cursor.unsigned((lengths & 3) + 1)?;
        let size = cursor.unsigned((lengths >> 2 & 3) + 1)?;
        let stamp = cursor.unsigned((lengths >> 4 & 7) + 1)?;
        let payload = cursor.take(usize::try_from(size).ok()?)?;
        if entry == 0 { self.control(&mut Cursor::new(payload)) } else { self.readings(entry, stamp as i64, payload) }
    }

    fn control(&mut self, cursor: &mut Cursor<'_>) -> Option<()> {
        match cursor.u8()? {
            START => {
                let (entry, name, kind) = (cursor.u32()?, cursor.text()?, cursor.text()?);
                let own = Kind::of(&kind);
                if own.is_none() {
                    self.others.insert(name.clone(), kind);
                }
                self.entries.insert(entry.into(), Entry { name, kind: own });
            }
            FINISH => drop(self.entries.remove(&cursor.u32()?.into())),
            METADATA => {
                cursor.u32()?;
            }
            _ => return None,
        }
        Some(())
    }

    fn readings(&mut self, entry: u64, stamp: i64, payload: &[u8]) -> Option<()> {
        let Entry { name, kind } = self.entries.get(&entry)?;
        let Some((kind, list)) = *kind else { return Some(()) };
        if !payload.len().is_multiple_of(kind.bytes()) || !list && payload.len() != kind.bytes() {
            return None;
        }
        let stamp = stamp.wrapping_sub(*self.first.get_or_insert(stamp)) as f64;
        for (place, bytes) in payload.chunks_exact(kind.bytes()).enumerate().take(MOST_PLACES) {
            let key = (name.clone(), list.then_some(place));
            let at = *self.index.entry(key).or_insert_with(|| {
                let name = if list { format!("{name}[{}]", place + 1) } else { name.clone() };
                self.columns.push(Timed { name: ColumnName::new(name), readings: Vec::new() });
                self.columns.len() - 1
            });
            self.columns[at].readings.push((stamp, kind.number(bytes)?));
        }
        Some(())
    }
}

/// The version of a file, whose header is taken; nothing where it is damaged.
fn header(cursor: &mut Cursor<'_>) -> Option<u16> {
    cursor.take(MAGIC.len()).filter(|magic| *magic == MAGIC)?;
    let version = cursor.u16()?;
    cursor.text()?;
    Some(version)
}

/// Reads the entries of a data log; messages call it `path`.
///
/// # Errors
/// [`LogError`] when the file cannot be read, is damaged, of another version, or has no entries of numbers.
pub(super) fn read(mut input: impl Read, path: &str) -> Result<OwnTimes, LogError> {
    let fault = |what: String, remedy: &str| LogError::Format { path: path.into(), what, remedy: remedy.into() };
    let mut bytes = Vec::new();
    input.read_to_end(&mut bytes).map_err(|source| LogError::Io { path: path.into(), source })?;
    let damaged = |at: usize| {
        let what = format!("the WPILOG file is cut short or damaged at byte {at}");
        fault(what, "copy it from the controller once more, or export the entries as CSV")
    };
    let mut cursor = Cursor::new(&bytes);
    match header(&mut cursor) {
        None => return Err(damaged(cursor.at())),
        Some(version) if version >> 8 != VERSION => {
            let what = format!("the WPILOG file is of version {}.{}, and 1.0 is read", version >> 8, version & 0xff);
            return Err(fault(what, "export the entries as CSV"));
        }
        Some(_) => {}
    }
    let mut log = Log::default();
    while !cursor.rest().is_empty() {
        let at = cursor.at();
        log.record(&mut cursor).ok_or_else(|| damaged(at))?;
    }
    if log.columns.is_empty() {
        let found: Vec<String> = log.others.iter().map(|(name, kind)| format!("`{name}` ({kind})")).collect();
        let found = if found.is_empty() { String::new() } else { format!(", only {}", found.join(", ")) };
        let what = format!("the WPILOG file has no readings of numbers{found}");
        return Err(fault(what, "log the signals as numbers, or export them as CSV"));
    }
    // A file may hold a record before one with an earlier stamp.
    log.columns.iter_mut().for_each(|column| column.readings.sort_by(|a, b| a.0.total_cmp(&b.0)));
    Ok(OwnTimes::new(log.columns, ColumnName { unit: Some("us".into()), ..ColumnName::new("time") }))
}

#[cfg(test)]
mod tests {
    use super::read;
    use crate::columns::Columns as _;

    const FIXTURE: &[u8] = include_bytes!("../../../../tests/fixtures/logs/slider.wpilog");

    #[test]
    fn entries_of_numbers_are_columns() {
        let file = read(FIXTURE, "run.wpilog").expect("sound");
        let names: Vec<&str> = file.header().iter().map(|column| column.text.as_str()).collect();
        assert_eq!(names, ["time", "/slider/x", "/slider/u", "/both[1]", "/both[2]", "/count", "/single", "/on"]);
    }

    #[test]
    fn damaged_files_are_refused_by_name() {
        for length in [6, 11, 13, 40, FIXTURE.len() - 1] {
            let message = read(&FIXTURE[..length], "run.wpilog").err().expect("cut").to_string();
            assert!(message.contains("WPILOG"), "{message}");
        }
        let mut damaged = FIXTURE.to_vec();
        for at in (0..FIXTURE.len()).step_by(7) {
            damaged[at] ^= 0x55;
            let _ = read(&damaged[..], "run.wpilog").err();
            damaged[at] ^= 0x55;
        }
        damaged[7] = 2;
        let message = read(&damaged[..], "run.wpilog").err().expect("another version").to_string();
        assert!(message.contains("version 2.0"), "{message}");
        let empty = b"WPILOG\x00\x01\x00\x00\x00\x00";
        let message = read(&empty[..], "run.wpilog").err().expect("empty").to_string();
        assert!(message.contains("no readings of numbers"), "{message}");
    }
}
