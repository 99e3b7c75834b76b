//! From text to the exact model: what the shipped models say, against the equations of their sources.

use crate::support::{parse, text_of};
use std::collections::BTreeMap;
use tpm_codegen::{Parsed, Source, parse_model, parse_tokens};
use tpm_symbolic::algebra::fourier::Fourier;
use tpm_symbolic::expr::graph::Node;
use tpm_symbolic::harmonic::expand::{ExpandError, expand};
use tpm_symbolic::number::rational::{display, ratio};
use tpm_symbolic::regressor::form::{RegressorError, RegressorForm, regressor_form};

fn shipped(name: &str) -> Parsed {
    parse(&text_of(name))
}

fn form(parsed: &Parsed) -> RegressorForm {
    regressor_form(&parsed.model).unwrap_or_else(|error| panic!("{error}"))
}

fn errors(text: &str) -> Vec<String> {
    let source = Source::new("test", text);
    match parse_model(&source) {
        Ok(_) => panic!("accepted: {text}"),
        Err(errors) => errors.iter().map(tpm_codegen::Diagnostic::headline).collect(),
    }
}

/// The left-hand side minus the right-hand side of every equation at a state that depends on names only.
fn residuals(parsed: &Parsed, seed: u64) -> Vec<f64> {
    let value = |name: &str, order: u32| {
        let mut hash = seed ^ 0x9e37_79b9_7f4a_7c15;
        for byte in name.bytes().chain([order as u8]) {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            hash ^= hash >> 29;
        }
        (hash % 10_007) as f64 / 5000.0 - 1.0
    };
    let model = &parsed.model;
    let leaf = |node: &Node| match node {
        Node::Symbol(symbol) => value(&model.quantity(*symbol).name, 0),
        Node::Derivative(coordinate, order) => value(&model.coordinates[coordinate.0 as usize].name, *order),
        _ => f64::NAN,
    };
    let equation = |equation: &tpm_symbolic::mechanics::model::Equation| {
        equation.terms.iter().map(|term| model.graph.evaluate(term.expr, leaf)).sum()
    };
    model.equations.iter().map(equation).collect()
}

fn assert_same_dynamics(left: &Parsed, right: &Parsed) {
    for seed in 0..200 {
        let (a, b) = (residuals(left, seed), residuals(right, seed));
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(&b) {
            assert!((a - b).abs() <= 1e-12 * (1.0 + a.abs()), "{a} {b}");
        }
    }
}

/// Coefficients of a table by harmonic, function, parameter and powers.
type Entries = BTreeMap<(usize, String, String, Vec<(String, i32)>), String>;

fn entries(parsed: &Parsed, equation: usize) -> Entries {
    let form = form(parsed);
    let table = expand(&parsed.model, &form, &parsed.model.patterns[0]).unwrap_or_else(|error| panic!("{error}"));
    table
        .entries()
        .filter(|entry| entry.equation == equation)
        .map(|entry| {
            let parameter = entry.column.map_or_else(String::new, |column| form.columns[column].name.to_string());
            let powers = entry
                .powers
                .factors()
                .map(|(&symbol, power)| (parsed.model.symbols[symbol].name.to_string(), power))
                .collect();
            ((entry.harmonic, entry.function.name().to_owned(), parameter, powers), display(&entry.coefficient))
        })
        .collect()
}

#[test]
fn the_table_of_3_26_comes_out_of_the_file() {
    let parsed = shipped("mass_spring_drag");
    let mut expected = Entries::new();
    let mut put = |harmonic, parameter: &str, powers: &[(&str, i32)], coefficient: &str| {
        let powers = powers.iter().map(|&(name, power)| (name.to_owned(), power)).collect();
        expected.insert((harmonic, "cos".to_owned(), parameter.to_owned(), powers), coefficient.to_owned());
    };
    let (mass, spring, drag) = ([("lambda", 1), ("w", 2)], [("lambda", 1)], [("lambda", 2), ("w", 2)]);
    put(1, "m", &mass, "-1");
    put(3, "m", &mass, "1");
    put(1, "k1", &spring, "1");
    put(3, "k1", &spring, "-1/9");
    put(0, "k2", &drag, "5/9");
    put(2, "k2", &drag, "-5/6");
    put(4, "k2", &drag, "1/3");
    put(6, "k2", &drag, "-1/18");
    assert_eq!(entries(&parsed, 0), expected);
}

