//! What makes an excitation good, as a number with its gradient in the information.
//!
//! With the regressor W of a motion's samples in base parameters, stacked, the information is M = W^T W. The condition number of W is not
//! smooth where eigenvalues meet; its logarithm is bounded from above by `(ln tr M^p + ln tr M^-p) / 2p`, which is smooth, and whose excess
//! over it is at most `ln(n) / p`.

use serde::Serialize;
use tpm_numerics::{Cholesky, DMatrix};

/// The power p, a power of two.
const POWER: usize = 8;

/// What an excitation is chosen for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Criterion {
    /// A small condition number of the stacked regressor in base parameters, in units of the model.
    #[default]
    Condition,
    /// A large determinant of the information, in which every row counts by the limit of its input.
    Determinant,
}

impl Criterion {
    /// The number to be minimised, and its gradient in M; nothing where the motion does not show every base parameter.
    pub(super) fn of(self, information: DMatrix<f64>) -> Option<(f64, DMatrix<f64>)> {
        let size = information.nrows();
        let scale = information.trace() / size as f64;
        if !(scale.is_finite() && scale > 0.0) {
            return None;
        }
        let scaled = information / scale;
        let factor = Cholesky::new(scaled.clone())?;
        let inverse = factor.inverse();
        match self {
            Self::Determinant => {
                let n = size as f64;
                let half: f64 = factor.l_dirty().diagonal().iter().map(|entry| entry.ln()).sum();
                Some((-(2.0 * half) / n - scale.ln(), inverse / (-n * scale)))
            }
            Self::Condition => {
                let (of_largest, slopes) = powers(&scaled);
                let (of_least, inverse_slopes) = powers(&inverse);
                let value = (of_largest.ln() + of_least.ln()) / (2 * POWER) as f64;
                // d tr M^p = p tr(M^(p-1) dM), d tr M^-p = -p tr(M^(-p-1) dM).
                let gradient = slopes / of_largest - (&inverse_slopes * &inverse) * &inverse / of_least;
                (value.is_finite() && gradient.iter().all(|entry| entry.is_finite()))
                    .then(|| (value, gradient * (0.5 / scale)))
            }
        }
    }
}

/// The trace of the p-th power of a matrix, and its power p - 1.
fn powers(matrix: &DMatrix<f64>) -> (f64, DMatrix<f64>) {
    // 1 + 2 + 4 + ... + p/2 = p - 1.
    let (mut power, mut product) = (matrix.clone(), matrix.clone());
    let mut exponent = 2;
    while exponent < POWER {
        power = &power * &power;
        product = &product * &power;
        exponent *= 2;
    }
    (product.dot(matrix), product)
}

#[cfg(test)]
mod tests {
    use super::{Criterion, POWER};
    use tpm_numerics::DMatrix;

    fn rows() -> DMatrix<f64> {
        DMatrix::from_fn(9, 4, |r, c| {
            (1.7 * (r * r) as f64 + 2.3 * (c as f64) * (r as f64 + 1.0)).sin() * (1 + c) as f64
        })
    }

    #[test]
    fn values_are_those_of_the_singular_values() {
        let singular = rows().singular_values();
        let (most, least) = (singular.max(), singular.min());
        let (found, _) = Criterion::Condition.of(rows().tr_mul(&rows())).expect("regular");
        let condition = (most / least).ln();
        assert!(found >= condition - 1e-12 && found <= condition + 4.0_f64.ln() / POWER as f64, "{found} {condition}");
        let (found, _) = Criterion::Determinant.of(rows().tr_mul(&rows())).expect("regular");
        let expected = -2.0 * singular.iter().map(|value| value.ln()).sum::<f64>() / 4.0;
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        assert!(Criterion::Condition.of(DMatrix::zeros(3, 3)).is_none());
        assert!(Criterion::Condition.of(DMatrix::from_element(3, 3, 1.0)).is_none());
    }

    #[test]
    fn gradients_are_those_of_difference_quotients() {
        for criterion in [Criterion::Condition, Criterion::Determinant] {
            let information = rows().tr_mul(&rows());
            let (_, gradient) = criterion.of(information.clone()).expect("regular");
            for (r, c) in (0..4).flat_map(|r| (0..=r).map(move |c| (r, c))) {
                let at = |step: f64| {
                    let mut moved = information.clone();
                    moved[(r, c)] += step;
                    moved[(c, r)] = moved[(r, c)];
                    criterion.of(moved).expect("regular").0
                };
                let h = 1e-4;
                let expected = (at(-2.0 * h) - at(2.0 * h) + 8.0 * (at(h) - at(-h))) / (12.0 * h);
                let found = if r == c { gradient[(r, r)] } else { gradient[(r, c)] + gradient[(c, r)] };
                assert!((found - expected).abs() < 1e-8 * (1.0 + expected.abs()), "{r} {c}: {found} {expected}");
            }
        }
    }
}
