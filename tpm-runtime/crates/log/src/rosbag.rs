//! Bags of ROS 2 in SQLite (`.db3`) with joint states.
//!
//! A bag has a table `topics`, with the name and type of each, and a table `messages`, each with its topic, the time at which it was logged
//! in nanoseconds, and its bytes.

use crate::error::LogError;
use crate::joint_state::{CDR, JOINT_STATE, Topic};
use crate::sqlite::{Database, Row, Table, Value};
use crate::stored::Stored;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

/// A topic as the bag describes it.
struct Described {
    name: String,
    kind: String,
    coding: String,
}

/// The tables of topics and of messages.
fn tables(all: &[Table]) -> Option<(&Table, &Table)> {
    let find = |name: &str| all.iter().find(|table| table.name == name);
    Some((find("topics")?, find("messages")?))
}

fn text(row: &Row<'_>, at: Option<usize>) -> Option<String> {
    match row.fields.get(at?)? {
        Value::Text(text) => Some(text.clone()),
        _ => None,
    }
}

/// An integer of a row; the integer key is the row's number.
fn integer(row: &Row<'_>, at: Option<usize>) -> Option<i64> {
    match row.fields.get(at?)? {
        Value::Integer(value) => Some(*value),
        Value::Null => Some(row.number),
        _ => None,
    }
}

/// The topics of a bag by their number, and the rows of those with joint states; nothing where it is damaged.
fn topics(database: &Database<'_>, described: &Table, messages: &Table) -> Option<(Vec<Described>, Vec<Topic>)> {
    let mut all = BTreeMap::new();
    database.each(described, |row| {
        let column = |name: &str| text(&row, described.column(name));
        let (name, kind, coding) = (column("name")?, column("type")?, column("serialization_format")?);
        all.insert(integer(&row, described.column("id"))?, Described { name, kind, coding });
        Some(())
    })?;
    let mut own: BTreeMap<i64, Topic> = BTreeMap::new();
    database.each(messages, |row| {
        let topic = integer(&row, messages.column("topic_id"))?;
        let described = all.get(&topic)?;
        if described.kind != JOINT_STATE || described.coding != CDR {
            return Some(());
        }
        let stamp = integer(&row, messages.column("timestamp"))?;
        let Value::Blob(message) = row.fields.get(messages.column("data")?)? else { return None };
        own.entry(topic).or_insert_with(|| Topic::new(&described.name)).push(message, u64::try_from(stamp).ok()?)
    })?;
    Some((all.into_values().collect(), own.into_values().collect()))
}

/// Reads the joint states of a bag; messages call it `path`.
///
/// # Errors
/// [`LogError`] when the file cannot be read, is damaged, was not closed, is another database, or has no joint states.
pub(super) fn read(mut input: impl Read, path: &str) -> Result<Stored<'static>, LogError> {
    let fault = |what: String, remedy: &str| LogError::Format { path: path.into(), what, remedy: remedy.into() };
    let mut bytes = Vec::new();
    input.read_to_end(&mut bytes).map_err(|source| LogError::Io { path: path.into(), source })?;
    let damaged = || {
        let what = "the SQLite database is cut short or damaged, or its texts are not UTF-8".to_owned();
        fault(what, "repair it with `sqlite3 FILE .recover`, or convert it with `ros2 bag convert` to MCAP")
    };
    let database = Database::of(&bytes).ok_or_else(damaged)?;
    let beside = format!("{path}-wal");
    if database.writes_ahead() && Path::new(&beside).metadata().is_ok_and(|file| file.len() > 0) {
        let what = format!("the bag was not closed: what was written last is in {beside}");
        return Err(fault(what, "close it with `sqlite3 FILE 'PRAGMA wal_checkpoint(TRUNCATE)'`"));
    }
    let all = database.tables().ok_or_else(damaged)?;
    let Some((described, messages)) = tables(&all) else {
        let names: Vec<String> = all.iter().map(|table| format!("`{}`", table.name)).collect();
        let found = if names.is_empty() { "no tables".to_owned() } else { format!("the tables {}", names.join(", ")) };
        let what = format!(
            "the file is an SQLite database with {found}, and no bag of ROS 2, which has `topics` and `messages`"
        );
        return Err(fault(what, "save the table of the signals as CSV (`sqlite3 -header -csv FILE 'SELECT ...'`)"));
    };
    let (all, own) = topics(&database, described, messages).ok_or_else(damaged)?;
    if own.is_empty() {
        let found: Vec<String> =
            all.iter().map(|topic| format!("{} ({}, {})", topic.name, topic.kind, topic.coding)).collect();
        let found = if found.is_empty() { String::new() } else { format!(", only {}", found.join(", ")) };
        let what = format!("the bag has no messages of {JOINT_STATE} in {CDR}{found}");
        return Err(fault(what, "record a topic of joint states, or save the signals as CSV"));
    }
    Ok(Stored::new(path, Topic::columns_of_all(own)))
}

#[cfg(test)]
mod tests {
    use super::read;
    use crate::columns::Columns as _;

    const FIXTURE: &[u8] = include_bytes!("../../../../tests/fixtures/logs/joint_states.db3");

    #[test]
    fn joints_are_columns() {
        let file = read(FIXTURE, "run.db3").expect("sound");
        let names: Vec<&str> = file.header().iter().map(|column| column.text.as_str()).collect();
        let expected = ["stamp.sec", "stamp.nanosec", "log_time", "position.slider", "position.idle", "effort.slider"];
        assert!(expected.iter().all(|name| names.contains(name)), "{names:?}");
    }

    #[test]
    fn other_and_damaged_databases_are_refused_by_name() {
        let other: &[u8] = include_bytes!("../../../../tests/fixtures/logs/tables.db3");
        let message = read(other, "run.db3").err().expect("no bag").to_string();
        assert!(message.contains("the tables `things`") && message.contains("no bag of ROS 2"), "{message}");
        for length in [16, 100, 5000, FIXTURE.len() / 2] {
            let message = read(&FIXTURE[..length], "run.db3").err().expect("cut").to_string();
            assert!(message.contains("SQLite"), "{message}");
        }
        let mut damaged = FIXTURE.to_vec();
        for at in (0..FIXTURE.len()).step_by(509) {
            damaged[at] ^= 0x55;
            let _ = read(&damaged[..], "run.db3").err();
            damaged[at] ^= 0x55;
        }
    }

    #[test]
    fn a_bag_that_was_not_closed_is_not_read_without_its_end() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("run.db3").display().to_string();
        let mut ahead = FIXTURE.to_vec();
        (ahead[18], ahead[19]) = (2, 2);
        assert!(read(&ahead[..], &path).is_ok());
        std::fs::write(format!("{path}-wal"), [0; 32]).expect("written");
        let message = read(&ahead[..], &path).err().expect("not closed").to_string();
        assert!(message.contains("was not closed") && message.contains("run.db3-wal"), "{message}");
    }
}
