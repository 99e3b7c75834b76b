//! Solutions of emitted estimators: their covariance, and the exact pseudo-inverse.

use super::{dyadic, estimator, runner};
use proptest::prelude::*;
use tpm_models as models;

/// Harmonics with deviations: parameters, covariance and residual beside the normal equations by hand; and inputs with the
/// regressor in one call.
#[test]
fn estimates_come_with_their_covariance() {
    use models::mass_spring_drag::{Harmonics, Motion, Parameters, Pattern};
    use models::mass_spring_drag::{feed_forward, feed_forward_with_regressor, regressor};
    let pattern = Pattern { lambda: 0.5, w: 2.0 };
    let (effort, deviations) = ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.5, 1.0, 2.0, 1.0, 0.25, 4.0]);
    let found = pattern.estimate(&Harmonics::from_array(effort), Some(&Harmonics::from_array(deviations)));
    let found = found.expect("observable");
    let matrix = pattern.estimator_matrix();
    let (mut information, mut left) = ([[0.0_f64; 3]; 3], [0.0_f64; 3]);
    for ((row, effort), deviation) in matrix.iter().zip(effort).zip(deviations) {
        for i in 0..3 {
            left[i] += row[i] * effort / (deviation * deviation);
            for j in 0..3 {
                information[i][j] += row[i] * row[j] / (deviation * deviation);
            }
        }
    }
    let theta = found.parameters.into_array();
    for i in 0..3 {
        let (mut right, size) = (0.0, information[i][i] * theta[i].abs());
        for j in 0..3 {
            right += information[i][j] * theta[j];
            let product: f64 = (0..3).map(|k| information[i][k] * found.covariance[k][j]).sum();
            let identity = if i == j { 1.0 } else { 0.0 };
            assert!((product - identity).abs() < 1e-12 * information[i][i] / information[j][j] + 1e-12, "{product}");
        }
        assert!((right - left[i]).abs() <= 1e-12 * (1.0 + size), "{right} {}", left[i]);
    }
    let motion = Motion::from_array(&[0.25, -0.5, 3.0]);
    let parameters = Parameters::from_array(theta);
    let (inputs, phi) = feed_forward_with_regressor(&motion, &parameters);
    assert_eq!((inputs, phi), (feed_forward(&motion, &parameters), regressor(&motion)));
}

/// Where every column of the matrix has one scale, the exact pseudo-inverse gives the parameters back from their harmonics, and
/// from any harmonics those of least squares.
#[test]
fn the_exact_pseudo_inverse_is_folded_into_constants() {
    use models::{emps, mass_spring_drag as slider};
    let result = runner(128).run(&(dyadic(2), dyadic(4)), |(pattern, theta)| {
        let excited = |value: f64| if value.abs() < 0.25 { 0.5 } else { value };
        let pattern: [f64; 2] = [excited(pattern[0]), excited(pattern[1])];
        let own = emps::Pattern::from_array(pattern);
        let harmonics =
            own.estimator_matrix().map(|row| row.iter().zip(&theta).map(|(entry, theta)| entry * theta).sum());
        let found = own.parameters_direct(&emps::Harmonics::from_array(harmonics)).into_array();
        for (found, theta) in found.iter().zip(&theta) {
            prop_assert!((found - theta).abs() <= 1e-10, "{} is not {}", found, theta);
        }
        let own = slider::Pattern::from_array(pattern);
        let harmonics = slider::Harmonics::from_array([theta[0], theta[1], theta[2], theta[3], 1.0, -0.5]);
        let (direct, solved) = (own.parameters_direct(&harmonics), own.parameters(&harmonics).expect("observable"));
        for (a, b) in direct.into_array().iter().zip(solved.into_array()) {
            prop_assert!((a - b).abs() <= 1e-12 * (1.0 + b.abs()), "{} {}", a, b);
        }
        Ok(())
    });
    result.expect("the same parameters");
    // Two joints on one pattern leave directions undetermined: there is no pseudo-inverse for them.
    let text = tpm_codegen::generate::generate(
        &estimator("closed_loop_arm.tpm"),
        &tpm_codegen::generate::Options::new(tpm_codegen::generate::Language::Rust, "test"),
    );
    assert!(!text.expect("whole")[0].text.contains("parameters_direct"));
}
