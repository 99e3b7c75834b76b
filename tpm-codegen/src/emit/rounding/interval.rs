//! Intervals of doubles, rounded outward.
//!
//! Invariant: the result of an operation holds the exact results for all operands in the intervals; results of elementary functions of the
//! standard library are taken to be within [`ULPS`] units in the last place.

use std::f64::consts::PI;
use tpm_symbolic::expr::graph::Function;

/// Units in the last place by which elementary functions of the standard library may be wrong.
const ULPS: usize = 4;

/// Largest argument of sines and cosines for which extrema between the ends are looked for; beyond it they have their whole range.
const LARGEST_ANGLE: f64 = 1e6;

/// The numbers from `low` to `high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Interval {
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Interval {
    pub(super) fn new(low: f64, high: f64) -> Self {
        Self { low, high }
    }

    fn outward(low: f64, high: f64) -> Self {
        Self { low: low.next_down(), high: high.next_up() }
    }

    /// The largest absolute value.
    pub(super) fn size(self) -> f64 {
        self.high.max(-self.low)
    }

    pub(super) fn holds_zero(self) -> bool {
        self.low <= 0.0 && self.high >= 0.0
    }

    /// All numbers that are within `distance` of these.
    pub(super) fn widened(self, distance: f64) -> Self {
        Self::outward(self.low - distance, self.high + distance)
    }

    /// Those of the numbers whose absolute value is at most `size`.
    pub(super) fn within(self, size: f64) -> Self {
        Self { low: self.low.max(-size), high: self.high.min(size) }
    }

    pub(super) fn add(self, other: Self) -> Self {
        Self::outward(self.low + other.low, self.high + other.high)
    }

    pub(super) fn neg(self) -> Self {
        Self { low: -self.high, high: -self.low }
    }

    pub(super) fn mul(self, other: Self) -> Self {
        Self::hull([self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high])
    }

    pub(super) fn squared(self) -> Self {
        let least = if self.holds_zero() { 0.0 } else { self.low.abs().min(self.high.abs()) };
        Self { low: (least * least).next_down().max(0.0), high: (self.size() * self.size()).next_up() }
    }

    /// The quotients; nothing where the divisor may be zero.
    pub(super) fn div(self, divisor: Self) -> Option<Self> {
        (!divisor.holds_zero()).then(|| self.mul(Self::outward(1.0 / divisor.high, 1.0 / divisor.low)))
    }

    fn hull(ends: [f64; 4]) -> Self {
        let low = ends.into_iter().fold(f64::INFINITY, f64::min);
        let high = ends.into_iter().fold(f64::NEG_INFINITY, f64::max);
        Self::outward(low, high)
    }

    /// The values of an increasing function, between its least and its greatest value.
    fn increasing(self, function: impl Fn(f64) -> f64, [least, greatest]: [f64; 2]) -> Self {
        let down = (0..ULPS).fold(function(self.low), |value, _| value.next_down());
        let up = (0..ULPS).fold(function(self.high), |value, _| value.next_up());
        Self { low: down.max(least), high: up.min(greatest) }
    }

    /// Values of a wave: those of the ends, and 1 or -1 where an extremum lies between them; the maxima lie at `crest` and whole turns from it.
    fn wave(self, function: impl Fn(f64) -> f64, crest: f64) -> Self {
        if self.high - self.low >= 2.0 * PI || self.size() > LARGEST_ANGLE {
            return Self::new(-1.0, 1.0);
        }
        // Places of extrema are rounded, so that those just outside count as well.
        let slack = 1e-9;
        let (first, last) = ((self.low - crest - slack) / PI, (self.high - crest + slack) / PI);
        let (a, b) = (function(self.low), function(self.high));
        let (mut low, mut high) = (a.min(b) - 1e-15, a.max(b) + 1e-15);
        let mut half_turns = first.ceil();
        while half_turns <= last {
            if half_turns % 2.0 == 0.0 {
                high = 1.0;
            } else {
                low = -1.0;
            }
            half_turns += 1.0;
        }
        Self::new(low.max(-1.0), high.min(1.0))
    }

    /// The values of a function; nothing where it is not defined everywhere.
    pub(super) fn apply(self, function: Function) -> Option<Self> {
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        let half = PI / 2.0;
        Some(match function {
            Function::Cos => self.wave(f64::cos, 0.0),
            Function::Sin => self.wave(f64::sin, half),
            Function::Tan if self.wave(f64::cos, 0.0).holds_zero() => return None,
            Function::Tan => self.increasing(f64::tan, all),
            Function::Asin | Function::Acos if self.size() > 1.0 => return None,
            Function::Asin => self.increasing(f64::asin, [-half.next_up(), half.next_up()]),
            Function::Acos => self.neg().increasing(|x| (-x).acos(), [0.0, PI.next_up()]),
            Function::Atan => self.increasing(f64::atan, [-half.next_up(), half.next_up()]),
            Function::Sqrt if self.low < 0.0 => return None,
            Function::Sqrt => self.increasing(f64::sqrt, [0.0, f64::INFINITY]),
            Function::Tanh => self.increasing(f64::tanh, [-1.0, 1.0]),
            Function::Exp => self.increasing(f64::exp, [0.0, f64::INFINITY]),
            Function::Log if self.low <= 0.0 => return None,
            Function::Log => self.increasing(f64::ln, all),
            Function::Abs if self.holds_zero() => Self::new(0.0, self.size()),
            Function::Abs => {
                if self.low > 0.0 {
                    self
                } else {
                    self.neg()
                }
            }
            Function::Sign if self.holds_zero() => Self::new(-1.0, 1.0),
            Function::Sign => Self::new(self.low.signum(), self.low.signum()),
        })
    }

    /// Angles atan2(y, x) of points whose second coordinates are these; nothing where the origin or the cut may be met.
    pub(super) fn atan2(self, x: Self) -> Option<Self> {
        if self.holds_zero() && x.low <= 0.0 {
            return None;
        }
        // Extrema lie at corners, since the angle is monotone in either coordinate on either side of the axes.
        let angles = [(self.low, x.low), (self.low, x.high), (self.high, x.low), (self.high, x.high)];
        Some(Self::hull(angles.map(|(y, x)| y.atan2(x))).widened(1e-15))
    }
}
