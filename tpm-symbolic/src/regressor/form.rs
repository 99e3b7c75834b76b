//! The model sorted into its parameters: Phi(q, q', ...) theta + known = B u, row by row.
//!
//! Products of parameters become *lumped* parameters, so that the result is linear in what is estimated; the map from
//! physical to lumped parameters is kept exactly.

use crate::mechanics::model::ExactModel;
use crate::regressor::collect::{WrittenTerm, collect_terms};
use crate::regressor::lump::{assemble, merge_proportional};

pub use crate::regressor::collect::RegressorError;
pub use crate::regressor::entries::{Column, RegressorForm, Row, Term};
pub use crate::regressor::lump::canonical;

/// Sorts a model into its parameters.
///
/// # Errors
/// When a parameter or an input does not enter linearly, or an equation vanishes; the source term is named.
pub fn regressor_form(model: &ExactModel) -> Result<RegressorForm, RegressorError> {
    // Equations share functions of the motion, such as the elements of an inertia matrix.
    let terms = model.equations.iter().flat_map(|equation| &equation.terms);
    let mut polynomials = model.graph.polynomials(terms.map(|term| term.expr)).into_iter();
    let mut rows = Vec::with_capacity(model.equations.len());
    for equation in &model.equations {
        let written = equation.terms.iter().zip(polynomials.by_ref()).map(|(term, polynomial)| WrittenTerm {
            id: term.id,
            source: term.expr,
            polynomial,
        });
        rows.push(collect_terms(model, &equation.name, &written.collect::<Vec<_>>())?);
    }
    if rows.iter().all(|row| row.inputs.is_empty()) {
        return Err(RegressorError::NoInput);
    }
    let groups = merge_proportional(&rows);
    Ok(assemble(model, rows, groups))
}
