//! Rational numbers of any size, stored in two machine words while they fit.
//!
//! Nearly all numbers of models and tables are small; for them an operation is a few instructions, without allocation,
//! and num-rational takes over where a word is too short (`DESIGN.md`, "How can exact arithmetic be fast enough?").
//!
//! Invariant of [`Rational`]: lowest terms and a positive denominator; `Small` whenever the magnitudes of numerator and
//! denominator are at most `i64::MAX`, `Big` otherwise. Equal numbers are therefore equal as data.

use crate::budget;
use num_bigint::BigInt;
use num_integer::Integer;
use num_rational::BigRational;
use num_traits::pow::Pow;
use num_traits::{One, Signed, ToPrimitive, Zero};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::num::NonZeroI64;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// An exact rational number of any size.
#[derive(Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(from = "BigRational", into = "BigRational")]
pub struct Rational(Value);

#[derive(Clone, PartialEq, Eq)]
enum Value {
    Small(i64, NonZeroI64),
    Big(Box<BigRational>),
}

/// num-rational hashes a quotient by its continued fraction, which takes one division per digit. For quotients in
/// lowest terms a hash of numerator and denominator suffices.
impl Hash for Value {
    fn hash<H: Hasher>(&self, state: &mut H) {
        match self {
            Self::Small(numerator, denominator) => (numerator, denominator).hash(state),
            Self::Big(value) => (value.numer(), value.denom()).hash(state),
        }
    }
}

const ONE: NonZeroI64 = NonZeroI64::new(1).expect("one is not zero");

/// A numerator and a denominator in lowest terms, the denominator positive.
fn reduced(numerator: i128, denominator: i128) -> Rational {
    match (i64::try_from(numerator), i64::try_from(denominator)) {
        (Ok(n), Ok(d)) if n != i64::MIN => Rational::small(n, d),
        _ => Rational(Value::Big(Box::new(BigRational::new_raw(numerator.into(), denominator.into())))),
    }
}

impl Rational {
    /// `numerator / denominator`, the denominator positive.
    pub(crate) fn from_wide(numerator: i128, denominator: i128) -> Self {
        if denominator == 1 {
            return reduced(numerator, 1);
        }
        let common = numerator.gcd(&denominator);
        reduced(numerator / common, denominator / common)
    }

    fn small(numerator: i64, denominator: i64) -> Self {
        Self(Value::Small(numerator, NonZeroI64::new(denominator).expect("invariant: denominators are positive")))
    }

    /// `numerator / denominator`.
    ///
    /// ```
    /// # use tpm_symbolic::number::rational::{Rational, integer, ratio};
    /// assert_eq!(Rational::new(6.into(), 4.into()), ratio(3, 2));
    /// ```
    ///
    /// # Panics
    /// When `denominator` is zero.
    #[must_use]
    pub fn new(numerator: BigInt, denominator: BigInt) -> Self {
        match (numerator.to_i64(), denominator.to_i64()) {
            (Some(n), Some(d)) if n != i64::MIN && d != i64::MIN && d != 0 => Self::quotient(n, d),
            _ => {
                charge_reduction((numerator.bits() + denominator.bits()) / 64);
                BigRational::new(numerator, denominator).into()
            }
        }
    }

    /// A quotient of words, the denominator not zero and neither `i64::MIN`.
    fn quotient(n: i64, d: i64) -> Self {
        let divisor = n.gcd(&d) * d.signum();
        Self::small(n / divisor, d / divisor)
    }

    /// The whole number `value`.
    #[must_use]
    pub fn from_integer(value: BigInt) -> Self {
        match value.to_i64() {
            Some(n) if n != i64::MIN => Self(Value::Small(n, ONE)),
            _ => Self(Value::Big(Box::new(BigRational::from_integer(value)))),
        }
    }

    /// A number from a numerator and a positive denominator without a common divisor.
    pub(crate) fn from_lowest_terms(numerator: BigInt, denominator: BigInt) -> Self {
        BigRational::new_raw(numerator, denominator).into()
    }

    /// The exact value of a finite `f64`; `None` for infinities and NaN.
    #[must_use]
    pub fn from_float(value: f64) -> Option<Self> {
        BigRational::from_float(value).map(Self::from)
    }

