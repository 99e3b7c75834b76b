//! The entries of the equations as text, made once for all the places that show them.

use std::collections::BTreeMap;
use tpm_symbolic::algebra::polynomial::Polynomial;
use tpm_symbolic::expr::graph::{ExprId, Symbol};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::regressor::form::RegressorForm;

/// The most leaves and operations of a formula above an entry that was not multiplied out.
const LONGEST_FORMULA: f64 = 40.0;

/// The entries of the equations as the model language writes them; of a long one that was not multiplied out, what it depends on.
#[derive(Clone, Debug)]
pub(super) struct Formulas {
    /// The regressor, row by row.
    entries: Vec<Vec<String>>,
    /// The terms without an unknown parameter, one sum per row.
    known: Vec<String>,
    /// The factors of the inputs, row by row.
    inputs: Vec<Vec<String>>,
}

impl Formulas {
    pub(super) fn new(model: &ExactModel, form: &RegressorForm, inputs: &[Symbol]) -> Self {
        let longest = if form.is_expanded(&model.graph) { f64::INFINITY } else { LONGEST_FORMULA };
        let mut graph = model.graph.clone();
        let mut display = |polynomial: &Polynomial<ExprId>| {
            let expr = graph.from_polynomial(polynomial);
            let text = graph.display_short(expr, longest, model);
            // The order of factors in a text is that in which the graph has met them, which no other text may change.
            graph.truncate(model.graph.len());
            text
        };
        let mut formulas = Self { entries: Vec::new(), known: Vec::new(), inputs: Vec::new() };
        for row in &form.rows {
            let mut sums: BTreeMap<Option<usize>, Polynomial<ExprId>> = BTreeMap::new();
            for term in &row.terms {
                sums.entry(term.column).or_default().add_term(term.atoms.clone(), term.coefficient.clone());
            }
            let mut entry = |column: Option<usize>| display(&sums.remove(&column).unwrap_or_default());
            formulas.entries.push((0..form.columns.len()).map(|column| entry(Some(column))).collect());
            formulas.known.push(entry(None));
            let factor =
                |input: &Symbol| row.inputs.iter().find(|(symbol, _)| symbol == input).map(|(_, factor)| factor);
            let factors = inputs.iter().map(|input| factor(input).map_or_else(|| "0".to_owned(), &mut display));
            formulas.inputs.push(factors.collect());
        }
        formulas
    }

    /// The entry of the regressor in a row and column, or the known terms.
    pub(super) fn entry(&self, row: usize, column: Option<usize>) -> &str {
        column.map_or(&self.known[row], |column| &self.entries[row][column])
    }

    /// The factor of an input in a row.
    pub(super) fn input_factor(&self, row: usize, input: usize) -> &str {
        &self.inputs[row][input]
    }
}
