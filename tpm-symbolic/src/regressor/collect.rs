//! Equations separated into parameter and motion monomials, row by row.
//!
//! Every term of an equation is a rational number times powers of parameters, constants and motion atoms (derivatives of
//! coordinates and functions of them).

use crate::algebra::monomial::{Factorisation, Monomial};
use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{ExprId, Names, Node, Symbol};
use crate::mechanics::model::{ExactModel, Kind, TermId};
use crate::number::rational::{self, Rational};
use ecow::EcoString;
use num_traits::{One, Zero};
use std::collections::BTreeMap;
use thiserror::Error;

/// Why a model has no regressor form.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RegressorError {
    /// A parameter occurs inside a function of the motion.
    #[error("the model is not linear in `{parameter}`: it stands inside `{inside}`, which depends on the motion")]
    InsideFunction {
        /// The source term at fault.
        term: TermId,
        /// The parameter.
        parameter: String,
        /// The function.
        inside: String,
    },
    /// An input is multiplied by a motion or by another input, or stands inside a function.
    #[error("the input `{input}` must stand alone, multiplied by parameters and constants only, not as in `{found}`")]
    InputNotLinear {
        /// The source term at fault.
        term: TermId,
        /// The input.
        input: String,
        /// The term as it was found.
        found: String,
    },
    /// The factor of an input depends on unknown parameters and cannot be divided out.
    #[error(
        "the factor `{factor}` of the input `{input}` has unknown parameters and cannot be divided out of its equation; declare them as constants"
    )]
    InputFactor {
        /// The source term at fault.
        term: TermId,
        /// The input.
        input: String,
        /// Its factor.
        factor: String,
    },
    /// A power or product of sums of parameters has more monomials than could be estimated.
    #[error("this power or product has more than {most} products of parameters; lower the exponents")]
    TooLarge {
        /// The source term at fault.
        term: TermId,
        /// Most monomials that are collected.
        most: usize,
    },
    /// A constant whose value is 0 occurs in a denominator.
    #[error("`{divisor}` is 0 and stands in a denominator; give it another value, or take it out")]
    ZeroDivisor {
        /// The source term at fault.
        term: TermId,
        /// The constant.
        divisor: String,
    },
    /// No equation has an input.
    #[error("no equation has an input, so nothing fixes the scale of the parameters")]
    NoInput,
    /// The terms of an equation cancel completely.
    #[error("equation {name} cancels to nothing")]
    Empty {
        /// The equation.
        name: String,
        /// One of its terms.
        term: Option<TermId>,
    },
}

impl RegressorError {
    /// The source term at fault, when there is one.
    #[must_use]
    pub fn term(&self) -> Option<TermId> {
        match self {
            Self::InsideFunction { term, .. }
            | Self::InputNotLinear { term, .. }
            | Self::InputFactor { term, .. }
            | Self::ZeroDivisor { term, .. }
            | Self::TooLarge { term, .. } => Some(*term),
            Self::Empty { term, .. } => *term,
            Self::NoInput => None,
        }
    }
}

/// Kind of a factor of a term.
enum Class {
    Input(Symbol),
    Parameter,
    /// A constant known exactly.
    Value(Rational),
    /// A run-time constant, pi, or a function of constants.
    Constant,
    Motion,
    /// A factor that depends on both a parameter (or input) and the motion.
    Mixed(Symbol),
}

fn classify(model: &ExactModel, atom: ExprId) -> Class {
    match model.graph.node(atom) {
        Node::Symbol(symbol) => match &model.quantity(*symbol).kind {
            Kind::Input => Class::Input(*symbol),
            Kind::Parameter => Class::Parameter,
            Kind::Constant { value: Some(value) } => Class::Value(value.clone()),
            Kind::Constant { value: None } | Kind::Amplitude | Kind::Frequency => Class::Constant,
        },
        Node::Derivative(..) => Class::Motion,
        _ => {
            let (mut motion, mut unknown) = (false, None);
            for leaf in model.graph.leaves(atom) {
                match model.graph.node(leaf) {
                    Node::Derivative(..) => motion = true,
                    Node::Symbol(symbol) => match model.quantity(*symbol).kind {
                        Kind::Input => return Class::Mixed(*symbol),
                        Kind::Parameter => unknown = unknown.or(Some(*symbol)),
                        _ => {}
                    },
                    _ => {}
                }
            }
            match (unknown, motion) {
                (Some(symbol), true) => Class::Mixed(symbol),
                (Some(_), false) => Class::Parameter,
                (None, true) => Class::Motion,
                (None, false) => Class::Constant,
            }
        }
    }
}

