//! Equations of motion from energies and their linearisation, against the printed equations of Feng (5.1, 5.2, 6.6,
//! 6.7) and Fong (3, 15, 20, 22-24, 26-28).

use crate::common::{Build, E};
use tpm_symbolic::expr::graph::{Coordinate, ExprId, Function, Symbol};
use tpm_symbolic::expr::trigonometric;
use tpm_symbolic::linear::linearize::{LinearizeError, OperatingPoint, linearize, substitute_coordinate};
use tpm_symbolic::mechanics::lagrange::{EulerLagrange, LagrangeError, Lagrangian, euler_lagrange};
use tpm_symbolic::mechanics::model::{Equation, Kind};
use tpm_symbolic::number::rational::{self, Rational, integer, ratio};

fn derive(b: &Build, lagrangian: &Lagrangian) -> EulerLagrange {
    b.model(|model| euler_lagrange(model, lagrangian)).expect("energies of a mechanical system")
}

fn row(b: &Build, equation: &Equation) -> E {
    b.e(b.graph(|g| g.sum(&equation.terms.iter().map(|term| term.expr).collect::<Vec<_>>())))
}

/// Derived equations agree with the printed ones, left minus right-hand sides; their text is kept as a snapshot.
fn check(name: &str, b: &Build, derived: &EulerLagrange, printed: &[E]) {
    let residual = b.model(|model| derived.residual(model));
    assert_eq!(derived.equations.len(), printed.len());
    for ((equation, residual), printed) in derived.equations.iter().zip(residual).zip(printed) {
        let found = row(b, equation);
        assert!(b.is_zero(&(&found - printed)), "{}", b.model(|m| m.display(found.id)));
        assert!(b.is_zero(&(b.e(residual) - found)));
    }
    let mut text = String::new();
    for equation in &derived.equations {
        text += &format!("{}: {} = 0\n", equation.name, simplest(b, row(b, equation).id));
    }
    let matrices = [("M", Some(&derived.mass)), ("C", Some(&derived.coriolis)), ("D", derived.damping.as_ref())];
    for (letter, matrix) in matrices.into_iter().filter_map(|(letter, matrix)| Some((letter, matrix?))) {
        text += &entries(b, letter, matrix);
    }
    text += &entries(b, "G", &derived.gravity.iter().map(|entry| vec![*entry]).collect::<Vec<_>>());
    insta::assert_snapshot!(name, text);
}

/// The shorter text of an expression: as it stands, or multiplied out in single angles.
fn simplest(b: &Build, expr: ExprId) -> String {
    b.model(|m| {
        let simplified = trigonometric::simplify(&mut m.graph, expr);
        let texts = [m.display(expr), m.display(simplified)];
        texts.into_iter().min_by_key(String::len).unwrap_or_default()
    })
}

/// The entries of a matrix that are not zero, a line each.
fn entries(b: &Build, letter: &str, matrix: &[Vec<ExprId>]) -> String {
    let mut text = String::new();
    for (i, row) in matrix.iter().enumerate() {
        for (j, entry) in row.iter().enumerate() {
            let entry = simplest(b, *entry);
            if entry != "0" {
                text += &format!("{letter}[{}, {}] = {entry}\n", i + 1, j + 1);
            }
        }
    }
    text
}

fn same(b: &Build, found: ExprId, expected: &E) {
    let difference = b.e(found) - expected;
    assert!(b.is_zero(&difference), "{} is not {}", b.model(|m| m.display(found)), b.model(|m| m.display(expected.id)));
}

