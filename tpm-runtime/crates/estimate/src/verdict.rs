//! What may be said of an estimated parameter, and of a fit as a whole.
//!
//! Invariant: every estimator follows the rule of [`Status::of`], and the bounds that it compares with stand here alone.

use crate::free::Free;
use serde::Serialize;
use tpm_numerics::DMatrix;

/// A standard deviation above this share of the value makes a parameter poorly determined.
pub const POOR_DEVIATION: f64 = 0.25;
/// A standard deviation above this share of the value makes a physical parameter behind lumped ones poorly determined.
pub const POOR_PHYSICAL_DEVIATION: f64 = 0.5;
/// A parameter whose standard deviation changes a row by no more than this share of its force is not poorly determined:
/// its value is nearly nothing, and known to be.
const MOST_UNFELT_FORCE: f64 = 0.01;
/// A residual above this share of the force is flagged: what was fitted is no result.
pub const LARGE_RESIDUAL: f64 = 0.2;

/// What a residual is a share of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ResidualOf {
    /// The generalised force: harmonic equations and regressions.
    #[default]
    Force,
    /// The motion, or the input where that is measured with noise: simulations.
    Motion,
}

impl ResidualOf {
    /// Whether it is the usual one, the force.
    // What serde calls takes a reference.
    #[allow(clippy::trivially_copy_pass_by_ref)]
    #[must_use]
    pub fn is_force(&self) -> bool {
        *self == Self::Force
    }
}

impl std::fmt::Display for ResidualOf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            ResidualOf::Force => "the force",
            ResidualOf::Motion => "the motion or input",
        })
    }
}

/// What may be said of one estimated parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Known with the stated standard deviation.
    Identified,
    /// Part of a direction that the data do not show; there is no value, or that of a stated prior.
    Unobservable,
    /// Visible, but its deviation is of the size of its value.
    PoorlyDetermined,
    /// Held at a given value.
    Frozen,
    /// Visible, but the value is no result and its deviation does not hold: the model does not explain what was measured, or the value
    /// is that of no machine.
    Untrusted,
}

/// What the status of one parameter follows from.
#[derive(Clone, Copy, Debug)]
pub enum Evidence {
    /// The caller holds the parameter at a value.
    Frozen,
    /// The parameter belongs to a direction that the data do not show.
    Hidden,
    /// The data ask for a value beyond a bound of the parameter, at which it is held.
    AtBound,
    /// The data show the parameter.
    Shown {
        /// Its value.
        value: f64,
        /// Its standard deviation.
        std: f64,
        /// Largest share of a row's force that a change by one standard deviation makes; infinite where it is not known.
        felt: f64,
    },
}

impl Status {
    /// The status that follows from what is known of a parameter; `poor` is [`POOR_DEVIATION`] or [`POOR_PHYSICAL_DEVIATION`].
    pub fn of(evidence: Evidence, poor: f64) -> Self {
        match evidence {
            Evidence::Frozen => Status::Frozen,
            Evidence::Hidden => Status::Unobservable,
            Evidence::AtBound => Status::PoorlyDetermined,
            Evidence::Shown { value, std, felt } if std > poor * value.abs() && felt > MOST_UNFELT_FORCE => {
                Status::PoorlyDetermined
            }
            Evidence::Shown { .. } => Status::Identified,
        }
    }

    /// The name used in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Status::Identified => "identified",
            Status::Unobservable => "unobservable",
            Status::PoorlyDetermined => "poorly_determined",
            Status::Frozen => "frozen",
            Status::Untrusted => "untrusted",
        }
    }

    /// The status in a result that is trusted or is not. A stated deviation holds under the model alone, so that nothing is identified
    /// by a model that does not explain what was measured.
    pub fn in_result(self, trusted: bool) -> Self {
        if self == Status::Identified && !trusted { Status::Untrusted } else { self }
    }
}

/// Standard deviation and status of every parameter.
#[derive(Clone, Debug)]
pub(super) struct Verdict {
    /// Infinite where unobservable, zero where frozen.
    pub(super) std: Vec<f64>,
    pub(super) status: Vec<Status>,
}

impl Verdict {
    /// The verdict on values with their covariance, both of all parameters. `hidden` says of every free parameter whether it belongs to an
    /// unobservable direction; `felt` gives the largest share of a row's force that a change of a parameter makes.
    pub(super) fn new(
        free: &Free,
        hidden: &[bool],
        values: &[f64],
        covariance: &DMatrix<f64>,
        felt: impl Fn(usize, f64) -> f64,
    ) -> Self {
        let mut std = vec![0.0; values.len()];
        let mut status = vec![Status::of(Evidence::Frozen, POOR_DEVIATION); values.len()];
        for (&j, &hidden) in free.indices.iter().zip(hidden) {
            let evidence = if hidden {
                std[j] = f64::INFINITY;
                Evidence::Hidden
            } else {
                std[j] = covariance[(j, j)].max(0.0).sqrt();
                Evidence::Shown { value: values[j], std: std[j], felt: felt(j, std[j]) }
            };
            status[j] = Status::of(evidence, POOR_DEVIATION);
        }
        Verdict { std, status }
    }
}

/// What a residual above [`LARGE_RESIDUAL`] means.
pub fn no_result(residual: f64, of: ResidualOf) -> String {
    format!("{:.1} % of {of} is not explained by the model; what was fitted is no result", 100.0 * residual)
}

#[cfg(test)]
mod tests {
    use super::{Evidence, POOR_DEVIATION, Status};

    #[test]
    fn a_status_follows_from_deviation_value_and_force() {
        let shown = |value, std, felt| Status::of(Evidence::Shown { value, std, felt }, POOR_DEVIATION);
        assert_eq!(shown(-4.0, 1.0, f64::INFINITY), Status::Identified);
        assert_eq!(shown(-4.0, 1.1, f64::INFINITY), Status::PoorlyDetermined);
        // A friction of nearly nothing is known when no force hangs on it.
        assert_eq!(shown(0.0, 1.1, 0.009), Status::Identified);
        assert_eq!(Status::of(Evidence::AtBound, POOR_DEVIATION), Status::PoorlyDetermined);
        assert_eq!(Status::of(Evidence::Hidden, POOR_DEVIATION), Status::Unobservable);
    }

    #[test]
    fn nothing_is_identified_by_a_model_that_does_not_explain_the_data() {
        assert_eq!(Status::Identified.in_result(true), Status::Identified);
        assert_eq!(Status::Identified.in_result(false), Status::Untrusted);
        for status in [Status::Unobservable, Status::PoorlyDetermined, Status::Frozen] {
            assert_eq!(status.in_result(false), status);
        }
    }
}
