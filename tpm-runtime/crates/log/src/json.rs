//! Logs in JSON: columns by name, records one after another, and the shapes that other programs write.
//!
//! An object of lists is a table of columns (`{"t": [...], "x": [...]}`), a list of objects one of records, whether in one list or a
//! record a line; what lies deeper is called by its path, `joint.position`, and the k-th number of a list within a record `q[k]`. Records
//! that are runs, with lists longer than there are records, have columns of their own: `run[2].position`. A list of lists is a matrix, its longer side being time. So are `columns` beside `data`, and columns whose rows are keyed by their number, as
//! pandas writes them, and the tests of SysId of WPILib, rows one test behind the other. Null is a reading that is missing, text a number
//! or a date, else a reading that is missing.

use crate::dates::Date;
use crate::error::LogError;
use crate::options::LEAST_SAMPLES;
use crate::stored::{Stored, StoredColumn};
use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, SeqAccess, Visitor};
use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::io::Read;
use std::mem::take;

/// Tests of SysId, in small letters.
const TESTS: [&str; 8] = [
    "slow-forward",
    "slow-backward",
    "fast-forward",
    "fast-backward",
    "quasistatic-forward",
    "quasistatic-reverse",
    "dynamic-forward",
    "dynamic-reverse",
];
/// Columns of a test of one motor.
const SINGLE: [&str; 4] = ["time", "voltage", "position", "velocity"];
/// Columns of a test of a drivetrain.
const DRIVETRAIN: [&str; 9] = [
    "time",
    "left.voltage",
    "right.voltage",
    "left.position",
    "right.position",
    "left.velocity",
    "right.velocity",
    "angle",
    "rate",
];
/// Most numbers of a list within a record that become columns.
const MOST_PARTS: usize = 4096;

/// Readings one after another.
#[derive(Debug, Default)]
struct Readings {
    values: Vec<f64>,
    /// The second of the first date, from which dates are counted.
    first: Option<i64>,
}

impl Readings {
    fn push_text(&mut self, text: &str) {
        let value = match (text.trim().parse(), Date::of(text.as_bytes())) {
            (Ok(number), _) => number,
            (_, Some(date)) => (date.seconds - *self.first.get_or_insert(date.seconds)) as f64 + date.fraction,
            _ => f64::NAN,
        };
        self.values.push(value);
    }

    fn column(self, name: String) -> StoredColumn<'static> {
        let mut column = StoredColumn::of(name, self.values);
        column.name.unit = self.first.map(|_| "s".to_owned());
        column
    }
}

/// Records one after another, as columns by their paths.
#[derive(Debug, Default)]
struct Records {
    rows: usize,
    columns: Vec<(String, Readings)>,
    index: HashMap<String, usize>,
    /// Lists of numbers by their paths: the record and its list.
    lists: BTreeMap<String, Vec<(usize, Vec<f64>)>>,
}

impl Records {
    /// The readings of a path, filled up to the record that is being read.
    fn at(&mut self, path: &str) -> &mut Readings {
        let at = match self.index.get(path) {
            Some(at) => *at,
            None => {
                self.index.insert(path.to_owned(), self.columns.len());
                self.columns.push((path.to_owned(), Readings::default()));
                self.columns.len() - 1
            }
        };
        let readings = &mut self.columns[at].1;
        readings.values.resize(self.rows.max(readings.values.len()), f64::NAN);
        readings
    }

    fn push(&mut self, record: Object) {
        self.place("", record);
        self.rows += 1;
        // A name that occurs twice in a record counts once.
        self.columns.iter_mut().for_each(|(_, readings)| readings.values.truncate(self.rows));
    }

    fn place(&mut self, path: &str, record: Object) {
        for (key, value) in record {
            let path = joined(path, &key);
            match value {
                Node::Number(value) => self.at(&path).values.push(value),
                Node::Text(text) => self.at(&path).push_text(&text),
                Node::Numbers(values) => self.lists.entry(path).or_default().push((self.rows, values)),
                Node::Object(inner) => self.place(&path, inner),
                Node::Texts(_) | Node::Rows(_) | Node::Records(_) | Node::Other => {}
            }
        }
    }

