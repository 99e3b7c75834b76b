//! Dry friction about a point at rest.
//!
//! At rest `sign(q')` has no derivative: a machine with dry friction sticks there, and what moves it, moves it away. While it moves one way
//! the sign is a number, and the friction a constant force against the motion: about this moving branch there is a linear model. It is one
//! model where both ways have the same; its constant force is no part of it. Invariant: what has no dry friction is not changed.

use crate::expr::graph::{ExprId, Function, Graph, Node};
use crate::expr::trigonometric;
use std::collections::HashMap;

/// A direction of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Way {
    /// Arguments of signs are positive.
    Forwards,
    /// Arguments of signs are negative.
    Backwards,
    /// The mean of both: at rest.
    Between,
}

/// The signs and absolute values of rates that vanish at a point.
#[derive(Clone, Debug, Default)]
pub(super) struct Branches {
    /// Signs, and absolute values, each with its argument.
    jumps: Vec<(Function, ExprId, ExprId)>,
}

impl Branches {
    /// Those of some terms at a point.
    pub(super) fn of(graph: &mut Graph, terms: &[ExprId], point: &HashMap<ExprId, ExprId>) -> Self {
        let mut found: Vec<(Function, ExprId, ExprId)> = Vec::new();
        let mut stack = terms.to_vec();
        let mut seen = std::collections::HashSet::new();
        while let Some(id) = stack.pop() {
            if !seen.insert(id) {
                continue;
            }
            stack.extend(graph.operands(id));
            if let Node::Function(function @ (Function::Sign | Function::Abs), argument) = *graph.node(id) {
                found.push((function, id, argument));
            }
        }
        found.retain(|(_, _, argument)| {
            let leaves = graph.leaves(*argument);
            let is_rate = |leaf: &ExprId| matches!(graph.node(*leaf), Node::Derivative(_, 1));
            let moves = |leaf: &ExprId| matches!(graph.node(*leaf), Node::Derivative(..));
            let of_rates = leaves.iter().any(is_rate) && leaves.iter().filter(|leaf| moves(leaf)).all(is_rate);
            of_rates && {
                let value = graph.substitute(*argument, point);
                trigonometric::is_zero(graph, value)
            }
        });
        // In the order in which they stand in the model, so that what is said of them is the same every time.
        found.sort_unstable_by_key(|(_, id, _)| *id);
        Branches { jumps: found }
    }

    /// Whether there are none.
    pub(super) fn is_empty(&self) -> bool {
        self.jumps.is_empty()
    }

    /// The first of them.
    pub(super) fn first(&self) -> Option<ExprId> {
        self.jumps.first().map(|(_, id, _)| *id)
    }

    /// The signs: what pushes by a constant.
    pub(super) fn signs(&self) -> impl Iterator<Item = ExprId> + '_ {
        self.jumps.iter().filter(|(function, ..)| *function == Function::Sign).map(|(_, id, _)| *id)
    }

    /// An expression while everything moves one way.
    pub(super) fn taken(&self, graph: &mut Graph, expr: ExprId, way: Way) -> ExprId {
        if self.is_empty() {
            return expr;
        }
        let mut replacement = HashMap::new();
        for &(function, id, argument) in &self.jumps {
            let value = match (function, way) {
                (_, Way::Between) => graph.integer(0),
                (Function::Sign, Way::Forwards) => graph.integer(1),
                (Function::Sign, Way::Backwards) => graph.integer(-1),
                (_, Way::Forwards) => argument,
                (_, Way::Backwards) => graph.neg(argument),
            };
            replacement.insert(id, value);
        }
        graph.substitute(expr, &replacement)
    }
}
