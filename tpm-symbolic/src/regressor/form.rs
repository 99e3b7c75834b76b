//! The regressor form of a model: Phi(q, q', ...) theta + known = B u, row by row.
//!
//! Products of parameters become *lumped* parameters, so that the result is linear in the estimated parameters; the map
//! from physical to lumped parameters is kept exactly.

use crate::budget;
use crate::expr::size::Sizes;
use crate::mechanics::model::ExactModel;
use crate::regressor::collect::{Gathered, WrittenTerm, collect_terms, require_scale, row_of};
use crate::regressor::gather::Gather;
use crate::regressor::lump::{assemble, groups_of, merge_by_traces, merge_proportional};
use crate::regressor::traces::Traces;
use rustc_hash::FxHashMap;

pub use crate::regressor::collect::RegressorError;
pub use crate::regressor::entries::{Column, RegressorForm, Row, Term};
pub use crate::regressor::lump::canonical;

/// Most terms of a model's equations, multiplied out, for which [`prepare`](crate::regressor::prepare::prepare)
/// multiplies them out, which takes some milliseconds. Longer equations keep their structure.
const MOST_TERMS: f64 = 5_000.0;

/// The regressor form of a model with its equations multiplied out.
///
/// # Errors
/// When a parameter does not enter linearly, nothing fixes the scale of the parameters, or an equation vanishes; the source term is named.
pub fn regressor_form(model: &ExactModel) -> Result<RegressorForm, RegressorError> {
    // Equations share functions of the motion, such as the elements of an inertia matrix.
    let mut known = FxHashMap::default();
    let mut rows = Vec::with_capacity(model.equations.len());
    for equation in &model.equations {
        let written = equation.terms.iter().map(|term| {
            let name = || model.display_brief(term.expr);
            let polynomial = budget::within(name, || model.graph.polynomial_beside(term.expr, &mut known));
            WrittenTerm { id: term.id, polynomial }
        });
        rows.push(collect_terms(model, &equation.name, &written.collect::<Vec<_>>())?);
    }
    require_scale(&rows)?;
    let groups = merge_proportional(&rows);
    Ok(assemble(model, rows, groups))
}

/// The regressor form of a model with its equations in their written form. The factors of the form's terms are added to
/// the model's graph.
///
/// # Errors
/// When a parameter does not enter linearly, nothing fixes the scale of the parameters, or an equation vanishes; the source term is named.
pub fn structured_form(model: &mut ExactModel) -> Result<RegressorForm, RegressorError> {
    structured(model, None)
}

/// [`structured_form`] with the columns of another form of the model. Equations that are multiplied out may have
/// further columns, which are proportional to others only by an identity such as that of sine and cosine.
///
/// # Errors
/// See [`structured_form`].
pub fn structured_form_with(model: &mut ExactModel, columns: &[Column]) -> Result<RegressorForm, RegressorError> {
    structured(model, Some(columns))
}

fn structured(model: &mut ExactModel, columns: Option<&[Column]>) -> Result<RegressorForm, RegressorError> {
    let equations = model.equations.clone();
    let mut gather = Gather::new(model);
    let gathered: Vec<Gathered> =
        equations.iter().map(|equation| gather.equation(&equation.terms)).collect::<Result<_, _>>()?;
    let mut rows = Vec::with_capacity(equations.len());
    for (equation, gathered) in equations.iter().zip(gathered) {
        rows.push(row_of(model, &equation.name, gathered, equation.terms.first().map(|term| term.id))?);
    }
    require_scale(&rows)?;
    let mut traces = Traces::new(&model.graph, &rows);
    traces.drop_zeros(&mut rows);
    if let Some((row, equation)) = rows.iter().zip(&equations).find(|(row, _)| row.terms.is_empty()) {
        let term = equation.terms.first().map(|term| term.id);
        return Err(RegressorError::Empty { name: row.name.to_string(), term });
    }
    let groups = match columns {
        Some(columns) => groups_of(columns),
        None => merge_by_traces(&rows, &traces),
    };
    Ok(assemble(model, rows, groups))
}

/// Whether the equations of a model are short enough to be multiplied out.
pub(crate) fn is_short(model: &ExactModel) -> bool {
    let mut sizes = Sizes::default();
    let terms = model.equations.iter().flat_map(|equation| &equation.terms);
    terms.map(|term| sizes.of(&model.graph, term.expr)).sum::<f64>() <= MOST_TERMS
}
