//! The leaves of plans.

use crate::expr::graph::{Coordinate, Node, Symbol};
use serde::{Deserialize, Serialize};

/// An argument of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Leaf {
    /// A time derivative of a coordinate (0: the coordinate itself).
    Motion(Coordinate, u32),
    /// A quantity of the model: a run-time constant, an input, an amplitude, a frequency, a physical parameter.
    Symbol(Symbol),
    /// The estimated parameter of a column of the regressor.
    Column(usize),
    /// The cosine of the pattern's phase, cos w t.
    Cos,
    /// The sine of the pattern's phase, sin w t.
    Sin,
    /// A sample of an equation's signal.
    Signal(usize),
    /// A harmonic of the equations' signals, by its row of the harmonic table.
    Harmonic(usize),
}

impl Leaf {
    /// A leaf of a model's own expressions.
    pub(crate) fn of_model(node: &Node) -> Self {
        match *node {
            Node::Symbol(symbol) => Self::Symbol(symbol),
            Node::Derivative(coordinate, order) => Self::Motion(coordinate, order),
            _ => unreachable!("invariant: the leaves of a model's expressions are its symbols and motions"),
        }
    }
}
