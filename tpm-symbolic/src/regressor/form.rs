//! The model sorted into its parameters: Phi(q, q', ...) theta + known = B u, row by row.
//!
//! Every term of an equation is a rational number times powers of parameters, constants and motion atoms (derivatives
//! of coordinates and functions of them). Products of parameters become *lumped* parameters, so that the result is
//! linear in what is estimated, and parameters whose regressors are proportional everywhere are merged into one, since
//! no motion could ever tell them apart. The map from physical to lumped parameters is kept exactly.
//!
//! Invariants of [`RegressorForm`]: terms of a row are sorted by column, then monomial, with no zero coefficient and no
//! two terms of equal column and monomial; no column is empty; a row with inputs that have only rational coefficients
//! and just one input is scaled so that this coefficient is 1.

use crate::algebra::fraction::display_polynomial;
use crate::algebra::monomial::{Factorisation, Monomial};
use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{ExprId, Names, Node, Symbol};
use crate::mechanics::model::{Kind, Model, TermId};
use crate::mechanics::unit::Unit;
use crate::number::rational::{self, Rational};
use ecow::EcoString;
use num_traits::{One, Zero};
use serde::{Deserialize, Serialize};
use smallvec::{SmallVec, smallvec};
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;

/// A parameter that is estimated: one of the model's own, or a lumped one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// The name, usable as an identifier.
    pub name: EcoString,
    /// The unit, when every unit that goes into it is declared.
    pub unit: Option<Unit>,
    /// The expression in the physical parameters, a Laurent polynomial over parameter symbols and parameter-only
    /// functions (atoms of the model's graph).
    pub definition: Polynomial<ExprId>,
    /// The symbol when the column is just one of the model's parameters.
    pub parameter: Option<Symbol>,
}

/// coefficient * (product of constants and motion atoms), multiplying one column, or none for a known term.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Term {
    /// Index of the column; `None` for a term without unknown parameters.
    pub column: Option<usize>,
    /// The exact factor.
    pub coefficient: Rational,
    /// Constants and motion atoms, by their ids in the model's graph.
    pub atoms: Monomial<ExprId>,
    /// A source term that it came from.
    pub source: TermId,
}

/// One equation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Row {
    /// The input's name, or `eq1`, `eq2`, ...
    pub name: EcoString,
    /// The terms on the left-hand side.
    pub terms: Vec<Term>,
    /// The right-hand side: known factor (a polynomial over run-time constants) of every input that occurs.
    pub inputs: Vec<(Symbol, Polynomial<ExprId>)>,
}

/// The whole model in regressor form.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RegressorForm {
    /// What is estimated.
    pub columns: Vec<Column>,
    /// The equations.
    pub rows: Vec<Row>,
}

/// Why a model has no regressor form.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum RegressorError {
    /// A parameter stands inside a function of the motion.
    #[error("the model is not linear in `{parameter}`: it stands inside `{inside}`, which depends on the motion")]
    InsideFunction {
        /// Where.
        term: TermId,
        /// Which parameter.
        parameter: String,
        /// The function.
        inside: String,
    },
    /// An input is multiplied by a motion or by another input, or stands inside a function.
    #[error("the input `{input}` must stand alone, multiplied by parameters and constants only, not as in `{found}`")]
    InputNotLinear {
        /// Where.
        term: TermId,
        /// Which input.
        input: String,
        /// The term as it was found.
        found: String,
    },
    /// The factor of an input depends on unknown parameters and cannot be divided out.
    #[error(
        "the factor `{factor}` of the input `{input}` has unknown parameters and cannot be divided out of its equation; declare them as constants"
    )]
    InputFactor {
        /// Where.
        term: TermId,
        /// Which input.
        input: String,
        /// Its factor.
        factor: String,
    },
    /// No equation has an input.
    #[error("no equation has an input, so nothing fixes the scale of the parameters")]
    NoInput,
    /// Nothing is left of an equation.
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
            Self::InsideFunction { term, .. } | Self::InputNotLinear { term, .. } | Self::InputFactor { term, .. } => {
                Some(*term)
            }
            Self::Empty { term, .. } => *term,
            Self::NoInput => None,
        }
    }
}

