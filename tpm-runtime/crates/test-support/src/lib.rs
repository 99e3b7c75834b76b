//! Models and recorded motions that the tests of several crates share.

pub mod models;
pub mod rig;

use tpm_motion::trajectory::{HarmonicSeries, Line, Part, ReferencePattern};

/// A forgetting factor with which the latest run alone counts: an estimator as it is by itself, without the runs before.
pub const LATEST_ALONE: f64 = f64::EPSILON / 2.0;

/// lambda (cos th - 1/9 cos 3 th), the rest-to-rest pattern of order 3 (Feng, Eqn 2.21), for one coordinate.
#[must_use]
pub fn rest_to_rest_3() -> ReferencePattern {
    let lines = vec![Line { harmonic: 1, cos: 1.0, sin: 0.0 }, Line { harmonic: 3, cos: -1.0 / 9.0, sin: 0.0 }];
    ReferencePattern {
        name: None,
        amplitudes: vec!["lambda".to_string()],
        frequency: "w".to_string(),
        coordinates: vec![vec![Part {
            powers: vec![(0, 1)],
            frequency_power: 0,
            series: HarmonicSeries { mean: 0.0, lines },
        }]],
        others: vec![],
    }
}
