//! Parameters that are shown only up to a common factor.
//!
//! A row in which neither an input nor a term without an unknown parameter stands, `phi . theta = 0`, holds for every multiple of its
//! parameters. Whatever the motion is, its regressors are orthogonal to the true parameters; of all that they could span, the row shows what is
//! orthogonal to `theta`. Where rows with an input show a parameter of it, they fix the factor; else all parameters that such rows share
//! have one factor in common, which nothing shows.

use crate::algebra::field::Field;
use crate::regressor::entries::{RegressorForm, Row};

/// Whether nothing known stands in a row.
fn is_homogeneous(row: &Row) -> bool {
    row.inputs.is_empty() && row.terms.iter().all(|term| term.column.is_some())
}

/// The rows of a form in which nothing known stands.
#[must_use]
pub fn homogeneous(form: &RegressorForm) -> Vec<usize> {
    (0..form.rows.len()).filter(|&row| is_homogeneous(&form.rows[row])).collect()
}

/// Sets of columns, each with a common factor that is not shown. `driven` are the rows of equations with something known in them, at any
/// motions, `free` those of every other equation, `theta` parameters in general position. The columns of `leading` are those that all rows
/// would show if motions did not obey the equations.
pub(crate) fn common_factors<F: Field>(
    field: &F,
    driven: Vec<Vec<F::Element>>,
    free: Vec<Vec<Vec<F::Element>>>,
    theta: &[F::Element],
    leading: &[usize],
) -> Vec<Vec<usize>> {
    let mut shown = driven;
    shown.extend(free.into_iter().flat_map(|rows| orthogonal(field, rows, theta)));
    let pivots = field.reduce(&mut shown, leading);
    let hidden = leading.iter().copied().filter(|column| !pivots.contains(column));
    hidden
        .map(|column| {
            let moved = pivots.iter().zip(&shown).filter(|(_, row)| !field.is_zero(&row[column]));
            let mut own: Vec<usize> = moved.map(|(pivot, _)| *pivot).chain([column]).collect();
            own.sort_unstable();
            own
        })
        .collect()
}

/// A basis of the vectors in the span of the rows that are orthogonal to `theta`.
fn orthogonal<F: Field>(field: &F, mut rows: Vec<Vec<F::Element>>, theta: &[F::Element]) -> Vec<Vec<F::Element>> {
    let along = |row: &Vec<F::Element>| {
        let products = row.iter().zip(theta).map(|(x, y)| field.mul(x, y));
        products.fold(field.zero(), |sum, product| field.add(&sum, &product))
    };
    let Some(at) = rows.iter().position(|row| !field.is_zero(&along(row))) else { return rows };
    let pivot = rows.swap_remove(at);
    let size = along(&pivot);
    for row in &mut rows {
        let share = along(row);
        for (value, of_pivot) in row.iter_mut().zip(&pivot) {
            *value = field.sub(&field.mul(&size, value), &field.mul(&share, of_pivot));
        }
    }
    rows
}
