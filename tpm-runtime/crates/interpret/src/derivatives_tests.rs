//! Derivatives of rows as numbers, against difference quotients of the rows.

use tpm_controller::derivatives::RowDerivatives as _;
use tpm_controller::model::{Buffer, EvalError, Model};
use tpm_test_support::models::differentiable;

const ARM: &str = "model Arm {
    coordinate a, b;
    input u, v;
    parameter J, m, c, d, g;
    constant l, r;

    J*ddot(a) + m*l*cos(a - b)*ddot(b) + m*l*sin(a - b)*dot(b)^2 + g*sin(a) + d*dot(a)*abs(dot(a)) = u;
    m*l*cos(a - b)*ddot(a) + m*(1 + r*sin(b)^2)*ddot(b) + c*sign(dot(b) - dot(a)) + m*r*sin(b)*cos(b)*dot(b)^2
        = r*v;
}";

/// The residual `Phi theta + known - B u`.
fn rows(model: &dyn Model<f64>, motion: &[f64], theta: &[f64], constants: &[f64], inputs: &[f64]) -> Vec<f64> {
    let dims = model.dims();
    let mut workspace = vec![0.0; model.inverse_workspace_len()];
    let (mut rows, mut map) = (vec![0.0; dims.rows], vec![0.0; dims.input_map_len()]);
    model.inverse_dynamics(motion, theta, constants, &mut workspace, &mut rows).expect("fits");
    model.input_map(motion, constants, &mut workspace, &mut map).expect("fits");
    for (row, factors) in rows.iter_mut().zip(map.chunks_exact(dims.inputs)) {
        *row -= factors.iter().zip(inputs).map(|(factor, input)| factor * input).sum::<f64>();
    }
    rows
}

const THETA: [f64; 5] = [0.7, 1.3, 0.4, 0.25, 5.0];
const CONSTANTS: [f64; 2] = [0.6, 0.35];
const INPUTS: [f64; 2] = [2.5, -1.5];

#[test]
fn derivatives_are_those_of_difference_quotients() {
    let (model, derivatives) = differentiable(ARM);
    let dims = model.dims();
    let (width, h) = (dims.motion_len(), 1e-3);
    let mut workspace = vec![f64::NAN; derivatives.workspace_len()];
    for motion in [[0.3, -0.8, 1.5, -0.7, 4.0, -9.0], [2.0, 0.1, -0.4, 0.9, 0.0, 3.0], [-1.0, 1.0, 0.2, 0.1, -2.0, 7.0]]
    {
        let mut found = vec![f64::NAN; dims.rows * width];
        derivatives.rows(&motion, &THETA, &CONSTANTS, &INPUTS, &mut workspace, &mut found).expect("fits");
        for slot in 0..width {
            let at = |steps: f64| {
                let mut moved = motion;
                moved[slot] += steps * h;
                rows(&model, &moved, &THETA, &CONSTANTS, &INPUTS)
            };
            let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(at);
            for row in 0..dims.rows {
                let expected = (a[row] - d[row] + 8.0 * (c[row] - b[row])) / (12.0 * h);
                let found = found[row * width + slot];
                assert!((found - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{row} {slot}: {found} {expected}");
            }
        }
    }
}

#[test]
fn the_jump_of_a_switch_is_that_of_the_rows() {
    let (model, derivatives) = differentiable(ARM);
    assert_eq!(derivatives.switches(), 1);
    let mut workspace = vec![0.0; derivatives.workspace_len()];
    let mut found = [0.0; 3];
    let motion = [0.3, -0.8, 1.5, 1.5 + 1e-9, 4.0, -9.0];
    derivatives.switching(&motion, &THETA, &CONSTANTS, &INPUTS, &mut workspace, &mut found).expect("fits");
    let other = [0.3, -0.8, 1.5, 1.5 - 1e-9, 4.0, -9.0];
    let [on, off] = [motion, other].map(|motion| rows(&model, &motion, &THETA, &CONSTANTS, &INPUTS));
    // The argument of the sign may be b' - a' or a' - b', as long as the jump has the matching sign.
    let side = (motion[3] - motion[2]).signum() * found[0].signum();
    assert!((found[0].abs() - 1e-9).abs() < 1e-15, "{found:?}");
    for row in 0..2 {
        let jump = 0.5 * (on[row] - off[row]);
        assert!((side * found[1 + row] - jump).abs() < 1e-7, "{found:?} {on:?} {off:?}");
    }
}

#[test]
fn slices_of_other_lengths_are_refused() {
    let (_, derivatives) = differentiable(ARM);
    let mut workspace = vec![0.0; derivatives.workspace_len()];
    let mut out = [0.0; 12];
    let short = derivatives.rows(&[0.0; 6], &THETA[..4], &CONSTANTS, &INPUTS, &mut workspace, &mut out);
    assert_eq!(short, Err(EvalError::Length { buffer: Buffer::Parameters, given: 4, needed: 5 }));
    let short = derivatives.rows(&[0.0; 6], &THETA, &CONSTANTS, &INPUTS, &mut workspace, &mut out[..11]);
    assert_eq!(short, Err(EvalError::Length { buffer: Buffer::Output, given: 11, needed: 12 }));
    let short = derivatives.switching(&[0.0; 5], &THETA, &CONSTANTS, &INPUTS, &mut workspace, &mut out[..3]);
    assert_eq!(short, Err(EvalError::Length { buffer: Buffer::Motion, given: 5, needed: 6 }));
}
