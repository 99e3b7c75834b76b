//! Expansion of a model under a trajectory pattern into its harmonic coefficient table (Feng, Eqns 3.13-3.17).
//!
//! Under the pattern every coordinate is a sum of amplitudes times Fourier polynomials, its *shapes*:
//!
//! ```text
//! q = sum_s m_s F_s(w t) ,      q^(n) = w^n sum_s m_s F_s^(n) .
//! ```
//!
//! Each regressor, a polynomial in the q^(n), is first written as a polynomial in the m_s, in w and in the F_s^(n). In
//! this form all symbolic cancellations occur, such as that of the offset in (q - q0)^k with q = q0 + a F. Then every
//! remaining product of shapes is multiplied out once, for all columns and amplitudes to which it belongs, and all its
//! harmonics are added to the table in one pass; none is dropped.
//!
//! Invariants: a product of shapes is computed from a shorter one by one multiplication, in the order of the packed
//! exponents, so that only the prefixes of the current product are kept. Numerators have a common denominator, known in
//! factored form from those of the factors. The width of the numerators follows from a bound that is exact for the
//! product before the last factor.

mod atoms;
mod coefficient;
mod expansion;
mod multiply;
mod product;
mod size;
mod structured;

use crate::algebra::packed::{Key, Layout, LongKey};
use crate::budget;
use crate::harmonic::expand::atoms::Atoms;
use crate::harmonic::expand::expansion::Expansion;
use crate::harmonic::expand::structured::multiplied_out;
use crate::harmonic::nonsmooth;
use crate::harmonic::table::HarmonicTable;
use crate::mechanics::model::ExactModel;
use crate::mechanics::pattern::Pattern;
use crate::regressor::form::RegressorForm;
use std::borrow::Cow;
use std::cell::Cell;

pub use crate::harmonic::error::ExpandError;
pub use crate::harmonic::options::{ExpandOptions, Progress};

/// Expands a model in regressor form under a pattern, within the default limits.
///
/// # Errors
/// When a coordinate has no motion, a term does not expand finitely, or the table would be too large; nothing is dropped.
pub fn expand(model: &ExactModel, form: &RegressorForm, pattern: &Pattern) -> Result<HarmonicTable, ExpandError> {
    expand_with(model, form, pattern, &mut ExpandOptions::default())
}

/// Expands a model in regressor form under a pattern.
///
/// # Errors
/// When a coordinate has no motion, a term does not expand finitely, the table would be too large and large ones are
/// not allowed, or the progress callback requests a stop; nothing is dropped.
pub fn expand_with(
    model: &ExactModel,
    form: &RegressorForm,
    pattern: &Pattern,
    options: &mut ExpandOptions<'_>,
) -> Result<HarmonicTable, ExpandError> {
    let form = &*multiplied_out(model, form, pattern, options)?;
    if let Some((finite, infinite)) = nonsmooth::split(model, form) {
        let (entries, tails) = nonsmooth::expand(model, &infinite, pattern, options)?;
        return Ok(expand_with(model, &finite, pattern, options)?.with_infinite(entries, tails));
    }
    let mut atoms = Atoms::new();
    atoms.resolve(model, form, pattern)?;
    atoms.refuse_too_many_products(options)?;
    let shapes = Layout::new(atoms.shapes.len(), atoms.largest_exponent);
    let symbols = Layout::new(atoms.symbols.len(), atoms.largest_exponent);
    match shapes.key_bits().max(symbols.key_bits()) {
        0..=64 => run(&mut Expansion::<u64>::new(model, form, &atoms, shapes, symbols), options),
        65..=128 => run(&mut Expansion::<u128>::new(model, form, &atoms, shapes, symbols), options),
        _ => run(&mut Expansion::<LongKey>::new(model, form, &atoms, shapes, symbols), options),
    }
}

/// Collects all terms, refuses expansions that would be too large, and multiplies out.
fn run<K: Key>(
    expansion: &mut Expansion<'_, '_, K>,
    options: &mut ExpandOptions<'_>,
) -> Result<HarmonicTable, ExpandError> {
    expansion.prepare();
    let (model, form) = (expansion.model, expansion.form);
    for (equation, row) in form.rows.iter().enumerate() {
        let mut terms = Cow::Borrowed(row.terms.as_slice());
        if !terms.is_sorted_by_key(|term| term.column) {
            terms.to_mut().sort_by_key(|term| term.column);
        }
        for column in terms.chunk_by(|a, b| a.column == b.column) {
            let name = || column.first().map_or_else(String::new, |term| model.display_source(term.source));
            budget::within(name, || expansion.collect(equation, column, options))?;
        }
    }
    expansion.refuse_too_large(options)?;
    let present_term = Cell::new(None);
    let name = || present_term.get().map_or_else(String::new, |term| model.display_source(term));
    budget::within(name, || expansion.multiply_out(options, &present_term))?;
    let names = [
        form.rows.iter().map(|row| row.name.clone()).collect(),
        form.columns.iter().map(|column| column.name.clone()).collect(),
        expansion.model.symbols.iter().map(|quantity| quantity.name.clone()).collect(),
    ];
    expansion.series.retain(|series| series.len > 0);
    let (series, words) = (std::mem::take(&mut expansion.series), std::mem::take(&mut expansion.words));
    Ok(HarmonicTable::from_series(expansion.model.name.as_str().into(), names, series, words, expansion.entries))
}
