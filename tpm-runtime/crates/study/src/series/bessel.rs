//! Bessel functions of the first kind, from their power series in integers of sufficient length, rounded once.

use num_bigint::BigInt;
use num_traits::{One, Zero};
use tpm_symbolic::number::rational::{self, Rational};

/// The largest magnitude of an argument of [`bessel_j`]; the power series takes about that many terms and bits.
pub(super) const MAX_ARGUMENT: f64 = 4096.0;

/// J_n(x), rounded to the nearest double (but for ties closer than 2^-100); `None` when |x| exceeds [`MAX_ARGUMENT`] or x
/// is no number.
pub(super) fn bessel_j(n: u32, x: f64) -> Option<f64> {
    if x.is_nan() || x.abs() > MAX_ARGUMENT {
        return None;
    }
    let exact = rational::from_f64(x)?;
    if exact.is_zero() {
        return Some(if n == 0 { 1.0 } else { 0.0 });
    }
    // J_n(x) = (x/2)^n / n! * S, S = sum_k (-x^2/4)^k n! / (k! (n+k)!), S being computed in units of 2^-bits.
    let half = &exact / rational::integer(2);
    let square = &half * &half;
    let mut bits: u64 = 192 + (2.0 * x.abs()) as u64;
    loop {
        let (sum, terms) = scaled_sum(n, &square, bits);
        // Every division loses less than one unit, and later terms propagate the loss with a factor of x^2/4 at most. A
        // hundred bits beyond those of a double cover both, unless S itself is small.
        let lost = 64 - u64::from(terms.leading_zeros()) + (2.0 * x.abs()) as u64;
        if sum.bits() >= 160 + lost {
            let factorial: BigInt = (1..=n).map(BigInt::from).product();
            let above = sum * half.numer().pow(n);
            let below = (half.denom().pow(n) * factorial) << bits;
            // The quotient is not in lowest terms: a common divisor would take longer than the division that rounds.
            return Some(rational::quotient_to_f64(&above, &below));
        }
        bits *= 2;
    }
}

fn scaled_sum(n: u32, square: &Rational, bits: u64) -> (BigInt, u64) {
    let mut term: BigInt = BigInt::one() << bits;
    let mut sum = term.clone();
    let mut k = 0u64;
    while !term.is_zero() {
        k += 1;
        term = -(term * square.numer()) / (square.denom() * BigInt::from(k * (k + u64::from(n))));
        sum += &term;
    }
    (sum, k)
}

#[cfg(test)]
mod tests {
    use super::{MAX_ARGUMENT, bessel_j};
    use num_traits::{One, Zero};
    use proptest::prelude::{prop_assert, proptest};
    use tpm_symbolic::number::rational::{self, Rational, integer};

    /// The power series, summed as one exact fraction with a remainder below 10^-60 of the first term.
    fn exact(n: u32, x: f64) -> Rational {
        let half = rational::from_f64(x).expect("finite") / integer(2);
        let mut term = (1..=n).fold(Rational::one(), |term, k| term * &half / integer(k.into()));
        let first = term.clone();
        let mut sum = Rational::zero();
        let mut k = 0i64;
        while !first.is_zero() && (k < 2 * x.abs() as i64 || rational::to_f64(&(&term / &first)).abs() > 1e-60) {
            sum += &term;
            k += 1;
            term = -term * &half * &half / integer(k * (k + i64::from(n)));
        }
        sum
    }

    #[test]
    fn values_are_the_nearest_doubles() {
        for n in [0u32, 1, 2, 3, 7, 20, 40] {
            for x in [1e-9, 0.1, 0.5, 1.0, -1.5, 2.404_825_557_695_773, 3.0, 5.520_078_110_286_311, 10.0, 25.0] {
                let (found, exact) = (bessel_j(n, x).expect("in range"), exact(n, x));
                assert_eq!(found, rational::to_f64(&exact), "J_{n}({x})");
            }
        }
        // Abramowitz and Stegun, table 9.1: J_0(1), J_1(1), J_0(10).
        assert_eq!(bessel_j(0, 1.0), Some(0.765_197_686_557_966_6));
        assert_eq!(bessel_j(1, 1.0), Some(0.440_050_585_744_933_5));
        assert_eq!(bessel_j(0, 10.0), "-0.24593576445134833520".parse().ok());
        assert_eq!(bessel_j(3, 0.0), Some(0.0));
        assert_eq!(bessel_j(0, f64::NAN), None);
        assert_eq!(bessel_j(0, 2.0 * MAX_ARGUMENT), None);
    }

    #[test]
    fn large_arguments_obey_the_sum_of_squares() {
        // J_0^2 + 2 sum J_n^2 = 1
        let x = 300.0;
        let square = |n: u32| bessel_j(n, x).expect("in range").powi(2);
        let sum = square(0) + 2.0 * (1..400).map(square).sum::<f64>();
        assert!((sum - 1.0).abs() < 1e-13, "{sum}");
    }

    proptest! {
        #[test]
        fn recurrence(n in 1u32..30, x in 0.1f64..40.0) {
            let j = |n| bessel_j(n, x).expect("in range");
            let sum = j(n - 1) + j(n + 1);
            let other = 2.0 * f64::from(n) / x * j(n);
            prop_assert!((sum - other).abs() <= 4.0 * f64::EPSILON * (j(n - 1).abs() + j(n + 1).abs() + other.abs()));
        }
    }
}