/// The parameter side of a term: a monomial over parameter atoms.
pub(crate) type ParameterMonomial = Monomial<ExprId>;

/// One term of an equation, split into its parameter side and its motion side.
pub(crate) struct CollectedTerm {
    pub(crate) parameters: ParameterMonomial,
    pub(crate) motion: Monomial<ExprId>,
    pub(crate) coefficient: Rational,
    pub(crate) source: TermId,
}

impl CollectedTerm {
    fn sides(&self) -> (&ParameterMonomial, &Monomial<ExprId>) {
        (&self.parameters, &self.motion)
    }
}

/// An equation separated into parameter and motion monomials: each pair once, in increasing order, with a nonzero
/// coefficient.
pub(crate) struct CollectedRow {
    pub(crate) name: EcoString,
    pub(crate) terms: Vec<CollectedTerm>,
    pub(crate) inputs: Vec<(Symbol, Polynomial<ExprId>)>,
}

/// A source term as a Laurent polynomial over atoms, with its written expression.
pub(crate) struct WrittenTerm {
    pub(crate) id: TermId,
    pub(crate) source: ExprId,
    pub(crate) polynomial: Polynomial<ExprId>,
}

/// The collected source terms of an equation, on its left-hand side.
#[derive(Default)]
pub(crate) struct Gathered {
    /// Terms in any order; a pair of parameter side and motion side may occur several times.
    pub(crate) terms: Vec<CollectedTerm>,
    /// The factor of every input, with the first source term that has the input.
    pub(crate) inputs: BTreeMap<Symbol, (Polynomial<ExprId>, TermId)>,
}

/// One equation that was multiplied out, with its terms sorted and added up.
///
/// # Errors
/// When a parameter or an input does not enter linearly, or the equation vanishes.
pub(crate) fn collect_terms(
    model: &ExactModel,
    name: &str,
    written: &[WrittenTerm],
) -> Result<CollectedRow, RegressorError> {
    let gathered = gather_terms(model, written)?;
    row_of(model, name, gathered, written.first().map(|term| term.id))
}

fn gather_terms(model: &ExactModel, written: &[WrittenTerm]) -> Result<Gathered, RegressorError> {
    let mut terms = Vec::with_capacity(written.iter().map(|source| source.polynomial.len()).sum());
    let mut inputs: BTreeMap<Symbol, (Polynomial<ExprId>, TermId)> = BTreeMap::new();
    for source in written {
        for (monomial, coefficient) in source.polynomial.terms() {
            let mut coefficient = coefficient.clone();
            // Both are parts of a sorted list, and therefore sorted.
            let (mut parameters, mut motion) = (Factorisation::new(), Factorisation::new());
            let mut input = None;
            let mut moves = false;
            for (&atom, exponent) in monomial.factors() {
                match classify(model, atom) {
                    Class::Input(symbol) if exponent == 1 && input.is_none() => input = Some(symbol),
                    Class::Input(symbol) => {
                        return Err(input_not_linear(model, source.id, symbol, source.source));
                    }
                    Class::Parameter => parameters.push((atom, exponent)),
                    Class::Value(value) if value.is_zero() && exponent < 0 => {
                        return Err(RegressorError::ZeroDivisor {
                            term: source.id,
                            divisor: model.display_brief(atom),
                        });
                    }
                    Class::Value(value) => coefficient *= rational::power(&value, exponent),
                    Class::Constant => motion.push((atom, exponent)),
                    Class::Motion => {
                        moves = true;
                        motion.push((atom, exponent));
                    }
                    Class::Mixed(symbol) if model.quantity(symbol).kind == Kind::Input => {
                        return Err(input_not_linear(model, source.id, symbol, source.source));
                    }
                    Class::Mixed(symbol) => {
                        return Err(RegressorError::InsideFunction {
                            term: source.id,
                            parameter: model.symbol_name(symbol),
                            inside: model.display_brief(atom),
                        });
                    }
                }
            }
            let parameters: ParameterMonomial = Monomial::from_sorted(parameters);
            let motion: Monomial<ExprId> = Monomial::from_sorted(motion);
            if let Some(symbol) = input {
                if moves {
                    return Err(input_not_linear(model, source.id, symbol, source.source));
                }
                let slot = inputs.entry(symbol).or_insert_with(|| (Polynomial::zero(), source.id));
                slot.0.add_term(parameters.mul(&motion), coefficient);
            } else {
                terms.push(CollectedTerm { parameters, motion, coefficient, source: source.id });
            }
        }
    }
    Ok(Gathered { terms, inputs })
}

