//! Feng, Appendix A: f1, f2, f3 of the two-joint closed-loop arm as functions of th2 through the loop closure, their
//! Taylor coefficients a10, a11, ..., a32, and the rank of A1..A8.

use crate::common::{Build, E};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tpm_symbolic::algebra::linear;
use tpm_symbolic::expr::graph::{Coordinate, ExprId, Function};
use tpm_symbolic::expr::trigonometric;
use tpm_symbolic::linear::taylor::{Expansion, series};
use tpm_symbolic::mechanics::constraint::{Implicit, ImplicitError};
use tpm_symbolic::mechanics::model::Kind;
use tpm_symbolic::number::rational::{Rational, integer, ratio};

/// The arm: lengths, angles, and f1..f3 as sums over A1..A8.
struct Arm {
    b: Build,
    th2: Coordinate,
    /// l2, l3, l4, l5.
    lengths: [E; 4],
    /// th2, th3, th4.
    angles: [E; 3],
    /// A1..A8.
    a: [E; 8],
    f: [E; 3],
}

/// f1..f3 (above Feng, Eqn A.3) with the loop angles as coordinates of their own.
fn arm() -> Arm {
    let b = Build::new();
    let [th2, th3, th4] = ["th2", "th3", "th4"].map(|name| b.coordinate(name));
    let lengths = ["l2", "l3", "l4", "l5"].map(|name| b.quantity(name, Kind::Constant { value: None }));
    let a = b.parameters(["A1", "A2", "A3", "A4", "A5", "A6", "A7", "A8"]);
    let angles = [th2, th3, th4].map(|c| b.der(c, 0));
    let f = functions(&lengths, &angles, &a);
    Arm { b, th2, lengths, angles, a, f }
}

fn functions([_, l3, l4, l5]: &[E; 4], [q2, q3, q4]: &[E; 3], a: &[E; 8]) -> [E; 3] {
    let [a1, a2, a3, a4, a5, a6, a7, a8] = a;
    let between = (q2 - q3).cos();
    // dth3/dth2 and dth4/dth2 in the loop.
    let r3 = l4 * (q4 - q2).sin() / (l5 * (q3 - q4).sin());
    let r4 = l4 * (q3 - q2).sin() / (l3 * (q3 - q4).sin());
    [
        a1 / 2 + a2 * q2.cos() + a3 * q3.cos() + a4 * q4.cos() + a5 * &between,
        a6 / 2 + a7 / 2 * r3.pow(2) + a8 / 2 * r4.pow(2) + a5 * &between * &r3,
        a6 + a2 * q2.cos() + a5 * &between + (a7 + a3 * q3.cos() + a5 * &between) * &r3 + (a8 + a4 * q4.cos()) * &r4,
    ]
}

/// l4 e^{j th2} + l5 e^{j th3} - l2 - l3 e^{j th4}, real and imaginary part.
fn closure([l2, l3, l4, l5]: &[E; 4], [q2, q3, q4]: &[E; 3]) -> [E; 2] {
    [l4 * q2.cos() + l5 * q3.cos() - l2 - l3 * q4.cos(), l4 * q2.sin() + l5 * q3.sin() - l3 * q4.sin()]
}

/// th3 and th4 as functions of th2, elbow up.
fn loop_angles([l2, l3, l4, l5]: &[E; 4], q2: &E) -> [E; 2] {
    let square = l2.pow(2) + l4.pow(2) - 2 * (l2 * l4 * q2.cos());
    let d = square.call(Function::Sqrt);
    let beta = (l4 * q2.sin()).atan2(&(l2 - l4 * q2.cos()));
    let at5 = ((&square + l5.pow(2) - l3.pow(2)) / (2 * (l5 * &d))).call(Function::Acos);
    let at3 = ((&square + l3.pow(2) - l5.pow(2)) / (2 * (l3 * &d))).call(Function::Acos);
    [at5 - &beta, q2.build_pi() - at3 - &beta]
}

type Values = Vec<(ExprId, f64)>;

