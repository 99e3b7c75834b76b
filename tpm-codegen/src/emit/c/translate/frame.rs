//! A function while it is translated: its names with their types, and its text so far.

use std::collections::{HashMap, HashSet};

use super::super::layout::statement as line;
use super::library::Untranslated;
use super::types::Type;

/// A function while it is translated.
pub(super) struct Frame {
    pub(super) file: String,
    /// The sizes of its structure.
    pub(super) environment: HashMap<String, String>,
    pub(super) own: Option<Type>,
    /// Names of type parameters that stand for a model.
    pub(super) models: HashSet<String>,
    pub(super) scopes: Vec<HashMap<String, Type>>,
    pub(super) used: HashSet<String>,
    pub(super) result: Type,
    pub(super) text: String,
    pub(super) depth: usize,
    counters: usize,
}

impl Frame {
    pub(super) fn new(file: String, environment: HashMap<String, String>, own: Option<Type>) -> Self {
        let (scopes, used) = (vec![HashMap::new()], HashSet::new());
        let (models, text) = (HashSet::new(), String::new());
        Self { file, environment, own, models, scopes, used, result: Type::Unit, text, depth: 1, counters: 0 }
    }

    /// A name that no other of the function has: C would hide the outer one, or refuse it.
    pub(super) fn declare(&mut self, name: &str, ty: Type) -> Result<(), Untranslated> {
        if self.scopes.iter().any(|scope| scope.contains_key(name)) {
            return Err(format!("the name {name} is given twice"));
        }
        if let Some(scope) = self.scopes.last_mut() {
            scope.insert(name.to_owned(), ty);
        }
        Ok(())
    }

    pub(super) fn local(&mut self, name: &str) -> Option<Type> {
        let found = self.scopes.iter().rev().find_map(|scope| scope.get(name).cloned());
        if found.is_some() {
            self.used.insert(name.to_owned());
        }
        found
    }

    pub(super) fn write(&mut self, text: &str) {
        self.text.push_str(&line(self.depth, text));
    }

    /// An index that no other loop has.
    pub(super) fn counter(&mut self) -> String {
        self.counters += 1;
        format!("i{}", self.counters)
    }
}
