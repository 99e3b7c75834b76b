//! A measured signal as a polynomial and a rest that closes upon itself.
//!
//! A discrete transform takes a signal for periodic. One that ends with another value or slope than it begins with has a second derivative
//! with impulses where its end meets its beginning, and every filter spreads these over its own reach. The share of a motion that is read
//! from a spectrum reaches over seconds: impulses of thousands of newtons then leave newtons in the middle of a record. So the cubic
//! that has the signal's value and slope at both ends is taken off before the transform; its derivatives are exact. Curvatures as well would be
//! those of a sensor's noise where it is large.

use crate::local::derivatives;
use crate::time_domain::transform::Transform;
use num_complex::Complex;

/// Fewest samples to which a quadratic is fitted at an end: twice as many as it has coefficients, and one.
const LEAST_SAMPLES: usize = 7;

/// A signal with its derivatives.
#[derive(Clone, Debug)]
pub(crate) struct Course {
    rest: Transform,
    trend: Trend,
}

/// A cubic in time over the length of a signal, which is taken off it, and its derivatives off those of the signal.
#[derive(Clone, Debug)]
pub(crate) struct Trend {
    /// Coefficients, the constant one first.
    cubic: [f64; 4],
    /// Time from the first sample to the last, s.
    duration: f64,
}

impl Trend {
    /// Nothing, for a signal whose end goes over into its beginning.
    pub(crate) fn nothing() -> Self {
        Trend { cubic: [0.0; 4], duration: 1.0 }
    }

    /// The cubic with the value and the slope that a signal has at both of its ends, as quadratics through `near` samples there tell.
    pub(crate) fn of(signal: &[f64], sample_time: f64, near: usize) -> Self {
        let half = near.max(LEAST_SAMPLES).min(signal.len() / 2).saturating_sub(1) / 2;
        let width = 2 * half + 1;
        let duration = signal.len().saturating_sub(1) as f64 * sample_time;
        // Value and slope at the first and the last of some samples, in units of the whole duration.
        let ends = |part: &[f64]| -> Option<[f64; 4]> {
            let found = derivatives(part, sample_time, half, 1, width - 1)?;
            let [a, da, b, db] = found.try_into().ok()?;
            Some([a, da * duration, b, db * duration])
        };
        let both = if half > 0 { ends(&signal[..width]).zip(ends(&signal[signal.len() - width..])) } else { None };
        let Some(([a, da, ..], [.., b, db])) = both else { return Trend::nothing() };
        let (value, slope) = (b - a - da, db - da);
        let cubic = [a, da, 3.0 * value - slope, slope - 2.0 * value];
        if cubic.iter().all(|x| x.is_finite()) { Trend { cubic, duration } } else { Trend::nothing() }
    }

    /// What is left of a derivative of the signal that was measured, `derivative` zero for the signal itself.
    pub(crate) fn off(&self, signal: &[f64], sample_time: f64, derivative: usize) -> Vec<f64> {
        let left = |(k, x): (usize, &f64)| x - self.at(k as f64 * sample_time, derivative);
        signal.iter().enumerate().map(left).collect()
    }

    /// A derivative at a time; beyond the last sample that of its time, since there is nothing to follow.
    fn at(&self, time: f64, derivative: usize) -> f64 {
        let x = time.min(self.duration) / self.duration;
        let falling = |power: usize| ((power + 1 - derivative)..=power).map(|n| n as f64).product::<f64>();
        let powers = (derivative..self.cubic.len()).rev();
        let sum = powers.fold(0.0, |sum, power| sum * x + falling(power) * self.cubic[power]);
        sum / self.duration.powi(derivative as i32)
    }
}

impl Course {
    /// From the transform of what a trend leaves.
    pub(crate) fn new(rest: Transform, trend: Trend) -> Self {
        Course { rest, trend }
    }

    /// A derivative of the signal at even times over the time of the transform. `response` is that of a smoother which passes what is slow,
    /// given the angular frequency (rad/s).
    pub(crate) fn derivative(&self, points: usize, derivative: usize, response: impl Fn(f64) -> f64) -> Vec<f64> {
        let of = |w: f64| Complex::new(0.0, w).powu(derivative as u32) * response(w);
        let mut values = self.rest.filtered(points, of);
        let apart = self.rest.duration() / points as f64;
        // A smoother passes a cubic as it passes what is slowest.
        let passed = response(0.0);
        for (k, value) in values.iter_mut().enumerate() {
            *value += passed * self.trend.at(k as f64 * apart, derivative);
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::{Course, Trend};
    use crate::time_domain::transform::{Transform, quick};

    #[test]
    fn derivatives_of_a_motion_that_does_not_close_are_right_up_to_its_ends() {
        let (samples, h) = (3001, 1e-3);
        let at = |t: f64, d: usize| -> f64 {
            let w = 7.3;
            let turned = w * t + 0.4 + d as f64 * std::f64::consts::FRAC_PI_2;
            w.powi(d as i32) * turned.sin() + [0.3 * t + 0.2 * t * t, 0.3 + 0.4 * t, 0.4][d]
        };
        let signal: Vec<f64> = (0..samples).map(|k| at(k as f64 * h, 0)).collect();
        let points = quick(samples);
        let largest = |trend: Trend, d: usize| {
            let rest = Transform::new(&trend.off(&signal, h, 0), points, h);
            let course = Course::new(rest, trend);
            // A smoother whose response has a corner, so that it reaches far.
            let values =
                course.derivative(points, d, |w| (1.0 - (w - 60.0).abs() / 60.0).max(f64::from(u8::from(w < 60.0))));
            let wrong = |k: &usize| (values[*k] - at(*k as f64 * h, d)).abs();
            (200..samples - 200).map(|k| wrong(&k)).fold(0.0, f64::max)
        };
        for d in 0..=2 {
            let (open, closed) = (largest(Trend::of(&signal, h, 40), d), largest(Trend::nothing(), d));
            assert!(open < 1e-3 * 7.3_f64.powi(d as i32) && open < 1e-2 * closed, "{d}: {open} beside {closed}");
        }
    }
}