#[test]
fn feng_5_1_and_5_2_from_the_energy() {
    // L = f1 th1'^2 + f3 th1' th2' + f2 th2'^2, f_i any function of th2: here polynomials of degree 5 with free
    // coefficients, whose derivatives up to the fifth are independent, besides a transcendental one.
    let b = Build::new();
    let (th1, th2) = (b.coordinate("th1"), b.coordinate("th2"));
    let ([_, v1, a1], [q2, v2, a2]) = (b.motion(th1), b.motion(th2));
    let (tau1, tau2) = (b.quantity("tau1", Kind::Input), b.quantity("tau2", Kind::Input));
    let th20 = b.quantity("th20", Kind::Constant { value: None });
    let series = |name: &str| {
        let shifted = &q2 - &th20;
        (0..=5).fold(b.num(0), |sum, k| sum + b.quantity(&format!("{name}{k}"), Kind::Parameter) * shifted.pow(k))
    };
    let (f1, f2, f3) = (series("a1"), series("a2") + q2.sin() * &th20, series("a3") + (2 * &q2).cos());
    let lagrangian = Lagrangian {
        kinetic: b.terms(&[&f1 * v1.pow(2), &f3 * (&v1 * &v2), &f2 * v2.pow(2)]),
        forces: vec![(th1, b.term(&tau1)), (th2, b.term(&tau2))],
        ..Lagrangian::default()
    };
    let derived = derive(&b, &lagrangian);
    let (df1, df2, df3) = (f1.diff(&q2), f2.diff(&q2), f3.diff(&q2));
    let printed = [
        2 * (&f1 * &a1) + &f3 * &a2 + 2 * (&df1 * &v1) * &v2 + &df3 * v2.pow(2) - &tau1,
        &f3 * &a1 + 2 * (&f2 * &a2) - &df1 * v1.pow(2) + &df2 * v2.pow(2) - &tau2,
    ];
    check("feng_5_1_and_5_2", &b, &derived, &printed);
    assert_eq!(derived.equations[0].name, "tau1");
    same(&b, derived.mass[0][0], &(2 * &f1));
    same(&b, derived.mass[0][1], &f3);
    same(&b, derived.mass[1][1], &(2 * &f2));
    same(&b, derived.gravity[1], &b.num(0));
}

#[test]
fn feng_6_6_and_6_7_cart_and_pendulum_in_the_horizontal_plane() {
    let b = Build::new();
    let (x, th) = (b.coordinate("x"), b.coordinate("th"));
    let ([q, v, a], [s, ds, dds]) = (b.motion(x), b.motion(th));
    let (force, tau) = (b.quantity("F", Kind::Input), b.quantity("tau", Kind::Input));
    let [big, m, l] = b.parameters(["M", "m", "L"]);
    // The bob's velocity from its position.
    let (px, py) = (&q + &l * s.sin(), &l * s.cos());
    let half = b.exact(ratio(1, 2));
    let kinetic = [&half * (&big * v.pow(2)), &half * &m * (px.time().pow(2) + py.time().pow(2))];
    let lagrangian = Lagrangian {
        kinetic: b.terms(&kinetic),
        forces: vec![(x, b.term(&force)), (th, b.term(&tau))],
        ..Lagrangian::default()
    };
    let derived = derive(&b, &lagrangian);
    let printed = [
        &m * &l * (&dds * s.cos() - ds.pow(2) * s.sin()) + (&big + &m) * &a - &force,
        &m * &l * &a * s.cos() + &m * l.pow(2) * &dds - &tau,
    ];
    check("feng_6_6_and_6_7", &b, &derived, &printed);
}

/// Fong's pendulum: energies as in the paper, J2 about the pivot with m2 c2^2 added to it once more.
struct Pendulum {
    b: Build,
    coordinates: [Coordinate; 2],
    derived: EulerLagrange,
}

/// Table 1; C2 = 3.168e-4, since the printed value does not give Eqn 24.
const TABLE_1: [(&str, &str); 13] = [
    ("m2", "0.022"),
    ("l1", "0.16"),
    ("c2", "0.08"),
    ("J1", "0.00215058"),
    ("J2", "0.00018773"),
    ("C1", "0.02"),
    ("C2", "3.168e-4"),
    ("g", "9.8"),
    ("Kt", "0.01826"),
    ("Kb", "0.01826"),
    ("Ku", "10"),
    ("Rm", "2.5604"),
    ("m1", "0.056"),
];

