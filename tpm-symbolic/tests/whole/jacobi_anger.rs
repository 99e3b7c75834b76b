//! Harmonic tables of models with sines and cosines of the motion, by the Jacobi-Anger series.

use crate::common::Build;
use tpm_symbolic::algebra::fourier::Fourier;
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{Function, Node, Symbol};
use tpm_symbolic::harmonic::bessel::{BesselError, numeric_table};
use tpm_symbolic::mechanics::model::{Kind, TermId};
use tpm_symbolic::mechanics::pattern::{Motion, Pattern, rest_to_rest};
use tpm_symbolic::number::rational::ratio;
use tpm_symbolic::regressor::form::regressor_form;

#[test]
fn the_cart_and_pendulum_has_its_true_forces() {
    // Feng, Eqns 6.6 and 6.7, and gravity g sin(th + x) for a function of two coordinates.
    let b = Build::new();
    let (x, th) = (b.coordinate("x"), b.coordinate("th"));
    let ([q, _, a], [s, ds, dds]) = (b.motion(x), b.motion(th));
    let (force, tau) = (b.quantity("F", Kind::Input), b.quantity("tau", Kind::Input));
    let [total, coupling, inertia, g] = b.parameters(["M", "mL", "J", "g"]);
    let tilt = b.quantity("th0", Kind::Constant { value: None });
    b.equation(&[&total * &a, &coupling * (&dds * s.cos() - ds.pow(2) * s.sin()), -&force]);
    b.equation(&[&coupling * &a * s.cos().pow(2), &inertia * &dds, &g * (&s + 2 * &q).sin(), -&tau]);
    let tilt = tilt.symbol();
    let pattern = b.model(|model| {
        let amplitudes: Vec<Symbol> = ["lx", "lth"].map(|name| model.declare(name, None, Kind::Amplitude)).to_vec();
        let frequency = model.declare("w", None, Kind::Frequency);
        let shape = rest_to_rest(3).expect("odd").add(&Fourier::sin(2, ratio(1, 5)));
        let part = |symbol, fourier| Motion::term(Monomial::power_of(symbol, 1), fourier);
        let offset = part(tilt, Fourier::constant(ratio(1, 1)));
        let motions =
            vec![Some(part(amplitudes[0], shape.clone())), Some(part(amplitudes[1], shape.derivative(1)).add(&offset))];
        Pattern { name: None, amplitudes, frequency, motions }
    });
    let model = b.take();
    let form = regressor_form(&model).expect("linear");
    let value = |symbol: Symbol| match model.quantity(symbol).name.as_str() {
        "lx" => 0.7,
        "lth" => 1.9,
        "w" => 3.0,
        "th0" => 0.4,
        other => panic!("{other} is not part of the motion"),
    };
    for harmonics in [5, 12, 60] {
        let columns = numeric_table(&model, &form, &pattern, harmonics, value).expect("sines and cosines");
        let mut worst = 0.0f64;
        for i in 0..97 {
            let theta = f64::from(i) / 97.0 * std::f64::consts::TAU;
            let motion = |c: usize, n: u32| -> f64 {
                let motion = pattern.motions[c].as_ref().expect("given").derivative(n);
                motion
                    .terms()
                    .map(|(m, f)| m.factors().map(|(&s, e)| value(s).powi(e)).product::<f64>() * f.evaluate(theta))
                    .sum::<f64>()
                    * 3f64.powi(n as i32)
            };
            for column in &columns {
                let parameter = form.columns[column.column.expect("no known terms")].parameter.expect("single");
                let terms = &model.equations[column.equation].terms;
                let expected: f64 = terms
                    .iter()
                    .map(|term| {
                        model.graph.evaluate(term.expr, |node| match node {
                            Node::Derivative(c, n) => motion(c.0 as usize, *n),
                            Node::Symbol(s) if *s == parameter => 1.0,
                            _ => 0.0,
                        })
                    })
                    .sum();
                let difference = (column.wave.evaluate(theta) - expected).abs();
                assert!(difference <= column.tail + 1e-11, "{harmonics}: {difference} {}", column.tail);
                worst = worst.max(difference);
            }
        }
        assert!(harmonics < 60 || worst < 1e-11, "{worst}");
    }
}

#[test]
fn other_functions_are_named() {
    let b = Build::new();
    let x = b.coordinate("x");
    let q = b.der(x, 0);
    let u = b.quantity("u", Kind::Input);
    let [k] = b.parameters(["k"]);
    b.equation(&[&k * q.call(Function::Tan), -&u]);
    let model = b.model(|model| model.clone());
    let form = regressor_form(&model).expect("linear");
    let pattern = b.model(|model| {
        let amplitude = model.declare("l", None, Kind::Amplitude);
        let frequency = model.declare("w", None, Kind::Frequency);
        let motion = Motion::term(Monomial::power_of(amplitude, 1), rest_to_rest(1).expect("odd"));
        Pattern { name: None, amplitudes: vec![amplitude], frequency, motions: vec![Some(motion)] }
    });
    let error = numeric_table(&model, &form, &pattern, 9, |_| 1.0).expect_err("tan has no such series");
    assert_eq!(error.term(), TermId(1));
    assert!(error.to_string().contains("tan(x)"), "{error}");
    b.model(|model| model.equations.clear());
    b.equation(&[&k * q.sin(), -&u]);
    let model = b.take();
    let form = regressor_form(&model).expect("linear");
    let error = numeric_table(&model, &form, &pattern, 9, |_| 1e9).expect_err("a million turns");
    assert!(matches!(error, BesselError::Amplitude { ref atom, .. } if atom == "sin(x)"), "{error}");
}
