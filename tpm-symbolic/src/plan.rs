//! Straight-line evaluation plans: shared by the interpreter and by every source emitter.
//!
//! Invariant: every operand slot is smaller than the slot of the operation that uses it; no two operations are equal.
//! Whoever executes the operations in order with one rounding each gets the same numbers as everybody else.

use crate::expr::{ExprId, Function, Graph, Node};
use crate::rational::Rational;
use num_traits::{One, Signed};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Index of an operation, and of its result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Slot(pub u32);

impl Slot {
    /// The position in [`Plan::ops`].
    #[must_use]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// One operation.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Op {
    /// An exact constant, rounded once when it becomes a float.
    Constant(Rational),
    /// The circle constant.
    Pi,
    /// An input of the plan, by index into [`Plan::inputs`].
    Load(u32),
    /// a + b
    Add(Slot, Slot),
    /// a - b
    Sub(Slot, Slot),
    /// a * b
    Mul(Slot, Slot),
    /// a / b
    Div(Slot, Slot),
    /// -a
    Neg(Slot),
    /// A function of one argument.
    Function(Function, Slot),
    /// atan2(y, x)
    Atan2(Slot, Slot),
}

/// Numbers of operations, for headers and comparisons.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct OperationCounts {
    /// Additions, subtractions and negations.
    pub additions: usize,
    /// Multiplications.
    pub multiplications: usize,
    /// Divisions.
    pub divisions: usize,
    /// Function calls.
    pub functions: usize,
}

/// A list of operations with named results.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// The leaves that the plan reads, in order of first use.
    pub inputs: Vec<Node>,
    /// The operations, in order of execution.
    pub ops: Vec<Op>,
    /// The slot of every requested expression, in the order of the request.
    pub outputs: Vec<Slot>,
}

impl Plan {
    /// The plan that computes `roots`, each common subexpression once.
    #[must_use]
    pub fn new(graph: &Graph, roots: &[ExprId]) -> Self {
        let mut builder = Builder { graph, plan: Self::default(), known: HashMap::new(), done: HashMap::new() };
        let outputs = roots.iter().map(|&root| builder.compile(root)).collect();
        builder.plan.outputs = outputs;
        builder.plan
    }

    /// Numbers of operations by kind.
    #[must_use]
    pub fn counts(&self) -> OperationCounts {
        let mut counts = OperationCounts::default();
        for op in &self.ops {
            match op {
                Op::Constant(_) | Op::Pi | Op::Load(_) => {}
                Op::Add(..) | Op::Sub(..) | Op::Neg(_) => counts.additions += 1,
                Op::Mul(..) => counts.multiplications += 1,
                Op::Div(..) => counts.divisions += 1,
                Op::Function(..) | Op::Atan2(..) => counts.functions += 1,
            }
        }
        counts
    }
}

struct Builder<'a> {
    graph: &'a Graph,
    plan: Plan,
    known: HashMap<Op, Slot>,
    done: HashMap<ExprId, Slot>,
}