    /// The columns of all records; where each is a run of its own, the columns of every one.
    fn columns(mut self, prefix: &str) -> impl Iterator<Item = StoredColumn<'static>> {
        let (rows, prefix) = (self.rows, prefix.to_owned());
        let mut runs: Vec<(usize, StoredColumn<'static>)> = Vec::new();
        for (path, lists) in take(&mut self.lists) {
            let lengths = || lists.iter().map(|(_, list)| list.len()).filter(|length| *length > 0);
            let (longest, shortest) = (lengths().max().unwrap_or(0), lengths().min().unwrap_or(0));
            if longest > rows && (rows < LEAST_SAMPLES || shortest < longest) || longest > MOST_PARTS {
                for (record, list) in lists.into_iter().filter(|(_, list)| list.len() > 1) {
                    let own = if rows == 1 { prefix.clone() } else { format!("{prefix}[{}]", record + 1) };
                    runs.push((record, StoredColumn::of(joined(&own, &path), list)));
                }
                continue;
            }
            for k in 0..longest {
                let mut values = vec![f64::NAN; rows];
                for (record, list) in &lists {
                    values[*record] = list.get(k).copied().unwrap_or(f64::NAN);
                }
                self.columns.push((format!("{path}[{}]", k + 1), Readings { values, first: None }));
            }
        }
        runs.sort_by_key(|(record, _)| *record);
        let runs = runs.into_iter().map(|(_, column)| column);
        // A number of a run is a setting, not a signal.
        let of_rows = if runs.len() > 0 && rows < LEAST_SAMPLES { Vec::new() } else { self.columns };
        of_rows
            .into_iter()
            .map(move |(path, mut readings)| {
                readings.values.resize(rows, f64::NAN);
                readings.column(joined(&prefix, &path))
            })
            .chain(runs)
    }
}

/// A path of names.
fn joined(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

/// Names with values, in the order of the file.
type Object = Vec<(String, Node)>;

/// A value; lists are gathered as they are read, so that a number takes its eight bytes and no more.
#[derive(Debug)]
enum Node {
    /// A number or a truth, NaN for null.
    Number(f64),
    Text(String),
    Object(Object),
    Numbers(Vec<f64>),
    Texts(Vec<String>),
    Rows(Vec<Vec<f64>>),
    Records(Records),
    /// A list of what has nothing in common.
    Other,
}

impl Node {
    /// A list with another item.
    fn with(self, item: Node) -> Self {
        match (self, item) {
            (Node::Numbers(mut list), Node::Number(value)) => {
                list.push(value);
                Node::Numbers(list)
            }
            (Node::Numbers(list), Node::Text(text)) if list.iter().all(|value| value.is_nan()) => {
                let missing = list.iter().map(|_| String::new());
                Node::Texts(missing.chain([text]).collect())
            }
            (Node::Texts(mut list), Node::Text(text)) => {
                list.push(text);
                Node::Texts(list)
            }
            (Node::Texts(mut list), Node::Number(value)) => {
                list.push(value.to_string());
                Node::Texts(list)
            }
            (Node::Numbers(list), Node::Numbers(row)) if list.is_empty() => Node::Rows(vec![row]),
            (Node::Rows(mut rows), Node::Numbers(row)) => {
                rows.push(row);
                Node::Rows(rows)
            }
            (Node::Numbers(list), Node::Object(record)) if list.is_empty() => {
                let mut records = Records::default();
                records.push(record);
                Node::Records(records)
            }
            (Node::Records(mut records), Node::Object(record)) => {
                records.push(record);
                Node::Records(records)
            }
            _ => Node::Other,
        }
    }

    /// An object, or the list that its keys, numbers from 0 on, make of it.
    fn keyed(object: Object) -> Self {
        let numbered = object.len() > 1 && object.iter().enumerate().all(|(k, (key, _))| key.parse() == Ok(k));
        if !numbered {
            return Node::Object(object);
        }
        object.into_iter().fold(Node::Numbers(Vec::new()), |list, (_, item)| list.with(item))
    }
}

impl<'de> Deserialize<'de> for Node {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Any;
        impl<'de> Visitor<'de> for Any {
            type Value = Node;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a value")
            }

            fn visit_bool<E>(self, value: bool) -> Result<Node, E> {
                Ok(Node::Number(f64::from(u8::from(value))))
            }

            fn visit_i64<E>(self, value: i64) -> Result<Node, E> {
                Ok(Node::Number(value as f64))
            }

            fn visit_u64<E>(self, value: u64) -> Result<Node, E> {
                Ok(Node::Number(value as f64))
            }

            fn visit_f64<E>(self, value: f64) -> Result<Node, E> {
                Ok(Node::Number(value))
            }

            fn visit_unit<E>(self) -> Result<Node, E> {
                Ok(Node::Number(f64::NAN))
            }

            fn visit_str<E>(self, value: &str) -> Result<Node, E> {
                Ok(Node::Text(value.to_owned()))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Node, A::Error> {
                let mut list = Node::Numbers(Vec::new());
                while let Some(item) = items.next_element()? {
                    list = list.with(item);
                }
                Ok(list)
            }

            fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Node, A::Error> {
                let mut object = Object::new();
                while let Some(entry) = entries.next_entry()? {
                    object.push(entry);
                }
                Ok(Node::keyed(object))
            }
        }
        deserializer.deserialize_any(Any)
    }
}

