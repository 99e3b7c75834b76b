//! The evaluation plans of a model in regressor form, which the interpreter executes and the emitters print.
//!
//! Invariant: coordinates, constants and inputs are listed in order of declaration; outputs are row-major, rows times
//! columns (regressor), rows (known) and rows times inputs (input map). The leaves of a plan are derivatives of the
//! listed coordinates and the listed constants, nothing else.

use crate::expr::graph::{Coordinate, ExprId, Symbol};
use crate::mechanics::model::ExactModel;
use crate::plan::derivatives::Derivatives;
use crate::plan::dynamics::Dynamics;
use crate::plan::entries::Entries;
use crate::plan::straight_line::Plan;
use crate::regressor::form::RegressorForm;
use serde::{Deserialize, Serialize};

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
    pub fn new(model: &ExactModel, form: &RegressorForm) -> Self {
        Self::of_entries(model, &Entries::new(model, form))
    }

    /// The plans of `form`, which belongs to `model`, and the plan of its forward dynamics: `None` where the rows are not as
    /// many as the coordinates, or not written as affine in the highest derivatives.
    #[must_use]
    pub fn with_dynamics(model: &ExactModel, form: &RegressorForm) -> (Self, Option<Dynamics>) {
        let entries = Entries::new(model, form);
        let evaluation = Self::of_entries(model, &entries);
        let dynamics = Dynamics::new(entries);
        (evaluation, dynamics)
    }

    /// The plans of `form`, which belongs to `model`, and the plans of the derivatives of its rows.
    #[must_use]
    pub fn with_derivatives(model: &ExactModel, form: &RegressorForm) -> (Self, Derivatives) {
        let entries = Entries::new(model, form);
        let evaluation = Self::of_entries(model, &entries);
        (evaluation, Derivatives::of_entries(entries, form.columns.len()))
    }

    fn of_entries(model: &ExactModel, entries: &Entries) -> Self {
        let plan = |roots: &[ExprId]| Plan::new(&entries.graph, roots);
        Self {
            coordinates: entries.coordinates.clone(),
            inputs: entries.inputs.clone(),
            constants: model.run_time_constants().collect(),
            regressor: plan(&entries.regressor),
            known: plan(&entries.known),
            input_map: plan(&entries.input_map),
        }
    }

    /// The highest time derivative of any coordinate.
    #[must_use]
    pub fn order(&self) -> u32 {
        self.coordinates.iter().map(|(_, order)| *order).max().unwrap_or(0)
    }
}
