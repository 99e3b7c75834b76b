//! Straight-line evaluation plans: shared by the interpreter and by every source emitter.
//!
//! Invariant: every operand slot is smaller than the slot of the operation that uses it; no two operations are equal.
//! Whoever executes the operations in order with one rounding each gets the same numbers as everybody else.

use crate::expr::graph::{ExprId, Function, Graph, Node};
use crate::number::rational::Rational;
use crate::plan::sharing::{Atom, SharedProducts};
use num_traits::{One, Signed, Zero};
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

impl Op {
    /// The slots that the operation reads.
    pub fn operands(&self) -> impl Iterator<Item = Slot> + use<> {
        let pair = match *self {
            Self::Constant(_) | Self::Pi | Self::Load(_) => [None, None],
            Self::Neg(a) | Self::Function(_, a) => [Some(a), None],
            Self::Add(a, b) | Self::Sub(a, b) | Self::Mul(a, b) | Self::Div(a, b) | Self::Atan2(a, b) => {
                [Some(a), Some(b)]
            }
        };
        pair.into_iter().flatten()
    }

    /// The same operation on other slots.
    #[must_use]
    pub fn map(&self, slot: impl Fn(Slot) -> Slot) -> Self {
        match self {
            Self::Constant(_) | Self::Pi | Self::Load(_) => self.clone(),
            Self::Neg(a) => Self::Neg(slot(*a)),
            Self::Function(function, a) => Self::Function(*function, slot(*a)),
            Self::Add(a, b) => Self::Add(slot(*a), slot(*b)),
            Self::Sub(a, b) => Self::Sub(slot(*a), slot(*b)),
            Self::Mul(a, b) => Self::Mul(slot(*a), slot(*b)),
            Self::Div(a, b) => Self::Div(slot(*a), slot(*b)),
            Self::Atan2(a, b) => Self::Atan2(slot(*a), slot(*b)),
        }
    }
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
    /// The plan that computes `roots`, each common subexpression once, products of several factors put together so that they share
    /// as many of their parts as can be found greedily.
    #[must_use]
    pub fn new(graph: &Graph, roots: &[ExprId]) -> Self {
        Self::with_products(graph, roots, SharedProducts::of(graph, roots))
    }

    /// The same with products put together from left to right: what an expression costs as it is written.
    pub(crate) fn unshared(graph: &Graph, roots: &[ExprId]) -> Self {
        Self::with_products(graph, roots, SharedProducts::default())
    }

    fn with_products(graph: &Graph, roots: &[ExprId], products: SharedProducts) -> Self {
        let mut builder = Builder { graph, products, merger: Merger::default(), done: HashMap::new() };
        let outputs = roots.iter().map(|&root| builder.compile(root)).collect();
        builder.merger.finish(outputs)
    }

    /// The same operations in the order in which the outputs, one after the other, need them.
    #[must_use]
    pub fn scheduled(&self) -> Self {
        let mut merger = Merger::default();
        let mut slots: Vec<Option<Slot>> = vec![None; self.ops.len()];
        let mut outputs = Vec::with_capacity(self.outputs.len());
        for &output in &self.outputs {
            let mut stack = vec![output];
            while let Some(&slot) = stack.last() {
                let op = &self.ops[slot.index()];
                let missing: Vec<Slot> = op.operands().filter(|operand| slots[operand.index()].is_none()).collect();
                if slots[slot.index()].is_none() && !missing.is_empty() {
                    // Reversed, so that the first operand is computed first.
                    stack.extend(missing.into_iter().rev());
                    continue;
                }
                stack.pop();
                let at = |slot: Slot| slots[slot.index()].expect("invariant: operands come first");
                let found = slots[slot.index()].unwrap_or_else(|| match op {
                    Op::Load(index) => merger.load(&self.inputs[*index as usize]),
                    op => merger.emit(op.map(at)),
                });
                slots[slot.index()] = Some(found);
            }
            outputs.push(slots[output.index()].expect("invariant: an output is computed"));
        }
        Self { inputs: merger.inputs, ops: merger.ops, outputs }
    }