/// Fong's pendulum with angle 0 upright (Eqn 3) or hanging down (Eqn 26).
fn pendulum(upright: bool) -> Pendulum {
    let b = Build::new();
    let (th1, th2) = (b.coordinate("th1"), b.coordinate(if upright { "th2" } else { "al2" }));
    let ([q1, v1, _], [q2, v2, _]) = (b.motion(th1), b.motion(th2));
    let e = b.quantity("e", Kind::Input);
    let p: Vec<E> = TABLE_1.iter().map(|(name, _)| b.quantity(name, Kind::Parameter)).collect();
    let [m2, l1, c2, j1, j2, f1, f2, g, kt, kb, ku, rm] = std::array::from_fn(|i| p[i].clone());
    // Centre of mass of the pendulum; it falls to the left of the arm for positive th2.
    let up = if upright { 1 } else { -1 };
    let side = up * (&c2 * q2.sin());
    let position = [&l1 * q1.cos() + &side * q1.sin(), &l1 * q1.sin() - &side * q1.cos(), up * (&c2 * q2.cos())];
    let speed = position.iter().fold(b.num(0), |sum, r| sum + r.time().pow(2));
    let half = b.exact(ratio(1, 2));
    let lagrangian = Lagrangian {
        kinetic: b.terms(&[&half * &j1 * v1.pow(2), &half * &j2 * v2.pow(2), &half * &m2 * speed]),
        potential: b.terms(&[&m2 * &g * &position[2]]),
        dissipation: b.terms(&[&half * &f1 * v1.pow(2), &half * &f2 * v2.pow(2)]),
        forces: vec![(th1, b.term(&(&kt * &ku / &rm * &e))), (th1, b.term(&-(&kt * &kb / &rm * &v1)))],
    };
    let derived = derive(&b, &lagrangian);
    b.model(|model| model.equations.clone_from(&derived.equations));
    Pendulum { b, coordinates: [th1, th2], derived }
}

fn named(b: &Build, name: &str) -> E {
    b.e(b.model(|model| {
        let symbol = model.find_symbol(name).expect("declared");
        model.graph.symbol(symbol)
    }))
}

/// Rows of Fong, Eqn 3 (sign = 1) or 26 (sign = -1): the matrices M, V_m, G and the residual.
type Printed = ([[E; 2]; 2], [[E; 2]; 2], [E; 2], [E; 2]);

fn printed(p: &Pendulum, sign: i64) -> Printed {
    let b = &p.b;
    let [m2, l1, c2, j1, j2, f1, f2, g, kt, kb, ku, rm] = std::array::from_fn(|i| named(b, TABLE_1[i].0));
    let ([_, v1, a1], [q2, v2, a2]) = (b.motion(p.coordinates[0]), b.motion(p.coordinates[1]));
    let half = b.exact(ratio(1, 2));
    let coupling = -(sign * (&m2 * &l1 * &c2 * q2.cos()));
    let centrifugal = &half * &m2 * c2.pow(2) * (2 * &q2).sin();
    let mass = [
        [&j1 + &m2 * l1.pow(2) + &m2 * c2.pow(2) * q2.sin().pow(2), coupling.clone()],
        [coupling, &j2 + &m2 * c2.pow(2)],
    ];
    let velocity = [
        [&f1 + &centrifugal * &v2, sign * (&m2 * &l1 * &c2 * &v2 * q2.sin()) + &centrifugal * &v1],
        [-(&centrifugal * &v1), f2],
    ];
    let gravity = [b.num(0), -(sign * (&m2 * &c2 * &g * q2.sin()))];
    let e = named(b, "e");
    let drive = [&kt * &ku / &rm * e - &kt * &kb / &rm * &v1, b.num(0)];
    let residual = [0, 1].map(|i| {
        &mass[i][0] * &a1 + &mass[i][1] * &a2 + &velocity[i][0] * &v1 + &velocity[i][1] * &v2 + &gravity[i] - &drive[i]
    });
    (mass, velocity, gravity, residual)
}

#[test]
fn fong_3_and_26_from_the_energies() {
    for (upright, sign) in [(true, 1), (false, -1)] {
        let p = pendulum(upright);
        let (mass, velocity, gravity, residual) = printed(&p, sign);
        check(if upright { "fong_3" } else { "fong_26" }, &p.b, &p.derived, &residual);
        let damping = p.derived.damping.as_ref().expect("viscous friction is quadratic");
        for i in 0..2 {
            same(&p.b, p.derived.gravity[i], &gravity[i]);
            for j in 0..2 {
                same(&p.b, p.derived.mass[i][j], &mass[i][j]);
                let found = p.b.e(p.derived.coriolis[i][j]) + p.b.e(damping[i][j]);
                same(&p.b, found.id, &velocity[i][j]);
            }
        }
        assert_eq!(p.derived.equations[0].name, "e");
        assert_eq!(p.derived.equations[1].name, "eq2");
    }
}

