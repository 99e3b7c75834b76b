//! TOML tables that keep the offset of every key and value, so that a fault is reported with its line and column.
//!
//! Invariant: an offset is that of the key or value in the file's text; an unknown key is refused
//! ([`Table::only`]), with its line and column.

use toml::de::{DeTable, DeValue};
use tpm_report::Remedy;

/// A fault of a file, at its place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: {message}")]
pub struct FileFault {
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1.
    pub column: usize,
    /// What is wrong and what to do.
    pub message: String,
    /// The setting outside the file that would help, when there is one.
    pub remedy: Option<Remedy>,
}

impl FileFault {
    /// A fault at a byte offset of a text.
    #[must_use]
    pub fn at(text: &str, offset: usize, message: String) -> Self {
        let before = text.get(..offset.min(text.len())).unwrap_or(text);
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().map_or(0, |last| last.chars().count()) + 1;
        FileFault { line, column, message, remedy: None }
    }
}

/// A value with its byte offset in the text.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Placed<T> {
    pub(super) value: T,
    pub(super) offset: usize,
}

#[derive(Clone, Debug, PartialEq)]
enum Item {
    Number(f64),
    Text(String),
    Flag(bool),
    Table(Table),
    Tables(Vec<Table>),
    Other(&'static str),
}

#[derive(Clone, Debug, PartialEq)]
struct Entry {
    key: String,
    key_offset: usize,
    offset: usize,
    item: Item,
}

/// A table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Table {
    /// Full name of the table, with the names of the tables around it before it, joined by dots; empty for the file.
    name: String,
    offset: usize,
    entries: Vec<Entry>,
}

/// Reads a file's text.
pub(super) fn parse(text: &str) -> Result<Table, FileFault> {
    let parsed = DeTable::parse(text).map_err(|fault| {
        let message = format!("{}; the file is TOML: lines `KEY = VALUE` below [TABLE] lines", fault.message());
        FileFault::at(text, fault.span().map_or(0, |span| span.start), message)
    })?;
    Ok(table(parsed.get_ref(), "", 0))
}

fn table(parsed: &DeTable<'_>, name: &str, offset: usize) -> Table {
    let entries = parsed.iter().map(|(key, value)| {
        let plain = key.get_ref().to_string();
        let whole = if name.is_empty() { plain.clone() } else { format!("{name}.{plain}") };
        let item = match value.get_ref() {
            // Digits may be grouped by underscores.
            DeValue::Integer(number) if number.radix() == 10 => {
                number.as_str().replace('_', "").parse().map_or(Item::Other("a number that is too large"), Item::Number)
            }
            DeValue::Float(number) => {
                number.as_str().replace('_', "").parse().map_or(Item::Other("no number"), Item::Number)
            }
            DeValue::String(text) => Item::Text(text.to_string()),
            DeValue::Boolean(flag) => Item::Flag(*flag),
            DeValue::Table(inner) => Item::Table(table(inner, &whole, key.span().start)),
            DeValue::Array(list) => {
                let tables: Option<Vec<Table>> = list
                    .iter()
                    .map(|one| one.get_ref().as_table().map(|inner| table(inner, &whole, one.span().start)))
                    .collect();
                tables.map_or(Item::Other("a list"), Item::Tables)
            }
            other => Item::Other(other.type_str()),
        };
        Entry { key: plain, key_offset: key.span().start, offset: value.span().start, item }
    });
    Table { name: name.to_string(), offset, entries: entries.collect() }
}

impl Table {
    /// Refuses every key that is not one of these.
    pub(super) fn only(&self, text: &str, known: &[&str]) -> Result<(), FileFault> {
        match self.entries.iter().find(|entry| !known.contains(&entry.key.as_str())) {
            None => Ok(()),
            Some(entry) => {
                let near = known.iter().min_by_key(|name| strsim::levenshtein(name, &entry.key));
                let near = near.filter(|name| strsim::levenshtein(name, &entry.key) <= 3);
                let hint = near.map_or_else(String::new, |name| format!("; did you mean {name}?"));
                let message = format!("unknown field `{}`; there are {}{hint}", entry.key, known.join(", "));
                Err(FileFault::at(text, entry.key_offset, message))
            }
        }
    }

