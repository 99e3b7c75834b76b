//! The estimators by name.

use crate::estimator::Estimator;
use crate::first_order::{FirstOrder, Linearised};
use crate::measured_motion::PooledMotion;
use crate::numerical::Numerical;
use crate::settings::Settings;
use crate::table::LineTable;
use std::sync::Arc;

/// Which estimator to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Method {
    /// Inverse dynamics on the measured motion; exact in one run without noise.
    #[default]
    MeasuredMotion,
    /// Harmonics of the tracking error with the exact phase (Feng, Eqns 3.22, 4.29).
    Error,
    /// Harmonics of the tracking error, coupled by the periodic derivatives of the rows.
    Hill,
    /// Harmonics of the feedback's effort, compared with B Lambda theta.
    Effort,
    /// Harmonics of the tracking error and one extra run per parameter (Feng, Eqn 3.28).
    Numerical,
}

impl Method {
    /// Every estimator.
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

    /// The estimator before any run. Where it needs the rows along a reference, it samples them.
    #[must_use]
    pub fn estimator(self, settings: &Settings) -> Box<dyn Estimator> {
        self.estimator_with(settings, None)
    }

    /// The estimator before any run. Where it needs the rows along a reference, it takes them from the exact table, and samples
    /// them along motions for which there is none.
    #[must_use]
    pub fn estimator_with(self, settings: &Settings, table: Option<Arc<dyn LineTable>>) -> Box<dyn Estimator> {
        let first_order = |kind, table| Box::new(Linearised::new(kind, settings, table));
        match self {
            Method::MeasuredMotion => Box::new(PooledMotion::new(settings)),
            Method::Error => first_order(FirstOrder::Error, table),
            Method::Hill => first_order(FirstOrder::Hill, table),
            Method::Effort => first_order(FirstOrder::Effort, table),
            Method::Numerical => Box::new(Numerical::new(settings, table)),
        }
    }
}