/// The columns of a value, and what was found that is none.
#[derive(Default)]
struct Found {
    columns: Vec<StoredColumn<'static>>,
    /// Whether a list or a matrix has no name.
    numbered: bool,
    others: Vec<String>,
}

impl Found {
    fn take(&mut self, name: &str, node: Node) {
        match node {
            Node::Numbers(values) if values.len() > 1 => {
                self.numbered |= name.is_empty();
                self.columns.push(StoredColumn::of(name, values));
            }
            Node::Texts(texts) => {
                let mut readings = Readings::default();
                texts.iter().for_each(|text| readings.push_text(text));
                if readings.values.iter().any(|value| !value.is_nan()) {
                    self.columns.push(readings.column(name.to_owned()));
                } else {
                    self.others.push(name.to_owned());
                }
            }
            Node::Rows(rows) => self.take_matrix(name, &rows),
            Node::Records(records) => self.columns.extend(records.columns(name)),
            Node::Object(object) => self.take_object(name, object),
            Node::Number(_) | Node::Numbers(_) | Node::Text(_) | Node::Other => self.others.push(name.to_owned()),
        }
    }

    /// A matrix of rows, or of columns where these are longer.
    fn take_matrix(&mut self, name: &str, rows: &[Vec<f64>]) {
        let wide = rows[0].len();
        if rows.iter().any(|row| row.len() != wide) {
            return self.others.push(name.to_owned());
        }
        self.numbered |= name.is_empty();
        // Rows one behind the other are the transpose stored column by column.
        self.columns.extend(StoredColumn::of_matrix(name, rows.concat(), wide, rows.len()));
    }

