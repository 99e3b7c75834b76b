//! Solutions of emitted estimators: their covariance, and the exact pseudo-inverse.

use super::{dyadic, estimator, exact, runner};
use proptest::prelude::*;
use tpm_models as models;
use tpm_runtime::interpret::InterpretedInverse;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::leaf::Leaf;

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

/// The interpreted pseudo-inverse does what the compiled one does, operation by operation, and rounds the exact value.
#[test]
fn interpreted_and_compiled_pseudo_inverses_agree() {
    use models::{emps, mass_spring_drag as slider};
    let estimators = ["emps.tpm", "mass_spring_drag.tpm"].map(estimator);
    let result = runner(128).run(&(dyadic(2), dyadic(6)), |(pattern, harmonics)| {
        let excited = |value: f64| if value.abs() < 0.25 { 0.5 } else { value };
        let pattern: [f64; 2] = [excited(pattern[0]), excited(pattern[1])];
        for estimator in &estimators {
            let (plan, constants) = (&estimator.plan.patterns[0], &estimator.plan.evaluation.constants);
            let inverse = InterpretedInverse::new(plan, constants).expect("every column has one scale");
            let rows = plan.table.as_ref().expect("a finite table").rows.len();
            let given: Vec<f64> = harmonics.iter().copied().cycle().take(rows).collect();
            let mut workspace = vec![0.0; inverse.workspace_len()];
            let mut found = vec![0.0; estimator.form.columns.len()];
            inverse.parameters(&pattern, &[], &given, &mut workspace, &mut found).expect("lengths fit");
            let compiled = if estimator.model.name == "MassSpringDrag" {
                let harmonics = slider::Harmonics::from_array(given.as_slice().try_into().expect("its rows"));
                slider::Pattern::from_array(pattern).parameters_direct(&harmonics).into_array().to_vec()
            } else {
                let harmonics = emps::Harmonics::from_array(given.as_slice().try_into().expect("its rows"));
                emps::Pattern::from_array(pattern).parameters_direct(&harmonics).into_array().to_vec()
            };
            let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<u64>>();
            prop_assert_eq!(bits(&found), bits(&compiled));
            let plan = &plan.pseudo_inverse.as_ref().expect("it was interpreted").plan;
            let amplitude = estimator.plan.patterns[0].amplitudes[0];
            let exactly = plan.evaluate_exact(|leaf| match *leaf {
                Leaf::Harmonic(row) => Some(exact(given[row])),
                Leaf::Symbol(symbol) => Some(exact(pattern[usize::from(symbol != amplitude)])),
                _ => None,
            });
            // Coulomb friction brings in pi, which has no exact value.
            let Some(exactly) = exactly else {
                prop_assert!(estimator.model.name != "MassSpringDrag", "its table is rational");
                continue;
            };
            for (found, exactly) in found.iter().zip(&exactly) {
                let expected = rational::to_f64(exactly);
                prop_assert!((found - expected).abs() <= 1e-12 * (1.0 + expected.abs()), "{} {}", found, expected);
            }
            prop_assert!(inverse.parameters(&pattern, &[], &given[1..], &mut workspace, &mut [0.0; 3]).is_err());
        }
        Ok(())
    });
    result.expect("the same parameters");
}
