//! Intervals of real numbers, for statements that hold on all of a range and not only at samples.
//!
//! Invariant: the result of an operation contains the results for all members of its arguments. Bounds are rounded outward: by one
//! step of the number format after an operation that rounds correctly, by [`FUNCTION_STEPS`] after a function of `tpm-controller`.

use core::f64::consts::{FRAC_PI_2, PI};
use core::ops::{Add, Div, Mul, Neg, Sub};
use tpm_controller::{Hyperbolic, Real};
use tpm_symbolic::expr::graph::Function;

/// Largest error of a function of `tpm-controller`, in steps of the number format.
const FUNCTION_STEPS: usize = 4;
/// Beyond this magnitude the reduction of an angle is no longer exact enough to tell where a sine has its peak.
const MOST_ANGLE: f64 = 1e6;

/// All numbers from a least to a largest one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The least number.
    pub low: f64,
    /// The largest number.
    pub high: f64,
}

impl Interval {
    const REAL: Self = Self { low: f64::NEG_INFINITY, high: f64::INFINITY };

    /// The number itself, known to the format's rounding.
    #[must_use]
    pub fn around(value: f64) -> Self {
        // Zero and small whole numbers are exact.
        if value.fract() == 0.0 && value.abs() < 1e15 {
            Self { low: value, high: value }
        } else {
            widened(value, value, 1)
        }
    }

    /// The largest magnitude.
    #[must_use]
    pub fn magnitude(self) -> f64 {
        self.low.abs().max(self.high.abs())
    }

    /// The products of every member with itself.
    #[must_use]
    pub fn square(self) -> Self {
        let [a, b] = [self.low * self.low, self.high * self.high];
        let low = if self.low <= 0.0 && self.high >= 0.0 { 0.0 } else { a.min(b).next_down() };
        Self { low, high: a.max(b).next_up() }
    }

    /// The function of every member.
    #[must_use]
    pub fn of(self, function: Function) -> Self {
        let Self { low, high } = self;
        let monotone = |function: fn(f64) -> f64| widened(function(low), function(high), FUNCTION_STEPS);
        match function {
            Function::Sin => self.cosine(FRAC_PI_2),
            Function::Cos => self.cosine(0.0),
            Function::Tan => {
                let half_turns = |x: f64| ((x - FRAC_PI_2) / PI).floor();
                let near = |x: f64| Real::cos(x).abs() < 1e-9;
                let pole = self.magnitude() > MOST_ANGLE
                    || high - low >= PI
                    || half_turns(low) != half_turns(high)
                    || near(low)
                    || near(high);
                if pole { Self::REAL } else { monotone(Real::tan) }
            }
            Function::Asin if low >= -1.0 && high <= 1.0 => monotone(Real::asin),
            Function::Acos if low >= -1.0 && high <= 1.0 => widened(Real::acos(high), Real::acos(low), FUNCTION_STEPS),
            Function::Sqrt if low >= 0.0 => monotone(Real::sqrt),
            Function::Log if low > 0.0 => monotone(Real::ln),
            Function::Asin | Function::Acos | Function::Sqrt | Function::Log => Self::REAL,
            Function::Atan => monotone(Real::atan),
            Function::Tanh => monotone(Hyperbolic::tanh),
            Function::Exp => monotone(Real::exp),
            Function::Abs if low >= 0.0 => self,
            Function::Abs if high <= 0.0 => -self,
            Function::Abs => Self { low: 0.0, high: self.magnitude() },
            Function::Sign => Self { low: Real::sign(low), high: Real::sign(high) },
        }
    }

    /// cos(x - shift) of every member; it turns at shift plus whole multiples of pi.
    fn cosine(self, shift: f64) -> Self {
        let Self { low, high } = self;
        if self.magnitude() >= MOST_ANGLE || high - low >= 2.0 * PI {
            return Self { low: -1.0, high: 1.0 };
        }
        let value = |x: f64| if shift == 0.0 { Real::cos(x) } else { Real::sin(x) };
        let (a, b) = (value(low), value(high));
        let ends = widened(a.min(b), a.max(b), FUNCTION_STEPS);
        // A margin on both sides, so that a turn at an end is not missed by rounding.
        let from = ((low - shift) / PI - 1e-9).ceil();
        let to = ((high - shift) / PI + 1e-9).floor();
        let (mut least, mut most) = (ends.low.max(-1.0), ends.high.min(1.0));
        let mut turn = from;
        while turn <= to {
            if turn.rem_euclid(2.0) == 0.0 {
                most = 1.0
            } else {
                least = -1.0
            }
            turn += 1.0;
        }
        Self { low: least, high: most }
    }

    /// The angle of every point with ordinate in `y` and abscissa in `x`.
    #[must_use]
    pub fn atan2(y: Self, x: Self) -> Self {
        if x.low <= 0.0 {
            return widened(-PI, PI, 1);
        }
        let angles = [(y.low, x.low), (y.low, x.high), (y.high, x.low), (y.high, x.high)];
        hull(angles.map(|(y, x)| Real::atan2(y, x)), FUNCTION_STEPS)
    }
}

