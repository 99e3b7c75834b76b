//! What a model declares of its infinite series, its number of harmonics and its Taylor polynomials, holds for emitted code.

use super::estimator;
use tpm_models as models;
use tpm_runtime::Model;

/// Dry friction has infinitely many harmonics; the matrix has those that the pattern declares: Fc sign(x') is 4/(pi n).
#[test]
fn a_declared_number_of_harmonics_holds_for_the_code() {
    use models::emps::{HIGHEST_HARMONIC, Pattern};
    let estimator = estimator("emps.tpm");
    let table = estimator.plan.patterns[0].table.as_ref().expect("a table");
    assert_eq!(table.table.tails[0].harmonics, HIGHEST_HARMONIC);
    let dims = Model::<f64>::dims(&models::Emps);
    let friction = (0..dims.parameters).position(|i| Model::<f64>::parameter(&models::Emps, i).name == "Fc");
    for sign in [1.0, -1.0] {
        let matrix = Pattern { lambda: sign * 0.2, w: 1.5 }.estimator_matrix();
        let last = matrix.last().expect("rows")[friction.expect("a column")];
        let expected = -sign * 4.0 / (HIGHEST_HARMONIC as f64 * std::f64::consts::PI);
        assert!((last - expected).abs() < 1e-15, "{last} {expected}");
    }
}

/// Sine and cosine become Taylor polynomials in the matrix only: at small amplitudes both agree to the remainder, here
/// theta^9/9! < 6e-13 of forces of a few newtons.
#[test]
fn declared_taylor_polynomials_hold_for_the_matrix() {
    use models::cart_pendulum::{HARMONICS, HIGHEST_HARMONIC, Parameters, Pattern, harmonics, inverse_dynamics};
    let pattern = Pattern { lambda1: 0.1, lambda2: 0.2, w: 3.0 };
    let theta = [11.0, 0.4, 0.16];
    let count = 2 * HIGHEST_HARMONIC + 3;
    let samples: Vec<_> = (0..count)
        .map(|i| {
            let motion = pattern.reference_at(2.0 * std::f64::consts::PI * i as f64 / count as f64);
            inverse_dynamics(&motion, &Parameters::from_array(theta))
        })
        .collect();
    let sampled = harmonics(&samples).expect("enough samples").into_array();
    let matrix = pattern.estimator_matrix();
    for row in 0..HARMONICS {
        let expected: f64 = matrix[row].iter().zip(theta).map(|(entry, theta)| entry * theta).sum();
        assert!((sampled[row] - expected).abs() < 1e-11, "row {row}: {} {expected}", sampled[row]);
    }
}
