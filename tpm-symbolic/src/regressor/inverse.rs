//! The physical parameters as functions of the lumped ones, in closed form.
//!
//! A value of more than a single product becomes an intermediate quantity, so that expressions do not grow from step to
//! step. [`ParameterMap::inverse`] finds an inverse; this module evaluates, checks and displays it.

use crate::algebra::fraction::{Fraction, display_polynomial};
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::{ExprId, Graph, Node, Symbol};
use crate::number::rational::Rational;
use crate::regressor::parameter_map::ParameterMap;
use num_traits::One;

/// Most terms in the numerator of a closed form; a longer one is of no use.
pub(super) const MAX_TERMS: usize = 500;

/// A variable of an inverse: `Variable(j)` is column j; beyond the columns come the constants that are known at run time,
/// and then the intermediate quantities.
pub type Variable = usize;

/// A product of parameters with a value of more than one term.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Intermediate {
    /// The product, over parameters, functions of them, and sums that several definitions share.
    pub product: Monomial<ExprId>,
    /// Its value in terms of the columns and earlier intermediates.
    pub value: Fraction<Variable>,
}

/// A relation among the columns that every physical system satisfies.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Constraint {
    /// The column that the others determine; `None` when the relation comes from a sum of parameters.
    pub column: Option<usize>,
    /// The expression that the column equals or, without a column, the expression that equals zero.
    pub value: Fraction<Variable>,
}

/// The physical parameters as functions of the columns, as far as a closed form was found.
#[derive(Clone, Debug)]
pub struct Inverse {
    pub(super) graph: Graph,
    /// Number of columns.
    pub columns: usize,
    /// The constants that the definitions read and that have their values at run time only.
    pub constants: Vec<Symbol>,
    /// Intermediate quantities, each in terms of the columns and those before it.
    pub intermediates: Vec<Intermediate>,
    /// Parameters with a closed form, in order of declaration.
    pub solved: Vec<(Symbol, Fraction<Variable>)>,
    /// Parameters without a known closed form.
    pub unsolved: Vec<Symbol>,
    /// Relations among the columns.
    pub constraints: Vec<Constraint>,
}

impl Inverse {
    /// Number of given variables, which is the index of the first intermediate.
    #[must_use]
    pub fn given(&self) -> usize {
        self.columns + self.constants.len()
    }

    /// An expression in which the intermediates are replaced, over columns and constants; `None` when it becomes too
    /// long.
    #[must_use]
    pub fn over_columns(&self, value: &Fraction<Variable>) -> Option<Fraction<usize>> {
        let mut value = value.clone();
        for (i, intermediate) in self.intermediates.iter().enumerate().rev() {
            let index = self.given() + i;
            let occurs = |polynomial: &Polynomial<Variable>| {
                polynomial.terms().any(|(monomial, _)| monomial.exponent(&index) != 0)
            };
            if !occurs(value.numerator()) && !value.denominator().any(|(factor, _)| occurs(factor)) {
                continue;
            }
            value = value.substitute(|&variable| {
                if variable == index { intermediate.value.clone() } else { Fraction::variable(variable) }
            })?;
            if value.numerator().len() > MAX_TERMS {
                return None;
            }
        }
        Some(value)
    }

    /// The solved parameters in double precision, given the columns and the constants known at run time.
    #[must_use]
    pub fn evaluate(&self, columns: &[f64], constant: impl FnMut(Symbol) -> f64) -> Vec<(Symbol, f64)> {
        let mut values = columns.to_vec();
        values.extend(self.constants.iter().copied().map(constant));
        for intermediate in &self.intermediates {
            let value = intermediate.value.evaluate_f64(|&variable| values[variable]);
            values.push(value);
        }
        self.solved.iter().map(|(parameter, value)| (*parameter, value.evaluate_f64(|&v| values[v]))).collect()
    }

    /// Checks every intermediate, parameter and constraint as an identity in the physical parameters; `None` when the
    /// definitions contain functions of parameters other than sums.
    #[must_use]
    pub fn holds(&self, map: &ParameterMap) -> Option<bool> {
        let mut known = map.rational_definitions()?;
        known.extend(self.constants.iter().map(|&constant| Fraction::variable(constant)));
        for intermediate in &self.intermediates {
            let product = Polynomial::term(intermediate.product.clone(), Rational::one());
            let product = map.rational_in(&self.graph, &product)?;
            let value = intermediate.value.substitute(|&variable| known[variable].clone())?;
            if !value.sub(&product).is_zero() {
                return Some(false);
            }
            known.push(product);
        }
        for (parameter, value) in &self.solved {
            let value = value.substitute(|&variable| known[variable].clone())?;
            if !value.sub(&Fraction::variable(*parameter)).is_zero() {
                return Some(false);
            }
        }
        for constraint in &self.constraints {
            let value = constraint.value.substitute(|&variable| known[variable].clone())?;
            let expected = constraint.column.map_or_else(Fraction::zero, |column| known[column].clone());
            if !value.sub(&expected).is_zero() {
                return Some(false);
            }
        }
        Some(true)
    }

    /// An expression in the model language, in which intermediates are written as their products.
    #[must_use]
    pub fn display(&self, map: &ParameterMap, value: &Fraction<Variable>) -> String {
        value.display(|&variable| match self.intermediates.get(variable.wrapping_sub(self.given())) {
            None => match self.constants.get(variable.wrapping_sub(self.columns)) {
                None => map.columns()[variable].clone(),
                Some(&constant) => map.name(constant).to_owned(),
            },
            Some(intermediate) => {
                let product = self.display_product(map, intermediate);
                match intermediate.product.factors().next() {
                    // A parameter, or a sum in parentheses.
                    Some((_, 1)) if intermediate.product.factors().len() == 1 => product,
                    _ => format!("({product})"),
                }
            }
        })
    }

    /// The product that an intermediate stands for, in the model language.
    #[must_use]
    pub fn display_product(&self, map: &ParameterMap, intermediate: &Intermediate) -> String {
        let product = Polynomial::term(intermediate.product.clone(), Rational::one());
        display_polynomial(&product, |&atom| match self.graph.node(atom) {
            Node::Sum(_) => format!("({})", self.graph.display(atom, map)),
            _ => self.graph.display(atom, map),
        })
    }
}
