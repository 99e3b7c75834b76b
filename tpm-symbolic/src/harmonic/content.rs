//! Harmonic content: how high the harmonics of every input reach, term by term (Feng, Eqns 2.22-2.28, corrected).
//!
//! Under the rest-to-rest pattern of order 2l+1 a product x'^i x^j reaches harmonic (2l+1)(i+j), so that an input made
//! of such products reaches (2l+1) max(1, max{i+j}), the 1 being the inertia's. Eqn 2.28 has 3(p+q) with the highest
//! exponents p and q taken separately, which is right only when both stand in one term. Nothing here relies on either
//! formula: the content is read off the exact expansion, of any pattern.

use crate::harmonic::expand::{ExpandError, expand};
use crate::harmonic::table::HarmonicTable;
use crate::mechanics::model::{Model, TermId};
use crate::mechanics::pattern::Pattern;
use crate::regressor::form::{Column, RegressorForm, Row, Term};
use ecow::EcoString;
use serde::{Deserialize, Serialize};

/// The harmonics of one term of an input.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TermContent {
    /// The column's name; `None` for a term without unknown parameters.
    pub parameter: Option<String>,
    /// The motion of the term, in the model language.
    pub motion: String,
    /// The harmonics with a coefficient that is not zero, increasing.
    pub harmonics: Vec<usize>,
    /// A source term it came from.
    pub source: TermId,
}

/// The harmonics of one input.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputContent {
    /// The equation's name, which is the input's where it has one.
    pub equation: String,
    /// The highest harmonic for parameters in general position, 0 when the input is constant.
    pub highest: usize,
    /// The terms, in the order of the form.
    pub terms: Vec<TermContent>,
}

/// The harmonic content of every input of a model in regressor form.
///
/// # Errors
/// As [`expand`].
pub fn harmonic_content(
    model: &Model,
    form: &RegressorForm,
    pattern: &Pattern,
) -> Result<Vec<InputContent>, ExpandError> {
    // Every term gets a column of its own, so that the table keeps them apart.
    let mut columns: Vec<Column> = Vec::new();
    let mut rows: Vec<Row> = Vec::with_capacity(form.rows.len());
    for row in &form.rows {
        let terms = row.terms.iter().map(|term| {
            let own = Term { column: Some(columns.len()), ..term.clone() };
            columns.push(Column {
                name: EcoString::new(),
                unit: None,
                definition: crate::algebra::polynomial::Polynomial::zero(),
                parameter: None,
            });
            own
        });
        rows.push(Row { name: row.name.clone(), terms: terms.collect(), inputs: row.inputs.clone() });
    }
    let table = expand(model, &RegressorForm { columns, rows }, pattern)?;
    let whole = expand(model, form, pattern)?;
    let mut harmonics: Vec<Vec<usize>> = vec![Vec::new(); form.rows.iter().map(|row| row.terms.len()).sum()];
    for entry in table.entries() {
        if let Some(column) = entry.column {
            harmonics[column].push(entry.harmonic);
        }
    }
    let mut graph = model.graph.clone();
    let mut next = harmonics.into_iter();
    let inputs = form.rows.iter().enumerate().map(|(equation, row)| {
        let terms = row.terms.iter().map(|term| {
            let mut harmonics = next.next().expect("invariant: one list for every term");
            harmonics.dedup();
            let factors: Vec<_> = term.atoms.factors().map(|(&atom, exponent)| (atom, exponent)).collect();
            let factors: Vec<_> = factors.into_iter().map(|(atom, exponent)| graph.pow(atom, exponent)).collect();
            let motion = graph.product(&factors);
            TermContent {
                parameter: term.column.map(|column| form.columns[column].name.to_string()),
                motion: graph.display(motion, model),
                harmonics,
                source: term.source,
            }
        });
        let terms = terms.collect();
        InputContent { equation: row.name.to_string(), highest: whole.highest_harmonic(equation), terms }
    });
    Ok(inputs.collect())
}

/// A harmonic of an input beyond what a drive or a sensor can follow.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HighHarmonic {
    /// The equation's name.
    pub equation: String,
    /// The harmonic.
    pub harmonic: usize,
    /// The columns that have it.
    pub parameters: Vec<String>,
}

/// The harmonics of the inputs above a limit, both frequencies in the same unit.
#[must_use]
pub fn above(table: &HarmonicTable, fundamental: f64, limit: f64) -> Vec<HighHarmonic> {
    let mut found: Vec<HighHarmonic> = Vec::new();
    for entry in table.entries().filter(|entry| entry.harmonic as f64 * fundamental > limit) {
        let equation = &table.equations[entry.equation];
        let same = |high: &HighHarmonic| high.equation == *equation && high.harmonic == entry.harmonic;
        if !found.last().is_some_and(same) {
            let parameters = Vec::new();
            found.push(HighHarmonic { equation: equation.to_string(), harmonic: entry.harmonic, parameters });
        }
        if let (Some(last), Some(column)) = (found.last_mut(), entry.column) {
            let name = &table.parameters[column];
            if !last.parameters.iter().any(|known| known == name) {
                last.parameters.push(name.to_string());
            }
        }
    }
    found
}
