//! A generated estimator of an arm's base parameters, sample by sample, in Rust: no allocation, either precision. Its numbers are
//! compared with those of the interpreter.

use crate::generated::parts::three_joints::support::{Real, SingularMass};
use crate::generated::parts::three_joints::{
    BASE_PARAMETERS, BaseEstimator, Forces, Inputs, Motion, Parameters, base_regressor, forward_dynamics, gravity,
    inverse_dynamics, mass_matrix, regressor,
};
use crate::support::root;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::generate::{Language, Options, generate};
use tpm_codegen::{Source, parse_model};
use tpm_runtime::model::Model;
use tpm_symbolic::regressor::prepare::prepare;

const FILE: &str = "tests/fixtures/arms/three_joints.tpm";

/// Mass, its products with the centre and moments of inertia of three links, then friction, in the order of the columns.
fn parameters() -> [f64; 26] {
    std::array::from_fn(|i| 0.4 + 0.3 * (1.7 * i as f64).sin())
}

/// A motion of the joints on a finite Fourier series.
fn motion(i: usize) -> [f64; 9] {
    let t = 0.013 * i as f64;
    let mut values = [0.0; 9];
    for joint in 0..3 {
        for (k, amplitude) in [(1.0, 0.6), (2.0, 0.35), (3.0, -0.25)] {
            let w = k * (1.0 + 0.15 * joint as f64);
            let (sine, cosine) = (w * t + joint as f64 * k).sin_cos();
            values[joint] += amplitude * sine;
            values[3 + joint] += amplitude * w * cosine;
            values[6 + joint] -= amplitude * w * w * sine;
        }
    }
    values
}

fn source() -> EstimatorSource {
    let source = Source::from_bytes("three_joints.tpm", std::fs::read(root().join(FILE)).expect("committed"));
    let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message))
}

#[test]
fn no_comment_is_giant() {
    let text = include_str!(concat!(env!("OUT_DIR"), "/generated/parts/three_joints.rs"));
    let comments = text.lines().filter(|line| line.trim_start().starts_with("//"));
    assert!(comments.map(str::len).all(|length| length <= 200));
}

#[test]
fn nothing_is_generated_that_was_not_asked_for() {
    let files = generate(&source(), &Options::new(Language::Rust, "tpm generate")).expect("nothing stands in the way");
    for word in ["gravity", "mass_matrix", "forward_dynamics", "BaseParameters", "SquareRoot", "SingularMass"] {
        assert!(!files[0].text.contains(&format!("fn {word}")) && !files[0].text.contains(&format!("struct {word}")));
    }
}

#[test]
fn functions_agree_with_the_interpreter() {
    let source = source();
    let prepared = prepare(source.model.clone()).expect("linear");
    let model = tpm_runtime::interpret::Interpreted::new(&prepared.model, &prepared.form);
    let theta = Parameters::from_array(parameters());
    let close =
        |found: f64, wanted: f64| assert!((found - wanted).abs() <= 1e-11 * (1.0 + wanted.abs()), "{found} {wanted}");
    for i in [3, 50, 212] {
        let values = motion(i);
        let at = Motion::from_array(&values);
        let dims = Model::<f64>::dims(&model);
        let mut workspace = vec![0.0; Model::<f64>::workspace_len(&model)];
        let mut phi = vec![0.0; dims.rows * dims.parameters];
        model.regressor(&values, &[], &mut workspace, &mut phi).expect("lengths fit");
        let generated = regressor(&at);
        phi.iter().zip(generated.as_flattened()).for_each(|(wanted, found)| close(*found, *wanted));
        let forces = inverse_dynamics(&at, &theta).into_array();
        for (row, force) in phi.chunks(dims.parameters).zip(forces) {
            close(force, row.iter().zip(parameters()).map(|(a, b)| a * b).sum());
        }
        let base = theta.base();
        for (row, force) in base_regressor(&at).iter().zip(forces) {
            close(row.iter().zip(base.into_array()).map(|(a, b)| a * b).sum(), force);
        }
        let again = inverse_dynamics(&at, &base.representative()).into_array();
        again.into_iter().zip(forces).for_each(|(found, wanted)| close(found, wanted));
        // M a is what acceleration adds to the forces.
        let still = Motion::from_array(&std::array::from_fn(|k| if k < 6 { values[k] } else { 0.0 }));
        let bias = inverse_dynamics(&still, &theta).into_array();
        let mass = mass_matrix(&at, &theta);
        for ((row, force), bias) in mass.iter().zip(forces).zip(bias) {
            close(row.iter().zip(&values[6..]).map(|(a, b)| a * b).sum::<f64>() + bias, force);
        }
        assert!((0..3).all(|i| (0..3).all(|j| mass[i][j] == mass[j][i])), "{mass:?}");
        let resting = Motion::from_array(&std::array::from_fn(|k| if k < 3 { values[k] } else { 0.0 }));
        let held = gravity(&at, &theta).into_array();
        held.into_iter().zip(inverse_dynamics(&resting, &theta).into_array()).for_each(|(a, b)| close(a, b));
        let [tau1, tau2, tau3] = forces;
        let found = forward_dynamics(&at, &Inputs { tau1, tau2, tau3 }, &theta).expect("regular").into_array();
        found
            .into_iter()
            .zip(&values[6..])
            .for_each(|(found, wanted)| assert!((found - wanted).abs() < 1e-9 * wanted.abs().max(1.0)));
    }
    let nothing = Parameters::from_array([0.0; 26]);
    let at = Motion::from_array(&motion(3));
    let error = forward_dynamics(&at, &Inputs { tau1: 1.0, tau2: 0.0, tau3: 0.0 }, &nothing).expect_err("no mass");
    assert_eq!(error, SingularMass::Undetermined { coordinate: 0, name: "q1" });
    let error = forward_dynamics(&at, &Inputs { tau1: f64::NAN, tau2: 0.0, tau3: 0.0 }, &theta).expect_err("no number");
    assert_eq!(error, SingularMass::NotFinite);
}

