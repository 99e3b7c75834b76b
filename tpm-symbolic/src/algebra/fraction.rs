//! Rational functions with an explicit, factored denominator: exact fractions without polynomial gcds.
//!
//! Invariants of [`Fraction`]: the numerator is a Laurent polynomial; every factor of the denominator has at least two
//! terms, no monomial content and leading coefficient 1, and does not divide the numerator; zero has no denominator.
//! A fraction is zero exactly when its numerator is, so equality is decided exactly although factors need not be
//! irreducible: single monomials, the common case of chains, never enter the denominator at all.

use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::number::rational::{self, Rational};
use num_traits::{One, Signed, Zero};
use std::cmp::Ordering;
use std::collections::BTreeMap;

/// `numerator / prod factor^exponent`.
#[derive(Clone, Debug)]
pub struct Fraction<V: Ord> {
    numerator: Polynomial<V>,
    denominator: BTreeMap<Polynomial<V>, u32>,
}

/// Equal as functions: factors need not be irreducible, so that equal fractions may differ as data.
impl<V: Ord + Clone> PartialEq for Fraction<V> {
    fn eq(&self, other: &Self) -> bool {
        self.sub(other).is_zero()
    }
}

impl<V: Ord + Clone> Eq for Fraction<V> {}

impl<V: Ord + Clone> Fraction<V> {
    /// The fraction 0.
    #[must_use]
    pub fn zero() -> Self {
        Self::polynomial(Polynomial::zero())
    }

    /// The fraction 1.
    #[must_use]
    pub fn one() -> Self {
        Self::polynomial(Polynomial::one())
    }

    /// A Laurent polynomial as a fraction.
    #[must_use]
    pub fn polynomial(numerator: Polynomial<V>) -> Self {
        Self { numerator, denominator: BTreeMap::new() }
    }

    /// A constant.
    #[must_use]
    pub fn constant(value: Rational) -> Self {
        Self::polynomial(Polynomial::constant(value))
    }

    /// A single variable.
    #[must_use]
    pub fn variable(variable: V) -> Self {
        Self::polynomial(Polynomial::variable(variable))
    }

    /// Whether this is 0; exact.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// let x = Fraction::variable("x");
    /// assert!(x.sub(&x).is_zero());
    /// ```
    #[must_use]
    pub fn is_zero(&self) -> bool {
        self.numerator.is_zero()
    }

    /// The numerator, a Laurent polynomial.
    #[must_use]
    pub fn numerator(&self) -> &Polynomial<V> {
        &self.numerator
    }

    /// The factors of the denominator with their exponents.
    pub fn denominator(&self) -> impl ExactSizeIterator<Item = (&Polynomial<V>, u32)> {
        self.denominator.iter().map(|(factor, exponent)| (factor, *exponent))
    }

    /// The fraction as a Laurent polynomial, when it is one.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// let x = Fraction::variable("x");
    /// assert!(x.inverse().is_some_and(|inverse| inverse.as_polynomial().is_some()));
    /// assert!(x.add(&Fraction::one()).inverse().is_some_and(|inverse| inverse.as_polynomial().is_none()));
    /// ```
    #[must_use]
    pub fn as_polynomial(&self) -> Option<&Polynomial<V>> {
        self.denominator.is_empty().then_some(&self.numerator)
    }

    /// The sum.
    #[must_use]
    pub fn add(&self, other: &Self) -> Self {
        if self.denominator == other.denominator {
            return Self { numerator: self.numerator.add(&other.numerator), denominator: self.denominator.clone() }
                .cancelled();
        }
        let mut common = self.denominator.clone();
        for (factor, exponent) in &other.denominator {
            let present = common.entry(factor.clone()).or_insert(0);
            *present = (*present).max(*exponent);
        }
        let numerator = self.over(&common).add(&other.over(&common));
        Self { numerator, denominator: common }.cancelled()
    }

    /// The numerator of this fraction over `common`, which is a multiple of its denominator.
    fn over(&self, common: &BTreeMap<Polynomial<V>, u32>) -> Polynomial<V> {
        let mut numerator = self.numerator.clone();
        for (factor, exponent) in common {
            let missing = exponent - self.denominator.get(factor).copied().unwrap_or(0);
            if missing > 0 {
                numerator = numerator.mul(&factor.pow(missing));
            }
        }
        numerator
    }

