//! Products of integer powers of variables.
//!
//! Invariant: a [`Monomial`] lists its variables in increasing order with non-zero exponents, so that equal monomials are equal
//! as data.

use serde::{Deserialize, Serialize};
use smallvec::SmallVec;
use std::cmp::Ordering;

/// The factors of a monomial.
pub(crate) type Factorisation<V> = SmallVec<[(V, i32); 4]>;

/// A product of integer powers of variables.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Monomial<V>(Factorisation<V>);

impl<V> Default for Monomial<V> {
    fn default() -> Self {
        Self(SmallVec::new())
    }
}

impl<V: Ord + Clone> Monomial<V> {
    /// The empty product.
    #[must_use]
    pub fn one() -> Self {
        Self::default()
    }

    /// `variable ^ exponent`.
    ///
    /// ```
    /// # use tpm_symbolic::algebra::polynomial::Monomial;
    /// assert!(Monomial::power_of("x", 0).is_one());
    /// ```
    #[must_use]
    pub fn power_of(variable: V, exponent: i32) -> Self {
        let mut factors = SmallVec::new();
        if exponent != 0 {
            factors.push((variable, exponent));
        }
        Self(factors)
    }

    /// The monomial with these factors, given in increasing order of the variables and without zero exponents.
    pub(crate) fn from_sorted(list: Factorisation<V>) -> Self {
        debug_assert!(list.is_sorted_by(|a, b| a.0 < b.0) && list.iter().all(|factor| factor.1 != 0));
        Self(list)
    }

    /// Whether this is the empty product.
    #[must_use]
    pub fn is_one(&self) -> bool {
        self.0.is_empty()
    }

    /// The factors in increasing order of the variables.
    ///
    /// ```
    /// # use tpm_symbolic::algebra::polynomial::Monomial;
    /// let product = Monomial::power_of("y", 2).mul(&Monomial::power_of("x", -1));
    /// assert_eq!(product.factors().collect::<Vec<_>>(), [(&"x", -1), (&"y", 2)]);
    /// ```
    pub fn factors(&self) -> impl ExactSizeIterator<Item = (&V, i32)> + Clone {
        self.0.iter().map(|(v, e)| (v, *e))
    }

    /// The exponent of `variable`, zero when absent.
    ///
    /// ```
    /// # use tpm_symbolic::algebra::polynomial::Monomial;
    /// let square = Monomial::power_of("x", 2);
    /// assert_eq!((square.exponent(&"x"), square.exponent(&"y")), (2, 0));
    /// ```
    #[must_use]
    pub fn exponent(&self, variable: &V) -> i32 {
        self.0.binary_search_by(|(v, _)| v.cmp(variable)).map_or(0, |i| self.0[i].1)
    }

    /// The sum of all exponents.
    ///
    /// ```
    /// # use tpm_symbolic::algebra::polynomial::Monomial;
    /// assert_eq!(Monomial::power_of("x", 2).mul(&Monomial::power_of("y", -3)).degree(), -1);
    /// ```
    #[must_use]
    pub fn degree(&self) -> i32 {
        self.0.iter().map(|(_, e)| e).sum()
    }

    /// The product of two monomials.
    ///
    /// ```
    /// # use tpm_symbolic::algebra::polynomial::Monomial;
    /// assert!(Monomial::power_of("x", 2).mul(&Monomial::power_of("x", -2)).is_one());
    /// ```
    #[must_use]
    pub fn mul(&self, other: &Self) -> Self {
        let mut factors = SmallVec::with_capacity(self.0.len() + other.0.len());
        let (mut left, mut right) = (self.0.as_slice(), other.0.as_slice());
        while let ([a, left_rest @ ..], [b, right_rest @ ..]) = (left, right) {
            match a.0.cmp(&b.0) {
                Ordering::Less => {
                    factors.push(a.clone());
                    left = left_rest;
                }
                Ordering::Greater => {
                    factors.push(b.clone());
                    right = right_rest;
                }
                Ordering::Equal => {
                    if a.1 + b.1 != 0 {
                        factors.push((a.0.clone(), a.1 + b.1));
                    }
                    (left, right) = (left_rest, right_rest);
                }
            }
        }
        for factor in left.iter().chain(right) {
            factors.push(factor.clone());
        }
        Self(factors)
    }

    /// The monomial raised to an integer power.
    ///
    /// ```
    /// # use tpm_symbolic::algebra::polynomial::Monomial;
    /// assert_eq!(Monomial::power_of("x", 2).pow(-3), Monomial::power_of("x", -6));
    /// ```
    #[must_use]
    pub fn pow(&self, exponent: i32) -> Self {
        if exponent == 0 {
            return Self::one();
        }
        Self(self.0.iter().map(|(v, e)| (v.clone(), e * exponent)).collect())
    }

    /// Splits into the factors for which `keep` holds and the rest.
    ///
    /// ```
    /// # use tpm_symbolic::algebra::polynomial::Monomial;
    /// let product = Monomial::power_of("x", 2).mul(&Monomial::power_of("y", 1));
    /// assert_eq!(product.partition(|name| *name == "x"), (Monomial::power_of("x", 2), Monomial::power_of("y", 1)));
    /// ```
    #[must_use]
    pub fn partition(&self, mut keep: impl FnMut(&V) -> bool) -> (Self, Self) {
        let (kept, rest) = self.0.iter().cloned().partition(|(v, _)| keep(v));
        (Self(kept), Self(rest))
    }
}

impl<V: Ord + Clone> FromIterator<(V, i32)> for Monomial<V> {
    fn from_iter<I: IntoIterator<Item = (V, i32)>>(factors: I) -> Self {
        let mut list: Factorisation<V> = factors.into_iter().filter(|factor| factor.1 != 0).collect();
        if !list.is_sorted_by(|a, b| a.0 < b.0) {
            list.sort_unstable_by(|a, b| a.0.cmp(&b.0));
            list.dedup_by(|next, kept| {
                let same = next.0 == kept.0;
                if same {
                    kept.1 += next.1;
                }
                same
            });
            list.retain(|factor| factor.1 != 0);
        }
        Self(list)
    }
}