/// A random geometry that closes over a stretch of th2 around the point.
fn geometry(arm: &Arm, rng: &mut ChaCha8Rng) -> (Values, f64) {
    loop {
        let lengths: [f64; 4] = std::array::from_fn(|_| rng.random_range(0.1..0.8));
        let th2: f64 = rng.random_range(-3.0..3.0);
        let [l2, l3, l4, l5] = lengths;
        let d = (l2 * l2 + l4 * l4 - 2.0 * l2 * l4 * th2.cos()).sqrt();
        let cosines = [(d * d + l5 * l5 - l3 * l3) / (2.0 * l5 * d), (d * d + l3 * l3 - l5 * l5) / (2.0 * l3 * d)];
        // Away from the stretched positions, where the arm is singular, and from th2 = 0 with l2 = l4.
        if cosines.iter().all(|c| c.abs() < 0.8) && d > 0.15 {
            let mut values: Values = arm.lengths.iter().map(|l| l.id).zip(lengths).collect();
            values.extend(arm.a.iter().map(|a| (a.id, rng.random_range(-1.0..1.0))));
            return (values, th2);
        }
    }
}

/// Derivative by central differences with four Richardson steps: error about 1e-12 of the function's size.
fn numerical_derivative(f: impl Fn(f64) -> f64, x: f64) -> f64 {
    let mut row: Vec<f64> = Vec::new();
    for i in 0..5 {
        let h = 0.02 / f64::from(1 << i);
        let mut next = vec![(f(x + h) - f(x - h)) / (2.0 * h)];
        for (k, previous) in row.iter().enumerate() {
            let factor = 4f64.powi(k as i32 + 1);
            next.push((factor * next[k] - previous) / (factor - 1.0));
        }
        row = next;
    }
    row[row.len() - 1]
}

#[test]
fn a10_to_a32_agree_with_numerical_differentiation_and_with_implicit_differentiation() {
    let arm = arm();
    let b = &arm.b;
    let th20 = b.quantity("th20", Kind::Constant { value: None });
    let explicit = loop_angles(&arm.lengths, &arm.angles[0]);
    let replaced = [(arm.angles[1].id, explicit[0].id), (arm.angles[2].id, explicit[1].id)].into();
    let f: Vec<E> = arm.f.iter().map(|f| b.e(b.graph(|g| g.substitute(f.id, &replaced)))).collect();
    // a_ik from the series of the explicit functions about th20.
    let expansion = Expansion { coordinate: arm.th2, point: th20.id, order: 3 };
    let coefficients: Vec<Vec<E>> = f
        .iter()
        .map(|f| {
            let found = b.model(|model| series(model, f.id, &[expansion])).expect("regular");
            (0..=3u32).map(|k| b.e(found.coefficients[&smallvec::smallvec![k]])).collect()
        })
        .collect();
    // D^k f_i from the loop closure alone, its angles left as they are.
    let constraints = closure(&arm.lengths, &arm.angles).map(|c| c.id);
    let [q2, q3, q4] = arm.angles.each_ref().map(|angle| angle.id);
    let implicit = b.graph(|g| Implicit::new(g, &constraints, q2, &[q3, q4])).expect("regular");
    // The printed slopes are those of the closure.
    let [_, l3, l4, l5] = &arm.lengths;
    let [t2, t3, t4] = &arm.angles;
    let printed = [l4 * (t4 - t2).sin() / (l5 * (t3 - t4).sin()), l4 * (t3 - t2).sin() / (l3 * (t3 - t4).sin())];
    for (found, printed) in implicit.slopes().iter().zip(&printed) {
        assert!(b.is_zero(&(b.e(*found) - printed)));
    }
    let text = |name: &str, e: &E| format!("{name} = {}\n", b.model(|m| m.display(e.id)));
    let slopes = implicit.slopes().iter().zip(["dth3/dth2", "dth4/dth2"]).map(|(slope, name)| text(name, &b.e(*slope)));
    let functions = arm.f.iter().zip(["f1", "f2", "f3"]).map(|(f, name)| text(name, f));
    insta::assert_snapshot!("functions_of_th2", slopes.chain(functions).collect::<String>());
    let derivatives: Vec<Vec<E>> = arm
        .f
        .iter()
        .map(|f| {
            let mut list = vec![f.clone()];
            for k in 0..3usize {
                list.push(b.e(b.graph(|g| implicit.derivative(g, list[k].id))));
            }
            list
        })
        .collect();

    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..40 {
        let (values, point) = geometry(&arm, &mut rng);
        let at = |e: &E, extra: &[(ExprId, f64)]| e.at(&[values.as_slice(), extra].concat());
        let angles: Vec<f64> = explicit.iter().map(|angle| at(angle, &[(q2, point)])).collect();
        let position = [(q2, point), (q3, angles[0]), (q4, angles[1])];
        for c in closure(&arm.lengths, &arm.angles) {
            assert!(at(&c, &position).abs() < 1e-14, "the loop closes");
        }
        for i in 0..3 {
            let mut factorial = 1.0;
            for k in 0..=3usize {
                factorial *= (k as f64).max(1.0);
                let from_series = at(&coefficients[i][k], &[(th20.id, point)]);
                let from_closure = at(&derivatives[i][k], &position) / factorial;
                let scale = from_closure.abs().max(1.0);
                assert!((from_series - from_closure).abs() <= 1e-11 * scale, "{i} {k}: {from_series} {from_closure}");
                // The derivative of order k - 1, exact, differentiated numerically once.
                if k > 0 {
                    let lower = |x: f64| at(&coefficients[i][k - 1], &[(th20.id, x)]);
                    let numeric = numerical_derivative(lower, point) / k as f64;
                    assert!((numeric - from_series).abs() <= 1e-9 * scale, "{i} {k}: {numeric} {from_series}");
                }
            }
            let value = at(&f[i], &[(q2, point)]);
            assert!((at(&coefficients[i][0], &[(th20.id, point)]) - value).abs() <= 1e-13 * value.abs().max(1.0));
        }
    }
}