    /// The difference.
    #[must_use]
    pub fn sub(&self, other: &Self) -> Self {
        self.add(&other.scale(&-Rational::one()))
    }

    /// A rational multiple.
    #[must_use]
    pub fn scale(&self, factor: &Rational) -> Self {
        if factor.is_zero() {
            return Self::zero();
        }
        Self { numerator: self.numerator.scale(factor), denominator: self.denominator.clone() }
    }

    /// The product.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// let sum = Fraction::variable("x").add(&Fraction::one());
    /// assert_eq!(sum.inverse().map(|inverse| inverse.mul(&sum)), Some(Fraction::one()));
    /// ```
    #[must_use]
    pub fn mul(&self, other: &Self) -> Self {
        Self::product_of_powers(&[(self, 1), (other, 1)])
    }

    /// A product of non-negative powers, multiplied out at once.
    #[must_use]
    pub fn product_of_powers(factors: &[(&Self, u32)]) -> Self {
        let numerators: Vec<(&Polynomial<V>, u32)> = factors.iter().map(|(value, e)| (&value.numerator, *e)).collect();
        let numerator = Polynomial::product_of_powers(&numerators);
        let mut denominator = BTreeMap::new();
        for (value, power) in factors {
            for (factor, exponent) in &value.denominator {
                *denominator.entry(factor.clone()).or_insert(0) += exponent * power;
            }
        }
        denominator.retain(|_, exponent| *exponent > 0);
        if denominator.is_empty() { Self::polynomial(numerator) } else { Self { numerator, denominator }.cancelled() }
    }

    /// The reciprocal; `None` for 0.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// assert_eq!(Fraction::<&str>::zero().inverse(), None);
    /// ```
    #[must_use]
    pub fn inverse(&self) -> Option<Self> {
        let (content, coefficient, primitive) = primitive_part(&self.numerator)?;
        let numerator = self
            .denominator
            .iter()
            .fold(Polynomial::term(content.pow(-1), coefficient.recip()), |product, (factor, exponent)| {
                product.mul(&factor.pow(*exponent))
            });
        let denominator = if primitive.len() > 1 { std::iter::once((primitive, 1)).collect() } else { BTreeMap::new() };
        Some(Self { numerator, denominator }.cancelled())
    }

    /// The quotient; `None` for a division by 0.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// let x = Fraction::variable("x");
    /// assert_eq!(x.mul(&x).div(&x), Some(x));
    /// ```
    #[must_use]
    pub fn div(&self, other: &Self) -> Option<Self> {
        Some(self.mul(&other.inverse()?))
    }

    /// An integer power; `None` for a negative power of 0.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// assert_eq!(Fraction::<&str>::constant(integer(2)).pow(-2), Some(Fraction::constant(ratio(1, 4))));
    /// ```
    #[must_use]
    pub fn pow(&self, exponent: i32) -> Option<Self> {
        let base = if exponent < 0 { self.inverse()? } else { self.clone() };
        let exponent = exponent.unsigned_abs();
        let denominator = base.denominator.iter().map(|(factor, e)| (factor.clone(), e * exponent)).collect();
        Some(if exponent == 0 { Self::one() } else { Self { numerator: base.numerator.pow(exponent), denominator } })
    }

    /// The fraction with a different numerator over the same denominator.
    #[must_use]
    pub fn with_numerator(&self, numerator: Polynomial<V>) -> Self {
        Self { numerator, denominator: self.denominator.clone() }.cancelled()
    }

    /// Replaces every variable by a fraction; `None` when a denominator becomes 0.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// let x = Fraction::variable("x");
    /// assert_eq!(x.inverse().and_then(|inverse| inverse.substitute(|_| Fraction::<&str>::zero())), None);
    /// ```
    #[must_use]
    pub fn substitute<W: Ord + Clone>(&self, mut replacement: impl FnMut(&V) -> Fraction<W>) -> Option<Fraction<W>> {
        let mut result = substitute_polynomial(&self.numerator, &mut replacement)?;
        for (factor, exponent) in &self.denominator {
            let exponent = i32::try_from(*exponent).ok()?;
            result = result.mul(&substitute_polynomial(factor, &mut replacement)?.pow(-exponent)?);
        }
        Some(result)
    }

