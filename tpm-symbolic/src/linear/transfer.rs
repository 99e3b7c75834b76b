//! Transfer functions of a linearised model with exact symbolic coefficients.
//!
//! ```text
//! (M s^2 + D s + K) dq = F du ,    dq / du = adj(M s^2 + D s + K) F / det(M s^2 + D s + K)
//! ```
//!
//! Invariant: polynomials in s stand from s^0 upwards and end with a coefficient that is not 0. Powers of s that numerator
//! and denominator share are removed and counted; other common factors need numbers
//! ([`StateSpace::transfer_function`](crate::linear::linearize::StateSpace::transfer_function)).

use crate::algebra::characteristic::{self, Matrix, Ring};
use crate::algebra::polynomial::Polynomial;
use crate::budget;
use crate::expr::graph::{ExprId, Graph};
use crate::expr::normal_form::NormalForms;
use crate::expr::trigonometric;
use crate::linear::linearize::Linearization;
use crate::mechanics::model::ExactModel;
use crate::number::rational::Rational;

/// The transfer function from one input to one coordinate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SymbolicTransfer {
    /// Coefficients of the numerator; empty when the input does not move the coordinate.
    pub numerator: Vec<ExprId>,
    /// Coefficients of the denominator.
    pub denominator: Vec<ExprId>,
    /// Power of s that was common to both and is removed: poles at 0 that zeros at 0 cancel.
    pub cancelled: usize,
}

/// Polynomials in s over normal forms.
struct InS<'a>(NormalForms<'a>);

type Element = Vec<Polynomial<ExprId>>;

/// Operations for a coefficient that is made or copied, for the budget.
const COPIED: u64 = 16;
/// Operations for a product of two coefficients, for the budget.
const COEFFICIENT: u64 = 16;

impl Ring for InS<'_> {
    type Element = Element;

    fn number(&mut self, value: &Rational) -> Element {
        vec![self.0.number(value)]
    }

    fn add(&mut self, a: &Element, b: &Element) -> Element {
        let (long, short) = if a.len() >= b.len() { (a, b) } else { (b, a) };
        budget::charge(COPIED.saturating_mul(long.len() as u64));
        let mut sum = long.clone();
        for (slot, value) in sum.iter_mut().zip(short) {
            *slot = slot.add(value);
        }
        sum
    }

    fn add_to(&mut self, sum: &mut Element, mut part: Element) {
        if sum.len() < part.len() {
            std::mem::swap(sum, &mut part);
        }
        budget::charge(COPIED.saturating_mul(sum.len() as u64));
        for (slot, value) in sum.iter_mut().zip(part).filter(|(_, value)| !value.is_zero()) {
            *slot = if slot.is_zero() { value } else { slot.add(&value) };
        }
    }

    fn mul(&mut self, a: &Element, b: &Element) -> Element {
        let length = (a.len() + b.len()).saturating_sub(1);
        budget::charge(COEFFICIENT.saturating_mul((a.len() * b.len()) as u64).saturating_add(COPIED * length as u64));
        let mut product = vec![Polynomial::zero(); length];
        for (i, left) in a.iter().enumerate().filter(|(_, left)| !left.is_zero()) {
            for (j, right) in b.iter().enumerate().filter(|(_, right)| !right.is_zero()) {
                let term = self.0.mul(left, right);
                let slot = &mut product[i + j];
                *slot = if slot.is_zero() { term } else { slot.add(&term) };
            }
        }
        product
    }

    fn scale(&mut self, a: &Element, factor: &Rational) -> Element {
        a.iter().map(|coefficient| self.0.scale(coefficient, factor)).collect()
    }

    fn is_zero(&self, a: &Element) -> bool {
        a.iter().all(Polynomial::is_zero)
    }
}

/// The transfer functions to every coordinate (rows) from every input (columns).
#[must_use]
pub fn transfer_functions(model: &mut ExactModel, linear: &Linearization) -> Matrix<SymbolicTransfer> {
    let graph = &mut model.graph;
    let n = linear.mass.len();
    let mut dynamic: Matrix<Element> = Vec::with_capacity(n);
    for i in 0..n {
        let entry = |graph: &mut Graph, j: usize| {
            [&linear.stiffness, &linear.damping, &linear.mass].map(|m| trigonometric::normal(graph, m[i][j])).to_vec()
        };
        dynamic.push((0..n).map(|j| entry(graph, j)).collect());
    }
    let drive: Matrix<Element> =
        linear.input.iter().map(|row| row.iter().map(|&e| vec![trigonometric::normal(graph, e)]).collect()).collect();
    let mut ring = InS(NormalForms(graph));
    let (determinant, adjugate) = characteristic::adjugate(&mut ring, &dynamic);
    let numerators = characteristic::multiply(&mut ring, &adjugate, &drive);
    let determinant = trimmed(graph, determinant);
    let mut rows = Vec::with_capacity(n);
    for row in numerators {
        rows.push(row.into_iter().map(|numerator| quotient(graph, numerator, &determinant)).collect());
    }
    rows
}

fn quotient(graph: &mut Graph, numerator: Element, denominator: &Element) -> SymbolicTransfer {
    let numerator = trimmed(graph, numerator);
    let mut zeros = |polynomial: &Element| {
        polynomial.iter().take_while(|coefficient| trigonometric::numerator(graph, coefficient).is_zero()).count()
    };
    let cancelled = if numerator.is_empty() { 0 } else { zeros(&numerator).min(zeros(denominator)) };
    let mut exprs = |polynomial: &[Polynomial<ExprId>]| -> Vec<ExprId> {
        polynomial.iter().skip(cancelled).map(|coefficient| graph.from_polynomial(coefficient)).collect()
    };
    let (numerator, denominator) = (exprs(&numerator), exprs(denominator));
    SymbolicTransfer { numerator, denominator, cancelled }
}

fn trimmed(graph: &mut Graph, mut polynomial: Element) -> Element {
    while polynomial.last().is_some_and(|coefficient| trigonometric::numerator(graph, coefficient).is_zero()) {
        polynomial.pop();
    }
    // A coefficient that is identically zero becomes the number 0.
    for coefficient in &mut polynomial {
        if trigonometric::numerator(graph, coefficient).is_zero() {
            *coefficient = Polynomial::zero();
        }
    }
    polynomial
}