    /// Numerator and denominator when both fit a word.
    ///
    /// ```
    /// # use tpm_symbolic::number::rational::{Rational, integer, ratio};
    /// assert_eq!(ratio(6, 4).as_words(), Some((3, 2)));
    /// assert_eq!(integer(i64::MAX).pow(2).as_words(), None);
    /// ```
    #[must_use]
    #[inline]
    pub fn as_words(&self) -> Option<(i64, i64)> {
        match &self.0 {
            Value::Small(n, d) => Some((*n, d.get())),
            Value::Big(_) => None,
        }
    }

    /// The numerator, which carries the sign.
    ///
    /// ```
    /// # use tpm_symbolic::number::rational::{Rational, integer, ratio};
    /// assert_eq!(ratio(6, -4).numer(), (-3).into());
    /// ```
    #[must_use]
    pub fn numer(&self) -> BigInt {
        match &self.0 {
            Value::Small(n, _) => BigInt::from(*n),
            Value::Big(value) => value.numer().clone(),
        }
    }

    /// The denominator, positive.
    ///
    /// ```
    /// # use tpm_symbolic::number::rational::{Rational, integer, ratio};
    /// assert_eq!(ratio(6, -4).denom(), 2.into());
    /// ```
    #[must_use]
    pub fn denom(&self) -> BigInt {
        match &self.0 {
            Value::Small(_, d) => BigInt::from(d.get()),
            Value::Big(value) => value.denom().clone(),
        }
    }

    /// Whether this is a whole number.
    #[must_use]
    pub fn is_integer(&self) -> bool {
        match &self.0 {
            Value::Small(_, d) => *d == ONE,
            Value::Big(value) => value.is_integer(),
        }
    }

    /// The whole part, rounded towards zero.
    ///
    /// ```
    /// # use tpm_symbolic::number::rational::{Rational, integer, ratio};
    /// assert_eq!(ratio(-7, 2).to_integer(), (-3).into());
    /// ```
    #[must_use]
    pub fn to_integer(&self) -> BigInt {
        match &self.0 {
            Value::Small(n, d) => BigInt::from(n / d.get()),
            Value::Big(value) => value.to_integer(),
        }
    }

    /// The reciprocal.
    ///
    /// ```
    /// # use tpm_symbolic::number::rational::{Rational, integer, ratio};
    /// assert_eq!(ratio(-3, 2).recip(), ratio(-2, 3));
    /// ```
    ///
    /// # Panics
    /// When the number is zero.
    #[must_use]
    pub fn recip(&self) -> Self {
        match &self.0 {
            Value::Small(n, d) if *n != 0 => Self::small(d.get() * n.signum(), n.abs()),
            _ => self.big().recip().into(),
        }
    }

    /// An integer power.
    ///
    /// ```
    /// # use tpm_symbolic::number::rational::{Rational, integer, ratio};
    /// assert_eq!(ratio(-3, 2).pow(-2), ratio(4, 9));
    /// ```
    ///
    /// # Panics
    /// For a negative power of zero.
    #[must_use]
    pub fn pow(&self, exponent: i32) -> Self {
        Pow::pow(self, exponent)
    }

    /// Number of words of numerator and denominator together.
    fn words(&self) -> u64 {
        match &self.0 {
            Value::Small(..) => 2,
            Value::Big(value) => (value.numer().bits() + value.denom().bits()) / 64 + 2,
        }
    }

    /// Charges the budget for a power, of which the last multiplication takes longest.
    fn charge_power(&self, exponent: u32) {
        let words = self.words().saturating_mul(u64::from(exponent));
        budget::charge(words.saturating_mul(words));
    }

    fn big(&self) -> BigRational {
        match &self.0 {
            Value::Small(n, d) => BigRational::new_raw(BigInt::from(*n), BigInt::from(d.get())),
            Value::Big(value) => (**value).clone(),
        }
    }