    /// The exact value; `None` when a denominator is 0.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// let sum = Fraction::variable("x").add(&Fraction::one());
    /// assert_eq!(sum.inverse().and_then(|inverse| inverse.evaluate(|_| integer(2))), Some(ratio(1, 3)));
    /// ```
    #[must_use]
    pub fn evaluate(&self, mut value: impl FnMut(&V) -> Rational) -> Option<Rational> {
        let mut result = self.numerator.evaluate(&mut value)?;
        for (factor, exponent) in &self.denominator {
            let divisor = factor.evaluate(&mut value)?;
            if divisor.is_zero() {
                return None;
            }
            result /= num_traits::pow::Pow::pow(&divisor, *exponent);
        }
        Some(result)
    }

    /// The value in double precision, each coefficient rounded once.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// assert_eq!(Fraction::variable("x").evaluate_f64(|_| 0.5), 0.5);
    /// ```
    #[must_use]
    pub fn evaluate_f64(&self, mut value: impl FnMut(&V) -> f64) -> f64 {
        let mut sum = |polynomial: &Polynomial<V>| -> f64 {
            let term = |(monomial, coefficient): (&Monomial<V>, &Rational)| {
                monomial.factors().fold(rational::to_f64(coefficient), |product, (v, e)| product * value(v).powi(e))
            };
            polynomial.terms().map(term).sum()
        };
        let numerator = sum(&self.numerator);
        self.denominator.iter().fold(numerator, |quotient, (factor, exponent)| {
            (0..*exponent).fold(quotient, |quotient, _| quotient / sum(factor))
        })
    }

    /// The partial derivative.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// let x = Fraction::variable("x");
    /// assert_eq!(x.mul(&x).derivative(&"x"), x.scale(&integer(2)));
    /// ```
    #[must_use]
    pub fn derivative(&self, variable: &V) -> Self {
        let mut result = self.with_numerator(self.numerator.derivative(variable));
        for (factor, exponent) in &self.denominator {
            let rate = factor.derivative(variable).scale(&-rational::integer(i64::from(*exponent)));
            if !rate.is_zero() {
                let mut denominator = self.denominator.clone();
                *denominator.entry(factor.clone()).or_insert(0) += 1;
                let change = Self { numerator: self.numerator.mul(&rate), denominator };
                result = result.add(&change.cancelled());
            }
        }
        result
    }

    /// The fraction in the usual notation: the numerator without negative exponents, and the monomial that stands in
    /// the denominator in addition to the factors of [`Self::denominator`].
    #[must_use]
    pub fn cleared(&self) -> (Polynomial<V>, Monomial<V>) {
        let content = least_exponents(&self.numerator);
        let below: Monomial<V> = content.factors().filter(|(_, e)| *e < 0).map(|(v, e)| (v.clone(), -e)).collect();
        (self.numerator.mul_monomial(&below), below)
    }

    /// The fraction in the model language, given the names of the variables.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
    /// let sum = Fraction::variable("x").add(&Fraction::one());
    /// assert_eq!(sum.inverse().map(|inverse| inverse.display(|name| name.to_string())), Some("1/(1 + x)".to_owned()));
    /// ```
    #[must_use]
    pub fn display(&self, mut name: impl FnMut(&V) -> String) -> String {
        let powers = |factors: Vec<(String, u32)>| -> Vec<String> {
            let text =
                |(base, exponent): (String, u32)| if exponent == 1 { base } else { format!("{base}^{exponent}") };
            factors.into_iter().map(text).collect()
        };
        let (numerator, below) = self.cleared();
        let mut divisors = powers(below.factors().map(|(v, e)| (name(v), e.unsigned_abs())).collect());
        let factors: Vec<(String, u32)> = self
            .denominator
            .iter()
            .map(|(factor, exponent)| (format!("({})", display_polynomial(factor, &mut name)), *exponent))
            .collect();
        divisors.extend(powers(factors));
        let mut text = display_polynomial(&numerator, &mut name);
        if divisors.is_empty() {
            return text;
        }
        if numerator.len() > 1 {
            text = format!("({text})");
        }
        format!("{text}/{}", divisors.join("/"))
    }