#[test]
fn a_series_is_its_taylor_polynomial_with_new_parameters() {
    // Feng, Eqn B.1: entries of the first harmonic, and the two of a12 that the thesis leaves out.
    let parsed = shipped("closed_loop_arm");
    let found = entries(&parsed, 0);
    let get = |harmonic, parameter: &str, powers: &[(&str, i32)]| {
        let powers = powers.iter().map(|&(name, power)| (name.to_owned(), power)).collect();
        found.get(&(harmonic, "cos".to_owned(), parameter.to_owned(), powers)).map(String::as_str)
    };
    assert_eq!(get(1, "a10", &[("lambda1", 1), ("w", 2)]), Some("-2"));
    assert_eq!(get(1, "a11", &[("lambda1", 1), ("lambda2", 1), ("w", 2)]), Some("16/9"));
    assert_eq!(get(1, "a12", &[("lambda1", 1), ("lambda2", 2), ("w", 2)]), Some("-55/27"));
    assert_eq!(get(7, "a12", &[("lambda1", 1), ("lambda2", 2), ("w", 2)]), Some("-49/162"));
    assert_eq!(get(9, "a12", &[("lambda1", 1), ("lambda2", 2), ("w", 2)]), Some("1/54"));
    assert!(found.keys().all(|(_, _, _, powers)| powers.iter().all(|(name, _)| name != "th20" && name != "th10")));
    // Their units follow from the torque's: kg m^2 for every one, since rad is 1.
    let unit = |name: &str| {
        let quantity = parsed.model.symbols.iter().find(|quantity| quantity.name == name).expect("declared");
        quantity.unit.as_ref().map(ToString::to_string)
    };
    assert_eq!(unit("a10").as_deref(), Some("kg*m^2"));
    assert_eq!(unit("a32").as_deref(), Some("kg*m^2"));
}

#[test]
fn the_cart_pendulum_s_energies_give_6_6_and_6_7() {
    let explicit = parse(
        "model A {
            coordinate x [m], theta [rad]; input F [N], tau [N*m]; parameter M [kg], m [kg], L [m];
            m*L*(ddot(theta)*cos(theta) - dot(theta)^2*sin(theta)) + (M + m)*ddot(x) = F;
            m*L*ddot(x)*cos(theta) + m*L^2*ddot(theta) = tau;
        }",
    );
    let derived = shipped("cart_pendulum");
    assert_same_dynamics(&derived, &explicit);
    let names: Vec<_> = derived.model.equations.iter().map(|equation| equation.name.as_str()).collect();
    assert_eq!(names, ["F", "tau"]);
    assert_eq!(derived.taylor.len(), 1);
    assert_eq!(derived.taylor[0].order, 8);
}

