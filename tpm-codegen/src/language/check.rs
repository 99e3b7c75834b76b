//! Checks of a syntax tree. All faults are reported, each at its place.
//!
//! Invariant: a check never stops at a fault, and each fault is reported by one check only. Statements that could not
//! be parsed are missing from the tree; in that case nothing is reported as missing from the model.

mod mechanism;
mod names;
mod parameters;
mod structure;
mod symbols;
mod units;

pub(crate) use symbols::{SymbolKind, Symbols};

use crate::diagnostic::Diagnostics;
use crate::language::ast::ModelDeclaration;
use crate::language::parse::Syntax;
use crate::source::Source;
use tpm_units::Unit;

/// Results of the checks that lowering needs.
pub(crate) struct Checked<'a> {
    pub(crate) symbols: Symbols<'a>,
    /// The unit of each `series` function, by the order of the statements, given or found from the equations.
    pub(crate) series_units: Vec<Option<Unit>>,
}

/// Checks names, uses, structure and units of a model.
pub(crate) fn check<'a>(
    model: &'a ModelDeclaration,
    syntax: &Syntax,
    source: &Source,
    diagnostics: &mut Diagnostics,
) -> Checked<'a> {
    let symbols = symbols::collect(model, diagnostics);
    structure::check(model, &symbols, syntax, diagnostics);
    mechanism::check(model, &symbols, syntax, diagnostics);
    names::check(model, &symbols, syntax, diagnostics);
    let series_units = units::check(model, &symbols, source, diagnostics);
    Checked { symbols, series_units }
}
