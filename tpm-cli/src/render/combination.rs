//! Combinations of parameters, as people read them.

use std::collections::BTreeMap;

/// `factor name`, without the factor when it is one.
fn multiple(name: &str, factor: &str) -> String {
    match factor {
        "1" => name.to_owned(),
        "-1" => format!("-{name}"),
        factor => format!("({factor}) {name}"),
    }
}

/// A sum of named terms with their factors.
pub(crate) fn sum(terms: &BTreeMap<String, String>) -> String {
    terms.iter().map(|(name, factor)| multiple(name, factor)).collect::<Vec<_>>().join(" + ")
}
