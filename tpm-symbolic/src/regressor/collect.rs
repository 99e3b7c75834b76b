//! Equations separated into parameter and motion monomials, row by row.
//!
//! Every term of an equation is a rational number times powers of parameters, constants and motion atoms (derivatives of
//! coordinates and functions of them). An input that is multiplied by parameters and constants alone stands on the right-hand side; an input
//! beside the motion, beside another input or in a function is an atom like those of the motion.

use crate::algebra::monomial::{Factorisation, Monomial};
use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{ExprId, Names, Node, Symbol};
use crate::mechanics::model::{ExactModel, Kind, TermId};
use crate::number::rational::{self, Rational};
use crate::regressor::entries::RegressorForm;
use ecow::EcoString;
use num_traits::Zero;
use std::collections::BTreeMap;
use thiserror::Error;

/// Why a model has no regressor form.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RegressorError {
    /// A parameter occurs inside a function of the motion.
    #[error(
        "the model is not linear in `{parameter}`: it stands inside `{inside}`, which depends on the motion; declare it with the interval in \
         which a log is to find it, `nonlinear parameter {parameter}{unit} from A to B;`"
    )]
    InsideFunction {
        /// The source term at fault.
        term: TermId,
        /// The parameter.
        parameter: String,
        /// Its unit in brackets behind a space; nothing where none is declared.
        unit: String,
        /// The function.
        inside: String,
    },
    /// An input is multiplied by a motion or by another input, or stands inside a function, where it has to stand alone.
    #[error(
        "the input `{input}` stands in `{found}`: here it must stand alone, multiplied by parameters and constants only; logs identify and validate such a model all the same"
    )]
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
    #[error(
        "no equation has an input, and every term has an unknown parameter, so that nothing fixes the scale of the parameters: set an equation equal to an `input`, or declare what is known as a `constant`"
    )]
    NoScale {
        /// A term of the equations.
        term: Option<TermId>,
    },
    /// No equation has an input, where a machine has to be driven.
    #[error("no equation has an input, so nothing drives this model; logs of its free motion identify it all the same")]
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
            Self::Empty { term, .. } | Self::NoScale { term } => *term,
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
    /// A function of inputs, and of the motion or not.
    Driven,
    /// A factor that depends on both a parameter and the motion or an input.
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
            let (mut motion, mut driven, mut unknown) = (false, false, None);
            for leaf in model.graph.leaves(atom) {
                match model.graph.node(leaf) {
                    Node::Derivative(..) => motion = true,
                    Node::Symbol(symbol) => match model.quantity(*symbol).kind {
                        Kind::Input => driven = true,
                        Kind::Parameter => unknown = unknown.or(Some(*symbol)),
                        _ => {}
                    },
                    _ => {}
                }
            }
            match unknown {
                Some(symbol) if motion || driven => Class::Mixed(symbol),
                Some(_) => Class::Parameter,
                None if driven => Class::Driven,
                None if motion => Class::Motion,
                None => Class::Constant,
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

    /// Whether an input stands in it.
    fn is_driven(&self, model: &ExactModel) -> bool {
        self.motion.factors().any(|(&atom, _)| matches!(classify(model, atom), Class::Input(_) | Class::Driven))
    }
}

/// An equation separated into parameter and motion monomials: each pair once, in increasing order, with a nonzero
/// coefficient.
pub(crate) struct CollectedRow {
    pub(crate) name: EcoString,
    pub(crate) terms: Vec<CollectedTerm>,
    pub(crate) inputs: Vec<(Symbol, Polynomial<ExprId>)>,
}

/// A source term as a Laurent polynomial over atoms.
pub(crate) struct WrittenTerm {
    pub(crate) id: TermId,
    pub(crate) polynomial: Polynomial<ExprId>,
}

/// The collected source terms of an equation, on its left-hand side.
#[derive(Default)]
pub(crate) struct Gathered {
    /// Terms in any order; a pair of parameter side and motion side may occur several times.
    pub(crate) terms: Vec<CollectedTerm>,
    /// Inputs that stand alone.
    pub(crate) inputs: BTreeMap<Symbol, Applied>,
}

