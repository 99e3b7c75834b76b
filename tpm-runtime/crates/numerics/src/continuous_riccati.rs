//! The continuous algebraic Riccati equation, by the sign of its Hamiltonian matrix.
//!
//! With G = B R^-1 B' the stable invariant subspace of the Hamiltonian matrix `H = [A, -G; -Q, -A']` holds the vectors
//! (x, P x), where P is the stabilising solution of `A' P + P A - P G P + Q = 0`. Newton's iteration
//! `Z <- (c Z + (c Z)^-1)/2` from Z = H, with a factor c that scales the eigenvalues' magnitudes to about one, tends to
//! the sign of H, which is -1 on this subspace: `(Z + 1) (x, P x) = 0` for every x (J. D. Roberts, 1980). Invariant:
//! what is returned solves the equation to rounding and stabilises; both are tested.

use crate::DMatrix;
use crate::Iteration;
use crate::eigenvalues::eigenvalues;
use crate::riccati::{MOST_RESIDUAL, Riccati, RiccatiError, weighted};

/// Newton's iteration, until the sign matrix changes by no more than a share of it; a dozen steps are usual.
const NEWTON: Iteration = Iteration { most: 100, settled: 1e-13 };
/// Relative change below which a step that is no smaller than the step before is rounding: the iteration has converged.
const MOST_ROUNDING_CHANGE: f64 = 1e-6;

/// Solves `A' P + P A - P B R^-1 B' P + Q = 0`; the poles are those of A - B K, rad/s.
///
/// # Errors
/// [`RiccatiError`], never [`RiccatiError::SampleTime`].
pub fn continuous_riccati(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
) -> Result<Riccati, RiccatiError> {
    let n = a.nrows();
    let weighted = weighted(a, b, q, r)?;
    let reach = b * &weighted;
    // 1. The Hamiltonian matrix.
    let mut sign = DMatrix::zeros(2 * n, 2 * n);
    sign.view_mut((0, 0), (n, n)).copy_from(a);
    sign.view_mut((0, n), (n, n)).copy_from(&-&reach);
    sign.view_mut((n, 0), (n, n)).copy_from(&-q);
    sign.view_mut((n, n), (n, n)).copy_from(&-a.transpose());
    // 2. Newton's iteration for its sign.
    let mut last = f64::INFINITY;
    for _ in 0..NEWTON.most {
        let factors = sign.clone().lu();
        let inverse = factors.try_inverse().ok_or(RiccatiError::NotStabilisable)?;
        // The inverse geometric mean of the eigenvalues' magnitudes, estimated by the norms of the matrix and of its
        // inverse.
        let scale = (inverse.norm() / sign.norm()).sqrt();
        let next = 0.5 * (scale * &sign + inverse / scale);
        let change = (&next - &sign).amax() / next.amax();
        sign = next;
        if !change.is_finite() {
            return Err(RiccatiError::NotStabilisable);
        }
        if change <= NEWTON.settled || (change < MOST_ROUNDING_CHANGE && change >= last) {
            break;
        }
        last = change;
    }
    // 3. P by least squares from [Z12; Z22 + 1] P = -[Z11 + 1; Z21], twice as many equations as unknowns.
    let identity = DMatrix::<f64>::identity(n, n);
    let mut left = sign.columns(n, n).into_owned();
    let mut right = -sign.columns(0, n).into_owned();
    let mut lower = left.rows_mut(n, n);
    lower += &identity;
    let mut upper = right.rows_mut(0, n);
    upper -= &identity;
    let qr = left.qr();
    let solution = qr.r().solve_upper_triangular(&(qr.q().transpose() * right)).ok_or(RiccatiError::NotStabilisable)?;
    let solution = 0.5 * (&solution + solution.transpose());
    // 4. The gain, the poles of the closed loop and the residual of the equation.
    let gain = &weighted * &solution;
    let poles = eigenvalues(&(a - b * &gain));
    let terms = [a.transpose() * &solution, &solution * a, &solution * &reach * &solution, q.clone()];
    let largest = terms.iter().map(DMatrix::amax).fold(0.0, f64::max);
    let left = (&terms[0] + &terms[1] - &terms[2] + &terms[3]).amax();
    let residual = if largest > 0.0 { left / largest } else { 0.0 };
    if residual.is_nan() || residual > MOST_RESIDUAL || !poles.iter().all(|s| s.re < 0.0) {
        return Err(RiccatiError::NotStabilisable);
    }
    Ok(Riccati { solution, gain, poles, residual })
}

#[cfg(test)]
mod tests {
    use super::continuous_riccati;
    use crate::DMatrix;
    use crate::riccati::RiccatiError;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn a_scalar_equation_has_its_closed_solution() {
        // 2 a p - b^2 p^2/r + q = 0.
        let one = |x| DMatrix::from_element(1, 1, x);
        for (a, b, q, r) in [(1.2_f64, 0.5_f64, 2.0_f64, 3.0_f64), (-0.3, 1.0, 1.0, 0.1), (0.0, 2.0, 5.0, 1.0)] {
            let found = continuous_riccati(&one(a), &one(b), &one(q), &one(r)).expect("can be stabilised");
            let expected = (a + (a * a + q * b * b / r).sqrt()) * r / (b * b);
            assert!((found.solution[(0, 0)] / expected - 1.0).abs() < 1e-13, "{a}");
        }
        // An unstable mode that the input does not reach.
        assert_eq!(continuous_riccati(&one(1.0), &one(0.0), &one(1.0), &one(1.0)), Err(RiccatiError::NotStabilisable));
    }

    #[test]
    fn random_systems_are_solved_to_rounding() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for (n, m) in [(2, 1), (4, 1), (6, 2), (8, 3)] {
            for _ in 0..5 {
                let mut matrix = |rows, columns| DMatrix::from_fn(rows, columns, |_, _| random.random_range(-3.0..3.0));
                let (a, b, c) = (matrix(n, n), matrix(n, m), matrix(n, n));
                let q = &c * c.transpose();
                let found = continuous_riccati(&a, &b, &q, &DMatrix::identity(m, m)).expect("can be stabilised");
                assert!(found.residual < 1e-10, "{n}: {:e}", found.residual);
                assert!(found.solution.clone().symmetric_eigenvalues().min() >= -1e-9 * found.solution.amax());
            }
        }
    }
}
