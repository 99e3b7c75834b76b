//! The scalar that models and estimators compute with.
//!
//! Invariant: every elementary function goes through `libm`, never through the platform's mathematics library, so that a
//! controller and a desk computer obtain the same bits from the same model.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A real number of fixed precision: `f32` or `f64`.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + SubAssign
    + Mul<Output = Self>
    + MulAssign
    + Div<Output = Self>
    + DivAssign
    + Neg<Output = Self>
    + 'static
{
    /// Zero.
    const ZERO: Self;
    /// One.
    const ONE: Self;
    /// Half the circumference of the unit circle.
    const PI: Self;
    /// The distance from one to the next larger number.
    const EPSILON: Self;

    /// The nearest number of this precision.
    fn from_f64(value: f64) -> Self;
    /// A constant that was rounded to each precision by itself: `double` or `single`, whichever is of this precision. Rounding
    /// a rational number to double and then to single precision is not always right.
    fn rounded(double: f64, single: f32) -> Self;
    /// The same value in double precision (exact for both scalars).
    fn to_f64(self) -> f64;

    /// Sine of an angle in radians.
    fn sin(self) -> Self;
    /// Cosine of an angle in radians.
    fn cos(self) -> Self;
    /// Tangent of an angle in radians.
    fn tan(self) -> Self;
    /// Principal arc sine in radians; not a number outside [-1, 1].
    fn asin(self) -> Self;
    /// Principal arc cosine in radians; not a number outside [-1, 1].
    fn acos(self) -> Self;
    /// Inverse tangent, in (-pi/2, pi/2).
    fn atan(self) -> Self;
    /// Angle of the point (`x`, `self`) in (-pi, pi].
    fn atan2(self, x: Self) -> Self;
    /// Square root; not a number below zero.
    fn sqrt(self) -> Self;
    /// Natural exponential.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Largest whole number that is not above `self`.
    fn floor(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The larger of two numbers; the other one when one is not a number.
    fn max(self, other: Self) -> Self;
    /// The smaller of two numbers; the other one when one is not a number.
    fn min(self, other: Self) -> Self;
    /// Neither infinite nor not a number.
    fn is_finite(self) -> bool;

    /// The three-valued sign: -1, 0 or 1 (0 at zero, unlike `f64::signum`); not a number stays so.
    ///
    /// Coulomb friction needs the zero: at rest on a rest-to-rest pattern `sgn(x') = 0`.
    fn sign(self) -> Self {
        if self > Self::ZERO {
            Self::ONE
        } else if self < Self::ZERO {
            -Self::ONE
        } else {
            // Zero of either sign becomes +0; a NaN stays visible instead of turning into a force of zero.
            self + Self::ZERO
        }
    }

    /// `self` to a whole power by repeated squaring; `x.powi(0)` is one.
    fn powi(self, exponent: u32) -> Self {
        let mut result = Self::ONE;
        let mut base = self;
        let mut left = exponent;
        while left > 0 {
            if left & 1 == 1 {
                result *= base;
            }
            left >>= 1;
            if left > 0 {
                base *= base;
            }
        }
        result
    }

    /// Sine and cosine of the same angle.
    fn sin_cos(self) -> (Self, Self) {
        (self.sin(), self.cos())
    }
}

macro_rules! real {
    ($scalar:ident, $pick:expr, $sin:ident $cos:ident $tan:ident $asin:ident $acos:ident $atan:ident $atan2:ident $sqrt:ident $exp:ident $log:ident $floor:ident $fabs:ident $fmax:ident $fmin:ident) => {
        impl Real for $scalar {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const PI: Self = core::$scalar::consts::PI;
            const EPSILON: Self = $scalar::EPSILON;

            // The identity for one of the two scalars, a rounding for the other.
            #[allow(clippy::unnecessary_cast)]
            #[inline]
            fn from_f64(value: f64) -> Self {
                value as $scalar
            }
            #[inline]
            fn rounded(double: f64, single: f32) -> Self {
                $pick(double, single)
            }
            #[inline]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline]
            fn sin(self) -> Self {
                libm::$sin(self)
            }
            #[inline]
            fn cos(self) -> Self {
                libm::$cos(self)
            }
            #[inline]
            fn tan(self) -> Self {
                libm::$tan(self)
            }
            #[inline]
            fn asin(self) -> Self {
                libm::$asin(self)
            }
            #[inline]
            fn acos(self) -> Self {
                libm::$acos(self)
            }
            #[inline]
            fn atan(self) -> Self {
                libm::$atan(self)
            }
            #[inline]
            fn atan2(self, x: Self) -> Self {
                libm::$atan2(self, x)
            }
            #[inline]
            fn sqrt(self) -> Self {
                libm::$sqrt(self)
            }
            #[inline]
            fn exp(self) -> Self {
                libm::$exp(self)
            }
            #[inline]
            fn ln(self) -> Self {
                libm::$log(self)
            }
            #[inline]
            fn floor(self) -> Self {
                libm::$floor(self)
            }
            #[inline]
            fn abs(self) -> Self {
                libm::$fabs(self)
            }
            #[inline]
            fn max(self, other: Self) -> Self {
                libm::$fmax(self, other)
            }
            #[inline]
            fn min(self, other: Self) -> Self {
                libm::$fmin(self, other)
            }
            #[inline]
            fn is_finite(self) -> bool {
                $scalar::is_finite(self)
            }
        }
    };
}

real!(f64, |double, _| double, sin cos tan asin acos atan atan2 sqrt exp log floor fabs fmax fmin);
real!(f32, |_, single| single, sinf cosf tanf asinf acosf atanf atan2f sqrtf expf logf floorf fabsf fmaxf fminf);
