use crate::series::{NoSeries, Nodes, PeriodicMotion, Series, Wave};
use proptest::prelude::{prop, prop_assert, proptest};
use tpm_session::DeclaredModel;
use tpm_symbolic::expr::graph::{Node, Symbol};
use tpm_symbolic::mechanics::model::TermId;
use tpm_symbolic::regressor::form::Term;

impl Wave {
    fn evaluate(&self, theta: f64) -> f64 {
        let cos = self.cos.iter().enumerate().map(|(k, c)| c * (k as f64 * theta).cos());
        let sin = self.sin.iter().enumerate().map(|(k, s)| s * (k as f64 * theta).sin());
        cos.chain(sin).sum()
    }
}

proptest! {
    #[test]
    fn series_agree_with_values_and_bounds_hold(
        cos in prop::collection::vec(-2.0f64..2.0, 1..4),
        sin in prop::collection::vec(-2.0f64..2.0, 1..4),
        theta in -3.0f64..3.0,
        harmonics in 3usize..40,
    ) {
        let mut phase = Wave { cos, sin };
        phase.sin[0] = 0.0;
        let angle = phase.evaluate(theta);
        let phase = Series { spectrum: phase.spectrum(), error: 0.0, is_finite: true };
        let (cosine, sine) = phase.cosine_and_sine().expect("small");
        for (series, value) in [(cosine, angle.cos()), (sine, angle.sin())] {
            prop_assert!(series.error < 1e-11, "{}", series.error);
            prop_assert!((series.wave().evaluate(theta) - value).abs() < 1e-13);
            let (short, left_out) = series.up_to(harmonics);
            prop_assert!(short.cos.len() <= harmonics + 1);
            prop_assert!((short.evaluate(theta) - value).abs() <= left_out + 1e-13);
        }
    }
}

/// The motion of coordinates, one after the other, at 3 rad/s.
fn moving(coordinates: Vec<Wave>) -> PeriodicMotion {
    PeriodicMotion { frequency: 3.0, coordinates: coordinates.into_iter().map(Some).collect() }
}

fn columns(terms: &[Term]) -> impl Iterator<Item = &[Term]> {
    terms.chunk_by(|a, b| a.column == b.column)
}

#[test]
fn the_cart_and_pendulum_has_its_true_forces() {
    // Feng, Eqns 6.6 and 6.7, and gravity g sin(th + 2 x) for a function of two coordinates.
    let model = DeclaredModel::parse(
        "test.tpm",
        "model Cart {
            coordinate x, th;
            input F, tau;
            parameter M, mL, J, g;
            constant th0;
            M*ddot(x) + mL*(ddot(th)*cos(th) - dot(th)^2*sin(th)) = F;
            mL*ddot(x)*cos(th)^2 + J*ddot(th) + g*sin(th + 2*x + th0) = tau;
        }",
    )
    .expect("a model");
    let prepared = model.prepared();
    let cos = vec![0.0, 0.7, 0.0, -0.7 / 9.0];
    let x = Wave { cos: cos.clone(), sin: vec![0.0, 0.0, 0.14] };
    let th = Wave { cos: vec![0.4, 0.0, 1.9 * 0.4], sin: vec![0.0, -1.9, 0.0, 1.9 / 3.0] };
    let motion = moving(vec![x, th]);
    let mut nodes = Nodes::new(&prepared.model, &motion, |_| 0.3);
    for harmonics in [5, 12, 60] {
        let mut worst = 0.0f64;
        for (row, equation) in prepared.form.rows.iter().zip(&prepared.model.equations) {
            for terms in columns(&row.terms) {
                let (wave, tail) = nodes.sum(terms).expect("sines and cosines").up_to(harmonics);
                let column = &prepared.form.columns[terms[0].column.expect("no known terms")];
                let parameter = column.parameter.expect("single");
                for theta in (0..97).map(|i| f64::from(i) / 97.0 * std::f64::consts::TAU) {
                    let leaf = |node: &Node| match node {
                        Node::Derivative(c, n) => {
                            let wave = motion.coordinates[c.0 as usize].as_ref().expect("moves");
                            wave.spectrum().derivative(motion.frequency, *n).wave().evaluate(theta)
                        }
                        Node::Symbol(symbol) if *symbol == parameter => 1.0,
                        Node::Symbol(symbol) if prepared.model.quantity(*symbol).name == "th0" => 0.3,
                        _ => 0.0,
                    };
                    let graph = &prepared.model.graph;
                    let expected: f64 = equation.terms.iter().map(|term| graph.evaluate(term.expr, leaf)).sum();
                    let difference = (wave.evaluate(theta) - expected).abs();
                    assert!(difference <= tail + 1e-11, "{harmonics}: {difference} {tail}");
                    worst = worst.max(difference);
                }
            }
        }
        assert!(harmonics < 60 || worst < 1e-11, "{worst}");
    }
}

/// The fault of the first row of a model of one coordinate that moves with an amplitude.
fn fault(equation: &str, amplitude: f64) -> NoSeries {
    let text = format!("model M {{ coordinate x; input u; parameter k, c; {equation} = u; }}");
    let model = DeclaredModel::parse("test.tpm", &text).expect("a model");
    let motion = moving(vec![Wave { cos: vec![0.0, amplitude], sin: Vec::new() }]);
    let prepared = model.prepared();
    let fault = Nodes::new(&prepared.model, &motion, |_: Symbol| f64::NAN).sum(&prepared.form.rows[0].terms);
    fault.err().expect("no series")
}

#[test]
fn what_has_no_series_is_named() {
    let error = fault("k*ddot(x) + c*tan(x)", 1.0);
    assert!(matches!(&error, NoSeries::Function { term: TermId(1), atom } if atom == "tan(x)"), "{error:?}");
    assert!(error.to_string().contains("tan(x)"), "{error}");
    let error = fault("k*ddot(x) + c*sin(x)", 1e9);
    assert!(matches!(&error, NoSeries::Large { atom, .. } if atom == "sin(x)"), "{error:?}");
    let error = fault("k*ddot(x) + c*sin(x)", f64::NAN);
    assert!(matches!(&error, NoSeries::Large { .. }), "{error:?}");
}

#[test]
fn polynomials_leave_nothing_out() {
    let wave = Wave { cos: vec![0.5, 2.0], sin: vec![0.0, 0.0, 1.0] };
    let series = Series { spectrum: wave.spectrum(), error: 0.0, is_finite: true };
    let square = series.times(&series).expect("short");
    assert_eq!(square.up_to(4).1, 0.0);
    assert!(square.up_to(3).1 > 0.4);
}
