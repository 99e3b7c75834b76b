//! Expansion of a model under a trajectory pattern into its harmonic coefficient table (Feng, Eqns 3.13-3.17).
//!
//! Each regressor term is a product of derivatives of coordinates; under the pattern each factor is a Fourier
//! polynomial over products of amplitudes, and so is the product. All harmonics come out of one pass, none dropped.
//! Polynomials in the pattern's amplitudes and in run-time constants stay symbolic; the frequency enters as w^n, with n
//! the number of time derivatives in the term.

use crate::expr::{Coordinate, ExprId, Node, Symbol};
use crate::fourier::Fourier;
use crate::model::{Kind, Model, TermId};
use crate::pattern::{Motion, Pattern};
use crate::polynomial::Monomial;
use crate::rational;
use crate::regressor::RegressorForm;
use crate::table::{Entry, HarmonicTable};
use std::collections::{BTreeMap, HashMap};
use thiserror::Error;

/// Why a model does not expand.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ExpandError {
    /// A coordinate of the equations is not in the pattern.
    #[error("the coordinate `{coordinate}` has no motion in the pattern; give it one, or eliminate it")]
    NoMotion {
        /// Where it occurs.
        term: TermId,
        /// The coordinate.
        coordinate: String,
    },
    /// A term is not a finite Fourier series.
    #[error(
        "`{atom}` does not expand into finitely many harmonics under the pattern; declare a Taylor series for it, or use the model with logs, which need no expansion"
    )]
    NotFinite {
        /// Where it occurs.
        term: TermId,
        /// The function or quotient.
        atom: String,
    },
}

impl ExpandError {
    /// The source term at fault.
    #[must_use]
    pub fn term(&self) -> TermId {
        match self {
            Self::NoMotion { term, .. } | Self::NotFinite { term, .. } => *term,
        }
    }
}

/// Expands a model in regressor form under a pattern.
///
/// # Errors
/// When a coordinate has no motion or a term does not expand finitely; nothing is dropped.
pub fn expand(model: &Model, form: &RegressorForm, pattern: &Pattern) -> Result<HarmonicTable, ExpandError> {
    let mut powers: HashMap<(Coordinate, u32, i32), Motion> = HashMap::new();
    let mut entries = Vec::new();
    for (equation, row) in form.rows.iter().enumerate() {
        let mut columns: BTreeMap<Option<usize>, Motion> = BTreeMap::new();
        for term in &row.terms {
            let mut product = Motion::term(Monomial::one(), Fourier::constant(term.coefficient.clone()));
            for (&atom, exponent) in term.atoms.factors() {
                let factor = factor_motion(model, pattern, term.source, atom, exponent, &mut powers)?;
                product = product.mul(&factor);
            }
            let sum = columns.remove(&term.column).unwrap_or_default().add(&product);
            columns.insert(term.column, sum);
        }
        for (column, motion) in columns {
            for (monomial, fourier) in motion.terms() {
                for (harmonic, function, coefficient) in fourier.terms() {
                    entries.push(Entry {
                        equation,
                        harmonic,
                        function,
                        column,
                        coefficient: coefficient.clone(),
                        pi: 0,
                        powers: monomial.factors().map(|(symbol, power)| (symbol.0 as usize, power)).collect(),
                        sign: Monomial::one(),
                    });
                }
            }
        }
    }
    Ok(HarmonicTable::new(
        model.name.clone(),
        form.rows.iter().map(|row| row.name.clone()).collect(),
        form.columns.iter().map(|column| column.name.clone()).collect(),
        model.symbols.iter().map(|quantity| quantity.name.clone()).collect(),
        entries,
    ))
}

fn factor_motion(
    model: &Model,
    pattern: &Pattern,
    term: TermId,
    atom: ExprId,
    exponent: i32,
    powers: &mut HashMap<(Coordinate, u32, i32), Motion>,
) -> Result<Motion, ExpandError> {
    let not_finite = || ExpandError::NotFinite { term, atom: model.display(atom) };
    match *model.graph.node(atom) {
        Node::Symbol(symbol) if matches!(model.quantity(symbol).kind, Kind::Constant { .. }) => {
            Ok(Motion::term(Monomial::power_of(symbol, exponent), Fourier::constant(rational::integer(1))))
        }
        Node::Derivative(coordinate, order) => {
            if exponent < 0 {
                return Err(not_finite());
            }
            if let Some(known) = powers.get(&(coordinate, order, exponent)) {
                return Ok(known.clone());
            }
            let motion = pattern.motions.get(coordinate.0 as usize).and_then(Option::as_ref).ok_or_else(|| {
                ExpandError::NoMotion { term, coordinate: model.coordinates[coordinate.0 as usize].name.clone() }
            })?;
            let base = scale_by_frequency(&motion.derivative(order), pattern.frequency, order);
            let mut power = base.clone();
            for _ in 1..exponent {
                power = power.mul(&base);
            }
            powers.insert((coordinate, order, exponent), power.clone());
            Ok(power)
        }
        _ => Err(not_finite()),
    }
}

fn scale_by_frequency(motion: &Motion, frequency: Symbol, order: u32) -> Motion {
    let exponent = i32::try_from(order).expect("invariant: derivative orders are small");
    let factor = Motion::term(Monomial::power_of(frequency, exponent), Fourier::constant(rational::integer(1)));
    motion.mul(&factor)
}
