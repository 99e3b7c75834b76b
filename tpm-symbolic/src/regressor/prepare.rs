//! Preparation of a declared model: its coordinates are eliminated and its parameters lumped to give the regressor
//! form.
//!
//! Without eliminations the result is [`regressor_form`], or [`structured_form`] where the equations are too long to be multiplied out.
//! With eliminations, every motion monomial of the remaining equations
//! gets one lumped parameter, its whole coefficient (Feng, Eqns 4.35-4.41), numbered in a documented order.
//!
//! Invariants of [`Prepared`]: every atom of `form` and every expression of `reconstructions` is in `model.graph`; two
//! lumped parameters are never rational multiples of each other.

use crate::algebra::fraction::Fraction;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::{Coordinate, ExprId, Graph, Node, Symbol};
use crate::mechanics::eliminate::{EliminateError, RemainingRow, eliminate, expression, moves, over_atoms};
use crate::mechanics::model::{ExactModel, Kind, TermId};
use crate::mechanics::unit::Unit;
use crate::number::rational::Rational;
use crate::regressor::collect::{
    CollectedRow, CollectedTerm, RegressorError, WrittenTerm, collect_terms, require_inputs_alone, require_scale,
};
use crate::regressor::form::{Column, RegressorForm, Row, Term, is_short, regressor_form, structured_form};
use crate::regressor::lump::names;
use num_traits::One;
use serde::{Deserialize, Serialize};
use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;

/// An eliminated coordinate in terms of the remaining ones: x1 = x2 + m2/k3 x2'' (Feng, Eqn 4.32).
///
/// The reference of the eliminated coordinate is computed from this expression.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reconstruction {
    /// The coordinate.
    pub coordinate: Coordinate,
    /// Its value, in the graph of the prepared model.
    pub expr: ExprId,
    /// The equation that was solved for it.
    pub equation: String,
    /// The divisor of the solution: the elimination holds where it is not zero.
    pub divisor: ExprId,
}

/// A model with its regressor form.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Prepared {
    /// The model as declared, its equations untouched; the graph also holds the atoms of `form`.
    pub model: ExactModel,
    /// The equations that remain, sorted into their parameters.
    pub form: RegressorForm,
    /// The eliminated coordinates.
    pub reconstructions: Vec<Reconstruction>,
}

