//! The sizes of the estimator of a run, as literals.

use proc_macro2::Literal;

use super::super::run::RunPlan;
use super::record::count;

/// The sizes of a run, as literals.
pub(super) struct Sizes {
    pub(super) coordinates: Literal,
    pub(super) inputs: Literal,
    pub(super) channels: Literal,
    pub(super) rows: Literal,
    pub(super) parameters: Literal,
    pub(super) motion: Literal,
    pub(super) lines: Literal,
    pub(super) equations: Literal,
    pub(super) covariances: Literal,
}

impl Sizes {
    pub(super) fn of(plan: &RunPlan<'_>) -> Self {
        let evaluation = &plan.source.plan.evaluation;
        let (coordinates, inputs) = (evaluation.coordinates.len(), evaluation.inputs.len());
        Self {
            coordinates: count(coordinates),
            inputs: count(inputs),
            channels: count(coordinates + inputs),
            rows: count(plan.source.form.rows.len()),
            parameters: count(plan.source.form.columns.len()),
            motion: count(plan.motion.len()),
            lines: count(plan.lines()),
            equations: count(plan.equations()),
            covariances: count(plan.covariances()),
        }
    }
}
