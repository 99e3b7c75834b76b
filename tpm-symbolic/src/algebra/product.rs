//! Products of powers of polynomials of many terms.
//!
//! Invariants: exponents are packed into one word that holds those of every intermediate product, so that multiplying
//! monomials is one addition. Coefficients are whole numbers over one denominator while the bound of all sums (the
//! product of the sums of magnitudes) fits into 128 bits, and rationals beyond. Terms are sorted once, at the end, by
//! words whose order is that of their monomials.

use crate::algebra::monomial::{Factorisation, Monomial};
use crate::algebra::packed::{Key, Layout, ShortKey};
use crate::budget;
use crate::number::rational::Rational;
use num_integer::gcd;
use num_traits::{FromPrimitive, One, Zero};
use rustc_hash::FxHashMap;
use std::ops::AddAssign;

/// Largest number of sums for which memory is reserved in advance.
const LARGEST: usize = 1 << 16;

/// Operations per product of terms, including the search for its sum, for the budget.
const PRODUCT: u64 = 16;

/// A term of a polynomial.
type Term<V> = (Monomial<V>, Rational);

/// A polynomial and its power, at least 1, in a product.
pub(crate) type Factor<'p, V> = (&'p [Term<V>], u32);

/// The terms of a product of powers, in the order of the monomials; `None` when no word holds their exponents.
pub(crate) fn product_of_powers<V: Ord + Clone>(factors: &[Factor<'_, V>]) -> Option<Vec<Term<V>>> {
    let packing = Packing::new(factors);
    match packing.layout.key_bits() {
        0..=64 => Some(packing.multiplied::<u64>(factors)),
        65..=128 => Some(packing.multiplied::<u128>(factors)),
        _ => None,
    }
}

/// Variables and the width of their exponents.
struct Packing<'v, V> {
    /// The variables in descending order, so that the first variable of a monomial has the highest field.
    variables: Vec<&'v V>,
    layout: Layout,
}

