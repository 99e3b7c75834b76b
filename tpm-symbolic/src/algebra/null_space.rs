//! Null spaces over fields of rational functions.

use crate::algebra::fraction::Fraction;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::number::rational::Rational;
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{One, Signed, Zero};
use std::collections::{BTreeMap, BTreeSet};

/// Largest number of terms in the numerator of a component; a longer one is of no use to a reader.
const MAX_TERMS: usize = 2000;

/// A basis of the null space over a field of rational functions, each vector with a 1 at its own free column; `None`
/// when a numerator grows beyond 2000 terms, which no reader could use.
#[must_use]
pub fn null_space_of_fractions<V: Ord + Clone>(
    mut rows: Vec<Vec<Fraction<V>>>,
    columns: usize,
) -> Option<Vec<Vec<Fraction<V>>>> {
    let size = |value: &Fraction<V>| (value.denominator().len(), value.numerator().len());
    let mut pivots = Vec::new();
    for column in 0..columns {
        let top = pivots.len();
        // The pivot with the fewest terms keeps the other rows short.
        let found = (top..rows.len()).filter(|&r| !rows[r][column].is_zero()).min_by_key(|&r| size(&rows[r][column]));
        let Some(found) = found else { continue };
        rows.swap(top, found);
        let inverse = rows[top][column].inverse().expect("invariant: a pivot is not zero");
        for value in &mut rows[top][column..] {
            *value = value.mul(&inverse);
        }
        let pivot_row = rows[top].clone();
        for (r, row) in rows.iter_mut().enumerate() {
            if r == top || row[column].is_zero() {
                continue;
            }
            let factor = row[column].clone();
            for (value, pivot) in row[column..].iter_mut().zip(&pivot_row[column..]) {
                if !pivot.is_zero() {
                    *value = value.sub(&factor.mul(pivot));
                    if value.numerator().len() > MAX_TERMS {
                        return None;
                    }
                }
            }
        }
        pivots.push(column);
    }
    let free = (0..columns).filter(|column| !pivots.contains(column));
    let vectors = free.map(|free| {
        let mut vector = vec![Fraction::zero(); columns];
        vector[free] = Fraction::one();
        for (row, &pivot) in rows.iter().zip(&pivots) {
            vector[pivot] = row[free].scale(&-Rational::one());
        }
        vector
    });
    Some(vectors.collect())
}

/// The vector scaled so that its components are polynomials with whole coefficients and no common factor that is a
/// number or a monomial; the first component leads with a positive coefficient.
#[must_use]
pub fn primitive_vector<V: Ord + Clone>(vector: Vec<Fraction<V>>) -> Vec<Polynomial<V>> {
    let mut common = Fraction::one();
    for value in &vector {
        // Multiply by the factors of the component's denominator that the multiplier does not contain yet.
        for (factor, exponent) in value.mul(&common).denominator() {
            common = common.mul(&Fraction::polynomial(factor.pow(exponent)));
        }
    }
    let polynomials: Vec<Polynomial<V>> = vector.iter().map(|value| value.mul(&common).numerator().clone()).collect();
    let mut least: Option<BTreeMap<V, i32>> = None;
    let (mut numerator, mut denominator) = (BigInt::zero(), BigInt::one());
    for (monomial, coefficient) in polynomials.iter().flat_map(Polynomial::terms) {
        numerator = numerator.gcd(&coefficient.numer());
        denominator = denominator.lcm(&coefficient.denom());
        let own: BTreeMap<V, i32> = monomial.factors().map(|(v, e)| (v.clone(), e)).collect();
        least = Some(match least {
            None => own,
            Some(least) => {
                let variables: BTreeSet<V> = least.keys().chain(own.keys()).cloned().collect();
                let exponent = |map: &BTreeMap<V, i32>, v: &V| map.get(v).copied().unwrap_or(0);
                variables.into_iter().map(|v| (v.clone(), exponent(&least, &v).min(exponent(&own, &v)))).collect()
            }
        });
    }
    if numerator.is_zero() {
        return polynomials;
    }
    let shift: Monomial<V> = least.unwrap_or_default().into_iter().map(|(v, e)| (v, -e)).collect();
    let lead = polynomials.iter().find_map(|p| p.terms().next_back().map(|(_, c)| c.is_negative())).unwrap_or(false);
    let scale = Rational::new(denominator, if lead { -numerator } else { numerator });
    polynomials.iter().map(|polynomial| polynomial.mul_monomial(&shift).scale(&scale)).collect()
}
