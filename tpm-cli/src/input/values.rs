//! Values of a model's parameters, run-time constants and, for a motion, amplitudes and frequency, exactly as they were
//! written.
//!
//! Invariant: a decimal is the rational number that its digits say; a name that the model does not have is an error.

use crate::failure::Failure;
use crate::input::assignments::{assignment, once};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_codegen::emit::estimator::READABLE_SCHEMAS;
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::number::rational::{self, Rational};

/// Options that give values.
#[derive(clap::Args)]
pub(crate) struct ValueArgs {
    /// Values of parameters and run-time constants: NAME = VALUE lines (.toml), or a result of `tpm identify --json`
    /// (.json).
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Value of one parameter or run-time constant; goes before that of the file.
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    set: Vec<(String, String)>,
}

impl ValueArgs {
    /// Options that name a file of values and nothing else.
    pub(crate) fn file(path: &Path) -> Self {
        Self { params: Some(path.to_owned()), set: Vec::new() }
    }
}

/// Values by symbol.
#[derive(Clone, Debug, Default)]
pub(crate) struct Values(BTreeMap<Symbol, Rational>);

impl Values {
    /// Reads the given values of parameters and run-time constants.
    pub(crate) fn load(args: &ValueArgs, model: &ExactModel) -> Result<Self, Failure> {
        Self::load_with(args, model, None)
    }

    /// Reads the given values, which may include the amplitudes and the frequency of a pattern.
    pub(crate) fn load_with(args: &ValueArgs, model: &ExactModel, pattern: Option<&Pattern>) -> Result<Self, Failure> {
        let mut values = BTreeMap::new();
        if let Some(path) = &args.params {
            let text = std::fs::read_to_string(path).map_err(|error| Failure::read(path, error))?;
            let json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
            let found = if json { identified(path, &text, model)? } else { table(path, &text)? };
            for (name, value) in found {
                values.insert(symbol(model, pattern, &name, &path.display().to_string())?, value);
            }
        }
        once("--set", &args.set)?;
        for (name, text) in &args.set {
            let value = rational::parse(text).ok_or_else(|| {
                Failure::Input(format!("--set {name}={text}: write a number, such as 2, 0.022, 3.168e-4 or 1/3"))
            })?;
            values.insert(symbol(model, pattern, name, "--set")?, value);
        }
        Ok(Values(values))
    }

    /// The value of a symbol.
    pub(crate) fn get(&self, symbol: Symbol) -> Option<&Rational> {
        self.0.get(&symbol)
    }

    /// Whether nothing was given.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Names of the parameters and run-time constants, and of a pattern's amplitudes and frequency, that have no value.
    pub(crate) fn missing(&self, model: &ExactModel, pattern: Option<&Pattern>) -> Vec<String> {
        model
            .parameters()
            .chain(model.run_time_constants())
            .chain(motion(pattern))
            .filter(|symbol| !self.0.contains_key(symbol))
            .map(|symbol| model.quantity(symbol).name.to_string())
            .collect()
    }
}

/// Amplitudes and frequency of a pattern.
fn motion(pattern: Option<&Pattern>) -> impl Iterator<Item = Symbol> + '_ {
    pattern.into_iter().flat_map(|pattern| pattern.amplitudes.iter().copied().chain([pattern.frequency]))
}

fn symbol(model: &ExactModel, pattern: Option<&Pattern>, name: &str, place: &str) -> Result<Symbol, Failure> {
    let motion: Vec<Symbol> = motion(pattern).collect();
    let known = model.find_symbol(name);
    match known.map(|symbol| (symbol, &model.quantity(symbol).kind)) {
        Some((symbol, Kind::Parameter | Kind::Constant { value: None })) => Ok(symbol),
        Some((symbol, _)) if motion.contains(&symbol) => Ok(symbol),
        Some((_, Kind::Constant { value: Some(value) })) => Err(Failure::Input(format!(
            "{place}: `{name}` is fixed to {} in model {}; declare it without a value there to set it",
            rational::display(value),
            model.name
        ))),
        _ => {
            let symbols = model.parameters().chain(model.run_time_constants()).chain(motion.iter().copied());
            let names: Vec<&str> = symbols.map(|symbol| model.quantity(symbol).name.as_str()).collect();
            let kinds = if motion.is_empty() {
                "parameter or run-time constant"
            } else {
                "parameter, run-time constant, amplitude or frequency"
            };
            Err(Failure::Input(format!(
                "{place}: model {} has no {kinds} `{name}`; it has {}",
                model.name,
                names.join(", ")
            )))
        }
    }
}

fn table(path: &Path, text: &str) -> Result<Vec<(String, Rational)>, Failure> {
    let at = |what: String| Failure::Input(format!("{}: {what}", path.display()));
    let table: toml::Table = text.parse().map_err(|error: toml::de::Error| at(error.to_string()))?;
    let mut values = Vec::new();
    for (name, value) in table {
        let text = match &value {
            toml::Value::Integer(value) => value.to_string(),
            // The shortest decimal of the number: the text as written, up to 15 digits.
            toml::Value::Float(value) => value.to_string(),
            toml::Value::String(text) => text.clone(),
            _ => return Err(at(format!("`{name}` must be a number"))),
        };
        let value = rational::parse(&text).ok_or_else(|| at(format!("`{name}`: `{text}` is not a finite number")))?;
        values.push((name, value));
    }
    Ok(values)
}

/// Parses a result of `tpm identify --json`.
pub(crate) fn identification(path: &Path, text: &str) -> Result<serde_json::Value, Failure> {
    let at = |what: String| Failure::Input(format!("{}: {what}", path.display()));
    let whole: serde_json::Value = serde_json::from_str(text).map_err(|error| at(error.to_string()))?;
    if !READABLE_SCHEMAS.iter().any(|schema| whole["schema"] == *schema) {
        let known = READABLE_SCHEMAS.join(" or ");
        return Err(at(format!("this is no result of `tpm identify --json` (schema {known})")));
    }
    Ok(whole)
}

/// The identified values whose names the model knows; values of lumped parameters give way to those of the physical
/// ones.
fn identified(path: &Path, text: &str, model: &ExactModel) -> Result<Vec<(String, Rational)>, Failure> {
    let at = |what: String| Failure::Input(format!("{}: {what}", path.display()));
    let whole = identification(path, text)?;
    let mut values = Vec::new();
    for list in ["parameters", "physical"] {
        for entry in whole[list].as_array().into_iter().flatten() {
            let Some(name) = entry["name"].as_str().filter(|name| model.find_symbol(name).is_some()) else { continue };
            let value = entry["value"].as_f64().and_then(|value| rational::parse(&value.to_string()));
            values.push((
                name.to_owned(),
                value.ok_or_else(|| {
                    at(format!("`{name}` was not identified, so it has no value; give one with --set {name}=VALUE"))
                })?,
            ));
        }
    }
    Ok(values)
}
