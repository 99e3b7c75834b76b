//! The entries of the equations as text, generated once for all places that print them.

use std::collections::BTreeMap;
use tpm_symbolic::algebra::polynomial::Polynomial;
use tpm_symbolic::expr::graph::{Coordinate, ExprId, Symbol};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::mechanics::tree::NAMES;
use tpm_symbolic::mechanics::tree::mechanism::{Mechanism, parameter_name};
use tpm_symbolic::regressor::form::RegressorForm;

/// Most leaves and operations of a printed formula of an entry that was not multiplied out.
const LONGEST_FORMULA: f64 = 40.0;

/// Explanation of the formulas of a recursion.
pub(super) const RECURSION: &str = "Entries follow from recursive Newton-Euler. `S(q, b).W(p, b)` is the power of a wrench along a screw, both about the \
     origin of the frame of the body b: S(q, b) is the velocity of that frame when the joint of q alone moves at a unit rate, W(p, b) \
     the force and the moment that a unit of the inertia parameter p of b needs under the motion of b, gravity included.";

/// The entries of the equations in the model language. A long entry that was not multiplied out is given by its formula
/// in the recursion of the mechanism, or by the quantities on which it depends.
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
    pub(super) fn new(
        model: &ExactModel,
        form: &RegressorForm,
        inputs: &[Symbol],
        mechanism: Option<&Mechanism>,
    ) -> Self {
        let longest = if form.is_expanded(&model.graph) { f64::INFINITY } else { LONGEST_FORMULA };
        let mut graph = model.graph.clone();
        let mut display = |polynomial: &Polynomial<ExprId>| {
            let expr = graph.from_polynomial(polynomial);
            let text = graph.display_short(expr, longest, model);
            // The text of a product lists factors in the order in which they were added to the graph, which other texts
            // must not change.
            graph.truncate(model.graph.len());
            text
        };
        let mut formulas = Self { entries: Vec::new(), known: Vec::new(), inputs: Vec::new() };
        let recursion = mechanism.filter(|_| longest.is_finite()).map(|mechanism| Recursion::new(model, mechanism));
        for (r, row) in form.rows.iter().enumerate() {
            let mut sums: BTreeMap<Option<usize>, Polynomial<ExprId>> = BTreeMap::new();
            for term in &row.terms {
                sums.entry(term.column).or_default().add_term(term.atoms.clone(), term.coefficient.clone());
            }
            let mut entry = |column: Option<usize>| display(&sums.remove(&column).unwrap_or_default());
            let of_column = |column: usize| {
                let text = entry(Some(column));
                let formula = recursion.as_ref().filter(|_| text.starts_with("f("));
                let formula = formula.and_then(|recursion| recursion.entry(r, &form.columns[column].definition));
                formula.unwrap_or(text)
            };
            formulas.entries.push((0..form.columns.len()).map(of_column).collect());
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

/// Names from which the formulas of a mechanism's rows are written.
struct Recursion<'a> {
    /// The coordinate of every row.
    coordinates: Vec<&'a str>,
    /// The inertia parameter and the body to which a symbol of the model belongs.
    inertias: BTreeMap<ExprId, (&'static str, &'a str)>,
}

impl<'a> Recursion<'a> {
    fn new(model: &'a ExactModel, mechanism: &'a Mechanism) -> Self {
        let mut moved: Vec<Coordinate> =
            mechanism.tree.bodies().iter().filter_map(|body| body.joint.coordinate()).collect();
        moved.sort_unstable();
        moved.dedup();
        let coordinates = moved.iter().map(|place| model.coordinates[place.0 as usize].name.as_str()).collect();
        let mut graph = model.graph.clone();
        let symbols: BTreeMap<&str, Symbol> =
            model.parameters().map(|symbol| (model.quantity(symbol).name.as_str(), symbol)).collect();
        let mut inertias = BTreeMap::new();
        for label in &mechanism.labels {
            for name in NAMES {
                if let Some(&symbol) = symbols.get(parameter_name(name, &label.name).as_str()) {
                    inertias.insert(graph.symbol(symbol), (name, label.name.as_str()));
                }
            }
        }
        Self { coordinates, inertias }
    }

    /// The entry of a row in the column of an inertia parameter.
    fn entry(&self, row: usize, column: &Polynomial<ExprId>) -> Option<String> {
        let (coordinate, (monomial, _)) = (self.coordinates.get(row)?, column.terms().next()?);
        let (name, body) = self.inertias.get(monomial.factors().next()?.0)?;
        Some(format!("S({coordinate}, {body}).W({name}, {body})"))
    }
}
