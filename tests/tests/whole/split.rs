//! The two parts of every input: they add up to the whole for every shipped model, and are those of Feng, section 6.2.

use crate::support::{model, root};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::HashMap;
use tpm_runtime::study::numeric_parts;
use tpm_symbolic::algebra::fourier::{Fourier, Trig};
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{ExprId, Node};
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::mechanics::model::{ExactModel, Kind, SourceTerm};
use tpm_symbolic::mechanics::pattern::{Motion, Pattern};
use tpm_symbolic::number::rational::{integer, to_f64};
use tpm_symbolic::plan::split::{Split, split};
use tpm_symbolic::regressor::prepare::prepare;

/// A random state and random quantities of a model; what is known exactly has its value.
fn random_leaves(model: &ExactModel, rng: &mut ChaCha8Rng) -> HashMap<Node, f64> {
    let mut leaves = HashMap::new();
    for (index, quantity) in (0u32..).zip(&model.symbols) {
        let value = match &quantity.kind {
            Kind::Constant { value: Some(value) } => to_f64(value),
            _ => rng.random_range(0.5..2.0),
        };
        leaves.insert(Node::Symbol(tpm_symbolic::expr::graph::Symbol(index)), value);
    }
    for c in 0..model.coordinates.len() as u32 {
        for order in 0..=model.order().max(2) {
            leaves
                .insert(Node::Derivative(tpm_symbolic::expr::graph::Coordinate(c), order), rng.random_range(-2.0..2.0));
        }
    }
    leaves
}

fn value(model: &ExactModel, expr: ExprId, leaves: &HashMap<Node, f64>) -> f64 {
    model.graph.evaluate(expr, |leaf| leaves[leaf])
}

/// J_n(x) of a small argument, from its power series (Abramowitz and Stegun, 9.1.10).
fn bessel(n: u32, x: f64) -> f64 {
    let first = (1..=n).fold(1.0, |term, k| term * x / 2.0 / f64::from(k));
    let terms = (1..20).scan(first, |term, k| {
        *term *= -x * x / 4.0 / f64::from(k) / f64::from(k + n);
        Some(*term)
    });
    first + terms.sum::<f64>()
}

/// The sum of a part's terms, and of their magnitudes.
fn sum(split: &Split, part: &[SourceTerm], leaves: &HashMap<Node, f64>) -> (f64, f64) {
    part.iter().map(|term| value(&split.model, term.expr, leaves)).fold((0.0, 0.0), |(s, m), v| (s + v, m + v.abs()))
}

#[test]
fn the_parts_of_every_shipped_model_add_up_to_the_whole() {
    let mut count = 0;
    let folder = std::fs::read_dir(root().join("models")).expect("the folder of models");
    for path in folder.map(|entry| entry.expect("readable").path()) {
        if path.extension().is_none_or(|extension| extension != "tpm") {
            continue;
        }
        count += 1;
        let name = path.file_stem().expect("named").to_str().expect("plain");
        let model = model(name);
        let found = split(&model, &[]).unwrap_or_else(|error| panic!("{name}: {error}"));
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for _ in 0..100 {
            let mut leaves = random_leaves(&model, &mut rng);
            // With the sums of the parts for inputs, every equation with an input holds.
            for input in &found.inputs {
                let (independent, dependent) =
                    (sum(&found, &input.independent, &leaves).0, sum(&found, &input.dependent, &leaves).0);
                leaves.insert(Node::Symbol(input.input), independent + dependent);
            }
            for equation in &model.equations {
                let inputs: Vec<Node> = found.inputs.iter().map(|input| Node::Symbol(input.input)).collect();
                let acts = equation.terms.iter().any(|term| {
                    model.graph.leaves(term.expr).iter().any(|leaf| inputs.contains(model.graph.node(*leaf)))
                });
                if acts {
                    let terms = equation.terms.iter().map(|term| value(&model, term.expr, &leaves));
                    let (sum, size) = terms.fold((0.0, 0.0), |(s, m), v| (s + v, m + f64::abs(v)));
                    assert!(sum.abs() <= 1e-12 * size, "{name}, {}: {sum:e} of {size}", equation.name);
                }
            }
            // At rest of its own coordinates the independent part keeps its value and the dependent one is gone.
            for input in &found.inputs {
                let mut still = leaves.clone();
                for (node, value) in &mut still {
                    if matches!(node, Node::Derivative(c, 1..) if input.motions.contains(c)) {
                        *value = 0.0;
                    }
                }
                let (moving, size) = sum(&found, &input.independent, &leaves);
                let (resting, _) = sum(&found, &input.independent, &still);
                assert!((moving - resting).abs() <= 1e-12 * size, "{name}: {moving} {resting}");
                let (_, left) = sum(&found, &input.dependent, &leaves);
                let (gone, _) = sum(&found, &input.dependent, &still);
                assert!(gone.abs() <= 1e-12 * left, "{name}: {gone} of {left}");
            }
        }
        // The parts expand to the same harmonics as the whole, where it expands.
        let whole = prepare(model.clone()).expect("linear in the parameters");
        if let Ok(table) = expand(&whole.model, &whole.form, &model.patterns[0]) {
            let parts = prepare(found.parts().expect("eliminates")).expect("linear in the parameters");
            let halves = expand(&parts.model, &parts.form, &model.patterns[0]).expect("as the whole does");
            assert!(halves.len() >= table.len().min(1), "{name}");
        }
    }
    assert!(count >= 10, "{count} models");
}