/// The interval between two numbers, widened by steps of the number format; all numbers where one is none.
fn widened(low: f64, high: f64, steps: usize) -> Interval {
    if low.is_nan() || high.is_nan() {
        return Interval::REAL;
    }
    let down = (0..steps).fold(low, |value, _| value.next_down());
    let up = (0..steps).fold(high, |value, _| value.next_up());
    Interval { low: down, high: up }
}

/// The least interval that holds these numbers, widened.
fn hull(values: [f64; 4], steps: usize) -> Interval {
    // Not `f64::min`, which would skip a result that is no number.
    if values.iter().any(|value| value.is_nan()) {
        return Interval::REAL;
    }
    widened(
        values.iter().copied().fold(f64::INFINITY, f64::min),
        values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        steps,
    )
}

impl Add for Interval {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        widened(self.low + other.low, self.high + other.high, 1)
    }
}

impl Sub for Interval {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Neg for Interval {
    type Output = Self;

    fn neg(self) -> Self {
        Self { low: -self.high, high: -self.low }
    }
}

impl Mul for Interval {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let [a, b] = [self, other];
        // Zero times anything is zero: what is infinite here is a bound that is not known.
        let product = |x: f64, y: f64| if x == 0.0 || y == 0.0 { 0.0 } else { x * y };
        let products = [product(a.low, b.low), product(a.low, b.high), product(a.high, b.low), product(a.high, b.high)];
        hull(products, usize::from(products != [0.0; 4]))
    }
}

impl Div for Interval {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        if other.low <= 0.0 && other.high >= 0.0 {
            return Self::REAL;
        }
        hull([self.low / other.low, self.low / other.high, self.high / other.low, self.high / other.high], 1)
    }
}

#[cfg(test)]
mod tests {
    use super::Interval;
    use std::f64::consts::{FRAC_PI_2, PI};
    use tpm_controller::{Hyperbolic, Real};
    use tpm_symbolic::expr::graph::Function;

    fn contains(interval: Interval, value: f64) -> bool {
        interval.low <= value && value <= interval.high
    }

    /// Members of an interval, its ends among them.
    fn members(interval: Interval) -> impl Iterator<Item = f64> {
        (0..=40).map(move |i| {
            (interval.low + f64::from(i) / 40.0 * (interval.high - interval.low)).clamp(interval.low, interval.high)
        })
    }

    fn intervals() -> Vec<Interval> {
        let ends = [-7.0, -PI, -FRAC_PI_2, -0.9, -0.3, 0.0, 1e-3, 0.4, 1.0, FRAC_PI_2, PI, 4.9, 12.0];
        let pairs = ends.iter().flat_map(|&low| ends.iter().map(move |&high| Interval { low, high }));
        pairs.filter(|interval| interval.low <= interval.high).collect()
    }

    #[test]
    fn functions_of_members_lie_in_functions_of_intervals() {
        type Value = fn(f64) -> f64;
        let functions: [(Function, Value); 12] = [
            (Function::Sin, f64::sin),
            (Function::Cos, f64::cos),
            (Function::Tan, f64::tan),
            (Function::Asin, f64::asin),
            (Function::Acos, f64::acos),
            (Function::Atan, f64::atan),
            (Function::Sqrt, f64::sqrt),
            (Function::Tanh, Hyperbolic::tanh),
            (Function::Exp, f64::exp),
            (Function::Log, f64::ln),
            (Function::Abs, f64::abs),
            (Function::Sign, Real::sign),
        ];
        for (function, value) in functions {
            for interval in intervals() {
                let found = interval.of(function);
                for member in members(interval).map(value).filter(|value| !value.is_nan()) {
                    assert!(contains(found, member), "{function:?} {interval:?}: {member} outside {found:?}");
                }
            }
        }
        // They say something, too.
        let narrow = Interval { low: 0.4, high: 0.5 };
        assert!((narrow.of(Function::Sin).high - 0.5_f64.sin()).abs() < 1e-15);
        assert!((narrow.of(Function::Tan).low - 0.4_f64.tan()).abs() < 1e-15);
        assert_eq!(Interval { low: 1.0, high: 2.0 }.of(Function::Sin).high, 1.0);
    }

    #[test]
    fn operations_on_members_lie_in_operations_on_intervals() {
        for a in intervals() {
            for b in intervals() {
                let found = [a + b, a - b, a * b, a / b, Interval::atan2(a, b)];
                for (x, y) in members(a).step_by(8).flat_map(|x| members(b).step_by(8).map(move |y| (x, y))) {
                    let values = [x + y, x - y, x * y, x / y, x.atan2(y)];
                    for (interval, value) in found.into_iter().zip(values).filter(|(_, value)| value.is_finite()) {
                        assert!(contains(interval, value), "{a:?} {b:?}: {value} outside {interval:?}");
                    }
                    assert!(contains(a.square(), x * x) && contains(-a, -x));
                }
            }
        }
    }
}
