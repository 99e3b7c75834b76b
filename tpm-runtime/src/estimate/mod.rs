//! Estimators: from harmonics to parameters with their uncertainty.
//!
//! Invariant: an estimator turns what was measured into [`Equations`], complex rows linear in theta with the variance of
//! their noise; [`Information`] condenses them to a square-root form without squaring their condition; runs and logs are
//! pooled there, and [`Information::solve`] gives rank first, then values. Nothing is estimated along a direction that the
//! data do not show.

mod along;
mod applied;
mod combination;
#[cfg(feature = "interpret")]
mod eliminated;
mod equations;
mod estimator;
mod first_order;
mod free;
mod information;
mod measured_motion;
pub(crate) mod named;
mod numerical;
#[cfg(feature = "interpret")]
pub mod physical;
mod select;

pub use along::Along;
pub use combination::Combination;
#[cfg(feature = "interpret")]
pub use eliminated::{Eliminated, EliminatedError};
pub use equations::Equations;
pub use estimator::{Estimator, Method, Run};
pub(crate) use first_order::error_lines;
pub use information::{Information, Solution};
pub use measured_motion::{EstimateError, Frozen, MeasuredMotion, Settings, Weights, estimate_measured_motion};
pub use named::{CombinationReport, ParameterReport};
pub use numerical::NumericalSettings;

use crate::numerics::DMatrix;
use std::format;
use std::string::String;
use std::vec::Vec;

/// What may be said of one estimated parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Known with the stated standard deviation.
    Identified,
    /// Part of a combination that the data do not show; the value is the prior.
    Unobservable,
    /// Visible, but its deviation is of the size of its value.
    PoorlyDetermined,
    /// Held at a given value.
    Frozen,
}

impl Status {
    /// The name used in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Status::Identified => "identified",
            Status::Unobservable => "unobservable",
            Status::PoorlyDetermined => "poorly_determined",
            Status::Frozen => "frozen",
        }
    }
}

/// The result that every estimator gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Value of every parameter, in the model's units; the prior where unobservable.
    pub values: Vec<f64>,
    /// Standard deviation of every parameter; infinite where unobservable, zero where frozen.
    pub std: Vec<f64>,
    /// Covariance, parameters x parameters; restricted to what is observable.
    pub covariance: DMatrix<f64>,
    /// What may be said of every parameter.
    pub status: Vec<Status>,
    /// Rank of the equations: the number of independent combinations that the data show.
    pub rank: usize,
    /// Directions in parameter space that the data do not show, the largest component of each being one.
    pub unobservable: Vec<Vec<f64>>,
    /// Condition number of the weighted equations after column scaling, over the observable directions.
    pub condition: f64,
    /// Root-mean-square residual of the used harmonics as a share of the generalised force.
    pub residual: f64,
    /// Weighted sum of squared residuals per degree of freedom before any inflation; about one when the noise explains it.
    pub chi_squared: f64,
    /// Standard deviation that the model's own error adds to a harmonic of each row, units of the row.
    pub model_error: Vec<f64>,
}

/// An error, or noise, below this share of a signal's largest harmonic is rounding, not noise that could be weighed.
const ROUNDING: f64 = 1e-9;

/// A residual above this share of the force is flagged: what was fitted is no result.
pub const LARGE_RESIDUAL: f64 = 0.2;

/// What such a residual means.
pub(crate) fn no_result(residual: f64) -> String {
    format!("{:.1} % of the force is not explained by the model; what was fitted is no result", 100.0 * residual)
}

impl Estimate {
    /// Whether the model explains what was measured: the residual is not above [`LARGE_RESIDUAL`].
    #[must_use]
    pub fn is_explained(&self) -> bool {
        self.residual <= LARGE_RESIDUAL
    }

    /// What to warn of when it does not.
    pub(crate) fn unexplained(&self) -> Option<String> {
        (!self.is_explained()).then(|| {
            format!(
                "{:.1} % of the force is not explained by the model; terms may be missing, or a scale, a sign or a column may be wrong",
                100.0 * self.residual
            )
        })
    }
}