/// Why a model has no regressor form.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PrepareError {
    /// A coordinate cannot be eliminated.
    #[error(transparent)]
    Eliminate(#[from] EliminateError),
    /// The equations are not linear in the parameters.
    #[error(transparent)]
    Regressor(#[from] RegressorError),
}

impl PrepareError {
    /// The source term at fault, when there is one.
    #[must_use]
    pub fn term(&self) -> Option<TermId> {
        match self {
            Self::Eliminate(error) => error.term(),
            Self::Regressor(error) => error.term(),
        }
    }
}

/// Eliminates the requested coordinates and computes the regressor form of the remaining equations.
///
/// With eliminations, the lumped parameters are numbered by their motion monomials: by the highest derivative,
/// descending (of the coordinate declared first, where two are equal); then its exponent, ascending; then the total
/// degree, ascending; then the same rule on the rest; monomials that are equal, by equation. Coefficients that are
/// rational multiples of each other are one parameter, which takes the first's place.
///
/// # Errors
/// When a coordinate cannot be eliminated, a parameter or an input does not enter linearly, or no equation has an input.
pub fn prepare(model: ExactModel) -> Result<Prepared, PrepareError> {
    let prepared = prepare_any(model)?;
    prepared.require_inputs_alone()?;
    Ok(prepared)
}

/// [`prepare`] for whoever simulates the equations: inputs may stand beside the motion, beside each other and in functions, and there may
/// be none where a term without an unknown parameter fixes the scale.
///
/// # Errors
/// When a coordinate cannot be eliminated, a parameter does not enter linearly, or nothing fixes the scale of the parameters.
pub fn prepare_any(mut model: ExactModel) -> Result<Prepared, PrepareError> {
    let targets: Vec<Coordinate> = model.eliminations.iter().flat_map(|e| e.coordinates.iter().copied()).collect();
    if targets.is_empty() {
        let form = if is_short(&model) { regressor_form(&model)? } else { structured_form(&mut model)? };
        return Ok(Prepared { model, form, reconstructions: Vec::new() });
    }
    let (remaining, solutions) = eliminate(&mut model, &targets)?;
    let mut rows = Vec::with_capacity(remaining.len());
    for row in &remaining {
        let terms = written_terms(&mut model.graph, row);
        rows.push(collect_terms(&model, &row.name, &terms)?);
    }
    require_scale(&rows)?;
    let prefix = model.eliminations.last().map_or_else(String::new, |elimination| elimination.prefix.clone());
    let form = lump(&model, rows, &prefix);
    let reconstructions = solutions.into_iter().map(|solution| Reconstruction {
        coordinate: solution.coordinate,
        expr: expression(&mut model.graph, &solution.value),
        equation: solution.equation,
        divisor: expression(&mut model.graph, &solution.divisor),
    });
    let reconstructions = reconstructions.collect();
    Ok(Prepared { model, form, reconstructions })
}

impl Prepared {
    /// Requires that every input stands alone, multiplied by parameters and constants only, and that there is one.
    ///
    /// # Errors
    /// [`PrepareError::Regressor`] with the term at fault.
    pub fn require_inputs_alone(&self) -> Result<(), PrepareError> {
        Ok(require_inputs_alone(&self.model, &self.form)?)
    }

    /// The highest time derivative of any coordinate in the regressor form.
    #[must_use]
    pub fn order(&self) -> u32 {
        let graph = &self.model.graph;
        let orders = self.form.leaves(graph).into_iter().filter_map(|leaf| match *graph.node(leaf) {
            Node::Derivative(_, order) => Some(order),
            _ => None,
        });
        orders.max().unwrap_or(0)
    }

    /// The reconstruction of a coordinate, when it was eliminated.
    #[must_use]
    pub fn reconstruction(&self, coordinate: Coordinate) -> Option<&Reconstruction> {
        self.reconstructions.iter().find(|reconstruction| reconstruction.coordinate == coordinate)
    }
}

fn derivative_orders(graph: &Graph, atom: ExprId) -> Vec<u32> {
    let order = |id: ExprId| match graph.node(id) {
        Node::Derivative(_, order) => Some(*order),
        _ => None,
    };
    match order(atom) {
        Some(order) => vec![order],
        None => graph.leaves(atom).into_iter().filter_map(order).collect(),
    }
}

/// The terms of a row as Laurent polynomials over atoms.
///
/// Sums in denominators are atoms there, so terms that cancel between source terms must cancel before: each motion
/// monomial then gets its whole coefficient, assigned to the first source term that contributes.
fn written_terms(graph: &mut Graph, row: &RemainingRow) -> Vec<WrittenTerm> {
    if row.terms.iter().all(|term| term.value.as_polynomial().is_some()) {
        let plain =
            row.terms.iter().map(|term| WrittenTerm { id: term.id, polynomial: term.value.numerator().clone() });
        return plain.collect();
    }
    let mut coefficients: BTreeMap<Monomial<ExprId>, (TermId, Fraction<ExprId>)> = BTreeMap::new();
    for term in &row.terms {
        let mut parts: BTreeMap<Monomial<ExprId>, Vec<(Monomial<ExprId>, Rational)>> = BTreeMap::new();
        for (monomial, coefficient) in term.value.numerator().terms() {
            let (motion, rest) = monomial.partition(|&atom| moves(graph, atom));
            parts.entry(motion).or_default().push((rest, coefficient.clone()));
        }
        for (motion, part) in parts {
            let part = term.value.with_numerator(part.into_iter().collect());
            let slot = coefficients.entry(motion).or_insert_with(|| (term.id, Fraction::zero()));
            slot.1 = slot.1.add(&part);
        }
    }
    let terms = coefficients
        .into_iter()
        .map(|(motion, (id, value))| WrittenTerm { id, polynomial: over_atoms(graph, &value).mul_monomial(&motion) });
    terms.collect()
}

/// A motion monomial of a row with its whole coefficient.
struct Lumped {
    row: usize,
    motion: Monomial<ExprId>,
    coefficient: Polynomial<ExprId>,
    source: TermId,
}

fn lump(model: &ExactModel, rows: Vec<CollectedRow>, prefix: &str) -> RegressorForm {
    let mut lumped: Vec<Lumped> = Vec::new();
    let mut result: Vec<Row> = Vec::with_capacity(rows.len());
    for (index, row) in rows.into_iter().enumerate() {
        let mut coefficients: BTreeMap<Monomial<ExprId>, (Polynomial<ExprId>, TermId)> = BTreeMap::new();
        let mut terms = Vec::new();
        for CollectedTerm { parameters, motion, coefficient, source } in row.terms {
            if parameters.is_one() {
                terms.push(Term { column: None, coefficient, atoms: motion, source });
            } else {
                let slot = coefficients.entry(motion).or_insert_with(|| (Polynomial::zero(), source));
                slot.0.add_term(parameters, coefficient);
                slot.1 = slot.1.min(source);
            }
        }
        lumped.extend(coefficients.into_iter().map(|(motion, (coefficient, source))| Lumped {
            row: index,
            motion,
            coefficient,
            source,
        }));
        result.push(Row { name: row.name, terms, inputs: row.inputs });
    }
    let keys: Vec<MotionKey> = lumped.iter().map(|entry| motion_key(&model.graph, &entry.motion)).collect();
    let mut order: Vec<usize> = (0..lumped.len()).collect();
    order.sort_by(|&a, &b| compare(&keys[a], &keys[b]).then(lumped[a].row.cmp(&lumped[b].row)));
    let mut taken = names(model);
    let mut columns: Vec<Column> = Vec::new();
    let mut known: BTreeMap<Polynomial<ExprId>, (usize, Rational)> = BTreeMap::new();
    for index in order {
        let Lumped { row, motion, coefficient, source } = &lumped[index];
        let lead = coefficient.terms().next().map_or_else(Rational::one, |(_, c)| c.clone());
        let direction = coefficient.scale(&lead.recip());
        let (column, ratio) = match known.get(&direction) {
            Some((column, first)) => (*column, lead / first),
            None => {
                known.insert(direction, (columns.len(), lead));
                columns.push(column(model, prefix, columns.len(), coefficient, &mut taken));
                (columns.len() - 1, Rational::one())
            }
        };
        result[*row].terms.push(Term {
            column: Some(column),
            coefficient: ratio,
            atoms: motion.clone(),
            source: *source,
        });
    }
    for row in &mut result {
        row.terms.sort_by(|a, b| (a.column, &a.atoms).cmp(&(b.column, &b.atoms)));
    }
    RegressorForm { columns, rows: result }
}

fn column(
    model: &ExactModel,
    prefix: &str,
    index: usize,
    definition: &Polynomial<ExprId>,
    taken: &mut BTreeSet<String>,
) -> Column {
    let named = model.lumps.iter().find(|lump| model.graph.polynomial(lump.expr) == *definition);
    let name = match named {
        Some(lump) => lump.name.clone(),
        None => {
            let mut name = format!("{prefix}{}", index + 1);
            while taken.contains(&name) {
                name.push('_');
            }
            name
        }
    };
    taken.insert(name.clone());
    let parameter = definition.as_term().filter(|(_, c)| c.is_one()).and_then(|(monomial, _)| {
        let mut factors = monomial.factors();
        match (factors.next(), factors.next()) {
            (Some((&atom, 1)), None) => symbol_of(model, atom),
            _ => None,
        }
    });
    let unit = match parameter {
        Some(symbol) => model.quantity(symbol).unit.clone(),
        None => definition.terms().next().and_then(|(monomial, _)| unit_of(model, monomial)).map(Unit::with_torque),
    };
    Column { name: name.into(), unit, definition: definition.clone(), parameter }
}

fn symbol_of(model: &ExactModel, atom: ExprId) -> Option<Symbol> {
    match model.graph.node(atom) {
        Node::Symbol(symbol) if model.quantity(*symbol).kind == Kind::Parameter => Some(*symbol),
        _ => None,
    }
}

/// The unit of a product; every term of a sum has the unit of the first.
fn unit_of(model: &ExactModel, monomial: &Monomial<ExprId>) -> Option<Unit> {
    let mut unit = Unit::one();
    for (&atom, exponent) in monomial.factors() {
        let factor = match model.graph.node(atom) {
            Node::Symbol(symbol) => model.quantity(*symbol).unit.clone()?,
            Node::Sum(_) => {
                let polynomial = model.graph.polynomial(atom);
                let (first, _) = polynomial.terms().next()?;
                unit_of(model, first)?
            }
            _ => return None,
        };
        unit = unit.mul(&factor.pow(exponent));
    }
    Some(unit)
}

/// A motion monomial, its factors in the order in which the numbering compares them.
type MotionKey = Vec<(Factor, i32)>;

/// A factor of a motion monomial. Derivatives come before everything else, the highest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Factor {
    Derivative(Reverse<u32>, Coordinate),
    Function(Reverse<u32>, ExprId),
    Constant(ExprId),
}

