//! Interval arithmetic in double precision, rounded outwards.
//!
//! Invariant of [`Interval`]: `lower <= upper`, neither is NaN, and every operation returns an interval that contains
//! all exact results of operands from the given intervals. Sums, products, quotients and square roots are correctly
//! rounded by the hardware and widened by one unit in the last place; the standard library's other functions are
//! widened by four, well above the error of the libraries in use (below one unit).

use crate::expr::graph::Function;
use crate::number::rational::{self, Rational};
use std::f64::consts::PI;
use std::ops::{Add, Mul, Neg, Sub};

/// A closed interval of real numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    lower: f64,
    upper: f64,
}

fn down(x: f64) -> f64 {
    if x == 0.0 { -f64::from_bits(1) } else { x.next_down() }
}

fn up(x: f64) -> f64 {
    if x == 0.0 { f64::from_bits(1) } else { x.next_up() }
}

/// Four units outwards.
fn loose(lower: f64, upper: f64) -> Interval {
    let (mut lower, mut upper) = (lower, upper);
    for _ in 0..4 {
        lower = down(lower);
        upper = up(upper);
    }
    Interval::hull(lower, upper)
}

impl Interval {
    /// All real numbers.
    pub const ALL: Self = Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY };

    /// The least interval with both numbers; everything when one is NaN.
    #[must_use]
    pub fn hull(a: f64, b: f64) -> Self {
        if a.is_nan() || b.is_nan() { Self::ALL } else { Self { lower: a.min(b), upper: a.max(b) } }
    }

    /// One floating-point number, exactly.
    #[must_use]
    pub fn point(x: f64) -> Self {
        Self::hull(x, x)
    }

    /// An interval around an exact number, of one unit in the last place unless it is a float itself.
    #[must_use]
    pub fn rational(value: &Rational) -> Self {
        let nearest = rational::to_f64(value);
        match rational::from_f64(nearest) {
            Some(back) if back == *value => Self::point(nearest),
            Some(back) if back < *value => Self::hull(nearest, up(nearest)),
            Some(_) => Self::hull(down(nearest), nearest),
            None if nearest > 0.0 => Self::hull(f64::MAX, nearest),
            None => Self::hull(nearest, f64::MIN),
        }
    }

    /// An interval around the circle constant.
    #[must_use]
    pub fn pi() -> Self {
        Self::hull(PI, up(PI))
    }

    /// The lower end.
    #[must_use]
    pub fn lower(self) -> f64 {
        self.lower
    }

    /// The upper end.
    #[must_use]
    pub fn upper(self) -> f64 {
        self.upper
    }

    /// The largest magnitude.
    #[must_use]
    pub fn magnitude(self) -> f64 {
        self.lower.abs().max(self.upper.abs())
    }

    /// Whether `x` lies in the interval.
    #[must_use]
    pub fn contains(self, x: f64) -> bool {
        self.lower <= x && x <= self.upper
    }

    /// The least interval that contains both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { lower: self.lower.min(other.lower), upper: self.upper.max(other.upper) }
    }

    /// An integer power; `None` when the exponent is negative and the interval contains 0.
    #[must_use]
    pub fn pow(self, exponent: i32) -> Option<Self> {
        if exponent < 0 {
            if self.contains(0.0) {
                return None;
            }
            let inverse = Self::hull(1.0 / self.upper, 1.0 / self.lower);
            return Self::hull(down(inverse.lower), up(inverse.upper)).pow(exponent.checked_neg()?);
        }
        // x^n of an interval is not the n-fold product: an even power is never negative.
        let base = if exponent % 2 == 0 { self.abs() } else { self };
        let end = |x: f64| (0..exponent).fold(Self::point(1.0), |product, _| product * Self::point(x));
        let (low, high) = (end(base.lower), end(base.upper));
        let result = low.union(high);
        Some(if exponent % 2 == 0 && exponent > 0 { Self::hull(result.lower.max(0.0), result.upper) } else { result })
    }

    /// The absolute value.
    #[must_use]
    pub fn abs(self) -> Self {
        if self.lower >= 0.0 {
            self
        } else if self.upper <= 0.0 {
            -self
        } else {
            Self { lower: 0.0, upper: self.magnitude() }
        }
    }

    /// The value of a function; `None` when it is not defined on the whole interval.
    #[must_use]
    pub fn function(self, function: Function) -> Option<Self> {
        let inside = |lower: f64, upper: f64| self.lower >= lower && self.upper <= upper;
        match function {
            Function::Sin => Some(self.wave(0.5, f64::sin)),
            Function::Cos => Some(self.wave(0.0, f64::cos)),
            Function::Tan => (!self.meets_lattice(0.5, 1.0)).then(|| loose(self.lower.tan(), self.upper.tan())),
            Function::Asin => inside(-1.0, 1.0).then(|| loose(self.lower.asin(), self.upper.asin())),
            Function::Acos => inside(-1.0, 1.0).then(|| loose(self.upper.acos(), self.lower.acos())),
            Function::Atan => Some(loose(self.lower.atan(), self.upper.atan())),
            Function::Sqrt => {
                let end = |x: f64| x.sqrt();
                (self.lower >= 0.0).then(|| Self::hull(down(end(self.lower)).max(0.0), up(end(self.upper))))
            }
            Function::Abs => Some(self.abs()),
            Function::Sign => {
                let sign = |x: f64| Function::Sign.apply(x);
                Some(Self::hull(sign(self.lower), sign(self.upper)))
            }
        }
    }

    /// sin or cos, whose maxima are at pi (2k + phase).
    fn wave(self, phase: f64, f: impl Fn(f64) -> f64) -> Self {
        if !(self.lower.is_finite() && self.upper.is_finite()) {
            return Self::hull(-1.0, 1.0);
        }
        let ends = loose(f(self.lower).min(f(self.upper)), f(self.lower).max(f(self.upper)));
        let upper = if self.meets_lattice(phase, 2.0) { 1.0 } else { ends.upper.min(1.0) };
        let lower = if self.meets_lattice(phase + 1.0, 2.0) { -1.0 } else { ends.lower.max(-1.0) };
        Self::hull(lower, upper)
    }

    /// Whether the interval may contain a number pi (phase + k step); "yes" when in doubt.
    fn meets_lattice(self, phase: f64, step: f64) -> bool {
        let index = |x: f64| (x / PI - phase) / step;
        let (low, high) = (index(self.lower), index(self.upper));
        let doubt = 8.0 * f64::EPSILON * (1.0 + low.abs().max(high.abs()));
        (low - doubt).ceil() <= (high + doubt).floor()
    }

    /// The angle of the points (x, y); `None` when the box contains the origin or meets the branch cut (y = 0, x < 0).
    #[must_use]
    pub fn atan2(y: Self, x: Self) -> Option<Self> {
        if x.lower <= 0.0 && y.contains(0.0) {
            return None;
        }
        let corners = [(y.lower, x.lower), (y.lower, x.upper), (y.upper, x.lower), (y.upper, x.upper)];
        let angles = corners.map(|(y, x)| y.atan2(x));
        let least = angles.iter().copied().fold(f64::INFINITY, f64::min);
        Some(loose(least, angles.iter().copied().fold(f64::NEG_INFINITY, f64::max)))
    }
}

