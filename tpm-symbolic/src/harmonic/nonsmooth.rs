//! Signs and absolute values of a motion as exact Fourier series.
//!
//! Under a pattern the argument of sign(u) or |u| is a Fourier polynomial u = m F(theta), m a product of amplitudes. When
//! F changes sign at multiples of a quarter turn of its own fundamental only, its sign is a [`QuadrantSign`], whose mean is
//! rational and whose harmonics are rational multiples of 1/pi; |u| = u sign(u), and the product with any other Fourier
//! polynomial is a finite convolution. So every harmonic of sign(x') x^p x'^q and the like lies exactly in Q + (1/pi) Q,
//! although there are infinitely many. On a rest-to-rest pattern x' = -lambda w K sin^(2l+1), so
//! sign(x') = -sign(lambda) sign(sin theta).
//!
//! The caller chooses how many harmonics are kept; a [`Tail`] bounds the truncation error. Entries hold for positive
//! amplitudes and w, and are marked with the amplitudes whose sign changes their sign.

use crate::algebra::fourier::{Fourier, Trig};
use crate::algebra::polynomial::Monomial;
use crate::budget;
use crate::expr::graph::{ExprId, Function, Node};
use crate::harmonic::error::ExpandError;
use crate::harmonic::motion::{motion_of, power_of};
use crate::harmonic::options::ExpandOptions;
use crate::harmonic::table::{Entry, Tail};
use crate::harmonic::tail::{maximum, root_mean_square};
use crate::mechanics::model::ExactModel;
use crate::mechanics::pattern::{Motion, Pattern};
use crate::number::rational::Rational;
use crate::regressor::form::{RegressorForm, Row, Term};
use num_traits::Zero;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry as Slot;

pub use crate::harmonic::error::SignError;
pub use crate::harmonic::options::DEFAULT_HARMONICS;
pub use crate::harmonic::sign::QuadrantSign;

/// Whether an atom of a term is a sign or an absolute value.
fn is_nonsmooth(model: &ExactModel, atom: ExprId) -> bool {
    matches!(model.graph.node(atom), Node::Function(Function::Sign | Function::Abs, _))
}

/// Splits the terms of a form into those without and those with signs and absolute values, as two forms of the same
/// columns; `None` when no term has a sign or an absolute value.
#[must_use]
pub fn split(model: &ExactModel, form: &RegressorForm) -> Option<(RegressorForm, RegressorForm)> {
    let nonsmooth = |term: &Term| term.atoms.factors().any(|(&atom, _)| is_nonsmooth(model, atom));
    if !form.rows.iter().flat_map(|row| &row.terms).any(nonsmooth) {
        return None;
    }
    let part = |keep: bool| RegressorForm {
        columns: form.columns.clone(),
        rows: form
            .rows
            .iter()
            .map(|row| Row {
                name: row.name.clone(),
                terms: row.terms.iter().filter(|term| nonsmooth(term) == keep).cloned().collect(),
                inputs: row.inputs.clone(),
            })
            .collect(),
    };
    Some((part(false), part(true)))
}

/// The key of the harmonics of one group of terms: equation, column, powers, signs.
type Group = (usize, Option<usize>, Monomial<usize>, Monomial<usize>);

/// Expands terms with signs and absolute values up to the harmonic of the options, with a bound of the truncation
/// error.
///
/// # Errors
/// When the sign changes of a term have no exact series under the pattern, or when so many harmonics would take more
/// memory than the options allow; the source term is named.
pub fn expand(
    model: &ExactModel,
    form: &RegressorForm,
    pattern: &Pattern,
    options: &ExpandOptions<'_>,
) -> Result<(Vec<Entry>, Vec<Tail>), ExpandError> {
    let harmonics = options.harmonics.unwrap_or(DEFAULT_HARMONICS);
    refuse_too_large(form, harmonics, options)?;
    let mut entries = Vec::new();
    let mut tails: BTreeMap<Group, Tail> = BTreeMap::new();
    for (equation, row) in form.rows.iter().enumerate() {
        for term in &row.terms {
            budget::within(
                || model.display_source(term.source),
                || expand_term(model, pattern, (equation, term), harmonics, &mut entries, &mut tails),
            )?;
        }
    }
    Ok((entries, tails.into_values().collect()))
}

