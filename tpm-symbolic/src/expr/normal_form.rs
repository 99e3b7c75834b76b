//! The ring of expressions in trigonometric normal form.
//!
//! Invariant: an element is a polynomial over atoms of the graph in the normal form of [`trigonometric`], so that two elements
//! with equal values are equal as data wherever that normal form decides equality.

use crate::algebra::characteristic::Ring;
use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{ExprId, Graph};
use crate::expr::trigonometric;
use crate::number::rational::Rational;

/// Polynomials over atoms of a graph, reduced to their trigonometric normal form after every product.
pub struct NormalForms<'a>(pub &'a mut Graph);

impl Ring for NormalForms<'_> {
    type Element = Polynomial<ExprId>;

    fn number(&mut self, value: &Rational) -> Polynomial<ExprId> {
        Polynomial::constant(value.clone())
    }

    fn add(&mut self, a: &Polynomial<ExprId>, b: &Polynomial<ExprId>) -> Polynomial<ExprId> {
        a.add(b)
    }

    fn mul(&mut self, a: &Polynomial<ExprId>, b: &Polynomial<ExprId>) -> Polynomial<ExprId> {
        trigonometric::multiply(self.0, a, b)
    }

    fn scale(&mut self, a: &Polynomial<ExprId>, factor: &Rational) -> Polynomial<ExprId> {
        a.scale(factor)
    }
    fn is_zero(&self, a: &Polynomial<ExprId>) -> bool {
        a.is_zero()
    }
}
