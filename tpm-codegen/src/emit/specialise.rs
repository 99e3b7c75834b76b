//! The functions of the dynamics for one machine: the values of its parameters stand in the code as numbers, and what they make zero or
//! constant is not computed.
//!
//! Invariant: where no operand is infinite or not a number, a specialised plan differs from its own by rounding alone: numbers are combined
//! exactly and rounded once.

use num_traits::{One, Zero};
use thiserror::Error;
use tpm_symbolic::number::rational::Rational;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::{Op, Slot};
use tpm_symbolic::plan::straight_line::{Merger, Plan};

/// Why code cannot be made for one machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum SpecialiseError {
    /// There are no values.
    #[error("code for one machine takes the values of its parameters, which are not given")]
    NoValues,
    /// A campaign goes from values to better ones.
    #[error(
        "a campaign changes the parameters while it runs, and code for one machine does not read them; ask for one of the two"
    )]
    Campaign,
}

/// A plan with the values of the columns.
pub(super) fn specialised(plan: &Plan, values: &[Rational]) -> Plan {
    let mut folded = Folded::default();
    let mut slots: Vec<Slot> = Vec::with_capacity(plan.ops.len());
    for op in &plan.ops {
        let slot = match op {
            Op::Load(index) => match plan.inputs[*index as usize] {
                Leaf::Column(column) => folded.number(values[column].clone()),
                leaf => folded.0.load(leaf),
            },
            op => folded.add(op.map(|slot| slots[slot.index()])),
        };
        slots.push(slot);
    }
    let outputs = plan.outputs.iter().map(|slot| slots[slot.index()]).collect();
    folded.0.finish(outputs).scheduled()
}

/// Operations without those that numbers make superfluous.
#[derive(Default)]
struct Folded(Merger);

impl Folded {
    fn number(&mut self, value: Rational) -> Slot {
        self.0.emit(Op::Constant(value))
    }

    fn value(&self, slot: Slot) -> Option<Rational> {
        match self.0.op(slot) {
            Op::Constant(value) => Some(value.clone()),
            _ => None,
        }
    }

    /// What a slot is the negative of.
    fn negated(&self, slot: Slot) -> Option<Slot> {
        match *self.0.op(slot) {
            Op::Neg(inner) => Some(inner),
            _ => None,
        }
    }

    /// A number times what it multiplies, where a slot is such a product.
    fn scaled(&self, slot: Slot) -> Option<(Rational, Slot)> {
        match *self.0.op(slot) {
            Op::Mul(a, b) => match (self.value(a), self.value(b)) {
                (Some(factor), _) => Some((factor, b)),
                (_, Some(factor)) => Some((factor, a)),
                _ => None,
            },
            Op::Neg(inner) => Some((-Rational::one(), inner)),
            _ => None,
        }
    }

    fn add(&mut self, op: Op) -> Slot {
        match op {
            Op::Add(a, b) => self.sum(a, b),
            Op::Sub(a, b) => self.difference(a, b),
            Op::Mul(a, b) => match (self.value(a), self.value(b)) {
                (Some(a), Some(b)) => self.number(a * b),
                (Some(factor), None) => self.product(factor, b),
                (None, Some(factor)) => self.product(factor, a),
                (None, None) => self.0.emit(op),
            },
            Op::Div(a, b) => match (self.value(a), self.value(b)) {
                (Some(a), Some(b)) if !b.is_zero() => self.number(a / b),
                (Some(zero), None) if zero.is_zero() => self.number(zero),
                (None, Some(one)) if one.is_one() => a,
                _ => self.0.emit(op),
            },
            Op::Neg(a) => self.product(-Rational::one(), a),
            Op::Function(function, a) => match self.value(a).and_then(|value| function.apply_exact(&value)) {
                Some(value) => self.number(value),
                None => self.0.emit(op),
            },
            op => self.0.emit(op),
        }
    }

    fn sum(&mut self, a: Slot, b: Slot) -> Slot {
        match (self.value(a), self.value(b)) {
            (Some(a), Some(b)) => self.number(a + b),
            (Some(zero), None) if zero.is_zero() => b,
            (None, Some(zero)) if zero.is_zero() => a,
            _ => match (self.negated(a), self.negated(b)) {
                (_, Some(b)) => self.difference(a, b),
                (Some(a), None) => self.difference(b, a),
                _ => self.0.emit(Op::Add(a, b)),
            },
        }
    }

