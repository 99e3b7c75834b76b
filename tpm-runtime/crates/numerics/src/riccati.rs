//! The discrete algebraic Riccati equation, by doubling.
//!
//! With G = B R^-1 B' the iteration
//!
//! ```text
//! W = 1 + G H,   A <- A W^-1 A,   G <- G + A W^-1 G A',   H <- H + A' H W^-1 A,   from H = Q
//! ```
//!
//! gives in H after k rounds what the plain iteration `P <- Q + A' P A - ...` gives after 2^k; it converges quadratically to the
//! stabilising solution when A, B can be stabilised and Q sees every mode that is not stable (E. K.-W. Chu, H.-Y. Fan,
//! W.-W. Lin, C.-S. Wang, 2004). Invariant: what is returned solves the equation to rounding and stabilises; both are tested.

use crate::DMatrix;
use crate::eigenvalues::eigenvalues;
use crate::{Iteration, tolerance};
use num_complex::Complex;

/// Rounds of doubling, until the solution changes by no more than a share of it: 2^60 samples are longer than any machine runs.
const DOUBLING: Iteration = Iteration { most: 60, settled: 1e-14 };
/// Largest residual of the equation, as a share of its terms, that still counts as solved.
pub(super) const MOST_RESIDUAL: f64 = 1e-8;

/// Why there is no regulator.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RiccatiError {
    /// Sizes do not fit.
    #[error(
        "the matrices do not fit: A must be square, B have as many rows, the weights as many entries as states and inputs"
    )]
    Shape,
    /// A number is not finite.
    #[error("a matrix of the linear model holds a number that is not finite")]
    NotFinite,
    /// The sample time is no positive number.
    #[error("a sample time of {sample_time} s; it must be a positive number")]
    SampleTime {
        /// The sample time, s.
        sample_time: f64,
    },
    /// R is not positive.
    #[error("the weight of the inputs must be symmetric and positive, every input must cost something")]
    InputWeight,
    /// Q is negative somewhere.
    #[error("the weight of the states must be symmetric and not negative")]
    StateWeight,
    /// No feedback stabilises, or an unstable mode is not observable through Q.
    #[error(
        "no regulator was found: the inputs do not reach a mode that is not stable, or the weights of the states do not see it"
    )]
    NotStabilisable,
}

/// The stabilising solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Riccati {
    /// P, symmetric.
    pub solution: DMatrix<f64>,
    /// K = (R + B' P B)^-1 B' P A; in continuous time R^-1 B' P.
    pub gain: DMatrix<f64>,
    /// Eigenvalues of A - B K.
    pub poles: Vec<Complex<f64>>,
    /// Largest entry of the equation's residual, as a share of the largest entry of its terms.
    pub residual: f64,
}

/// Solves `P = Q + A' P A - A' P B (R + B' P B)^-1 B' P A`.
///
/// # Errors
/// [`RiccatiError`], never [`RiccatiError::SampleTime`].
pub fn riccati(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
) -> Result<Riccati, RiccatiError> {
    let n = a.nrows();
    let (mut transition, mut reach, mut solution) = (a.clone(), b * weighted(a, b, q, r)?, q.clone());
    // 1. The doubling iteration, until the solution no longer changes.
    let mut settled = false;
    for _ in 0..DOUBLING.most {
        let inverse = (DMatrix::identity(n, n) + &reach * &solution).lu();
        let (Some(of_a), Some(of_g)) = (inverse.solve(&transition), inverse.solve(&reach)) else {
            return Err(RiccatiError::NotStabilisable);
        };
        let change = transition.transpose() * &solution * &of_a;
        reach += &transition * of_g * transition.transpose();
        transition = &transition * of_a;
        let size = solution.amax();
        let step = change.amax();
        solution += change;
        solution = 0.5 * (&solution + solution.transpose());
        reach = 0.5 * (&reach + reach.transpose());
        if !(step.is_finite() && solution.iter().chain(reach.iter()).all(|x| x.is_finite())) {
            return Err(RiccatiError::NotStabilisable);
        }
        if step <= DOUBLING.settled * size {
            settled = true;
            break;
        }
    }
    if !settled {
        return Err(RiccatiError::NotStabilisable);
    }
    // 2. The gain and the poles of the closed loop.
    let seen = b.transpose() * &solution;
    let gain = (r + &seen * b).lu().solve(&(&seen * a)).ok_or(RiccatiError::NotStabilisable)?;
    let closed = a - b * &gain;
    let poles = eigenvalues(&closed);
    // 3. The residual of the equation; what is returned solves it and stabilises.
    let terms = [q.clone(), a.transpose() * &solution * a, a.transpose() * &solution * b * &gain, solution.clone()];
    let largest = terms.iter().map(DMatrix::amax).fold(0.0, f64::max);
    let left = (&terms[0] + &terms[1] - &terms[2] - &terms[3]).amax();
    let residual = if largest > 0.0 { left / largest } else { 0.0 };
    if residual > MOST_RESIDUAL || !poles.iter().all(|z| z.norm() < 1.0) {
        return Err(RiccatiError::NotStabilisable);
    }
    Ok(Riccati { solution, gain, poles, residual })
}