/// What a factor of a term is.
enum Class {
    Input(Symbol),
    Parameter,
    /// A constant known exactly.
    Value(Rational),
    /// A run-time constant, pi, or a function of constants.
    Constant,
    Motion,
    /// Depends on both a parameter (or input) and the motion.
    Mixed(Symbol),
}

fn classify(model: &Model, atom: ExprId) -> Class {
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
type ParameterMonomial = Monomial<ExprId>;

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

/// An equation sorted into parameter and motion monomials: each pair once, in increasing order, with a coefficient that is
/// not zero.
pub(crate) struct CollectedRow {
    pub(crate) name: EcoString,
    pub(crate) terms: Vec<CollectedTerm>,
    pub(crate) inputs: Vec<(Symbol, Polynomial<ExprId>)>,
}

/// A source term as a Laurent polynomial over atoms, beside the expression it was written as.
pub(crate) struct WrittenTerm {
    pub(crate) id: TermId,
    pub(crate) source: ExprId,
    pub(crate) polynomial: Polynomial<ExprId>,
}

/// Sorts a model into its parameters.
///
/// # Errors
/// When a parameter or an input does not enter linearly, or an equation vanishes; the source term is named.
pub fn regressor_form(model: &Model) -> Result<RegressorForm, RegressorError> {
    // Equations share functions of the motion, such as the elements of an inertia matrix.
    let terms = model.equations.iter().flat_map(|equation| &equation.terms);
    let mut polynomials = model.graph.polynomials(terms.map(|term| term.expr)).into_iter();
    let mut rows = Vec::with_capacity(model.equations.len());
    for equation in &model.equations {
        let written = equation.terms.iter().zip(polynomials.by_ref()).map(|(term, polynomial)| WrittenTerm {
            id: term.id,
            source: term.expr,
            polynomial,
        });
        rows.push(collect_terms(model, &equation.name, &written.collect::<Vec<_>>())?);
    }
    if rows.iter().all(|row| row.inputs.is_empty()) {
        return Err(RegressorError::NoInput);
    }
    let groups = merge_proportional(&rows);
    Ok(assemble(model, rows, groups))
}

pub(crate) fn collect_terms(
    model: &Model,
    name: &str,
    written: &[WrittenTerm],
) -> Result<CollectedRow, RegressorError> {
    let mut terms = Vec::with_capacity(written.iter().map(|source| source.polynomial.len()).sum());
    // input -> (factor monomial -> coefficient), on the left-hand side
    let mut inputs: BTreeMap<Symbol, (Polynomial<ExprId>, TermId)> = BTreeMap::new();
    for source in written {
        for (monomial, coefficient) in source.polynomial.terms() {
            let mut coefficient = coefficient.clone();
            // Both are parts of a sorted list and stay sorted.
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
                            inside: model.display(atom),
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
    // Stable, so that the first source of a pair stays.
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
        let term = written.first().map(|term| term.id);
        return Err(RegressorError::Empty { name: name.to_owned(), term });
    }
    normalise(model, &mut terms, &mut inputs)?;
    let name = match inputs.len() {
        1 => inputs.keys().next().map_or_else(EcoString::new, |symbol| model.quantity(*symbol).name.clone()),
        _ => name.into(),
    };
    // The input moves to the right-hand side.
    let minus_one = rational::integer(-1);
    let inputs = inputs.into_iter().map(|(symbol, (factor, _))| (symbol, factor.scale(&minus_one))).collect();
    Ok(CollectedRow { name, terms, inputs })
}

/// Divides the row by the factor of its input when that factor has unknown parameters, or is the row's only one and a
/// plain number.
fn normalise(
    model: &Model,
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
                factor: graph.display(expr, model),
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
            factor: graph.display(expr, model),
        });
    }
    Ok(())
}

fn input_not_linear(model: &Model, term: TermId, symbol: Symbol, found: ExprId) -> RegressorError {
    RegressorError::InputNotLinear { term, input: model.symbol_name(symbol), found: model.display(found) }
}

