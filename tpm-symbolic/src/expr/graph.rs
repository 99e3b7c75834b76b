//! Expressions as a hash-consed graph.
//!
//! Invariants of [`Graph`]: equal nodes have equal ids; operands come before the nodes that use them; a sum or product
//! is flat, has at least two operands, at most one number (first), no repeated operand of a sum (like terms are
//! collected) and no repeated base of a product (powers are collected). Numbers are exact.
//!
//! The graph is an arena of plain data, so that it is `Send + Sync` and can be serialised.

use crate::algebra::monomial::{Factorisation, Monomial};
use crate::algebra::polynomial::{Polynomial, Terms};
use crate::number::rational::{self, Rational};
use num_traits::{One, Signed, Zero};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};
use smallvec::{SmallVec, smallvec};
use std::collections::{BTreeMap, HashMap};

/// Index of a node in its [`Graph`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ExprId(u32);

impl ExprId {
    /// The position in the arena.
    #[must_use]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// Index of a named quantity (parameter, constant, input, amplitude, frequency) in a model's symbol table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Symbol(pub u32);

/// Index of a coordinate of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Coordinate(pub u32);

/// Functions of one argument.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Function {
    /// Sine.
    Sin,
    /// Cosine.
    Cos,
    /// Tangent.
    Tan,
    /// Inverse sine, principal value.
    Asin,
    /// Inverse cosine, principal value.
    Acos,
    /// Inverse tangent, principal value.
    Atan,
    /// Non-negative square root.
    Sqrt,
    /// Absolute value.
    Abs,
    /// Sign: -1, 0 or 1.
    Sign,
}

impl Function {
    /// The name in the model language.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sin => "sin",
            Self::Cos => "cos",
            Self::Tan => "tan",
            Self::Asin => "asin",
            Self::Acos => "acos",
            Self::Atan => "atan",
            Self::Sqrt => "sqrt",
            Self::Abs => "abs",
            Self::Sign => "sign",
        }
    }

    /// The exact value, where it is known to be rational.
    #[must_use]
    pub fn apply_exact(self, x: &Rational) -> Option<Rational> {
        match self {
            Self::Sin | Self::Tan | Self::Asin | Self::Atan if x.is_zero() => Some(x.clone()),
            Self::Cos if x.is_zero() => Some(Rational::one()),
            Self::Abs => Some(x.abs()),
            Self::Sign => Some(x.signum()),
            Self::Sqrt => exact_square_root(x),
            _ => None,
        }
    }

    /// The value in double precision.
    #[must_use]
    pub fn apply(self, x: f64) -> f64 {
        match self {
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tan => x.tan(),
            Self::Asin => x.asin(),
            Self::Acos => x.acos(),
            Self::Atan => x.atan(),
            Self::Sqrt => x.sqrt(),
            Self::Abs => x.abs(),
            Self::Sign => {
                if x > 0.0 {
                    1.0
                } else if x < 0.0 {
                    -1.0
                } else {
                    0.0
                }
            }
        }
    }
}

