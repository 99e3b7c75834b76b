//! Taylor series about symbolic points, their errors, and the truncation of whole models.

use crate::common::{Build, E};
use proptest::prelude::{prop_assert, proptest};
use tpm_symbolic::algebra::fourier::Fourier;
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{Function, Node};
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::linear::taylor::{Expansion, SeriesError, series, truncate};
use tpm_symbolic::mechanics::model::{Kind, TermId};
use tpm_symbolic::mechanics::pattern::{Motion, Pattern, rest_to_rest};
use tpm_symbolic::number::rational::ratio;
use tpm_symbolic::regressor::form::regressor_form;

fn factorial(n: u32) -> i64 {
    (1..=i64::from(n)).product()
}

/// The Taylor coefficient f^(k)(q0) / k!, by differentiating k times.
fn by_derivatives(b: &Build, f: &E, q: &E, point: &E, k: u32) -> E {
    let derivative = (0..k).fold(f.clone(), |f, _| f.diff(q));
    let at = b.graph(|g| g.substitute(derivative.id, &[(q.id, point.id)].into()));
    b.e(at) / factorial(k)
}

/// Functions of every kind, regular at generic points.
fn functions(q: &E, p: &E) -> Vec<E> {
    let inner = q * p + q.pow(2);
    vec![
        inner.sin(),
        inner.cos(),
        inner.call(Function::Tan),
        (q / 3).call(Function::Asin),
        (q * p / 5).call(Function::Acos),
        inner.call(Function::Atan),
        (2 + &inner).call(Function::Sqrt),
        inner.call(Function::Tanh),
        inner.call(Function::Exp),
        (2 + &inner).call(Function::Log),
        inner.call(Function::Abs) * q,
        (1 + inner.pow(2)).pow(-2),
        (q.sin() + 2).atan2(&(q.cos() * p)),
        (q.sin() / (3 + q.cos())).sin() * q.pow(3),
    ]
}

#[test]
fn coefficients_are_derivatives_over_factorials() {
    let b = Build::new();
    let x = b.coordinate("x");
    let q = b.der(x, 0);
    let [p, q0] = b.parameters(["p", "q0"]);
    let order = 6;
    for f in functions(&q, &p) {
        let expansion = Expansion { coordinate: x, point: q0.id, order };
        let found = b.model(|model| series(model, f.id, &[expansion])).expect("regular");
        for k in 0..=order {
            let expected = by_derivatives(&b, &f, &q, &q0, k);
            let coefficient = found.coefficients.get(&smallvec::smallvec![k]);
            let coefficient = coefficient.map_or(b.num(0), |&id| b.e(id));
            for (point, value) in [(0.3, 0.7), (0.45, 1.1), (0.2, -0.6)] {
                let at = |e: &E| e.at(&[(q0.id, point), (p.id, value)]);
                let (left, right) = (at(&coefficient), at(&expected));
                assert!((left - right).abs() <= 1e-9 * (1.0 + right.abs()), "{k}: {left} {right}");
            }
        }
    }
}

/// Derivatives beside differences of values four steps apart, of fourth order; exact values and odd symmetry.
#[test]
fn derivatives_of_tanh_exp_and_log_are_slopes() {
    let b = Build::new();
    let q = b.der(b.coordinate("x"), 0);
    let [p] = b.parameters(["p"]);
    let cases = [
        (&q / &p).call(Function::Tanh),
        (-&(&q * &p).pow(2)).call(Function::Exp),
        (1 + q.pow(2) * &p).call(Function::Log),
        (&q * &p).call(Function::Exp).call(Function::Tanh) * (2 + q.call(Function::Tanh)).call(Function::Log),
    ];
    for f in &cases {
        let slope = f.diff(&q);
        for (point, value) in [(0.3, 0.7), (-1.2, 0.4), (2.5, 1.3), (0.0, 0.9)] {
            let at = |e: &E, offset: f64| e.at(&[(q.id, point + offset), (p.id, value)]);
            let h = 1e-3;
            let difference = (8.0 * (at(f, h) - at(f, -h)) - (at(f, 2.0 * h) - at(f, -2.0 * h))) / (12.0 * h);
            let exact = at(&slope, 0.0);
            assert!((exact - difference).abs() < 1e-8 * (1.0 + exact.abs()), "{point}: {exact} {difference}");
        }
    }
    let odd = (-&q).call(Function::Tanh) + q.call(Function::Tanh);
    let whole = [b.num(0).call(Function::Tanh), b.num(0).call(Function::Exp) - 1, b.num(1).call(Function::Log), odd];
    assert!(whole.iter().all(|zero| zero.id == b.num(0).id));
}

