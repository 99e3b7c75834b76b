//! A 95 % interval with its prior and true value, as positions on a horizontal strip.

use serde::Serialize;
use tpm_numerics::tail::NORMAL_95;

/// Least and largest half-width of a strip, in standard deviations.
const SHOWN: (f64, f64) = (4.0, 8.0);
/// Width of a strip, in pixels.
const WIDTH: f64 = 200.0;
/// Width at either end, in pixels, in which marks outside the range of the strip are drawn.
const MARGIN: f64 = 12.0;

/// A position on the strip, or the end beyond which the value lies.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Mark {
    x: String,
    /// -1 or 1 where the value lies beyond that end, otherwise 0.
    beyond: i8,
}

/// A 95 % interval on a strip.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Interval {
    low: String,
    width: String,
    value: String,
    truth: Option<Mark>,
    prior: Option<Mark>,
    /// The range of the strip as text, for readers who do not see it.
    label: String,
}

impl Interval {
    /// The interval of a value; nothing without a standard deviation.
    pub(super) fn of(value: Option<f64>, std: Option<f64>, truth: Option<f64>, prior: Option<f64>) -> Option<Self> {
        let (value, std) = (value?, std.filter(|std| std.is_finite() && *std > 0.0)?);
        let away = |other: f64| (other - value) / std;
        let farthest = truth.map_or(0.0, |truth| 1.2 * away(truth).abs());
        let half = farthest.clamp(SHOWN.0, SHOWN.1);
        let place = |deviations: f64| MARGIN + (0.5 + 0.5 * deviations / half) * (WIDTH - 2.0 * MARGIN);
        let mark = |other: f64| {
            let deviations = away(other);
            let beyond = if deviations.abs() > half { deviations.signum() as i8 } else { 0 };
            let x = if beyond == 0 { place(deviations) } else { 0.5 * WIDTH + f64::from(beyond) * (0.5 * WIDTH - 5.0) };
            Mark { x: format!("{x:.1}"), beyond }
        };
        Some(Interval {
            low: format!("{:.1}", place(-NORMAL_95)),
            width: format!("{:.1}", place(NORMAL_95) - place(-NORMAL_95)),
            value: format!("{:.1}", place(0.0)),
            truth: truth.filter(|truth| truth.is_finite()).map(mark),
            prior: prior.filter(|prior| prior.is_finite()).map(mark),
            label: format!("95 % interval on a strip of {half:.1} standard deviations to either side"),
        })
    }
}
