//! Sparse multivariate Laurent polynomials with exact rational coefficients.
//!
//! Invariant: a [`Polynomial`] lists its terms in increasing order of the monomials, each once and with a coefficient that is
//! not zero. Two equal polynomials are therefore equal as data, and iteration order is deterministic.

use crate::algebra::product;
use crate::budget;
use crate::number::rational::{self, Rational};
use num_traits::{One, Zero};
use serde::{Deserialize, Serialize};
use smallvec::SmallVec;
use std::cmp::Ordering;

pub use crate::algebra::monomial::Monomial;

/// A finite sum of rational multiples of monomials.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Polynomial<V: Ord>(Terms<V>);

/// Terms of a polynomial. One term is stored inline, since most polynomials of a model have a single term.
pub(crate) type Terms<V> = SmallVec<[(Monomial<V>, Rational); 1]>;

/// Fewest products of terms for which packing the exponents is faster.
const PACKED: usize = 24;

/// Operations per copied term, and per factor of its monomial, for the budget.
const TERM: u64 = 16;

/// Operations for copying a list of terms whose monomials are about as long as the last one. The count also bounds the
/// memory of the copy.
fn copying<V: Ord + Clone>(terms: &[(Monomial<V>, Rational)]) -> u64 {
    let factors = terms.last().map_or(0, |term| term.0.factors().count());
    TERM * (1 + factors as u64) * terms.len() as u64
}

/// Operations for moving a term by one place, for the budget.
const MOVING: u64 = 4;

/// Number of products that are collected before they are sorted and added up.
const BATCH: usize = 1 << 16;

impl<V: Ord> Default for Polynomial<V> {
    fn default() -> Self {
        Self(SmallVec::new())
    }
}

/// Sorts terms and adds up the terms of equal monomials.
fn collected<V: Ord>(mut terms: Terms<V>) -> Terms<V> {
    if !terms.is_sorted_by(|a, b| a.0 < b.0) {
        terms.sort_unstable_by(|a, b| a.0.cmp(&b.0));
        terms.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                kept.1 += &next.1;
            }
            same
        });
    }
    terms.retain(|(_, coefficient)| !coefficient.is_zero());
    terms
}

/// The sum of two sorted lists, the second times `factor`.
fn merged<V: Ord + Clone>(left: &Terms<V>, right: &Terms<V>, factor: &Rational) -> Terms<V> {
    budget::charge(copying(left) + copying(right));
    let mut sum = Terms::with_capacity(left.len() + right.len());
    let (mut left, mut right) = (left.iter().peekable(), right.iter().peekable());
    loop {
        let order = match (left.peek(), right.peek()) {
            (Some(a), Some(b)) => a.0.cmp(&b.0),
            (Some(_), None) => Ordering::Less,
            (None, Some(_)) => Ordering::Greater,
            (None, None) => return sum,
        };
        let (a, b) = (
            (order != Ordering::Greater).then(|| left.next()).flatten(),
            (order != Ordering::Less).then(|| right.next()).flatten(),
        );
        match (a, b) {
            (Some((monomial, a)), Some((_, b))) => {
                let coefficient = a + b * factor;
                if !coefficient.is_zero() {
                    sum.push((monomial.clone(), coefficient));
                }
            }
            (Some(term), None) => sum.push(term.clone()),
            (None, Some((monomial, b))) => sum.push((monomial.clone(), b * factor)),
            (None, None) => {}
        }
    }
}

impl<V: Ord + Clone> Polynomial<V> {
    /// The polynomial 0.
    #[must_use]
    pub fn zero() -> Self {
        Self::default()
    }

    /// The polynomial 1.
    #[must_use]
    pub fn one() -> Self {
        Self::constant(Rational::one())
    }

    /// A constant.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// assert!(Polynomial::<&str>::constant(integer(0)).is_zero());
    /// ```
    #[must_use]
    pub fn constant(value: Rational) -> Self {
        Self::term(Monomial::one(), value)
    }

    /// A single variable.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// assert_eq!(Polynomial::variable("x"), Polynomial::term(Monomial::power_of("x", 1), integer(1)));
    /// ```
    #[must_use]
    pub fn variable(variable: V) -> Self {
        Self::term(Monomial::power_of(variable, 1), Rational::one())
    }

