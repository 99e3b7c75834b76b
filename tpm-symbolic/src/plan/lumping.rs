//! Plans of the map from physical parameters to columns, and of its inverse.

use crate::algebra::fraction::Fraction;
use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{ExprId, Graph, Symbol};
use crate::mechanics::model::ExactModel;
use crate::plan::constants::substitute_values;
use crate::plan::draft::Draft;
use crate::plan::leaf::Leaf;
use crate::plan::operation::{Op, Slot};
use crate::plan::straight_line::{Merger, Plan};
use crate::regressor::form::{Column, RegressorForm};
use crate::regressor::inverse::{Inverse, Variable};
use crate::regressor::parameter_map::ParameterMap;
use thiserror::Error;

/// Why the physical parameters cannot be computed from the columns.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum UnlumpGap {
    /// Different values of these physical parameters give the same columns.
    #[error("the estimated parameters do not determine {}", quoted(.0))]
    NotDetermined(Vec<String>),
    /// The columns determine the parameters, at least locally, but no rational function for them was found.
    #[error("no rational function of the estimated parameters was found that gives {}", quoted(.0))]
    NoClosedForm(Vec<String>),
}

fn quoted(names: &[String]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<String>>().join(", ")
}

/// The exact inverse of the lumping.
#[derive(Clone, Debug)]
pub struct Unlumping {
    /// The map from the physical parameters to the columns.
    pub map: ParameterMap,
    /// The complete inverse of `map`, which solves every parameter of the model.
    pub inverse: Inverse,
    /// The intermediate quantities of the inverse that a parameter needs.
    pub intermediates: Vec<usize>,
    /// The outputs are the `intermediates`, then the model's parameters; leaves are columns and constants.
    pub plan: Plan,
}

/// The columns from the physical parameters; `None` when every column is one of them.
pub(crate) fn lumping(model: &ExactModel, form: &RegressorForm) -> Option<Plan> {
    let (graph, columns) = lumped(model, form)?;
    Some(Plan::new(&graph, &columns))
}

/// The columns from the physical parameters, then the derivative of every column by every parameter of the model, column by column;
/// `None` when every column is a parameter.
#[must_use]
pub fn lumping_slopes(model: &ExactModel, form: &RegressorForm) -> Option<Plan> {
    let (mut graph, columns) = lumped(model, form)?;
    let parameters: Vec<ExprId> = model.parameters().map(|parameter| graph.symbol(parameter)).collect();
    let mut roots = columns.clone();
    for column in columns {
        roots.extend(parameters.iter().map(|&parameter| graph.differentiate(column, parameter)));
    }
    Some(Plan::new(&graph, &roots))
}

/// The definitions of the columns; `None` when every column is a parameter.
fn lumped(model: &ExactModel, form: &RegressorForm) -> Option<(Graph, Vec<ExprId>)> {
    if form.columns.iter().all(|column| column.parameter.is_some()) {
        return None;
    }
    let mut graph = model.graph.clone();
    let mut definition = |column: &Column| {
        let expr = graph.from_polynomial(&column.definition);
        substitute_values(model, &mut graph, expr)
    };
    let columns = form.columns.iter().map(&mut definition).collect();
    Some((graph, columns))
}

