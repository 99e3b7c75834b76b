//! Expressions over the leaves of a plan, before they are compiled.
//!
//! Invariant of [`Draft`]: placeholder i of the graph stands for entry i of the leaves; equal leaves are one placeholder.

use crate::expr::graph::{ExprId, Graph, Node};
use crate::plan::leaf::Leaf;
use crate::plan::straight_line::Plan;

/// An expression graph with leaves of type `L`. If it began as a model's graph, it also holds quantities of the model.
#[derive(Debug)]
pub(crate) struct Draft<L = Leaf> {
    pub(crate) graph: Graph,
    leaves: Vec<L>,
}

impl<L: Clone + PartialEq + From<Leaf>> Draft<L> {
    /// A draft over the expressions of a graph without placeholders.
    pub(crate) fn new(graph: Graph) -> Self {
        Self { graph, leaves: Vec::new() }
    }

    /// The expression of a leaf.
    pub(crate) fn leaf(&mut self, leaf: L) -> ExprId {
        let index = self.leaves.iter().position(|present| *present == leaf).unwrap_or_else(|| {
            self.leaves.push(leaf);
            self.leaves.len() - 1
        });
        self.graph.placeholder(u32::try_from(index).expect("invariant: fewer than 2^32 leaves"))
    }

    /// The plan that computes these expressions.
    pub(crate) fn plan(&self, roots: &[ExprId]) -> Plan<L> {
        Plan::with_leaves(&self.graph, roots, |node| match *node {
            Node::Placeholder(index) => self.leaves[index as usize].clone(),
            _ => Leaf::of_model(node).into(),
        })
    }
}
