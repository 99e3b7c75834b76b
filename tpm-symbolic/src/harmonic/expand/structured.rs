//! Equations in their written form, multiplied out for a table.
//!
//! Equations without a finite series, and equations that would be too long, are refused before anything is multiplied
//! out.

use crate::algebra::polynomial::Monomial;
use crate::expr::graph::{ExprId, Function, Graph, Node};
use crate::expr::size::Sizes;
use crate::harmonic::error::ExpandError;
use crate::harmonic::expand::atoms::Atoms;
use crate::harmonic::options::ExpandOptions;
use crate::mechanics::model::ExactModel;
use crate::mechanics::pattern::Pattern;
use crate::number::rational;
use crate::regressor::form::{RegressorForm, Row, Term};
use std::borrow::Cow;
use std::collections::BTreeSet;

/// Memory of a term while it is multiplied out, in bytes: a product of several atoms and its coefficient.
const BYTES: f64 = 128.0;

/// The form with all its terms multiplied out.
///
/// # Errors
/// When a coordinate has no motion, a term does not expand finitely, or there would be more terms than the options allow.
pub(super) fn multiplied_out<'f>(
    model: &ExactModel,
    form: &'f RegressorForm,
    pattern: &Pattern,
    options: &ExpandOptions<'_>,
) -> Result<Cow<'f, RegressorForm>, ExpandError> {
    if form.is_expanded(&model.graph) {
        return Ok(Cow::Borrowed(form));
    }
    Atoms::new().resolve(model, &atom_by_atom(&model.graph, form), pattern)?;
    let mut sizes = Sizes::default();
    let (mut total, mut worst) = (0.0, None);
    for term in form.rows.iter().flat_map(|row| &row.terms) {
        let size = term.size(&model.graph, &mut sizes);
        total += size;
        if worst.is_none_or(|(largest, _)| size > largest) {
            worst = Some((size, term.source));
        }
    }
    options.refuse_beyond(worst.map(|(_, source)| source), total, total * BYTES)?;
    Ok(form.expanded(&model.graph))
}

/// A form with one term for every atom of every source term, for checks that concern single atoms.
fn atom_by_atom(graph: &Graph, form: &RegressorForm) -> RegressorForm {
    let mut seen: BTreeSet<(ExprId, bool)> = BTreeSet::new();
    let rows = form.rows.iter().map(|row| {
        let mut terms = Vec::new();
        for term in &row.terms {
            let mut stack: Vec<(ExprId, bool)> =
                term.atoms.factors().map(|(&id, exponent)| (id, exponent < 0)).collect();
            while let Some((id, below)) = stack.pop() {
                if !seen.insert((id, below)) {
                    continue;
                }
                match *graph.node(id) {
                    // Signs and absolute values are expanded separately.
                    Node::Number(_) | Node::Function(Function::Sign | Function::Abs, _) => {}
                    Node::Sum(_) if !below => stack.extend(graph.operands(id).map(|part| (part, false))),
                    Node::Product(_) => stack.extend(graph.operands(id).map(|part| (part, below))),
                    Node::Power(base, exponent) => stack.push((base, below != (exponent < 0))),
                    _ => terms.push(Term {
                        column: term.column,
                        coefficient: rational::integer(1),
                        atoms: Monomial::power_of(id, if below { -1 } else { 1 }),
                        source: term.source,
                    }),
                }
            }
        }
        Row { name: row.name.clone(), terms, inputs: row.inputs.clone() }
    });
    RegressorForm { rows: rows.collect(), columns: form.columns.clone() }
}
