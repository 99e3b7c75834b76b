//! Eigenvalues of a real matrix, by a bounded number of iterations.
//!
//! nalgebra's double-shift QR iteration has no exceptional shifts, and does not end on some matrices (`DESIGN.md`, "Why
//! nalgebra and what does it get wrong?"). Invariant: every iteration here is bounded. A matrix on which the iteration
//! does not end is reflected, which changes its eigenvalues by rounding only and the course of the iteration entirely
//! (after Golub and Van Loan, Matrix Computations, 7.5).

use crate::{DMatrix, DVector};
use nalgebra::linalg::Schur;
use num_complex::Complex;

/// Most QR sweeps per row; a few are usual.
const MOST_SWEEPS_PER_ROW: usize = 60;
/// Most attempts: the matrix as it is, then reflections of it.
const MOST_ATTEMPTS: usize = 8;

/// The eigenvalues of a square matrix; NaN when an entry is not finite, or no attempt ends.
pub fn eigenvalues(matrix: &DMatrix<f64>) -> Vec<Complex<f64>> {
    let n = matrix.nrows();
    let none = || vec![Complex::new(f64::NAN, f64::NAN); n];
    if n == 0 || matrix.iter().any(|x| !x.is_finite()) {
        return none();
    }
    let attempt = |attempt| {
        let similar = if attempt == 0 { matrix.clone() } else { reflected(matrix, attempt) };
        let schur = Schur::try_new(similar, f64::EPSILON, MOST_SWEEPS_PER_ROW * n)?;
        let found: Vec<Complex<f64>> = schur.complex_eigenvalues().iter().copied().collect();
        found.iter().all(|z| z.re.is_finite() && z.im.is_finite()).then_some(found)
    };
    (0..MOST_ATTEMPTS).find_map(attempt).unwrap_or_else(none)
}

/// `Q A Q` with the reflection `Q = 1 - 2 v v'/v'v`.
fn reflected(matrix: &DMatrix<f64>, attempt: usize) -> DMatrix<f64> {
    let n = matrix.nrows();
    // Any direction serves that does not share the structure of the matrix, such as its zeros.
    let v = DVector::from_fn(n, |i, _| ((i + 1) as f64 * (attempt as f64 + 0.5).sqrt()).sin()).normalize();
    let half = matrix - 2.0 * &v * (v.transpose() * matrix);
    &half - 2.0 * (&half * &v) * v.transpose()
}

#[cfg(test)]
mod tests {
    use super::{eigenvalues, reflected};
    use crate::DMatrix;
    use nalgebra::linalg::Schur;
    use num_complex::Complex;

    /// One sample of two carts in closed loop, by columns, on which the library's iteration does not end: the last error and the
    /// filtered rate of the second cart, which is not fed back, stand behind the other states.
    #[rustfmt::skip]
    const ROUND: [f64; 64] = [
        0.9974399308948784, -5.120086135614634, 9.060565231957018e-5, 0.18113121348501324, 1.0, 0.0, 393.46934028736655, 0.0,
        0.0009999802159216308, 0.9999406482848886, 3.02147795456396e-8, 9.064343219820617e-5, 0.0, 0.0, 0.0, 0.0,
        4.718548041948028e-5, 0.09436860157106675, 0.9999093563840027, -0.1812830674367691, 0.0, 1.0, 0.0, 393.46934028736655,
        1.572865075854108e-8, 4.718548041948035e-5, 0.0009999697851836974, 0.9999093563840064, 0.0, 0.0, 0.0, 0.0,
        0.0024387370326369897, 4.877425816843482, 3.684349963510957e-8, 0.00014737326156211836, 0.0, 0.0, -393.46934028736655, 0.0,
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -393.46934028736655,
        -3.7592987046732706e-6, -0.007518523034676438, -5.679403666746809e-11, -2.2717501062215322e-7, 0.0, 0.0, 0.6065306597126334, 0.0,
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.6065306597126334,
    ];

    /// Checks eigenvalues by the sums of their powers, which are the traces of the matrix's powers.
    fn check(matrix: &DMatrix<f64>, found: &[Complex<f64>]) {
        let (mut power, size) = (matrix.clone(), found.iter().map(|z| z.norm()).fold(1.0, f64::max));
        for k in 1..=matrix.nrows() {
            let sum: Complex<f64> = found.iter().map(|z| z.powu(k as u32)).sum();
            let off = (sum - power.trace()).norm();
            assert!(off < 1e-9 * size.powi(k as i32), "power {k}: {sum} {}", power.trace());
            power *= matrix;
        }
    }

    #[test]
    fn a_matrix_on_which_the_iteration_goes_round_has_its_eigenvalues() {
        let matrix = DMatrix::from_column_slice(8, 8, &ROUND);
        assert!(Schur::try_new(matrix.clone(), f64::EPSILON, 100_000).is_none());
        let found = eigenvalues(&matrix);
        check(&matrix, &found);
        // The pole of the filter that nothing uses, and the error that nothing reads.
        for alone in [0.0, 0.6065306597126334] {
            assert!(found.iter().any(|z| (z - alone).norm() < 1e-9), "{found:?}");
        }
        assert!(found.iter().all(|z| z.norm() < 1.0));
    }

    #[test]
    fn reflections_keep_the_eigenvalues() {
        let matrix = DMatrix::from_fn(6, 6, |r, c| ((r * 7 + c * c * 3 + r * c) as f64).sin());
        for attempt in 1..super::MOST_ATTEMPTS {
            check(&matrix, &eigenvalues(&reflected(&matrix, attempt)));
        }
        check(&matrix, &eigenvalues(&matrix));
        assert!(eigenvalues(&DMatrix::zeros(0, 0)).is_empty());
        let broken = DMatrix::from_element(3, 3, f64::NAN);
        assert!(eigenvalues(&broken).iter().all(|z| z.re.is_nan()));
    }
}
