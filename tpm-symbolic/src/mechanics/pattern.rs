//! Trajectory patterns: finite Fourier series with symbolic amplitudes (Feng, chapter 2, Eqns 4.13 and 4.42).
//!
//! A coordinate follows q(t) = sum_s m_s F_s(w t), where every m_s is a product of amplitudes and constants and every
//! F_s is a [`Fourier`] polynomial with exact coefficients. All coordinates of a pattern share the fundamental w.
//!
//! Rest-to-rest shapes are computed here in closed form. Any other end conditions are solved by
//! [`shape`](super::shape), which gives the same coefficients for rest-to-rest conditions.

use crate::algebra::fourier::Fourier;
use crate::algebra::polynomial::Monomial;
use crate::expr::graph::Symbol;
use crate::mechanics::shape::Solved;
use crate::number::rational;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use thiserror::Error;

/// The motion of one coordinate under a pattern.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Motion(Vec<(Monomial<Symbol>, Fourier)>);

impl Motion {
    /// The motion that is constantly 0.
    #[must_use]
    pub fn zero() -> Self {
        Self::default()
    }

    /// `monomial * fourier`.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fourier::Fourier, polynomial::Monomial}, expr::graph::Symbol, mechanics::pattern::*, number::rational::{integer, ratio}};
    /// let amplitude = Monomial::power_of(Symbol(0), 1);
    /// assert_eq!(Motion::term(amplitude, Fourier::zero()), Motion::zero());
    /// ```
    #[must_use]
    pub fn term(monomial: Monomial<Symbol>, fourier: Fourier) -> Self {
        if fourier.is_zero() { Self::zero() } else { Self(vec![(monomial, fourier)]) }
    }

    /// The motion of a shape that meets its end conditions.
    #[must_use]
    pub fn of_shape(shape: Solved) -> Self {
        shape.parts.into_iter().fold(Self::zero(), |sum, (monomial, series)| sum.add(&Self::term(monomial, series)))
    }

    /// The sum of two motions.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fourier::Fourier, polynomial::Monomial}, expr::graph::Symbol, mechanics::pattern::*, number::rational::{integer, ratio}};
    /// let cosine = Motion::term(Monomial::power_of(Symbol(0), 1), Fourier::cos(1, integer(1)));
    /// assert_eq!(cosine.add(&cosine), Motion::term(Monomial::power_of(Symbol(0), 1), Fourier::cos(1, integer(2))));
    /// ```
    #[must_use]
    pub fn add(&self, other: &Self) -> Self {
        let mut terms: BTreeMap<Monomial<Symbol>, Fourier> = self.0.iter().cloned().collect();
        for (monomial, fourier) in &other.0 {
            let sum = terms.get(monomial).map_or_else(|| fourier.clone(), |present| present.add(fourier));
            terms.insert(monomial.clone(), sum);
        }
        Self(terms.into_iter().filter(|(_, fourier)| !fourier.is_zero()).collect())
    }

    /// The product of two motions.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fourier::Fourier, polynomial::Monomial}, expr::graph::Symbol, mechanics::pattern::*, number::rational::{integer, ratio}};
    /// let cosine = Motion::term(Monomial::power_of(Symbol(0), 1), Fourier::cos(1, integer(1)));
    /// assert_eq!(cosine.mul(&cosine).highest_harmonic(), 2);
    /// ```
    #[must_use]
    pub fn mul(&self, other: &Self) -> Self {
        let mut result = Self::zero();
        for (left, a) in &self.0 {
            for (right, b) in &other.0 {
                result = result.add(&Self::term(left.mul(right), a.mul(b)));
            }
        }
        result
    }

    /// The parts, sorted by monomial.
    pub fn terms(&self) -> impl ExactSizeIterator<Item = &(Monomial<Symbol>, Fourier)> {
        self.0.iter()
    }

    /// The n-th derivative with respect to the phase; the time derivative is w^n times it.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fourier::Fourier, polynomial::Monomial}, expr::graph::Symbol, mechanics::pattern::*, number::rational::{integer, ratio}};
    /// let cosine = Motion::term(Monomial::power_of(Symbol(0), 1), Fourier::cos(2, integer(1)));
    /// assert_eq!(cosine.derivative(1), Motion::term(Monomial::power_of(Symbol(0), 1), Fourier::sin(2, integer(-2))));
    /// ```
    #[must_use]
    pub fn derivative(&self, order: u32) -> Self {
        let terms = self.0.iter().map(|(m, f)| (m.clone(), f.derivative(order)));
        Self(terms.filter(|(_, f)| !f.is_zero()).collect())
    }

    /// The highest harmonic of the motion.
    #[must_use]
    pub fn highest_harmonic(&self) -> usize {
        self.0.iter().map(|(_, f)| f.highest_harmonic()).max().unwrap_or(0)
    }
}

/// A named set of motions, one per coordinate that has one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pattern {
    /// The name, when the model gives one.
    pub name: Option<String>,
    /// The amplitudes, in order of declaration.
    pub amplitudes: Vec<Symbol>,
    /// The fundamental angular frequency w.
    pub frequency: Symbol,
    /// The motion of every coordinate, by index; `None` when the pattern does not give one.
    pub motions: Vec<Option<Motion>>,
}