#[test]
fn polynomials_are_their_own_series_and_several_coordinates_keep_the_total_order() {
    let b = Build::new();
    let (x, y) = (b.coordinate("x"), b.coordinate("y"));
    let (q, r) = (b.der(x, 0), b.der(y, 0));
    let [a, c] = b.parameters(["a", "c"]);
    let f = &a * q.pow(3) + &c * (&q * r.pow(2)) - 7;
    let at = |coordinate, point: &E, order| Expansion { coordinate, point: point.id, order };
    let found = b.model(|m| series(m, f.id, &[at(x, &a, 3), at(y, &c, 3)])).expect("a polynomial");
    let polynomial = b.e(b.graph(|g| found.polynomial(g)));
    assert!(b.is_zero(&(polynomial - &f)));
    // sin(x + y) about (a, 0) to order 3: every coefficient is +-sin a or cos a over i! j!.
    let wave = (&q + &r).sin();
    let zero = b.num(0);
    let found = b.model(|m| series(m, wave.id, &[at(x, &a, 3), at(y, &zero, 3)])).expect("regular");
    assert_eq!(found.coefficients.len(), 10);
    for (index, &coefficient) in &found.coefficients {
        let (i, j) = (index[0], index[1]);
        let trig = if (i + j).is_multiple_of(2) { a.sin() } else { a.cos() };
        let sign = if (i + j) % 4 >= 2 { -1 } else { 1 };
        let expected = sign * trig / (factorial(i) * factorial(j));
        assert_eq!(coefficient, expected.id);
    }
    // New parameters instead of expressions (Feng, Eqns 5.5-5.7).
    let (expr, parameters) = b.model(|m| found.with_parameters(m, "s"));
    assert_eq!(parameters.len(), 10);
    let names: Vec<String> =
        b.model(|m| parameters.iter().map(|(symbol, _)| m.quantity(*symbol).name.to_string()).collect());
    assert_eq!(names[..3], ["s0_0", "s0_1", "s0_2"]);
    let back = b.model(|m| {
        let replaced = parameters.iter().map(|&(symbol, id)| (m.graph.symbol(symbol), id)).collect();
        m.graph.substitute(expr, &replaced)
    });
    let polynomial = b.e(b.graph(|g| found.polynomial(g)));
    assert!(b.is_zero(&(b.e(back) - polynomial)));
}

#[test]
fn singular_points_are_named() {
    let b = Build::new();
    let x = b.coordinate("x");
    let q = b.der(x, 0);
    let [p] = b.parameters(["p"]);
    let f = q.clone().pow(-1);
    let one = b.num(1);
    let cases: [(E, E, &str); 9] = [
        (f.clone(), b.num(0), "1/x"),
        ((&q - &p).pow(-2), p.clone(), "1/(x - p)^2"),
        (q.call(Function::Sqrt), b.num(0), "sqrt(x)"),
        (q.call(Function::Log), b.num(0), "log(x)"),
        (q.call(Function::Abs), b.num(0), "abs(x)"),
        (q.call(Function::Tan), b.pi() / 2, "tan(x)"),
        (q.call(Function::Asin), one.clone(), "asin(x)"),
        (q.sin().atan2(&(q.cos() - 1)), b.num(0), "atan2(sin(x), -1 + cos(x))"),
        (((&q - &p).sin().pow(2) + (&q - &p).cos().pow(2) - 1).pow(-1), p.clone(), ""),
    ];
    for (f, point, name) in cases {
        let expansion = Expansion { coordinate: x, point: point.id, order: 3 };
        match b.model(|model| series(model, f.id, &[expansion])) {
            Err(SeriesError::Singular { term: None, atom }) if name.is_empty() || atom == name => {}
            other => panic!("{name}: {other:?}"),
        }
    }
    // In a model the source term is named, and the model stays as it was.
    let u = b.quantity("u", Kind::Input);
    b.equation(&[&p * b.der(x, 2), &p * q.pow(-1), -&u]);
    let before = b.model(|model| model.equations.clone());
    let zero = b.num(0);
    let expansion = Expansion { coordinate: x, point: zero.id, order: 3 };
    let error = b.model(|model| truncate(model, &[expansion])).expect_err("1/x at 0");
    assert_eq!(error, SeriesError::Singular { term: Some(TermId(2)), atom: "1/x".to_owned() });
    assert_eq!(b.model(|model| model.equations.clone()), before);
    let moving = Expansion { coordinate: x, point: q.id, order: 3 };
    assert!(matches!(b.model(|m| series(m, f.id, &[moving])), Err(SeriesError::Point { .. })));
    let twice = b.model(|m| series(m, f.id, &[expansion, expansion]));
    assert!(matches!(twice, Err(SeriesError::Twice { .. })));
}