    fn take_object(&mut self, name: &str, mut object: Object) {
        let place = |object: &Object, key: &str| object.iter().position(|(own, _)| own == key);
        // A table whose columns are named beside its rows.
        if let (Some(names), Some(data)) = (place(&object, "columns"), place(&object, "data"))
            && let (Node::Texts(names), Node::Rows(rows)) = (&object[names].1, &object[data].1)
            && rows.iter().all(|row| row.len() == names.len())
        {
            self.columns.extend(named(names, rows, name));
            return;
        }
        let test = |(key, node): &(String, Node)| {
            matches!(node, Node::Rows(_)) && TESTS.contains(&key.to_ascii_lowercase().as_str())
        };
        let mut tests = Vec::new();
        for at in (0..object.len()).rev().filter(|at| test(&object[*at])).collect::<Vec<_>>() {
            if let (_, Node::Rows(rows)) = object.remove(at) {
                drop(tests.splice(0..0, rows));
            }
        }
        if let Some(wide) = tests.first().map(Vec::len) {
            let names: &[&str] = if wide <= SINGLE.len() { &SINGLE[..wide] } else { &DRIVETRAIN };
            if tests.iter().all(|row| row.len() == names.len()) {
                self.columns.extend(named(names, &tests, name));
            } else {
                self.take_matrix(name, &tests);
            }
        }
        for (key, node) in object {
            self.take(&joined(name, &key), node);
        }
    }
}

/// The columns of rows by their names.
fn named<'a>(
    names: &'a [impl AsRef<str>],
    rows: &'a [Vec<f64>],
    path: &'a str,
) -> impl Iterator<Item = StoredColumn<'static>> {
    let column = move |(k, name): (usize, &'a _)| {
        let name: &str = AsRef::as_ref(name);
        StoredColumn::of(joined(path, name), rows.iter().map(|row| row[k]).collect())
    };
    names.iter().enumerate().map(column)
}

/// Whether a text begins as JSON does: with an object, or with a list of what no header of a table has in brackets.
pub(super) fn is_json(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    let mut signs = head.iter().filter(|byte| !byte.is_ascii_whitespace());
    match (signs.next(), signs.next()) {
        (Some(b'{'), second) => matches!(second, Some(b'"' | b'}') | None),
        (Some(b'['), second) => matches!(second, Some(b'{' | b'[' | b'-' | b'0'..=b'9' | b']' | b'"') | None),
        _ => false,
    }
}

/// Reads the columns of JSON; messages call it `path`.
///
/// # Errors
/// [`LogError`] when the file cannot be read, is no JSON throughout, or has no lists of numbers.
pub(super) fn read(mut input: impl Read, path: &str) -> Result<Stored<'static>, LogError> {
    let mut bytes = Vec::new();
    input.read_to_end(&mut bytes).map_err(|source| LogError::Io { path: path.into(), source })?;
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    let mut values = serde_json::Deserializer::from_slice(text).into_iter::<Node>();
    let damaged = |error: serde_json::Error| LogError::Csv {
        path: path.into(),
        line: error.line() as u64,
        message: format!(
            "the JSON is not valid: {error}; repair it, write what is missing as null, or save the table as CSV"
        ),
    };
    let mut found = Found::default();
    if let Some(first) = values.next() {
        let first = first.map_err(damaged)?;
        match values.next() {
            None => found.take("", first),
            // A record a line, or a row.
            Some(second) => {
                let list = Node::Numbers(Vec::new()).with(first).with(second.map_err(damaged)?);
                let all = values.try_fold(list, |list, item| item.map(|item| list.with(item))).map_err(damaged)?;
                found.take("", all);
            }
        }
    }
    if found.columns.is_empty() {
        let others =
            found.others.iter().filter(|name| !name.is_empty()).map(|name| format!("`{name}`")).collect::<Vec<_>>();
        let others = if others.is_empty() { String::new() } else { format!(", only {}", others.join(", ")) };
        return Err(LogError::Format {
            path: path.into(),
            what: format!("the JSON has no lists of numbers{others}"),
            remedy: "write lists by name (`{\"t\": [...], \"x\": [...]}`), records, or a table as CSV".into(),
        });
    }
    Ok(if found.numbered { Stored::numbered(path, found.columns) } else { Stored::new(path, found.columns) })
}

#[cfg(test)]
mod tests {
    use super::{is_json, read};
    use crate::columns::Columns as _;

