//! Values of a model's parameters, run-time constants and, for a motion, amplitudes and frequency, exactly as they were
//! written.
//!
//! Invariant: a decimal is the rational number that its digits say; a name that the model does not have is an error. A parameter
//! that a result of an identification leaves open has no value until it is shown that none is needed.

use crate::failure::Failure;
use crate::input::assignments::{assignment, once};
use crate::output::file;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_codegen::identified::{Identified, IdentifiedError, READABLE_SCHEMAS, remedy};
use tpm_runtime::report::number;
use tpm_runtime::session::{StoredFault, StoredResult, agreeing};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::number::rational::{self, Rational};

/// Numbers that differ by no more than this share of their size are alike: a result has nine digits of what the data do not show.
const ALIKE: f64 = 1e-6;
/// Numbers below this share of the largest one are rounding.
const ROUNDING: f64 = 1e-12;

/// Options that give values.
#[derive(clap::Args)]
pub(crate) struct ValueArgs {
    /// Values of parameters and run-time constants: NAME = VALUE lines (.toml), or a result of `tpm identify --json`
    /// (.json), whose parameters need not all be identified where the answer does not depend on them.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Value of one parameter or run-time constant; goes before that of the file.
    #[arg(long = "value", value_name = "NAME=VALUE", value_parser = assignment)]
    values: Vec<(String, String)>,
}

impl ValueArgs {
    /// The options as they are given on the command line, files without their folders.
    pub(crate) fn flags(&self) -> String {
        let name = |path: &PathBuf| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let file = self.params.iter().map(|path| format!(" --params {}", name(path)));
        file.chain(self.values.iter().map(|(name, value)| format!(" --value {name}={value}"))).collect()
    }

    /// Options that name a file of values and nothing else.
    pub(crate) fn file(path: &Path) -> Self {
        Self { params: Some(path.to_owned()), values: Vec::new() }
    }
}

/// Values by symbol.
#[derive(Clone, Debug, Default)]
pub(crate) struct Values {
    known: BTreeMap<Symbol, Rational>,
    hidden: Hidden,
}

/// What is left open of the parameters that a result does not give.
#[derive(Clone, Debug, Default)]
struct Hidden {
    /// One set of values with which the result holds.
    values: BTreeMap<Symbol, Rational>,
    open: Vec<Open>,
}

/// A direction along which these values may move.
#[derive(Clone, Debug)]
struct Open {
    direction: String,
    parameters: Vec<String>,
    /// Other sets of values with which the result holds.
    others: Vec<BTreeMap<Symbol, Rational>>,
}

/// A number that a command computes from values, with the words that name it.
pub(crate) type Output = (String, f64);

impl Values {
    /// Reads the given values of parameters and run-time constants.
    pub(crate) fn load(args: &ValueArgs, model: &ExactModel) -> Result<Self, Failure> {
        Self::load_with(args, model, None)
    }

    /// Reads the given values, which may include the amplitudes and the frequency of a pattern.
    pub(crate) fn load_with(args: &ValueArgs, model: &ExactModel, pattern: Option<&Pattern>) -> Result<Self, Failure> {
        let mut known = BTreeMap::new();
        let mut result = None;
        if let Some(path) = &args.params {
            let text = tpm_runtime::report::read_text(path).map_err(|error| Failure::read(path, error))?;
            let json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
            let found = if json {
                let identified = identification(path, &text, &model.name)?;
                let found = shown(&identified, model);
                result = Some((path, identified));
                found
            } else {
                table(path, &text)?
            };
            for (name, value) in found {
                known.insert(symbol(model, pattern, &name, &path.display().to_string())?, value);
            }
        }
        once("--value", &args.values)?;
        for (name, text) in &args.values {
            let value = rational::parse(text).ok_or_else(|| {
                Failure::Input(format!("--value {name}={text}: write a number, such as 2, 0.022, 3.168e-4 or 1/3"))
            })?;
            known.insert(symbol(model, pattern, name, "--value")?, value);
        }
        let mut values = Self { known, hidden: Hidden::default() };
        if let Some((path, identified)) = result {
            values.complete(model, path, &identified)?;
        }
        Ok(values)
    }