    #[inline]
    fn plus(&self, other: &Self) -> Self {
        let (Value::Small(a, b), Value::Small(c, d)) = (&self.0, &other.0) else {
            return self.plus_big(other);
        };
        let (b, d) = (b.get(), d.get());
        if b == 1 && d == 1 {
            return reduced(i128::from(*a) + i128::from(*c), 1);
        }
        let common = b.gcd(&d);
        // |a d + c b| < 2^127, since each product is of two words below 2^63.
        let sum = i128::from(*a) * i128::from(d / common) + i128::from(*c) * i128::from(b / common);
        let rest = (sum % i128::from(common)) as i64;
        let divisor = i128::from(rest.gcd(&common));
        reduced(sum / divisor, i128::from(b / common) * (i128::from(d) / divisor))
    }

    #[inline]
    fn times(&self, other: &Self) -> Self {
        let (Value::Small(a, b), Value::Small(c, d)) = (&self.0, &other.0) else {
            return self.times_big(other);
        };
        let (a, b, c, d) = (*a, b.get(), *c, d.get());
        if b == 1 && d == 1 {
            return reduced(i128::from(a) * i128::from(c), 1);
        }
        let (left, right) = (a.gcd(&d), c.gcd(&b));
        reduced(i128::from(a / left) * i128::from(c / right), i128::from(b / right) * i128::from(d / left))
    }

    /// The sum for values beyond one word. For whole numbers the common divisor, which takes most of the time of a sum,
    /// is not computed.
    #[cold]
    fn plus_big(&self, other: &Self) -> Self {
        match (self.is_zero(), other.is_zero()) {
            (true, _) => other.clone(),
            (_, true) => self.clone(),
            _ if self.is_integer() && other.is_integer() => {
                budget::charge(self.words() + other.words());
                Self::from_integer(self.numer() + other.numer())
            }
            _ => {
                charge_reduction(self.words() + other.words());
                (self.big() + other.big()).into()
            }
        }
    }

    /// The product for values beyond one word. For whole numbers no common divisors are computed.
    #[cold]
    fn times_big(&self, other: &Self) -> Self {
        if self.is_zero() || other.is_zero() {
            return Self::zero();
        }
        match (self.is_integer(), other.is_integer()) {
            (true, true) => {
                budget::charge(self.words().saturating_mul(other.words()));
                Self::from_integer(self.numer() * other.numer())
            }
            _ => {
                charge_reduction(self.words() + other.words());
                (self.big() * other.big()).into()
            }
        }
    }

    fn minus(&self, other: &Self) -> Self {
        self.plus(&-other)
    }

    /// # Panics
    /// When `other` is zero.
    fn over(&self, other: &Self) -> Self {
        self.times(&other.recip())
    }
}

/// Charges the budget for bringing a quotient of `words` words into lowest terms. Stein's algorithm passes through the
/// numbers once for every bit, and allocates.
fn charge_reduction(words: u64) {
    budget::charge(24u64.saturating_mul(words).saturating_mul(words + 40));
}

impl From<BigRational> for Rational {
    fn from(value: BigRational) -> Self {
        match (value.numer().to_i64(), value.denom().to_i64()) {
            (Some(n), Some(d)) if n != i64::MIN => Self::small(n, d),
            _ => Self(Value::Big(Box::new(value))),
        }
    }
}

impl From<Rational> for BigRational {
    fn from(value: Rational) -> Self {
        match value.0 {
            Value::Small(..) => value.big(),
            Value::Big(big) => *big,
        }
    }
}

impl From<BigInt> for Rational {
    fn from(value: BigInt) -> Self {
        Self::from_integer(value)
    }
}

impl Zero for Rational {
    fn zero() -> Self {
        Self(Value::Small(0, ONE))
    }

    #[inline]
    fn is_zero(&self) -> bool {
        matches!(self.0, Value::Small(0, _))
    }
}

impl One for Rational {
    fn one() -> Self {
        Self(Value::Small(1, ONE))
    }

    #[inline]
    fn is_one(&self) -> bool {
        matches!(self.0, Value::Small(1, ONE))
    }
}

impl Neg for Rational {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        match self.0 {
            Value::Small(n, d) => Self(Value::Small(-n, d)),
            Value::Big(value) => Self(Value::Big(Box::new(-*value))),
        }
    }
}

impl Neg for &Rational {
    type Output = Rational;

