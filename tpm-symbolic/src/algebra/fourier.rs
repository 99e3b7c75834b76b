//! Fourier (trigonometric) polynomials with exact rational coefficients in the phase theta = w t.
//!
//! Invariant of [`Fourier`]: the coefficient lists end with a non-zero entry, and the sine of harmonic 0 is not stored
//! (`sin[0]` is the coefficient of sin theta). Equal functions are therefore equal as data.

use crate::number::rational::{self, Rational};
use num_traits::Zero;
use serde::{Deserialize, Serialize};

/// sum_k c_k cos(k theta) + s_k sin(k theta).
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Fourier {
    cos: Vec<Rational>,
    sin: Vec<Rational>,
}

impl Fourier {
    /// The zero function.
    #[must_use]
    pub fn zero() -> Self {
        Self::default()
    }

    /// A constant function.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::constant(integer(3)).evaluate(0.5), 3.0);
    /// ```
    #[must_use]
    pub fn constant(value: Rational) -> Self {
        Self::from_parts(vec![value], Vec::new())
    }

    /// `coefficient * cos(harmonic * theta)`.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::cos(2, integer(3)).evaluate(0.0), 3.0);
    /// ```
    #[must_use]
    pub fn cos(harmonic: usize, coefficient: Rational) -> Self {
        let mut cos = vec![Rational::zero(); harmonic];
        cos.push(coefficient);
        Self::from_parts(cos, Vec::new())
    }

    /// `coefficient * sin(harmonic * theta)`; zero for harmonic 0.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::sin(0, integer(3)), Fourier::zero());
    /// ```
    #[must_use]
    pub fn sin(harmonic: usize, coefficient: Rational) -> Self {
        if harmonic == 0 {
            return Self::zero();
        }
        let mut sin = vec![Rational::zero(); harmonic - 1];
        sin.push(coefficient);
        Self::from_parts(Vec::new(), sin)
    }

    /// The polynomial with the given cosine coefficients of harmonics 0, 1, ... and sine coefficients of
    /// harmonics 1, 2, ...
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// let series = Fourier::from_parts(vec![integer(1)], vec![integer(0), integer(2)]);
    /// assert_eq!(series, Fourier::constant(integer(1)).add(&Fourier::sin(2, integer(2))));
    /// ```
    #[must_use]
    pub fn from_parts(mut cos: Vec<Rational>, mut sin: Vec<Rational>) -> Self {
        for list in [&mut cos, &mut sin] {
            while list.last().is_some_and(Zero::is_zero) {
                list.pop();
            }
        }
        Self { cos, sin }
    }

    /// Whether this is the zero function.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert!(Fourier::cos(3, integer(0)).is_zero());
    /// ```
    #[must_use]
    pub fn is_zero(&self) -> bool {
        self.cos.is_empty() && self.sin.is_empty()
    }

    /// The cosine coefficient of a harmonic.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::cos(3, ratio(-1, 9)).cos_coefficient(3), ratio(-1, 9));
    /// ```
    #[must_use]
    pub fn cos_coefficient(&self, harmonic: usize) -> Rational {
        self.cos.get(harmonic).cloned().unwrap_or_else(Rational::zero)
    }

    /// The sine coefficient of a harmonic.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::cos(3, ratio(-1, 9)).sin_coefficient(3), integer(0));
    /// ```
    #[must_use]
    pub fn sin_coefficient(&self, harmonic: usize) -> Rational {
        harmonic.checked_sub(1).and_then(|i| self.sin.get(i).cloned()).unwrap_or_else(Rational::zero)
    }

    /// The highest harmonic with a non-zero coefficient, 0 for constants.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::cos(3, integer(1)).mul(&Fourier::sin(2, integer(1))).highest_harmonic(), 5);
    /// ```
    #[must_use]
    pub fn highest_harmonic(&self) -> usize {
        self.sin.len().max(self.cos.len().saturating_sub(1))
    }

