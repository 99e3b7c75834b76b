//! The motion of an imported model's experiments, and how large it is at first.
//!
//! Every joint moves about a centre as one of two Fourier series that start at rest and without acceleration: those at odd places of a
//! chain as A (cos n w t - 1/9 cos 3 n w t), those at even places as A (sin n w t - 1/2 sin 2 n w t). Were all of them cosines, the second
//! half of every period would be the first one backwards. The multiple n is the joint's place in its chain, so that joints whose torques
//! have inertias in common do not move alike. The multiples stand in the experiment, where `tpm design` may choose others.

use std::fmt::Write as _;

use num_traits::Zero;
use tpm_symbolic::number::rational::to_f64;

use crate::import::arrange::{Moving, Robot};

/// The frequency of the first stage, rad/s.
pub(super) const FREQUENCY: f64 = 1.0;
/// Multiples of joints further out begin again at one: accelerations rise with the square of the multiple.
const MOST_MULTIPLE: u32 = 6;
/// Share of a limit that the motion takes at first.
const SHARE: f64 = 0.5;
/// Largest amplitude at first, rad; a quarter turn to both sides is more than arms have room for.
const MOST_TURN: f64 = 0.5;
/// Largest amplitude at first, m.
const MOST_SLIDE: f64 = 0.1;

/// A series of which a joint's motion is a multiple.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Series {
    Cosines,
    Sines,
}

impl Series {
    fn at(place: u32) -> Self {
        if place % 2 == 1 { Self::Cosines } else { Self::Sines }
    }

    /// The largest position and the largest rate, for the amplitude and the frequency one: at phases 0 and pi/2 of the cosines, 2 pi/3 and
    /// pi of the sines.
    fn peaks(self) -> [f64; 2] {
        match self {
            Self::Cosines => [8.0 / 9.0, 4.0 / 3.0],
            Self::Sines => [0.75 * 3.0_f64.sqrt(), 2.0],
        }
    }

    /// In the language.
    fn text(self, w: &str) -> String {
        match self {
            Self::Cosines => format!("(cos({w}*t) - 1/9*cos(3*{w}*t))"),
            Self::Sines => format!("(sin({w}*t) - 1/2*sin(2*{w}*t))"),
        }
    }
}

/// The motion of one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    /// The middle of the motion, rad or m.
    pub(super) centre: f64,
    /// The amplitude of the first stage, rad or m.
    pub(super) amplitude: f64,
    /// The multiple of the frequency.
    pub(super) multiple: u32,
    series: Series,
}

impl Motion {
    /// The largest rate of the first stage, rad/s or m/s.
    pub(super) fn fastest(self) -> f64 {
        let [_, fast] = self.series.peaks();
        self.amplitude * fast * FREQUENCY * f64::from(self.multiple)
    }
}

/// The motions of all bodies; `None` for a body on a fixed joint, and on one that follows another joint.
pub(super) fn motions(robot: &Robot) -> Vec<Option<Motion>> {
    let mut places: Vec<u32> = Vec::with_capacity(robot.bodies.len());
    let mut motions = Vec::with_capacity(robot.bodies.len());
    for body in &robot.bodies {
        let before = body.parent.map_or(0, |parent| places[parent]);
        places.push(before + u32::from(body.moving.is_some()));
        let leading = body.moving.as_ref().filter(|moving| moving.follows.is_none());
        motions.push(leading.map(|moving| motion(moving, before + 1)));
    }
    motions
}

/// The motion of a joint at this place of its chain, from 1.
fn motion(moving: &Moving, place: u32) -> Motion {
    let (series, multiple) = (Series::at(place), (place - 1) % MOST_MULTIPLE + 1);
    let [far, fast] = series.peaks();
    let limits = &moving.limits;
    let range = limits.lower.as_ref().zip(limits.upper.as_ref()).map(|(lower, upper)| (to_f64(lower), to_f64(upper)));
    let range = range.filter(|(lower, upper)| lower < upper);
    let centre = range.map_or(0.0, |(lower, upper)| centre(lower, upper));
    let room = range.map(|(lower, upper)| (upper - centre).min(centre - lower) / far);
    // Descriptions write a velocity of zero where nobody knew it.
    let rate = limits.velocity.as_ref().filter(|velocity| !velocity.is_zero());
    let rate = rate.map(|velocity| to_f64(velocity) / (fast * FREQUENCY * f64::from(multiple)));
    let most = if moving.turns { MOST_TURN } else { MOST_SLIDE };
    let amplitude =
        [room, rate].into_iter().flatten().filter(|limit| *limit > 0.0).map(|limit| SHARE * limit).fold(most, f64::min);
    Motion { centre, amplitude: two_digits_below(amplitude), multiple, series }
}