    fn difference(&mut self, a: Slot, b: Slot) -> Slot {
        match (self.value(a), self.value(b)) {
            (Some(a), Some(b)) => self.number(a - b),
            (Some(zero), None) if zero.is_zero() => self.product(-Rational::one(), b),
            (None, Some(zero)) if zero.is_zero() => a,
            _ if a == b => self.number(Rational::zero()),
            _ => match self.negated(b) {
                Some(b) => self.sum(a, b),
                None => self.0.emit(Op::Sub(a, b)),
            },
        }
    }

    /// A number times a slot, with the number that multiplies it there.
    fn product(&mut self, factor: Rational, of: Slot) -> Slot {
        if let Some(value) = self.value(of) {
            return self.number(factor * value);
        }
        match self.scaled(of) {
            _ if factor.is_zero() => self.number(factor),
            _ if factor.is_one() => of,
            Some((inner, of)) => self.product(factor * inner, of),
            None if (-&factor).is_one() => self.0.emit(Op::Neg(of)),
            None => {
                let number = self.number(factor);
                self.0.emit(Op::Mul(number, of))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Op, Plan, Rational, Slot, specialised};
    use tpm_symbolic::number::rational::{integer, ratio};
    use tpm_symbolic::plan::leaf::Leaf;

    /// A plan of whole numbers, the leaves of both kinds and operations on what is there before them, and values of its leaves; a number of a
    /// sequence decides about each.
    fn random_plan(next: &mut impl FnMut(usize) -> usize) -> (Plan, Vec<Rational>, Vec<Rational>) {
        let inputs: Vec<Leaf> = (0..3).flat_map(|index| [Leaf::Column(index), Leaf::Signal(index)]).collect();
        let mut ops: Vec<Op> = (0..inputs.len()).map(|index| Op::Load(index as u32)).collect();
        ops.extend([0, 1, -1, 3].map(|value| Op::Constant(integer(value))));
        for _ in 0..30 {
            let mut slot = || Slot(next(ops.len()) as u32);
            let (a, b) = (slot(), slot());
            let op = match next(9) {
                0 | 1 => Op::Add(a, b),
                2 | 3 => Op::Sub(a, b),
                4..=6 => Op::Mul(a, b),
                7 => Op::Div(a, b),
                _ => Op::Neg(a),
            };
            if !ops.contains(&op) {
                ops.push(op);
            }
        }
        let outputs = (ops.len() - 6..ops.len()).map(|slot| Slot(slot as u32)).collect();
        let mut numbers = || -> Vec<Rational> {
            let list = [integer(0), integer(0), integer(1), integer(-1), ratio(5, 7), ratio(-3, 2)];
            (0..3).map(|_| list[next(list.len())].clone()).collect()
        };
        let (values, signals) = (numbers(), numbers());
        (Plan { inputs, ops, outputs }, values, signals)
    }

    #[test]
    fn a_specialised_plan_has_the_same_exact_values_and_reads_no_parameter() {
        let mut state = 1_u64;
        let mut next = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below
        };
        let (mut compared, mut fewer) = (0, 0);
        for _ in 0..3000 {
            let (plan, values, signals) = random_plan(&mut next);
            let leaf = |leaf: &Leaf| match *leaf {
                Leaf::Column(column) => Some(values[column].clone()),
                Leaf::Signal(signal) => Some(signals[signal].clone()),
                _ => None,
            };
            // A plan that divides by zero has no values.
            let Some(expected) = plan.evaluate_exact(leaf) else { continue };
            let special = specialised(&plan, &values);
            assert!(!special.inputs.iter().any(|leaf| matches!(leaf, Leaf::Column(_))));
            assert_eq!(special.evaluate_exact(leaf), Some(expected), "{plan:?} {values:?} {special:?}");
            let operations = |plan: &Plan| {
                let counts = plan.counts();
                counts.additions + counts.multiplications + counts.divisions
            };
            let whole = plan.scheduled();
            assert!(operations(&special) <= operations(&whole), "{whole:?} {special:?}");
            compared += 1;
            fewer += usize::from(operations(&special) < operations(&whole));
        }
        assert!(compared > 500 && fewer > compared / 2, "{compared} {fewer}");
    }
}
