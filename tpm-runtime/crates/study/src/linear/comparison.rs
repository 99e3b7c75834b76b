//! A transfer function beside that of a model, in a band of frequencies.

use crate::linear::words::{gain_text, roots, roots_text, table_of};
use serde::Serialize;
use std::f64::consts::TAU;
use std::fmt;
use thiserror::Error;
use tpm_frequency::{Complex, TransferFunction};
use tpm_report::number;

/// Largest median relative difference of two responses that are called consistent: what a fit of a few per cent leaves.
const CONSISTENT: f64 = 5e-2;

/// Number of frequencies at which two responses are compared.
const COMPARED: usize = 400;

/// A transfer function beside that of the model.
#[derive(Debug, Serialize)]
pub(super) struct Comparison {
    #[serde(skip)]
    name: String,
    #[serde(skip)]
    own: TransferFunction,
    #[serde(skip)]
    pub(super) other: TransferFunction,
    numerator: Vec<f64>,
    denominator: Vec<f64>,
    #[serde(serialize_with = "roots")]
    poles: Vec<Complex>,
    #[serde(serialize_with = "roots")]
    zeros: Vec<Complex>,
    static_gain: f64,
    low_hz: f64,
    high_hz: f64,
    /// Median over the band of |other/own - 1|.
    median_difference: f64,
    largest_difference: f64,
    consistent: bool,
}

/// A band of frequencies in Hz; an end that is not given lies a factor of ten outside of all poles.
#[derive(Clone, Copy, Debug, Default)]
pub struct Band {
    /// The lowest frequency, Hz.
    pub low: Option<f64>,
    /// The highest frequency, Hz.
    pub high: Option<f64>,
}

/// Why a transfer function cannot be compared or drawn.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum LinearisedError {
    /// There is more than one transfer function, or none.
    #[error("one transfer function is needed, and there are {0}")]
    NotOne(usize),
    /// The model has no values.
    #[error("the model in numbers is needed")]
    NoNumbers,
    /// No pole is there to choose a band by.
    #[error("there is no pole to choose a band by")]
    NoPole,
    /// The band does not rise from above zero.
    #[error("the band {low} to {high} Hz must rise from above 0")]
    Band {
        /// The lowest frequency, Hz.
        low: f64,
        /// The highest frequency, Hz.
        high: f64,
    },
}

impl Band {
    /// Both ends for these functions.
    pub(super) fn around(self, functions: &[&TransferFunction]) -> Result<(f64, f64), LinearisedError> {
        let poles = functions.iter().flat_map(|function| function.poles());
        let sizes: Vec<f64> = poles.map(|pole| pole.norm() / TAU).filter(|size| *size > 0.0).collect();
        let low = self.low.or_else(|| Some(0.1 * sizes.iter().copied().reduce(f64::min)?));
        let high = self.high.or_else(|| Some(10.0 * sizes.iter().copied().reduce(f64::max)?));
        let (Some(low), Some(high)) = (low, high) else { return Err(LinearisedError::NoPole) };
        if low > 0.0 && low < high && high.is_finite() {
            Ok((low, high))
        } else {
            Err(LinearisedError::Band { low, high })
        }
    }
}

impl Comparison {
    pub(super) fn new(name: String, own: TransferFunction, other: TransferFunction, low: f64, high: f64) -> Self {
        let mut differences: Vec<f64> = (0..COMPARED)
            .map(|i| {
                let w = TAU * low * (high / low).powf(i as f64 / (COMPARED - 1) as f64);
                (other.response(w) / own.response(w) - 1.0).norm()
            })
            .collect();
        differences.sort_by(f64::total_cmp);
        let (median, largest) = (differences[COMPARED / 2], differences[COMPARED - 1]);
        Comparison {
            name,
            own,
            numerator: other.numerator().to_vec(),
            denominator: other.denominator().to_vec(),
            poles: other.poles(),
            zeros: other.zeros(),
            static_gain: other.static_gain(),
            other,
            low_hz: low,
            high_hz: high,
            median_difference: median,
            largest_difference: largest,
            consistent: median <= CONSISTENT,
        }
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = table_of(&[&self.name, "model", "beside"]);
        let mut row = |name: &str, of: &dyn Fn(&TransferFunction) -> String| {
            table.row(&[name.to_owned(), of(&self.own), of(&self.other)]);
        };
        row("order", &|f| format!("{}/{}", f.numerator().len() - 1, f.denominator().len() - 1));
        row("poles [rad/s]", &|f| roots_text(&f.poles()));
        row("zeros [rad/s]", &|f| roots_text(&f.zeros()));
        row("static gain", &|f| gain_text(f.static_gain()));
        writeln!(
            f,
            "{}the two are {}: from {} to {} Hz their responses differ by {} % of the model's (median), {} % at most",
            table.finish(),
            if self.consistent { "consistent" } else { "not consistent" },
            number(self.low_hz),
            number(self.high_hz),
            number(100.0 * self.median_difference),
            number(100.0 * self.largest_difference)
        )
    }
}