/// Zero in the middle half of the range, where the description put it; otherwise the middle, rounded as far as the range allows.
fn centre(lower: f64, upper: f64) -> f64 {
    let (middle, width) = (f64::midpoint(lower, upper), upper - lower);
    if middle.abs() <= width / 4.0 {
        return 0.0;
    }
    let step = 10_f64.powf((width / 20.0).log10().floor());
    decimal((middle / step).round() * step)
}

/// The largest number of two digits that is not above.
fn two_digits_below(value: f64) -> f64 {
    let step = 10_f64.powf(value.log10().floor() - 1.0);
    // A number of two digits must not lose its last one to rounding.
    decimal((value / step + 1e-9).floor() * step)
}

/// The number without the digits that its step's rounding left.
fn decimal(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

/// The joints that have a coordinate, with their motions.
pub(super) fn moving(robot: &Robot) -> impl Iterator<Item = (&Moving, Motion)> {
    robot.bodies.iter().zip(motions(robot)).filter_map(|(body, motion)| Some((body.moving.as_ref()?, motion?)))
}

/// The constants of the pattern in the language.
pub(super) fn constants(robot: &Robot) -> String {
    let away = moving(robot).filter(|(moving, motion)| !moving.turns && motion.centre != 0.0);
    away.map(|(moving, motion)| format!("    constant {} = {} [m];\n", moving.centre, motion.centre)).collect()
}

/// The pattern in the language.
pub(super) fn pattern(robot: &Robot) -> String {
    let unit = |moving: &Moving| if moving.turns { "rad" } else { "m" };
    let amplitudes: Vec<String> =
        moving(robot).map(|(moving, _)| format!("{} [{}]", moving.amplitude, unit(moving))).collect();
    let w = &robot.frequency;
    let mut text =
        format!("\n    pattern {{\n        amplitude {};\n        frequency {w} [rad/s];\n", amplitudes.join(", "));
    for (Moving { coordinate, amplitude, centre, turns, .. }, motion) in moving(robot) {
        let centre = match (motion.centre, turns) {
            (0.0, _) => String::new(),
            (angle, true) => format!("{angle} + "),
            (_, false) => format!("{centre} + "),
        };
        let _ = writeln!(text, "        {coordinate} = {centre}{amplitude}*{};", motion.series.text(w));
    }
    text.push_str("    }\n");
    text
}

#[cfg(test)]
mod tests {
    use super::{Series, centre, two_digits_below};

    #[test]
    fn series_start_at_rest_and_reach_their_peaks() {
        for (series, position) in [
            (Series::Cosines, &(|x: f64| x.cos() - (3.0 * x).cos() / 9.0) as &dyn Fn(f64) -> f64),
            (Series::Sines, &|x: f64| x.sin() - (2.0 * x).sin() / 2.0),
        ] {
            let step = 1e-3;
            let rate = |x: f64| (position(x + step) - position(x - step)) / (2.0 * step);
            assert!(rate(0.0).abs() < 1e-5 && (rate(step) - rate(-step)).abs() < 1e-5);
            let most = |of: &dyn Fn(f64) -> f64| (0..6284).map(|k| of(f64::from(k) * step).abs()).fold(0.0, f64::max);
            let [far, fast] = series.peaks();
            assert!((most(position) - far).abs() < 1e-5 && (most(&rate) - fast).abs() < 1e-5, "{series:?}");
        }
    }

    #[test]
    fn centres_are_zero_or_in_the_middle() {
        assert_eq!(centre(-6.3, 6.3), 0.0);
        assert_eq!(centre(-2.0, 3.0), 0.0);
        assert_eq!(centre(-3.0718, -0.0698), -1.6);
        assert_eq!(centre(0.0, 0.04), 0.02);
        assert_eq!(centre(0.0, 1234.0), 620.0);
    }

    #[test]
    fn amplitudes_have_two_digits_and_stay_below() {
        for (value, rounded) in
            [(0.5, 0.5), (0.1999, 0.19), (0.2, 0.2), (1.2345e-5, 1.2e-5), (0.13, 0.13), (0.07, 0.07)]
        {
            assert_eq!(two_digits_below(value), rounded);
        }
    }
}
