//! What a file that stands alone brings along: the runtime's own text.
//!
//! Invariant: the files under `support/` are links to the runtime's sources, so that nothing stands twice; what they take from
//! their crate is what stands beside them here.

/// A module's name, and its source.
const SOURCES: [(&str, &str); 4] = [
    ("error", include_str!("support/error.rs")),
    ("label", include_str!("support/label.rs")),
    ("least_squares", include_str!("support/least_squares.rs")),
    ("real", include_str!("support/real.rs")),
];

/// The module `support`; with what solves where a pattern has a table.
pub(super) fn text(solves: bool) -> String {
    let mut text = String::from(
        "\n/// What the functions above need beside `core` and the crate `libm`.\n#[allow(dead_code, unused_imports, reason = \"no model needs all of it\")]\npub mod support {\n    pub use self::label::Label;\n    pub use self::real::Real;\n",
    );
    if solves {
        text.push_str(
            "    pub use self::error::AccumulatorError;\n    pub use self::least_squares::{LeastSquares, SolveError, least_squares, weighted_least_squares};\n",
        );
    }
    for (name, source) in SOURCES {
        if !solves && ["error", "least_squares"].contains(&name) {
            continue;
        }
        text.push_str(&format!("\n    mod {name} {{\n"));
        let own = source.split("#[cfg(test)]").next().unwrap_or(source);
        for line in own.trim_end().lines() {
            let line = match line {
                "use crate::model::Label;" => "use super::Label;",
                "use crate::real::Real;" => "use super::Real;",
                other => other,
            };
            if !line.is_empty() {
                text.push_str("        ");
                text.push_str(line);
            }
            text.push('\n');
        }
        text.push_str("    }\n");
    }
    text.push_str("}\n");
    text
}

#[cfg(test)]
mod tests {
    use super::text;

    #[test]
    fn nothing_of_the_runtime_is_left() {
        for solves in [true, false] {
            let text = text(solves);
            assert!(!text.contains("crate::") && !text.contains("cfg(test)"), "{text}");
            assert!(syn::parse_file(&text).is_ok());
        }
    }
}
