//! Rational transfer functions with numerical coefficients.
//!
//! Invariant: coefficients are listed from s^0 upwards; the denominator's last one is 1, the numerator's last one is
//! not zero unless it is the only one.

use num_complex::Complex;
use tpm_numerics::DMatrix;
use tpm_numerics::eigenvalues::eigenvalues;

/// `e^{-s delay} b(s) / a(s)`.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    /// b, from s^0 upwards.
    pub(super) numerator: Vec<f64>,
    /// a, from s^0 upwards, monic.
    pub(super) denominator: Vec<f64>,
    /// Delay, s.
    pub(super) delay: f64,
}

/// Why coefficients are no transfer function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TransferError {
    /// The denominator is zero.
    #[error("the denominator of a transfer function has no coefficient other than zero")]
    ZeroDenominator,
    /// A coefficient is no number.
    #[error("a coefficient of the transfer function is not finite")]
    NotFinite,
}

impl TransferFunction {
    /// The function of these coefficients without delay, its denominator made monic, leading zeros removed.
    ///
    /// # Errors
    /// [`TransferError::NotFinite`] for a coefficient that is not finite, [`TransferError::ZeroDenominator`] for a denominator
    /// of zeros.
    pub fn new(numerator: &[f64], denominator: &[f64]) -> Result<Self, TransferError> {
        if numerator.iter().chain(denominator).any(|c| !c.is_finite()) {
            return Err(TransferError::NotFinite);
        }
        let denominator = trimmed(denominator);
        let leading = *denominator.last().filter(|c| **c != 0.0).ok_or(TransferError::ZeroDenominator)?;
        let over = |coefficients: &[f64]| coefficients.iter().map(|c| c / leading).collect();
        Ok(TransferFunction { numerator: over(trimmed(numerator)), denominator: over(denominator), delay: 0.0 })
    }

    /// b, from s^0 upwards; the last coefficient is not zero unless it is the only one.
    #[must_use]
    pub fn numerator(&self) -> &[f64] {
        &self.numerator
    }

    /// a, from s^0 upwards; the last coefficient is 1.
    #[must_use]
    pub fn denominator(&self) -> &[f64] {
        &self.denominator
    }

    /// Delay, s.
    #[must_use]
    pub const fn delay(&self) -> f64 {
        self.delay
    }

    /// The value at s.
    #[must_use]
    pub fn evaluate(&self, s: Complex<f64>) -> Complex<f64> {
        let delayed = if self.delay == 0.0 { Complex::from(1.0) } else { (-s * self.delay).exp() };
        delayed * polynomial(&self.numerator, s) / polynomial(&self.denominator, s)
    }

    /// The value at the angular frequency W, rad/s.
    #[must_use]
    pub fn response(&self, frequency: f64) -> Complex<f64> {
        self.evaluate(Complex::new(0.0, frequency))
    }

    /// Roots of the numerator.
    #[must_use]
    pub fn zeros(&self) -> Vec<Complex<f64>> {
        roots(&self.numerator)
    }

    /// Roots of the denominator.
    #[must_use]
    pub fn poles(&self) -> Vec<Complex<f64>> {
        roots(&self.denominator)
    }

    /// The value at s = 0; infinite with a pole there.
    #[must_use]
    pub fn static_gain(&self) -> f64 {
        let at = |c: &[f64]| c.first().copied().unwrap_or(0.0);
        at(&self.numerator) / at(&self.denominator)
    }
}

fn trimmed(coefficients: &[f64]) -> &[f64] {
    let last = coefficients.iter().rposition(|c| *c != 0.0).unwrap_or(0);
    coefficients.get(..=last).unwrap_or(coefficients)
}

/// The value of a polynomial.
pub(super) fn polynomial(coefficients: &[f64], s: Complex<f64>) -> Complex<f64> {
    coefficients.iter().rev().fold(Complex::from(0.0), |sum, &c| sum * s + c)
}

/// The derivative of a polynomial.
pub(super) fn derivative(coefficients: &[f64]) -> Vec<f64> {
    coefficients.iter().enumerate().skip(1).map(|(i, c)| c * i as f64).collect()
}