/// A node of the graph. Built only through [`Graph`], which keeps the canonical form.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Node {
    /// An exact number.
    Number(Rational),
    /// The circle constant.
    Pi,
    /// A named quantity that does not depend on time, or an input.
    Symbol(Symbol),
    /// The n-th time derivative of a coordinate (0: the coordinate itself).
    Derivative(Coordinate, u32),
    /// A leaf that is no quantity of a model: an entry of a list that whoever builds the expression keeps, by index.
    Placeholder(u32),
    /// A sum.
    Sum(Vec<ExprId>),
    /// A product.
    Product(Vec<ExprId>),
    /// An integer power, not 0 or 1.
    Power(ExprId, i32),
    /// A function of one argument.
    Function(Function, ExprId),
    /// The angle of the point (second, first): `atan2(y, x)`.
    Atan2(ExprId, ExprId),
}

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
            if operands(node).any(|operand| operand.index() >= i) {
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

fn operands(node: &Node) -> impl Iterator<Item = ExprId> + '_ {
    let (list, pair): (&[ExprId], [Option<ExprId>; 2]) = match node {
        Node::Number(_) | Node::Pi | Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_) => {
            (&[], [None, None])
        }
        Node::Sum(list) | Node::Product(list) => (list, [None, None]),
        Node::Power(a, _) | Node::Function(_, a) => (&[], [Some(*a), None]),
        Node::Atan2(a, b) => (&[], [Some(*a), Some(*b)]),
    };
    list.iter().copied().chain(pair.into_iter().flatten())
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

    /// All nodes, operands before what is built of them.
    pub(crate) fn ids(&self) -> impl Iterator<Item = ExprId> + use<> {
        let count = u32::try_from(self.len()).expect("invariant: fewer than 2^32 nodes fit in memory");
        (0..count).map(ExprId)
    }

    /// Whether the graph has no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The operands of a node.
    pub fn operands(&self, id: ExprId) -> impl Iterator<Item = ExprId> + '_ {
        operands(self.node(id))
    }

    fn intern(&mut self, node: Node) -> ExprId {
        if let Some(&id) = self.index.get(&node) {
            return id;
        }
        let id = ExprId(u32::try_from(self.nodes.len()).expect("invariant: fewer than 2^32 nodes fit in memory"));
        self.nodes.push(node.clone());
        self.index.insert(node, id);
        id
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
    pub fn derivative_of(&mut self, coordinate: Coordinate, order: u32) -> ExprId {
        self.intern(Node::Derivative(coordinate, order))
    }

    /// A leaf that stands for entry `index` of a list that the caller keeps.
    pub fn placeholder(&mut self, index: u32) -> ExprId {
        self.intern(Node::Placeholder(index))
    }

    /// The value when the expression is a number.
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
    pub fn sub(&mut self, a: ExprId, b: ExprId) -> ExprId {
        let b = self.neg(b);
        self.add(a, b)
    }

    /// The product of any number of factors.
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
            (1, false) => {
                let number = self.number(coefficient);
                self.intern(Node::Product(vec![number, operands[0]]))
            }
            (_, true) => self.intern(Node::Product(operands)),
            (_, false) => {
                let number = self.number(coefficient);
                operands.insert(0, number);
                self.intern(Node::Product(operands))
            }
        }
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

    /// `function(argument)`, with exact values at 0 and exact square roots taken.
    pub fn function(&mut self, function: Function, argument: ExprId) -> ExprId {
        if let Some(exact) = self.as_number(argument).and_then(|value| function.apply_exact(value)) {
            return self.number(exact);
        }
        // sin, tan, asin, atan and sign are odd, cos and abs even: one form for an argument and its negative.
        if let (coefficient, Some(_)) = self.split_coefficient(argument)
            && coefficient.is_negative()
        {
            match function {
                Function::Sin | Function::Tan | Function::Asin | Function::Atan | Function::Sign => {
                    let negated = self.neg(argument);
                    let value = self.function(function, negated);
                    return self.neg(value);
                }
                Function::Cos | Function::Abs => {
                    let negated = self.neg(argument);
                    return self.function(function, negated);
                }
                Function::Acos | Function::Sqrt => {}
            }
        }
        self.intern(Node::Function(function, argument))
    }

    /// `atan2(y, x)`, the angle of the point (x, y).
    pub fn atan2(&mut self, y: ExprId, x: ExprId) -> ExprId {
        self.intern(Node::Atan2(y, x))
    }

    /// The partial derivative of `expr` with respect to the leaf `variable` (a symbol or a derivative of a
    /// coordinate), every other leaf held fixed. `sign` is taken as constant and `abs` as having slope `sign`:
    /// right everywhere but at the kink itself.
    pub fn differentiate(&mut self, expr: ExprId, variable: ExprId) -> ExprId {
        let mut memo = HashMap::new();
        self.differentiate_with(
            expr,
            &mut |graph, leaf| {
                if leaf == variable { graph.integer(1) } else { graph.integer(0) }
            },
            &mut memo,
        )
    }

    /// The total time derivative: every coordinate's n-th derivative becomes its (n+1)-th, symbols are constant.
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
        // Post-order over an explicit stack: an expression may be deeper than the call stack allows.
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
            Function::Abs => self.function(Function::Sign, argument),
            Function::Sign => self.integer(0),
        }
    }

    /// Replaces leaves (or any other nodes) by expressions.
    pub fn substitute(&mut self, expr: ExprId, replacement: &HashMap<ExprId, ExprId>) -> ExprId {
        let mut memo = replacement.clone();
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
            let rebuilt = match self.node(id).clone() {
                Node::Number(_) | Node::Pi | Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_) => id,
                Node::Sum(terms) => {
                    let terms: Vec<ExprId> = terms.iter().map(|term| memo[term]).collect();
                    self.sum(&terms)
                }
                Node::Product(factors) => {
                    let factors: Vec<ExprId> = factors.iter().map(|factor| memo[factor]).collect();
                    self.product(&factors)
                }
                Node::Power(base, exponent) => self.pow(memo[&base], exponent),
                Node::Function(function, argument) => self.function(function, memo[&argument]),
                Node::Atan2(y, x) => self.atan2(memo[&y], memo[&x]),
            };
            memo.insert(id, rebuilt);
        }
        memo[&expr]
    }

    /// All leaves (symbols, derivatives of coordinates, placeholders) that `expr` depends on, in increasing order.
    #[must_use]
    pub fn leaves(&self, expr: ExprId) -> Vec<ExprId> {
        let mut seen = vec![false; expr.index() + 1];
        let mut stack = vec![expr];
        while let Some(id) = stack.pop() {
            if !std::mem::replace(&mut seen[id.index()], true) {
                stack.extend(self.operands(id));
            }
        }
        (0..=expr.0)
            .map(ExprId)
            .filter(|id| {
                seen[id.index()]
                    && matches!(self.node(*id), Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_))
            })
            .collect()
    }

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

    /// The exact value, given exact leaves; `None` when a function without a rational value, pi, or a division by zero
    /// stands in the way.
    #[must_use]
    pub fn evaluate_exact(&self, expr: ExprId, mut leaf: impl FnMut(&Node) -> Option<Rational>) -> Option<Rational> {
        // Nodes come after their operands, so one pass in order visits operands first.
        let mut needed = vec![false; expr.index() + 1];
        needed[expr.index()] = true;
        for i in (0..=expr.index()).rev() {
            if needed[i] {
                operands(&self.nodes[i]).for_each(|operand| needed[operand.index()] = true);
            }
        }
        let mut values: Vec<Option<Rational>> = vec![None; expr.index() + 1];
        for i in 0..=expr.index() {
            if !needed[i] {
                continue;
            }
            let at = |operand: &ExprId| values[operand.index()].clone().expect("invariant: operands come first");
            let value = match &self.nodes[i] {
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

    /// The expression as a Laurent polynomial over its atoms: symbols, derivatives of coordinates, pi, functions, and
    /// powers with negative exponent of sums. Sums under a positive power are multiplied out.
    #[must_use]
    pub fn polynomial(&self, expr: ExprId) -> Polynomial<ExprId> {
        self.polynomial_beside(expr, &mut FxHashMap::default())
    }

    /// Several expressions as polynomials, each part that they share multiplied out once.
    #[must_use]
    pub fn polynomials(&self, exprs: impl IntoIterator<Item = ExprId>) -> Vec<Polynomial<ExprId>> {
        let mut memo = FxHashMap::default();
        exprs.into_iter().map(|expr| self.polynomial_beside(expr, &mut memo)).collect()
    }

    fn polynomial_beside(&self, expr: ExprId, memo: &mut FxHashMap<ExprId, Polynomial<ExprId>>) -> Polynomial<ExprId> {
        if let Some((monomial, coefficient)) = self.single_term(expr) {
            return Polynomial::term(monomial, coefficient);
        }
        if let Some(known) = memo.get(&expr) {
            return known.clone();
        }
        let mut stack: SmallVec<[ExprId; 8]> = smallvec![expr];
        while let Some(&id) = stack.last() {
            // Another node that needs it may have come first.
            if memo.contains_key(&id) {
                stack.pop();
                continue;
            }
            match self.polynomial_of(id, memo, &mut stack) {
                // Terms of a model share their parts, hardly ever the whole.
                Some(value) if id == expr => return value,
                Some(value) => {
                    stack.pop();
                    memo.insert(id, value);
                }
                None => {}
            }
        }
        unreachable!("invariant: the root is converted last")
    }

    /// The polynomial of a node that is no single term from those of its operands; where some are missing, these are put on
    /// the stack instead.
    fn polynomial_of(
        &self,
        id: ExprId,
        memo: &FxHashMap<ExprId, Polynomial<ExprId>>,
        stack: &mut SmallVec<[ExprId; 8]>,
    ) -> Option<Polynomial<ExprId>> {
        let waiting = stack.len();
        let mut known = |operand: &ExprId| {
            let found = memo.get(operand);
            if found.is_none() {
                stack.push(*operand);
            }
            found
        };
        match self.node(id) {
            Node::Sum(terms) => {
                let mut sum = Terms::with_capacity(terms.len());
                for term in terms {
                    if let Some(single) = self.single_term(*term) {
                        sum.push(single);
                    } else if let Some(operand) = known(term) {
                        sum.extend(operand.to_terms());
                    }
                }
                (stack.len() == waiting).then(|| Polynomial::from_terms(sum))
            }
            Node::Product(factors) => {
                let mut coefficient = Rational::one();
                let mut single = Factorisation::new();
                let mut others: SmallVec<[&Polynomial<ExprId>; 4]> = SmallVec::new();
                for factor in factors {
                    if !self.extend_term(*factor, &mut coefficient, &mut single) {
                        others.extend(known(factor));
                    }
                }
                let product = || {
                    let single = Polynomial::term(single.into_iter().collect(), coefficient);
                    others.into_iter().fold(single, |product, factor| product.mul(factor))
                };
                (stack.len() == waiting).then(product)
            }
            Node::Power(base, exponent) => {
                let own =
                    self.single_term(*base).map(|(monomial, coefficient)| Polynomial::term(monomial, coefficient));
                let polynomial = match &own {
                    Some(own) => own,
                    None => known(base)?,
                };
                Some(if *exponent > 0 {
                    polynomial.pow(exponent.unsigned_abs())
                } else if let Some((monomial, coefficient)) = polynomial.as_term() {
                    Polynomial::term(monomial.pow(*exponent), rational::power(coefficient, *exponent))
                } else {
                    // The atom is the base itself with a negative exponent, so that 1/(a+b)^2 and 1/(a+b) share it.
                    Polynomial::term(Monomial::power_of(*base, *exponent), Rational::one())
                })
            }
            _ => Some(Polynomial::variable(id)),
        }
    }

    /// A number, an atom, a power of an atom, or a product of these, as a term; `None` for anything else.
    fn single_term(&self, expr: ExprId) -> Option<(Monomial<ExprId>, Rational)> {
        let mut coefficient = Rational::one();
        let mut factors = Factorisation::new();
        let single = self.extend_term(expr, &mut coefficient, &mut factors);
        single.then(|| (factors.into_iter().collect(), coefficient))
    }

    /// Multiplies a term by such an expression; false, with the term as it was, for anything else.
    fn extend_term(&self, expr: ExprId, coefficient: &mut Rational, factors: &mut Factorisation<ExprId>) -> bool {
        let parts = match self.node(expr) {
            Node::Sum(_) => return false,
            Node::Product(parts) => parts.as_slice(),
            _ => std::slice::from_ref(&expr),
        };
        let before = factors.len();
        let mut number = None;
        for &part in parts {
            match (self.node(part), self.atom_power(part)) {
                // A product has one number at most.
                (Node::Number(value), _) => number = Some(value),
                (_, Some(power)) => factors.push(power),
                _ => {
                    factors.truncate(before);
                    return false;
                }
            }
        }
        match number {
            Some(value) if coefficient.is_one() => coefficient.clone_from(value),
            Some(value) => *coefficient *= value,
            None => {}
        }
        true
    }

    /// An atom, or a power of one, as atom and exponent.
    fn atom_power(&self, expr: ExprId) -> Option<(ExprId, i32)> {
        match self.node(expr) {
            Node::Number(_) | Node::Sum(_) | Node::Product(_) => None,
            Node::Power(base, exponent) => match self.node(*base) {
                Node::Number(_) | Node::Sum(_) | Node::Product(_) | Node::Power(..) => None,
                _ => Some((*base, *exponent)),
            },
            _ => Some((expr, 1)),
        }
    }

    /// The expression of a polynomial over atoms of this graph.
    pub fn from_polynomial(&mut self, polynomial: &Polynomial<ExprId>) -> ExprId {
        let mut terms = Vec::with_capacity(polynomial.len());
        for (monomial, coefficient) in polynomial.terms() {
            let mut factors = vec![self.number(coefficient.clone())];
            for (&atom, exponent) in monomial.factors() {
                factors.push(self.pow(atom, exponent));
            }
            terms.push(self.product(&factors));
        }
        self.sum(&terms)
    }

    /// The expression in the model language; `leaf` names symbols and coordinates.
    pub fn display(&self, expr: ExprId, names: &impl Names) -> String {
        let mut text = String::new();
        self.write(expr, 0, names, &mut text);
        text
    }

    // Binding strength: 0 sum, 1 product, 2 unary minus, 3 power.
    fn write(&self, expr: ExprId, strength: u8, names: &impl Names, out: &mut String) {
        let open = |out: &mut String, needed: bool| {
            if needed {
                out.push('(');
            }
        };
        let close = |out: &mut String, needed: bool| {
            if needed {
                out.push(')');
            }
        };
        match self.node(expr) {
            Node::Number(value) => {
                let paren = strength > 0 && (value.is_negative() || !rational::is_integer(value));
                open(out, paren);
                out.push_str(&value.to_string());
                close(out, paren);
            }
            Node::Pi => out.push_str("pi"),
            Node::Symbol(symbol) => out.push_str(&names.symbol_name(*symbol)),
            Node::Placeholder(index) => out.push_str(&format!("#{index}")),
            Node::Derivative(coordinate, order) => {
                let name = names.coordinate_name(*coordinate);
                match order {
                    0 => out.push_str(&name),
                    1 => out.push_str(&format!("dot({name})")),
                    2 => out.push_str(&format!("ddot({name})")),
                    n => out.push_str(&format!("der({name}, {n})")),
                }
            }
            Node::Sum(terms) => {
                open(out, strength > 0);
                for (i, term) in terms.iter().enumerate() {
                    let mut text = String::new();
                    self.write(*term, 0, names, &mut text);
                    if let Some(rest) = text.strip_prefix('-') {
                        out.push_str(if i == 0 { "-" } else { " - " });
                        out.push_str(rest);
                    } else {
                        if i > 0 {
                            out.push_str(" + ");
                        }
                        out.push_str(&text);
                    }
                }
                close(out, strength > 0);
            }
            Node::Product(factors) => {
                let leading_minus = self.as_number(factors[0]).is_some_and(Signed::is_negative);
                let paren = strength > 1 || (strength == 1 && leading_minus);
                open(out, paren);
                self.write_product(factors, names, out);
                close(out, paren);
            }
            Node::Power(base, exponent) if *exponent < 0 => {
                open(out, strength > 1);
                out.push_str("1/");
                self.write_power(*base, -exponent, names, out);
                close(out, strength > 1);
            }
            Node::Power(base, exponent) => self.write_power(*base, *exponent, names, out),
            Node::Function(function, argument) => {
                out.push_str(function.name());
                out.push('(');
                self.write(*argument, 0, names, out);
                out.push(')');
            }
            Node::Atan2(y, x) => {
                out.push_str("atan2(");
                self.write(*y, 0, names, out);
                out.push_str(", ");
                self.write(*x, 0, names, out);
                out.push(')');
            }
        }
    }

    fn write_product(&self, factors: &[ExprId], names: &impl Names, out: &mut String) {
        let mut above: Vec<String> = Vec::new();
        let mut below: Vec<String> = Vec::new();
        for (i, factor) in factors.iter().enumerate() {
            match self.node(*factor) {
                Node::Number(value) if i == 0 => {
                    if value.is_negative() {
                        out.push('-');
                    }
                    let (numerator, denominator) = (value.numer().into_parts().1, value.denom());
                    if !numerator.is_one() {
                        above.push(numerator.to_string());
                    }
                    if !denominator.is_one() {
                        below.push(denominator.to_string());
                    }
                }
                Node::Power(base, exponent) if *exponent < 0 => {
                    let mut text = String::new();
                    self.write_power(*base, -exponent, names, &mut text);
                    below.push(text);
                }
                _ => {
                    let mut text = String::new();
                    self.write(*factor, 1, names, &mut text);
                    above.push(text);
                }
            }
        }
        out.push_str(&if above.is_empty() { "1".to_owned() } else { above.join("*") });
        for text in below {
            out.push('/');
            out.push_str(&text);
        }
    }

    fn write_power(&self, base: ExprId, exponent: i32, names: &impl Names, out: &mut String) {
        let exponent_suffix = if exponent == 1 { String::new() } else { format!("^{exponent}") };
        let strength = if exponent == 1 { 2 } else { 3 };
        self.write(base, strength, names, out);
        out.push_str(&exponent_suffix);
    }
}

/// Names for the leaves of an expression.
pub trait Names {
    /// The name of a symbol.
    fn symbol_name(&self, symbol: Symbol) -> String;
    /// The name of a coordinate.
    fn coordinate_name(&self, coordinate: Coordinate) -> String;
}

/// The square root when it is rational.
fn exact_square_root(value: &Rational) -> Option<Rational> {
    if value.is_negative() {
        return None;
    }
    let (numerator, denominator) = (value.numer().sqrt(), value.denom().sqrt());
    let root = Rational::new(numerator, denominator);
    (&root * &root == *value).then_some(root)
}
