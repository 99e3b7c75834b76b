//! The entries of the regressor, of the known terms and of the input map, as expressions.

use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{Coordinate, ExprId, Graph, Node, Symbol};
use crate::mechanics::model::ExactModel;
use crate::plan::constants::substitute_values;
use crate::plan::factored;
use crate::regressor::form::RegressorForm;
use std::collections::BTreeMap;

/// The expressions from which the plans are compiled.
pub(crate) struct Entries {
    pub(crate) graph: Graph,
    /// The coordinates that the rows use, each with its highest time derivative there.
    pub(crate) coordinates: Vec<(Coordinate, u32)>,
    pub(crate) inputs: Vec<Symbol>,
    /// The regressor, rows times columns.
    pub(crate) regressor: Vec<ExprId>,
    /// The known terms, one per row.
    pub(crate) known: Vec<ExprId>,
    /// The input map, rows times inputs.
    pub(crate) input_map: Vec<ExprId>,
}

impl Entries {
    pub(crate) fn new(model: &ExactModel, form: &RegressorForm) -> Self {
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
}