    /// Takes in what a result says of the parameters that it gives no value to: stated priors become values, with a remark, and what
    /// is open stays apart until [`settled`](Self::settled).
    fn complete(&mut self, model: &ExactModel, path: &Path, identified: &Identified) -> Result<(), Failure> {
        let left = model.parameters().filter(|symbol| !self.known.contains_key(symbol));
        let listed =
            |name: &str| identified.parameters.iter().chain(&identified.physical).any(|entry| entry.name == name);
        let left: Vec<Symbol> = left.filter(|symbol| listed(&model.quantity(*symbol).name)).collect();
        if left.is_empty() {
            return Ok(());
        }
        let name = |symbol: Symbol| model.quantity(symbol).name.to_string();
        let at = |what: String| Failure::Input(format!("{}: {what}", path.display()));
        let given = self.known.iter().map(|(symbol, value)| (name(*symbol), rational::to_f64(value))).collect();
        let found = agreeing(model, identified, &given).map_err(|error| {
            let flags: Vec<String> = left.iter().map(|symbol| format!("--value {}=VALUE", name(*symbol))).collect();
            at(format!("{error}; give {}", flags.join(" ")))
        })?;
        let by_symbol = |values: &BTreeMap<String, f64>| -> BTreeMap<Symbol, Rational> {
            let exact = |(name, value): (&String, &f64)| Some((model.find_symbol(name)?, rational::from_f64(*value)?));
            values.iter().filter_map(exact).collect()
        };
        for name in &found.from_prior {
            let value = found.values[name];
            file::remark(&format!(
                "remark: {}: the data do not show `{name}`; its value {} is that of a stated prior",
                path.display(),
                number(value)
            ));
        }
        let mut values = by_symbol(&found.values);
        let of = |names: &[String], name: &str| names.iter().any(|other| other == name);
        let is_open = |name: &str| found.open.iter().any(|open| of(&open.parameters, name));
        self.known.extend(values.extract_if(.., |symbol, _| !is_open(&name(*symbol))));
        let open = found.open.into_iter().map(|open| Open {
            others: open.others.iter().map(&by_symbol).collect(),
            direction: open.direction,
            parameters: open.parameters,
        });
        self.hidden = Hidden { values, open: open.collect() };
        Ok(())
    }

    /// The values with every parameter in place, when what is computed from them does not depend on what a result leaves open.
    ///
    /// `outputs` computes what the command needs, in numbers. It is computed from several sets of values with which the result
    /// holds, and must come out alike.
    pub(crate) fn settled(&self, outputs: impl Fn(&Self) -> Result<Vec<Output>, Failure>) -> Result<Self, Failure> {
        if self.hidden.values.is_empty() {
            return Ok(self.clone());
        }
        let with = |hidden: &BTreeMap<Symbol, Rational>| {
            let all = self.known.iter().chain(hidden).map(|(symbol, value)| (*symbol, value.clone()));
            Self { known: all.collect(), hidden: Hidden::default() }
        };
        let settled = with(&self.hidden.values);
        let own = outputs(&settled)?;
        for Open { direction, parameters, others } in &self.hidden.open {
            for other in others {
                let changed = match outputs(&with(other)) {
                    Ok(other) => first_change(&own, &other),
                    // Values with which the model is no machine are an outcome that differs.
                    Err(_) => Some("the result".to_owned()),
                };
                if let Some(changed) = changed {
                    let flags: Vec<String> = parameters.iter().map(|name| format!("--value {name}=VALUE")).collect();
                    return Err(Failure::Input(format!(
                        "the identified values do not determine {direction}, and {changed} needs it; {} (or give {} here)",
                        remedy(parameters),
                        flags.join(" or ")
                    )));
                }
            }
        }
        Ok(settled)
    }

    /// The value of a symbol; nothing for a parameter that a result leaves open, unless the values are settled.
    pub(crate) fn get(&self, symbol: Symbol) -> Option<&Rational> {
        self.known.get(&symbol)
    }

    /// Whether nothing was given.
    pub(crate) fn is_empty(&self) -> bool {
        self.known.is_empty() && self.hidden.values.is_empty()
    }

    /// Names of the parameters and run-time constants, and of a pattern's amplitudes and frequency, of which nothing is known.
    pub(crate) fn missing(&self, model: &ExactModel, pattern: Option<&Pattern>) -> Vec<String> {
        model
            .parameters()
            .chain(model.run_time_constants())
            .chain(motion(pattern))
            .filter(|symbol| !self.known.contains_key(symbol) && !self.hidden.values.contains_key(symbol))
            .map(|symbol| model.quantity(symbol).name.to_string())
            .collect()
    }
}

