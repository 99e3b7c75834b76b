//! One type for even and logarithmic axes, so that a panel may combine them without a type for each.

use crate::figure::Spacing;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// Share of the data's extent that is left free at each end of an even axis.
const MARGIN: f64 = 0.05;
/// Steps of an axis of angles, degrees, in place of 50 and 100.
const ANGLES: [f64; 2] = [45.0, 90.0];

/// An axis with its ends.
#[derive(Clone, Debug)]
pub(super) struct Scaled {
    spacing: Spacing,
    first: f64,
    last: f64,
}

impl Scaled {
    /// An axis between the ends given, or else around the values that can be shown; `None` without two different ends.
    pub(super) fn new(spacing: Spacing, range: Option<(f64, f64)>, values: &[f64]) -> Option<Self> {
        let shown = |value: &f64| value.is_finite() && (spacing != Spacing::Logarithmic || *value > 0.0);
        let (first, last) = match range {
            Some(ends) => ends,
            None => {
                let low = values.iter().copied().filter(shown).fold(f64::INFINITY, f64::min);
                let high = values.iter().copied().filter(shown).fold(f64::NEG_INFINITY, f64::max);
                match spacing {
                    // An axis of a single value is widened around it.
                    Spacing::Logarithmic if low == high => (low / 2.0, high * 2.0),
                    Spacing::Logarithmic => (low, high),
                    _ if low == high => (low - 1.0, high + 1.0),
                    _ => (low - MARGIN * (high - low), high + MARGIN * (high - low)),
                }
            }
        };
        (shown(&first) && shown(&last) && first != last).then_some(Scaled { spacing, first, last })
    }

    /// Whether a value has a place on an axis of this spacing.
    pub(super) fn can_show(&self, value: f64) -> bool {
        value.is_finite() && (self.spacing != Spacing::Logarithmic || value > 0.0)
    }

    fn place(&self, value: f64) -> f64 {
        let of = |v: f64| if self.spacing == Spacing::Logarithmic { v.log10() } else { v };
        (of(value) - of(self.first)) / (of(self.last) - of(self.first))
    }

    /// Ticks in even steps of 1, 2 or 5 times a power of ten, of angles also of 45 and 90 degrees; about `most` of them
    /// at most.
    fn even(&self, most: usize) -> Vec<f64> {
        let (low, high) = (self.first.min(self.last), self.first.max(self.last));
        let raw = (high - low) / most.max(1) as f64;
        let power = 10.0_f64.powf(raw.log10().floor());
        let steps = [1.0, 2.0, 5.0, 10.0].map(|multiple| multiple * power);
        let even = steps.into_iter().find(|step| *step >= raw).unwrap_or(10.0 * power);
        let angle = ANGLES.into_iter().find(|step| *step >= raw && (*step..1.2 * step).contains(&even));
        let step = match self.spacing {
            Spacing::Degrees => angle.unwrap_or(even),
            Spacing::Whole => even.max(1.0),
            _ => even,
        };
        ((low / step).ceil() as i64..=(high / step).floor() as i64).map(|i| i as f64 * step).collect()
    }

    /// Ticks at 1, 2 and 5 times the powers of ten, or at 1 and 3 times them, or at the powers alone: the first of
    /// these with at most `most` ticks, else every few powers.
    fn decades(&self, most: usize) -> Vec<f64> {
        let (low, high) = (self.first.min(self.last), self.first.max(self.last));
        let powers = || low.log10().floor() as i32..=high.log10().ceil() as i32;
        let ticks = |digits: &[f64]| -> Vec<f64> {
            powers()
                .flat_map(|p| digits.iter().map(move |d| d * 10.0_f64.powi(p)))
                .filter(|v| (low * (1.0 - 1e-12)..=high * (1.0 + 1e-12)).contains(v))
                .collect()
        };
        [&[1.0, 2.0, 5.0][..], &[1.0, 3.0][..], &[1.0][..]]
            .into_iter()
            .map(ticks)
            .find(|found| found.len() <= most)
            .unwrap_or_else(|| {
                let all = ticks(&[1.0]);
                let skip = all.len().div_ceil(most.max(1));
                all.into_iter().step_by(skip.max(1)).collect()
            })
    }
}

impl Ranged for Scaled {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        // A coordinate far outside the panel would overflow; the drawing is clipped at the panel's edge anyway.
        let place = self.place(*value).clamp(-1.0, 2.0);
        limit.0 + (place * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let most = if hint.weight().allow_light_points() { hint.max_num_points() } else { hint.bold_points() };
        match self.spacing {
            Spacing::Linear | Spacing::Whole | Spacing::Degrees => {
                self.even(most.min(if hint.weight().allow_light_points() { 40 } else { 10 }))
            }
            Spacing::Logarithmic => self.decades(most),
        }
    }

    fn range(&self) -> Range<f64> {
        self.first..self.last
    }
}

impl ValueFormatter<f64> for Scaled {
    fn format(value: &f64) -> String {
        let size = value.abs();
        if size != 0.0 && !(1e-4..1e6).contains(&size) {
            return format!("{value:.1e}");
        }
        // Ten digits hide the rounding of multiples of a step.
        let text = format!("{value:.10}");
        let text = text.trim_end_matches('0').trim_end_matches('.');
        String::from(if text == "-0" { "0" } else { text })
    }
}

#[cfg(test)]
mod tests {
    use super::Scaled;
    use crate::figure::Spacing;
    use plotters::coord::ranged1d::{Ranged, ValueFormatter};

    #[test]
    fn ticks_and_places() {
        let axis = Scaled::new(Spacing::Logarithmic, Some((0.2, 23.0)), &[]).expect("a range");
        assert_eq!(axis.decades(12), [0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0]);
        assert_eq!(axis.decades(3), [1.0, 10.0]);
        assert_eq!(axis.map(&0.2, (10, 110)), 10);
        assert_eq!(axis.map(&(0.2_f64 * 23.0).sqrt(), (10, 110)), 60);
        assert!(!axis.can_show(0.0) && axis.can_show(1e9));
        let over = |spacing| Scaled::new(spacing, None, &[-180.0, 90.0, f64::NAN]).expect("two values");
        assert_eq!(over(Spacing::Degrees).even(7), [-180.0, -135.0, -90.0, -45.0, 0.0, 45.0, 90.0]);
        assert_eq!(over(Spacing::Degrees).even(4), [-180.0, -90.0, 0.0, 90.0]);
        assert_eq!(over(Spacing::Linear).even(7), [-150.0, -100.0, -50.0, 0.0, 50.0, 100.0]);
        let harmonics = Scaled::new(Spacing::Whole, Some((0.0, 5.0)), &[]).expect("a range");
        assert_eq!(harmonics.even(20), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        assert!(Scaled::new(Spacing::Logarithmic, None, &[-1.0]).is_none());
        assert!(Scaled::new(Spacing::Linear, None, &[2.0]).is_some());
        let text = |v: f64| <Scaled as ValueFormatter<f64>>::format(&v);
        assert_eq!([text(0.30000000000000004), text(-0.0), text(2e-7), text(20.0)], ["0.3", "0", "2.0e-7", "20"]);
    }
}
