//! A 95 % interval with its prior and true value, or of a difference beside none, as positions on a horizontal strip.

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
    /// Where no difference is, of an interval that is one of a difference.
    zero: Option<String>,
    /// The range of the strip as text, for readers who do not see it.
    label: String,
}

impl Interval {
    /// The interval of a value, in the middle of its strip; nothing without a standard deviation.
    pub(super) fn of(value: Option<f64>, std: Option<f64>, truth: Option<f64>, prior: Option<f64>) -> Option<Self> {
        let (value, std) = (value?, deviation(std)?);
        let away = |other: f64| (other - value) / std;
        let farthest = truth.map_or(0.0, |truth| 1.2 * away(truth).abs());
        let half = farthest.clamp(SHOWN.0, SHOWN.1);
        let mark = |other: f64| {
            let deviations = away(other);
            let beyond = if deviations.abs() > half { deviations.signum() as i8 } else { 0 };
            let x = match beyond {
                0 => place(deviations, half),
                _ => 0.5 * WIDTH + f64::from(beyond) * (0.5 * WIDTH - 5.0),
            };
            Mark { x: pixels(x), beyond }
        };
        Some(Interval {
            truth: truth.filter(|truth| truth.is_finite()).map(mark),
            prior: prior.filter(|prior| prior.is_finite()).map(mark),
            ..Interval::at(0.0, half, "")
        })
    }

    /// The interval of a difference on a strip with no difference in its middle, as long as it takes to hold the interval.
    pub(super) fn of_difference(difference: Option<f64>, std: Option<f64>) -> Option<Self> {
        let away = difference.filter(|difference| difference.is_finite())? / deviation(std)?;
        let half = (1.1 * (away.abs() + NORMAL_95)).max(SHOWN.0);
        Some(Interval { zero: Some(pixels(place(0.0, half))), ..Interval::at(away, half, " of no difference") })
    }

    /// An interval whose middle is so many deviations from that of its strip.
    fn at(deviations: f64, half: f64, middle: &str) -> Self {
        let [low, high] = [-NORMAL_95, NORMAL_95].map(|end| place(deviations + end, half));
        Interval {
            low: pixels(low),
            width: pixels(high - low),
            value: pixels(place(deviations, half)),
            truth: None,
            prior: None,
            zero: None,
            label: format!("95 % interval on a strip of {half:.1} standard deviations to either side{middle}"),
        }
    }
}

/// A standard deviation that an interval can be drawn from.
fn deviation(std: Option<f64>) -> Option<f64> {
    std.filter(|std| std.is_finite() && *std > 0.0)
}

/// The pixel at so many deviations from the middle of a strip.
fn place(deviations: f64, half: f64) -> f64 {
    MARGIN + (0.5 + 0.5 * deviations / half) * (WIDTH - 2.0 * MARGIN)
}

fn pixels(x: f64) -> String {
    format!("{x:.1}")
}
