//! Identifiability before any pattern: what no motion, or no motion in a given set, can tell apart.
//!
//! Two ranks enclose the truth. The *structural* null space treats every motion monomial, functions of the coordinates
//! included, as independent of the others: what it contains no motion can reveal. The *sampled* rank takes the regressors
//! at given states, exactly, so that relations between functions (loop closures, sin^2 + cos^2 = 1) count; it is the
//! rank over these states and a lower bound of what richer motions reach.

use crate::algebra::linear;
use crate::algebra::polynomial::Monomial;
use crate::expr::graph::ExprId;
use crate::number::rational::{self, Rational};
use crate::regressor::form::RegressorForm;
use num_traits::Zero;
use std::collections::BTreeMap;

/// A basis of the parameter directions that no motion reveals.
#[must_use]
pub fn structural_null_space(form: &RegressorForm) -> Vec<Vec<Rational>> {
    let mut rows: BTreeMap<(usize, &Monomial<ExprId>), Vec<Rational>> = BTreeMap::new();
    for (index, row) in form.rows.iter().enumerate() {
        for term in &row.terms {
            if let Some(column) = term.column {
                let zero = || vec![Rational::zero(); form.columns.len()];
                rows.entry((index, &term.atoms)).or_insert_with(zero)[column] += &term.coefficient;
            }
        }
    }
    linear::null_space(rows.into_values().collect(), form.columns.len())
}

/// The regressor rows at `samples` states, stacked, given the exact value of every atom at every state; `None` when an
/// atom has none there.
pub fn sampled_rows(
    form: &RegressorForm,
    samples: usize,
    mut value: impl FnMut(usize, ExprId) -> Option<Rational>,
) -> Option<Vec<Vec<Rational>>> {
    let mut rows = Vec::with_capacity(samples * form.rows.len());
    for sample in 0..samples {
        for row in &form.rows {
            let mut values = vec![Rational::zero(); form.columns.len()];
            for term in &row.terms {
                let Some(column) = term.column else { continue };
                let mut product = term.coefficient.clone();
                for (&atom, exponent) in term.atoms.factors() {
                    let base = value(sample, atom)?;
                    if base.is_zero() && exponent < 0 {
                        return None;
                    }
                    product *= rational::power(&base, exponent);
                }
                values[column] += product;
            }
            rows.push(values);
        }
    }
    Some(rows)
}

/// The exact rank of [`sampled_rows`] and a basis of its null space.
#[must_use]
pub fn rank_of_rows(rows: Vec<Vec<Rational>>, columns: usize) -> (usize, Vec<Vec<Rational>>) {
    let null = linear::null_space(rows, columns);
    (columns - null.len(), null)
}
