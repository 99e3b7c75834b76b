//! The model language: source to tokens to a model as it is written, and its checks.

pub mod ast;
mod check;
pub mod function;
mod lex;
mod parse;
mod print;
pub mod stream;
mod suggest;
mod token;
pub mod unit;

pub use parse::DEEPEST;

use crate::diagnostic::Diagnostics;
use crate::source::Source;

/// The syntax of a source, unchecked: what it says, not whether it makes sense.
///
/// # Errors
/// Every fault of the text, in the order of their places.
pub fn parse(source: &Source) -> Result<ast::Model, Diagnostics> {
    let mut diagnostics = Diagnostics::new();
    let syntax = parse::parse(source, &mut diagnostics);
    diagnostics.sort();
    match syntax.model {
        Some(model) if !diagnostics.has_errors() => Ok(model),
        _ => Err(diagnostics),
    }
}

/// Parses and checks a source. The warnings come beside the model.
///
/// # Errors
/// Every fault of the text, of its names, its structure and its units, in the order of their places.
pub fn check(source: &Source) -> Result<(ast::Model, Diagnostics), Diagnostics> {
    let mut diagnostics = Diagnostics::new();
    let mut syntax = parse::parse(source, &mut diagnostics);
    let model = syntax.model.take();
    if let Some(model) = &model {
        check::check(model, &syntax, source, &mut diagnostics);
    }
    diagnostics.sort();
    match model {
        Some(model) if !diagnostics.has_errors() => Ok((model, diagnostics)),
        _ => Err(diagnostics),
    }
}
