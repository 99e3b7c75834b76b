//! Tables with functions of constants: Taylor polynomials about a point that is known at run time only.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use tpm_codegen::{Parsed, parse_model, source::Source};
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::expr::graph::Node;
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::derived::Derived;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::regressor::prepare::prepare;

type Values = BTreeMap<String, f64>;

fn parsed(text: &str) -> Parsed {
    parse_model(&Source::new("model.tpm", text.to_owned())).unwrap_or_else(|faults| panic!("{faults:?}"))
}

fn table_of(parsed: &Parsed) -> HarmonicTable {
    let (model, _, constants) = parsed.for_read_tables().expect("regular");
    let prepared = prepare(model).expect("linear");
    let table = expand(&prepared.model, &prepared.form, &prepared.model.patterns[0]).expect("finite");
    table.gathered(constants, prepared.model.is_constant())
}

fn value(model: &ExactModel, expr: tpm_symbolic::expr::graph::ExprId, values: &Values) -> f64 {
    model.graph.evaluate(expr, |leaf| match leaf {
        Node::Symbol(symbol) => values[model.quantity(*symbol).name.as_str()],
        Node::Derivative(coordinate, order) => {
            values[&format!("{}{}", model.coordinates[coordinate.0 as usize].name, "'".repeat(*order as usize))]
        }
        other => panic!("{other:?}"),
    })
}

/// The values with those of the derived constants, which are read as the definitions of a model.
fn with_derived(values: &Values, constants: &[Derived]) -> Values {
    let named: Vec<&String> = values.keys().filter(|name| !name.contains('\'')).collect();
    let names = named.iter().map(|name| name.as_str()).collect::<Vec<_>>().join(", ");
    let lets: String = constants.iter().map(|c| format!("let {} = {};\n", c.name, c.definition)).collect();
    let forces: String = constants.iter().map(|c| format!("p*ddot(q) + {} = u{};\n", c.name, c.name)).collect();
    let inputs = constants.iter().map(|c| format!("u{}", c.name)).collect::<Vec<_>>().join(", ");
    let text = format!("model M {{ coordinate q; input {inputs}; parameter p; constant {names};\n{lets}{forces}}}");
    let model = parsed(&text).model;
    let mut all = values.clone();
    all.extend(["p", "q''"].map(|name| (name.to_owned(), 0.0)));
    all.extend(constants.iter().map(|c| (format!("u{}", c.name), 0.0)));
    let found = constants.iter().zip(&model.equations).map(|(constant, equation)| {
        let sum: f64 = equation.terms.iter().map(|term| value(&model, term.expr, &all)).sum();
        (constant.name.to_string(), sum)
    });
    let found: Vec<(String, f64)> = found.collect();
    all.extend(found);
    all
}

/// Harmonics of the truncated equations along the pattern, by quadrature, beside those of the table.
fn agrees(parsed: &Parsed, values: &Values, shape: impl Fn(f64, u32) -> f64, moved: &[(&str, f64, f64)]) {
    let table = table_of(parsed);
    let w = values["w"];
    let all = with_derived(values, &table.constants);
    let symbols: Vec<f64> =
        table.symbols.iter().map(|name| all.get(name.as_str()).copied().unwrap_or(f64::NAN)).collect();
    let (model, _) = parsed.for_tables().expect("regular");
    let samples = 64;
    let rows: Vec<Vec<f64>> = model
        .equations
        .iter()
        .map(|equation| {
            (0..samples)
                .map(|n| {
                    let angle = TAU * f64::from(n) / f64::from(samples);
                    let mut at = values.clone();
                    for (name, start, amplitude) in moved {
                        for order in 0..3 {
                            let value = amplitude * w.powi(order as i32) * shape(angle, order);
                            let offset = if order == 0 { *start } else { 0.0 };
                            at.insert(format!("{name}{}", "'".repeat(order as usize)), offset + value);
                        }
                    }
                    equation.terms.iter().map(|term| value(&model, term.expr, &at)).sum()
                })
                .collect()
        })
        .collect();
    let scale = rows.iter().flatten().fold(0.0_f64, |most, value| most.max(value.abs()));
    assert!(scale > 0.1);
    for (row, forces) in rows.iter().enumerate() {
        for harmonic in 0..=12 {
            for function in [Trig::Cos, Trig::Sin] {
                let weight = if harmonic == 0 { 1.0 } else { 2.0 } / f64::from(samples);
                let wave = |n: usize| {
                    let angle = TAU * (n * harmonic) as f64 / f64::from(samples);
                    if function == Trig::Cos { angle.cos() } else { angle.sin() }
                };
                let integral: f64 = forces.iter().enumerate().map(|(n, value)| weight * value * wave(n)).sum();
                let exact: f64 = table
                    .entries()
                    .filter(|entry| (entry.equation, entry.harmonic, entry.function) == (row, harmonic, function))
                    .map(|entry| {
                        let parameter = entry.column.map_or(1.0, |column| values[table.parameters[column].as_str()]);
                        parameter * table.evaluate(&entry, &symbols)
                    })
                    .sum();
                assert!((integral - exact).abs() < 1e-11 * scale, "{row} {harmonic} {function:?}: {integral} {exact}");
            }
        }
    }
}