    /// Names of the columns of a text, and its first two rows.
    fn table(text: &str) -> (Vec<String>, Vec<Vec<f64>>) {
        let mut file = read(text.as_bytes(), "run.json").unwrap_or_else(|error| panic!("{text}: {error}"));
        let names: Vec<String> = file.header().iter().map(|column| column.text.clone()).collect();
        file.select(&(0..names.len()).collect::<Vec<_>>());
        let mut values = vec![0.0; names.len()];
        let mut rows = Vec::new();
        while file.next_row(&mut values).expect("sound").is_some() {
            rows.push(values.clone());
        }
        (names, rows)
    }

    #[test]
    fn records_with_lists_longer_than_their_number_are_runs() {
        let (names, rows) =
            table(r#"{"rate": 50, "data": [{"kind": "step", "k": 2, "u": [0, 1, 2], "x": [3, 4, 5]}]}"#);
        assert_eq!((names, rows.len()), (vec!["data.u".to_owned(), "data.x".into()], 3));
        let text = r#"{"data": [{"u": [0, 1], "x": [3, 4]}, {"u": [0, 1, 2], "x": [3, 4, 5]}]}"#;
        let file = read(text.as_bytes(), "run.json").expect("sound");
        let names: Vec<&str> = file.header().iter().map(|column| column.text.as_str()).collect();
        assert_eq!(names, ["data[1].u", "data[1].x", "data[2].u", "data[2].x"]);
        // Joints of a robot are numbers of a row.
        let rows: String = (0..20).map(|k| format!(r#"{{"t": {k}, "q": [1, {k}, 3], "v": []}},"#)).collect();
        let (names, rows) = table(&format!("[{}]", rows.trim_end_matches(',')));
        assert_eq!((names.join(" "), rows[4].clone()), ("t q[1] q[2] q[3]".to_owned(), vec![4.0, 1.0, 4.0, 3.0]));
    }

    #[test]
    fn the_time_of_records_is_the_one_beside_what_is_named() {
        use crate::{ReadingSettings, Recording};
        use tpm_test_support::models::MassSpringDrag;
        let record = |scale: f64| -> String {
            let one = |k: i32| {
                format!(
                    r#"{{"pos": {}, "volts": {}, "timestamp": {}}}"#,
                    (0.1 * f64::from(k)).sin(),
                    k % 7,
                    scale * f64::from(k)
                )
            };
            (0..40).map(one).collect::<Vec<_>>().join(",")
        };
        let map = [("x", "right.pos"), ("u", "right.volts")].map(|(signal, column)| (signal.into(), column.into()));
        let mut options = ReadingSettings { map: map.into(), ..ReadingSettings::default() };
        let text = format!(r#"{{"left": [{}], "right": [{}]}}"#, record(0.01), record(0.02));
        let read = |options: &ReadingSettings| Recording::read(text.as_bytes(), "run.json", &MassSpringDrag, options);
        assert!((read(&options).expect("its own time").segments[0].sample_time - 0.02).abs() < 1e-12);
        options.map.insert("u".into(), "left.volts".into());
        let error = read(&options).expect_err("two records").to_string();
        assert!(error.contains("the time may be `left.timestamp` or `right.timestamp`"), "{error}");
    }

    #[test]
    fn shapes_of_tables_are_columns() {
        let rows = vec![vec![0.0, 1.5], vec![0.1, -2.0], vec![0.2, 3.0]];
        for text in [
            r#"{"t": [0, 0.1, 0.2], "x": [1.5, -2, 3e0], "rate": 100, "note": "a run"}"#,
            r#"[{"t": 0, "x": 1.5}, {"x": -2, "t": 0.1}, {"t": "0.2", "x": 3}]"#,
            r#"{"t": ["0", 0.1, "0.2"], "x": ["1.5", "-2", "3"]}"#,
            "{\"t\": 0, \"x\": 1.5}\n{\"t\": 0.1, \"x\": -2}\n{\"t\": 0.2, \"x\": 3}\n",
            r#"{"columns": ["t", "x"], "index": [0, 1, 2], "data": [[0, 1.5], [0.1, -2], [0.2, 3]]}"#,
            r#"{"t": {"0": 0, "1": 0.1, "2": 0.2}, "x": {"0": 1.5, "1": -2, "2": 3}}"#,
            r#"{"0": {"t": 0, "x": 1.5}, "1": {"t": 0.1, "x": -2}, "2": {"t": 0.2, "x": 3}}"#,
        ] {
            assert_eq!(table(text), (vec!["t".to_owned(), "x".to_owned()], rows.clone()), "{text}");
        }
        for text in
            ["[[0, 1.5], [0.1, -2], [0.2, 3]]", "[[0, 0.1, 0.2], [1.5, -2, 3]]", "[0, 1.5]\n[0.1, -2]\n[0.2, 3]\n"]
        {
            assert_eq!(table(text), (vec!["1".to_owned(), "2".to_owned()], rows.clone()), "{text}");
        }
    }

    #[test]
    fn what_lies_deeper_has_a_path() {
        let text = r#"{"signals": {"t": [0, 1], "arm": {"q": [[1, 2], [3, 4], [5, 6]]}}}"#;
        assert_eq!(
            table(r#"[{"t": 0, "arm": {"q": [1, 2]}}, {"t": 1, "arm": {"q": [3, 4]}}]"#).0,
            ["t", "arm.q[1]", "arm.q[2]"]
        );
        assert_eq!(read(text.as_bytes(), "run.json").expect("sound").header()[1].text, "signals.arm.q[1]");
        let (names, rows) =
            table(r#"[{"t": "2026-03-01T23:59:59.5Z", "x": null}, {"t": "2026-03-02T00:00:01Z", "x": 2}]"#);
        assert_eq!((names, rows[1].clone()), (vec!["t".into(), "x".into()], vec![2.0, 2.0]));
        assert!(rows[0][1].is_nan() && rows[0][0] == 0.5);
    }

    #[test]
    fn tests_of_sysid_are_one_record() {
        let single =
            r#"{"sysid": true, "test": "Simple", "slow-forward": [[0, 1, 2, 3]], "fast-forward": [[0, 4, 5, 6]]}"#;
        let (names, rows) = table(single);
        assert_eq!(names, ["time", "voltage", "position", "velocity"]);
        assert_eq!(rows, [[0.0, 1.0, 2.0, 3.0], [0.0, 4.0, 5.0, 6.0]]);
        let drive =
            r#"{"slow-forward": [[0, 1, 2, 3, 4, 5, 6, 7, 8]], "slow-backward": [[1, 1, 2, 3, 4, 5, 6, 7, 8]]}"#;
        assert_eq!(table(drive).0[..3], ["time", "left.voltage", "right.voltage"]);
    }

    #[test]
    fn other_and_damaged_json_is_refused_by_name() {
        let fault = |text: &str| read(text.as_bytes(), "run.json").err().expect(text).to_string();
        assert!(fault(r#"{"gain": 3, "name": "arm"}"#).contains("no lists of numbers, only `gain`, `name`"));
        let message = fault("{\"t\": [0, 1],\n \"x\": [1, ");
        assert!(message.starts_with("run.json:2: the JSON is not valid"), "{message}");
        assert!(fault("{\"t\": [0, NaN]}").contains("as null"));
        assert!(fault(&"[".repeat(100_000)).contains("recursion"));
        assert!(fault("[]").contains("no lists"));
        assert!(fault("[[1, 2], [3]]").contains("no lists"));
    }

    #[test]
    fn json_is_told_from_headers_in_brackets() {
        assert!(
            is_json(b"{\n \"t\": [")
                && is_json(b"[{\"t\":0}")
                && is_json(b" [[0, 1],")
                && is_json(b"\xef\xbb\xbf{\"a\"")
        );
        assert!(!is_json(b"[s],[m]\n0,1\n") && !is_json(b"t_s,x,u\n") && !is_json(b"{t},x\n") && !is_json(b""));
    }
}
