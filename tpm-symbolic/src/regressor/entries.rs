//! What a regressor form consists of: columns, and rows of terms.
//!
//! Invariants of [`RegressorForm`]: terms of a row are sorted by column, then monomial, with no zero coefficient and no
//! two terms of equal column and monomial; no column is empty; a row with a single input, whose coefficient is rational,
//! is scaled so that this coefficient is 1.

use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::{ExprId, Symbol};
use crate::mechanics::model::TermId;
use crate::mechanics::unit::Unit;
use crate::number::rational::Rational;
use ecow::EcoString;
use serde::{Deserialize, Serialize};

/// A parameter that is estimated: one of the model's own, or a lumped one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// The name, usable as an identifier.
    pub name: EcoString,
    /// The unit, when every unit that goes into it is declared.
    pub unit: Option<Unit>,
    /// The expression in the physical parameters, a Laurent polynomial over parameter symbols and parameter-only
    /// functions (atoms of the model's graph).
    pub definition: Polynomial<ExprId>,
    /// The symbol when the column is just one of the model's parameters.
    pub parameter: Option<Symbol>,
}

/// coefficient * (product of constants and motion atoms), multiplying one column, or none for a known term.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Term {
    /// Index of the column; `None` for a term without unknown parameters.
    pub column: Option<usize>,
    /// The exact factor.
    pub coefficient: Rational,
    /// Constants and motion atoms, by their ids in the model's graph.
    pub atoms: Monomial<ExprId>,
    /// A source term from which this term came.
    pub source: TermId,
}

/// One equation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Row {
    /// The input's name, or `eq1`, `eq2`, ...
    pub name: EcoString,
    /// The terms on the left-hand side.
    pub terms: Vec<Term>,
    /// The right-hand side: known factor (a polynomial over run-time constants) of every input that occurs.
    pub inputs: Vec<(Symbol, Polynomial<ExprId>)>,
}

/// The whole model in regressor form.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RegressorForm {
    /// What is estimated.
    pub columns: Vec<Column>,
    /// The equations.
    pub rows: Vec<Row>,
}
