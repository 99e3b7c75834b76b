//! Values of expressions, in double precision or exact.

use crate::expr::graph::{ExprId, Graph, Node};
use crate::number::rational::{self, Rational};
use num_traits::Zero;

impl Graph {
    /// The value in double precision, given the leaves.
    #[must_use]
    pub fn evaluate(&self, expr: ExprId, mut leaf: impl FnMut(&Node) -> f64) -> f64 {
        let mut values: Vec<Option<f64>> = vec![None; expr.index() + 1];
        let mut stack = vec![expr];
        while let Some(&id) = stack.last() {
            if values[id.index()].is_some() {
                stack.pop();
                continue;
            }
            let before = stack.len();
            for operand in self.operands(id) {
                if values[operand.index()].is_none() {
                    stack.push(operand);
                }
            }
            if stack.len() > before {
                continue;
            }
            let at = |operand: &ExprId| values[operand.index()].expect("invariant: operands are evaluated first");
            let value = match self.node(id) {
                Node::Number(value) => rational::to_f64(value),
                Node::Pi => std::f64::consts::PI,
                node @ (Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_)) => leaf(node),
                Node::Sum(terms) => terms.iter().map(at).sum(),
                Node::Product(factors) => factors.iter().map(at).product(),
                Node::Power(base, exponent) => at(base).powi(*exponent),
                Node::Function(function, argument) => function.apply(at(argument)),
                Node::Atan2(y, x) => at(y).atan2(at(x)),
            };
            values[id.index()] = Some(value);
            stack.pop();
        }
        values[expr.index()].expect("invariant: the root is evaluated last")
    }

    /// Whether the expression is 0 for all values of its unknown leaves, as far as sums of known values and factors of
    /// 0 show it.
    #[must_use]
    pub fn vanishes(&self, expr: ExprId, mut leaf: impl FnMut(&Node) -> Option<Rational>) -> bool {
        let nodes = self.up_to(expr);
        let mut needed = vec![false; nodes.len()];
        needed[expr.index()] = true;
        for i in (0..nodes.len()).rev() {
            if needed[i] {
                nodes[i].operands().for_each(|operand| needed[operand.index()] = true);
            }
        }
        let mut values: Vec<Option<Rational>> = vec![None; nodes.len()];
        for i in (0..nodes.len()).filter(|&i| needed[i]) {
            let at = |operand: &ExprId| values[operand.index()].clone();
            values[i] = match &nodes[i] {
                Node::Number(value) => Some(value.clone()),
                Node::Pi | Node::Atan2(..) => None,
                node @ (Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_)) => leaf(node),
                Node::Sum(terms) => terms.iter().map(at).sum::<Option<Rational>>(),
                Node::Product(factors) if factors.iter().filter_map(at).any(|value| value.is_zero()) => {
                    Some(Rational::zero())
                }
                Node::Product(factors) => factors.iter().map(at).product::<Option<Rational>>(),
                Node::Power(base, exponent) => at(base)
                    .filter(|base| *exponent > 0 || !base.is_zero())
                    .map(|base| rational::power(&base, *exponent)),
                Node::Function(function, argument) => at(argument).and_then(|value| function.apply_exact(&value)),
            };
        }
        values[expr.index()].as_ref().is_some_and(Zero::is_zero)
    }

    /// The exact value, given exact leaves; `None` when the expression contains a function without a rational value,
    /// pi, or a division by zero.
    #[must_use]
    pub fn evaluate_exact(&self, expr: ExprId, mut leaf: impl FnMut(&Node) -> Option<Rational>) -> Option<Rational> {
        // Nodes come after their operands, so one pass in order visits operands first.
        let nodes = self.up_to(expr);
        let mut needed = vec![false; nodes.len()];
        needed[expr.index()] = true;
        for i in (0..nodes.len()).rev() {
            if needed[i] {
                nodes[i].operands().for_each(|operand| needed[operand.index()] = true);
            }
        }
        let mut values: Vec<Option<Rational>> = vec![None; nodes.len()];
        for i in 0..nodes.len() {
            if !needed[i] {
                continue;
            }
            let at = |operand: &ExprId| values[operand.index()].clone().expect("invariant: operands come first");
            let value = match &nodes[i] {
                Node::Number(value) => value.clone(),
                Node::Pi | Node::Atan2(..) => return None,
                node @ (Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_)) => leaf(node)?,
                Node::Sum(terms) => terms.iter().map(at).sum(),
                Node::Product(factors) => factors.iter().map(at).product(),
                Node::Power(base, exponent) => {
                    let base = at(base);
                    if base.is_zero() && *exponent < 0 {
                        return None;
                    }
                    rational::power(&base, *exponent)
                }
                Node::Function(function, argument) => function.apply_exact(&at(argument))?,
            };
            values[i] = Some(value);
        }
        values[expr.index()].take()
    }
}
