//! Derivatives of rows as plans: against values derived by hand, and against difference quotients, which are exact for polynomials.

use crate::common::Build;
use num_traits::Zero;
use tpm_symbolic::expr::graph::{Coordinate, Function, Symbol};
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::number::rational::{Rational, integer, ratio};
use tpm_symbolic::plan::derivatives::Derivatives;
use tpm_symbolic::plan::evaluation::Evaluation;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::regressor::form::{RegressorForm, regressor_form};

/// Values of all leaves of a model.
#[derive(Clone)]
struct Point {
    motion: Vec<(Coordinate, [Rational; 3])>,
    columns: Vec<Rational>,
    symbols: Vec<(Symbol, Rational)>,
}

impl Point {
    fn leaf(&self, leaf: &Leaf) -> Option<Rational> {
        match leaf {
            Leaf::Motion(q, order) => {
                let of = self.motion.iter().find(|(present, _)| present == q);
                of.map(|(_, motion)| motion[*order as usize].clone())
            }
            Leaf::Column(j) => self.columns.get(*j).cloned(),
            Leaf::Symbol(symbol) => self.symbols.iter().find(|(present, _)| present == symbol).map(|(_, v)| v.clone()),
            _ => None,
        }
    }

    fn evaluate(&self, plan: &Plan) -> Vec<Rational> {
        plan.evaluate_exact(|leaf| self.leaf(leaf)).expect("rational")
    }

    /// `Phi theta + known - B u`.
    fn rows(&self, evaluation: &Evaluation) -> Vec<Rational> {
        let [phi, known, map] =
            [&evaluation.regressor, &evaluation.known, &evaluation.input_map].map(|p| self.evaluate(p));
        let inputs: Vec<Rational> =
            evaluation.inputs.iter().map(|input| self.leaf(&Leaf::Symbol(*input)).expect("given")).collect();
        let row = |(r, known): (usize, &Rational)| {
            let mut sum = known.clone();
            for (j, value) in self.columns.iter().enumerate() {
                sum += &(&phi[r * self.columns.len() + j] * value);
            }
            for (i, value) in inputs.iter().enumerate() {
                sum -= &(&map[r * inputs.len() + i] * value);
            }
            sum
        };
        known.iter().enumerate().map(row).collect()
    }

    fn moved(&self, (q, order): (Coordinate, u32), by: &Rational) -> Self {
        let mut moved = self.clone();
        let (_, motion) = moved.motion.iter_mut().find(|(present, _)| *present == q).expect("a coordinate");
        motion[order as usize] += by;
        moved
    }
}

/// A five-point difference quotient, exact for polynomials up to the fourth degree.
fn quotient(at: &Point, slot: (Coordinate, u32), evaluation: &Evaluation) -> Vec<Rational> {
    let h = ratio(3, 7);
    let [a, b, c, d] = [-2, -1, 1, 2].map(|n| at.moved(slot, &(&integer(n) * &h)).rows(evaluation));
    let scale = &integer(12) * &h;
    (0..a.len())
        .map(|r| {
            let eight = integer(8);
            let sum = &(&a[r] - &d[r]) + &(&eight * &(&c[r] - &b[r]));
            &sum / &scale
        })
        .collect()
}

fn check_against_quotients(model: &ExactModel, form: &RegressorForm, points: &[Point]) {
    let (derivatives, evaluation) = (Derivatives::new(model, form), Evaluation::new(model, form));
    let slots = derivatives.slots.len();
    for point in points {
        let found = point.evaluate(&derivatives.rows);
        for (s, &slot) in derivatives.slots.iter().enumerate() {
            let expected = quotient(point, slot, &evaluation);
            for (r, expected) in expected.iter().enumerate() {
                assert_eq!(&found[r * slots + s], expected, "row {r}, slot {slot:?}");
            }
        }
    }
}