    fn cancelled(mut self) -> Self {
        if self.numerator.is_zero() {
            self.denominator.clear();
            return self;
        }
        let factors: Vec<Polynomial<V>> = self.denominator.keys().cloned().collect();
        for factor in factors {
            let Some(mut exponent) = self.denominator.remove(&factor) else { continue };
            while exponent > 0 {
                let Some(quotient) = exact_quotient(&self.numerator, &factor) else { break };
                self.numerator = quotient;
                exponent -= 1;
            }
            if exponent > 0 {
                self.denominator.insert(factor, exponent);
            }
        }
        self
    }
}

/// A Laurent polynomial in the model language.
///
/// ```
/// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
/// let x = Polynomial::variable("x");
/// assert_eq!(display_polynomial(&x.pow(2).scale(&ratio(-1, 2)), |name| name.to_string()), "-x^2/2");
/// ```
#[must_use]
pub fn display_polynomial<V: Ord + Clone>(polynomial: &Polynomial<V>, mut name: impl FnMut(&V) -> String) -> String {
    if polynomial.is_zero() {
        return "0".to_owned();
    }
    let mut text = String::new();
    for (i, (monomial, coefficient)) in polynomial.terms().enumerate() {
        text.push_str(match (i, coefficient.is_negative()) {
            (0, false) => "",
            (0, true) => "-",
            (_, false) => " + ",
            (_, true) => " - ",
        });
        let magnitude = rational::abs(coefficient);
        let (mut above, mut below) = (Vec::new(), Vec::new());
        if !magnitude.numer().is_one() {
            above.push(magnitude.numer().to_string());
        }
        if !magnitude.denom().is_one() {
            below.push(magnitude.denom().to_string());
        }
        for (variable, exponent) in monomial.factors() {
            let base = name(variable);
            let size = exponent.unsigned_abs();
            let power = if size == 1 { base } else { format!("{base}^{size}") };
            if exponent > 0 { above.push(power) } else { below.push(power) }
        }
        text.push_str(&if above.is_empty() { "1".to_owned() } else { above.join("*") });
        for factor in below {
            text.push('/');
            text.push_str(&factor);
        }
    }
    text
}

/// Replaces every variable of a Laurent polynomial by a fraction; `None` when a negative power of 0 would be needed.
fn substitute_polynomial<V: Ord + Clone, W: Ord + Clone>(
    polynomial: &Polynomial<V>,
    replacement: &mut impl FnMut(&V) -> Fraction<W>,
) -> Option<Fraction<W>> {
    let mut sum = Fraction::zero();
    for (monomial, coefficient) in polynomial.terms() {
        let mut product = Fraction::constant(coefficient.clone());
        for (variable, exponent) in monomial.factors() {
            product = product.mul(&replacement(variable).pow(exponent)?);
        }
        sum = sum.add(&product);
    }
    Some(sum)
}

/// The monomial, the coefficient and the rest whose product is a non-zero Laurent polynomial: the rest has no monomial
/// content, no negative exponents and coefficient 1 on its first term.
#[must_use]
pub fn primitive_part<V: Ord + Clone>(polynomial: &Polynomial<V>) -> Option<(Monomial<V>, Rational, Polynomial<V>)> {
    let (_, lead) = polynomial.terms().next()?;
    let lead = lead.clone();
    let content = least_exponents(polynomial);
    let rest = polynomial.mul_monomial(&content.pow(-1)).scale(&lead.recip());
    // Multiplication by a monomial may change which term comes first.
    let first = rest.terms().next().map_or_else(Rational::one, |(_, c)| c.clone());
    if first.is_one() {
        Some((content, lead, rest))
    } else {
        Some((content, lead * &first, rest.scale(&first.recip())))
    }
}