    #[inline]
    fn neg(self) -> Rational {
        -self.clone()
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $assign:ident, $assign_method:ident, $with:ident) => {
        impl $trait for Rational {
            type Output = Rational;
            fn $method(self, other: Rational) -> Rational {
                self.$with(&other)
            }
        }
        impl $trait<&Rational> for Rational {
            type Output = Rational;
            fn $method(self, other: &Rational) -> Rational {
                self.$with(other)
            }
        }
        impl $trait<Rational> for &Rational {
            type Output = Rational;
            fn $method(self, other: Rational) -> Rational {
                self.$with(&other)
            }
        }
        impl $trait for &Rational {
            type Output = Rational;
            fn $method(self, other: &Rational) -> Rational {
                self.$with(other)
            }
        }
        impl $assign for Rational {
            fn $assign_method(&mut self, other: Rational) {
                *self = self.$with(&other);
            }
        }
        impl $assign<&Rational> for Rational {
            fn $assign_method(&mut self, other: &Rational) {
                *self = self.$with(other);
            }
        }
    };
}
operator!(Add, add, AddAssign, add_assign, plus);
operator!(Sub, sub, SubAssign, sub_assign, minus);
operator!(Mul, mul, MulAssign, mul_assign, times);
operator!(Div, div, DivAssign, div_assign, over);

impl std::iter::Sum for Rational {
    fn sum<I: Iterator<Item = Self>>(numbers: I) -> Self {
        numbers.fold(Self::zero(), |sum, number| sum + number)
    }
}

impl<'a> std::iter::Sum<&'a Self> for Rational {
    fn sum<I: Iterator<Item = &'a Self>>(numbers: I) -> Self {
        numbers.fold(Self::zero(), |sum, number| sum + number)
    }
}

impl std::iter::Product for Rational {
    fn product<I: Iterator<Item = Self>>(numbers: I) -> Self {
        numbers.fold(Self::one(), |product, number| product * number)
    }
}

/// Integer powers.
///
/// # Panics
/// For a negative power of zero.
impl Pow<i32> for &Rational {
    type Output = Rational;

    fn pow(self, exponent: i32) -> Rational {
        let base = if exponent < 0 { self.recip() } else { self.clone() };
        Pow::pow(&base, exponent.unsigned_abs())
    }
}

impl Pow<u32> for &Rational {
    type Output = Rational;

    fn pow(self, exponent: u32) -> Rational {
        match &self.0 {
            // Powers of numbers in lowest terms are in lowest terms.
            Value::Small(n, d) => match (n.checked_pow(exponent), d.get().checked_pow(exponent)) {
                (Some(n), Some(d)) if n != i64::MIN => Rational::small(n, d),
                _ => {
                    self.charge_power(exponent);
                    Pow::pow(&self.big(), exponent).into()
                }
            },
            Value::Big(value) => {
                self.charge_power(exponent);
                Pow::pow(&**value, exponent).into()
            }
        }
    }
}

impl PartialOrd for Rational {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Rational {
    fn cmp(&self, other: &Self) -> Ordering {
        match (&self.0, &other.0) {
            (Value::Small(a, b), Value::Small(c, d)) if b == d => a.cmp(c),
            (Value::Small(a, b), Value::Small(c, d)) => {
                (i128::from(*a) * i128::from(d.get())).cmp(&(i128::from(*c) * i128::from(b.get())))
            }
            _ => self.big().cmp(&other.big()),
        }
    }
}

impl num_traits::Num for Rational {
    type FromStrRadixErr = <BigRational as num_traits::Num>::FromStrRadixErr;

    fn from_str_radix(text: &str, radix: u32) -> Result<Self, Self::FromStrRadixErr> {
        BigRational::from_str_radix(text, radix).map(Self::from)
    }
}

/// The remainder of division rounded towards zero, as in num-rational.
impl std::ops::Rem for Rational {
    type Output = Self;

    fn rem(self, other: Self) -> Self {
        (self.big() % other.big()).into()
    }
}

impl Signed for Rational {
    fn abs(&self) -> Self {
        if self.is_negative() { -self } else { self.clone() }
    }

