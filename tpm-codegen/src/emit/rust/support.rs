//! What a file that stands alone brings along: the text of the controller's crate.
//!
//! Invariant: the text is taken unchanged; every module takes what it needs from the module around it, which is written here.

use tpm_core::source::SUPPORT;

/// The module `support`; `solves` adds least squares, which a pattern with a table needs.
pub(super) fn text(solves: bool) -> String {
    let mut text = String::from(
        "\n/// What the functions above need beside `core` and the crate `libm`.\n#[allow(dead_code, unused_imports, reason = \"no model needs all of it\")]\npub mod support {\n    pub use self::label::Label;\n    pub use self::real::Real;\n",
    );
    if solves {
        text.push_str(
            "    pub use self::error::AccumulatorError;\n    pub use self::least_squares::{LeastSquares, SolveError, least_squares, weighted_least_squares};\n",
        );
    }
    for (name, source) in SUPPORT {
        if !solves && ["error", "least_squares"].contains(&name) {
            continue;
        }
        text.push_str(&format!("\n    mod {name} {{\n"));
        for line in source.trim_end().lines() {
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