impl Add for Interval {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::hull(down(self.lower + other.lower), up(self.upper + other.upper))
    }
}

impl Sub for Interval {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Interval {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        // A product with an exact 0 is 0, also where the other end is infinite.
        let times = |a: f64, b: f64| if a == 0.0 || b == 0.0 { 0.0 } else { a * b };
        if self == Self::point(0.0) || other == Self::point(0.0) {
            return Self::point(0.0);
        }
        let products = [
            times(self.lower, other.lower),
            times(self.lower, other.upper),
            times(self.upper, other.lower),
            times(self.upper, other.upper),
        ];
        let least = products.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = products.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self::hull(down(least), up(greatest))
    }
}

impl Neg for Interval {
    type Output = Self;

    fn neg(self) -> Self {
        Self { lower: -self.upper, upper: -self.lower }
    }
}

#[cfg(test)]
mod tests {
    use super::Interval;
    use crate::expr::graph::Function;
    use crate::number::rational::ratio;
    use proptest::prelude::{prop_assert, proptest};

    #[test]
    fn turning_points_are_inside() {
        let wave = |a, b, f| Interval::hull(a, b).function(f).expect("defined");
        assert_eq!(wave(1.0, 2.0, Function::Sin).upper(), 1.0);
        assert!(wave(1.0, 1.5, Function::Sin).upper() < 1.0);
        assert_eq!(wave(-0.1, 0.1, Function::Cos).upper(), 1.0);
        assert_eq!(wave(3.0, 3.2, Function::Cos).lower(), -1.0);
        assert_eq!(wave(0.0, 100.0, Function::Cos), Interval::hull(-1.0, 1.0));
        assert_eq!(Interval::hull(1.0, 2.0).function(Function::Tan), None);
        assert_eq!(Interval::hull(-1.0, 1.0).pow(-1), None);
        assert_eq!(Interval::hull(-1.0, 2.0).pow(2).expect("even").lower(), 0.0);
        assert_eq!(Interval::atan2(Interval::hull(-1.0, 1.0), Interval::hull(-2.0, -1.0)), None);
        assert!(Interval::rational(&ratio(1, 3)).lower() < Interval::rational(&ratio(1, 3)).upper());
    }

    proptest! {
        #[test]
        fn values_lie_inside(a in -4.0f64..4.0, b in -4.0f64..4.0, c in -4.0f64..4.0, s in 0.0f64..1.0, n in -4i32..5) {
            let (x, y) = (Interval::hull(a, b), Interval::hull(b, c));
            let inside = |i: Interval| (i.lower() + s * (i.upper() - i.lower())).clamp(i.lower(), i.upper());
            let (u, v) = (inside(x), inside(y));
            prop_assert!((x + y).contains(u + v) && (x * y).contains(u * v) && (x - y).contains(u - v));
            for f in [Function::Sin, Function::Cos, Function::Tan, Function::Asin, Function::Acos, Function::Atan,
                Function::Sqrt, Function::Abs, Function::Sign] {
                if let Some(value) = x.function(f) {
                    prop_assert!(value.contains(f.apply(u)), "{f:?} {x:?} {u}");
                }
            }
            if let Some(value) = x.pow(n) {
                prop_assert!(value.contains(u.powi(n)), "{x:?}^{n}");
            }
            if let Some(value) = Interval::atan2(y, x) {
                prop_assert!(value.contains(v.atan2(u)));
            }
        }
    }
}
