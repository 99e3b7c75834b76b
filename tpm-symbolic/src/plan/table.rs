//! Plans of the harmonic table: the estimator matrix with the known terms, and the addends of a sample.

use crate::expr::graph::{ExprId, Function, Graph, Symbol};
use crate::harmonic::table::{Entry, HarmonicTable};
use crate::mechanics::model::ExactModel;
use crate::number::rational;
use crate::plan::bank::{TableRow, bank};
use crate::plan::constants;
use crate::plan::draft::Draft;
use crate::plan::straight_line::Plan;

/// The harmonic table and the plans derived from it.
#[derive(Clone, Debug)]
pub struct TablePlan {
    /// The table itself.
    pub table: HarmonicTable,
    /// The rows of the table.
    pub rows: Vec<TableRow>,
    /// Row and column (`None`: the terms without unknown parameters) of every output of `matrix`.
    pub places: Vec<(usize, Option<usize>)>,
    /// The entries at `places`; leaves are amplitudes, frequency and constants.
    pub matrix: Plan,
    /// The addend of a sample to the sum of every row: the equation's signal times cos or sin of `harmonic * w t`. The
    /// leaves are the signals, cos w t and sin w t.
    pub bank: Plan,
}

impl TablePlan {
    /// The plans of a table whose symbols are the model's.
    pub(crate) fn new(model: &ExactModel, table: HarmonicTable) -> Self {
        let rows = table.rows();
        let mut draft = Draft::new(Graph::new());
        let mut places: Vec<(usize, Option<usize>)> = Vec::new();
        let mut sums: Vec<Vec<ExprId>> = Vec::new();
        let mut row = 0;
        for entry in table.entries() {
            // Rows and entries are sorted alike, so one walk finds every entry's row.
            while rows[row] != (entry.equation, entry.harmonic, entry.function) {
                row += 1;
            }
            let place = (row, entry.column);
            if places.last() != Some(&place) {
                places.push(place);
                sums.push(Vec::new());
            }
            let value = entry_expr(model, &mut draft, &entry);
            if let Some(terms) = sums.last_mut() {
                terms.push(value);
            }
        }
        let roots: Vec<ExprId> = sums.iter().map(|terms| draft.graph.sum(terms)).collect();
        let matrix = draft.plan(&roots);
        let bank = bank(&rows);
        Self { table, rows, places, matrix, bank }
    }

    /// The row of an entry of the table.
    #[must_use]
    pub fn row_of(&self, entry: &Entry) -> usize {
        let found = self.rows.iter().position(|row| *row == (entry.equation, entry.harmonic, entry.function));
        found.expect("invariant: every entry has its row")
    }
}

fn entry_expr(model: &ExactModel, draft: &mut Draft, entry: &Entry) -> ExprId {
    let mut factors = vec![draft.graph.number(entry.coefficient.clone())];
    if entry.pi != 0 {
        let pi = draft.graph.pi();
        factors.push(draft.graph.pow(pi, entry.pi));
    }
    for (&symbol, exponent) in entry.powers.factors() {
        let symbol = constants::quantity(model, draft, table_symbol(symbol));
        factors.push(draft.graph.pow(symbol, exponent));
    }
    for (&symbol, exponent) in entry.sign.factors() {
        if exponent % 2 != 0 {
            let symbol = constants::quantity(model, draft, table_symbol(symbol));
            factors.push(draft.graph.function(Function::Sign, symbol));
        }
    }
    draft.graph.product(&factors)
}

/// The symbol at an index of a table's list of symbols. A table that came from expansion has the model's own list.
#[must_use]
pub fn table_symbol(index: usize) -> Symbol {
    Symbol(u32::try_from(index).expect("invariant: fewer than 2^32 symbols"))
}

/// The exact formula of one table entry, such as `-55/27*lambda1*lambda2^2*w^2`.
#[must_use]
pub fn entry_formula(table: &HarmonicTable, entry: &Entry) -> String {
    let mut above = vec![rational::display(&entry.coefficient)];
    let mut below = Vec::new();
    let powers = entry.powers.factors().map(|(&symbol, exponent)| (table.symbols[symbol].as_str(), exponent));
    for (name, exponent) in std::iter::once(("pi", entry.pi)).chain(powers) {
        match exponent {
            0 => {}
            1 => above.push(name.to_owned()),
            -1 => below.push(name.to_owned()),
            2.. => above.push(format!("{name}^{exponent}")),
            _ => below.push(format!("{name}^{}", -exponent)),
        }
    }
    for (&symbol, exponent) in entry.sign.factors() {
        if exponent % 2 != 0 {
            above.push(format!("sign({})", table.symbols[symbol]));
        }
    }
    // A factor 1 is omitted next to other factors.
    if above.len() > 1 && (above[0] == "1" || above[0] == "-1") {
        let minus = if above.remove(0) == "-1" { "-" } else { "" };
        above[0].insert_str(0, minus);
    }
    let mut text = above.join("*");
    for factor in below {
        text.push('/');
        text.push_str(&factor);
    }
    text
}