fn motion_key(graph: &Graph, monomial: &Monomial<ExprId>) -> MotionKey {
    let mut key: MotionKey = monomial
        .factors()
        .map(|(&atom, exponent)| {
            let factor = match *graph.node(atom) {
                Node::Derivative(coordinate, order) => Factor::Derivative(Reverse(order), coordinate),
                _ => match derivative_orders(graph, atom).into_iter().max() {
                    Some(order) => Factor::Function(Reverse(order), atom),
                    None => Factor::Constant(atom),
                },
            };
            (factor, exponent)
        })
        .collect();
    key.sort_unstable();
    key
}

fn compare(left: &[(Factor, i32)], right: &[(Factor, i32)]) -> Ordering {
    let degree = |key: &[(Factor, i32)]| key.iter().map(|(_, exponent)| exponent).sum::<i32>();
    match (left.split_first(), right.split_first()) {
        (None, None) => Ordering::Equal,
        // A monomial without further factors comes last.
        (None, Some(_)) => Ordering::Greater,
        (Some(_), None) => Ordering::Less,
        (Some(((a, p), rest_a)), Some(((b, q), rest_b))) => {
            a.cmp(b).then(p.cmp(q)).then(degree(left).cmp(&degree(right))).then_with(|| compare(rest_a, rest_b))
        }
    }
}