#[test]
fn the_error_of_a_series_is_of_the_next_order() {
    let b = Build::new();
    let (x, y) = (b.coordinate("x"), b.coordinate("y"));
    let (q, r) = (b.der(x, 0), b.der(y, 0));
    let [p, q0] = b.parameters(["p", "q0"]);
    let zero = b.num(0);
    let mut cases: Vec<E> = functions(&q, &p);
    cases.push((&q + &r).sin() * (&p + r.cos()).pow(-1));
    for (f, order) in cases.iter().flat_map(|f| [(f, 2u32), (f, 4)]) {
        let expansions =
            [Expansion { coordinate: x, point: q0.id, order }, Expansion { coordinate: y, point: zero.id, order }];
        let found = b.model(|model| series(model, f.id, &expansions)).expect("regular");
        let polynomial = b.e(b.graph(|g| found.polynomial(g)));
        let (point, value, reach) = (0.4, 0.7, 0.005f64);
        let mut worst: f64 = 0.0;
        for (i, j) in (0..=20).flat_map(|i| (0..=20).map(move |j| (i, j))) {
            let at = |n: i32| reach * (f64::from(n) / 10.0 - 1.0);
            let values = [(q.id, point + at(i)), (r.id, at(j)), (p.id, value), (q0.id, point)];
            worst = worst.max((f.at(&values) - polynomial.at(&values)).abs());
        }
        // Over a small box the next order is nearly the whole remainder.
        let further = expansions.map(|e| Expansion { order: order + 1, ..e });
        let further = b.model(|model| series(model, f.id, &further)).expect("regular");
        let next: f64 = further
            .coefficients
            .iter()
            .filter(|(index, _)| index.iter().sum::<u32>() == order + 1)
            .map(|(_, &c)| b.e(c).at(&[(p.id, value), (q0.id, point)]).abs())
            .sum();
        let next = next * reach.powi(order as i32 + 1);
        assert!(worst <= 3.0 * next + 1e-13, "{worst} {next}");
    }
}

/// The two-joint serial arm with gravity: inertia a, c, coupling b, gravity g1, g2 (W6).
fn serial_arm(b: &Build) {
    let (x, y) = (b.coordinate("q1"), b.coordinate("q2"));
    let ([q1, v1, a1], [q2, v2, a2]) = (b.motion(x), b.motion(y));
    let (tau1, tau2) = (b.quantity("tau1", Kind::Input), b.quantity("tau2", Kind::Input));
    let [a, bb, c, g1, g2] = b.parameters(["a", "b", "c", "g1", "g2"]);
    let (cosine, sine, tilt) = (q2.cos(), q2.sin(), (&q1 + &q2).cos());
    b.equation(&[
        &a * &a1,
        2 * (&bb * &cosine) * &a1,
        &c * &a2,
        &bb * &cosine * &a2,
        -(2 * (&bb * &sine) * (&v1 * &v2)),
        -(&bb * &sine * v2.pow(2)),
        &g1 * q1.cos(),
        &g2 * &tilt,
        -&tau1,
    ]);
    b.equation(&[&c * &a1, &bb * &cosine * &a1, &c * &a2, &bb * &sine * v1.pow(2), &g2 * &tilt, -&tau2]);
}

fn sliding(b: &Build) -> Pattern {
    b.model(|model| {
        let amplitudes: Vec<_> = ["l1", "l2"].map(|name| model.declare(name, None, Kind::Amplitude)).to_vec();
        let frequency = model.declare("w", None, Kind::Frequency);
        let shape = rest_to_rest(3).expect("odd").add(&Fourier::constant(ratio(-8, 9)));
        let motions = amplitudes.iter().map(|&l| Some(Motion::term(Monomial::power_of(l, 1), shape.clone()))).collect();
        Pattern { name: None, amplitudes, frequency, motions }
    })
}

