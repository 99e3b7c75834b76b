//! Options of the form NAME=VALUE.

use crate::failure::Failure;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_codegen::parse_factor;
use tpm_runtime::experiment::prior_values;

/// Parses NAME=VALUE.
pub(crate) fn assignment(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
            Ok((name.trim().to_owned(), value.trim().to_owned()))
        }
        _ => Err(format!("`{text}` is not of the form NAME=VALUE")),
    }
}

/// Parses NAME=VALUE, where the value is a finite number.
pub(crate) fn number_assignment(text: &str) -> Result<(String, f64), String> {
    let (name, value) = assignment(text)?;
    match value.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok((name, number)),
        _ => Err(format!("`{value}` is not a finite number")),
    }
}

/// Parses NAME=FACTOR, where the factor is a number or an expression of numbers and pi, such as `2*pi/4096`. An expression is
/// evaluated exactly as far as it is rational.
pub(crate) fn factor_assignment(text: &str) -> Result<(String, f64), String> {
    let (name, value) = assignment(text)?;
    parse_factor(&value).map(|number| (name, number)).ok_or_else(|| {
        format!("`{value}` is no finite number or expression of numbers and pi, such as 0.1, pi/180 or 2*pi/4096")
    })
}

/// Prior values as they are given on the command line.
#[derive(Clone, Debug)]
pub(crate) enum PriorArg {
    /// The value of one parameter.
    Value(String, f64),
    /// A file with values of several parameters.
    File(PathBuf),
}

impl PriorArg {
    /// Parses NAME=VALUE, or the path of a TOML file.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        if text.contains('=') {
            return number_assignment(text).map(|(name, value)| Self::Value(name, value));
        }
        match Path::new(text).extension() {
            Some(extension) if extension == "toml" => Ok(Self::File(PathBuf::from(text))),
            _ => Err(format!("`{text}` is neither NAME=VALUE nor a file ending in .toml")),
        }
    }

    /// The prior values by name: those of files, and single ones, which stand above those of files.
    pub(crate) fn all(given: &[Self]) -> Result<BTreeMap<String, f64>, Failure> {
        let mut of_files: BTreeMap<String, f64> = BTreeMap::new();
        let mut single = Vec::new();
        for prior in given {
            match prior {
                Self::Value(name, value) => single.push((name.clone(), *value)),
                Self::File(path) => {
                    for (name, value) in prior_file(path)? {
                        if of_files.insert(name.clone(), value).is_some() {
                            let place = path.display();
                            return Err(Failure::Input(format!("{place}: another --prior file gives `{name}` too")));
                        }
                    }
                }
            }
        }
        of_files.extend(once("--prior", &single)?);
        Ok(of_files)
    }
}

/// The values of a prior file.
fn prior_file(path: &Path) -> Result<BTreeMap<String, f64>, Failure> {
    let text = tpm_runtime::report::read_text(path).map_err(|error| Failure::read(path, error))?;
    prior_values(&text).map_err(|fault| Failure::Input(format!("{}: {fault}", path.display())))
}

/// Assignments by name; a repeated name is an error.
pub(crate) fn once<V: Clone>(flag: &str, given: &[(String, V)]) -> Result<BTreeMap<String, V>, Failure> {
    let mut result = BTreeMap::new();
    for (name, value) in given {
        if result.insert(name.clone(), value.clone()).is_some() {
            return Err(Failure::Input(format!("{flag} {name}=... is given twice")));
        }
    }
    Ok(result)
}

/// Assignments by name; an unknown or repeated name is an error that lists the known names.
pub(crate) fn by_name<V: Clone>(
    flag: &str,
    given: &[(String, V)],
    known: &[String],
) -> Result<BTreeMap<String, V>, Failure> {
    if let Some((name, _)) = given.iter().find(|(name, _)| !known.contains(name)) {
        let known = if known.is_empty() { "it has none".to_owned() } else { format!("there are {}", known.join(", ")) };
        return Err(Failure::Input(format!("{flag} {name}=...: the model has no such name; {known}")));
    }
    once(flag, given)
}
