//! The row forces of equations in their written form.
//!
//! Phi theta adds the contributions of every parameter separately, whereas a recursion adds the forces at a point
//! before it transforms them further. Where the equations were not multiplied out, the forces are therefore computed
//! from the equations, with columns substituted for the parameters. A column that stands for several proportional
//! parameters is substituted for one of them, and the others are set to zero. The column is their sum weighted by the
//! factors of proportion, so that the rows keep their values.

use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{ExprId, Graph, Node};
use crate::mechanics::model::{Equation, ExactModel, Kind};
use crate::number::rational::{self, Rational};
use crate::plan::constants::Values;
use crate::plan::draft::Draft;
use crate::plan::leaf::Leaf;
use crate::plan::straight_line::Plan;
use crate::regressor::form::{RegressorForm, Row};
use std::collections::HashMap;

/// Phi theta + known, one output per row; `None` where the equations are multiplied out, where a column is no sum of
/// parameters, and where a row was divided by a factor that is no number.
pub(crate) fn forces(model: &ExactModel, form: &RegressorForm) -> Option<Plan> {
    if form.is_expanded(&model.graph) {
        return None;
    }
    let mut written = Written::new(model, form, model.graph.clone())?;
    let mut roots = Vec::with_capacity(form.rows.len());
    for (row, equation) in model.equations.iter().enumerate() {
        let terms: Vec<ExprId> = equation.terms.iter().map(|term| written.put_in(term.expr)).collect();
        let sum = written.draft.graph.sum(&terms);
        roots.push(written.scaled(row, sum));
    }
    Some(written.draft.plan(&roots))
}

/// Converts expressions of a model's equations to the corresponding expressions of its rows.
pub(crate) struct Written {
    pub(crate) draft: Draft,
    values: Values,
    replacement: HashMap<ExprId, ExprId>,
    /// The number by which the equation of every row was multiplied.
    scales: Vec<Rational>,
}

impl Written {
    /// `graph` holds the model's and further expressions; `None` where a column is no sum of parameters, and where the rows are not the
    /// equations times numbers.
    pub(crate) fn new(model: &ExactModel, form: &RegressorForm, graph: Graph) -> Option<Self> {
        if !model.eliminations.is_empty() || form.rows.len() != model.equations.len() {
            return None;
        }
        let mut draft: Draft = Draft::new(graph);
        let mut values = Values::new(model, &mut draft.graph);
        let mut replacement: HashMap<ExprId, ExprId> = HashMap::new();
        let zero = draft.graph.integer(0);
        for symbol in model.symbols_where(|kind| matches!(kind, Kind::Parameter | Kind::Input)) {
            replacement.insert(draft.graph.symbol(symbol), zero);
        }
        for (index, column) in form.columns.iter().enumerate() {
            let (parameter, factor) = first_parameter(model, &column.definition)?;
            let theta = draft.leaf(Leaf::Column(index));
            let value = draft.graph.scale(theta, factor.recip());
            replacement.insert(parameter, value);
        }
        let mut scales = Vec::with_capacity(form.rows.len());
        for (equation, row) in model.equations.iter().zip(&form.rows) {
            scales.push(scale(&mut draft.graph, equation, row, &mut values)?);
        }
        Some(Self { draft, values, replacement, scales })
    }

    /// An expression with columns for parameters, numbers for constants and zeros for inputs.
    pub(crate) fn put_in(&mut self, expr: ExprId) -> ExprId {
        let expr = self.values.put_in(&mut self.draft.graph, expr);
        self.draft.graph.substitute_beside(expr, &mut self.replacement)
    }

    /// A subexpression of an equation, scaled as in the equation's row.
    pub(crate) fn scaled(&mut self, row: usize, expr: ExprId) -> ExprId {
        self.draft.graph.scale(expr, self.scales[row].clone())
    }
}

/// The first parameter of a sum of multiples of parameters, with its factor.
fn first_parameter(model: &ExactModel, definition: &Polynomial<ExprId>) -> Option<(ExprId, Rational)> {
    let mut found = None;
    for (monomial, factor) in definition.terms() {
        let mut factors = monomial.factors();
        let (Some((&atom, 1)), None) = (factors.next(), factors.next()) else { return None };
        let Node::Symbol(symbol) = *model.graph.node(atom) else { return None };
        if model.quantity(symbol).kind != Kind::Parameter {
            return None;
        }
        found = found.or_else(|| Some((atom, factor.clone())));
    }
    found
}

/// The number by which an equation, left minus right-hand side, became its row; `None` where it was divided by parameters.
fn scale(graph: &mut Graph, equation: &Equation, row: &Row, values: &mut Values) -> Option<Rational> {
    let Some((input, factor)) = row.inputs.first() else { return Some(rational::integer(1)) };
    let leaf = graph.symbol(*input);
    let slopes: Vec<ExprId> = equation.terms.iter().map(|term| graph.differentiate(term.expr, leaf)).collect();
    let slope = graph.sum(&slopes);
    let slope = values.put_in(graph, slope);
    let slope = graph.polynomial(slope);
    // The input was moved to the other side.
    let (_, of_row) = factor.terms().next()?;
    let (_, of_equation) = slope.terms().next()?;
    let scale = -(of_row / of_equation);
    (slope.scale(&-scale.clone()) == *factor).then_some(scale)
}