#[test]
fn derivatives_of_a_polynomial_model_are_exact() {
    // m (1 + y^2) x'' + 2 m y x' y' + k x^3 = (1 + c) u  and  J y'' + g0 (3/5) x x''^2 - c y'^4 = 0, c known at run time.
    let build = Build::new();
    let (qx, qy) = (build.coordinate("x"), build.coordinate("y"));
    let ([x, vx, ax], [y, vy, ay]) = (build.motion(qx), build.motion(qy));
    let [m, k, inertia, g0] = build.parameters(["m", "k", "J", "g0"]);
    let u = build.quantity("u", Kind::Input);
    let c = build.quantity("c", Kind::Constant { value: None });
    build.equation(&[
        &m * &ax,
        &(&m * &y.pow(2)) * &ax,
        &(&(2 * &m) * &y) * &(&vx * &vy),
        &k * &x.pow(3),
        -&u,
        -(&c * &u),
    ]);
    build.equation(&[&inertia * &ay, &(&build.exact(ratio(3, 5)) * &g0) * &(&x * &ax.pow(2)), -(&c * &vy.pow(4))]);
    let (u, c) = (u.symbol(), c.symbol());
    let model = build.take();
    let form = regressor_form(&model).expect("linear in the parameters");
    let names: Vec<&str> = form.columns.iter().map(|column| column.name.as_str()).collect();
    let theta = |name: &str| match name {
        "m" => ratio(7, 3),
        "k" => integer(11),
        "J" => ratio(1, 9),
        _ => ratio(-5, 2),
    };
    let point = |motion: [[Rational; 3]; 2]| Point {
        motion: [qx, qy].into_iter().zip(motion).collect(),
        columns: names.iter().map(|name| theta(name)).collect(),
        symbols: vec![(u, ratio(13, 4)), (c, ratio(2, 3))],
    };
    let points = [
        point([[ratio(1, 2), integer(3), integer(-2)], [ratio(-2, 5), ratio(4, 3), integer(1)]]),
        point([[integer(0), integer(0), integer(0)], [integer(2), integer(0), ratio(-1, 7)]]),
    ];
    check_against_quotients(&model, &form, &points);

    let derivatives = Derivatives::new(&model, &form);
    assert_eq!(derivatives.slots, [(qx, 0), (qx, 1), (qx, 2), (qy, 0), (qy, 1), (qy, 2)]);
    assert_eq!((derivatives.switches, derivatives.switching.outputs.len()), (0, 0));
    let found = points[0].evaluate(&derivatives.rows);
    // By hand at x = 1/2, x' = 3, x'' = -2, y = -2/5, y' = 4/3, y'' = 1.
    let expected = [
        // 3 k x^2; 2 m y y'; m (1 + y^2); 2 m y x'' + 2 m x' y' = 56/15 + 56/3; 2 m y x'; 0.
        ratio(33, 4),
        ratio(-112, 45),
        ratio(203, 75),
        ratio(112, 5),
        ratio(-28, 5),
        integer(0),
        // 3/5 g0 x''^2; 0; 6/5 g0 x x''; 0; -4 c y'^3; J.
        integer(-6),
        integer(0),
        integer(3),
        integer(0),
        ratio(-512, 81),
        ratio(1, 9),
    ];
    assert_eq!(found, expected);
}

#[test]
fn signs_have_no_derivative_but_an_argument_and_half_a_jump() {
    // m x'' + f1 sign(x' - v0) + f2 x sign(x') = u  and  n y'' - f1 sign(x' - v0) + d y'^2 = 0.
    let build = Build::new();
    let (qx, qy) = (build.coordinate("x"), build.coordinate("y"));
    let ([x, vx, ax], [_, vy, ay]) = (build.motion(qx), build.motion(qy));
    let [m, n, f1, f2, d] = build.parameters(["m", "n", "f1", "f2", "d"]);
    let u = build.quantity("u", Kind::Input);
    let belt = build.quantity("v0", Kind::Constant { value: None });
    let slip = (&vx - &belt).call(Function::Sign);
    build.equation(&[&m * &ax, &f1 * &slip, &(&f2 * &x) * &vx.call(Function::Sign), -&u]);
    build.equation(&[&n * &ay, -(&f1 * &slip), &d * &vy.pow(2)]);
    let (u, belt) = (u.symbol(), belt.symbol());
    let model = build.take();
    let form = regressor_form(&model).expect("linear in the parameters");
    let derivatives = Derivatives::new(&model, &form);
    assert_eq!(derivatives.switches, 2);
    let theta = |name: &str| match name {
        "m" => integer(2),
        "n" => integer(3),
        "f1" => ratio(5, 4),
        "f2" => ratio(-7, 2),
        _ => ratio(1, 2),
    };
    let point = Point {
        motion: vec![(qx, [ratio(1, 3), integer(2), integer(-1)]), (qy, [integer(0), ratio(-3, 5), integer(1)])],
        columns: form.columns.iter().map(|column| theta(&column.name)).collect(),
        symbols: vec![(u, integer(9)), (belt, integer(5))],
    };
    let rows = point.evaluate(&derivatives.rows);
    let slot = |wanted| derivatives.slots.iter().position(|slot| *slot == wanted).expect("a slot");
    let width = derivatives.slots.len();
    // Away from the jumps only the factor x of the second sign changes with the motion: x' = 2 gives sign(x') = 1.
    assert_eq!(rows[slot((qx, 0))], ratio(-7, 2));
    assert!(rows[slot((qx, 1))].is_zero());
    assert_eq!(rows[slot((qx, 2))], integer(2));
    assert!(rows[width + slot((qx, 1))].is_zero());
    assert_eq!(rows[width + slot((qy, 1))], ratio(-3, 5));
    let switching = point.evaluate(&derivatives.switching);
    let mut switches: Vec<&[Rational]> = switching.chunks_exact(3).collect();
    switches.sort();
    let expected = [
        // x' - v0 = -3: half a jump is f1 in the first row, and -f1 in the second.
        vec![integer(-3), ratio(5, 4), ratio(-5, 4)],
        // x' = 2: f2 x in the first row.
        vec![integer(2), ratio(-7, 6), integer(0)],
    ];
    assert_eq!(switches, expected);
}