    /// `coefficient * monomial`.
    #[must_use]
    pub fn term(monomial: Monomial<V>, coefficient: Rational) -> Self {
        let mut terms = Terms::new();
        if !coefficient.is_zero() {
            terms.push((monomial, coefficient));
        }
        Self(terms)
    }

    /// The polynomial with these terms, given in any order; terms of equal monomials are added up.
    pub(crate) fn from_terms(terms: Terms<V>) -> Self {
        Self(collected(terms))
    }

    /// The terms, cloned.
    pub(crate) fn to_terms(&self) -> impl ExactSizeIterator<Item = (Monomial<V>, Rational)> + '_ {
        self.0.iter().cloned()
    }

    /// Whether this is 0.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        self.0.is_empty()
    }

    /// Number of terms.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let (x, y) = (Polynomial::variable("x"), Polynomial::variable("y"));
    /// assert_eq!(x.add(&y).pow(3).len(), 4);
    /// ```
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is no term, which only the polynomial 0 has.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The value when the polynomial is constant.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let x = Polynomial::variable("x");
    /// assert_eq!((x.as_constant(), x.sub(&x).as_constant()), (None, Some(integer(0))));
    /// ```
    #[must_use]
    pub fn as_constant(&self) -> Option<Rational> {
        match self.0.as_slice() {
            [] => Some(Rational::zero()),
            [(monomial, value)] if monomial.is_one() => Some(value.clone()),
            _ => None,
        }
    }

    /// The single term when there is exactly one.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let x = Polynomial::variable("x");
    /// assert_eq!(x.scale(&integer(3)).as_term(), Some((&Monomial::power_of("x", 1), &integer(3))));
    /// assert_eq!(x.add(&Polynomial::one()).as_term(), None);
    /// ```
    #[must_use]
    pub fn as_term(&self) -> Option<(&Monomial<V>, &Rational)> {
        match self.0.as_slice() {
            [(monomial, coefficient)] => Some((monomial, coefficient)),
            _ => None,
        }
    }

    /// Terms in increasing order of the monomials.
    pub fn terms(&self) -> impl DoubleEndedIterator<Item = (&Monomial<V>, &Rational)> + ExactSizeIterator {
        self.0.iter().map(|(monomial, coefficient)| (monomial, coefficient))
    }

    fn position(&self, monomial: &Monomial<V>) -> Result<usize, usize> {
        self.0.binary_search_by(|term| term.0.cmp(monomial))
    }

    /// The coefficient of `monomial`, zero when absent.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let square = Polynomial::variable("x").add(&Polynomial::one()).pow(2);
    /// assert_eq!(square.coefficient(&Monomial::power_of("x", 1)), integer(2));
    /// ```
    #[must_use]
    pub fn coefficient(&self, monomial: &Monomial<V>) -> Rational {
        self.position(monomial).map_or_else(|_| Rational::zero(), |at| self.0[at].1.clone())
    }

    /// Adds `coefficient * monomial` in place; many terms at once are better collected from an iterator.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let mut sum = Polynomial::variable("x");
    /// sum.add_term(Monomial::power_of("x", 1), integer(-1));
    /// assert!(sum.is_zero());
    /// ```
    pub fn add_term(&mut self, monomial: Monomial<V>, coefficient: Rational) {
        if coefficient.is_zero() {
            return;
        }
        match self.position(&monomial) {
            Err(at) => {
                budget::charge(MOVING * (self.0.len() - at) as u64);
                self.0.insert(at, (monomial, coefficient));
            }
            Ok(at) => {
                self.0[at].1 += coefficient;
                if self.0[at].1.is_zero() {
                    self.0.remove(at);
                }
            }
        }
    }

    /// The sum.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let x = Polynomial::variable("x");
    /// assert_eq!(x.add(&x), x.scale(&integer(2)));
    /// ```
    #[must_use]
    pub fn add(&self, other: &Self) -> Self {
        Self(merged(&self.0, &other.0, &Rational::one()))
    }

    /// Adds in place.
    pub fn add_assign(&mut self, other: &Self) {
        match other.0.as_slice() {
            [] => {}
            [(monomial, coefficient)] => self.add_term(monomial.clone(), coefficient.clone()),
            _ => *self = self.add(other),
        }
    }

    /// The difference.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let x = Polynomial::variable("x");
    /// assert!(x.sub(&x).is_zero());
    /// ```
    #[must_use]
    pub fn sub(&self, other: &Self) -> Self {
        Self(merged(&self.0, &other.0, &-Rational::one()))
    }

    /// Every coefficient multiplied by `factor`.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// assert_eq!(Polynomial::variable("x").scale(&ratio(1, 2)).coefficient(&Monomial::power_of("x", 1)), ratio(1, 2));
    /// ```
    #[must_use]
    pub fn scale(&self, factor: &Rational) -> Self {
        if factor.is_zero() {
            return Self::zero();
        }
        Self(self.0.iter().map(|(m, c)| (m.clone(), c * factor)).collect())
    }

    /// The product.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let (x, y) = (Polynomial::variable("x"), Polynomial::variable("y"));
    /// assert_eq!(x.add(&y).mul(&x.sub(&y)), x.pow(2).sub(&y.pow(2)));
    /// ```
    #[must_use]
    pub fn mul(&self, other: &Self) -> Self {
        match (self.as_term(), other.as_term()) {
            (_, Some((monomial, coefficient))) => return self.mul_term(monomial, coefficient),
            (Some((monomial, coefficient)), _) => return other.mul_term(monomial, coefficient),
            _ => {}
        }
        if self.len() * other.len() >= PACKED
            && let Some(product) = product::product_of_powers(&[(&self.0, 1), (&other.0, 1)])
        {
            return Self(product.into());
        }
        budget::charge(copying(&self.0).saturating_mul(other.len() as u64));
        let mut result = Self::zero();
        let mut products = Terms::with_capacity((self.len() * other.len()).min(BATCH + other.len()));
        for (left, a) in &self.0 {
            products.extend(other.0.iter().map(|(right, b)| (left.mul(right), a * b)));
            if products.len() >= BATCH {
                result = result.add(&Self(collected(std::mem::take(&mut products))));
            }
        }
        let last = Self(collected(products));
        if result.is_zero() { last } else { result.add(&last) }
    }

    /// Every monomial multiplied by `monomial`.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let inverse = Monomial::power_of("x", -1);
    /// assert_eq!(Polynomial::variable("x").mul_monomial(&inverse), Polynomial::one());
    /// ```
    #[must_use]
    pub fn mul_monomial(&self, monomial: &Monomial<V>) -> Self {
        self.mul_term(monomial, &Rational::one())
    }

    fn mul_term(&self, monomial: &Monomial<V>, coefficient: &Rational) -> Self {
        budget::charge(copying(&self.0));
        let times = |(m, c): &(Monomial<V>, Rational)| {
            (m.mul(monomial), if coefficient.is_one() { c.clone() } else { c * coefficient })
        };
        Self(collected(self.0.iter().map(times).collect()))
    }

    /// A non-negative power.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// assert_eq!(Polynomial::variable("x").pow(0), Polynomial::one());
    /// ```
    #[must_use]
    pub fn pow(&self, exponent: u32) -> Self {
        Self::product_of_powers(&[(self, exponent)])
    }

    /// A product of non-negative powers, multiplied out at once.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let (x, y) = (Polynomial::variable("x"), Polynomial::variable("y"));
    /// assert_eq!(Polynomial::product_of_powers(&[(&x, 2), (&y, 1)]), x.pow(2).mul(&y));
    /// ```
    #[must_use]
    pub fn product_of_powers(factors: &[(&Self, u32)]) -> Self {
        let mut common = (Monomial::one(), Rational::one());
        let mut sums: SmallVec<[(&Self, u32); 4]> = SmallVec::new();
        for &(factor, exponent) in factors.iter().filter(|(_, exponent)| *exponent > 0) {
            if let (Some((monomial, coefficient)), Ok(exponent)) = (factor.as_term(), i32::try_from(exponent)) {
                common = (common.0.mul(&monomial.pow(exponent)), common.1 * rational::power(coefficient, exponent));
            } else {
                sums.push((factor, exponent));
            }
        }
        let products = sums
            .iter()
            .fold(1, |count: usize, (sum, exponent)| count.saturating_mul(sum.len().saturating_pow(*exponent)));
        let common = [common];
        if products >= PACKED {
            let mut factors: SmallVec<[product::Factor<'_, V>; 4]> =
                sums.iter().map(|(sum, exponent)| (sum.0.as_slice(), *exponent)).collect();
            factors.push((&common, 1));
            if let Some(product) = product::product_of_powers(&factors) {
                return Self(product.into());
            }
        }
        let all = sums.iter().flat_map(|&(sum, exponent)| (0..exponent).map(move |_| sum));
        let [(monomial, coefficient)] = common;
        all.fold(Self::term(monomial, coefficient), |left, right| left.mul(right))
    }

    /// The partial derivative with respect to `variable`.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let x = Polynomial::variable("x");
    /// assert_eq!(x.pow(3).derivative(&"x"), x.pow(2).scale(&integer(3)));
    /// ```
    #[must_use]
    pub fn derivative(&self, variable: &V) -> Self {
        let lower = Monomial::power_of(variable.clone(), -1);
        let rate = |(monomial, coefficient): &(Monomial<V>, Rational)| {
            let exponent = monomial.exponent(variable);
            (exponent != 0).then(|| (monomial.mul(&lower), coefficient * rational::integer(i64::from(exponent))))
        };
        Self(collected(self.0.iter().filter_map(rate).collect()))
    }

    /// Replaces every variable by a polynomial; `None` when a negative power of a replacement of more than one term
    /// would be needed.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let (x, y) = (Polynomial::variable("x"), Polynomial::variable("y"));
    /// assert_eq!(x.pow(2).substitute(|_| y.add(&y)), Some(y.pow(2).scale(&integer(4))));
    /// ```
    #[must_use]
    pub fn substitute<W: Ord + Clone>(
        &self,
        mut replacement: impl FnMut(&V) -> Polynomial<W>,
    ) -> Option<Polynomial<W>> {
        let mut result = Polynomial::zero();
        for (monomial, coefficient) in &self.0 {
            let mut product = Polynomial::constant(coefficient.clone());
            for (variable, exponent) in monomial.factors() {
                let base = replacement(variable);
                product = if exponent >= 0 {
                    product.mul(&base.pow(exponent.unsigned_abs()))
                } else {
                    let (m, c) = base.as_term()?;
                    product.mul(&Polynomial::term(m.pow(exponent), rational::power(c, exponent)))
                };
            }
            result.add_assign(&product);
        }
        Some(result)
    }

    /// The exact value; `None` when a variable with a negative exponent is zero.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::polynomial::{Monomial, Polynomial}, number::rational::{integer, ratio}};
    /// let inverse = Polynomial::term(Monomial::power_of("x", -1), integer(3));
    /// assert_eq!(inverse.evaluate(|_| integer(2)), Some(ratio(3, 2)));
    /// assert_eq!(inverse.evaluate(|_| integer(0)), None);
    /// ```
    #[must_use]
    pub fn evaluate(&self, mut value: impl FnMut(&V) -> Rational) -> Option<Rational> {
        let mut sum = Rational::zero();
        for (monomial, coefficient) in &self.0 {
            let mut product = coefficient.clone();
            for (variable, exponent) in monomial.factors() {
                let base = value(variable);
                if base.is_zero() && exponent < 0 {
                    return None;
                }
                product *= rational::power(&base, exponent);
            }
            sum += product;
        }
        Some(sum)
    }
}

