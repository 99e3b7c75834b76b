//! Coefficients of a column as whole numbers over one denominator.

use crate::number::rational::Rational;
use crate::number::scalar::Scalar;
use crate::regressor::form::Term;
use num_integer::Integer;

/// The least common denominator of the terms' coefficients; `None` when it is 1.
pub(super) fn common_denominator(terms: &[Term]) -> Option<Scalar> {
    let mut common: Option<Scalar> = None;
    for term in terms {
        if term.coefficient.is_integer() {
            continue;
        }
        let denominator = denominator_of(&term.coefficient);
        common = Some(match common {
            None => denominator,
            Some(common) if common == denominator => common,
            Some(common) => {
                let small = match (&common, &denominator) {
                    (Scalar::Small(a), Scalar::Small(b)) => (b / a.gcd(b)).checked_mul(*a),
                    _ => None,
                };
                small.map_or_else(|| Scalar::from_big(&common.to_big().lcm(&denominator.to_big())), Scalar::Small)
            }
        });
    }
    common
}

pub(super) fn numerator_of(value: &Rational) -> Scalar {
    value.as_words().map_or_else(|| Scalar::from_big(&value.numer()), |(numerator, _)| Scalar::Small(numerator))
}

fn denominator_of(value: &Rational) -> Scalar {
    value.as_words().map_or_else(|| Scalar::from_big(&value.denom()), |(_, denominator)| Scalar::Small(denominator))
}

/// The numerator of a coefficient over a multiple of its denominator.
pub(super) fn numerator_over(coefficient: &Rational, common: Option<&Scalar>) -> Scalar {
    let numerator = numerator_of(coefficient);
    let Some(common) = common else { return numerator };
    let denominator = denominator_of(coefficient);
    if let (Scalar::Small(common), Scalar::Small(denominator)) = (common, &denominator) {
        return numerator.times(&Scalar::Small(common / denominator));
    }
    Scalar::from_big(&(coefficient.numer() * (common.to_big() / coefficient.denom())))
}