#[test]
fn a_truncated_arm_expands_and_converges_to_the_true_torque() {
    // The table of the truncated model against the true equations at a phase; the error falls with the order and stays
    // below the bound of Lagrange.
    let mut last = f64::INFINITY;
    for order in [2, 4, 6, 8] {
        let b = Build::new();
        serial_arm(&b);
        let exact = b.model(|model| model.equations.clone());
        let zero = b.num(0);
        let expansions =
            [0, 1].map(|c| Expansion { coordinate: tpm_symbolic::expr::graph::Coordinate(c), point: zero.id, order });
        let truncations = b.model(|model| truncate(model, &expansions)).expect("sin and cos are regular");
        // cos q2 (3 times), sin q2 (3), cos q1, cos(q1 + q2) (2)
        assert_eq!(truncations.len(), 9);
        let pattern = sliding(&b);
        let model = b.model(|model| model.clone());
        let form = regressor_form(&model).expect("linear in the parameters");
        let table = expand(&model, &form, &pattern).expect("finite after truncation");
        let (amplitudes, w, theta) = ([0.4, -0.3], 2.0, 1.9f64);
        let parameters = [1.3, 0.4, 0.5, 6.0, 2.0];
        let symbols: Vec<f64> = model
            .symbols
            .iter()
            .map(|quantity| match quantity.name.as_str() {
                "l1" => amplitudes[0],
                "l2" => amplitudes[1],
                "w" => w,
                _ => 0.0,
            })
            .collect();
        let mut torque = [0.0; 2];
        for entry in table.entries() {
            let angle = entry.harmonic as f64 * theta;
            let wave = if entry.function.name() == "cos" { angle.cos() } else { angle.sin() };
            let column = entry.column.expect("every term has a parameter");
            torque[entry.equation] += table.evaluate(&entry, &symbols) * wave * parameters[column];
        }
        let shape = rest_to_rest(3).expect("odd");
        let position =
            |n: u32| shape.derivative(n).evaluate(theta) * w.powi(n as i32) - if n == 0 { 8.0 / 9.0 } else { 0.0 };
        let names = form.columns.iter().map(|column| column.name.as_str()).collect::<Vec<_>>();
        assert_eq!(names, ["a", "b", "c", "g1", "g2"]);
        let mut worst: f64 = 0.0;
        for (row, equation) in exact.iter().enumerate() {
            let value: f64 = equation
                .terms
                .iter()
                .map(|term| {
                    model.graph.evaluate(term.expr, |node| match node {
                        Node::Derivative(c, n) => amplitudes[c.0 as usize] * position(*n),
                        Node::Symbol(symbol) => {
                            let name = model.quantity(*symbol).name.as_str();
                            names.iter().position(|n| *n == name).map_or(0.0, |i| parameters[i])
                        }
                        _ => 0.0,
                    })
                })
                .sum();
            worst = worst.max((value - torque[row]).abs());
        }
        // The remainders of Lagrange over the box q1 in [-r1, 0], q2 in [0, r2], each times the largest factor that multiplies
        // a truncation: the derivative of odd order + 1 is a sine for a cosine, and a cosine for a sine.
        let [r1, r2] = amplitudes.map(|amplitude: f64| amplitude.abs() * 16.0 / 9.0);
        let power = |distance: f64| distance.powi(order as i32 + 1) / factorial(order + 1) as f64;
        let (cosine2, sine2, cosine1) = (r2.sin() * power(r2), power(r2), r1.sin() * power(r1));
        let tilt = r1.max(r2).sin() * power(r1 + r2);
        let total = 3.0 * cosine2 + 3.0 * sine2 + cosine1 + 2.0 * tilt;
        let largest_factor = 6.0;
        assert!(worst <= total * largest_factor, "{worst} {total}");
        assert!(worst < last * 0.2, "order {order}: {worst} after {last}");
        last = worst;
    }
    assert!(last < 1e-6, "{last}");
}

proptest! {
    #[test]
    fn products_and_sums_of_series_are_series_of_products_and_sums(
        m in -3i64..4, n in 1i64..4, point in -0.6f64..0.6, d in -0.02f64..0.02,
    ) {
        let b = Build::new();
        let x = b.coordinate("x");
        let q = b.der(x, 0);
        let [q0] = b.parameters(["q0"]);
        let f = (m * &q).sin() * (n + q.cos()).pow(-1) + (&q / n).call(Function::Atan);
        let expansion = Expansion { coordinate: x, point: q0.id, order: 5 };
        let found = b.model(|model| series(model, f.id, &[expansion])).expect("regular");
        let polynomial = b.e(b.graph(|g| found.polynomial(g)));
        let values = [(q.id, point + d), (q0.id, point)];
        prop_assert!((f.at(&values) - polynomial.at(&values)).abs() < 1e-6);
    }
}
