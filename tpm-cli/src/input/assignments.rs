//! Options of the form NAME=VALUE.

use crate::failure::Failure;
use std::collections::BTreeMap;
use tpm_codegen::parse_value;
use tpm_codegen::source::Source;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::number::rational;

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
    let number = value.parse::<f64>().ok().or_else(|| {
        let mut numbers = ExactModel::default();
        let expression = parse_value(&Source::new("factor", value.as_str()), &mut numbers).ok()?;
        let exact = numbers.graph.evaluate_exact(expression, |_| None);
        Some(exact.map_or_else(|| numbers.graph.evaluate(expression, |_| f64::NAN), |exact| rational::to_f64(&exact)))
    });
    match number {
        Some(number) if number.is_finite() => Ok((name, number)),
        _ => Err(format!(
            "`{value}` is no finite number or expression of numbers and pi, such as 0.1, pi/180 or 2*pi/4096"
        )),
    }
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
