//! Files of the study. The shipped ones are part of the program, so that it finds them wherever it is started.

use super::failure::Failure;
use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use tpm_codegen::source::Source;
use tpm_codegen::{Parsed, parse_model};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::number::rational::{self, Rational};

/// The path of a file, by which messages name it, and what the file holds.
#[derive(Clone)]
pub(super) struct Input {
    pub(super) path: PathBuf,
    bytes: Vec<u8>,
}

impl Input {
    /// A file of the folder `models`.
    pub(super) fn shipped(name: &str, text: &str) -> Self {
        Self { path: Path::new("models").join(name), bytes: text.as_bytes().to_vec() }
    }

    /// The pendulum upright (Fong, Eqn 3).
    pub(super) fn upright() -> Self {
        Self::shipped("rotary_pendulum.tpm", include_str!("../../../models/rotary_pendulum.tpm"))
    }

    /// The pendulum hanging down (Fong, Eqn 26).
    pub(super) fn down() -> Self {
        Self::shipped("rotary_pendulum_down.tpm", include_str!("../../../models/rotary_pendulum_down.tpm"))
    }

    /// The experiment on the pendulum hanging down.
    pub(super) fn experiment() -> Self {
        Self::shipped("rotary_pendulum_down.toml", include_str!("../../../models/rotary_pendulum_down.toml"))
    }

    /// Values of the parameters and constants (Fong, Table 1).
    pub(super) fn table_1() -> Self {
        Self::shipped("rotary_pendulum_table1.toml", include_str!("../../../models/rotary_pendulum_table1.toml"))
    }

    /// Reads a file.
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        match std::fs::read(path) {
            Ok(bytes) => Ok(Self { path: path.to_owned(), bytes }),
            Err(source) => Err(Failure::Read { path: path.to_owned(), source }),
        }
    }

    /// A fault of the file.
    pub(super) fn fault(&self, what: impl std::fmt::Display) -> Failure {
        Failure::Input(format!("{}: {what}", self.path.display()))
    }

    /// The file's text.
    pub(super) fn text(&self) -> Result<&str, Failure> {
        std::str::from_utf8(&self.bytes).map_err(|error| self.fault(error))
    }

    /// The model in the file, with its source for messages. Warnings go to standard error.
    pub(super) fn model(&self) -> Result<(Source, Parsed), Failure> {
        let source = Source::from_bytes(self.path.display().to_string(), self.bytes.clone());
        let parsed = parse_model(&source).map_err(|diagnostics| Failure::Model(diagnostics.render(&source)))?;
        if !parsed.warnings.is_empty() {
            let _ = writeln!(std::io::stderr(), "{}", parsed.warnings.render(&source).trim_end());
        }
        Ok((source, parsed))
    }

    /// Values of a model's parameters and run-time constants from NAME = VALUE lines, exactly as their decimals are written.
    pub(super) fn values(&self, model: &ExactModel) -> Result<BTreeMap<Symbol, Rational>, Failure> {
        let table: toml::Table = self.text()?.parse().map_err(|error: toml::de::Error| self.fault(error))?;
        let mut values = BTreeMap::new();
        for (name, value) in table {
            let text = match &value {
                toml::Value::Integer(value) => value.to_string(),
                // The shortest decimal that is this number: what was written, up to 15 digits.
                toml::Value::Float(value) => value.to_string(),
                toml::Value::String(text) => text.clone(),
                _ => return Err(self.fault(format!("`{name}` must be a number"))),
            };
            let value = rational::parse(&text);
            let value = value.ok_or_else(|| self.fault(format!("`{name}`: `{text}` is not a finite number")))?;
            let known = |symbol: &Symbol| {
                matches!(model.quantity(*symbol).kind, Kind::Parameter | Kind::Constant { value: None })
            };
            let symbol = model.find_symbol(&name).filter(known).ok_or_else(|| {
                self.fault(format!("model {} has no parameter or run-time constant `{name}`", model.name))
            })?;
            values.insert(symbol, value);
        }
        Ok(values)
    }
}
