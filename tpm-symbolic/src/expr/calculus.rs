//! Derivatives of expressions, and substitution.
//!
//! Every pass is in post-order over an explicit stack: an expression may be deeper than the call stack allows.

use crate::budget;
use crate::expr::graph::{ExprId, Function, Graph, Node};
use crate::number::rational;
use num_traits::Zero;
use std::collections::HashMap;

/// Operations for an expression that a pass looks at, and for each of its operands, for the budget.
const VISITED: u64 = 20;

impl Graph {
    /// The partial derivative of `expr` with respect to the leaf `variable` (a symbol or a derivative of a
    /// coordinate), every other leaf held fixed. `sign` is taken as constant and `abs` as having slope `sign`:
    /// right everywhere but at the kink itself.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let x = g.symbol(Symbol(0));
    /// let sine = g.function(Function::Sin, x);
    /// assert_eq!(g.differentiate(sine, x), g.function(Function::Cos, x));
    /// ```
    pub fn differentiate(&mut self, expr: ExprId, variable: ExprId) -> ExprId {
        self.differentiate_beside(expr, variable, &mut HashMap::new())
    }

    /// [`Self::differentiate`] with a memo: `known` holds derivatives of subexpressions by the same variable, and the
    /// new ones are added to it.
    pub(crate) fn differentiate_beside(
        &mut self,
        expr: ExprId,
        variable: ExprId,
        known: &mut HashMap<ExprId, ExprId>,
    ) -> ExprId {
        self.differentiate_with(
            expr,
            &mut |graph, leaf| {
                if leaf == variable { graph.integer(1) } else { graph.integer(0) }
            },
            known,
        )
    }

    /// The total time derivative: every coordinate's n-th derivative becomes its (n+1)-th, symbols are constant.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let [q, velocity] = [0, 1].map(|order| g.derivative_of(Coordinate(0), order));
    /// assert_eq!(g.time_derivative(q), velocity);
    /// ```
    pub fn time_derivative(&mut self, expr: ExprId) -> ExprId {
        let mut memo = HashMap::new();
        self.differentiate_with(
            expr,
            &mut |graph, leaf| match *graph.node(leaf) {
                Node::Derivative(coordinate, order) => graph.derivative_of(coordinate, order + 1),
                _ => graph.integer(0),
            },
            &mut memo,
        )
    }