/// Why a rest-to-rest shape does not exist.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ShapeError {
    /// The order is not odd.
    #[error("the order of a rest-to-rest pattern is its highest harmonic and must be odd and at least 1, not {0}")]
    NotOdd(u32),
    /// The order is beyond what a controller could play.
    #[error("a rest-to-rest pattern of order {0} is beyond the supported {MAX_ORDER}")]
    TooHigh(u32),
}

/// The highest order of [`rest_to_rest`].
pub const MAX_ORDER: u32 = 255;

/// The shape cos th + sum a_i cos (2i+1) th whose derivatives 1..=order vanish at th = 0 and th = pi (Feng, Eqns 2.4-2.9, 4.13).
///
/// `order` = 2l + 1 is also the highest harmonic; Feng, Eqn 2.21 is order 3 and Eqn 4.42 order 5. The velocity of such a motion is a
/// multiple of sin^order th, whose coefficients are binomial: a_i = (-1)^i C(2l+1, l-i) / ((2i+1) C(2l+1, l)).
///
/// ```
/// # use tpm_symbolic::{algebra::{fourier::Fourier, polynomial::Monomial}, expr::graph::Symbol, mechanics::pattern::*, number::rational::{integer, ratio}};
/// assert_eq!(rest_to_rest(3), Ok(Fourier::cos(1, integer(1)).add(&Fourier::cos(3, ratio(-1, 9)))));
/// assert!(rest_to_rest(2).is_err());
/// ```
///
/// # Errors
/// When `order` is even, zero or above [`MAX_ORDER`].
pub fn rest_to_rest(order: u32) -> Result<Fourier, ShapeError> {
    if order.is_multiple_of(2) {
        return Err(ShapeError::NotOdd(order));
    }
    if order > MAX_ORDER {
        return Err(ShapeError::TooHigh(order));
    }
    let l = i64::from(order / 2);
    let mut cosines = Vec::with_capacity(order as usize + 1);
    // (2i+1) a_i, from one binomial coefficient to the next.
    let mut weight = rational::integer(1);
    for i in 0..=l {
        cosines.push(rational::integer(0));
        cosines.push(&weight / rational::integer(2 * i + 1));
        weight *= rational::ratio(i - l, l + i + 2);
    }
    Ok(Fourier::from_parts(cosines, Vec::new()))
}

#[cfg(test)]
mod tests {
    use super::{ShapeError, rest_to_rest};
    use crate::algebra::fourier::Fourier;
    use crate::algebra::polynomial::Polynomial;
    use crate::mechanics::shape::{Condition, End, EndPhase, Shape};
    use crate::number::rational::{integer, ratio};

    /// The series of these cosines, the first with the coefficient 1, whose even derivatives up to an order vanish at both ends. Odd ones
    /// vanish there by themselves.
    fn at_rest(cosines: impl IntoIterator<Item = u32>, order: u32) -> Fourier {
        let zero = |order| [End::Start, End::Finish].map(|end| Condition { end, order, value: Polynomial::zero() });
        let shape = Shape {
            cosines: cosines.into_iter().collect(),
            sines: [].into(),
            end: EndPhase::Pi(integer(1)),
            conditions: (2..=order).step_by(2).flat_map(zero).collect(),
            amplitude: Some(Polynomial::one()),
        };
        let solved = shape.solve().expect("solvable");
        assert_eq!((solved.parts.len(), solved.freedom), (1, 0));
        solved.parts[0].1.clone()
    }

    #[test]
    fn the_closed_form_is_what_the_end_conditions_give() {
        // Conditions on derivatives above the 31st are refused.
        for order in (1..=31).step_by(2) {
            assert_eq!(
                rest_to_rest(order).expect("odd order"),
                at_rest((1..=order).step_by(2), order),
                "order {order}"
            );
        }
    }

    #[test]
    fn derivatives_vanish_at_both_ends_up_to_the_order_and_no_further() {
        for order in [3u32, 5, 7, 9, 11, 13, 41] {
            let pattern = rest_to_rest(order).expect("odd order");
            for n in 1..=order {
                let derivative = pattern.derivative(n);
                assert_eq!(derivative.at_zero(), ratio(0, 1));
                assert_eq!(derivative.at_pi(), ratio(0, 1));
            }
            assert_ne!(pattern.derivative(order + 1).at_zero(), ratio(0, 1));
        }
    }

    #[test]
    fn travel_is_twice_the_start() {
        // Feng, below Eqn 2.21: x(0) = 8/9 lambda for l = 1; 64/75 for l = 2 (errata: travel 16/9 and 128/75 lambda).
        let start = |order| rest_to_rest(order).expect("odd order").at_zero();
        assert_eq!(start(3), ratio(8, 9));
        assert_eq!(start(5), ratio(64, 75));
        assert_eq!(rest_to_rest(3).expect("odd order").at_pi(), ratio(-8, 9));
    }

    #[test]
    fn user_chosen_harmonics_and_conditions() {
        // Acceleration zero at both ends with harmonics 1 and 5 instead of 1 and 3.
        assert_eq!(at_rest([1, 5], 3).cos_coefficient(5), ratio(-1, 25));
        assert_eq!(rest_to_rest(4), Err(ShapeError::NotOdd(4)));
    }
}