#[test]
fn a10_and_a11_are_the_printed_ones() {
    let arm = arm();
    let b = &arm.b;
    let q = b.quantity("th20", Kind::Constant { value: None });
    let [l2, l3, l4, l5] = &arm.lengths;
    let [a1, a2, a3, a4, a5, ..] = &arm.a;
    let root = |e: E| e.call(Function::Sqrt);
    let square = l2.pow(2) + l4.pow(2) - 2 * (l2 * l4 * q.cos());
    // Feng, below Eqn A.11, with l3^2 for l_{l^2}^2 and l2 l4 for l_l l4, and atan2 for arctan (errata, E).
    let n5 = &square - l3.pow(2) + l5.pow(2);
    let n3 = &square + l3.pow(2) - l5.pow(2);
    let c5 = &n5 / (2 * (l5 * root(square.clone())));
    let c3 = &n3 / (2 * (l3 * root(square.clone())));
    let angle = (l4 * q.sin()).atan2(&(l2 - l4 * q.cos()));
    let (up, low) = (c5.call(Function::Acos), c3.call(Function::Acos));
    let a10 =
        a1 / 2 + a2 * q.cos() + a3 * (&up - &angle).cos() - a4 * (&low + &angle).cos() + a5 * (&q - &up + &angle).cos();
    let three_halves = &square * root(square.clone());
    let turn = (l4.pow(2) - l2 * l4 * q.cos()) / &square;
    let slope5 = l2 * l4 * &n3 * q.sin() / (2 * (l5 * &three_halves) * root(1 - c5.pow(2)));
    let slope3 = l2 * l4 * &n5 * q.sin() / (2 * (l3 * &three_halves) * root(1 - c3.pow(2)));
    let a11 = -(a2 * q.sin())
        + a3 * (&slope5 - &turn) * (&up - &angle).sin()
        + a4 * (-&slope3 - &turn) * (&low + &angle).sin()
        + a5 * (-&slope5 + &turn - 1) * (&q - &up + &angle).sin();
    let explicit = loop_angles(&arm.lengths, &arm.angles[0]);
    let replaced = [(arm.angles[1].id, explicit[0].id), (arm.angles[2].id, explicit[1].id)].into();
    let f1 = b.e(b.graph(|g| g.substitute(arm.f[0].id, &replaced)));
    let expansion = Expansion { coordinate: arm.th2, point: q.id, order: 1 };
    let found = b.model(|model| series(model, f1.id, &[expansion])).expect("regular");
    let text = |k: u32| b.model(|m| m.display(found.coefficients[&smallvec::smallvec![k]]));
    insta::assert_snapshot!("a10_and_a11", format!("a10 = {}\na11 = {}\n", text(0), text(1)));
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for _ in 0..40 {
        let (mut values, point) = geometry(&arm, &mut rng);
        values.push((q.id, point));
        for (k, printed) in [(0u32, &a10), (1, &a11)] {
            let (left, right) = (b.e(found.coefficients[&smallvec::smallvec![k]]).at(&values), printed.at(&values));
            assert!((left - right).abs() <= 1e-11 * right.abs().max(1.0), "{k}: {left} {right}");
        }
    }
}