impl<'v, V: Ord + Clone> Packing<'v, V> {
    fn new(factors: &[Factor<'v, V>]) -> Self {
        let (mut variables, mut highest): (Vec<&V>, u64) = (Vec::new(), 0);
        for (terms, power) in factors {
            let mut largest = 0;
            for (variable, exponent) in terms.iter().flat_map(|term| term.0.factors()) {
                largest = largest.max(exponent.unsigned_abs());
                if let Err(at) = variables.binary_search_by(|other| variable.cmp(other)) {
                    variables.insert(at, variable);
                }
            }
            highest = highest.saturating_add(u64::from(largest) * u64::from(*power));
        }
        let layout = Layout::new(variables.len(), highest);
        Self { variables, layout }
    }

    fn multiplied<K: ShortKey>(&self, factors: &[Factor<'_, V>]) -> Vec<Term<V>> {
        let Some((numerators, largest, denominator)) = over_one_denominator(factors) else {
            let own = |(terms, _): &Factor<'_, V>| terms.iter().map(|term| term.1.clone()).collect();
            let product = self.product::<K, Rational>(factors, factors.iter().map(own).collect(), power);
            return self.terms(product, |coefficient| coefficient);
        };
        if i64::try_from(largest).is_ok() {
            let words = |list: Vec<i128>| list.into_iter().map(|numerator| numerator as i64).collect();
            let words = numerators.into_iter().map(words).collect();
            let product = self.product::<K, i64>(factors, words, integer_power);
            return self.terms(product, |numerator| Rational::from_wide(numerator.into(), denominator));
        }
        let product = self.product::<K, i128>(factors, numerators, integer_power);
        self.terms(product, |numerator| Rational::from_wide(numerator, denominator))
    }

    /// The terms of the product with these coefficients, in no order.
    fn product<K: ShortKey, C: Coefficient>(
        &self,
        factors: &[Factor<'_, V>],
        coefficients: Vec<Vec<C>>,
        power: impl Fn(Vec<(K, C)>, u32) -> Vec<(K, C)>,
    ) -> Vec<(K, C)> {
        let powers = factors.iter().zip(coefficients).map(|((terms, exponent), coefficients)| {
            power(terms.iter().map(|term| self.key(&term.0)).zip(coefficients).collect(), *exponent)
        });
        powers.reduce(|product, power| times(&product, &power)).unwrap_or_else(|| vec![(K::one(self.layout), C::one())])
    }

    /// A monomial, packed.
    fn key<K: Key>(&self, monomial: &Monomial<V>) -> K {
        let mut key = K::one(self.layout);
        for (variable, exponent) in monomial.factors() {
            let at = self.variables.binary_search_by(|other| variable.cmp(other));
            key.add(&K::variable(self.layout, at.expect("invariant: every variable was collected")), exponent.into());
        }
        key
    }

    /// The sums in the order of their monomials, unpacked.
    fn terms<K: ShortKey, C>(&self, sums: Vec<(K, C)>, value: impl Fn(C) -> Rational) -> Vec<Term<V>> {
        let ones = K::ones(self.layout);
        let listed = |(key, sum): (K, C)| (key.listed(self.layout, ones), key, sum);
        let mut sums: Vec<(K, K, C)> = sums.into_iter().map(listed).collect();
        sums.sort_unstable_by_key(|sum| sum.0);
        let term = |(_, key, sum): (K, K, C)| {
            let present = key.present(self.layout, ones);
            let mut factors = Factorisation::with_capacity(present.len());
            for (at, exponent) in present {
                let exponent = i32::try_from(exponent).expect("invariant: exponents of products are small");
                factors.push((self.variables[at].clone(), exponent));
            }
            (Monomial::from_sorted(factors), value(sum))
        };
        sums.into_iter().map(term).collect()
    }
}

/// A coefficient of a packed monomial.
trait Coefficient: Clone + Zero + One + AddAssign {
    fn times(&self, other: &Self) -> Self;
}

impl Coefficient for Rational {
    fn times(&self, other: &Self) -> Self {
        self * other
    }
}

impl<C: Copy + Zero + One + AddAssign + FromPrimitive> Coefficient for C {
    fn times(&self, other: &Self) -> Self {
        *self * *other
    }
}

/// A coefficient that is a machine integer.
trait Integer: Coefficient + Copy + FromPrimitive {}
impl<C: Coefficient + Copy + FromPrimitive> Integer for C {}

/// The coefficients of every factor as whole numbers, a bound of all sums of their products, and the denominator of the
/// product; `None` when one of these might not fit into 128 bits.
fn over_one_denominator<V>(factors: &[Factor<'_, V>]) -> Option<(Vec<Vec<i128>>, i128, i128)> {
    let (mut lists, mut largest, mut below) = (Vec::with_capacity(factors.len()), 1i128, 1i128);
    for (terms, power) in factors {
        let mut common = 1i64;
        for (_, coefficient) in *terms {
            let own = coefficient.as_words()?.1;
            common = (common / gcd(common, own)).checked_mul(own)?;
        }
        let over = |(_, coefficient): &Term<V>| {
            coefficient.as_words().map(|(numerator, own)| i128::from(numerator) * i128::from(common / own))
        };
        let numerators: Vec<i128> = terms.iter().map(over).collect::<Option<_>>()?;
        let sum = numerators.iter().try_fold(0i128, |sum, numerator| sum.checked_add(numerator.abs()))?;
        largest = largest.checked_mul(sum.checked_pow(*power)?)?;
        below = below.checked_mul(i128::from(common).checked_pow(*power)?)?;
        lists.push(numerators);
    }
    Some((lists, largest, below))
}

/// The terms of left * right, in no order.
fn times<K: ShortKey, C: Coefficient>(left: &[(K, C)], right: &[(K, C)]) -> Vec<(K, C)> {
    let product = |(left, a): &(K, C), (right, b): &(K, C)| {
        let mut key = *left;
        key.add(right, 1);
        (key, a.times(b))
    };
    if let ([one], many) | (many, [one]) = (left, right) {
        return many.iter().map(|term| product(term, one)).collect();
    }
    budget::charge((left.len() as u64).saturating_mul(right.len() as u64).saturating_mul(PRODUCT));
    let mut sums = FxHashMap::default();
    sums.reserve(left.len() + right.len());
    for left in left {
        for right in right {
            let (key, value) = product(left, right);
            *sums.entry(key).or_insert_with(C::zero) += value;
        }
    }
    sums.into_iter().filter(|(_, sum)| !sum.is_zero()).collect()
}

/// The terms of base^exponent, in no order.
fn power<K: ShortKey, C: Coefficient>(base: Vec<(K, C)>, exponent: u32) -> Vec<(K, C)> {
    let mut power = base.clone();
    for _ in 1..exponent {
        power = times(&power, &base);
    }
    power
}

/// The terms of base^exponent with whole coefficients, in no order. The multinomial theorem is used where it takes no
/// more products than repeated multiplication.
fn integer_power<K: ShortKey, C: Integer>(base: Vec<(K, C)>, exponent: u32) -> Vec<(K, C)> {
    // Binomial coefficients of exponents up to 60 fit into a word.
    let count = |exponent: u32| products(base.len(), exponent).filter(|_| exponent <= 60);
    let mut power = base.clone();
    for present in 1..exponent {
        let multiplication = (power.len() * base.len()) as u64;
        if let Some(count) = count(exponent).filter(|count| *count <= multiplication) {
            return multinomial(&base, exponent, count);
        }
        power = match count(2) {
            Some(count) if present == 1 => multinomial(&base, 2, count),
            _ => times(&power, &base),
        };
    }
    power
}

/// The number of products of `exponent` factors out of `terms` terms, whatever their order.
fn products(terms: usize, exponent: u32) -> Option<u64> {
    let more = (terms as u64).checked_sub(1)?;
    (1..=u64::from(exponent)).try_fold(1u64, |count, i| Some(count.checked_mul(more.checked_add(i)?)? / i))
}

/// The terms of base^exponent by the multinomial theorem, which takes `count` products.
fn multinomial<K: ShortKey, C: Integer>(base: &[(K, C)], exponent: u32, count: u64) -> Vec<(K, C)> {
    budget::charge(count.saturating_mul(PRODUCT));
    let mut sums = FxHashMap::default();
    // Many products have equal monomials, so half of the count is reserved.
    sums.reserve(usize::try_from(count / 2).unwrap_or(LARGEST).min(LARGEST));
    add_products(base, exponent, K::default(), C::one(), &mut sums);
    sums.into_iter().filter(|(_, sum)| !sum.is_zero()).collect()
}

/// Adds coefficient * key * base^exponent.
fn add_products<K: ShortKey, C: Integer>(
    base: &[(K, C)],
    exponent: u32,
    key: K,
    coefficient: C,
    sums: &mut FxHashMap<K, C>,
) {
    if exponent == 1 {
        for (own, value) in base {
            let mut key = key;
            key.add(own, 1);
            *sums.entry(key).or_insert_with(C::zero) += coefficient * *value;
        }
        return;
    }
    for (i, (own, value)) in base.iter().enumerate() {
        let last = i + 1 == base.len();
        // Products with earlier terms are already added. The current term now occurs once, twice, ...
        let (mut key, mut power, mut ways) = (key, coefficient, 1u64);
        for times in 1..=exponent {
            key.add(own, 1);
            power = power * *value;
            ways = ways * u64::from(exponent - times + 1) / u64::from(times);
            // After the last term no factor remains, so its power must use up the exponent; lower powers occur in no
            // product, and the bound does not cover them.
            if last && times < exponent {
                continue;
            }
            let product = power * C::from_u64(ways).expect("invariant: no larger than the sum of all products");
            if times == exponent {
                *sums.entry(key).or_insert_with(C::zero) += product;
            } else {
                add_products(&base[i + 1..], exponent - times, key, product, sums);
            }
        }
    }
}