/// The monomial with the least exponent of every variable over all terms.
fn least_exponents<V: Ord + Clone>(polynomial: &Polynomial<V>) -> Monomial<V> {
    let mut least: BTreeMap<&V, (i32, usize)> = BTreeMap::new();
    for (monomial, _) in polynomial.terms() {
        for (variable, exponent) in monomial.factors() {
            let slot = least.entry(variable).or_insert((exponent, 0));
            *slot = (slot.0.min(exponent), slot.1 + 1);
        }
    }
    // A variable that some term lacks has exponent 0 there.
    let count = polynomial.len();
    least.into_iter().map(|(v, (e, seen))| (v.clone(), if seen == count { e } else { e.min(0) })).collect()
}

/// A monomial in lexicographic order (a true monomial order, unlike the order of the data).
struct Lexicographic<V>(Monomial<V>);

impl<V: Ord + Clone> Ord for Lexicographic<V> {
    fn cmp(&self, other: &Self) -> Ordering {
        let (mut left, mut right) = (self.0.factors().peekable(), other.0.factors().peekable());
        loop {
            match (left.peek(), right.peek()) {
                (None, None) => return Ordering::Equal,
                (Some((_, a)), None) => return a.cmp(&0),
                (None, Some((_, b))) => return 0.cmp(b),
                (Some((v, a)), Some((w, b))) => match v.cmp(w) {
                    Ordering::Less => return a.cmp(&0),
                    Ordering::Greater => return 0.cmp(b),
                    Ordering::Equal if a != b => return a.cmp(b),
                    Ordering::Equal => {
                        left.next();
                        right.next();
                    }
                },
            }
        }
    }
}

impl<V: Ord + Clone> PartialOrd for Lexicographic<V> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<V: Ord + Clone> PartialEq for Lexicographic<V> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<V: Ord + Clone> Eq for Lexicographic<V> {}

