//! The equations in base parameters: the combinations of columns that any motion can identify, and their regressor.
//!
//! A free column of the regressor is a sum of multiples of leading ones, exactly, so that Phi theta is the product of the leading
//! columns and the base parameters: every leading parameter plus the multiples of others that are lumped into it.

use crate::expr::graph::{ExprId, Graph};
use crate::mechanics::model::ExactModel;
use crate::plan::draft::Draft;
use crate::plan::evaluation::Evaluation;
use crate::plan::leaf::Leaf;
use crate::plan::straight_line::{Merger, Plan};
use crate::regressor::base_parameters::{BaseParameter, BaseParameterError, Motions, base_parameters};
use crate::regressor::form::RegressorForm;
use thiserror::Error;

/// The plans in base parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BasePlan {
    /// The base parameters, in the order of their leading columns.
    pub parameters: Vec<BaseParameter>,
    /// The leading columns of Phi, rows times base parameters.
    pub regressor: Plan,
    /// The base parameters from the columns' parameters.
    pub lumping: Plan,
}

/// Why equations have no base parameters.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BasePlanError {
    /// The rank could not be determined.
    #[error(transparent)]
    Rank(#[from] BaseParameterError),
    /// The combinations have no exact factors.
    #[error(
        "the base parameters depend on constants without a value, or on sines of angles that are no rational numbers; write values of constants and right angles in the model for code in base parameters"
    )]
    Constants,
    /// No parameter acts on any row.
    #[error("no motion shows a parameter")]
    None,
}

impl BasePlan {
    /// The plans of a model in regressor form, whose evaluation is `evaluation`.
    ///
    /// # Errors
    /// When the equations have no value at any motion, the base parameters depend on constants without a value, or there is none.
    pub fn new(model: &ExactModel, form: &RegressorForm, evaluation: &Evaluation) -> Result<Self, BasePlanError> {
        let found = base_parameters(model, form, &Motions::default())?;
        let parameters = found.base.ok_or(BasePlanError::Constants)?;
        if parameters.is_empty() {
            return Err(BasePlanError::None);
        }
        let mut merger = Merger::default();
        let entries = merger.append(&evaluation.regressor);
        let columns = form.columns.len();
        let leading = |row: usize| parameters.iter().map(move |base| row * columns + base.column);
        let outputs = (0..form.rows.len()).flat_map(leading).map(|place| entries[place]).collect();
        let regressor = merger.finish(outputs);
        let mut draft: Draft = Draft::new(Graph::new());
        let mut roots: Vec<ExprId> = Vec::with_capacity(parameters.len());
        for base in &parameters {
            let mut terms = vec![draft.leaf(Leaf::Column(base.column))];
            for (column, factor) in &base.others {
                let other = draft.leaf(Leaf::Column(*column));
                terms.push(draft.graph.scale(other, factor.clone()));
            }
            roots.push(draft.graph.sum(&terms));
        }
        Ok(Self { regressor, lumping: draft.plan(&roots), parameters })
    }
}