#[test]
fn fong_26_by_substitution_of_the_coordinate() {
    let p = pendulum(true);
    let pi = p.b.pi();
    let minus_pi = -pi;
    p.b.model(|model| substitute_coordinate(model, p.coordinates[1], "al2", &integer(1), minus_pi.id))
        .expect("a constant offset");
    let (.., residual) = printed(&p, -1);
    let equations = p.b.model(|model| model.equations.clone());
    for (equation, printed) in equations.iter().zip(&residual) {
        assert!(p.b.is_zero(&(row(&p.b, equation) - printed)));
        for term in &equation.terms {
            let text = p.b.model(|model| model.display(term.expr));
            assert!(!text.contains("pi"), "{text}");
        }
    }
    assert_eq!(p.b.model(|model| model.coordinates[1].name.clone()), "al2");
}

fn table_1(p: &Pendulum) -> impl Fn(Symbol) -> Option<Rational> + use<> {
    let names: Vec<String> = p.b.model(|model| model.symbols.iter().map(|q| q.name.to_string()).collect());
    move |symbol| {
        let (_, value) = TABLE_1.iter().find(|(name, _)| *name == names[symbol.0 as usize])?;
        rational::parse(value)
    }
}

#[test]
fn fong_15_to_28_linearised() {
    // Eqn 24 as printed; Eqn 28 is lost in the OCR, its numbers follow from Eqn 27 (signs of the coupling changed).
    let eqn_24: [[f64; 3]; 2] = [[5.9796, -8.1419, -0.1098], [57.6254, -6.9788, -1.0584]];
    let eqn_28: [[f64; 3]; 2] = [[5.9797, -8.1420, 0.1098], [-57.626, 6.9789, -1.0584]];
    for (upright, sign, rows, input) in [(true, 1, eqn_24, [28.8442, 24.7236]), (false, -1, eqn_28, [28.845, -24.725])]
    {
        let p = pendulum(upright);
        let b = &p.b;
        let linear = b.model(|model| linearize(model, &OperatingPoint::default())).expect("at rest");
        let [m2, l1, c2, j1, j2, f1, f2, g, kt, kb, ku, rm] = std::array::from_fn(|i| named(b, TABLE_1[i].0));
        // Eqn 15
        let (arm, rod) = (&j1 + &m2 * l1.pow(2), &j2 + &m2 * c2.pow(2));
        let coupling = sign * (&m2 * &l1 * &c2);
        let friction = &f1 + &kt * &kb / &rm;
        let drive = &kt * &ku / &rm;
        let gravity = sign * (&m2 * &c2 * &g);
        let zero = b.num(0);
        type Named<'a> = (&'a Vec<Vec<ExprId>>, [[&'a E; 2]; 2]);
        let expected: [Named; 3] = [
            (&linear.mass, [[&arm, &-&coupling], [&-&coupling, &rod]]),
            (&linear.damping, [[&friction, &zero], [&zero, &f2]]),
            (&linear.stiffness, [[&zero, &zero], [&zero, &-&gravity]]),
        ];
        for (found, expected) in expected {
            for i in 0..2 {
                for j in 0..2 {
                    same(b, found[i][j], expected[i][j]);
                }
            }
        }
        same(b, linear.input[0][0], &drive);
        same(b, linear.input[1][0], &zero);
        // Eqns 20, 22 (upright) and 27 (downward), state (th1, th2, th1', th2').
        let determinant = &arm * &rod - coupling.pow(2);
        same(b, linear.determinant, &determinant);
        let mut text = entries(b, "M", &linear.mass) + &entries(b, "D", &linear.damping);
        text += &(entries(b, "K", &linear.stiffness) + &entries(b, "F", &linear.input));
        text += &entries(b, "det", &[vec![linear.determinant]]);
        text += &(entries(b, "A", &linear.a) + &entries(b, "B", &linear.b));
        insta::assert_snapshot!(if upright { "fong_15_to_22" } else { "fong_27" }, text);
        let expected = [
            [zero.clone(), &coupling * &gravity, -(&rod * &friction), -(&coupling * &f2), &rod * &drive],
            [zero.clone(), &arm * &gravity, -(&coupling * &friction), -(&arm * &f2), &coupling * &drive],
        ];
        for (i, row) in expected.iter().enumerate() {
            for (found, expected) in linear.a[2 + i].iter().zip(row) {
                same(b, *found, &(expected / &determinant));
            }
            same(b, linear.b[2 + i][0], &(&row[4] / &determinant));
        }
        // Eqns 24 and 28 in numbers.
        let values = table_1(&p);
        let exact = b.model(|model| linear.evaluate_exact(model, &values)).expect("all values are rational");
        let floats = b.model(|model| linear.evaluate(model, |s| rational::to_f64(&values(s).expect("in Table 1"))));
        for i in 0..2 {
            let numbers: Vec<f64> = exact.a[2 + i].iter().chain(&exact.b[2 + i]).map(rational::to_f64).collect();
            assert_eq!(numbers[0], 0.0);
            for (found, printed) in numbers[1..].iter().zip(rows[i].iter().chain([&input[i]])) {
                // 1e-4 relative; .1098 has only four digits.
                let tolerance = if printed.abs() < 1.0 { 5e-5 } else { 1e-4 * printed.abs() };
                assert!((found - printed).abs() <= tolerance, "{found} {printed}");
            }
            for (found, exact) in floats.a[2 + i].iter().chain(&floats.b[2 + i]).zip(&numbers) {
                assert!((found - exact).abs() <= 1e-14 * exact.abs(), "{found} {exact}");
            }
        }
        assert_eq!(exact.a[0], [0, 0, 1, 0].map(integer));
        let output = [0, 1, 0, 0].map(integer);
        let transfer = exact.transfer_function(&output, 0).expect("four states, one input");
        // th1 is a free integrator that al2 does not see: one factor s cancels.
        assert_eq!(transfer.denominator.len(), 4);
        assert_eq!(exact.characteristic_polynomial()[0], integer(0));
        assert_eq!(transfer.evaluate(&integer(0)), Some(integer(0)), "no displacement at rest");
        if !upright {
            // G = -24.72 s / (s^3 + 9.200 s^2 + 65.48 s + 427.5)
            let close = |found: &Rational, printed: f64, digits: f64| {
                let found = rational::to_f64(found);
                assert!((found - printed).abs() <= digits, "{found} {printed}");
            };
            assert_eq!(transfer.numerator.len(), 2);
            close(&transfer.numerator[1], -24.72, 0.006);
            close(&transfer.denominator[2], 9.200, 0.0006);
            close(&transfer.denominator[1], 65.48, 0.006);
            close(&transfer.denominator[0], 427.5, 0.06);
        }
        // The transfer function against a direct solution of (s I - A) x = B at s = 3.
        let s = integer(3);
        let rows: Vec<Vec<Rational>> = (0..4)
            .map(|i| {
                let entry = |j: usize| if i == j { &s - &exact.a[i][j] } else { -exact.a[i][j].clone() };
                (0..4).map(entry).chain([exact.b[i][0].clone()]).collect()
            })
            .collect();
        let state = tpm_symbolic::algebra::linear::solve_unique(rows, 4).expect("3 is no pole");
        assert_eq!(transfer.evaluate(&s), Some(state[1].clone()));
    }
}

#[test]
fn a_point_that_is_no_equilibrium_names_the_row() {
    let p = pendulum(true);
    let quarter = p.b.pi() / 2;
    let point = OperatingPoint { coordinates: vec![(p.coordinates[1], quarter.id)], inputs: vec![] };
    let error = p.b.model(|model| linearize(model, &point)).expect_err("a horizontal rod falls");
    assert_eq!(error, LinearizeError::NotEquilibrium { equation: "eq2".to_owned(), residual: "-m2*c2*g".to_owned() });
    // The upright model has an equilibrium at th2 = pi, where its linearisation is that of Eqn 27.
    let down = OperatingPoint { coordinates: vec![(p.coordinates[1], p.b.pi().id)], inputs: vec![] };
    let linear = p.b.model(|model| linearize(model, &down)).expect("at rest");
    let values = table_1(&p);
    let exact = p.b.model(|model| linear.evaluate_exact(model, &values)).expect("all values are rational");
    let other = pendulum(false);
    let reference = other.b.model(|model| linearize(model, &OperatingPoint::default())).expect("at rest");
    let values = table_1(&other);
    let reference = other.b.model(|model| reference.evaluate_exact(model, &values)).expect("all values are rational");
    assert_eq!(exact, reference);
}

#[test]
fn an_input_can_hold_the_point() {
    // m x'' + k x - m g = F at x = a needs F = k a - m g.
    let b = Build::new();
    let x = b.coordinate("x");
    let [q, _, acceleration] = b.motion(x);
    let force = b.quantity("F", Kind::Input);
    let [m, k, g] = b.parameters(["m", "k", "g"]);
    let a = b.quantity("a", Kind::Constant { value: None });
    b.equation(&[&m * &acceleration, &k * &q, -(&m * &g), -&force]);
    let at = |b: &Build, input: &E| OperatingPoint {
        coordinates: vec![(x, a.id)],
        inputs: vec![(b.model(|m| m.find_symbol("F")).expect("declared"), input.id)],
    };
    let held = at(&b, &(&k * &a - &m * &g));
    let linear = b.model(|model| linearize(model, &held)).expect("held");
    same(&b, linear.a[1][0], &-(&k / &m));
    let free = at(&b, &b.num(0));
    let error = b.model(|model| linearize(model, &free)).err();
    assert!(matches!(error, Some(LinearizeError::NotEquilibrium { .. })), "{error:?}");
}

#[test]
fn faults_are_named() {
    let b = Build::new();
    let x = b.coordinate("x");
    let [q, v, a] = b.motion(x);
    let force = b.quantity("F", Kind::Input);
    let [m, c] = b.parameters(["m", "c"]);
    b.equation(&[&m * &a, &c * v.call(Function::Sign), -&force]);
    let point = OperatingPoint::default();
    // While it moves one way, dry friction is a constant force, which is no part of the linear model.
    let moving = b.model(|model| linearize(model, &point)).expect("dry friction at rest");
    assert_eq!(moving.friction.len(), 1);
    same(&b, moving.a[1][1], &b.num(0));
    b.model(|model| model.equations.clear());
    b.equation(&[&m * &a, &c * q.call(Function::Sign), -&force]);
    let error = b.model(|model| linearize(model, &point)).expect_err("a step of the force at the point");
    assert!(matches!(&error, LinearizeError::NotSmooth { atom, .. } if atom == "sign(x)"), "{error}");
    b.model(|model| model.equations.clear());
    b.equation(&[&c * &v, -&force]);
    assert_eq!(b.model(|model| linearize(model, &point)), Err(LinearizeError::SingularMass));
    b.equation(&[m.clone() * &q]);
    assert_eq!(b.model(|model| linearize(model, &point)), Err(LinearizeError::Shape { equations: 2, coordinates: 1 }));

    let lagrangian = |kinetic: &[E], potential: &[E]| Lagrangian {
        kinetic: b.terms(kinetic),
        potential: b.terms(potential),
        ..Lagrangian::default()
    };
    let fails = |kinetic: &[E], potential: &[E]| {
        let given = lagrangian(kinetic, potential);
        b.model(|model| euler_lagrange(model, &given)).expect_err("not a mechanical system")
    };
    assert!(matches!(fails(&[v.pow(3)], &[]), LagrangeError::NotQuadratic { .. }));
    assert!(matches!(fails(&[v.pow(2)], &[q.clone() * &v]), LagrangeError::Argument { energy: "potential", .. }));
    assert!(matches!(fails(&[a.pow(2)], &[]), LagrangeError::Argument { energy: "kinetic", .. }));
    assert!(matches!(fails(&[v.pow(2)], &[&force * &q]), LagrangeError::InputInEnergy { .. }));
    assert!(matches!(fails(&[], &[]), LagrangeError::NoEquation { .. }));
    let zero = b.num(0);
    let error = b.model(|model| substitute_coordinate(model, x, "y", &integer(0), zero.id));
    assert!(error.is_err());
}

#[test]
fn gyroscopic_terms_and_dry_friction() {
    // T = m/2 ((x' - W y)^2 + (y' + W x)^2): rotating frame; Coriolis +-2 m W and centrifugal -m W^2.
    let b = Build::new();
    let (x, y) = (b.coordinate("x"), b.coordinate("y"));
    let ([qx, vx, ax], [qy, vy, ay]) = (b.motion(x), b.motion(y));
    let [m, w, f] = b.parameters(["m", "W", "f"]);
    let half = b.exact(ratio(1, 2));
    let lagrangian = Lagrangian {
        kinetic: b.terms(&[&half * &m * ((&vx - &w * &qy).pow(2) + (&vy + &w * &qx).pow(2))]),
        dissipation: b.terms(&[&f * vx.call(Function::Abs)]),
        ..Lagrangian::default()
    };
    let derived = derive(&b, &lagrangian);
    let sign = vx.call(Function::Sign);
    let printed = [
        &m * &ax - 2 * (&m * &w * &vy) - &m * w.pow(2) * &qx + &f * &sign,
        &m * &ay + 2 * (&m * &w * &vx) - &m * w.pow(2) * &qy,
    ];
    check("rotating_frame", &b, &derived, &printed);
    assert_eq!(derived.damping, None);
    same(&b, derived.coriolis[0][1], &-(2 * (&m * &w)));
}