#[test]
fn the_rotary_pendulum_s_energies_give_fong_s_eqns_3_and_26() {
    let quantities = "input e [V];
        parameter m2 [kg], l1 [m], c2 [m], J1 [kg*m^2], J2 [kg*m^2], C1 [N*m*s/rad], C2 [N*m*s/rad], Kb [V*s/rad];
        constant g = 9.8 [m/s^2], Kt [N*m/A], Ku [1], Rm [ohm];";
    let up = parse(&format!(
        "model A {{
            coordinate th1 [rad], th2 [rad]; {quantities}
            (J1 + m2*l1^2 + m2*c2^2*sin(th2)^2)*ddot(th1) - m2*l1*c2*cos(th2)*ddot(th2)
                + (C1 + 1/2*m2*c2^2*dot(th2)*sin(2*th2))*dot(th1)
                + (m2*l1*c2*dot(th2)*sin(th2) + 1/2*m2*c2^2*dot(th1)*sin(2*th2))*dot(th2)
                = Kt*Ku/Rm*e - Kt*Kb/Rm*dot(th1);
            -m2*l1*c2*cos(th2)*ddot(th1) + (J2 + m2*c2^2)*ddot(th2)
                - 1/2*m2*c2^2*dot(th1)*sin(2*th2)*dot(th1) + C2*dot(th2) - m2*c2*g*sin(th2) = 0;
        }}"
    ));
    assert_same_dynamics(&shipped("rotary_pendulum"), &up);
    let down = parse(&format!(
        "model A {{
            coordinate th1 [rad], alpha2 [rad]; {quantities}
            (J1 + m2*l1^2 + m2*c2^2*sin(alpha2)^2)*ddot(th1) + m2*l1*c2*cos(alpha2)*ddot(alpha2)
                + (C1 + 1/2*m2*c2^2*dot(alpha2)*sin(2*alpha2))*dot(th1)
                + (-m2*l1*c2*dot(alpha2)*sin(alpha2) + 1/2*m2*c2^2*dot(th1)*sin(2*alpha2))*dot(alpha2)
                = Kt*Ku/Rm*e - Kt*Kb/Rm*dot(th1);
            m2*l1*c2*cos(alpha2)*ddot(th1) + (J2 + m2*c2^2)*ddot(alpha2)
                - 1/2*m2*c2^2*dot(th1)*sin(2*alpha2)*dot(th1) + C2*dot(alpha2) + m2*c2*g*sin(alpha2) = 0;
        }}"
    ));
    assert_same_dynamics(&shipped("rotary_pendulum_down"), &down);
}

#[test]
fn every_shipped_model_has_a_regressor_form() {
    for (name, columns) in [
        ("mass_spring_drag", "m k1 k2"),
        ("closed_loop_arm", "a10 a11 a12 a20 a21 a22 a30 a31 a32"),
        ("emps", "M Fv Fc OF"),
        ("silverbox", "m d k1 k3"),
        ("brushless_motor", "kt J R L kv"),
    ] {
        let form = form(&shipped(name));
        let names: Vec<_> = form.columns.iter().map(|column| column.name.as_str()).collect();
        let mut expected: Vec<_> = columns.split(' ').collect();
        let mut sorted = names.clone();
        sorted.sort_unstable();
        expected.sort_unstable();
        assert_eq!(sorted, expected, "{name}");
    }
    for name in ["two_carts", "three_carts", "cart_pendulum", "rotary_pendulum", "rotary_pendulum_down"] {
        assert!(!form(&shipped(name)).columns.is_empty(), "{name}");
    }
}

#[test]
fn numbers_of_a_machine_are_cut_in_the_names_of_lumped_parameters() {
    let parsed = parse(
        "model Arm {
            coordinate q; input u; parameter m1, m2, m3, J; constant l1 = 0.537464253, l2 = 0.000123456789, l3 = 1/3;
            (J + m1*l1^2 + m2*l2 - m3*l3)*ddot(q) = u;
        }",
    );
    let names: Vec<_> = form(&parsed).columns.iter().map(|column| column.name.clone()).collect();
    // The ratios themselves stay exact.
    assert_eq!(names, ["m1_plus_2137_m2_per_5000000_minus_577_m3_per_500_plus_1731_J_per_500"]);
}