/// Roots of a polynomial, by real part, conjugates together: the eigenvalues of its companion matrix, polished by Newton's
/// rule.
pub(super) fn roots(coefficients: &[f64]) -> Vec<Complex<f64>> {
    let coefficients = trimmed(coefficients);
    let zero = coefficients.iter().take_while(|c| **c == 0.0).count();
    let rest = coefficients.get(zero..).unwrap_or(&[]);
    let order = rest.len().saturating_sub(1);
    let mut found = vec![Complex::from(0.0); if rest.is_empty() { 0 } else { zero }];
    if order > 0 {
        // With s = scale * z first and last coefficient have equal magnitude, and the companion matrix is balanced.
        let (first, last) = (rest[0], rest[order]);
        let scale = (first / last).abs().powf(1.0 / order as f64);
        let mut power = 1.0 / last;
        let scaled: Vec<f64> = rest
            .iter()
            .rev()
            .map(|c| {
                let value = c * power;
                power /= scale;
                value
            })
            .collect();
        let companion =
            DMatrix::from_fn(
                order,
                order,
                |r, c| {
                    if r == 0 { -scaled[c + 1] } else { f64::from(u8::from(r == c + 1)) }
                },
            );
        let slope = derivative(rest);
        found.extend(eigenvalues(&companion).iter().map(|z| polish(rest, &slope, *z * scale)));
    }
    found.sort_by(|a, b| {
        let close = (a.re - b.re).abs() <= 1e-9 * (a.norm() + b.norm());
        let by_real = if close { std::cmp::Ordering::Equal } else { a.re.total_cmp(&b.re) };
        by_real.then(a.im.abs().total_cmp(&b.im.abs())).then(a.im.total_cmp(&b.im))
    });
    found
}

/// Newton steps while they make the polynomial smaller; a root that was real stays so.
fn polish(coefficients: &[f64], slope: &[f64], start: Complex<f64>) -> Complex<f64> {
    let mut root = start;
    let mut value = polynomial(coefficients, root).norm();
    for _ in 0..5 {
        let next = root - polynomial(coefficients, root) / polynomial(slope, root);
        let smaller = polynomial(coefficients, next).norm();
        // A comparison with NaN (at a multiple root) is false and ends the iteration too.
        if smaller < value {
            (root, value) = (next, smaller);
        } else {
            break;
        }
    }
    root
}

#[cfg(test)]
mod tests {
    use super::{TransferError, TransferFunction, roots};
    use num_complex::Complex;

    #[test]
    fn roots_of_a_known_polynomial() {
        // (s + 2)(s^2 + 2 s + 101) s = s^4 + 4 s^3 + 105 s^2 + 202 s.
        let found = roots(&[0.0, 202.0, 105.0, 4.0, 1.0]);
        let expected =
            [Complex::new(-2.0, 0.0), Complex::new(-1.0, -10.0), Complex::new(-1.0, 10.0), Complex::new(0.0, 0.0)];
        assert_eq!(found.len(), 4);
        for (root, truth) in found.iter().zip(expected) {
            assert!((root - truth).norm() < 1e-13, "{found:?}");
        }
        assert!(roots(&[3.0]).is_empty() && roots(&[0.0]).is_empty() && roots(&[]).is_empty());
        // Widely spread: 1e-6, 1, 1e6 to full relative precision.
        let spread = roots(&[-1.0, 1e6 + 1.0 + 1e-6, -(1e6 + 1.0 + 1e-6), 1.0]);
        for (root, truth) in spread.iter().zip([1e-6, 1.0, 1e6]) {
            assert!((root.re / truth - 1.0).abs() < 1e-9 && root.im == 0.0, "{spread:?}");
        }
    }

    #[test]
    fn values_gain_and_faults() {
        let mut g = TransferFunction::new(&[4.0, 2.0], &[6.0, 2.0, 0.0]).expect("valid");
        assert_eq!((g.numerator.as_slice(), g.denominator.as_slice()), (&[2.0, 1.0][..], &[3.0, 1.0][..]));
        assert!((g.static_gain() - 2.0 / 3.0).abs() < 1e-15);
        assert!((g.response(3.0) - Complex::new(2.0, 3.0) / Complex::new(3.0, 3.0)).norm() < 1e-15);
        g.delay = 0.5;
        assert!((g.response(3.0).arg() - ((3.0_f64 / 2.0).atan() - 1.0_f64.atan() - 1.5)).abs() < 1e-14);
        assert_eq!(TransferFunction::new(&[1.0], &[0.0]), Err(TransferError::ZeroDenominator));
        assert_eq!(TransferFunction::new(&[f64::NAN], &[1.0]), Err(TransferError::NotFinite));
    }
}