    /// The sum.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// let sine = Fourier::sin(1, integer(1));
    /// assert_eq!(sine.add(&sine), Fourier::sin(1, integer(2)));
    /// ```
    #[must_use]
    pub fn add(&self, other: &Self) -> Self {
        let add = |a: &[Rational], b: &[Rational]| -> Vec<Rational> {
            let zero = Rational::zero();
            (0..a.len().max(b.len())).map(|i| a.get(i).unwrap_or(&zero) + b.get(i).unwrap_or(&zero)).collect()
        };
        Self::from_parts(add(&self.cos, &other.cos), add(&self.sin, &other.sin))
    }

    /// The difference.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// let sine = Fourier::sin(1, integer(1));
    /// assert!(sine.sub(&sine).is_zero());
    /// ```
    #[must_use]
    pub fn sub(&self, other: &Self) -> Self {
        self.add(&other.scale(&rational::integer(-1)))
    }

    /// Every coefficient multiplied by `factor`.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::cos(1, integer(3)).scale(&ratio(1, 6)), Fourier::cos(1, ratio(1, 2)));
    /// ```
    #[must_use]
    pub fn scale(&self, factor: &Rational) -> Self {
        let scale = |list: &[Rational]| list.iter().map(|c| c * factor).collect();
        Self::from_parts(scale(&self.cos), scale(&self.sin))
    }

    /// The n-th derivative with respect to the phase theta; a time derivative is w^n times it.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::sin(3, integer(1)).derivative(1), Fourier::cos(3, integer(3)));
    /// ```
    #[must_use]
    pub fn derivative(&self, order: u32) -> Self {
        let mut result = self.clone();
        for _ in 0..order {
            let harmonic = |i: usize| rational::integer(i64::try_from(i).expect("invariant: harmonics fit in i64"));
            let cos = std::iter::once(Rational::zero())
                .chain(result.sin.iter().enumerate().map(|(i, s)| s * harmonic(i + 1)))
                .collect();
            let sin = result.cos.iter().enumerate().skip(1).map(|(i, c)| -(c * harmonic(i))).collect();
            result = Self::from_parts(cos, sin);
        }
        result
    }

    /// The function f(n theta), the phase being multiplied by a positive whole number n.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::cos(2, integer(5)).with_multiple(3), Fourier::cos(6, integer(5)));
    /// ```
    #[must_use]
    pub fn with_multiple(&self, n: usize) -> Self {
        let mut cos = vec![Rational::zero(); self.cos.len().saturating_sub(1) * n + 1];
        for (i, c) in self.cos.iter().enumerate() {
            cos[i * n] = c.clone();
        }
        let mut sin = vec![Rational::zero(); self.sin.len() * n];
        for (i, s) in self.sin.iter().enumerate() {
            sin[(i + 1) * n - 1] = s.clone();
        }
        Self::from_parts(cos, sin)
    }

    /// The exact value at theta = 0.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::cos(1, integer(5)).add(&Fourier::sin(1, integer(7))).at_zero(), integer(5));
    /// ```
    #[must_use]
    pub fn at_zero(&self) -> Rational {
        self.cos.iter().sum()
    }

    /// The exact value at theta = pi.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::cos(3, integer(5)).at_pi(), integer(-5));
    /// ```
    #[must_use]
    pub fn at_pi(&self) -> Rational {
        self.cos.iter().enumerate().map(|(i, c)| if i % 2 == 0 { c.clone() } else { -c }).sum()
    }

    /// The value at a phase, in double precision.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::cos(2, integer(5)).evaluate(std::f64::consts::PI), 5.0);
    /// ```
    #[must_use]
    pub fn evaluate(&self, theta: f64) -> f64 {
        let cos = self.cos.iter().enumerate().map(|(i, c)| rational::to_f64(c) * (i as f64 * theta).cos());
        let sin = self.sin.iter().enumerate().map(|(i, s)| rational::to_f64(s) * ((i + 1) as f64 * theta).sin());
        cos.chain(sin).sum()
    }

