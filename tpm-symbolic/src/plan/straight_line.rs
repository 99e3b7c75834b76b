//! Straight-line evaluation plans, shared by the interpreter and all emitters.
//!
//! Invariant: every operand slot is smaller than the slot of the operation that uses it; no two operations are equal.
//! Executing the operations in order with one rounding each gives the same numbers on every platform.

use crate::budget;
use crate::number::rational::Rational;
use crate::plan::leaf::Leaf;
use crate::plan::operation::{Op, OperationCounts, Slot};
use num_traits::Zero;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Operations on machine words for adding an operation to a plan, for the budget.
const EMITTED: u64 = 200;

/// A list of operations, some of whose results are outputs. `L` is the type of its leaves.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan<L = Leaf> {
    /// The leaves that the plan reads, in order of first use.
    pub inputs: Vec<L>,
    /// The operations, in order of execution.
    pub ops: Vec<Op>,
    /// The slot of every requested expression, in the order of the request.
    pub outputs: Vec<Slot>,
}

impl<L: Clone + PartialEq> Plan<L> {
    /// The plan with its operations in the order in which the outputs, one after the other, need them.
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
                    // The order is reversed, so that the first operand is computed first.
                    stack.extend(missing.into_iter().rev());
                    continue;
                }
                stack.pop();
                let at = |slot: Slot| slots[slot.index()].expect("invariant: operands come first");
                let found = slots[slot.index()].unwrap_or_else(|| match op {
                    Op::Load(index) => merger.load(self.inputs[*index as usize].clone()),
                    op => merger.emit(op.map(at)),
                });
                slots[slot.index()] = Some(found);
            }
            outputs.push(slots[output.index()].expect("invariant: an output is computed"));
        }
        Self { inputs: merger.inputs, ops: merger.ops, outputs }
    }

    /// The exact values of the outputs, given exact leaves; `None` when the plan contains pi, a function without a
    /// rational value or a division by zero.
    #[must_use]
    pub fn evaluate_exact(&self, mut leaf: impl FnMut(&L) -> Option<Rational>) -> Option<Vec<Rational>> {
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

/// Merges operations and whole plans, with every operation once.
#[derive(Clone, Debug)]
pub struct Merger<L = Leaf> {
    inputs: Vec<L>,
    ops: Vec<Op>,
    known: HashMap<Op, Slot>,
}

impl<L> Default for Merger<L> {
    fn default() -> Self {
        Self { inputs: Vec::new(), ops: Vec::new(), known: HashMap::new() }
    }
}

impl<L: Clone + PartialEq> Merger<L> {
    /// Adds an operation on slots of this merger, and returns its slot.
    pub fn emit(&mut self, op: Op) -> Slot {
        if let Some(&slot) = self.known.get(&op) {
            return slot;
        }
        budget::charge(EMITTED);
        let slot = Slot(u32::try_from(self.ops.len()).expect("invariant: fewer than 2^32 operations"));
        self.ops.push(op.clone());
        self.known.insert(op, slot);
        slot
    }

    /// Adds a leaf, and returns its slot.
    pub fn load(&mut self, leaf: L) -> Slot {
        let index = self.inputs.iter().position(|present| *present == leaf).unwrap_or_else(|| {
            self.inputs.push(leaf);
            self.inputs.len() - 1
        });
        self.emit(Op::Load(u32::try_from(index).expect("invariant: fewer than 2^32 inputs")))
    }

    /// Adds a whole plan and returns the slots of its outputs.
    pub fn append(&mut self, plan: &Plan<L>) -> Vec<Slot> {
        let mut slots: Vec<Slot> = Vec::with_capacity(plan.ops.len());
        for op in &plan.ops {
            let slot = match op {
                Op::Load(index) => self.load(plan.inputs[*index as usize].clone()),
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

    /// Whether a slot is a number with the given property.
    #[must_use]
    pub fn is_number(&self, slot: Slot, property: impl FnOnce(&Rational) -> bool) -> bool {
        matches!(self.op(slot), Op::Constant(value) if property(value))
    }

    /// The plan of these outputs, without operations and leaves that no output needs.
    #[must_use]
    pub fn finish(self, outputs: Vec<Slot>) -> Plan<L> {
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
                Op::Load(index) => pruned.load(self.inputs[*index as usize].clone()),
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