/// (1 - t^2, 2 t) / (1 + t^2): cosine and sine of a rational point on the circle.
fn rational_angle(t: &Rational) -> (Rational, Rational) {
    let square = t * t;
    let below = integer(1) + &square;
    ((integer(1) - &square) / &below, integer(2) * t / below)
}

#[test]
fn only_six_combinations_of_a1_to_a8_are_identifiable() {
    // f1, f2, f3 are linear in A1..A8; which combinations vanish for every th2?
    let arm = arm();
    let b = &arm.b;
    let [q2, q3, q4] = arm.angles.each_ref().map(|angle| angle.id);
    let constraints = closure(&arm.lengths, &arm.angles).map(|c| c.id);
    let implicit = b.graph(|g| Implicit::new(g, &constraints, q2, &[q3, q4])).expect("regular");
    // Coefficients of A_j in f_i, with single angles only, and their derivatives by th2.
    let mut rows: Vec<Vec<E>> = Vec::new();
    for f in &arm.f {
        let single = |e: E| b.e(b.graph(|g| trigonometric::simplify(g, e.id)));
        let mut row: Vec<E> = arm.a.iter().map(|a| single(f.diff(a))).collect();
        for _ in 0..=3 {
            rows.push(row.clone());
            row = row.iter().map(|e| b.e(b.graph(|g| implicit.derivative(g, e.id)))).collect();
        }
    }
    // A rational configuration: angles are rational points of the circle, l4 and l5 are chosen, and l2 and l3 follow
    // from the closure, which is linear in them.
    let evaluate = |tangents: [Rational; 3], l4: Rational, l5: Rational| -> (Vec<Vec<Rational>>, [Rational; 4]) {
        let [(c2, s2), (c3, s3), (c4, s4)] = tangents.each_ref().map(rational_angle);
        let l3 = (&l4 * &s2 + &l5 * &s3) / &s4;
        let l2 = &l4 * &c2 + &l5 * &c3 - &l3 * &c4;
        let lengths = [l2, l3, l4, l5];
        let mut replaced = std::collections::HashMap::new();
        b.graph(|g| {
            for (angle, (c, s)) in [q2, q3, q4].into_iter().zip([(c2, s2), (c3, s3), (c4, s4)]) {
                let (cosine, sine) = (g.function(Function::Cos, angle), g.function(Function::Sin, angle));
                replaced.insert(cosine, g.number(c));
                replaced.insert(sine, g.number(s));
            }
            for (symbol, value) in arm.lengths.iter().zip(&lengths) {
                let value = g.number(value.clone());
                replaced.insert(symbol.id, value);
            }
        });
        let matrix = rows.iter().map(|row| {
            let entry = |e: &E| {
                b.graph(|g| {
                    let value = g.substitute(e.id, &replaced);
                    g.as_number(value).cloned().expect("every quantity has a rational value")
                })
            };
            row.iter().map(entry).collect()
        });
        (matrix.collect(), lengths)
    };
    for (tangents, l4, l5) in [
        ([ratio(1, 2), ratio(2, 3), ratio(5, 4)], ratio(1, 10), ratio(7, 10)),
        ([ratio(-3, 7), ratio(1, 5), ratio(-9, 4)], ratio(3, 1), ratio(2, 1)),
    ] {
        let (matrix, lengths) = evaluate(tangents, l4, l5);
        let null = linear::null_space(matrix.clone(), 8);
        // Six independent rows exist already at this one configuration: the rank is at least 6.
        assert_eq!(null.len(), 2);
        // The null vectors below lie in this null space, so they span it.
        for vector in null_vectors(&lengths) {
            for row in &matrix {
                let product: Rational = row.iter().zip(&vector).map(|(a, b)| a * b).sum();
                assert_eq!(product, integer(0));
            }
        }
    }
    // For every th2 and all lengths: the closure, solved for l2 and l3, makes both combinations vanish identically.
    let [l2, l3, l4, l5] = arm.lengths.clone();
    let [t2, t3, t4] = &arm.angles;
    let solved3 = (&l4 * t2.sin() + &l5 * t3.sin()) / t4.sin();
    let solved2 = &l4 * t2.cos() + &l5 * t3.cos() - &solved3 * t4.cos();
    let vectors = null_expressions(&arm, &[l2.clone(), l3.clone(), l4, l5]);
    for vector in &vectors {
        for f in &arm.f {
            let combination = arm.a.iter().zip(vector).fold(b.num(0), |sum, (a, v)| sum + f.diff(a) * v);
            let replaced = [(l2.id, solved2.id), (l3.id, solved3.id)].into();
            let on_loop = b.e(b.graph(|g| g.substitute(combination.id, &replaced)));
            assert!(b.is_zero(&on_loop));
        }
    }
}