    fn entry(&self, key: &str) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.key == key)
    }

    fn wrong(text: &str, entry: &Entry, must: &str) -> FileFault {
        let is = match &entry.item {
            Item::Number(_) => "a number",
            Item::Text(_) => "a text",
            Item::Flag(_) => "true or false",
            Item::Table(_) => "a table",
            Item::Tables(_) => "a list of tables",
            Item::Other(what) => what,
        };
        FileFault::at(text, entry.offset, format!("`{}` must be {must}, but this is {is}", entry.key))
    }

    /// A number, when it is there.
    pub(super) fn number(&self, text: &str, key: &str) -> Result<Option<Placed<f64>>, FileFault> {
        let Some(entry) = self.entry(key) else { return Ok(None) };
        match entry.item {
            Item::Number(value) if value.is_finite() => Ok(Some(Placed { value, offset: entry.offset })),
            _ => Err(Self::wrong(text, entry, "a finite number")),
        }
    }

    /// A positive number, when it is there.
    pub(super) fn positive(&self, text: &str, key: &str) -> Result<Option<Placed<f64>>, FileFault> {
        match self.number(text, key)? {
            Some(found) if found.value <= 0.0 => {
                let message = format!("{key} = {}: the value must be positive", found.value);
                Err(FileFault::at(text, found.offset, message))
            }
            found => Ok(found),
        }
    }

    /// A text, when it is there.
    pub(super) fn text(&self, text: &str, key: &str) -> Result<Option<Placed<String>>, FileFault> {
        let Some(entry) = self.entry(key) else { return Ok(None) };
        match &entry.item {
            Item::Text(value) => Ok(Some(Placed { value: value.clone(), offset: entry.offset })),
            _ => Err(Self::wrong(text, entry, "a text")),
        }
    }

    /// True or false, when it is there.
    pub(super) fn flag(&self, text: &str, key: &str) -> Result<Option<bool>, FileFault> {
        let Some(entry) = self.entry(key) else { return Ok(None) };
        match entry.item {
            Item::Flag(value) => Ok(Some(value)),
            _ => Err(Self::wrong(text, entry, "true or false")),
        }
    }

    /// A table, when it is there.
    pub(super) fn table(&self, text: &str, key: &str) -> Result<Option<&Table>, FileFault> {
        let Some(entry) = self.entry(key) else { return Ok(None) };
        match &entry.item {
            Item::Table(inner) => Ok(Some(inner)),
            _ => Err(Self::wrong(text, entry, "a table")),
        }
    }

    /// A list of tables; empty when it is not there.
    pub(super) fn tables(&self, text: &str, key: &str) -> Result<&[Table], FileFault> {
        let Some(entry) = self.entry(key) else { return Ok(&[]) };
        match &entry.item {
            Item::Tables(list) => Ok(list),
            _ => Err(Self::wrong(text, entry, "a list of tables")),
        }
    }

    /// All keys with their offsets.
    pub(super) fn keys(&self) -> impl Iterator<Item = Placed<&str>> {
        self.entries.iter().map(|entry| Placed { value: entry.key.as_str(), offset: entry.key_offset })
    }

    /// Returns a value that was found under `key`, and otherwise a fault. `unit` follows the key in the message: its
    /// unit in parentheses, or a remedy of its own behind a colon.
    pub(super) fn required<T>(&self, text: &str, key: &str, unit: &str, found: Option<T>) -> Result<T, FileFault> {
        found.ok_or_else(|| {
            let place = if self.name.is_empty() { "the file".to_string() } else { format!("[{}]", self.name) };
            let remedy = if unit.starts_with(':') { String::new() } else { format!(": add `{key} = ...` to it") };
            FileFault::at(text, self.offset, format!("{place} lacks `{key}`{unit}{remedy}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{FileFault, parse};

    #[test]
    fn places_are_lines_and_columns() {
        let text = "a\n\u{e9}b = 1\n";
        let place = |offset| {
            let fault = FileFault::at(text, offset, "".into());
            (fault.line, fault.column)
        };
        assert_eq!(place(0), (1, 1));
        assert_eq!(place(text.find('b').expect("there")), (2, 2));
        assert_eq!(place(1000), (3, 1));
    }

    #[test]
    fn what_is_not_asked_for_or_of_another_kind_is_refused() {
        let text = "gear = 1_000\nname = 'x'\n[limits]\ncurent = 2\n[[list]]\na = true\n";
        let file = parse(text).expect("TOML");
        assert_eq!(file.number(text, "gear").expect("a number").map(|found| found.value), Some(1000.0));
        assert_eq!(file.number(text, "ratio"), Ok(None));
        let fault = file.number(text, "name").expect_err("a text").to_string();
        assert_eq!(fault, "line 2, column 8: `name` must be a finite number, but this is a text");
        let limits = file.table(text, "limits").expect("a table").expect("there");
        let fault = limits.only(text, &["current", "voltage"]).expect_err("a slip").to_string();
        assert!(
            fault.starts_with("line 4, column 1: unknown field `curent`") && fault.ends_with("current?"),
            "{fault}"
        );
        let fault = limits.required::<f64>(text, "voltage", " (V)", None).expect_err("missing").to_string();
        assert!(
            fault.ends_with("[limits] lacks `voltage` (V): add `voltage = ...` to it") && fault.starts_with("line 3"),
            "{fault}"
        );
        assert_eq!(file.tables(text, "list").expect("tables")[0].flag(text, "a"), Ok(Some(true)));
        assert!(
            file.tables(text, "gear").is_err() && file.flag(text, "gear").is_err() && file.text(text, "gear").is_err()
        );
        let fault = parse("a = \n").expect_err("no value");
        assert_eq!(fault.line, 1);
    }
}
