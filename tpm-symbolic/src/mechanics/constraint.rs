//! Derivatives of coordinates that follow others by constraints.
//!
//! Constraints g(x, y) = 0, as many as dependent coordinates y, make y a function of x where dg/dy is regular, with
//!
//! ```text
//! dy/dx = -(dg/dy)^-1 dg/dx ,       df/dx = @f/@x + @f/@y dy/dx ,
//! ```
//!
//! and, repeated, derivatives of every order (the loop closure of Feng, Appendix A). The matrix is inverted as its
//! adjugate over its determinant; no constraint is ever solved.

use crate::algebra::characteristic;
use crate::expr::graph::{ExprId, Graph};
use crate::expr::normal_form::NormalForms;
use crate::expr::trigonometric;
use thiserror::Error;

/// A relation between one independent leaf and the leaves that depend on it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Implicit {
    variable: ExprId,
    dependents: Vec<ExprId>,
    slopes: Vec<ExprId>,
}

/// Why constraints do not determine the dependent coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ImplicitError {
    /// The numbers of constraints and of dependent coordinates differ.
    #[error("{constraints} constraints do not determine {dependents} dependent coordinates")]
    Count {
        /// Number of constraints.
        constraints: usize,
        /// Number of dependent coordinates.
        dependents: usize,
    },
    /// The matrix dg/dy is singular everywhere.
    #[error("the constraints do not determine the dependent coordinates: their derivatives are linearly dependent")]
    Singular,
}

impl Implicit {
    /// The slopes dy/dx from constraints g = 0.
    ///
    /// # Errors
    /// When there are not as many constraints as dependents, or dg/dy is singular everywhere.
    pub fn new(
        graph: &mut Graph,
        constraints: &[ExprId],
        variable: ExprId,
        dependents: &[ExprId],
    ) -> Result<Self, ImplicitError> {
        if constraints.len() != dependents.len() {
            return Err(ImplicitError::Count { constraints: constraints.len(), dependents: dependents.len() });
        }
        let mut matrix = Vec::with_capacity(constraints.len());
        let mut column = Vec::with_capacity(constraints.len());
        for &constraint in constraints {
            let mut row = Vec::with_capacity(dependents.len());
            for &dependent in dependents {
                let slope = graph.differentiate(constraint, dependent);
                row.push(trigonometric::normal(graph, slope));
            }
            matrix.push(row);
            let slope = graph.differentiate(constraint, variable);
            column.push(vec![trigonometric::normal(graph, slope)]);
        }
        let (determinant, adjugate) = characteristic::adjugate(&mut NormalForms(graph), &matrix);
        if !dependents.is_empty() && trigonometric::numerator(graph, &determinant).is_zero() {
            return Err(ImplicitError::Singular);
        }
        let numerators = characteristic::multiply(&mut NormalForms(graph), &adjugate, &column);
        let determinant = graph.from_polynomial(&determinant);
        let mut slopes = Vec::with_capacity(dependents.len());
        for row in &numerators {
            let numerator = graph.from_polynomial(&row[0]);
            let quotient = graph.div(numerator, determinant);
            slopes.push(graph.neg(quotient));
        }
        Ok(Self { variable, dependents: dependents.to_vec(), slopes })
    }

    /// dy/dx, in the order of the dependents.
    #[must_use]
    pub fn slopes(&self) -> &[ExprId] {
        &self.slopes
    }

    /// The total derivative df/dx.
    pub fn derivative(&self, graph: &mut Graph, expr: ExprId) -> ExprId {
        let mut terms = vec![graph.differentiate(expr, self.variable)];
        for (&dependent, &slope) in self.dependents.iter().zip(&self.slopes) {
            let partial = graph.differentiate(expr, dependent);
            terms.push(graph.mul(partial, slope));
        }
        graph.sum(&terms)
    }
}