/// Displayed parts by input.
fn shown(name: &str) -> Vec<[String; 2]> {
    let mut found = split(&model(name), &[]).expect("can be split");
    let inputs = found.inputs.clone();
    let display = |found: &mut Split, part: &[SourceTerm]| {
        let expr = found.expression(part);
        found.model.display(expr)
    };
    inputs.iter().map(|i| [display(&mut found, &i.independent), display(&mut found, &i.dependent)]).collect()
}

/// Whether two expressions of a model's language are equal as functions.
fn same(model: &ExactModel, left: &str, right: ExprId, terms: impl Fn(&mut ExactModel) -> ExprId) {
    let mut model = model.clone();
    let expected = terms(&mut model);
    let difference = model.graph.sub(expected, right);
    assert!(
        tpm_symbolic::expr::trigonometric::is_zero(&mut model.graph, difference),
        "{left}: {}",
        model.display(right)
    );
}

#[test]
fn the_parts_are_those_of_feng_6_6_and_6_7() {
    let mut found = split(&model("cart_pendulum"), &[]).expect("can be split");
    let inputs = found.inputs.clone();
    let [force, torque] = inputs.as_slice() else { panic!("two inputs") };
    let symbol = |model: &mut ExactModel, name: &str| {
        let symbol = model.find_symbol(name).expect("declared");
        model.graph.symbol(symbol)
    };
    let (x, theta) = (tpm_symbolic::expr::graph::Coordinate(0), tpm_symbolic::expr::graph::Coordinate(1));
    let parts = [&force.independent, &force.dependent, &torque.independent, &torque.dependent]
        .map(|part| found.expression(part));
    let model = found.model;
    same(&model, "F_MI = m L (theta'' cos theta - theta'^2 sin theta)", parts[0], |model| {
        let (m, l) = (symbol(model, "m"), symbol(model, "L"));
        let g = &mut model.graph;
        let [q, v, a] = [0, 1, 2].map(|n| g.derivative_of(theta, n));
        let (cos, sin) = (
            g.function(tpm_symbolic::expr::graph::Function::Cos, q),
            g.function(tpm_symbolic::expr::graph::Function::Sin, q),
        );
        let (left, square) = (g.mul(a, cos), g.pow(v, 2));
        let right = g.mul(square, sin);
        let difference = g.sub(left, right);
        g.product(&[m, l, difference])
    });
    same(&model, "F_MD = (M + m) x''", parts[1], |model| {
        let (big, m) = (symbol(model, "M"), symbol(model, "m"));
        let a = model.graph.derivative_of(x, 2);
        let sum = model.graph.add(big, m);
        model.graph.mul(sum, a)
    });
    same(&model, "tau_MI = m L x'' cos theta", parts[2], |model| {
        let (m, l) = (symbol(model, "m"), symbol(model, "L"));
        let (a, q) = (model.graph.derivative_of(x, 2), model.graph.derivative_of(theta, 0));
        let cos = model.graph.function(tpm_symbolic::expr::graph::Function::Cos, q);
        model.graph.product(&[m, l, a, cos])
    });
    same(&model, "tau_MD = m L^2 theta''", parts[3], |model| {
        let (m, l) = (symbol(model, "m"), symbol(model, "L"));
        let a = model.graph.derivative_of(theta, 2);
        let square = model.graph.pow(l, 2);
        model.graph.product(&[m, square, a])
    });
}

#[test]
fn other_models_split_into_what_holds_still_and_what_moves() {
    let pair = |found: &[[String; 2]], i: usize| [found[i][0].clone(), found[i][1].clone()];
    let emps = shown("emps");
    assert_eq!(pair(&emps, 0)[0], "OF");
    assert!(pair(&emps, 0)[1].contains("sign(dot(q))"));
    let silverbox = shown("silverbox");
    assert!(!silverbox[0][0].contains("dot") && silverbox[0][0].contains("y^3"), "{silverbox:?}");
    // Feng, Eqns C.15, C.16: of torque and voltage what the shaft's motion asks for, and the rest.
    let motor = shown("brushless_motor");
    assert_eq!(motor[0], ["i*kt", "-J*ddot(phi)"].map(String::from));
    assert_eq!(motor[1][1], "kv*dot(phi)");
    // The free cart's spring force stays when the driven cart stands.
    let carts = shown("two_carts");
    assert!(carts[0][0].contains("x2*k3") && !carts[0][1].contains("k3"), "{carts:?}");
}

