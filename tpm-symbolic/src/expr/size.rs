//! Sizes of expressions: the number of terms when multiplied out, and the length of the written form.

use crate::expr::graph::{ExprId, Graph, Node};
use rustc_hash::FxHashMap;

/// Upper bounds of the numbers of terms that expressions have when they are multiplied out.
#[derive(Clone, Debug, Default)]
pub struct Sizes(FxHashMap<ExprId, f64>);

impl Sizes {
    /// The bound for an expression of a graph; all calls must be for the same graph, which may grow in between.
    pub fn of(&mut self, graph: &Graph, expr: ExprId) -> f64 {
        for id in graph.used_by(&[expr], |id| self.0.contains_key(&id)) {
            let size = match graph.node(id) {
                Node::Sum(terms) => terms.iter().map(|term| self.0[term]).sum(),
                Node::Product(factors) => factors.iter().map(|factor| self.0[factor]).product(),
                Node::Power(base, exponent) if *exponent > 0 => multiset(self.0[base], *exponent),
                _ => 1.0,
            };
            self.0.insert(id, size);
        }
        self.0[&expr]
    }
}

/// The number of monomials of degree `exponent` in so many terms: C(terms + exponent - 1, exponent).
#[must_use]
pub fn multiset(terms: f64, exponent: i32) -> f64 {
    if terms <= 1.0 {
        return terms;
    }
    let mut count = 1.0;
    for i in 1..=exponent {
        count *= (terms - 1.0 + f64::from(i)) / f64::from(i);
        if count > 1e300 {
            return f64::INFINITY;
        }
    }
    count
}

impl Graph {
    /// The number of leaves and operations of an expression in written form, with a shared subexpression counted at
    /// each use.
    #[must_use]
    pub fn written_size(&self, expr: ExprId) -> f64 {
        let mut sizes: FxHashMap<ExprId, f64> = FxHashMap::default();
        for id in self.used_by(&[expr], |_| false) {
            let size = 1.0 + self.operands(id).map(|operand| sizes[&operand]).sum::<f64>();
            sizes.insert(id, size);
        }
        sizes[&expr]
    }
}

#[cfg(test)]
mod tests {
    use super::Sizes;
    use crate::expr::graph::{Graph, Symbol};

    #[test]
    fn bounds_hold_and_are_exact_without_cancellation() {
        let mut g = Graph::new();
        let [a, b, c] = [0, 1, 2].map(|i| g.symbol(Symbol(i)));
        let sum = g.sum(&[a, b, c]);
        let cube = g.pow(sum, 3);
        let pair = g.add(a, b);
        let product = g.mul(cube, pair);
        let mut sizes = Sizes::default();
        assert_eq!(sizes.of(&g, cube), 10.0);
        assert_eq!(sizes.of(&g, product), 20.0);
        assert!(g.polynomial(product).len() <= 20);
        // a chain of squares of sums: 2^n factors
        let mut deep = pair;
        for _ in 0..60 {
            let shifted = g.add(deep, c);
            deep = g.mul(shifted, deep);
        }
        assert!(sizes.of(&g, deep) > 1e15 && g.written_size(deep) > 1e15);
    }
}