#[test]
fn models_for_logs_keep_the_names_of_their_quantities() {
    let emps = shipped("emps").model;
    assert_eq!((emps.name.as_str(), emps.coordinates[0].name.as_str()), ("Emps", "q"));
    let names: Vec<_> = emps.symbols.iter().map(|quantity| quantity.name.as_str()).collect();
    assert_eq!(names[..5], ["force", "M", "Fv", "Fc", "OF"]);
    let silverbox = shipped("silverbox").model;
    let names: Vec<_> = silverbox.symbols.iter().map(|quantity| quantity.name.as_str()).collect();
    assert_eq!(names[..5], ["u", "m", "d", "k1", "k3"]);
}

#[test]
fn motions_are_exact_fourier_polynomials() {
    let parsed = parse(
        "model A {
            coordinate x, y, z, v; input u; parameter m; constant c = 3/2, x0; m*ddot(x) + y + z + v = u;
            pattern slow {
                amplitude a, b; frequency w; harmonics 21;
                x = point_to_point(1, -3, w, 3);
                y = c + a*(cos(w*t)^2 - sin(-3*w*t)/2);
                z = rest_to_rest(a*b/x0, 2*w, 5);
                v = a/w*sin(t*w*2/2);
            }
            pattern fast { amplitude a; frequency w; x = a*cos(w*t); }
        }",
    );
    let slow = parsed.model.pattern(Some("slow")).expect("slow");
    let series = |coordinate: usize, part: usize| {
        let motion = slow.motions[coordinate].as_ref().expect("a motion");
        motion.terms().nth(part).expect("a part").clone()
    };
    // Feng, Eqns 2.17-2.20 with x0 = 1, x1 = -3: a0 = -1, a1 = 9 (1 + 3)/16, a3 = -(1 + 3)/16.
    let x = series(0, 0).1;
    assert_eq!(
        (x.cos_coefficient(0), x.cos_coefficient(1), x.cos_coefficient(3)),
        (ratio(-1, 1), ratio(9, 4), ratio(-1, 4))
    );
    assert_eq!((x.at_zero(), x.at_pi()), (ratio(1, 1), ratio(-3, 1)));
    let (y0, y1) = (series(1, 0).1, series(1, 1).1);
    let expected = Fourier::constant(ratio(1, 2)).add(&Fourier::cos(2, ratio(1, 2))).add(&Fourier::sin(3, ratio(1, 2)));
    assert!(
        (y0 == Fourier::constant(ratio(3, 2)) && y1 == expected)
            || (y1 == Fourier::constant(ratio(3, 2)) && y0 == expected)
    );
    let (monomial, z) = series(2, 0);
    let powers: Vec<_> =
        monomial.factors().map(|(symbol, power)| (parsed.model.quantity(*symbol).name.as_str(), power)).collect();
    assert_eq!(powers, [("x0", -1), ("a", 1), ("b", 1)]);
    assert_eq!(
        (z.cos_coefficient(2), z.cos_coefficient(6), z.cos_coefficient(10)),
        (ratio(1, 1), ratio(-1, 6), ratio(1, 50))
    );
    assert_eq!(series(3, 0).1, Fourier::sin(1, ratio(1, 1)));
    assert_eq!([0, 1, 2].map(|pattern| parsed.harmonics_of(pattern)), [Some(21), None, None]);
    // Both patterns share the amplitude `a` and the frequency.
    assert_eq!(parsed.model.patterns[0].frequency, parsed.model.patterns[1].frequency);
    assert_eq!(parsed.model.patterns[0].amplitudes[0], parsed.model.patterns[1].amplitudes[0]);
}

#[test]
fn a_known_series_has_the_derivatives_as_coefficients() {
    let parsed = parse(
        "model A {
            coordinate q; input u; parameter m, k; constant q0;
            series s(q) = k*sin(q) about 0 order 3 as s0, s1, s2, s3;
            series r(q) = 1/q about q0 order 1;
            m*ddot(q) + s + r = u;
        }",
    );
    let by_hand = parse(
        "model A {
            coordinate q; input u; parameter m, k; constant q0;
            m*ddot(q) + k*(q - q^3/6) + 1/q0 - (q - q0)/q0^2 = u;
        }",
    );
    assert_same_dynamics(&parsed, &by_hand);
    let lumps: Vec<_> =
        parsed.model.lumps.iter().map(|lump| format!("{}={}", lump.name, parsed.model.display(lump.expr))).collect();
    assert_eq!(lumps[1], "s1=k");
}

