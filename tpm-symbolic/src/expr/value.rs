//! Values of expressions, in double precision or exact.

use crate::expr::graph::{ExprId, Graph, Node};
use crate::number::rational::{self, Rational};
use num_traits::Zero;

impl Graph {
    /// The value in double precision, given the leaves.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let x = g.symbol(Symbol(0));
    /// let square = g.pow(x, 2);
    /// assert_eq!(g.evaluate(square, |_| 3.0), 9.0);
    /// ```
    #[must_use]
    pub fn evaluate(&self, expr: ExprId, mut leaf: impl FnMut(&Node) -> f64) -> f64 {
        let mut values = vec![0.0; expr.index() + 1];
        for id in self.used_by(&[expr], |_| false) {
            let at = |operand: &ExprId| values[operand.index()];
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
            values[id.index()] = value;
        }
        values[expr.index()]
    }

    /// Whether the expression is 0 for all values of its unknown leaves, as far as sums of known values and factors of
    /// 0 show it.
    #[must_use]
    pub fn vanishes(&self, expr: ExprId, mut leaf: impl FnMut(&Node) -> Option<Rational>) -> bool {
        let mut values: Vec<Option<Rational>> = vec![None; expr.index() + 1];
        for id in self.used_by(&[expr], |_| false) {
            let at = |operand: &ExprId| values[operand.index()].clone();
            values[id.index()] = match self.node(id) {
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
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let x = g.symbol(Symbol(0));
    /// let inverse = g.pow(x, -1);
    /// assert_eq!(g.evaluate_exact(inverse, |_| Some(integer(3))), Some(ratio(1, 3)));
    /// assert_eq!(g.evaluate_exact(inverse, |_| Some(integer(0))), None);
    /// ```
    #[must_use]
    pub fn evaluate_exact(&self, expr: ExprId, mut leaf: impl FnMut(&Node) -> Option<Rational>) -> Option<Rational> {
        let mut values: Vec<Option<Rational>> = vec![None; expr.index() + 1];
        for id in self.used_by(&[expr], |_| false) {
            let at = |operand: &ExprId| values[operand.index()].clone().expect("invariant: operands come first");
            let value = match self.node(id) {
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
            values[id.index()] = Some(value);
        }
        values[expr.index()].take()
    }
}
