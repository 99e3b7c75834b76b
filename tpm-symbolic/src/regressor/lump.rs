//! Lumped parameters: parameter monomials that share a column, and the names of the columns.
//!
//! Products of parameters become lumped parameters, and parameters whose regressors are proportional over all rows are merged
//! into one, since no motion could ever tell them apart. Where theta_k has the regressor of theta_j times r, the column is
//! theta_j + r theta_k.

use crate::algebra::fraction::display_polynomial;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::{ExprId, Node, Symbol};
use crate::mechanics::model::{ExactModel, TermId};
use crate::mechanics::unit::Unit;
use crate::number::rational::{self, Rational};
use crate::regressor::collect::{CollectedRow, CollectedTerm, ParameterMonomial};
use crate::regressor::entries::{Column, RegressorForm, Row, Term};
use crate::regressor::traces::{Direction, Traces};
use num_traits::One;
use smallvec::{SmallVec, smallvec};
use std::collections::{BTreeMap, BTreeSet};

/// A merged column: sum of ratio * parameter monomial, with the regressor of the first.
pub(crate) struct Group {
    members: SmallVec<[(ParameterMonomial, Rational); 1]>,
}

/// A parameter monomial's regressor over all equations: its terms, row by row.
type Regressor<'a> = SmallVec<[(usize, &'a [CollectedTerm]); 2]>;

/// The ratio of `regressor` to `first`, when the two are proportional.
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

/// Parameter monomials with their regressors, in the order of their first appearance: by row, then by source term.
fn regressors(rows: &[CollectedRow]) -> Vec<(&ParameterMonomial, Regressor<'_>)> {
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
    order.into_iter().map(|(parameters, _, regressor)| (parameters, regressor)).collect()
}

/// Groups parameter monomials whose regressors are proportional over all rows; the equations are multiplied out.
pub(crate) fn merge_proportional(rows: &[CollectedRow]) -> Vec<Group> {
    let order = regressors(rows);
    // Groups, each with the regressor of its first member.
    let mut groups: Vec<(Group, &Regressor<'_>)> = Vec::with_capacity(order.len());
    // Groups by the row and the motion monomial of their first term.
    let mut seen: BTreeMap<(usize, &Monomial<ExprId>), SmallVec<[usize; 1]>> = BTreeMap::new();
    for (parameters, regressor) in &order {
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

/// Groups parameter monomials whose regressors are proportional over all rows, according to their traces; the equations
/// are in their written form.
pub(crate) fn merge_by_traces(rows: &[CollectedRow], traces: &Traces<'_>) -> Vec<Group> {
    let directions = traces.directions(rows);
    let mut groups: Vec<Group> = Vec::new();
    let mut seen: BTreeMap<&Direction, usize> = BTreeMap::new();
    for (parameters, regressor) in regressors(rows) {
        let direction = directions.get(parameters);
        let known = direction.and_then(|direction| seen.get(direction)).copied();
        let ratio = known.and_then(|group| {
            let first = &groups[group].members[0].0;
            Some((group, traces.ratio(&rows[regressor.first()?.0], parameters, first)?))
        });
        match ratio {
            Some((group, ratio)) => groups[group].members.push((parameters.clone(), ratio)),
            None => {
                if let Some(direction) = direction {
                    seen.insert(direction, groups.len());
                }
                groups.push(Group { members: smallvec![(parameters.clone(), Rational::one())] });
            }
        }
    }
    groups
}

/// The groups of the columns of a form.
pub(crate) fn groups_of(columns: &[Column]) -> Vec<Group> {
    let group = |column: &Column| {
        let mut members: SmallVec<[(ParameterMonomial, Rational); 1]> =
            column.definition.terms().map(|(monomial, ratio)| (monomial.clone(), ratio.clone())).collect();
        // The regressor of the column is that of a member with the factor one.
        members.sort_by_key(|(_, ratio)| !ratio.is_one());
        Group { members }
    };
    columns.iter().map(group).collect()
}

/// The form with a column for every group of parameter monomials.
pub(crate) fn assemble(model: &ExactModel, rows: Vec<CollectedRow>, groups: Vec<Group>) -> RegressorForm {
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
        let unit = match symbol {
            Some(symbol) => model.quantity(symbol).unit.clone(),
            None => first.as_ref().and_then(|monomial| monomial_unit(model, monomial)).map(Unit::with_torque),
        };
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
                // Both lists are in ascending order.
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
        // The sort is stable: terms of one column stay in the order of their motion monomials.
        terms.sort_by_key(|term| term.column);
        Row { name: row.name, terms, inputs: row.inputs }
    });
    RegressorForm { rows: rows.collect(), columns }
}

/// All names that the model already has.
pub(crate) fn names(model: &ExactModel) -> BTreeSet<String> {
    let symbols = model.symbols.iter().map(|quantity| quantity.name.to_string());
    symbols.chain(model.coordinates.iter().map(|coordinate| coordinate.name.clone())).collect()
}

fn monomial_unit(model: &ExactModel, monomial: &ParameterMonomial) -> Option<Unit> {
    let mut unit = Unit::one();
    for (&atom, exponent) in monomial.factors() {
        let Node::Symbol(symbol) = model.graph.node(atom) else { return None };
        unit = unit.mul(&model.quantity(*symbol).unit.as_ref()?.pow(exponent));
    }
    Some(unit)
}

/// The user's name when `lump` gives one, otherwise the canonical expression, with long numbers shortened, spelled as
/// an identifier.
fn lumped_name(model: &ExactModel, definition: &Polynomial<ExprId>, taken: &mut BTreeSet<String>) -> String {
    for lump in &model.lumps {
        if model.graph.polynomial(lump.expr) == *definition {
            taken.insert(lump.name.clone());
            return lump.name.clone();
        }
    }
    // Measured numbers, such as lengths, give ratios whose last digits are of no interest.
    let readable: Polynomial<ExprId> =
        definition.terms().map(|(monomial, ratio)| (monomial.clone(), rational::readable(ratio))).collect();
    let mut name = identifier(&canonical(model, &readable));
    while !taken.insert(name.clone()) {
        name.push('_');
    }
    name
}

/// The canonical expression of a lumped parameter: factors and terms in order of declaration, such as `m2*c2^2`.
#[must_use]
pub fn canonical(model: &ExactModel, definition: &Polynomial<ExprId>) -> String {
    // The first member comes first in the text. The polynomial's own order is that of declaration, since symbols are
    // interned in that order.
    display_polynomial(definition, |&atom| match model.graph.node(atom) {
        Node::Symbol(_) | Node::Function(..) | Node::Pi | Node::Atan2(..) => model.display(atom),
        _ => format!("({})", model.display(atom)),
    })
}

/// `m2*c2^2` as `m2_c2_2`, `J1 + m2*l1^2` as `J1_plus_m2_l1_2`, `1/b` as `lumped_1_per_b`.
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
    let name = name.trim_matches('_');
    // No target language accepts a name that begins with a digit.
    if name.starts_with(char::is_numeric) { format!("lumped_{name}") } else { name.to_owned() }
}