#[test]
fn later_errors_point_at_the_text() {
    let text = "model A {\n coordinate x; input u; parameter m, k;\n m*ddot(x)\n + sin(k*x) = u;\n}";
    let parsed = parse(text);
    let error = regressor_form(&parsed.model).expect_err("a parameter inside a sine");
    assert!(matches!(error, RegressorError::InsideFunction { .. }));
    let diagnostic = parsed.locate(&error);
    assert_eq!(Source::new("test", text).slice(diagnostic.span), "sin(k*x)");

    let text = "model A { coordinate th; input u; parameter m, k; kinetic = 1/2*m*dot(th)^2; potential = -k*cos(th); force th = u;
        pattern { amplitude a; frequency w; th = a*cos(w*t); } }";
    let parsed = parse(text);
    let form = form(&parsed);
    let error = expand(&parsed.model, &form, &parsed.model.patterns[0]).expect_err("not finite");
    assert!(matches!(error, ExpandError::NotFinite { .. }));
    assert_eq!(Source::new("test", text).slice(parsed.locate(&error).span), "-k*cos(th)");
}

#[test]
fn what_has_no_value_is_an_error_at_its_place() {
    let frame =
        |equation: &str| format!("model A {{ coordinate x; input u; parameter m; m*ddot(x) + {equation} = u; }}");
    for (equation, part) in [
        ("x/(1 - 1)", "division by zero"),
        ("x/0", "division by zero"),
        ("sqrt(-2)*x", "no real number"),
        ("asin(2)*x", "no real number"),
        ("atan2(0, 0)", "no angle"),
        ("10^4294967295*x", "too large"),
        ("10^300000*x", "too large"),
        ("x^4294967295", "too large"),
        ("der(x, 4294967295)", "at most 100"),
        ("der(dot(x), 100)", "at most 100"),
    ] {
        let found = errors(&frame(equation));
        assert!(found.len() == 1 && found[0].contains(part), "{equation}: {found:?}");
    }
    let found = errors("model A { coordinate x; input u; parameter m; let y = u*x; m*dot(y) = u; }");
    assert!(found[0].contains("the input `u` has no time derivative"), "{found:?}");
    let found =
        errors("model A { coordinate x; input u; parameter m; series f(x) = sqrt(x) about 0 order 2; m*f = u; }");
    assert!(found[0].contains("singular"), "{found:?}");
    let found =
        errors("model A { coordinate x; input u; parameter m; constant a = 10^100000, b = 1/(a - a); m*a*b*x = u; }");
    assert!(found.len() == 2 && found[0].contains("too large"), "{found:?}");
}

#[test]
fn what_is_no_finite_series_is_refused() {
    let frame = |motion: &str| {
        format!(
            "model A {{ coordinate x; input u; parameter m; m*ddot(x) = u; pattern {{ amplitude a; frequency w; x = {motion}; }} }}"
        )
    };
    for (motion, part) in [
        ("a*w*cos(w)", "not an integer multiple"),
        ("a*cos(w*t + 1)", "not an integer multiple"),
        ("a*cos(w*t/2)", "a fraction of it"),
        ("a*cos(a*w*t)", "not an integer multiple"),
        ("a*w*t", "inside sine and cosine"),
        ("a*sqrt(cos(w*t))", "does not make a finite"),
        ("a/cos(w*t)", "divided by numbers"),
        ("a*pi*cos(w*t)", "rational"),
        ("a/0*cos(w*t)", "division by zero"),
        ("a*cos(1000000000000000000000*w*t)", "harmonics up to"),
        ("a*cos(w*t)^4294967295", "harmonics up to"),
        ("a*cos(4000*w*t)^2", "harmonics up to"),
        ("rest_to_rest(a, w/2, 3)", "positive integer multiple"),
        ("rest_to_rest(a, 2000*w, 3)", "harmonics up to"),
        ("rest_to_rest(a*cos(w*t), w, 3)", "does not change"),
        ("rest_to_rest(a, w, 1001)", "beyond"),
    ] {
        let found = errors(&frame(motion));
        assert!(found.len() == 1 && found[0].contains(part), "{motion}: {found:?}");
    }
}

