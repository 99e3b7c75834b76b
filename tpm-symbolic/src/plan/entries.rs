//! The entries of the regressor, of the known terms and of the input map, as expressions.

use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{Coordinate, ExprId, Graph, Node, Symbol};
use crate::mechanics::model::ExactModel;
use crate::plan::constants::Values;
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
        for leaf in form.leaves(&model.graph) {
            if let Node::Derivative(coordinate, order) = *model.graph.node(leaf) {
                let highest = coordinates.entry(coordinate).or_insert(order);
                *highest = order.max(*highest);
            }
        }
        // Equations in their written form need no search for a shorter form.
        let searched = form.is_expanded(&model.graph);
        let mut values = Values::new(model, &mut graph);
        let (mut regressor, mut known, mut input_map) = (Vec::new(), Vec::new(), Vec::new());
        for (r, row) in form.rows.iter().enumerate() {
            let mut entries: BTreeMap<Option<usize>, Polynomial<ExprId>> = BTreeMap::new();
            for term in &row.terms {
                let entry = entries.entry(term.column).or_default();
                entry.add_term(term.atoms.clone(), term.coefficient.clone());
            }
            let mut entry = |graph: &mut Graph, column: Option<usize>| {
                let polynomial = entries.remove(&column).unwrap_or_default();
                let found = if searched { factored::entry(model, form, graph, (r, column), &polynomial) } else { None };
                let expr = found.unwrap_or_else(|| graph.from_polynomial(&polynomial));
                values.put_in(graph, expr)
            };
            for column in 0..form.columns.len() {
                regressor.push(entry(&mut graph, Some(column)));
            }
            known.push(entry(&mut graph, None));
            for input in &inputs {
                let factor = row.inputs.iter().find(|(symbol, _)| symbol == input).map(|(_, factor)| factor);
                let factor = graph.from_polynomial(factor.unwrap_or(&Polynomial::zero()));
                input_map.push(values.put_in(&mut graph, factor));
            }
        }
        Self { graph, coordinates: coordinates.into_iter().collect(), inputs, regressor, known, input_map }
    }
}