/// The harmonics of Feng, Eqn 6.2, F_MI for theta = a cos(w t) and a cart that stands, by three ways: Jacobi-Anger in
/// numbers, its closed form, and quadrature. Printed is +4 a m L w^2 [...]; the sign is minus and there is no 4.
#[test]
fn feng_6_2_has_its_harmonics() {
    let mut model = model("cart_pendulum");
    let a = model.declare("a", None, Kind::Amplitude);
    let w = model.declare("omega", None, Kind::Frequency);
    let motion = |symbol| Motion::term(Monomial::power_of(symbol, 1), Fourier::cos(1, integer(1)));
    let still = Motion::zero();
    let pattern =
        Pattern { name: None, amplitudes: vec![a], frequency: w, motions: vec![Some(still), Some(motion(a))] };
    let found = split(&model, &[]).expect("can be split");
    let parts = prepare(found.parts().expect("nothing to eliminate")).expect("linear");
    let (amplitude, frequency, mass, length) = (0.9, 5.0, 1.5, 0.4);
    let value = |symbol: tpm_symbolic::expr::graph::Symbol| match parts.model.quantity(symbol).name.as_str() {
        "a" => amplitude,
        "omega" => frequency,
        "M" => 10.0,
        "m" => mass,
        "L" => length,
        other => panic!("{other} is not asked for"),
    };
    let waves = numeric_parts(&parts, &pattern, 25, value).expect("sines and cosines");
    let wave = &waves.iter().find(|part| parts.form.rows[part.equation].name == "F_independent").expect("there").wave;
    let force = |phase: f64| {
        let angle = amplitude * phase.cos();
        -amplitude
            * mass
            * length
            * frequency.powi(2)
            * (phase.cos() * angle.cos() + amplitude * phase.sin().powi(2) * angle.sin())
    };
    let n = 4096;
    for k in 0..=25u32 {
        let samples = (0..n).map(|i| std::f64::consts::TAU * f64::from(i) / f64::from(n));
        let sum: f64 = samples.map(|phase| force(phase) * (f64::from(k) * phase).cos()).sum();
        let quadrature = sum * if k == 0 { 1.0 } else { 2.0 } / f64::from(n);
        // F = m L d^2/dt^2 sin(theta), and sin(a cos p) = 2 sum_l (-1)^l J_{2l+1}(a) cos (2l+1)p.
        let closed = if k % 2 == 1 {
            let sign = if (k / 2) % 2 == 0 { 1.0 } else { -1.0 };
            -mass * length * (f64::from(k) * frequency).powi(2) * 2.0 * sign * bessel(k, amplitude)
        } else {
            0.0
        };
        let found = wave.cos.get(k as usize).copied().unwrap_or(0.0);
        assert!(
            (found - quadrature).abs() < 1e-11 && (found - closed).abs() < 1e-11,
            "{k}: {found} {quadrature} {closed}"
        );
        assert!(wave.sin.get(k as usize).is_none_or(|s| s.abs() < 1e-12));
    }
    // The declared Taylor polynomial of order 8 gives the table; at a small amplitude its sum is the same force.
    let text = std::fs::read_to_string(root().join("models/cart_pendulum.tpm")).expect("shipped");
    let source = tpm_codegen::source::Source::new("cart_pendulum.tpm", text);
    let parsed = tpm_codegen::parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let (truncated, _) = parsed.for_tables().expect("regular");
    let parts = prepare(split(&truncated, &[]).expect("can be split").parts().expect("none")).expect("linear");
    let table = expand(&parts.model, &parts.form, &parsed.model.patterns[0]).expect("a polynomial");
    let equation = table.equations.iter().position(|name| name == "F_independent").expect("there");
    let symbols: Vec<f64> = table
        .symbols
        .iter()
        .map(|name| match name.as_str() {
            "lambda2" => 0.1,
            "w" => 3.0,
            _ => 0.0,
        })
        .collect();
    let phase: f64 = 0.7;
    let sum: f64 = table
        .entries()
        .filter(|entry| entry.equation == equation)
        .map(|entry| {
            let angle = entry.harmonic as f64 * phase;
            table.evaluate(&entry, &symbols) * if entry.function == Trig::Cos { angle.cos() } else { angle.sin() }
        })
        .sum();
    let p = 4.0 * phase;
    let (q, v, acc) = (
        0.1 * (p.cos() - (3.0 * p).cos() / 9.0),
        -0.1 * 12.0 * 4.0 / 3.0 * p.sin().powi(3),
        -0.1 * 144.0 * 4.0 * p.sin().powi(2) * p.cos(),
    );
    let exact = acc * q.cos() - v * v * q.sin();
    assert!((sum - exact).abs() < 1e-9 * exact.abs(), "{sum} {exact}");
}