#[test]
fn shapes_meet_the_end_conditions_of_their_clauses() {
    let parsed = parse(
        "model A {
            coordinate x [m], y [m], z [m], v [m]; input u; parameter m; constant x0 [m]; m*ddot(x) + y + z + v = u;
            pattern {
                amplitude a [m], rate [m/s]; frequency w [rad/s];
                x = shape(w, start(x0), end(pi, a), rest(3));
                y = point_to_point(x0, a, w, 3);
                z = shape(w, rest(3), cosines(1, 5), amplitude(a));
                v = shape(2*w, start(0, rate), end(pi/2, 0, 0), harmonics(1, 2));
            }
        }",
    );
    let motions = &parsed.model.patterns[0].motions;
    // Feng, Eqn 2.20 follows from the end conditions alone, without a choice of harmonics.
    assert_eq!(motions[0], motions[1]);
    let z: Vec<_> = motions[2].as_ref().expect("a motion").terms().collect();
    assert_eq!(z[0].1, Fourier::cos(1, ratio(1, 1)).add(&Fourier::cos(5, ratio(-1, 25))));
    let v: Vec<_> = motions[3].as_ref().expect("a motion").terms().collect();
    let powers: Vec<_> = v[0].0.factors().map(|(s, power)| (parsed.model.quantity(*s).name.as_str(), power)).collect();
    assert_eq!((v.len(), powers), (1, vec![("rate", 1), ("w", -1)]));
    // v' = w dv/dtheta is the given rate at the start, and zero at the end, where twice the phase is pi/2.
    let rate = v[0].1.derivative(1);
    assert_eq!((v[0].1.at_zero(), rate.at_zero()), (ratio(0, 1), ratio(1, 1)));
    let end = std::f64::consts::FRAC_PI_4;
    assert!(v[0].1.evaluate(end).abs() < 1e-15 && rate.evaluate(end).abs() < 1e-15);
}

#[test]
fn shapes_that_cannot_be_are_refused_with_the_reason() {
    let frame = |motion: &str| {
        format!(
            "model A {{ coordinate x [m]; input u; parameter m; m*ddot(x) = u; pattern {{ amplitude a [m], v [m/s]; frequency w [rad/s]; x = {motion} + 0*a + 0*v/w; }} }}"
        )
    };
    for (motion, part) in [
        ("shape()", "begins with its frequency"),
        ("shape(w, a)", "no clause of `shape`"),
        ("shape(w, begin(a))", "no clause of `shape`"),
        ("shape(w, rest(3))", "nothing moves"),
        ("shape(w)", "nothing moves"),
        ("shape(w, harmonics(1))", "nothing moves"),
        ("shape(w, harmonics())", "nothing moves"),
        ("shape(w, amplitude(a), sines(1))", "coefficient of its lowest cosine"),
        ("shape(w, end())", "does not take these values"),
        ("shape(w, rest(1, 2), start(a))", "does not take these values"),
        ("shape(w, rest(1/2), start(a))", "whole number"),
        ("shape(w, start(a), end(-pi, 0))", "positive phase"),
        ("shape(w, start(a), end(1, 0))", "no phase at which a motion ends"),
        ("shape(w, start(a), end(pi/3, 0), rest(1))", "not both rational"),
        ("shape(w, start(a, a), end(pi, a))", "unit mismatch"),
        ("shape(2, start(a), end(pi, a))", "unit mismatch"),
        ("shape(w, start(a*cos(w*t)), end(pi, a))", "does not change"),
        (
            "shape(w, start(a), end(pi, 0), rest(3), harmonics(1, 2))",
            "harmonics up to 3 are the least that can, with cos 1, cos 3",
        ),
        ("shape(w, start(a), end(2*pi, 0))", "no finite series does"),
        ("shape(w, start(a), end(pi, 0), cosines(0, 1))", "not harmonic 0"),
        ("shape(w, start(a), end(pi, 0), rest(100))", "not derivative 32"),
    ] {
        let found = errors(&frame(motion));
        assert!(found.len() == 1 && found[0].contains(part), "{motion}: {found:?}");
    }
    // An angle that is no admissible phase is answered with one next to it.
    let source = Source::new("test", frame("shape(w, start(a), end(1, 0))"));
    let errors = parse_model(&source).map(|_| ()).expect_err("refused").render(&source);
    assert!(errors.contains("`2*atan2(6, 11)`, which is 0.9987, lies next to 1.0000"), "{errors}");
}

