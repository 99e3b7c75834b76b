//! Prior values in a file of their own, as an imported description has them beside its model.

use std::collections::BTreeMap;

/// The values of a prior file by parameter: `NAME = VALUE` lines, or those of the table `[prior]` of an experiment.
///
/// # Errors
/// What is wrong with the text, with its place where it is no TOML.
pub fn prior_values(text: &str) -> Result<BTreeMap<String, f64>, String> {
    let whole: toml::Table = text.parse().map_err(|error: toml::de::Error| error.to_string().trim_end().to_owned())?;
    let table = match whole.get("prior") {
        Some(toml::Value::Table(prior)) => prior,
        _ => &whole,
    };
    let number = |(name, value): (&String, &toml::Value)| {
        let number = match value {
            toml::Value::Float(number) => Some(*number),
            toml::Value::Integer(number) => Some(*number as f64),
            _ => None,
        };
        match number.filter(|number| number.is_finite()) {
            Some(number) => Ok((name.clone(), number)),
            None => Err(format!("`{name}` is no finite number: a prior file has lines such as `m_link = 1.5`")),
        }
    };
    if table.is_empty() {
        return Err("the file has no prior values: lines such as `m_link = 1.5`".to_owned());
    }
    table.iter().map(number).collect()
}