/// An input of an equation with its factor there.
pub(crate) struct Applied {
    /// The input as an atom.
    pub(crate) atom: ExprId,
    /// Its factor, of parameters and constants.
    pub(crate) factor: Polynomial<ExprId>,
    /// The first source term that has it.
    pub(crate) source: TermId,
}

impl Applied {
    pub(crate) fn new(atom: ExprId, source: TermId) -> Self {
        Self { atom, factor: Polynomial::zero(), source }
    }

    /// Whether the factor has unknown parameters.
    fn is_unknown(&self, model: &ExactModel) -> bool {
        let is_parameter = |(&atom, _): (&ExprId, i32)| matches!(classify(model, atom), Class::Parameter);
        self.factor.terms().any(|(monomial, _)| monomial.factors().any(is_parameter))
    }

    /// The input with its factor as terms of the left-hand side.
    fn terms<'a>(&'a self, model: &'a ExactModel) -> impl Iterator<Item = CollectedTerm> + 'a {
        let own = Monomial::power_of(self.atom, 1);
        self.factor.terms().map(move |(monomial, coefficient)| {
            let (parameters, constants) = monomial.partition(|&atom| matches!(classify(model, atom), Class::Parameter));
            let motion = constants.mul(&own);
            CollectedTerm { parameters, motion, coefficient: coefficient.clone(), source: self.source }
        })
    }
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
    let mut inputs: BTreeMap<Symbol, Applied> = BTreeMap::new();
    for source in written {
        for (monomial, coefficient) in source.polynomial.terms() {
            let mut coefficient = coefficient.clone();
            // Both are parts of a sorted list, and therefore sorted.
            let (mut parameters, mut motion) = (Factorisation::new(), Factorisation::new());
            // An input, and whether the term has nothing else that changes with time.
            let (mut input, mut alone) = (None, true);
            for (&atom, exponent) in monomial.factors() {
                match classify(model, atom) {
                    Class::Input(symbol) => {
                        alone &= exponent == 1 && input.is_none();
                        input = Some((symbol, atom));
                        motion.push((atom, exponent));
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
                    Class::Motion | Class::Driven => {
                        alone = false;
                        motion.push((atom, exponent));
                    }
                    Class::Mixed(symbol) => {
                        return Err(RegressorError::InsideFunction {
                            term: source.id,
                            parameter: model.symbol_name(symbol),
                            unit: model.bracketed_unit(symbol),
                            inside: model.display_brief(atom),
                        });
                    }
                }
            }
            let parameters: ParameterMonomial = Monomial::from_sorted(parameters);
            if let (Some((symbol, atom)), true) = (input, alone) {
                motion.retain(|(own, _)| *own != atom);
                let motion: Monomial<ExprId> = Monomial::from_sorted(motion);
                let slot = inputs.entry(symbol).or_insert_with(|| Applied::new(atom, source.id));
                slot.factor.add_term(parameters.mul(&motion), coefficient);
            } else {
                let motion: Monomial<ExprId> = Monomial::from_sorted(motion);
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
    sort(&mut terms);
    inputs.retain(|_, own| !own.factor.is_zero());
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
    let inputs = inputs.into_iter().map(|(symbol, own)| (symbol, own.factor.scale(&minus_one))).collect();
    Ok(CollectedRow { name, terms, inputs })
}

/// Sorts terms and adds up equal ones. The sort is stable, so that a pair keeps its first source term.
fn sort(terms: &mut Vec<CollectedTerm>) {
    terms.sort_by(|a, b| a.sides().cmp(&b.sides()));
    terms.dedup_by(|next, kept| {
        let same = next.sides() == kept.sides();
        if same {
            kept.coefficient += &next.coefficient;
        }
        same
    });
    terms.retain(|term| !term.coefficient.is_zero());
}

/// Divides the row by the factor of an input where every input's factor has unknown parameters, or it is the row's only one and a plain
/// number. Where inputs have unknown factors beside it, these are columns like those of other terms; so are all of them in a row of which
/// other terms have inputs too and one has no unknown parameter. A row in which no input stands alone and every term has an unknown
/// parameter shows its parameters only up to a common factor, which is that of its first term with an input.
fn normalise(
    model: &ExactModel,
    terms: &mut Vec<CollectedTerm>,
    inputs: &mut BTreeMap<Symbol, Applied>,
) -> Result<(), RegressorError> {
    let unknown = inputs.values().filter(|own| own.is_unknown(model)).count();
    let is_driven = terms.iter().any(|term| term.is_driven(model));
    let is_scaled = terms.iter().any(|term| term.parameters.is_one());
    let divisor = match inputs.values().next() {
        Some(only) if inputs.len() == 1 && unknown == 0 => {
            only.factor.as_term().filter(|(monomial, _)| monomial.is_one())
        }
        Some(_) if unknown == inputs.len() && !(is_driven && is_scaled) => {
            inputs.values().find_map(|own| own.factor.as_term())
        }
        _ => None,
    };
    match divisor.map(|(monomial, coefficient)| (monomial.clone(), coefficient.clone())) {
        Some((monomial, coefficient)) => divide(model, (terms, inputs), &monomial, &-coefficient),
        None if unknown > 0 && unknown == inputs.len() && !is_driven => {
            return Err(input_factor(model, inputs));
        }
        None => {}
    }
    for own in inputs.values().filter(|own| own.is_unknown(model)) {
        terms.extend(own.terms(model));
    }
    inputs.retain(|_, own| !own.is_unknown(model));
    sort(terms);
    if inputs.is_empty() && terms.iter().all(|term| !term.parameters.is_one()) {
        let driven = terms.iter().filter(|term| term.is_driven(model)).min_by_key(|term| term.source);
        if let Some(parameters) = driven.map(|term| term.parameters.clone()) {
            divide(model, (terms, inputs), &parameters, &rational::integer(1));
        }
    }
    Ok(())
}

/// Divides a row by a product of parameters and constants and by a number.
fn divide(
    model: &ExactModel,
    (terms, inputs): (&mut Vec<CollectedTerm>, &mut BTreeMap<Symbol, Applied>),
    monomial: &Monomial<ExprId>,
    number: &Rational,
) {
    let (inverse, scale) = (monomial.pow(-1), number.recip());
    let (parameters, constants) = inverse.partition(|&atom| matches!(classify(model, atom), Class::Parameter));
    for term in &mut *terms {
        term.coefficient *= &scale;
        term.parameters = term.parameters.mul(&parameters);
        term.motion = term.motion.mul(&constants);
    }
    sort(terms);
    for own in inputs.values_mut() {
        own.factor = own.factor.mul_monomial(&inverse).scale(&scale);
    }
}

/// The fault of a row of which no input's factor can be divided out.
fn input_factor(model: &ExactModel, inputs: &BTreeMap<Symbol, Applied>) -> RegressorError {
    let Some((&symbol, own)) = inputs.iter().next() else { return RegressorError::NoInput };
    let mut graph = model.graph.clone();
    let expr = graph.from_polynomial(&own.factor);
    RegressorError::InputFactor {
        term: own.source,
        input: model.symbol_name(symbol),
        factor: graph.display_brief(expr, model),
    }
}

/// Requires that something fixes the scale of the parameters.
///
/// # Errors
/// [`RegressorError::NoScale`] where no row has an input or a term without an unknown parameter.
pub(crate) fn require_scale(rows: &[CollectedRow]) -> Result<(), RegressorError> {
    let fixes = |row: &CollectedRow| !row.inputs.is_empty() || row.terms.iter().any(|term| term.parameters.is_one());
    if rows.iter().any(fixes) {
        return Ok(());
    }
    Err(RegressorError::NoScale { term: rows.iter().flat_map(|row| &row.terms).map(|term| term.source).min() })
}

/// Requires that a form is that of a machine which is driven, with inputs that stand alone.
///
/// # Errors
/// [`RegressorError::InputNotLinear`] with the source term of an input that does not stand alone, [`RegressorError::NoInput`] where no row has
/// an input.
pub(crate) fn require_inputs_alone(model: &ExactModel, form: &RegressorForm) -> Result<(), RegressorError> {
    if let Some((term, input)) = form.driven(model) {
        return Err(RegressorError::InputNotLinear {
            term: term.source,
            input: model.symbol_name(input),
            found: model.display_source(term.source),
        });
    }
    if form.rows.iter().all(|row| row.inputs.is_empty()) { Err(RegressorError::NoInput) } else { Ok(()) }
}