/// A merged column: sum of ratio * parameter monomial, with the regressor of the first.
struct Group {
    members: SmallVec<[(ParameterMonomial, Rational); 1]>,
}

/// A parameter monomial's regressor over the whole system: its terms, row by row.
type Regressor<'a> = SmallVec<[(usize, &'a [CollectedTerm]); 2]>;

/// What `regressor` is as a multiple of `first`, when it is one.
fn multiple(regressor: &Regressor<'_>, first: &Regressor<'_>) -> Option<Rational> {
    let mut pairs = Vec::new();
    for ((row, terms), (first_row, first_terms)) in regressor.iter().zip(first) {
        if row != first_row || terms.len() != first_terms.len() {
            return None;
        }
        pairs.extend(terms.iter().zip(*first_terms));
    }
    let same_motion = regressor.len() == first.len() && pairs.iter().all(|(a, b)| a.motion == b.motion);
    let (lead, first_lead) = pairs.first().filter(|_| same_motion)?;
    let ratio = &lead.coefficient / &first_lead.coefficient;
    pairs.iter().all(|(a, b)| a.coefficient == &ratio * &b.coefficient).then_some(ratio)
}

/// Groups parameter monomials whose regressors are proportional over all rows.
fn merge_proportional(rows: &[CollectedRow]) -> Vec<Group> {
    // Columns appear as the user wrote them: by row, then by source term.
    let mut regressors: BTreeMap<&ParameterMonomial, ((usize, TermId), Regressor<'_>)> = BTreeMap::new();
    for (r, row) in rows.iter().enumerate() {
        for terms in row.terms.chunk_by(|a, b| a.parameters == b.parameters) {
            let Some(source) = terms.iter().map(|term| term.source).min() else { continue };
            if !terms[0].parameters.is_one() {
                let (_, regressor) =
                    regressors.entry(&terms[0].parameters).or_insert_with(|| ((r, source), Regressor::new()));
                regressor.push((r, terms));
            }
        }
    }
    let mut order: Vec<(&ParameterMonomial, (usize, TermId), Regressor<'_>)> =
        regressors.into_iter().map(|(parameters, (place, regressor))| (parameters, place, regressor)).collect();
    order.sort_by_key(|(_, place, _)| *place);
    // A group with the regressor of its first member.
    let mut groups: Vec<(Group, &Regressor<'_>)> = Vec::with_capacity(order.len());
    // Groups by where, and on which motion, they begin.
    let mut seen: BTreeMap<(usize, &Monomial<ExprId>), SmallVec<[usize; 1]>> = BTreeMap::new();
    for (parameters, _, regressor) in &order {
        let Some((row, terms)) = regressor.first() else { continue };
        let alike = seen.entry((*row, &terms[0].motion)).or_default();
        match alike.iter().find_map(|&group| Some((group, multiple(regressor, groups[group].1)?))) {
            Some((group, ratio)) => groups[group].0.members.push(((*parameters).clone(), ratio)),
            None => {
                alike.push(groups.len());
                groups.push((Group { members: smallvec![((*parameters).clone(), Rational::one())] }, regressor));
            }
        }
    }
    groups.into_iter().map(|(group, _)| group).collect()
}

fn assemble(model: &Model, rows: Vec<CollectedRow>, groups: Vec<Group>) -> RegressorForm {
    let single = |group: &Group| match group.members.as_slice() {
        [(monomial, ratio)] if ratio.is_one() => {
            let mut factors = monomial.factors();
            match (factors.next(), factors.next()) {
                (Some((&atom, 1)), None) => match model.graph.node(atom) {
                    Node::Symbol(symbol) => Some(*symbol),
                    _ => None,
                },
                _ => None,
            }
        }
        _ => None,
    };
    let mut indexed: Vec<(Option<Symbol>, Group)> = groups.into_iter().map(|group| (single(&group), group)).collect();
    // The model's own parameters in order of declaration, then the lumped ones as they appeared.
    indexed.sort_by_key(|(symbol, _)| (symbol.is_none(), *symbol));
    let mut taken: Option<BTreeSet<String>> = None;
    let mut columns = Vec::with_capacity(indexed.len());
    let mut position: Vec<(ParameterMonomial, usize)> = Vec::with_capacity(indexed.len());
    for (index, (symbol, group)) in indexed.into_iter().enumerate() {
        let first = group.members.first().map(|(monomial, _)| monomial.clone());
        let unit = first.as_ref().and_then(|monomial| monomial_unit(model, monomial));
        let definition: Polynomial<ExprId> = group.members.into_iter().collect();
        let name = match symbol {
            Some(symbol) => model.quantity(symbol).name.clone(),
            None => lumped_name(model, &definition, taken.get_or_insert_with(|| names(model))).into(),
        };
        // Only the first member keeps its terms: theta_first + r theta_other multiplies the first's regressor.
        position.extend(first.map(|first| (first, index)));
        columns.push(Column { name, unit, definition, parameter: symbol });
    }
    position.sort_unstable();
    let rows = rows.into_iter().map(|row| {
        let mut terms = Vec::with_capacity(row.terms.len());
        let mut at = 0;
        for CollectedTerm { parameters, motion: atoms, coefficient, source } in row.terms {
            let column = if parameters.is_one() {
                None
            } else {
                // Both lists ascend.
                while position.get(at).is_some_and(|(first, _)| *first < parameters) {
                    at += 1;
                }
                match position.get(at) {
                    Some((first, column)) if *first == parameters => Some(*column),
                    _ => continue,
                }
            };
            terms.push(Term { column, coefficient, atoms, source });
        }
        // Within a column they are sorted by what they multiply already.
        terms.sort_by_key(|term| term.column);
        Row { name: row.name, terms, inputs: row.inputs }
    });
    RegressorForm { rows: rows.collect(), columns }
}

/// All names that a model has already.
pub(crate) fn names(model: &Model) -> BTreeSet<String> {
    let symbols = model.symbols.iter().map(|quantity| quantity.name.to_string());
    symbols.chain(model.coordinates.iter().map(|coordinate| coordinate.name.clone())).collect()
}

fn monomial_unit(model: &Model, monomial: &ParameterMonomial) -> Option<Unit> {
    let mut unit = Unit::one();
    for (&atom, exponent) in monomial.factors() {
        let Node::Symbol(symbol) = model.graph.node(atom) else { return None };
        unit = unit.mul(&model.quantity(*symbol).unit.as_ref()?.pow(exponent));
    }
    Some(unit)
}

/// The user's name when one was given by `lump`, otherwise the canonical expression spelled as an identifier.
fn lumped_name(model: &Model, definition: &Polynomial<ExprId>, taken: &mut BTreeSet<String>) -> String {
    for lump in &model.lumps {
        if model.graph.polynomial(lump.expr) == *definition {
            taken.insert(lump.name.clone());
            return lump.name.clone();
        }
    }
    let mut name = identifier(&canonical(model, definition));
    while !taken.insert(name.clone()) {
        name.push('_');
    }
    name
}

/// The canonical expression of a lumped parameter: factors and terms in order of declaration, such as `m2*c2^2`.
#[must_use]
pub fn canonical(model: &Model, definition: &Polynomial<ExprId>) -> String {
    // The member that was met first leads; the polynomial's own order is by declaration, since symbols are interned so.
    display_polynomial(definition, |&atom| match model.graph.node(atom) {
        Node::Symbol(_) | Node::Function(..) | Node::Pi | Node::Atan2(..) => model.display(atom),
        _ => format!("({})", model.display(atom)),
    })
}

/// `m2*c2^2` as `m2_c2_2`, `J1 + m2*l1^2` as `J1_plus_m2_l1_2`.
fn identifier(expression: &str) -> String {
    let mut name = String::new();
    for c in expression.chars() {
        let piece = match c {
            c if c.is_alphanumeric() || c == '_' => {
                name.push(c);
                continue;
            }
            '+' => "plus",
            '-' => "minus",
            '/' => "_per_",
            '*' | '^' => "_",
            _ => "_",
        };
        if !(piece == "_" && name.ends_with('_')) {
            name.push_str(piece);
        }
    }
    let name = name.replace("__", "_");
    name.trim_matches('_').to_owned()
}
