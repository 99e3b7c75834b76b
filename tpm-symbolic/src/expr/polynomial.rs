//! Conversion of expressions to Laurent polynomials over their atoms, and back.
//!
//! Atoms are symbols, derivatives of coordinates, pi, functions, and powers with negative exponent of sums.

use crate::algebra::monomial::{Factorisation, Monomial};
use crate::algebra::polynomial::{Polynomial, Terms};
use crate::expr::graph::{ExprId, Graph, Node};
use crate::number::rational::{self, Rational};
use num_traits::One;
use rustc_hash::FxHashMap;
use smallvec::{SmallVec, smallvec};

impl Graph {
    /// The expression as a Laurent polynomial over its atoms: symbols, derivatives of coordinates, pi, functions, and
    /// powers with negative exponent of sums. Sums under a positive power are multiplied out.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::{Coordinate, Function, Graph, Node, Symbol}, number::rational::{integer, ratio}};
    /// let mut g = Graph::new();
    /// let [x, y] = [0, 1].map(|index| g.symbol(Symbol(index)));
    /// let sum = g.add(x, y);
    /// let square = g.pow(sum, 2);
    /// assert_eq!(g.polynomial(square).len(), 3);
    /// ```
    #[must_use]
    pub fn polynomial(&self, expr: ExprId) -> Polynomial<ExprId> {
        self.polynomial_beside(expr, &mut FxHashMap::default())
    }

    /// Several expressions as polynomials; shared subexpressions are multiplied out once.
    #[must_use]
    pub fn polynomials(&self, exprs: impl IntoIterator<Item = ExprId>) -> Vec<Polynomial<ExprId>> {
        let mut memo = FxHashMap::default();
        exprs.into_iter().map(|expr| self.polynomial_beside(expr, &mut memo)).collect()
    }

    /// [`Self::polynomial`] with a memo: `memo` holds the polynomials of subexpressions, and the new ones are added to
    /// it.
    pub(crate) fn polynomial_beside(
        &self,
        expr: ExprId,
        memo: &mut FxHashMap<ExprId, Polynomial<ExprId>>,
    ) -> Polynomial<ExprId> {
        if let Some((monomial, coefficient)) = self.single_term(expr) {
            return Polynomial::term(monomial, coefficient);
        }
        if let Some(known) = memo.get(&expr) {
            return known.clone();
        }
        let mut stack: SmallVec<[ExprId; 8]> = smallvec![expr];
        while let Some(&id) = stack.last() {
            // The node may have been computed for another node meanwhile.
            if memo.contains_key(&id) {
                stack.pop();
                continue;
            }
            match self.polynomial_of(id, memo, &mut stack) {
                // Terms of a model share subexpressions, but rarely the whole, which is therefore not added to the
                // memo.
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

    /// The polynomial of a node that is no single term, from those of its operands. Operands without a polynomial are
    /// put on the stack instead.
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

    /// A number, an atom, a power of an atom, or a product of these as a single term; `None` for anything else.
    fn single_term(&self, expr: ExprId) -> Option<(Monomial<ExprId>, Rational)> {
        let mut coefficient = Rational::one();
        let mut factors = Factorisation::new();
        let single = self.extend_term(expr, &mut coefficient, &mut factors);
        single.then(|| (factors.into_iter().collect(), coefficient))
    }

    /// Multiplies a term, given as coefficient and factors, by an expression that is a single term. For any other
    /// expression, returns false and leaves the term unchanged.
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

    fn is_sum(&self, id: ExprId) -> bool {
        matches!(self.node(id), Node::Sum(_))
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
        match terms.as_slice() {
            // A sum of sums keeps its structure.
            [single] if self.is_sum(*single) && self.operands(*single).any(|part| self.is_sum(part)) => *single,
            _ => self.sum(&terms),
        }
    }
}
