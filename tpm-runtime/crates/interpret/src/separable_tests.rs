//! Tests of models with nonlinear parameters against difference quotients of their rows.

use crate::{InterpretedDerivatives, Separable};
use tpm_codegen::source::Source;
use tpm_controller::derivatives::RowDerivatives as _;
use tpm_controller::model::{EvalError, Model};

const MACHINE: &str = "model Machine {
    coordinate q;
    input u;
    parameter J, d, fc, df, c;
    nonlinear parameter vs from 0.1 to 2, q0 from -1 to 1;
    constant g;

    J*ddot(q) + d*tanh(dot(q)/vs) + (fc + df*exp(-(dot(q)/vs)^2))*sign(dot(q)) + c*g*sin(q - q0) + vs^2*q = u;
}";

const POINT: [f64; 7] = [0.7, 1.3, 0.4, 0.25, 5.0, 0.6, 0.2];
const MOTIONS: [[f64; 3]; 3] = [[0.3, -0.8, 1.5], [2.0, 0.1, -0.4], [-1.0, 1.1, 0.2]];

fn machine() -> (Separable, InterpretedDerivatives) {
    let Ok(parsed) = tpm_codegen::parse_model(&Source::new("test", MACHINE)) else { panic!("no model") };
    let prepared = tpm_symbolic::regressor::prepare::prepare(parsed.model).expect("separable");
    let model = Separable::new(&prepared.model, &prepared.form).expect("has nonlinear parameters");
    (model, InterpretedDerivatives::separable(&prepared.model, &prepared.form))
}

fn rows(model: &Separable, motion: &[f64], parameters: &[f64]) -> f64 {
    let mut workspace = vec![0.0; model.inverse_workspace_len()];
    let mut out = [0.0];
    model.inverse_dynamics(motion, parameters, &[9.0], &mut workspace, &mut out).expect("fits");
    out[0]
}

/// The derivative of a function at zero by differences of fourth order.
fn slope(of: &dyn Fn(f64) -> f64) -> f64 {
    let h = 1e-3;
    let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|steps| of(steps * h));
    (a - d + 8.0 * (c - b)) / (12.0 * h)
}

#[test]
fn sensitivities_are_those_of_difference_quotients() {
    let (model, derivatives) = machine();
    assert_eq!((model.linear(), model.dims().parameters, model.dims().constants), (5, 7, 1));
    assert_eq!([5, 6].map(|j| model.parameter(j).name), ["vs", "q0"]);
    assert_eq!((model.parameter_interval(4), model.parameter_interval(6)), (None, Some([-1.0, 1.0])));
    let mut workspace = vec![f64::NAN; model.workspace_len().max(derivatives.workspace_len())];
    for motion in MOTIONS {
        let mut found = [f64::NAN; 7];
        model.sensitivity(&motion, &POINT, &[9.0], &mut workspace, &mut found).expect("fits");
        for (j, found) in found.into_iter().enumerate() {
            let expected = slope(&|step| {
                let mut moved = POINT;
                moved[j] += step;
                rows(&model, &motion, &moved)
            });
            assert!((found - expected).abs() < 1e-8 * (1.0 + expected.abs()), "{j}: {found} {expected}");
        }
        let mut found = [f64::NAN; 3];
        derivatives.rows(&motion, &POINT, &[9.0], &[0.5], &mut workspace, &mut found).expect("fits");
        for (slot, found) in found.into_iter().enumerate() {
            let expected = slope(&|step| {
                let mut moved = motion;
                moved[slot] += step;
                rows(&model, &moved, &POINT)
            });
            assert!((found - expected).abs() < 1e-8 * (1.0 + expected.abs()), "slot {slot}: {found} {expected}");
        }
    }
}

#[test]
fn rows_about_a_point_are_exact_there_and_simulated_motions_obey_them() {
    let (model, _) = machine();
    let about = model.at(POINT.to_vec()).expect("a point");
    let mut workspace = vec![0.0; about.workspace_len().max(about.forward_workspace_len())];
    for mut motion in MOTIONS {
        let (mut phi, mut known) = (vec![0.0; 7], [0.0]);
        about.regressor(&motion, &[9.0], &mut workspace, &mut phi).expect("fits");
        about.known(&motion, &[9.0], &mut workspace, &mut known).expect("fits");
        let force: f64 = phi.iter().zip(&POINT).map(|(entry, value)| entry * value).sum::<f64>() + known[0];
        let expected = rows(&about, &motion, &POINT);
        assert!((force - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{force} {expected}");
        about.forward_dynamics(&mut motion, &POINT, &[9.0], &[0.5], &mut workspace).expect("fits");
        assert!((rows(&about, &motion, &POINT) - 0.5).abs() < 1e-12);
    }
    let short: Result<Separable, EvalError> = model.at(Vec::from([0.0; 6]));
    assert!(short.is_err());
}
