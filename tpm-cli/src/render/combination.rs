//! Combinations of parameters, as people read them.

use std::collections::BTreeMap;
use std::fmt::Write as _;

/// `factor name`, without the factor when it is one.
fn multiple(name: &str, factor: &str) -> String {
    match factor {
        "1" => name.to_owned(),
        "-1" => format!("-{name}"),
        factor => format!("({factor}) {name}"),
    }
}

/// What is said of nonlinear parameters where a rank counts the others alone; nothing where there are none.
pub(crate) fn not_counted(nonlinear: &[String]) -> String {
    if nonlinear.is_empty() {
        return String::new();
    }
    let names = nonlinear.join(", ");
    format!(
        "\nnot counted: {names}, in which the equations are not linear; `tpm identify` says whether a log shows them\n"
    )
}

/// What is said of parameters that equations without anything known in them alone show; nothing where there are none.
pub(crate) fn common_factors(sets: &[Vec<String>]) -> String {
    let mut text = String::new();
    for set in sets {
        let names = set.join(", ");
        let _ = writeln!(
            text,
            "known up to a common factor: {names}; no input or known term stands in the equations that show them. Hold one of them (`tpm \
             identify --freeze {}=VALUE`)",
            set.first().map_or("", String::as_str)
        );
    }
    text
}

/// A sum of named terms with their factors.
pub(crate) fn sum(terms: &BTreeMap<String, String>) -> String {
    terms.iter().map(|(name, factor)| multiple(name, factor)).collect::<Vec<_>>().join(" + ")
}
