//! Replacement of constants with a stated value by numbers in plans.

use crate::expr::graph::{ExprId, Graph, Symbol};
use crate::mechanics::model::{ExactModel, Kind};
use crate::plan::draft::Draft;
use crate::plan::leaf::Leaf;
use std::collections::HashMap;

/// Replaces stated constants by their values, even inside functions, where the regressor form keeps them as symbols.
pub(crate) fn substitute_values(model: &ExactModel, graph: &mut Graph, expr: ExprId) -> ExprId {
    Values::new(model, graph).put_in(graph, expr)
}

/// The values of the constants of a model, for replacement in many expressions of one graph.
pub(crate) struct Values(HashMap<ExprId, ExprId>);

impl Values {
    pub(crate) fn new(model: &ExactModel, graph: &mut Graph) -> Self {
        let mut replacement = HashMap::new();
        for (index, quantity) in (0u32..).zip(&model.symbols) {
            if let Kind::Constant { value: Some(value) } = &quantity.kind {
                let symbol = graph.symbol(Symbol(index));
                replacement.insert(symbol, graph.number(value.clone()));
            }
        }
        Self(replacement)
    }

    /// The expression with numbers for the constants.
    pub(crate) fn put_in(&mut self, graph: &mut Graph, expr: ExprId) -> ExprId {
        if self.0.is_empty() { expr } else { graph.substitute_beside(expr, &mut self.0) }
    }
}

/// The leaf of a quantity, or its value when the model states one.
pub(crate) fn quantity(model: &ExactModel, draft: &mut Draft, symbol: Symbol) -> ExprId {
    match &model.quantity(symbol).kind {
        Kind::Constant { value: Some(value) } => draft.graph.number(value.clone()),
        _ => draft.leaf(Leaf::Symbol(symbol)),
    }
}
