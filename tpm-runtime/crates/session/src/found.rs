//! What is found in a log, whichever way it is used.

use crate::log_report::{HoldResiduals, UnseenFaultReport, Way};
use crate::refinement_report::RefinementReport;
use crate::warning::Warning;
use tpm_estimate::{CalibrationFault, Estimate, FittedDelay};

/// What is found in a log.
pub(super) struct Found {
    pub(super) estimate: Estimate,
    /// Highest harmonic used; zero in the time domain.
    pub(super) harmonics: usize,
    pub(super) way: Way,
    /// Residual per row, as a share of its force.
    pub(super) row_residuals: Vec<f64>,
    pub(super) hold_residuals: HoldResiduals,
    pub(super) refinement: Option<RefinementReport>,
    pub(super) warnings: Vec<Warning>,
    /// Whether a simulation tells that the inputs do the other thing between samples.
    pub(super) tells_hold: bool,
    /// Delays of inputs that were asked for, where the record shows them.
    pub(super) delays: Vec<FittedDelay>,
    /// What faults of the sensors' calibration would do; nothing where the way does not tell it.
    pub(super) calibration: Vec<CalibrationFault>,
    /// What a wrong gain of the only input would do.
    pub(super) unseen_gain: Option<UnseenFaultReport>,
}
