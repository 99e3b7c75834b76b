//! The estimators by name.

use crate::estimate::estimator::Estimator;
use crate::estimate::first_order::{FirstOrder, Linearised};
use crate::estimate::measured_motion::PooledMotion;
use crate::estimate::numerical::Numerical;
use crate::estimate::settings::Settings;
use std::boxed::Box;

/// Which estimator to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Inverse dynamics on the measured motion; exact in one run without noise.
    #[default]
    MeasuredMotion,
    /// Harmonics of the tracking error with the exact phase (Feng, Eqns 3.22, 4.29).
    Error,
    /// The same with harmonics coupled.
    Hill,
    /// Harmonics of the feedback's effort on the table.
    Effort,
    /// Harmonics of the tracking error and one extra run per parameter (Feng, Eqn 3.28).
    Numerical,
}

impl Method {
    /// All of them.
    pub const ALL: [Method; 5] =
        [Method::MeasuredMotion, Method::Error, Method::Hill, Method::Effort, Method::Numerical];

    /// The name in experiment files and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Method::MeasuredMotion => "measured-motion",
            Method::Error => "error",
            Method::Hill => "hill",
            Method::Effort => "effort",
            Method::Numerical => "numerical",
        }
    }

    /// The estimator, with everything still to learn.
    #[must_use]
    pub fn estimator(self, settings: &Settings) -> Box<dyn Estimator> {
        let first_order = |kind| Box::new(Linearised::new(kind, settings));
        match self {
            Method::MeasuredMotion => Box::new(PooledMotion::new(settings)),
            Method::Error => first_order(FirstOrder::Error),
            Method::Hill => first_order(FirstOrder::Hill),
            Method::Effort => first_order(FirstOrder::Effort),
            Method::Numerical => Box::new(Numerical::new(settings)),
        }
    }
}