    fn abs_sub(&self, other: &Self) -> Self {
        if self <= other { Self::zero() } else { self - other }
    }

    fn signum(&self) -> Self {
        match (self.is_zero(), self.is_negative()) {
            (true, _) => Self::zero(),
            (_, true) => -Self::one(),
            _ => Self::one(),
        }
    }

    fn is_positive(&self) -> bool {
        !self.is_zero() && !self.is_negative()
    }

    fn is_negative(&self) -> bool {
        match &self.0 {
            Value::Small(n, _) => *n < 0,
            Value::Big(value) => value.is_negative(),
        }
    }
}

/// `n` or `n/d`.
impl fmt::Display for Rational {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Value::Small(n, d) if *d == ONE => fmt::Display::fmt(n, f),
            _ => fmt::Display::fmt(&self.big(), f),
        }
    }
}

impl fmt::Debug for Rational {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.big(), f)
    }
}

#[cfg(test)]
mod tests {
    use super::{Rational, Value};
    use num_bigint::BigInt;
    use num_rational::BigRational;
    use num_traits::pow::Pow;
    use num_traits::{Signed, ToPrimitive, Zero};
    use proptest::prelude::{Just, Strategy, any, prop_assert_eq, prop_oneof, proptest};

    /// Whole numbers near the limits of one word, and small ones with common factors.
    fn whole() -> impl Strategy<Value = BigInt> {
        let edge = prop_oneof![Just(i64::MIN), Just(i64::MAX), Just(i64::MIN + 1), Just(0), Just(1), Just(-1)];
        prop_oneof![
            any::<i64>().prop_map(BigInt::from),
            edge.prop_map(BigInt::from),
            (-30i64..30).prop_map(BigInt::from),
            any::<i128>().prop_map(BigInt::from),
        ]
    }

    fn big() -> impl Strategy<Value = BigRational> {
        (whole(), whole().prop_filter("a denominator", |d| !d.is_zero())).prop_map(|(n, d)| BigRational::new(n, d))
    }

    fn canonical(value: &Rational) -> bool {
        let fits = |part: &BigInt| part.to_i64().is_some_and(|word| word != i64::MIN);
        match &value.0 {
            Value::Small(n, d) => d.get() > 0 && *n != i64::MIN,
            Value::Big(value) => !(fits(value.numer()) && fits(value.denom())),
        }
    }

    proptest! {
        #[test]
        fn agrees_with_num_rational(a in big(), b in big(), exponent in 0u32..5) {
            let (x, y) = (Rational::from(a.clone()), Rational::from(b.clone()));
            let mut results = vec![
                (&x + &y, &a + &b),
                (&x - &y, &a - &b),
                (&x * &y, &a * &b),
                (-&x, -&a),
                (x.abs(), a.abs()),
                (x.signum(), a.signum()),
                (x.abs_sub(&y), a.abs_sub(&b)),
                (Pow::pow(&x, exponent), Pow::pow(&a, exponent)),
                (Rational::new(a.numer().clone() * b.denom(), a.denom().clone() * b.denom()), a.clone()),
                (Rational::new(-a.numer(), -a.denom()), a.clone()),
                (Rational::from_integer(a.numer().clone()), BigRational::from_integer(a.numer().clone())),
            ];
            if !b.is_zero() {
                results.push((&x / &y, &a / &b));
                results.push((x.clone() % y.clone(), &a % &b));
                results.push((y.recip(), b.recip()));
                results.push((Pow::pow(&y, -2), Pow::pow(&b, -2)));
            }
            for (own, expected) in results {
                assert!(canonical(&own), "{own:?}");
                prop_assert_eq!(own.to_string(), expected.to_string());
                prop_assert_eq!(own, Rational::from(expected));
            }
            prop_assert_eq!(x.cmp(&y), a.cmp(&b));
            prop_assert_eq!(x == y, a == b);
            prop_assert_eq!((x.is_integer(), x.to_integer()), (a.is_integer(), a.to_integer()));
            prop_assert_eq!((x.numer(), x.denom()), (a.numer().clone(), a.denom().clone()));
        }
    }

    #[test]
    fn two_words() {
        assert_eq!(size_of::<Rational>(), 16);
    }
}
