//! Expressions as a hash-consed graph.
//!
//! Invariants of [`Graph`]: equal nodes have equal ids; operands come before the nodes that use them; a sum or product
//! is flat, has at least two operands, at most one number (first), no repeated operand of a sum (like terms are
//! collected) and no repeated base of a product (powers are collected). Numbers are exact.
//!
//! Only [`Graph::sum_of_wholes`] and [`Graph::product_of_wholes`] build sums of sums and products of products, for recursions whose
//! intermediate values are to be computed once: a flat sum would repeat the additions of every sum that goes into it.
//!
//! The graph is an arena of plain data, so that it is `Send + Sync` and can be serialised.

use crate::budget;
use crate::number::rational::{self, Rational};
use num_traits::{One, Signed, Zero};
use rustc_hash::FxHashSet;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};

pub use crate::expr::node::{Coordinate, ExprId, Function, Names, Node, Symbol};

/// Operations per new node, for the budget.
const NODE: u64 = 100;

/// The arena.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    nodes: Vec<Node>,
    index: HashMap<Node, ExprId>,
}

impl Serialize for Graph {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.nodes.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Graph {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let nodes = Vec::<Node>::deserialize(deserializer)?;
        let mut index = HashMap::with_capacity(nodes.len());
        for (i, node) in nodes.iter().enumerate() {
            if node.operands().any(|operand| operand.index() >= i) {
                return Err(serde::de::Error::custom(format!("node {i} uses a node that does not come before it")));
            }
            let id = ExprId(u32::try_from(i).map_err(serde::de::Error::custom)?);
            if index.insert(node.clone(), id).is_some() {
                return Err(serde::de::Error::custom(format!("node {i} repeats an earlier node")));
            }
        }
        Ok(Self { nodes, index })
    }
}

impl Graph {
    /// An empty graph.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The node of an id.
    #[must_use]
    pub fn node(&self, id: ExprId) -> &Node {
        &self.nodes[id.index()]
    }

    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// All nodes, operands before the nodes that use them.
    pub(crate) fn ids(&self) -> impl Iterator<Item = ExprId> + use<> {
        self.ids_from(0)
    }

    /// All nodes behind the first `start`, which are not passed one by one.
    pub(crate) fn ids_from(&self, start: usize) -> impl Iterator<Item = ExprId> + use<> {
        let word = |count: usize| u32::try_from(count).expect("invariant: fewer than 2^32 nodes fit in memory");
        (word(start)..word(self.len())).map(ExprId)
    }