/// The first number that differs by more than rounding from what it is with other values; numbers of equal name are of one size.
fn first_change(own: &[Output], other: &[Output]) -> Option<String> {
    let mut sizes: BTreeMap<&str, f64> = BTreeMap::new();
    for (name, value) in own.iter().chain(other) {
        let size = sizes.entry(name).or_default();
        *size = size.max(value.abs());
    }
    let largest = sizes.values().copied().fold(0.0, f64::max);
    let same = |(name, value): &Output, other: &Output| {
        (value - other.1).abs() <= (ALIKE * sizes[name.as_str()]).max(ROUNDING * largest)
    };
    if own.len() != other.len() {
        return Some("the result".to_owned());
    }
    own.iter().zip(other).find(|(own, other)| !same(own, other)).map(|(own, _)| own.0.clone())
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

/// Reads NAME = VALUE lines.
pub(crate) fn table(path: &Path, text: &str) -> Result<Vec<(String, Rational)>, Failure> {
    let at = |what: String| Failure::Input(format!("{}: {what}", path.display()));
    let table: toml::Table = text.parse().map_err(|error: toml::de::Error| {
        at(format!(
            "{}; type a file ending in .toml with lines such as `m = 1.5`, or a result ending in .json",
            error.to_string().trim_end()
        ))
    })?;
    let mut values = Vec::new();
    for (name, value) in table {
        let text = match &value {
            toml::Value::Integer(value) => value.to_string(),
            // The shortest decimal of the number: the text as written, up to 15 digits.
            toml::Value::Float(value) => value.to_string(),
            toml::Value::String(text) => text.clone(),
            toml::Value::Table(_) => {
                return Err(at(format!(
                    "`{name}` is a table; values of parameters are lines `NAME = VALUE` without a heading, such as `m = 1.5`"
                )));
            }
            _ => return Err(at(format!("`{name}` must be a number: write lines such as `m = 1.5`"))),
        };
        let value = rational::parse(&text).ok_or_else(|| at(format!("`{name}`: `{text}` is not a finite number")))?;
        values.push((name, value));
    }
    Ok(values)
}

/// Reads a result of `tpm identify --json`, or values of the parameters of a model, NAME = VALUE lines, from a file ending in .toml.
pub(crate) fn identification(path: &Path, text: &str, model: &str) -> Result<Identified, Failure> {
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) {
        let values = table(path, text)?.into_iter().map(|(name, value)| (name, rational::to_f64(&value))).collect();
        return Ok(Identified::of_values(model, &values));
    }
    Identified::from_json(text).map_err(|error| {
        let known = READABLE_SCHEMAS.join(" or ");
        Failure::Input(match error {
            IdentifiedError::Schema(fault) => {
                format!("{}: this is no result of `tpm identify --json` (schema {known}): {fault}; type a file that `tpm identify --json -o FILE` wrote", path.display())
            }
            other => format!("{}: {other}", path.display()),
        })
    })
}

/// The identified values whose names the model knows; values of lumped parameters give way to those of the physical
/// ones.
fn shown(identified: &Identified, model: &ExactModel) -> Vec<(String, Rational)> {
    let lists = identified.parameters.iter().chain(&identified.physical);
    let known = lists.filter(|entry| model.find_symbol(&entry.name).is_some());
    known.filter_map(|entry| Some((entry.name.clone(), rational::parse(&entry.value?.to_string())?))).collect()
}

/// The first value or deviation of a result whose products with others would overflow or vanish, with the name under which it stands.
fn beyond_size(value: &serde_json::Value) -> Option<(String, f64)> {
    let below = |name: String, inner: &serde_json::Value| {
        let least = if name == "std" { 1e-100 } else { 0.0 };
        let size = inner.as_f64().filter(|size| *size != 0.0 && !(least..=1e100).contains(&size.abs()));
        match (size, beyond_size(inner)) {
            (Some(size), _) => Some((name, size)),
            (None, Some((place, size))) => Some((format!("{name}.{place}"), size)),
            (None, None) => None,
        }
    };
    match value {
        serde_json::Value::Array(list) => list.iter().enumerate().find_map(|(at, inner)| below(at.to_string(), inner)),
        serde_json::Value::Object(map) => map.iter().find_map(|(name, inner)| below(name.clone(), inner)),
        _ => None,
    }
}

/// Reads a result of an identification with its covariances.
pub(crate) fn stored_result(path: &Path) -> Result<StoredResult, Failure> {
    let text = tpm_runtime::report::read_text(path).map_err(|error| Failure::read(path, error))?;
    if let Some((place, value)) = serde_json::from_str(&text).ok().as_ref().and_then(beyond_size) {
        return Err(Failure::Input(format!(
            "{}: `{place}` is {value:e}, which no machine has; sizes are from 1e-100 to 1e100: identify again, and check the units of the log",
            path.display()
        )));
    }
    StoredResult::parse(&text).map_err(|fault| {
        let remedy = match fault {
            StoredFault::Form(_) | StoredFault::Schema => "; type a file that `tpm identify --json -o FILE` wrote",
            _ => "",
        };
        Failure::Input(format!("{}: {fault}{remedy}", path.display()))
    })
}