/// Adds the entries of one term of an equation, and the bound of their truncation error.
fn expand_term(
    model: &ExactModel,
    pattern: &Pattern,
    (equation, term): (usize, &Term),
    harmonics: usize,
    entries: &mut Vec<Entry>,
    tails: &mut BTreeMap<Group, Tail>,
) -> Result<(), ExpandError> {
    let parts = term_parts(model, pattern, term).map_err(|source| ExpandError::Sign { term: term.source, source })?;
    for (powers, fourier) in parts.smooth.terms() {
        let powers: Monomial<usize> = powers.factors().map(|(s, e)| (s.0 as usize, e)).collect();
        let mean = fourier.scale(&parts.sign.mean());
        let reach = harmonics + fourier.highest_harmonic();
        let series = truncated(&parts.sign.series_times_pi(reach).mul(fourier), harmonics);
        for (pi, fourier) in [(0, &mean), (-1, &series)] {
            entries.extend(fourier.terms().map(|(harmonic, function, coefficient)| Entry {
                equation,
                harmonic,
                function,
                column: term.column,
                coefficient: coefficient.clone(),
                pi: pi + parts.pi,
                powers: powers.clone(),
                sign: parts.flips.clone(),
            }));
        }
        if parts.sign.is_constant() {
            continue;
        }
        let scale = std::f64::consts::PI.powi(parts.pi);
        let rms = root_mean_square(fourier, &mean, &series) * scale;
        let maximum = maximum(fourier, &parts.sign, harmonics).map(|value| value * scale);
        let group = (equation, term.column, powers.clone(), parts.flips.clone());
        match tails.entry(group) {
            Slot::Occupied(mut slot) => {
                let tail = slot.get_mut();
                tail.rms = (tail.rms + rms).next_up();
                tail.maximum = tail.maximum.zip(maximum).map(|(a, b)| (a + b).next_up());
            }
            Slot::Vacant(slot) => {
                let (column, sign) = (term.column, parts.flips.clone());
                slot.insert(Tail { equation, column, powers, sign, harmonics, rms, maximum });
            }
        }
    }
    Ok(())
}

/// Refuses tables beyond the memory limit; every harmonic of a term takes one entry.
fn refuse_too_large(form: &RegressorForm, harmonics: usize, options: &ExpandOptions<'_>) -> Result<(), ExpandError> {
    let mut terms = form.rows.iter().flat_map(|row| &row.terms);
    let Some(first) = terms.next() else { return Ok(()) };
    let entries = (1 + terms.count() as u128) * harmonics as u128;
    let bytes = entries * std::mem::size_of::<Entry>() as u128;
    let limit = options.limit();
    if bytes > limit { Err(ExpandError::TooLarge { term: first.source, entries, bytes, limit }) } else { Ok(()) }
}

/// A term as pi^n * flips * sign(theta) * smooth.
struct Parts {
    smooth: Motion,
    sign: QuadrantSign,
    /// The amplitudes whose sign changes the sign of the term.
    flips: Monomial<usize>,
    pi: i32,
}

fn term_parts(model: &ExactModel, pattern: &Pattern, term: &Term) -> Result<Parts, SignError> {
    let mut parts = Parts {
        smooth: Motion::term(Monomial::one(), Fourier::constant(term.coefficient.clone())),
        sign: QuadrantSign::POSITIVE,
        flips: Monomial::one(),
        pi: 0,
    };
    for (&atom, exponent) in term.atoms.factors() {
        match *model.graph.node(atom) {
            Node::Pi => parts.pi += exponent,
            Node::Function(function @ (Function::Sign | Function::Abs), argument) if exponent > 0 => {
                let motion = motion_of(model, pattern, argument)?;
                if function == Function::Abs {
                    parts.smooth = (0..exponent).fold(parts.smooth, |product, _| product.mul(&motion));
                }
                if motion.terms().len() == 0 {
                    // sign(0) = 0
                    parts.smooth = Motion::zero();
                } else if exponent % 2 == 1 {
                    apply_sign(model, pattern, argument, &motion, &mut parts)?;
                }
            }
            _ => {
                let factor = power_of(model, pattern, atom, exponent)?;
                parts.smooth = parts.smooth.mul(&factor);
            }
        }
    }
    Ok(parts)
}

fn apply_sign(
    model: &ExactModel,
    pattern: &Pattern,
    argument: ExprId,
    motion: &Motion,
    parts: &mut Parts,
) -> Result<(), SignError> {
    let argument = || model.display_brief(argument);
    let mut terms = motion.terms();
    let (Some((monomial, fourier)), None) = (terms.next(), terms.next()) else {
        return Err(SignError::Ratio { argument: argument() });
    };
    let sign = QuadrantSign::of(fourier).ok_or_else(|| SignError::Phase { argument: argument() })?;
    parts.sign = parts.sign.times(&sign).ok_or_else(|| SignError::Multiples { argument: argument() })?;
    for (&symbol, exponent) in monomial.factors() {
        // The frequency is positive, and two flips cancel.
        if exponent % 2 != 0 && symbol != pattern.frequency {
            let present = parts.flips.exponent(&(symbol.0 as usize));
            let change = if present == 0 { 1 } else { -1 };
            parts.flips = parts.flips.mul(&Monomial::power_of(symbol.0 as usize, change));
        }
    }
    Ok(())
}

fn truncated(fourier: &Fourier, harmonics: usize) -> Fourier {
    let mut result = (vec![Rational::zero(); harmonics + 1], vec![Rational::zero(); harmonics]);
    for (k, function, value) in fourier.terms().filter(|(k, ..)| *k <= harmonics) {
        match function {
            Trig::Cos => result.0[k] = value.clone(),
            Trig::Sin => result.1[k - 1] = value.clone(),
        }
    }
    Fourier::from_parts(result.0, result.1)
}