    fn differentiate_with(
        &mut self,
        expr: ExprId,
        leaf: &mut impl FnMut(&mut Self, ExprId) -> ExprId,
        memo: &mut HashMap<ExprId, ExprId>,
    ) -> ExprId {
        let mut stack = vec![expr];
        while let Some(&id) = stack.last() {
            if memo.contains_key(&id) {
                stack.pop();
                continue;
            }
            let missing: Vec<ExprId> = self.operands(id).filter(|operand| !memo.contains_key(operand)).collect();
            if !missing.is_empty() {
                stack.extend(missing);
                continue;
            }
            stack.pop();
            budget::charge(VISITED * (1 + self.operands(id).count() as u64));
            let slope = match self.node(id).clone() {
                Node::Number(_) | Node::Pi => self.integer(0),
                Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_) => leaf(self, id),
                Node::Sum(terms) => {
                    let slopes: Vec<ExprId> = terms.iter().map(|term| memo[term]).collect();
                    self.sum(&slopes)
                }
                Node::Product(factors) => {
                    let mut terms = Vec::new();
                    for (i, factor) in factors.iter().enumerate() {
                        let slope = memo[factor];
                        if self.as_number(slope).is_some_and(Zero::is_zero) {
                            continue;
                        }
                        let mut product = factors.clone();
                        product[i] = slope;
                        terms.push(self.product(&product));
                    }
                    self.sum(&terms)
                }
                Node::Power(base, exponent) => {
                    let lowered = self.pow(base, exponent - 1);
                    let factor = self.integer(i64::from(exponent));
                    self.product(&[factor, lowered, memo[&base]])
                }
                Node::Function(function, argument) => {
                    let slope = memo[&argument];
                    if self.as_number(slope).is_some_and(Zero::is_zero) {
                        slope
                    } else {
                        let outer = self.function_slope(function, argument);
                        self.mul(outer, slope)
                    }
                }
                Node::Atan2(y, x) => {
                    let (dy, dx) = (memo[&y], memo[&x]);
                    let (x_dy, y_dx) = (self.mul(x, dy), self.mul(y, dx));
                    let numerator = self.sub(x_dy, y_dx);
                    let (x2, y2) = (self.pow(x, 2), self.pow(y, 2));
                    let denominator = self.add(x2, y2);
                    self.div(numerator, denominator)
                }
            };
            memo.insert(id, slope);
        }
        memo[&expr]
    }

    /// The derivative of a function at its argument.
    fn function_slope(&mut self, function: Function, argument: ExprId) -> ExprId {
        match function {
            Function::Sin => self.function(Function::Cos, argument),
            Function::Cos => {
                let sine = self.function(Function::Sin, argument);
                self.neg(sine)
            }
            Function::Tan => {
                let tangent = self.function(Function::Tan, argument);
                let square = self.pow(tangent, 2);
                let one = self.integer(1);
                self.add(one, square)
            }
            Function::Asin | Function::Acos => {
                let square = self.pow(argument, 2);
                let one = self.integer(1);
                let difference = self.sub(one, square);
                let root = self.function(Function::Sqrt, difference);
                let slope = self.pow(root, -1);
                if function == Function::Acos { self.neg(slope) } else { slope }
            }
            Function::Atan => {
                let square = self.pow(argument, 2);
                let one = self.integer(1);
                let sum = self.add(one, square);
                self.pow(sum, -1)
            }
            Function::Sqrt => {
                let root = self.function(Function::Sqrt, argument);
                let inverse = self.pow(root, -1);
                self.scale(inverse, rational::ratio(1, 2))
            }
            Function::Tanh => {
                let tangent = self.function(Function::Tanh, argument);
                let square = self.pow(tangent, 2);
                let one = self.integer(1);
                self.sub(one, square)
            }
            Function::Exp => self.function(Function::Exp, argument),
            Function::Log => self.pow(argument, -1),
            Function::Abs => self.function(Function::Sign, argument),
            Function::Sign => self.integer(0),
        }
    }

    /// Replaces leaves (or any other nodes) by expressions.
    pub fn substitute(&mut self, expr: ExprId, replacement: &HashMap<ExprId, ExprId>) -> ExprId {
        self.substitute_beside(expr, &mut replacement.clone())
    }

    /// [`Self::substitute`] with a memo: `memo` initially holds the replacements, and the result of every subexpression
    /// is added to it.
    pub(crate) fn substitute_beside(&mut self, expr: ExprId, memo: &mut HashMap<ExprId, ExprId>) -> ExprId {
        let mut stack = vec![expr];
        while let Some(&id) = stack.last() {
            if memo.contains_key(&id) {
                stack.pop();
                continue;
            }
            let missing: Vec<ExprId> = self.operands(id).filter(|operand| !memo.contains_key(operand)).collect();
            if !missing.is_empty() {
                stack.extend(missing);
                continue;
            }
            stack.pop();
            budget::charge(VISITED * (1 + self.operands(id).count() as u64));
            let rebuilt = match self.node(id).clone() {
                Node::Number(_) | Node::Pi | Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_) => id,
                // Sums of sums and products of products keep their structure.
                Node::Sum(terms) => {
                    let whole = terms.iter().any(|&term| matches!(self.node(term), Node::Sum(_)));
                    let found: Vec<ExprId> = terms.iter().map(|term| memo[term]).collect();
                    match (whole, found == terms) {
                        (true, true) => id,
                        (true, false) => self.sum_of_wholes(&found),
                        (false, _) => self.sum(&found),
                    }
                }
                Node::Product(factors) => {
                    let whole = factors.iter().any(|&factor| matches!(self.node(factor), Node::Product(_)));
                    let found: Vec<ExprId> = factors.iter().map(|factor| memo[factor]).collect();
                    match (whole, found == factors) {
                        (true, true) => id,
                        (true, false) => self.product_of_wholes(&found),
                        (false, _) => self.product(&found),
                    }
                }
                Node::Power(base, exponent) => self.pow(memo[&base], exponent),
                Node::Function(function, argument) => self.function(function, memo[&argument]),
                Node::Atan2(y, x) => self.atan2(memo[&y], memo[&x]),
            };
            memo.insert(id, rebuilt);
        }
        memo[&expr]
    }
}
