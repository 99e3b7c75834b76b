//! Regulators of linearised models.

use tpm_numerics::{Matrix, RiccatiError};
use tpm_plant::regulator::{Regulator, RegulatorWeights};
use tpm_symbolic::linear::linearize::StateSpace;

/// The optimal linear-quadratic regulator of a linearised model.
///
/// # Errors
/// [`RiccatiError`] as for [`Regulator::optimal`].
pub fn linear_regulator(
    space: &StateSpace<f64>,
    sample_time: f64,
    weights: &RegulatorWeights,
) -> Result<Regulator, RiccatiError> {
    let matrix = |rows: &[Vec<f64>]| Matrix::from_rows(rows).ok_or(RiccatiError::Shape);
    Regulator::optimal(&matrix(&space.a)?, &matrix(&space.b)?, sample_time, weights)
}
