//! What is to be said of a model's text: what `tpm check` says with a place in the text.

use crate::diagnostic::{Diagnostic, Diagnostics, Severity};
use crate::source::{Source, Span};
use crate::{Parsed, parse_model};
use tpm_symbolic::budget::{self, Budget};
use tpm_symbolic::harmonic::expand::{ExpandOptions, expand_with};
use tpm_symbolic::regressor::prepare::{prepare, prepare_any};

/// Faults and remarks in the order of their places. Work beyond the budget is a fault without a place, with `larger` as its help: what a user
/// does to allow a larger budget.
#[must_use]
pub fn findings(source: &Source, budget: Budget, larger: &str) -> Diagnostics {
    let found = budget::run(budget, || match parse_model(source) {
        Ok(parsed) => of_model(&parsed),
        Err(diagnostics) => diagnostics,
    });
    let mut found = found.unwrap_or_else(|halted| {
        [Diagnostic::error(Span::default(), halted.to_string()).help(larger)].into_iter().collect()
    });
    found.sort();
    found
}

/// What only the algebra finds: parameters that are not linear, coordinates that cannot be eliminated, patterns without a table.
fn of_model(parsed: &Parsed) -> Diagnostics {
    let mut found = parsed.warnings.clone();
    match prepare_any(parsed.model.clone()) {
        Err(error) => {
            found.push(parsed.locate(&error));
            return found;
        }
        // Logs identify a model whose inputs do not stand alone; nothing else uses it.
        Ok(prepared) => {
            if let Err(fault) = prepared.require_inputs_alone() {
                let mut remark = parsed.locate(&fault);
                remark.severity = Severity::Warning;
                found.push(remark);
                return found;
            }
        }
    }
    let tables = match parsed.for_read_tables() {
        Ok((model, ..)) => prepare(model).map_err(|error| parsed.locate(&error)),
        Err(error) => Err(parsed.locate(&error)),
    };
    let tables = match tables {
        Ok(tables) => tables,
        Err(fault) => {
            found.push(fault);
            return found;
        }
    };
    for pattern in &tables.model.patterns {
        let mut options = ExpandOptions { harmonics: parsed.declared_harmonics(pattern), ..ExpandOptions::default() };
        if let Err(error) = expand_with(&tables.model, &tables.form, pattern, &mut options) {
            let mut remark = parsed.locate(&error);
            remark.severity = Severity::Warning;
            remark.message =
                format!("no finite table under the pattern, and `tpm expand` will refuse it: {}", remark.message);
            found.push(remark);
        }
    }
    found
}
