//! Bounds of the truncation error of an infinite series above the highest harmonic kept.

use crate::algebra::fourier::{Fourier, Trig};
use crate::harmonic::sign::QuadrantSign;
use crate::number::rational::{self, Rational};
use num_bigint::BigInt;
use num_traits::{Signed, ToPrimitive, Zero};

/// The root mean square of the truncation error, rounded up, by Parseval's identity. The root mean square of the whole
/// equals that of the smooth factor, since the square of a sign is 1.
pub(crate) fn root_mean_square(whole: &Fourier, mean: &Fourier, series: &Fourier) -> f64 {
    let inner = |a: &Fourier, b: &Fourier| -> Rational { a.mul(b).cos_coefficient(0) };
    // |mean + series / pi|^2 = A + B / pi + C / pi^2
    let kept = [inner(mean, mean), rational::integer(2) * inner(mean, series), inner(series, series)];
    let inverse = inverse_of_pi();
    let kept = &kept[0] + &kept[1] * &inverse + &kept[2] * &inverse * &inverse;
    let rest = inner(whole, whole) - kept;
    if rest.is_positive() { rational::to_f64(&rest).sqrt().next_up().next_up() } else { 0.0 }
}

/// 1/pi to 80 digits (Abramowitz and Stegun, table 1.1, extended). Its error is far below the rounding of the result,
/// even after the cancellation in a tail of 1e-20 of the whole.
fn inverse_of_pi() -> Rational {
    let digits = "31830988618379067153776752674502872406891929148091289749533468811779359526845307";
    let numerator: BigInt = digits.parse().expect("invariant: digits");
    Rational::new(numerator, BigInt::from(10).pow(80))
}

/// A bound of the largest magnitude of the truncation error. When the product is r times continuously differentiable
/// except for jumps of its r-th derivative, its n-th amplitude is at most V / (pi n^(r+1)), with V the variation of the
/// r-th derivative over a period; the sum over n > N is at most V / (pi r N^r). `None` for r = 0: the Fourier series of
/// a jump does not converge uniformly.
pub(crate) fn maximum(fourier: &Fourier, sign: &QuadrantSign, harmonics: usize) -> Option<f64> {
    let multiple = sign.multiple();
    // In phi = multiple theta the values at quarter turns are rational. For other arguments no smoothness is assumed.
    if fourier.terms().any(|(k, ..)| k % multiple != 0) || harmonics < multiple {
        return None;
    }
    let top = fourier.highest_harmonic() / multiple;
    let part =
        |f: fn(&Fourier, usize) -> Rational, from: usize| (from..=top).map(|k| f(fourier, k * multiple)).collect();
    let shape = Fourier::from_parts(part(Fourier::cos_coefficient, 0), part(Fourier::sin_coefficient, 1));
    let mut derivative = shape;
    let mut smoothness = 0;
    let jumps = |f: &Fourier| -> Rational { sign.flips().map(|turns| at_quarter_turn(f, turns).abs()).sum() };
    while jumps(&derivative).is_zero() {
        derivative = derivative.derivative(1);
        smoothness += 1;
        if derivative.is_zero() {
            return Some(0.0);
        }
    }
    if smoothness == 0 {
        return None;
    }
    let slope: Rational = derivative.derivative(1).terms().map(|(_, _, value)| value.abs()).sum();
    let variation = 2.0 * rational::to_f64(&jumps(&derivative)) + std::f64::consts::TAU * rational::to_f64(&slope);
    let kept = (harmonics / multiple).to_f64()?;
    let bound = variation / (std::f64::consts::PI * f64::from(smoothness) * kept.powi(smoothness));
    Some(bound * (1.0 + 1e-12))
}

fn at_quarter_turn(fourier: &Fourier, turns: usize) -> Rational {
    fourier
        .terms()
        .map(|(k, function, value)| {
            let quarter = match function {
                Trig::Cos => (k * turns + 1) % 4,
                Trig::Sin => (k * turns) % 4,
            };
            match quarter {
                1 => value.clone(),
                3 => -value,
                _ => Rational::zero(),
            }
        })
        .sum()
}
