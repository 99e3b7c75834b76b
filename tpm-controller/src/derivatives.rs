//! Derivatives of a model's rows with respect to the motion, from which the sensitivities of simulated motions follow.

use crate::model::EvalError;
use crate::support::Real;

/// Derivatives of the rows `r = Phi theta + known - B u` of a model with respect to the motion.
pub trait RowDerivatives<T: Real>: Send + Sync {
    /// Number of entries of workspace that an evaluation needs.
    fn workspace_len(&self) -> usize;

    /// Writes `dr/d(slot)` into `out`, a row-major matrix of rows times slots. The slots are those of a motion:
    /// derivatives of the coordinates, order by order.
    ///
    /// # Errors
    /// [`EvalError::Length`] when the length of a slice differs from the model's.
    fn rows(
        &self,
        motion: &[T],
        parameters: &[T],
        constants: &[T],
        inputs: &[T],
        workspace: &mut [T],
        out: &mut [T],
    ) -> Result<(), EvalError>;

    /// Number of different arguments of `sign` in the rows, called switches.
    fn switches(&self) -> usize;

    /// Writes into `out`, for every switch, its argument and then half the height of the jump of every row.
    ///
    /// # Errors
    /// [`EvalError::Length`] when the length of a slice differs from the model's.
    fn switching(
        &self,
        motion: &[T],
        parameters: &[T],
        constants: &[T],
        inputs: &[T],
        workspace: &mut [T],
        out: &mut [T],
    ) -> Result<(), EvalError>;
}