/// The estimator after samples with some noise; `share` of the past is left after every hundred.
fn estimated<T: Real>(samples: std::ops::Range<usize>, theta: &[f64; 26], share: f64) -> BaseEstimator<T> {
    let theta = Parameters::from_array(*theta);
    let mut estimator = BaseEstimator::new();
    for i in samples {
        let values = motion(i);
        let forces = inverse_dynamics(&Motion::from_array(&values), &theta).into_array();
        let noise = |k: usize| 0.02 * ((12.9898 * (3 * i + k) as f64).sin() * 43_758.545).fract();
        let forces: [T; 3] = std::array::from_fn(|k| T::from_f64(forces[k] + noise(k)));
        let at = Motion::from_array(&values.map(T::from_f64));
        estimator.push(&at, &Forces::from_array(forces), None).expect("finite");
        if i % 100 == 99 {
            estimator.fade(T::from_f64(share));
        }
    }
    estimator
}

#[test]
fn single_precision_finds_what_double_precision_finds() {
    let theta = parameters();
    let truth = Parameters::from_array(theta).base().into_array();
    let single = estimated::<f32>(0..2000, &theta, 1.0).estimate();
    let double = estimated::<f64>(0..2000, &theta, 1.0).estimate();
    assert_eq!((single.rank, double.rank), (BASE_PARAMETERS.len(), BASE_PARAMETERS.len()));
    let (single, found) = (single.whole().expect("shown"), double.whole().expect("shown"));
    let mut worst: f64 = 0.0;
    for ((single, double), label) in single.into_array().into_iter().zip(found.into_array()).zip(BASE_PARAMETERS) {
        let off = (f64::from(single) - double).abs() / double.abs();
        assert!(off < 1e-2, "{label}: {single} {double}");
        worst = worst.max(off);
    }
    println!("condition {}, largest relative difference {worst:e}", double.condition);
    // The noise is uniform, of deviation 0.04/sqrt(12).
    let noise = double.residual / (double.rows - found.into_array().len() as f64).sqrt();
    assert!((noise - 0.02 / 3.0_f64.sqrt()).abs() < 1e-3, "{noise}");
    let deviations = double.deviations.into_array();
    for ((found, truth), deviation) in found.into_array().into_iter().zip(truth).zip(deviations) {
        assert!((found - truth).abs() < 5.0 * noise * deviation.expect("shown"), "{found} {truth}");
    }
}

#[test]
fn what_samples_do_not_show_yet_has_no_value() {
    let mut estimator = BaseEstimator::<f32>::new();
    assert_eq!(estimator.estimate().rank, 0);
    // The last joint moves alone, and nothing shows what only the others feel.
    let theta = Parameters::from_array(parameters().map(|value| value as f32));
    for i in 0..500 {
        let mut values = motion(i).map(|value| value as f32);
        for k in [0, 1, 3, 4, 6, 7] {
            values[k] = 0.0;
        }
        let at = Motion::from_array(&values);
        estimator.push(&at, &inverse_dynamics(&at, &theta), None).expect("finite");
    }
    let estimate = estimator.estimate();
    let shown = estimate.parameters.into_array();
    let named = BASE_PARAMETERS.iter().zip(shown).zip(theta.base().into_array());
    let mut last = Vec::new();
    for ((label, shown), truth) in named {
        if let Some(found) = shown {
            assert!((found - truth).abs() < 1e-3 * truth.abs(), "{label}: {found} {truth}");
            last.push(label.name);
        }
    }
    assert!(estimate.whole().is_none() && estimate.rank < BASE_PARAMETERS.len());
    for name in ["mx_fore", "mz_fore", "Iyy_fore", "fv_q3", "fc_q3"] {
        assert!(last.contains(&name), "{name}: {last:?}");
    }
    assert!(!last.contains(&"fv_q1") && !last.contains(&"Ixx_fore - Izz_fore"), "{last:?}");
    let bad = Motion::from_array(&[f32::NAN; 9]);
    assert!(estimator.push(&bad, &Forces::default(), None).is_err());
    assert_eq!(estimator.estimate(), estimate);
}

#[test]
fn the_past_fades() {
    let (before, mut after) = (parameters(), parameters());
    // Two parameters change.
    after[9] *= 2.0;
    after[25] *= 3.0;
    let mut estimator = estimated::<f64>(0..1000, &before, 0.05);
    assert!(estimator.estimate().rows < 320.0);
    for i in 1000..2000 {
        let at = Motion::from_array(&motion(i));
        estimator.push(&at, &inverse_dynamics(&at, &Parameters::from_array(after)), None).expect("finite");
        if i % 100 == 99 {
            estimator.fade(0.05);
        }
    }
    let truth = Parameters::from_array(after).base().into_array();
    let found = estimator.estimate().whole().expect("shown").into_array();
    found.iter().zip(truth).for_each(|(found, truth)| assert!((found - truth).abs() < 1e-3, "{found} {truth}"));
}