/// Changes of (A1, ..., A8) that leave the kinetic energy as it is, from l2..l5: point masses moved across the joints of the loop.
fn null_expressions(arm: &Arm, [l2, l3, l4, l5]: &[E; 4]) -> [Vec<E>; 2] {
    let n = |value: i64| arm.b.num(value);
    [
        vec![-(2 * l2), l4.clone(), l5.clone(), -l3, n(0), n(0), n(0), n(0)],
        vec![
            l4.pow(2) + l5.pow(2) - l2.pow(2) - l3.pow(2),
            n(0),
            n(0),
            -(l2 * l3),
            l4 * l5,
            l4.pow(2),
            l5.pow(2),
            -l3.pow(2),
        ],
    ]
}

fn null_vectors([l2, l3, l4, l5]: &[Rational; 4]) -> [Vec<Rational>; 2] {
    let zero = || integer(0);
    [
        vec![integer(-2) * l2, l4.clone(), l5.clone(), -l3.clone(), zero(), zero(), zero(), zero()],
        vec![l4 * l4 + l5 * l5 - l2 * l2 - l3 * l3, zero(), zero(), -(l2 * l3), l4 * l5, l4 * l4, l5 * l5, -(l3 * l3)],
    ]
}

#[test]
fn constraints_that_do_not_determine_are_refused() {
    let b = Build::new();
    let [x, y] = ["x", "y"].map(|name| b.coordinate(name));
    let (x, y) = (b.der(x, 0), b.der(y, 0));
    let circle = x.pow(2) + y.pow(2) - 1;
    let one = b.graph(|g| Implicit::new(g, &[circle.id], x.id, &[y.id])).expect("regular");
    assert!(b.is_zero(&(b.e(one.slopes()[0]) + &x / &y)));
    assert_eq!(b.graph(|g| Implicit::new(g, &[x.id], x.id, &[y.id])), Err(ImplicitError::Singular));
    let count = b.graph(|g| Implicit::new(g, &[], x.id, &[y.id]));
    assert_eq!(count, Err(ImplicitError::Count { constraints: 0, dependents: 1 }));
}