impl<V: Ord + Clone> FromIterator<(Monomial<V>, Rational)> for Polynomial<V> {
    fn from_iter<I: IntoIterator<Item = (Monomial<V>, Rational)>>(terms: I) -> Self {
        Self(collected(terms.into_iter().collect()))
    }
}

impl<V: Ord + Clone + Serialize> Serialize for Polynomial<V> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter())
    }
}

impl<'de, V: Ord + Clone + Deserialize<'de>> Deserialize<'de> for Polynomial<V> {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Ok(Vec::<(Monomial<V>, Rational)>::deserialize(deserializer)?.into_iter().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::{Monomial, Polynomial};
    use crate::number::rational::{integer, ratio};
    use proptest::prelude::{Strategy, prop, prop_assert, prop_assert_eq, proptest};

    type P = Polynomial<u8>;

    fn polynomial() -> impl Strategy<Value = P> {
        prop::collection::vec((prop::collection::vec((0u8..4, 0i32..4), 0..3), -9i64..10, 1i64..6), 0..5).prop_map(
            |terms| {
                terms
                    .into_iter()
                    .map(|(factors, n, d)| (factors.into_iter().collect::<Monomial<u8>>(), ratio(n, d)))
                    .collect()
            },
        )
    }

    /// Polynomials with negative exponents and with enough terms for packing.
    fn laurent() -> impl Strategy<Value = P> {
        prop::collection::vec((prop::collection::vec((0u8..6, -40i32..40), 0..5), -9i64..10, 1i64..6), 0..20).prop_map(
            |terms| {
                terms
                    .into_iter()
                    .map(|(factors, n, d)| (factors.into_iter().collect::<Monomial<u8>>(), ratio(n, d)))
                    .collect()
            },
        )
    }

    #[test]
    fn exponents_that_no_word_holds_are_multiplied_all_the_same() {
        let wide: P = (0..40).map(|v| (Monomial::power_of(v, 1_000_000), integer(1))).collect();
        assert_eq!(crate::algebra::product::product_of_powers(&[(&wide.0, 1), (&wide.0, 1)]), None);
        let square = wide.mul(&wide);
        assert_eq!(square.len(), 40 * 41 / 2);
        assert_eq!(square.evaluate(|_| integer(1)), Some(integer(1600)));
    }

    proptest! {
        #[test]
        fn ring_axioms(a in polynomial(), b in polynomial(), c in polynomial()) {
            prop_assert_eq!(a.add(&b), b.add(&a));
            prop_assert_eq!(a.mul(&b), b.mul(&a));
            prop_assert_eq!(a.mul(&b).mul(&c), a.mul(&b.mul(&c)));
            prop_assert_eq!(a.mul(&b.add(&c)), a.mul(&b).add(&a.mul(&c)));
            prop_assert_eq!(a.mul(&P::one()), a.clone());
            prop_assert!(a.sub(&a).is_zero());
        }

        #[test]
        fn packed_products_are_products(a in laurent(), b in laurent()) {
            let plain: P = a
                .terms()
                .flat_map(|(m, x)| b.terms().map(move |(n, y)| (m.mul(n), x * y)))
                .collect();
            let packed = crate::algebra::product::product_of_powers(&[(&a.0, 1), (&b.0, 1)]);
            prop_assert_eq!(packed.map(|terms| Polynomial(terms.into())), Some(plain.clone()));
            prop_assert_eq!(a.mul(&b), plain);
        }

        #[test]
        fn powers_are_repeated_products(a in laurent(), b in polynomial(), c in polynomial(), n in 0u32..5, m in 0u32..4) {
            let repeated = |p: &P, n: u32| (0..n).fold(P::one(), |power, _| power.mul(p));
            let expected = repeated(&a, n).mul(&repeated(&b, m)).mul(&c);
            prop_assert_eq!(P::product_of_powers(&[(&a, n), (&b, m), (&c, 1)]), expected);
            prop_assert_eq!(a.pow(n), repeated(&a, n));
        }

        #[test]
        fn product_rule(a in polynomial(), b in polynomial()) {
            let left = a.mul(&b).derivative(&1);
            let right = a.derivative(&1).mul(&b).add(&a.mul(&b.derivative(&1)));
            prop_assert_eq!(left, right);
        }

        #[test]
        fn evaluation_is_a_homomorphism(a in polynomial(), b in polynomial(), x in -5i64..6, y in -5i64..6) {
            let at = |p: &P| p.evaluate(|v| if *v == 0 { integer(x) } else { ratio(y, 3) }).expect("no negative powers");
            prop_assert_eq!(at(&a.mul(&b)), at(&a) * at(&b));
            prop_assert_eq!(at(&a.add(&b)), at(&a) + at(&b));
        }
    }

    #[test]
    fn laurent_monomials_cancel() {
        let k3 = P::term(Monomial::power_of(3, -1), integer(1));
        assert_eq!(k3.mul(&P::variable(3)), P::one());
    }
}