#[test]
fn energies_that_give_no_equations_are_refused_at_their_term() {
    let frame = |energies: &str| {
        format!(
            "model A {{ coordinate x, y; input u; parameter m, k; {energies} force x = u; kinetic = 1/2*m*dot(x)^2 + 1/2*k*dot(y)^2; }}"
        )
    };
    for (energies, part) in [
        ("potential = k*x + k*dot(x);", "must not depend on `dot(x)`"),
        ("potential = u*x;", "the input `u` stands in an energy"),
        ("dissipation = k*ddot(x)^2;", "must not depend on `ddot(x)`"),
    ] {
        let found = errors(&frame(energies));
        assert!(found.len() == 1 && found[0].contains(part), "{energies}: {found:?}");
    }
}

#[test]
fn a_macro_s_tokens_give_the_same_model_as_the_file() {
    for name in ["mass_spring_drag", "two_carts", "closed_loop_arm", "rotary_pendulum_down", "emps", "silverbox"] {
        let stream = text_of(name).parse().expect("Rust tokens");
        let (parsed, tokens) = parse_tokens("model!", stream).unwrap_or_else(|errors| panic!("{errors}"));
        let mut from_tokens = parsed.ast.clone();
        let mut from_file = shipped(name).ast;
        from_tokens.forget_spans();
        from_file.forget_spans();
        assert_eq!(from_tokens, from_file);
        let term = parsed.model.equations[0].terms[0];
        assert!(tokens.tokens_at(parsed.span(term.id)).0.start().line > 1);
    }
}

#[test]
fn a_macro_s_faults_are_on_the_user_s_tokens() {
    let text = "model A {
        coordinate x [m];
        input u [N];
        parameter m [kg], k [N/m], type [kg]
        m*ddot(x) + k*dot(x) = u;
        3w*x = u;
    }";
    let errors = parse_tokens("model!", text.parse().expect("Rust tokens")).map(|_| ()).expect_err("three faults");
    let mut found = Vec::new();
    let trees: Vec<_> = errors.into_iter().collect();
    for item in trees.chunks(8) {
        let place = item[0].span().start();
        found.push((place.line, place.column, item[7].to_string()));
    }
    found.sort_by_key(|&(line, column, _)| (line, column));
    let places: Vec<_> = found.iter().map(|&(line, column, _)| (line, column)).collect();
    // The unused `type`, the missing semicolon behind its unit, the term with the wrong unit, and `3w` with its unknown name.
    assert_eq!(places, [(4, 35), (4, 43), (5, 20), (6, 8), (6, 8)]);
    assert!(
        found[1].2.contains("a `;` is missing")
            && found[2].2.contains("unit mismatch")
            && found[3].2.contains("write `3*w`")
    );
}
