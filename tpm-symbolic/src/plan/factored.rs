//! Entries of the regressor in their written form, where that is shorter than the expanded one.
//!
//! The regressor form is a sum of monomials: (q - q0)^2 q'' becomes three terms that nearly cancel when q is near q0. The
//! declared equation still holds the square, and its derivative with respect to a parameter is that parameter's regressor.
//!
//! Invariant: an expression is returned only when, multiplied out, it is exactly the entry of the regressor form, and
//! takes fewer operations. Its origin alone does not count as a proof.

use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{ExprId, Graph};
use crate::mechanics::model::{ExactModel, Kind};
use crate::plan::constants::substitute_values;
use crate::plan::operation::OperationCounts;
use crate::plan::straight_line::Plan;
use crate::regressor::form::RegressorForm;
use num_traits::Zero;
use std::collections::HashMap;

/// The entry of a row and column (`None`: the known terms) from the declared equation, when that is exact and shorter.
pub(crate) fn entry(
    model: &ExactModel,
    form: &RegressorForm,
    graph: &mut Graph,
    (row, column): (usize, Option<usize>),
    polynomial: &Polynomial<ExprId>,
) -> Option<ExprId> {
    // A single term cannot be shortened, and the rows that remain after eliminations are not the declared ones.
    if polynomial.len() < 2 || !model.eliminations.is_empty() {
        return None;
    }
    let equation = model.equations.get(row)?;
    let terms: Vec<ExprId> = equation.terms.iter().map(|term| term.expr).collect();
    let written = match column {
        Some(column) => {
            let parameter = graph.symbol(form.columns.get(column)?.parameter?);
            let slopes: Vec<ExprId> = terms.iter().map(|&term| graph.differentiate(term, parameter)).collect();
            graph.sum(&slopes)
        }
        None => {
            let zero = graph.integer(0);
            let unknown = model.symbols_where(|kind| matches!(kind, Kind::Parameter | Kind::Input));
            let replacement: HashMap<ExprId, ExprId> = unknown.map(|symbol| (graph.symbol(symbol), zero)).collect();
            let rest: Vec<ExprId> = terms.iter().map(|&term| graph.substitute(term, &replacement)).collect();
            graph.sum(&rest)
        }
    };
    // The form contains the values of exact constants, so they are replaced here too.
    let written = substitute_values(model, graph, written);
    // The row of the form may be scaled so that its input stands alone.
    let found = graph.polynomial(written);
    let (monomial, coefficient) = polynomial.terms().next()?;
    let present = found.coefficient(monomial);
    if present.is_zero() {
        return None;
    }
    let scale = coefficient / present;
    if found.scale(&scale) != *polynomial {
        return None;
    }
    let written = graph.scale(written, scale);
    let expanded = graph.from_polynomial(polynomial);
    let cost = |expr: ExprId| {
        let OperationCounts { additions, multiplications, divisions, functions } =
            Plan::unshared(graph, &[expr]).counts();
        additions + multiplications + 4 * divisions + 10 * functions
    };
    (cost(written) < cost(expanded)).then_some(written)
}