/// The physical parameters from the columns; `None` when every column is a parameter.
pub(crate) fn unlumping(model: &ExactModel, form: &RegressorForm) -> Option<Result<Unlumping, UnlumpGap>> {
    if form.columns.iter().all(|column| column.parameter.is_some()) {
        return None;
    }
    let map = ParameterMap::of(model, form);
    let inverse = map.inverse();
    let value = |parameter: Symbol| inverse.solved.iter().find(|(solved, _)| *solved == parameter).map(|(_, v)| v);
    let parameters: Vec<Symbol> = model.parameters().collect();
    let names = |chosen: &dyn Fn(Symbol) -> bool| -> Vec<String> {
        let chosen = parameters.iter().filter(|parameter| chosen(**parameter));
        chosen.map(|parameter| model.quantity(*parameter).name.to_string()).collect()
    };
    let missing = names(&|parameter| value(parameter).is_none());
    if !missing.is_empty() {
        let determined = map.local_identifiability().map(|local| local.determined).unwrap_or_default();
        let is_open = |parameter: Symbol| match map.parameters().iter().position(|own| *own == parameter) {
            Some(position) => determined.get(position) == Some(&false),
            None => true,
        };
        let open = names(&is_open);
        return Some(Err(match open.is_empty() {
            true => UnlumpGap::NoClosedForm(missing),
            false => UnlumpGap::NotDetermined(open),
        }));
    }
    // An intermediate quantity is computed from earlier ones.
    let mut needed = vec![false; inverse.intermediates.len()];
    let mark = |needed: &mut Vec<bool>, value: &Fraction<Variable>| {
        let factors = value.denominator().map(|(factor, _)| factor);
        for variable in std::iter::once(value.numerator())
            .chain(factors)
            .flat_map(Polynomial::terms)
            .flat_map(|(monomial, _)| monomial.factors().map(|(&variable, _)| variable).collect::<Vec<Variable>>())
        {
            if let Some(place) = variable.checked_sub(inverse.given()) {
                needed[place] = true;
            }
        }
    };
    inverse.solved.iter().for_each(|(_, value)| mark(&mut needed, value));
    for index in (0..inverse.intermediates.len()).rev() {
        if needed[index] {
            mark(&mut needed, &inverse.intermediates[index].value);
        }
    }
    let intermediates: Vec<usize> = (0..needed.len()).filter(|&index| needed[index]).collect();
    let mut given: Vec<Part> = (0..form.columns.len()).map(|column| Part::Given(Leaf::Column(column))).collect();
    given.extend(inverse.constants.iter().map(|&constant| Part::Given(Leaf::Symbol(constant))));
    let variables: Vec<Part> =
        given.into_iter().chain((0..inverse.intermediates.len()).map(Part::Intermediate)).collect();
    let values = intermediates.iter().map(|&index| &inverse.intermediates[index].value);
    let solved = parameters.iter().map(|&parameter| value(parameter).expect("invariant: no parameter is missing"));
    let mut draft = Draft::new(Graph::new());
    let roots: Vec<ExprId> = values.chain(solved).map(|value| fraction_expr(&mut draft, value, &variables)).collect();
    let plan = closed(&draft.plan(&roots), &intermediates);
    Some(Ok(Unlumping { map, inverse, intermediates, plan }))
}

/// A variable of the inverse: a given number, or an intermediate quantity. An intermediate stays a leaf until
/// [`closed`] connects it to the output that computes it, so that later formulas use the computed value.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    Given(Leaf),
    Intermediate(usize),
}

impl From<Leaf> for Part {
    fn from(leaf: Leaf) -> Self {
        Self::Given(leaf)
    }
}

/// The plan in which every use of an intermediate quantity refers to the output that computes it.
fn closed(open: &Plan<Part>, intermediates: &[usize]) -> Plan {
    let mut merger = Merger::default();
    let mut slots: Vec<Slot> = Vec::with_capacity(open.ops.len());
    for op in &open.ops {
        let at = |slot: Slot| slots[slot.index()];
        let slot = match op {
            Op::Load(input) => match open.inputs[*input as usize] {
                Part::Given(leaf) => merger.load(leaf),
                Part::Intermediate(index) => {
                    let output = intermediates.iter().position(|&present| present == index);
                    // The output of an intermediate quantity precedes its uses.
                    at(open.outputs[output.expect("invariant: an intermediate that is read is computed")])
                }
            },
            op => merger.emit(op.map(at)),
        };
        slots.push(slot);
    }
    merger.finish(open.outputs.iter().map(|slot| slots[slot.index()]).collect())
}

fn fraction_expr(draft: &mut Draft<Part>, value: &Fraction<Variable>, variables: &[Part]) -> ExprId {
    let power = |draft: &mut Draft<Part>, (&variable, exponent): (&Variable, i32)| {
        let base = draft.leaf(variables[variable]);
        draft.graph.pow(base, exponent)
    };
    let sum = |draft: &mut Draft<Part>, polynomial: &Polynomial<Variable>| {
        let mut terms = Vec::with_capacity(polynomial.len());
        for (monomial, coefficient) in polynomial.terms() {
            let factors: Vec<ExprId> = monomial.factors().map(|factor| power(draft, factor)).collect();
            let product = draft.graph.product(&factors);
            terms.push(draft.graph.scale(product, coefficient.clone()));
        }
        draft.graph.sum(&terms)
    };
    let (numerator, below) = value.cleared();
    let mut factors = vec![sum(draft, &numerator)];
    factors.extend(below.factors().map(|(variable, exponent)| power(draft, (variable, -exponent))));
    for (factor, exponent) in value.denominator() {
        let base = sum(draft, factor);
        factors.push(draft.graph.pow(base, -i32::try_from(exponent).expect("invariant: exponents are small")));
    }
    draft.graph.product(&factors)
}
