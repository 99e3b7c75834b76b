//! Uncontrollable modes of a linear model: those that its inputs do not reach.
//!
//! With `x' = A x + B u`, x = (q, q'), an eigenvalue s of A is a mode that the inputs do not reach when there is a row w with
//! `w A = s w` and `w B = 0`: the combination `z = w x` then moves as `z' = s z`, whatever the inputs do (the test of Popov, Belevitch
//! and Hautus). Invariant: rates are scaled by the fastest mode and inputs by their effect, so that the result does not
//! depend on the choice of units.

use num_complex::Complex;
use tpm_numerics::eigenvalues::eigenvalues;
use tpm_numerics::singular::Singular;
use tpm_numerics::{DMatrix, Matrix, tolerance};

/// A mode that no input reaches.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// The eigenvalue s, rad/s; its imaginary part is not negative.
    pub pole: Complex<f64>,
    /// The combination of the coordinates on which the inputs have no effect: one factor per coordinate, the largest 1.
    pub combination: Vec<f64>,
    /// Whether the mode dies down by itself.
    pub decays: bool,
}

/// The modes of `x' = A x + B u` that no input reaches, each conjugate pair once. A is states times states and B states times
/// inputs; the states are coordinates before their rates.
#[must_use]
pub fn unreached_modes(a: &Matrix, b: &Matrix) -> Vec<Mode> {
    let (a, b) = (a.dense(), b.dense());
    let (states, inputs) = (a.nrows(), b.ncols());
    let n = states / 2;
    let poles = eigenvalues(a);
    let fastest = poles.iter().map(|s| s.norm()).fold(0.0, f64::max);
    let unit = if fastest > 0.0 { fastest } else { 1.0 };
    let scale = |state: usize| if state < n { 1.0 } else { 1.0 / unit };
    let scaled = DMatrix::from_fn(states, states, |r, c| scale(r) * a[(r, c)] / scale(c));
    let mut drive = DMatrix::from_fn(states, inputs, |r, c| scale(r) * b[(r, c)]);
    for mut column in drive.column_iter_mut().filter(|column| column.norm() > 0.0) {
        let size = column.norm();
        column *= unit / size;
    }
    let mut found: Vec<Mode> = Vec::new();
    for pole in poles.into_iter().filter(|s| s.im >= 0.0) {
        // A complex number z = x + jy times a vector, in real numbers: [x, -y; y, x] times its real and imaginary parts. The matrix is
        // transposed, so that its null space is that of the rows.
        let doubled = DMatrix::from_fn(2 * (states + inputs), 2 * states, |r, c| {
            let ((row, upper), (column, left)) =
                ((c % states, c < states), (r % (states + inputs), r < states + inputs));
            let entry = if column < states { scaled[(row, column)] } else { drive[(row, column - states)] };
            let on_diagonal = row == column;
            match (upper == left, on_diagonal) {
                (true, true) => entry - pole.re,
                (true, false) => entry,
                (false, true) => {
                    if upper {
                        pole.im
                    } else {
                        -pole.im
                    }
                }
                (false, false) => 0.0,
            }
        });
        if has_full_rank(&doubled) {
            continue;
        }
        let null = Singular::new(&doubled, tolerance::PENCIL_RANK).null();
        if null.ncols() == 0 || found.iter().any(|mode| (mode.pole - pole).norm() <= tolerance::EIGENVALUE * unit) {
            continue;
        }
        // The combination is read from the factors of the rates: if they were all zero, those of the coordinates would
        // be zero too. The phase of the row is arbitrary, and is chosen so that the largest factor is real.
        let rates: Vec<Complex<f64>> =
            (n..states).map(|s| Complex::new(null[(s, 0)], null[(states + s, 0)]) * scale(s)).collect();
        let Some(largest) = rates.iter().copied().max_by(|x, y| x.norm().total_cmp(&y.norm())) else { continue };
        let combination = rates.iter().map(|rate| (rate / largest).re).collect();
        found.push(Mode { pole, combination, decays: pole.re < -tolerance::EIGENVALUE * unit });
    }
    found
}

/// Whether the columns of a matrix are independent, as bounds of its singular values show: with `Q R` the largest is at most the
/// Frobenius norm of R, and the least at least one over that of its inverse. Far cheaper than the values; false where they must tell.
fn has_full_rank(matrix: &DMatrix<f64>) -> bool {
    let factor = matrix.clone().qr().r();
    let identity = DMatrix::identity(factor.nrows(), factor.ncols());
    let inverse = factor.solve_upper_triangular(&identity);
    inverse.is_some_and(|inverse| factor.norm() * inverse.norm() * tolerance::PENCIL_RANK < 1.0)
}

#[cfg(test)]
mod tests {
    use super::unreached_modes;
    use tpm_numerics::Matrix;

    #[test]
    fn two_equal_pendulums_on_one_drive_have_a_mode_that_is_not_reached() {
        // Both hang from the same driven support, so that no input reaches their difference. With damping it decays.
        let pair = |damping: f64, other: f64| {
            let a = Matrix::from_rows(&[
                vec![0.0, 0.0, 1.0, 0.0],
                vec![0.0, 0.0, 0.0, 1.0],
                vec![-9.0, 0.0, -damping, 0.0],
                vec![0.0, -other, 0.0, -damping],
            ]);
            let b = Matrix::from_rows(&[vec![0.0], vec![0.0], vec![2.0], vec![2.0]]);
            unreached_modes(&a.expect("rows of one length"), &b.expect("rows of one length"))
        };
        for (damping, decays) in [(0.0, false), (0.2, true)] {
            let found = pair(damping, 9.0);
            assert_eq!(found.len(), 1, "{found:?}");
            assert!((found[0].pole.norm() - 3.0).abs() < 1e-6 && found[0].decays == decays);
            assert!((found[0].combination[0] + found[0].combination[1]).abs() < 1e-6, "{found:?}");
        }
        assert!(pair(0.0, 9.1).is_empty());
    }

    #[test]
    fn a_coordinate_without_an_input_is_named() {
        let a = Matrix::from_rows(&[
            vec![0.0, 0.0, 1.0, 0.0],
            vec![0.0, 0.0, 0.0, 1.0],
            vec![0.0, 0.0, -1.0, 0.0],
            vec![0.0, 0.0, 0.0, 0.0],
        ]);
        let b = Matrix::from_rows(&[vec![0.0], vec![0.0], vec![1e-6], vec![0.0]]);
        let found = unreached_modes(&a.expect("rows"), &b.expect("rows"));
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].pole.norm() < 1e-7 && !found[0].decays);
        assert!((found[0].combination[1] - 1.0).abs() < 1e-9 && found[0].combination[0].abs() < 1e-9, "{found:?}");
    }
}