/// The equation that consists of these terms, sorted and added up, and divided by the factor of its input. `first` is its first
/// source term.
///
/// # Errors
/// When the factor of an input cannot be divided out, or the equation vanishes.
pub(crate) fn row_of(
    model: &ExactModel,
    name: &str,
    gathered: Gathered,
    first: Option<TermId>,
) -> Result<CollectedRow, RegressorError> {
    let Gathered { mut terms, mut inputs } = gathered;
    // The sort is stable, so that a pair keeps its first source term.
    terms.sort_by(|a, b| a.sides().cmp(&b.sides()));
    terms.dedup_by(|next, kept| {
        let same = next.sides() == kept.sides();
        if same {
            kept.coefficient += &next.coefficient;
        }
        same
    });
    terms.retain(|term| !term.coefficient.is_zero());
    inputs.retain(|_, (factor, _)| !factor.is_zero());
    if terms.is_empty() {
        return Err(RegressorError::Empty { name: name.to_owned(), term: first });
    }
    normalise(model, &mut terms, &mut inputs)?;
    let name = match inputs.len() {
        1 => inputs.keys().next().map_or_else(EcoString::new, |symbol| model.quantity(*symbol).name.clone()),
        _ => name.into(),
    };
    // The input is moved to the right-hand side.
    let minus_one = rational::integer(-1);
    let inputs = inputs.into_iter().map(|(symbol, (factor, _))| (symbol, factor.scale(&minus_one))).collect();
    Ok(CollectedRow { name, terms, inputs })
}

/// Divides the row by the factor of its input when that factor has unknown parameters, or is the row's only one and a
/// plain number.
fn normalise(
    model: &ExactModel,
    terms: &mut Vec<CollectedTerm>,
    inputs: &mut BTreeMap<Symbol, (Polynomial<ExprId>, TermId)>,
) -> Result<(), RegressorError> {
    let unknown = |factor: &Polynomial<ExprId>| {
        factor.terms().any(|(m, _)| m.factors().any(|(&atom, _)| matches!(classify(model, atom), Class::Parameter)))
    };
    let single = inputs.len() == 1;
    let Some((&symbol, (factor, term))) = inputs.iter().find(|(_, (factor, _))| unknown(factor) || single) else {
        return Ok(());
    };
    let has_unknown = unknown(factor);
    let divisor = match factor.as_term() {
        Some((monomial, coefficient)) if has_unknown || monomial.is_one() => (monomial.clone(), coefficient.clone()),
        _ if !has_unknown => return Ok(()),
        _ => {
            let mut graph = model.graph.clone();
            let expr = graph.from_polynomial(factor);
            return Err(RegressorError::InputFactor {
                term: *term,
                input: model.symbol_name(symbol),
                factor: graph.display_brief(expr, model),
            });
        }
    };
    let (parameters, constants) = divisor.0.partition(|&atom| matches!(classify(model, atom), Class::Parameter));
    let scale = -divisor.1.recip();
    if !scale.is_one() {
        terms.iter_mut().for_each(|term| term.coefficient *= &scale);
    }
    if !divisor.0.is_one() {
        let (parameters, constants) = (parameters.pow(-1), constants.pow(-1));
        for term in &mut *terms {
            term.parameters = term.parameters.mul(&parameters);
            term.motion = term.motion.mul(&constants);
        }
        terms.sort_unstable_by(|a, b| a.sides().cmp(&b.sides()));
    }
    let inverse = divisor.0.pow(-1);
    for (factor, _) in inputs.values_mut() {
        *factor = factor.mul_monomial(&inverse).scale(&scale);
    }
    // With several inputs, another factor may now carry unknown parameters.
    if let Some((&symbol, (factor, term))) = inputs.iter().find(|(_, (factor, _))| unknown(factor)) {
        let mut graph = model.graph.clone();
        let expr = graph.from_polynomial(factor);
        return Err(RegressorError::InputFactor {
            term: *term,
            input: model.symbol_name(symbol),
            factor: graph.display_brief(expr, model),
        });
    }
    Ok(())
}

pub(crate) fn input_not_linear(model: &ExactModel, term: TermId, symbol: Symbol, found: ExprId) -> RegressorError {
    RegressorError::InputNotLinear { term, input: model.symbol_name(symbol), found: model.display_short(found) }
}
