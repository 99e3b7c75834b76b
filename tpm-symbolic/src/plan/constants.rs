//! Constants with a stated value: in plans they are numbers, not leaves.

use crate::expr::graph::{ExprId, Graph, Node, Symbol};
use crate::mechanics::model::{ExactModel, Kind};
use crate::plan::draft::Draft;
use crate::plan::leaf::Leaf;
use std::collections::HashMap;

/// Replaces stated constants by their values, also inside functions, where the regressor form keeps them as symbols.
pub(crate) fn substitute_values(model: &ExactModel, graph: &mut Graph, expr: ExprId) -> ExprId {
    let mut replacement = HashMap::new();
    for leaf in graph.leaves(expr) {
        if let Node::Symbol(symbol) = *graph.node(leaf)
            && let Kind::Constant { value: Some(value) } = &model.quantity(symbol).kind
        {
            replacement.insert(leaf, graph.number(value.clone()));
        }
    }
    if replacement.is_empty() { expr } else { graph.substitute(expr, &replacement) }
}

/// The leaf of a quantity, or its value when the model states one.
pub(crate) fn quantity(model: &ExactModel, draft: &mut Draft, symbol: Symbol) -> ExprId {
    match &model.quantity(symbol).kind {
        Kind::Constant { value: Some(value) } => draft.graph.number(value.clone()),
        _ => draft.leaf(Leaf::Symbol(symbol)),
    }
}