    /// Whether the graph has no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The operands of a node.
    pub fn operands(&self, id: ExprId) -> impl Iterator<Item = ExprId> + '_ {
        self.node(id).operands()
    }

    /// The nodes that expressions use, operands first, but for those that are known and what only they use.
    #[must_use]
    pub fn used_by(&self, exprs: &[ExprId], is_known: impl Fn(ExprId) -> bool) -> Vec<ExprId> {
        let mut seen = vec![false; exprs.iter().map(|expr| expr.index() + 1).max().unwrap_or(0)];
        let mut stack = exprs.to_vec();
        let mut found = Vec::new();
        while let Some(id) = stack.pop() {
            if !is_known(id) && !std::mem::replace(&mut seen[id.index()], true) {
                found.push(id);
                stack.extend(self.operands(id));
            }
        }
        // A node is added behind its operands.
        found.sort_unstable();
        found
    }

    fn intern(&mut self, node: Node) -> ExprId {
        if let Some(&id) = self.index.get(&node) {
            return id;
        }
        budget::charge(NODE + node.operands().count() as u64);
        let id = ExprId(u32::try_from(self.nodes.len()).expect("invariant: fewer than 2^32 nodes fit in memory"));
        self.nodes.push(node.clone());
        self.index.insert(node, id);
        id
    }

    /// Removes all nodes after the first `len`. Their ids are reused for other nodes.
    pub fn truncate(&mut self, len: usize) {
        for node in self.nodes.drain(len.min(self.nodes.len())..) {
            self.index.remove(&node);
        }
    }

    /// An exact number.
    pub fn number(&mut self, value: Rational) -> ExprId {
        self.intern(Node::Number(value))
    }

    /// A whole number.
    pub fn integer(&mut self, value: i64) -> ExprId {
        self.number(rational::integer(value))
    }

    /// The circle constant.
    pub fn pi(&mut self) -> ExprId {
        self.intern(Node::Pi)
    }

    /// A named quantity.
    pub fn symbol(&mut self, symbol: Symbol) -> ExprId {
        self.intern(Node::Symbol(symbol))
    }

    /// The n-th time derivative of a coordinate.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let velocity = g.derivative_of(Coordinate(0), 1);
    /// assert_eq!(g.node(velocity), &Node::Derivative(Coordinate(0), 1));
    /// ```
    pub fn derivative_of(&mut self, coordinate: Coordinate, order: u32) -> ExprId {
        self.intern(Node::Derivative(coordinate, order))
    }

    /// A leaf that stands for entry `index` of a list that the caller keeps.
    pub fn placeholder(&mut self, index: u32) -> ExprId {
        self.intern(Node::Placeholder(index))
    }

    /// The value when the expression is a number.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let two = g.integer(2);
    /// let half = g.pow(two, -1);
    /// assert_eq!(g.as_number(half), Some(&ratio(1, 2)));
    /// ```
    #[must_use]
    pub fn as_number(&self, id: ExprId) -> Option<&Rational> {
        match self.node(id) {
            Node::Number(value) => Some(value),
            _ => None,
        }
    }

    /// The coefficient and the rest of a term: 3*x*y is (3, x*y).
    fn split_coefficient(&mut self, id: ExprId) -> (Rational, Option<ExprId>) {
        match self.node(id).clone() {
            Node::Number(value) => (value, None),
            Node::Product(factors) => match self.as_number(factors[0]).cloned() {
                Some(value) => {
                    let rest =
                        if factors.len() == 2 { factors[1] } else { self.intern(Node::Product(factors[1..].to_vec())) };
                    (value, Some(rest))
                }
                None => (Rational::one(), Some(id)),
            },
            _ => (Rational::one(), Some(id)),
        }
    }

    /// The sum of any number of terms.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let x = g.symbol(Symbol(0));
    /// let twice = g.scale(x, integer(2));
    /// assert_eq!(g.sum(&[x, x]), twice);
    /// ```
    pub fn sum(&mut self, terms: &[ExprId]) -> ExprId {
        let mut constant = Rational::zero();
        let mut collected: BTreeMap<ExprId, Rational> = BTreeMap::new();
        let mut pending: Vec<ExprId> = terms.iter().rev().copied().collect();
        while let Some(term) = pending.pop() {
            if let Node::Sum(inner) = self.node(term) {
                pending.extend(inner.iter().rev().copied());
                continue;
            }
            match self.split_coefficient(term) {
                (value, None) => constant += value,
                (value, Some(rest)) => *collected.entry(rest).or_insert_with(Rational::zero) += value,
            }
        }
        self.sum_of_collected(constant, collected)
    }

    /// The sum of a number and of terms with their coefficients.
    fn sum_of_collected(&mut self, constant: Rational, collected: BTreeMap<ExprId, Rational>) -> ExprId {
        let mut operands = Vec::with_capacity(collected.len() + 1);
        if !constant.is_zero() {
            operands.push(self.number(constant));
        }
        for (rest, coefficient) in collected {
            if coefficient.is_one() {
                operands.push(rest);
            } else if !coefficient.is_zero() {
                operands.push(self.with_coefficient(coefficient, rest));
            }
        }
        match operands.len() {
            0 => self.number(Rational::zero()),
            1 => operands[0],
            _ => self.intern(Node::Sum(operands)),
        }
    }

    fn with_coefficient(&mut self, coefficient: Rational, rest: ExprId) -> ExprId {
        let coefficient = self.number(coefficient);
        let factors = match self.node(rest) {
            Node::Product(factors) => std::iter::once(coefficient).chain(factors.iter().copied()).collect(),
            _ => vec![coefficient, rest],
        };
        self.intern(Node::Product(factors))
    }

    /// `a + b`.
    pub fn add(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.sum(&[a, b])
    }

    /// `-a`.
    pub fn neg(&mut self, a: ExprId) -> ExprId {
        let minus_one = self.integer(-1);
        self.mul(minus_one, a)
    }

    /// `a - b`.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let x = g.symbol(Symbol(0));
    /// assert_eq!(g.sub(x, x), g.integer(0));
    /// ```
    pub fn sub(&mut self, a: ExprId, b: ExprId) -> ExprId {
        let b = self.neg(b);
        self.add(a, b)
    }

    /// The product of any number of factors.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let x = g.symbol(Symbol(0));
    /// let inverse = g.pow(x, -1);
    /// assert_eq!(g.product(&[x, x, inverse]), x);
    /// ```
    pub fn product(&mut self, factors: &[ExprId]) -> ExprId {
        let mut coefficient = Rational::one();
        let mut collected: BTreeMap<ExprId, i32> = BTreeMap::new();
        let mut pending: Vec<ExprId> = factors.iter().rev().copied().collect();
        while let Some(factor) = pending.pop() {
            match self.node(factor) {
                Node::Number(value) => coefficient *= value,
                Node::Product(inner) => pending.extend(inner.iter().rev().copied()),
                Node::Power(base, exponent) => *collected.entry(*base).or_insert(0) += exponent,
                _ => *collected.entry(factor).or_insert(0) += 1,
            }
        }
        self.product_of_collected(coefficient, collected)
    }

    /// The product of a number and of bases with their exponents.
    fn product_of_collected(&mut self, coefficient: Rational, collected: BTreeMap<ExprId, i32>) -> ExprId {
        if coefficient.is_zero() {
            return self.number(coefficient);
        }
        let mut operands: Vec<ExprId> = Vec::with_capacity(collected.len() + 1);
        for (base, exponent) in collected {
            match exponent {
                0 => {}
                1 => operands.push(base),
                _ => operands.push(self.intern(Node::Power(base, exponent))),
            }
        }
        operands.sort_unstable();
        match (operands.len(), coefficient.is_one()) {
            (0, _) => self.number(coefficient),
            (1, true) => operands[0],
            (1, false) => self.with_coefficient(coefficient, operands[0]),
            (_, true) => self.intern(Node::Product(operands)),
            (_, false) => {
                let number = self.number(coefficient);
                operands.insert(0, number);
                self.intern(Node::Product(operands))
            }
        }
    }

    /// The sum of terms, in which terms that are sums themselves are not flattened. Like terms are collected, as in
    /// [`Graph::sum`]. A sum of negative terms alone becomes minus the sum of positive ones, so that its users subtract
    /// instead of negating.
    pub fn sum_of_wholes(&mut self, terms: &[ExprId]) -> ExprId {
        let mut constant = Rational::zero();
        let mut collected: BTreeMap<ExprId, Rational> = BTreeMap::new();
        for &term in terms {
            match self.split_coefficient(term) {
                (value, None) => constant += value,
                (value, Some(rest)) => *collected.entry(rest).or_insert_with(Rational::zero) += value,
            }
        }
        collected.retain(|_, coefficient| !coefficient.is_zero());
        let all_negative = !constant.is_positive() && collected.values().all(Signed::is_negative);
        if !all_negative || collected.len() + usize::from(!constant.is_zero()) < 2 {
            return self.sum_of_collected(constant, collected);
        }
        collected.values_mut().for_each(|coefficient| *coefficient = -&*coefficient);
        let positive = self.sum_of_collected(-constant, collected);
        self.with_coefficient(-Rational::one(), positive)
    }

    /// The product of factors, in which factors that are products themselves are not flattened, except for their
    /// coefficient. Numbers and powers are collected, as in [`Graph::product`].
    pub fn product_of_wholes(&mut self, factors: &[ExprId]) -> ExprId {
        let mut coefficient = Rational::one();
        let mut collected: BTreeMap<ExprId, i32> = BTreeMap::new();
        for &factor in factors {
            let (value, rest) = self.split_coefficient(factor);
            coefficient *= &value;
            let Some(rest) = rest else { continue };
            let (base, exponent) = match self.node(rest) {
                Node::Power(base, exponent) => (*base, *exponent),
                _ => (rest, 1),
            };
            *collected.entry(base).or_insert(0) += exponent;
        }
        self.product_of_collected(coefficient, collected)
    }

    /// `a * b`.
    pub fn mul(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.product(&[a, b])
    }

    /// `a * value`.
    pub fn scale(&mut self, a: ExprId, value: Rational) -> ExprId {
        let value = self.number(value);
        self.mul(value, a)
    }

    /// `base ^ exponent`; a zero base with a negative exponent stays a power node and evaluates to an infinity.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let x = g.symbol(Symbol(0));
    /// let square = g.pow(x, 2);
    /// assert_eq!(g.pow(square, 3), g.pow(x, 6));
    /// ```
    pub fn pow(&mut self, base: ExprId, exponent: i32) -> ExprId {
        if exponent == 0 {
            return self.number(Rational::one());
        }
        if exponent == 1 {
            return base;
        }
        match self.node(base).clone() {
            Node::Number(value) if !(value.is_zero() && exponent < 0) => {
                let value = rational::power(&value, exponent);
                self.number(value)
            }
            Node::Power(inner, inner_exponent) => match inner_exponent.checked_mul(exponent) {
                Some(product) => self.pow(inner, product),
                None => self.intern(Node::Power(base, exponent)),
            },
            Node::Product(factors) => {
                let powers: Vec<ExprId> = factors.into_iter().map(|factor| self.pow(factor, exponent)).collect();
                self.product(&powers)
            }
            Node::Function(Function::Sqrt, argument) if exponent % 2 == 0 => self.pow(argument, exponent / 2),
            Node::Function(Function::Abs, argument) if exponent % 2 == 0 => self.pow(argument, exponent),
            _ => self.intern(Node::Power(base, exponent)),
        }
    }

    /// `a / b`.
    pub fn div(&mut self, a: ExprId, b: ExprId) -> ExprId {
        let inverse = self.pow(b, -1);
        self.mul(a, inverse)
    }

    /// `function(argument)`, with exact values at 0 (of the logarithm at 1) and exact square roots taken.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let zero = g.integer(0);
    /// assert_eq!(g.function(Function::Cos, zero), g.integer(1));
    /// ```
    pub fn function(&mut self, function: Function, argument: ExprId) -> ExprId {
        if let Some(exact) = self.as_number(argument).and_then(|value| function.apply_exact(value)) {
            return self.number(exact);
        }
        // sin, tan, asin, atan, tanh and sign are odd, cos and abs even: one form for an argument and its negative.
        if let (coefficient, Some(_)) = self.split_coefficient(argument)
            && coefficient.is_negative()
        {
            match function {
                Function::Sin | Function::Tan | Function::Asin | Function::Atan | Function::Tanh | Function::Sign => {
                    let negated = self.neg(argument);
                    let value = self.function(function, negated);
                    return self.neg(value);
                }
                Function::Cos | Function::Abs => {
                    let negated = self.neg(argument);
                    return self.function(function, negated);
                }
                Function::Acos | Function::Sqrt | Function::Exp | Function::Log => {}
            }
        }
        self.intern(Node::Function(function, argument))
    }

    /// `atan2(y, x)`, the angle of the point (x, y).
    pub fn atan2(&mut self, y: ExprId, x: ExprId) -> ExprId {
        self.intern(Node::Atan2(y, x))
    }

    /// All leaves (symbols, derivatives of coordinates, placeholders) that `expr` depends on, in increasing order.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let [x, y] = [0, 1].map(|index| g.symbol(Symbol(index)));
    /// let product = g.mul(y, x);
    /// assert_eq!(g.leaves(product), [x, y]);
    /// ```
    #[must_use]
    pub fn leaves(&self, expr: ExprId) -> Vec<ExprId> {
        self.leaves_of([expr])
    }

    /// All leaves (symbols, derivatives of coordinates, placeholders) that any of several expressions depends on, in increasing order.
    #[must_use]
    pub fn leaves_of(&self, exprs: impl IntoIterator<Item = ExprId>) -> Vec<ExprId> {
        // Few of all expressions are looked at, so that the work is theirs and not that of the whole graph.
        let mut stack: Vec<ExprId> = exprs.into_iter().collect();
        let mut seen = FxHashSet::default();
        let mut leaves = Vec::new();
        while let Some(id) = stack.pop() {
            if seen.insert(id) {
                stack.extend(self.operands(id));
                if matches!(self.node(id), Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_)) {
                    leaves.push(id);
                }
            }
        }
        leaves.sort_unstable();
        leaves
    }
}