    /// The exact values of the outputs, given exact leaves; `None` when pi, a function without a rational value or a
    /// division by zero stands in the way.
    #[must_use]
    pub fn evaluate_exact(&self, mut leaf: impl FnMut(&Node) -> Option<Rational>) -> Option<Vec<Rational>> {
        let mut values: Vec<Rational> = Vec::with_capacity(self.ops.len());
        for op in &self.ops {
            let at = |slot: &Slot| &values[slot.index()];
            let value = match op {
                Op::Constant(value) => value.clone(),
                Op::Pi | Op::Atan2(..) => return None,
                Op::Load(index) => leaf(&self.inputs[*index as usize])?,
                Op::Add(a, b) => at(a) + at(b),
                Op::Sub(a, b) => at(a) - at(b),
                Op::Mul(a, b) => at(a) * at(b),
                Op::Div(_, b) if at(b).is_zero() => return None,
                Op::Div(a, b) => at(a) / at(b),
                Op::Neg(a) => -at(a),
                Op::Function(function, a) => function.apply_exact(at(a))?,
            };
            values.push(value);
        }
        Some(self.outputs.iter().map(|slot| values[slot.index()].clone()).collect())
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
    products: SharedProducts,
    merger: Merger,
    done: HashMap<ExprId, Slot>,
}

impl Builder<'_> {
    fn emit(&mut self, op: Op) -> Slot {
        self.merger.emit(op)
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
            node @ (Node::Symbol(_) | Node::Derivative(..)) => self.merger.load(node),
            Node::Sum(terms) => self.sum(terms),
            Node::Product(factors) => self.product(id, factors),
            Node::Power(base, exponent) => {
                let power = match self.shared(id) {
                    Some(power) => power,
                    None => self.power(self.done[base], exponent.unsigned_abs()),
                };
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
        Some(self.scaled(term, -value, &factors[1..]))
    }

    fn product(&mut self, id: ExprId, factors: &[ExprId]) -> Slot {
        match self.graph.as_number(factors[0]).cloned() {
            Some(value) if value.is_negative() => {
                let positive = self.scaled(id, -value, &factors[1..]);
                self.emit(Op::Neg(positive))
            }
            Some(value) => self.scaled(id, value, &factors[1..]),
            None => self.scaled(id, Rational::one(), factors),
        }
    }

    /// The product of what a node shares with others; nothing for a node that is no product of several factors.
    fn shared(&mut self, id: ExprId) -> Option<Slot> {
        let atoms = self.products.atoms(id)?.to_vec();
        if let [Atom::Two, single] | [single, Atom::Two] = atoms.as_slice() {
            return Some(self.doubled(*single));
        }
        let mut product: Option<Slot> = None;
        for atom in atoms {
            let slot = self.atom(atom);
            product = Some(product.map_or(slot, |product| self.emit(Op::Mul(product, slot))));
        }
        product
    }

    /// A value twice, as its sum with itself: as exact, without a constant.
    fn doubled(&mut self, single: Atom) -> Slot {
        let value = self.atom(single);
        self.emit(Op::Add(value, value))
    }

    fn atom(&mut self, atom: Atom) -> Slot {
        match atom {
            Atom::Expr(id) => self.done[&id],
            Atom::Two => self.emit(Op::Constant(Rational::from_integer(2.into()))),
            Atom::Pair(index) => {
                if let Some(single) = self.products.doubled(index) {
                    return self.doubled(single);
                }
                let (left, right) = self.products.pair(index);
                let (left, right) = (self.atom(left), self.atom(right));
                self.emit(Op::Mul(left, right))
            }
        }
    }

    /// value * product of the factors of a node, with negative powers collected into one division.
    fn scaled(&mut self, id: ExprId, value: Rational, factors: &[ExprId]) -> Slot {
        let mut above: Option<Slot> = self.shared(id);
        let mut below: Option<Slot> = None;
        // What the shared product holds already.
        let whole = above.is_some();
        let value = if whole { self.products.rest(&value) } else { value };
        for factor in factors {
            match self.graph.node(*factor) {
                Node::Power(base, exponent) if *exponent < 0 => {
                    let power = self.power(self.done[base], exponent.unsigned_abs());
                    below = Some(below.map_or(power, |product| self.emit(Op::Mul(product, power))));
                }
                _ if whole => {}
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

/// Puts operations and whole plans together, every operation once.
#[derive(Clone, Debug, Default)]
pub struct Merger {
    inputs: Vec<Node>,
    ops: Vec<Op>,
    known: HashMap<Op, Slot>,
}

impl Merger {
    /// The slot of an operation on slots of this merger.
    pub fn emit(&mut self, op: Op) -> Slot {
        if let Some(&slot) = self.known.get(&op) {
            return slot;
        }
        let slot = Slot(u32::try_from(self.ops.len()).expect("invariant: fewer than 2^32 operations"));
        self.ops.push(op.clone());
        self.known.insert(op, slot);
        slot
    }

    /// The slot of a leaf.
    pub fn load(&mut self, leaf: &Node) -> Slot {
        let index = self.inputs.iter().position(|present| present == leaf).unwrap_or_else(|| {
            self.inputs.push(leaf.clone());
            self.inputs.len() - 1
        });
        self.emit(Op::Load(u32::try_from(index).expect("invariant: fewer than 2^32 inputs")))
    }

    /// Takes in a whole plan and returns the slots of its outputs.
    pub fn append(&mut self, plan: &Plan) -> Vec<Slot> {
        let mut slots: Vec<Slot> = Vec::with_capacity(plan.ops.len());
        for op in &plan.ops {
            let slot = match op {
                Op::Load(index) => self.load(&plan.inputs[*index as usize]),
                op => self.emit(op.map(|slot| slots[slot.index()])),
            };
            slots.push(slot);
        }
        plan.outputs.iter().map(|slot| slots[slot.index()]).collect()
    }

    /// The operation of a slot.
    #[must_use]
    pub fn op(&self, slot: Slot) -> &Op {
        &self.ops[slot.index()]
    }

    /// Whether a slot is a number with some property.
    #[must_use]
    pub fn is_number(&self, slot: Slot, property: impl FnOnce(&Rational) -> bool) -> bool {
        matches!(self.op(slot), Op::Constant(value) if property(value))
    }

    /// The plan of these outputs, without the operations and leaves that none of them needs.
    #[must_use]
    pub fn finish(self, outputs: Vec<Slot>) -> Plan {
        let mut needed = vec![false; self.ops.len()];
        outputs.iter().for_each(|slot| needed[slot.index()] = true);
        for i in (0..self.ops.len()).rev() {
            if needed[i] {
                self.ops[i].operands().for_each(|slot| needed[slot.index()] = true);
            }
        }
        let mut pruned = Self::default();
        let mut slots: Vec<Option<Slot>> = vec![None; self.ops.len()];
        let at = |slots: &[Option<Slot>], slot: Slot| slots[slot.index()].expect("invariant: operands come first");
        for (i, op) in self.ops.iter().enumerate().filter(|(i, _)| needed[*i]) {
            slots[i] = Some(match op {
                Op::Load(index) => pruned.load(&self.inputs[*index as usize]),
                op => {
                    let op = op.map(|slot| at(&slots, slot));
                    pruned.emit(op)
                }
            });
        }
        let outputs = outputs.into_iter().map(|slot| at(&slots, slot)).collect();
        Plan { inputs: pruned.inputs, ops: pruned.ops, outputs }
    }
}
