//! Change of one value of an experiment by its path, and the reading of such a value from text.
//!
//! Invariant: an override is accepted exactly when an experiment file that contains the value would be accepted.

use crate::error::ExperimentError;
use crate::file::Experiment;
use crate::names::near;
use toml::{Table, Value};

impl Experiment {
    /// Sets the value at a path to what a text says, which [`written_value`] reads.
    ///
    /// # Errors
    /// Those of [`set_value`](Self::set_value).
    pub fn apply_override(&mut self, path: &str, value: &str) -> Result<(), ExperimentError> {
        self.set_value(path, written_value(value))
    }

    /// Sets the value at a path such as `seed`, `plant.parameters.m` or `schedule.stages.0.lambda`, in the units of the file. A name
    /// that occurs in only one place needs no path.
    ///
    /// # Errors
    /// [`ExperimentError::Override`] when the path does not exist or the value does not fit, with similar names. The
    /// experiment is then unchanged.
    pub fn set_value(&mut self, path: &str, value: Value) -> Result<(), ExperimentError> {
        let refuse =
            |reason: String, near: Vec<String>| ExperimentError::Override { key: path.to_string(), reason, near };
        let mut root = Table::try_from(&*self).map_err(|fault| refuse(fault.to_string(), Vec::new()))?;
        let mut known = Vec::new();
        leaves(&Value::Table(root.clone()), "", &mut known);
        let left_out =
            ["pattern", "harmonics", "control.derivative_filter", "control.position_filter", "control.smoothing"];
        known.extend(left_out.map(String::from));
        known.sort();
        known.dedup();
        let full = if path.contains('.') || root.contains_key(path) {
            path.to_string()
        } else {
            let ends: Vec<&String> = known.iter().filter(|leaf| last(leaf) == path).collect();
            match ends[..] {
                [only] => only.clone(),
                [] => path.to_string(),
                _ => {
                    let places = ends.into_iter().cloned().collect();
                    return Err(refuse("the name occurs in several places; give the whole path".to_string(), places));
                }
            }
        };
        let suggestions = || {
            let mut found = near(&full, known.iter().map(String::as_str));
            for leaf in &known {
                let similar = strsim::jaro_winkler(last(&full), last(leaf)) >= 0.85;
                if similar && !found.contains(leaf) && found.len() < 4 {
                    found.push(leaf.clone());
                }
            }
            found
        };
        let segments: Vec<&str> = full.split('.').collect();
        if !place(&mut root, &segments, value) {
            return Err(refuse("there is no such key".to_string(), suggestions()));
        }
        *self = Value::Table(root).try_into().map_err(|fault: toml::de::Error| {
            refuse(fault.message().trim().to_string(), if known.contains(&full) { Vec::new() } else { suggestions() })
        })?;
        Ok(())
    }
}

/// The value that a text says, written as in an experiment file; a text that is no value of TOML stands for itself, and needs no quotes.
#[must_use]
pub fn written_value(text: &str) -> Value {
    toml::from_str::<Table>(&format!("value = {text}"))
        .ok()
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(text.to_string()))
}

fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

fn leaves(value: &Value, prefix: &str, out: &mut Vec<String>) {
    let join = |key: &str| if prefix.is_empty() { key.to_string() } else { format!("{prefix}.{key}") };
    match value {
        Value::Table(table) => table.iter().for_each(|(key, inner)| leaves(inner, &join(key), out)),
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(i, inner)| leaves(inner, &join(&i.to_string()), out))
        }
        _ => out.push(prefix.to_string()),
    }
}

/// Sets the value at a path and creates missing tables along it; false when the path leads through a value that is no
/// table, or past the end of an array.
fn place(table: &mut Table, path: &[&str], value: Value) -> bool {
    let Some((first, rest)) = path.split_first() else { return false };
    if rest.is_empty() {
        table.insert((*first).to_string(), value);
        return true;
    }
    let next = table.entry((*first).to_string()).or_insert_with(|| Value::Table(Table::new()));
    match next {
        Value::Table(inner) => place(inner, rest, value),
        Value::Array(items) => {
            let Some(item) = rest[0].parse::<usize>().ok().and_then(|index| items.get_mut(index)) else { return false };
            match item {
                Value::Table(inner) => place(inner, &rest[1..], value),
                _ if rest.len() == 1 => {
                    *item = value;
                    true
                }
                _ => false,
            }
        }
        _ => false,
    }
}
