//! The evaluation plans of a model in regressor form: what the interpreter runs and what the emitters print.
//!
//! Invariant: coordinates, constants and inputs are listed in order of declaration; outputs are row-major, rows times
//! columns (regressor), rows (known) and rows times inputs (input map). The leaves of a plan are derivatives of the
//! listed coordinates and the listed constants, nothing else.

use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{Coordinate, ExprId, Graph, Node, Symbol};
use crate::mechanics::model::{Kind, Model};
use crate::plan::dynamics::Dynamics;
use crate::plan::factored;
use crate::plan::straight_line::Plan;
use crate::regressor::form::RegressorForm;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Plans for Phi, the known terms and the input map.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Evaluation {
    /// The coordinates that the rows use, each with its highest time derivative there.
    pub coordinates: Vec<(Coordinate, u32)>,
    /// The inputs of the model.
    pub inputs: Vec<Symbol>,
    /// The constants known at run time only.
    pub constants: Vec<Symbol>,
    /// Phi, rows times columns.
    pub regressor: Plan,
    /// The terms without unknown parameters, one per row.
    pub known: Plan,
    /// B, rows times inputs.
    pub input_map: Plan,
}

impl Evaluation {
    /// The plans of `form`, which belongs to `model`.
    #[must_use]
    pub fn new(model: &Model, form: &RegressorForm) -> Self {
        Entries::new(model, form).evaluation(model)
    }

    /// The same with the plan of the forward dynamics; `None` where the rows are not as many as the coordinates, or not written
    /// as affine in the highest derivatives.
    #[must_use]
    pub fn with_dynamics(model: &Model, form: &RegressorForm) -> (Self, Option<Dynamics>) {
        let mut entries = Entries::new(model, form);
        let evaluation = entries.evaluation(model);
        let dynamics = Dynamics::new(model, &mut entries);
        (evaluation, dynamics)
    }

    /// The highest time derivative of any coordinate.
    #[must_use]
    pub fn order(&self) -> u32 {
        self.coordinates.iter().map(|(_, order)| *order).max().unwrap_or(0)
    }
}

/// The entries behind the plans, as expressions.
pub(crate) struct Entries {
    pub(crate) graph: Graph,
    /// The coordinates that the rows use, each with its highest time derivative there.
    pub(crate) coordinates: Vec<(Coordinate, u32)>,
    pub(crate) inputs: Vec<Symbol>,
    /// Rows times columns.
    pub(crate) regressor: Vec<ExprId>,
    /// One per row.
    pub(crate) known: Vec<ExprId>,
    /// Rows times inputs.
    pub(crate) input_map: Vec<ExprId>,
}

impl Entries {
    fn new(model: &Model, form: &RegressorForm) -> Self {
        let mut graph = model.graph.clone();
        let inputs: Vec<Symbol> = model.inputs().collect();
        let mut coordinates: BTreeMap<Coordinate, u32> = BTreeMap::new();
        for atom in form.rows.iter().flat_map(|row| &row.terms).flat_map(|term| term.atoms.factors()) {
            for leaf in model.graph.leaves(*atom.0) {
                if let Node::Derivative(coordinate, order) = *model.graph.node(leaf) {
                    let highest = coordinates.entry(coordinate).or_insert(order);
                    *highest = order.max(*highest);
                }
            }
        }
        let (mut regressor, mut known, mut input_map) = (Vec::new(), Vec::new(), Vec::new());
        for (r, row) in form.rows.iter().enumerate() {
            let mut entries: BTreeMap<Option<usize>, Polynomial<ExprId>> = BTreeMap::new();
            for term in &row.terms {
                let entry = entries.entry(term.column).or_default();
                entry.add_term(term.atoms.clone(), term.coefficient.clone());
            }
            let mut entry = |graph: &mut Graph, column: Option<usize>| {
                let polynomial = entries.remove(&column).unwrap_or_default();
                let expr = match factored::entry(model, form, graph, (r, column), &polynomial) {
                    Some(expr) => expr,
                    None => graph.from_polynomial(&polynomial),
                };
                substitute_values(model, graph, expr)
            };
            for column in 0..form.columns.len() {
                regressor.push(entry(&mut graph, Some(column)));
            }
            known.push(entry(&mut graph, None));
            for input in &inputs {
                let factor = row.inputs.iter().find(|(symbol, _)| symbol == input).map(|(_, factor)| factor);
                let factor = graph.from_polynomial(factor.unwrap_or(&Polynomial::zero()));
                input_map.push(substitute_values(model, &mut graph, factor));
            }
        }
        Self { graph, coordinates: coordinates.into_iter().collect(), inputs, regressor, known, input_map }
    }

    fn evaluation(&self, model: &Model) -> Evaluation {
        let plan = |roots: &[ExprId]| Plan::new(&self.graph, roots);
        Evaluation {
            coordinates: self.coordinates.clone(),
            inputs: self.inputs.clone(),
            constants: model.run_time_constants().collect(),
            regressor: plan(&self.regressor),
            known: plan(&self.known),
            input_map: plan(&self.input_map),
        }
    }
}

/// Constants that are known exactly become numbers also inside functions, where the regressor form leaves them.
pub(crate) fn substitute_values(model: &Model, graph: &mut Graph, expr: ExprId) -> ExprId {
    let mut replacement = std::collections::HashMap::new();
    for leaf in graph.leaves(expr) {
        if let Node::Symbol(symbol) = *graph.node(leaf)
            && let Kind::Constant { value: Some(value) } = &model.quantity(symbol).kind
        {
            replacement.insert(leaf, graph.number(value.clone()));
        }
    }
    if replacement.is_empty() { expr } else { graph.substitute(expr, &replacement) }
}