    /// The non-zero coefficients: first those of the cosines, then those of the sines.
    pub(crate) fn coefficients(&self) -> impl Iterator<Item = &Rational> {
        self.cos.iter().chain(&self.sin).filter(|value| !value.is_zero())
    }

    /// The non-zero coefficients of the cosine and the sine of a harmonic.
    pub(crate) fn pair(&self, harmonic: usize) -> [Option<&Rational>; 2] {
        let sin = harmonic.checked_sub(1).and_then(|i| self.sin.get(i));
        [self.cos.get(harmonic), sin].map(|value| value.filter(|value| !value.is_zero()))
    }

    /// Non-zero coefficients: (harmonic, cosine or sine, value), by harmonic, cosine first.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// let series = Fourier::sin(1, integer(2)).add(&Fourier::cos(1, integer(3)));
    /// assert_eq!(series.terms().map(|(k, function, _)| (k, function)).collect::<Vec<_>>(), [(1, Trig::Cos), (1, Trig::Sin)]);
    /// ```
    pub fn terms(&self) -> impl Iterator<Item = (usize, Trig, &Rational)> {
        (0..=self.highest_harmonic()).flat_map(move |k| {
            let cos = self.cos.get(k).map(|c| (k, Trig::Cos, c));
            let sin = k.checked_sub(1).and_then(|i| self.sin.get(i)).map(|s| (k, Trig::Sin, s));
            cos.into_iter().chain(sin).filter(|(_, _, value)| !value.is_zero())
        })
    }
}

/// Cosine or sine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Trig {
    /// Cosine.
    Cos,
    /// Sine.
    Sin,
}

impl Trig {
    /// `cos` or `sin`.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Trig::Sin.name(), "sin");
    /// ```
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Cos => "cos",
            Self::Sin => "sin",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Fourier;
    use crate::number::rational::ratio;
    use proptest::prelude::{Strategy, prop, prop_assert, prop_assert_eq, proptest};

    fn fourier() -> impl Strategy<Value = Fourier> {
        let list = || prop::collection::vec((-9i64..10, 1i64..6), 0..5);
        (list(), list()).prop_map(|(cos, sin)| {
            let exact = |list: Vec<(i64, i64)>| list.into_iter().map(|(n, d)| ratio(n, d)).collect();
            Fourier::from_parts(exact(cos), exact(sin))
        })
    }

    proptest! {
        #[test]
        fn ring_axioms(a in fourier(), b in fourier(), c in fourier()) {
            prop_assert_eq!(a.mul(&b), b.mul(&a));
            prop_assert_eq!(a.mul(&b).mul(&c), a.mul(&b.mul(&c)));
            prop_assert_eq!(a.mul(&b.add(&c)), a.mul(&b).add(&a.mul(&c)));
            prop_assert!(a.sub(&a).is_zero());
        }

        #[test]
        fn product_rule(a in fourier(), b in fourier()) {
            let left = a.mul(&b).derivative(1);
            prop_assert_eq!(left, a.derivative(1).mul(&b).add(&a.mul(&b.derivative(1))));
        }

        #[test]
        fn products_agree_with_values(a in fourier(), b in fourier(), theta in -3.0f64..3.0) {
            let difference = a.mul(&b).evaluate(theta) - a.evaluate(theta) * b.evaluate(theta);
            prop_assert!(difference.abs() < 1e-10, "{}", difference);
        }

        #[test]
        fn a_multiple_of_the_phase_is_the_same_function(a in fourier(), n in 1usize..5, theta in -3.0f64..3.0) {
            let difference = a.with_multiple(n).evaluate(theta) - a.evaluate(n as f64 * theta);
            prop_assert!(difference.abs() < 1e-10, "{}", difference);
        }
    }
}