/// `R^-1 B'`, when the matrices of a regulator fit together and the weights are allowed.
///
/// # Errors
/// [`RiccatiError::Shape`], [`RiccatiError::NotFinite`], [`RiccatiError::InputWeight`] unless R is symmetric and positive,
/// [`RiccatiError::StateWeight`] unless Q is symmetric and not negative.
pub(super) fn weighted(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
) -> Result<DMatrix<f64>, RiccatiError> {
    let (n, m) = (a.nrows(), b.ncols());
    if a.shape() != (n, n) || b.nrows() != n || q.shape() != (n, n) || r.shape() != (m, m) {
        return Err(RiccatiError::Shape);
    }
    if [a, b, q, r].iter().any(|matrix| matrix.iter().any(|x| !x.is_finite())) {
        return Err(RiccatiError::NotFinite);
    }
    let symmetric = |x: &DMatrix<f64>| (x - x.transpose()).amax() <= tolerance::WEIGHT * x.amax();
    let factor = r.clone().cholesky().filter(|_| symmetric(r)).ok_or(RiccatiError::InputWeight)?;
    let least = q.clone().symmetric_eigenvalues().min();
    if !symmetric(q) || least < -tolerance::WEIGHT * q.amax() {
        return Err(RiccatiError::StateWeight);
    }
    Ok(factor.solve(&b.transpose()))
}

#[cfg(test)]
mod tests {
    use super::{RiccatiError, riccati};
    use crate::DMatrix;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// The plain iteration, the definition of the limit.
    fn iterated(a: &DMatrix<f64>, b: &DMatrix<f64>, q: &DMatrix<f64>, r: &DMatrix<f64>) -> DMatrix<f64> {
        let mut p = q.clone();
        for _ in 0..200_000 {
            let seen = b.transpose() * &p * a;
            let inverse = (r + b.transpose() * &p * b).try_inverse().expect("positive");
            let next = q + a.transpose() * &p * a - seen.transpose() * inverse * seen;
            // Rounding that is not symmetric grows without bound.
            let next = 0.5 * (&next + next.transpose());
            let change = (&next - &p).amax();
            p = next;
            if change <= 1e-15 * p.amax() {
                break;
            }
        }
        p
    }

    #[test]
    fn a_scalar_equation_has_its_closed_solution() {
        // p = q + a^2 p r/(r + b^2 p): b^2 p^2 + (r - a^2 r - q b^2) p - q r = 0.
        for (a, b, q, r) in [(1.2, 0.5, 2.0, 3.0), (0.3, 1.0, 1.0, 0.1), (-2.0, 1.0, 0.0, 1.0)] {
            let one = |x| DMatrix::from_element(1, 1, x);
            let half: f64 = 0.5 * (r - a * a * r - q * b * b);
            let expected = (-half + (half * half + b * b * q * r).sqrt()) / (b * b);
            match riccati(&one(a), &one(b), &one(q), &one(r)) {
                Ok(found) => assert!((found.solution[(0, 0)] / expected - 1.0).abs() < 1e-13, "{a}"),
                // Without a weight on the unstable state doubling finds the solution that does not stabilise it.
                Err(fault) => assert_eq!((q, fault), (0.0, RiccatiError::NotStabilisable)),
            }
        }
    }

    #[test]
    fn doubling_and_plain_iteration_agree() {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        for (n, m) in [(1, 1), (2, 1), (3, 2), (5, 2), (6, 3)] {
            for _ in 0..5 {
                let mut matrix = |rows, columns| DMatrix::from_fn(rows, columns, |_, _| random.random_range(-1.0..1.0));
                let (a, b, c, d) = (matrix(n, n) * 0.9, matrix(n, m), matrix(n, n), matrix(m, m));
                let (q, r) = (&c * c.transpose(), &d * d.transpose() + DMatrix::identity(m, m) * 0.1);
                let found = riccati(&a, &b, &q, &r).expect("generic systems can be stabilised");
                let plain = iterated(&a, &b, &q, &r);
                let difference = (&found.solution - &plain).amax() / plain.amax();
                assert!(difference < 1e-10, "{n} {m}: {difference:e}");
                assert!(found.residual < 1e-12, "{:e}", found.residual);
                assert!(found.solution.symmetric_eigenvalues().min() >= -1e-12 * plain.amax());
                // P is the cost of the closed loop: P = Q + K'RK + (A-BK)' P (A-BK).
                let closed = &a - &b * &found.gain;
                let cost = &q + found.gain.transpose() * &r * &found.gain + closed.transpose() * &plain * &closed;
                assert!((cost - &plain).amax() < 1e-10 * plain.amax());
            }
        }
    }
}
