//! The derivatives of a model's rows, from which the sensitivities of its motion follow.

use crate::model::EvalError;
use crate::support::Real;

/// How the rows `r = Phi theta + known - B u` of a model change with the motion.
pub trait RowDerivatives<T: Real>: Send + Sync {
    /// Entries of workspace that an evaluation needs.
    fn workspace_len(&self) -> usize;

    /// `dr/d(slot)`, rows times slots, row-major, into `out`; slots are those of a motion: derivatives of the coordinates, order by
    /// order.
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has another length than the model says.
    fn rows(
        &self,
        motion: &[T],
        parameters: &[T],
        constants: &[T],
        inputs: &[T],
        workspace: &mut [T],
        out: &mut [T],
    ) -> Result<(), EvalError>;

    /// Number of different arguments of `sign` in the rows.
    fn switches(&self) -> usize;

    /// Per switch its argument, then per row half the height of the jump, into `out`.
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has another length than the model says.
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