impl Builder<'_> {
    fn emit(&mut self, op: Op) -> Slot {
        if let Some(&slot) = self.known.get(&op) {
            return slot;
        }
        let slot = Slot(u32::try_from(self.plan.ops.len()).expect("invariant: fewer than 2^32 operations"));
        self.plan.ops.push(op.clone());
        self.known.insert(op, slot);
        slot
    }

    fn load(&mut self, node: &Node) -> Slot {
        let index = self.plan.inputs.iter().position(|present| present == node).unwrap_or_else(|| {
            self.plan.inputs.push(node.clone());
            self.plan.inputs.len() - 1
        });
        self.emit(Op::Load(u32::try_from(index).expect("invariant: fewer than 2^32 inputs")))
    }

    fn compile(&mut self, root: ExprId) -> Slot {
        let mut stack = vec![root];
        while let Some(&id) = stack.last() {
            if self.done.contains_key(&id) {
                stack.pop();
                continue;
            }
            let missing: Vec<ExprId> =
                self.graph.operands(id).filter(|operand| !self.done.contains_key(operand)).collect();
            if !missing.is_empty() {
                // Reversed, so that the first operand is computed first.
                stack.extend(missing.into_iter().rev());
                continue;
            }
            stack.pop();
            let slot = self.node(id);
            self.done.insert(id, slot);
        }
        self.done[&root]
    }

    fn node(&mut self, id: ExprId) -> Slot {
        match self.graph.node(id) {
            Node::Number(value) => self.emit(Op::Constant(value.clone())),
            Node::Pi => self.emit(Op::Pi),
            node @ (Node::Symbol(_) | Node::Derivative(..)) => self.load(node),
            Node::Sum(terms) => self.sum(terms),
            Node::Product(factors) => self.product(factors),
            Node::Power(base, exponent) => {
                let power = self.power(self.done[base], exponent.unsigned_abs());
                if *exponent > 0 {
                    power
                } else {
                    let one = self.emit(Op::Constant(Rational::one()));
                    self.emit(Op::Div(one, power))
                }
            }
            Node::Function(function, argument) => self.emit(Op::Function(*function, self.done[argument])),
            Node::Atan2(y, x) => self.emit(Op::Atan2(self.done[y], self.done[x])),
        }
    }

    /// Terms with a factor -1 are subtracted rather than negated and added.
    fn sum(&mut self, terms: &[ExprId]) -> Slot {
        let mut positive = Vec::new();
        let mut negative = Vec::new();
        for term in terms {
            match self.negated(*term) {
                Some(slot) => negative.push(slot),
                None => positive.push(self.done[term]),
            }
        }
        let mut positive = positive.into_iter();
        let mut negative = negative.into_iter();
        let mut total = match positive.next() {
            Some(first) => first,
            None => {
                let first = negative.next().expect("invariant: a sum has terms");
                self.emit(Op::Neg(first))
            }
        };
        for slot in positive {
            total = self.emit(Op::Add(total, slot));
        }
        for slot in negative {
            total = self.emit(Op::Sub(total, slot));
        }
        total
    }

    /// The slot of -term when the term has a negative coefficient.
    fn negated(&mut self, term: ExprId) -> Option<Slot> {
        let Node::Product(factors) = self.graph.node(term) else { return None };
        let value = self.graph.as_number(factors[0]).filter(|value| value.is_negative())?.clone();
        Some(self.scaled(-value, &factors[1..]))
    }

    fn product(&mut self, factors: &[ExprId]) -> Slot {
        match self.graph.as_number(factors[0]).cloned() {
            Some(value) if value.is_negative() => {
                let positive = self.scaled(-value, &factors[1..]);
                self.emit(Op::Neg(positive))
            }
            Some(value) => self.scaled(value, &factors[1..]),
            None => self.scaled(Rational::one(), factors),
        }
    }

    /// value * product of factors, with negative powers collected into one division.
    fn scaled(&mut self, value: Rational, factors: &[ExprId]) -> Slot {
        let mut above: Option<Slot> = None;
        let mut below: Option<Slot> = None;
        for factor in factors {
            match self.graph.node(*factor) {
                Node::Power(base, exponent) if *exponent < 0 => {
                    let power = self.power(self.done[base], exponent.unsigned_abs());
                    below = Some(below.map_or(power, |product| self.emit(Op::Mul(product, power))));
                }
                _ => {
                    let slot = self.done[factor];
                    above = Some(above.map_or(slot, |product| self.emit(Op::Mul(product, slot))));
                }
            }
        }
        let above = match above {
            Some(product) if value.is_one() => product,
            Some(product) => {
                let value = self.emit(Op::Constant(value));
                self.emit(Op::Mul(value, product))
            }
            None => self.emit(Op::Constant(value)),
        };
        match below {
            Some(divisor) => self.emit(Op::Div(above, divisor)),
            None => above,
        }
    }

    /// base^exponent by repeated squaring.
    fn power(&mut self, base: Slot, exponent: u32) -> Slot {
        let mut result: Option<Slot> = None;
        let mut square = base;
        let mut rest = exponent;
        loop {
            if rest & 1 == 1 {
                result = Some(result.map_or(square, |product| self.emit(Op::Mul(product, square))));
            }
            rest >>= 1;
            if rest == 0 {
                return result.expect("invariant: the exponent is positive");
            }
            square = self.emit(Op::Mul(square, square));
        }
    }
}
