//! Products and powers of polynomials of many terms.
//!
//! Invariants: exponents are packed into one word, wide enough for every product on the way, so that multiplying monomials
//! is one addition; coefficients are whole numbers over one denominator while a bound on all sums, from the sums of their
//! magnitudes, fits into 128 bits, and rationals beyond. Terms are sorted once, at the end, as the words that compare like
//! their monomials.

use crate::packed::{Key, Layout, ShortKey};
use crate::polynomial::{Factorisation, Monomial};
use crate::rational::Rational;
use num_integer::Integer;
use num_traits::Zero;
use rustc_hash::FxHashMap;
use std::ops::{AddAssign, Mul};

/// A term of a polynomial.
type Term<V> = (Monomial<V>, Rational);

/// The terms of left * right, in the order of the monomials; `None` when no word holds their exponents.
pub(crate) fn product<V: Ord + Clone>(left: &[Term<V>], right: &[Term<V>]) -> Option<Vec<Term<V>>> {
    Packing::new(&[left, right], 2).multiplied(left, right, 1)
}

/// The terms of base^exponent, in the order of the monomials; `None` when no word holds their exponents, and for the exponent 0.
pub(crate) fn power<V: Ord + Clone>(base: &[Term<V>], exponent: u32) -> Option<Vec<Term<V>>> {
    Packing::new(&[base], exponent.into()).multiplied(base, base, exponent.checked_sub(1)?)
}

/// Variables and the width of their exponents.
struct Packing<'v, V> {
    variables: Vec<&'v V>,
    layout: Layout,
}

impl<'v, V: Ord + Clone> Packing<'v, V> {
    /// For products of at most `degree` of the polynomials.
    fn new(polynomials: &[&'v [Term<V>]], degree: u64) -> Self {
        let (mut variables, mut largest): (Vec<&V>, u32) = (Vec::new(), 0);
        for (variable, exponent) in polynomials.iter().copied().flatten().flat_map(|term| term.0.factors()) {
            largest = largest.max(exponent.unsigned_abs());
            if let Err(at) = variables.binary_search(&variable) {
                variables.insert(at, variable);
            }
        }
        let layout = Layout::new(variables.len(), degree.saturating_mul(largest.into()));
        Self { variables, layout }
    }

    /// The terms of first * base^times.
    fn multiplied(&self, first: &[Term<V>], base: &[Term<V>], times: u32) -> Option<Vec<Term<V>>> {
        match self.layout.key_bits() {
            0..=64 => Some(self.over_integers::<u64>(first, base, times)),
            65..=128 => Some(self.over_integers::<u128>(first, base, times)),
            _ => None,
        }
    }

    fn over_integers<K: ShortKey>(&self, first: &[Term<V>], base: &[Term<V>], times: u32) -> Vec<Term<V>> {
        match numerators(first, base, times) {
            Some((a, b, denominator)) => {
                let product = chain(self.keyed::<K, _>(first, a), &self.keyed(base, b), times);
                self.terms(product, |numerator| Rational::from_wide(numerator, denominator))
            }
            None => {
                let own = |terms: &[Term<V>]| terms.iter().map(|term| term.1.clone()).collect();
                let product = chain(self.keyed::<K, _>(first, own(first)), &self.keyed(base, own(base)), times);
                self.terms(product, |coefficient| coefficient)
            }
        }
    }

    /// Packed monomials with these coefficients.
    fn keyed<K: Key, C>(&self, terms: &[Term<V>], coefficients: Vec<C>) -> Vec<(K, C)> {
        let key = |(monomial, _): &Term<V>| {
            let mut key = K::one(self.layout);
            for (variable, exponent) in monomial.factors() {
                let at = self.variables.binary_search(&variable).expect("invariant: every variable was collected");
                key.add(&K::variable(self.layout, at), exponent.into());
            }
            key
        };
        terms.iter().map(key).zip(coefficients).collect()
    }

    fn terms<K: ShortKey, C>(&self, mut sums: Vec<(K, C)>, value: impl Fn(C) -> Rational) -> Vec<Term<V>> {
        sums.sort_by_cached_key(|(key, _)| key.listed(self.layout));
        let term = |(key, sum): (K, C)| {
            let mut count = 0;
            key.exponents(self.layout, |_, exponent| count += usize::from(exponent != 0));
            let mut factors = Factorisation::with_capacity(count);
            key.exponents(self.layout, |at, exponent| {
                if exponent != 0 {
                    let exponent = i32::try_from(exponent).expect("invariant: exponents of products are small");
                    factors.push((self.variables[at].clone(), exponent));
                }
            });
            (Monomial::from_sorted(factors), value(sum))
        };
        sums.into_iter().map(term).collect()
    }
}

/// The coefficients of both as whole numbers, and the denominator of first * base^times; `None` when a sum of products might not
/// fit.
fn numerators<V>(first: &[Term<V>], base: &[Term<V>], times: u32) -> Option<(Vec<i128>, Vec<i128>, i128)> {
    let ((a, a_sum, a_below), (b, b_sum, b_below)) = (over_one_denominator(first)?, over_one_denominator(base)?);
    a_sum.checked_mul(b_sum.checked_pow(times)?)?;
    Some((a, b, a_below.checked_mul(b_below.checked_pow(times)?)?))
}

/// The numerators, the sum of their magnitudes, and the denominator.
fn over_one_denominator<V>(terms: &[Term<V>]) -> Option<(Vec<i128>, i128, i128)> {
    let mut common = 1i64;
    for (_, coefficient) in terms {
        let own = coefficient.as_words()?.1;
        common = (common / common.gcd(&own)).checked_mul(own)?;
    }
    let over = |(_, coefficient): &Term<V>| {
        coefficient.as_words().map(|(numerator, own)| i128::from(numerator) * i128::from(common / own))
    };
    let numerators: Vec<i128> = terms.iter().map(over).collect::<Option<_>>()?;
    let sum = numerators.iter().try_fold(0i128, |sum, numerator| sum.checked_add(numerator.abs()))?;
    Some((numerators, sum, common.into()))
}

/// The terms of product * base^times, in no order.
fn chain<K, C>(mut product: Vec<(K, C)>, base: &[(K, C)], times: u32) -> Vec<(K, C)>
where
    K: ShortKey,
    C: Zero + AddAssign,
    for<'c> &'c C: Mul<&'c C, Output = C>,
{
    for _ in 0..times {
        let mut sums = FxHashMap::default();
        sums.reserve(product.len() + base.len());
        for (left, a) in &product {
            for (right, b) in base {
                let mut key = *left;
                key.add(right, 1);
                *sums.entry(key).or_insert_with(C::zero) += a * b;
            }
        }
        product = sums.into_iter().filter(|(_, sum)| !sum.is_zero()).collect();
    }
    product
}