/// The quotient of two Laurent polynomials when the division leaves no remainder; `None` otherwise, and for a zero
/// divisor.
///
/// ```
/// # use tpm_symbolic::{algebra::{fraction::*, polynomial::{Monomial, Polynomial}}, number::rational::{integer, ratio}};
/// let (x, one) = (Polynomial::variable("x"), Polynomial::one());
/// assert_eq!(exact_quotient(&x.pow(2).sub(&one), &x.add(&one)), Some(x.sub(&one)));
/// assert_eq!(exact_quotient(&x, &x.add(&one)), None);
/// ```
#[must_use]
pub fn exact_quotient<V: Ord + Clone>(dividend: &Polynomial<V>, divisor: &Polynomial<V>) -> Option<Polynomial<V>> {
    if dividend.is_zero() {
        return (!divisor.is_zero()).then(Polynomial::zero);
    }
    // Monomials are units: divide the polynomials without monomial content.
    let (shift_up, shift_down) = (least_exponents(dividend), least_exponents(divisor));
    let back = shift_up.mul(&shift_down.pow(-1));
    let plain = |polynomial: &Polynomial<V>, content: &Monomial<V>| -> BTreeMap<Lexicographic<V>, Rational> {
        let inverse = content.pow(-1);
        polynomial.terms().map(|(m, c)| (Lexicographic(m.mul(&inverse)), c.clone())).collect()
    };
    let mut rest = plain(dividend, &shift_up);
    let divisor = plain(divisor, &shift_down);
    let (lead, lead_coefficient) = divisor.last_key_value()?;
    let (lead_inverse, lead_reciprocal) = (lead.0.pow(-1), lead_coefficient.recip());
    let mut quotient = Vec::new();
    while let Some((Lexicographic(monomial), coefficient)) = rest.pop_last() {
        let factor = monomial.mul(&lead_inverse);
        if factor.factors().any(|(_, exponent)| exponent < 0) {
            return None;
        }
        let scale = coefficient * &lead_reciprocal;
        for (Lexicographic(other), value) in divisor.iter().rev().skip(1) {
            let key = Lexicographic(other.mul(&factor));
            let sum = rest.remove(&key).unwrap_or_else(Rational::zero) - value * &scale;
            if !sum.is_zero() {
                rest.insert(key, sum);
            }
        }
        quotient.push((factor.mul(&back), scale));
    }
    Some(quotient.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use super::{Fraction, exact_quotient};
    use crate::algebra::polynomial::{Monomial, Polynomial};
    use crate::number::rational::{Rational, integer, ratio};
    use proptest::prelude::{Strategy, prop, prop_assert, prop_assert_eq, prop_assume, proptest};

    type P = Polynomial<u8>;

    fn polynomial() -> impl Strategy<Value = P> {
        prop::collection::vec((prop::collection::vec((0u8..3, -2i32..3), 0..3), -5i64..6), 0..4).prop_map(|terms| {
            terms.into_iter().map(|(factors, n)| (factors.into_iter().collect::<Monomial<u8>>(), integer(n))).collect()
        })
    }

    fn fraction() -> impl Strategy<Value = Fraction<u8>> {
        (polynomial(), polynomial()).prop_map(|(n, d)| {
            Fraction::polynomial(n.clone()).div(&Fraction::polynomial(d)).unwrap_or_else(|| Fraction::polynomial(n))
        })
    }

    fn at(v: &u8) -> Rational {
        [ratio(3, 7), ratio(-11, 5), ratio(13, 2)][usize::from(*v)].clone()
    }

    proptest! {
        #[test]
        fn exact_division_undoes_multiplication(a in polynomial(), b in polynomial()) {
            prop_assume!(!b.is_zero());
            prop_assert_eq!(exact_quotient(&a.mul(&b), &b), Some(a));
        }

        #[test]
        fn a_remainder_is_refused(a in polynomial(), b in polynomial()) {
            prop_assume!(b.len() > 1);
            // a b + 1 is divisible by b only when b divides 1, which a polynomial of two terms does not.
            prop_assert_eq!(exact_quotient(&a.mul(&b).add(&P::one()), &b), None);
        }

        #[test]
        fn field_axioms(a in fraction(), b in fraction(), c in fraction()) {
            prop_assert!(a.mul(&b.add(&c)).sub(&a.mul(&b).add(&a.mul(&c))).is_zero());
            prop_assert!(a.add(&b).sub(&b.add(&a)).is_zero());
            prop_assert!(a.sub(&a).is_zero());
            if let Some(inverse) = a.inverse() {
                prop_assert!(a.mul(&inverse).sub(&Fraction::one()).is_zero());
            }
        }

        #[test]
        fn evaluation_is_a_homomorphism(a in fraction(), b in fraction()) {
            if let (Some(x), Some(y)) = (a.evaluate(at), b.evaluate(at)) {
                prop_assert_eq!(a.mul(&b).evaluate(at), Some(&x * &y));
                prop_assert_eq!(a.add(&b).evaluate(at), Some(x + y));
            }
        }
    }

    #[test]
    fn derivatives_obey_the_quotient_rule_and_print() {
        let [x, y] = [0u8, 1].map(P::variable);
        let quotient = Fraction::polynomial(x.clone()).div(&Fraction::polynomial(x.add(&y))).expect("not zero");
        let square = x.add(&y).pow(2);
        let expected = Fraction::polynomial(y).div(&Fraction::polynomial(square)).expect("not zero");
        assert_eq!(quotient.derivative(&0), expected);
        let name = |v: &u8| ["x", "y"][usize::from(*v)].to_owned();
        assert_eq!(quotient.derivative(&0).display(name), "y/(x + y)^2");
        assert_eq!(expected.inverse().expect("not zero").display(name), "(2*x*y + x^2 + y^2)/y");
        assert_eq!(expected.evaluate_f64(|v| [1.0, 3.0][usize::from(*v)]), 3.0 / 16.0);
    }

    #[test]
    fn common_factors_cancel_and_monomials_are_no_denominators() {
        let [x, y] = [0u8, 1].map(P::variable);
        let sum = Fraction::polynomial(x.add(&y));
        let square = Fraction::polynomial(x.mul(&x).sub(&y.mul(&y)));
        assert_eq!(square.div(&sum), Some(Fraction::polynomial(x.sub(&y))));
        let monomial = Fraction::polynomial(x.mul(&y).scale(&integer(3)));
        assert!(sum.div(&monomial).expect("not zero").as_polynomial().is_some());
        assert_eq!(sum.div(&Fraction::zero()), None);
    }
}
