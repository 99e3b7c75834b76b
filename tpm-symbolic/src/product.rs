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
use std::hash::Hash;
use std::ops::{AddAssign, Mul};

/// A term of a polynomial.
type Term<V> = (Monomial<V>, Rational);

/// The terms of left * right, in the order of the monomials; `None` when no word holds their exponents.
pub(crate) fn product<V: Ord + Clone>(left: &[Term<V>], right: &[Term<V>]) -> Option<Vec<Term<V>>> {
    Packing::new(&[left, right], 2).multiplied(&[left, right])
}

/// The terms of base^exponent, in the order of the monomials; `None` when no word holds their exponents.
pub(crate) fn power<V: Ord + Clone>(base: &[Term<V>], exponent: u32) -> Option<Vec<Term<V>>> {
    Packing::new(&[base], exponent.into()).multiplied(&vec![base; exponent as usize])
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

    fn multiplied(&self, factors: &[&[Term<V>]]) -> Option<Vec<Term<V>>> {
        match self.layout.key_bits() {
            0..=64 => Some(self.over_integers::<u64>(factors)),
            65..=128 => Some(self.over_integers::<u128>(factors)),
            _ => None,
        }
    }

    fn over_integers<K: ShortKey>(&self, factors: &[&[Term<V>]]) -> Vec<Term<V>> {
        let keys: Vec<Vec<K>> = factors.iter().map(|factor| self.keys(factor)).collect();
        let Some((numerators, denominator)) = numerators(factors) else {
            let coefficients = |terms: &&[Term<V>]| terms.iter().map(|term| term.1.clone()).collect();
            let product = chain(&keys, &factors.iter().map(coefficients).collect::<Vec<_>>());
            return self.terms(product, |coefficient| coefficient);
        };
        self.terms(chain(&keys, &numerators), |numerator| Rational::from_wide(numerator, denominator))
    }

    fn keys<K: Key>(&self, terms: &[Term<V>]) -> Vec<K> {
        let key = |(monomial, _): &Term<V>| {
            let mut key = K::one(self.layout);
            for (variable, exponent) in monomial.factors() {
                let at = self.variables.binary_search(&variable).expect("invariant: every variable was collected");
                key.add(&K::variable(self.layout, at), exponent.into());
            }
            key
        };
        terms.iter().map(key).collect()
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

/// The coefficients of every factor as whole numbers, and the product of their denominators; `None` when a sum of products
/// might not fit.
fn numerators<V>(factors: &[&[Term<V>]]) -> Option<(Vec<Vec<i128>>, i128)> {
    let (mut all, mut denominator, mut bound) = (Vec::with_capacity(factors.len()), 1i128, 1i128);
    for terms in factors {
        let mut common = 1i64;
        for (_, coefficient) in *terms {
            let own = coefficient.as_words()?.1;
            common = (common / common.gcd(&own)).checked_mul(own)?;
        }
        let over = |(_, coefficient): &Term<V>| {
            coefficient.as_words().map(|(numerator, own)| i128::from(numerator) * i128::from(common / own))
        };
        let numerators: Vec<i128> = terms.iter().map(over).collect::<Option<_>>()?;
        let sum = numerators.iter().try_fold(0i128, |sum, numerator| sum.checked_add(numerator.abs()))?;
        (bound, denominator) = (bound.checked_mul(sum)?, denominator.checked_mul(common.into())?);
        all.push(numerators);
    }
    Some((all, denominator))
}

/// The terms of a product of several factors, from their keys and coefficients, in no order.
fn chain<K, C>(keys: &[Vec<K>], coefficients: &[Vec<C>]) -> Vec<(K, C)>
where
    K: ShortKey + Hash,
    C: Clone + Zero + AddAssign,
    for<'c> &'c C: Mul<&'c C, Output = C>,
{
    let mut factors = keys.iter().zip(coefficients);
    let Some((keys, coefficients)) = factors.next() else { return Vec::new() };
    let mut product: Vec<(K, C)> = keys.iter().copied().zip(coefficients.iter().cloned()).collect();
    for (keys, coefficients) in factors {
        let mut sums = FxHashMap::default();
        sums.reserve(product.len() + keys.len());
        for (left, a) in &product {
            for (right, b) in keys.iter().zip(coefficients) {
                let mut key = *left;
                key.add(right, 1);
                *sums.entry(key).or_insert_with(C::zero) += a * b;
            }
        }
        product = sums.into_iter().filter(|(_, sum)| !sum.is_zero()).collect();
    }
    product
}
