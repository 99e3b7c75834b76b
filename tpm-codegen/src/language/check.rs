//! Checks of a model as it is written, all of them, each fault at its place.
//!
//! Invariant: a check never stops at a fault, and a fault is reported by one check only. What could not be parsed is not there:
//! with statements missing, nothing is said about what the model lacks.

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

/// What the checks found out and lowering needs.
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
