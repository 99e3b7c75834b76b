//! Compilation of expressions to plans: each common subexpression once, divisions collected, differences instead of
//! negated terms.

use crate::expr::graph::{ExprId, Graph, Node};
use crate::number::rational::Rational;
use crate::plan::leaf::Leaf;
use crate::plan::operation::{Op, Slot};
use crate::plan::sharing::{Atom, SharedProducts};
use crate::plan::straight_line::{Merger, Plan};
use num_traits::{One, Signed, Zero};
use std::collections::HashMap;

impl Plan {
    /// The plan that computes `roots`, expressions over quantities of a model. Each common subexpression is computed once;
    /// products of several factors share as many of their parts as a greedy search finds.
    #[must_use]
    pub fn new(graph: &Graph, roots: &[ExprId]) -> Self {
        Self::with_leaves(graph, roots, Leaf::of_model)
    }

    /// The plan in which every product is multiplied from left to right. It counts the operations of an expression in
    /// its written form.
    pub(crate) fn unshared(graph: &Graph, roots: &[ExprId]) -> Self {
        compiled(graph, roots, Leaf::of_model, SharedProducts::default())
    }
}

impl<L: Clone + PartialEq> Plan<L> {
    /// The plan that computes `roots`, as [`Plan::new`]; `leaf` converts the leaves of the graph.
    pub(crate) fn with_leaves(graph: &Graph, roots: &[ExprId], leaf: impl Fn(&Node) -> L) -> Self {
        compiled(graph, roots, leaf, SharedProducts::of(graph, roots))
    }
}

fn compiled<L: Clone + PartialEq>(
    graph: &Graph,
    roots: &[ExprId],
    leaf: impl Fn(&Node) -> L,
    products: SharedProducts,
) -> Plan<L> {
    let mut builder = Builder { graph, leaf, products, merger: Merger::default(), done: HashMap::new() };
    let outputs = roots.iter().map(|&root| builder.compile(root)).collect();
    builder.merger.finish(outputs)
}

struct Builder<'a, L, F> {
    graph: &'a Graph,
    /// Gives the leaf of the plan for a leaf of the graph.
    leaf: F,
    products: SharedProducts,
    merger: Merger<L>,
    done: HashMap<ExprId, Slot>,
}

impl<L: Clone + PartialEq, F: Fn(&Node) -> L> Builder<'_, L, F> {
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
                // The order is reversed, so that the first operand is computed first.
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
            node @ (Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_)) => {
                let leaf = (self.leaf)(node);
                self.merger.load(leaf)
            }
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
        // Removes equal terms that became recognisable as equal only by shared products.
        negative.retain(|slot| match positive.iter().position(|same| same == slot) {
            Some(same) => {
                positive.remove(same);
                false
            }
            None => !self.is_zero(*slot),
        });
        positive.retain(|slot| !self.is_zero(*slot));
        let mut positive = positive.into_iter();
        let mut negative = negative.into_iter();
        let first = positive.next();
        let mut total = match first.or_else(|| negative.next()) {
            Some(slot) if first.is_some() => slot,
            Some(slot) => self.emit(Op::Neg(slot)),
            None => self.emit(Op::Constant(Rational::zero())),
        };
        for slot in positive {
            total = self.emit(Op::Add(total, slot));
        }
        for slot in negative {
            total = self.emit(Op::Sub(total, slot));
        }
        total
    }

    fn is_zero(&self, slot: Slot) -> bool {
        self.merger.is_number(slot, Zero::is_zero)
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

    /// The slot of the product of a node's atoms, parts of which other products may share; `None` for a node without
    /// several factors.
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

    /// Twice a value, as the sum of the value with itself, which is as exact as a product and needs no constant.
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
        if factors.iter().any(|factor| self.done.get(factor).is_some_and(|slot| self.is_zero(*slot))) {
            return self.emit(Op::Constant(Rational::zero()));
        }
        let mut above: Option<Slot> = self.shared(id);
        let mut below: Option<Slot> = None;
        // The shared product contains all factors except the divisors and a part of the coefficient.
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

#[cfg(test)]
mod tests {
    use crate::expr::graph::{ExprId, Graph, Symbol};
    use crate::number::rational::{Rational, integer, ratio};
    use crate::plan::leaf::Leaf;
    use crate::plan::sharing::SharedProducts;
    use crate::plan::straight_line::Plan;

    #[test]
    fn parts_are_shared_and_values_stay() {
        let mut graph = Graph::new();
        let [s, a, b] = [0, 1, 2].map(|index| graph.symbol(Symbol(index)));
        let squared = graph.pow(s, 2);
        let product = |graph: &mut Graph, value: Rational, factors: &[ExprId]| {
            let whole = graph.product(factors);
            graph.scale(whole, value)
        };
        // 2 s a, 2 s^2 a, 4 s b, 3 s^2 b, s^2: shared factors such as 2 s and s^2 are computed once.
        let roots = [
            product(&mut graph, integer(2), &[s, a]),
            product(&mut graph, integer(2), &[squared, a]),
            product(&mut graph, integer(-4), &[s, b]),
            product(&mut graph, ratio(3, 7), &[squared, b]),
            squared,
        ];
        let plan = Plan::new(&graph, &roots);
        assert!(plan.counts().multiplications <= 8, "{:?}", plan.counts());
        let values = [ratio(5, 3), ratio(-2, 7), ratio(11, 4)];
        let leaf = |leaf: &Leaf| match leaf {
            Leaf::Symbol(Symbol(index)) => Some(values[*index as usize].clone()),
            _ => None,
        };
        let [s, a, b] = values.clone();
        let two = integer(2);
        let expected =
            vec![&two * &s * &a, &two * &s * &s * &a, integer(-4) * &s * &b, ratio(3, 7) * &s * &s * &b, &s * &s];
        assert_eq!(plan.evaluate_exact(leaf), Some(expected));
        assert!(SharedProducts::of(&graph, &[]).atoms(roots[0]).is_none());
    }
}