fn rest_to_rest(angle: f64, order: u32) -> f64 {
    let wave = |factor: f64| factor.powi(order as i32) * (factor * angle + f64::from(order) * TAU / 4.0).cos();
    wave(1.0) - wave(3.0) / 9.0
}

fn values(list: &[(&str, f64)]) -> Values {
    list.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
}

#[test]
fn a_pendulum_about_an_angle_that_is_known_at_run_time_has_a_table() {
    let text = "model P { coordinate th [rad]; input u [N*m]; parameter J [kg*m^2], g1 [N*m]; constant th0 [rad];
        taylor th about th0 order 3; J*ddot(th) + g1*sin(th)*cos(th) + g1/(2 + cos(th0))*th = u;
        pattern { amplitude lambda [rad]; frequency w [rad/s]; th = th0 + lambda*(cos(w*t) - 1/9*cos(3*w*t)); } }";
    let parsed = parsed(text);
    let table = table_of(&parsed);
    let definitions: Vec<&str> = table.constants.iter().map(|c| c.definition.as_str()).collect();
    assert!(definitions.contains(&"cos(th0)") && definitions.contains(&"1/(2 + s1)"), "{definitions:?}");
    let values = values(&[("J", 1.3), ("g1", 2.1), ("th0", 0.7), ("lambda", 0.4), ("w", 2.0), ("u", 0.0)]);
    agrees(&parsed, &values, rest_to_rest, &[("th", 0.7, 0.4)]);
}

/// Feng, A.11: the closed-loop arm with its links, f1 to f3 by their Taylor polynomials about th20, in either way of saying so.
#[test]
fn the_links_of_the_closed_loop_arm_have_a_table_about_the_start() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/linkages/closed_loop_arm_links.tpm");
    let links = std::fs::read_to_string(path).expect("shipped");
    let whole = links.replace("constant th10 [rad], th20 [rad];", "$0\n    taylor th2 about th20 order 2;");
    let whole = whole.replace("$0", "constant th10 [rad], th20 [rad];");
    let mut functions = links.clone();
    for (name, coefficients) in [("f1", "a10, a11, a12"), ("f2", "a20, a21, a22"), ("f3", "a30, a31, a32")] {
        let start = functions.find(&format!("let {name} = ")).expect("declared");
        let end = start + functions[start..].find(';').expect("ended");
        functions.insert_str(end, &format!(" about th20 order 2 as {coefficients}"));
        functions = functions.replace(&format!("let {name} ="), &format!("series {name}(th2) ="));
    }
    let mut at = values(&[("l2", 0.437018273), ("l3", 0.431160162), ("l4", 0.100730344), ("l5", 0.698343839)]);
    at.extend(values(&[("th10", 0.0), ("th20", 5.42161682), ("lambda1", -0.245), ("lambda2", 0.199), ("w", 2.0)]));
    at.extend((1..=8).map(|i| (format!("A{i}"), 0.3 + 0.17 * f64::from(i))));
    at.extend(values(&[("tau1", 0.0), ("tau2", 0.0)]));
    let moved = [("th1", -8.0 / 9.0 * at["lambda1"], at["lambda1"]), ("th2", 5.42161682 - 8.0 / 9.0 * 0.199, 0.199)];
    for text in [&whole, &functions] {
        agrees(&parsed(text), &at, rest_to_rest, &moved);
    }
    // The coefficients by name are those of the functions: against differences of the functions themselves.
    let model = parsed(&functions).model;
    let exact = parsed(&links).model;
    let f3 = |th2: f64| {
        // With th2'' = 1 and all else at rest the first equation is f3.
        let mut at = at.clone();
        for name in ["th1", "th1'", "th1''", "th2'"] {
            at.insert(name.to_owned(), 0.0);
        }
        at.insert("th2".to_owned(), th2);
        at.insert("th2''".to_owned(), 1.0);
        exact.equations[0].terms.iter().map(|term| value(&exact, term.expr, &at)).sum::<f64>()
    };
    let (th20, h) = (at["th20"], 1e-3);
    let expected = [
        f3(th20),
        (f3(th20 + h) - f3(th20 - h)) / (2.0 * h),
        (f3(th20 + h) - 2.0 * f3(th20) + f3(th20 - h)) / (2.0 * h * h),
    ];
    for (name, expected) in ["a30", "a31", "a32"].iter().zip(expected) {
        let lump = model.lumps.iter().find(|lump| lump.name == *name).expect("named");
        let found = value(&model, lump.expr, &at);
        assert!((found - expected).abs() < 1e-4 * expected.abs().max(1.0), "{name}: {found} {expected}");
    }
}
