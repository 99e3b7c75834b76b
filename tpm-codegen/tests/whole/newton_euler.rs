//! Arms written by hand, by recursive Newton-Euler with a `let` for every intermediate vector.

use crate::support::{outputs, parse};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::time::Instant;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::generate::{Language, Options, generate};
use tpm_symbolic::algebra::field::{Field, Rationals};
use tpm_symbolic::expr::graph::{ExprId, Function};
use tpm_symbolic::expr::point::{Drawn, Draws, Points};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::regressor::base_parameters::{Motions, base_parameters, verify};
use tpm_symbolic::regressor::form::{RegressorForm, regressor_form, structured_form};
use tpm_symbolic::regressor::prepare::prepare;

/// Per joint: distance a along x, quarter turns about x, distance d along the joint's axis (Craig's convention).
type Geometry = [(&'static str, i32, &'static str)];

/// Universal Robots UR5.
pub(crate) const UR5: [(&str, i32, &str); 6] = [
    ("0", 0, "0.089159"),
    ("0", 1, "0"),
    ("-0.425", 0, "0"),
    ("-0.39225", 0, "0.10915"),
    ("0", 1, "0.09465"),
    ("0", -1, "0.0823"),
];

/// Franka Emika Panda.
pub(crate) const PANDA: [(&str, i32, &str); 7] = [
    ("0", 0, "333/1000"),
    ("0", -1, "0"),
    ("0", 1, "79/250"),
    ("33/400", 1, "0"),
    ("-33/400", -1, "48/125"),
    ("0", 1, "0"),
    ("11/125", 1, "0"),
];

type Vector = [String; 3];

fn zero() -> Vector {
    ["0", "0", "0"].map(String::from)
}

/// A sum of products, written without what is zero.
fn sum(products: &[(i32, &str, &str)]) -> String {
    let mut text = String::new();
    for (sign, a, b) in products.iter().filter(|(sign, a, b)| *sign != 0 && *a != "0" && *b != "0") {
        let sign = if *sign < 0 {
            "- "
        } else if text.is_empty() {
            ""
        } else {
            "+ "
        };
        let product = match (*a, *b) {
            ("1", b) => b.to_owned(),
            (a, "1") => format!("({a})"),
            (a, b) => format!("({a})*({b})"),
        };
        let _ = write!(text, "{}{sign}{product}", if text.is_empty() { "" } else { " " });
    }
    if text.is_empty() { "0".to_owned() } else { text }
}

fn plus(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|k| sum(&[(1, &a[k], "1"), (1, &b[k], "1")]))
}

fn cross(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        sum(&[(1, &a[i], &b[j]), (-1, &a[j], &b[i])])
    })
}

/// The statements of a model in the order of the text.
#[derive(Default)]
struct Text(Vec<(String, String)>);

fn quarters(geometry: &Geometry, i: usize) -> (i32, i32) {
    match geometry[i - 1].1.rem_euclid(4) {
        0 => (1, 0),
        1 => (0, 1),
        2 => (-1, 0),
        _ => (0, -1),
    }
}

impl Text {
    /// Names the components of a vector.
    fn name(&mut self, name: &str, vector: &Vector) -> Vector {
        std::array::from_fn(|k| {
            if vector[k] == "0" {
                return "0".to_owned();
            }
            let name = format!("{name}_{}", ["x", "y", "z"][k]);
            self.0.push((name.clone(), vector[k].clone()));
            name
        })
    }

    /// The vector in the frame of joint `i`, from the one before.
    fn outward(&mut self, name: &str, i: usize, (ca, sa): (i32, i32), v: &Vector) -> Vector {
        let (c, s) = (format!("c{i}"), format!("s{i}"));
        // R^T v with the turn about x first.
        let y = sum(&[(ca, &v[1], "1"), (sa, &v[2], "1")]);
        let z = sum(&[(-sa, &v[1], "1"), (ca, &v[2], "1")]);
        let turned = [sum(&[(1, &c, &v[0]), (1, &s, &y)]), sum(&[(-1, &s, &v[0]), (1, &c, &y)]), z];
        self.name(name, &turned)
    }

    /// The vector in the frame before joint `i`, from that of the joint.
    fn inward(&mut self, name: &str, i: usize, (ca, sa): (i32, i32), v: &Vector) -> Vector {
        let (c, s) = (format!("c{i}"), format!("s{i}"));
        let y = sum(&[(1, &s, &v[0]), (1, &c, &v[1])]);
        let turned = [
            sum(&[(1, &c, &v[0]), (-1, &s, &v[1])]),
            sum(&[(ca, &y, "1"), (-sa, &v[2], "1")]),
            sum(&[(sa, &y, "1"), (ca, &v[2], "1")]),
        ];
        self.name(name, &turned)
    }
}

/// An arm by recursive Newton-Euler, with friction in every joint.
pub(crate) fn arm(geometry: &Geometry) -> String {
    let joints = geometry.len();
    let mut text = Text::default();
    let (mut w, mut dw) = (zero(), zero());
    let mut a = ["0", "0", "981/100"].map(String::from);
    let mut wrenches = Vec::new();
    let mut offsets = Vec::new();
    for i in 1..=joints {
        text.0.push((format!("c{i}"), format!("cos(q{i})")));
        text.0.push((format!("s{i}"), format!("sin(q{i})")));
        let (ca, sa) = quarters(geometry, i);
        let d = geometry[i - 1].2;
        let p = [geometry[i - 1].0.to_owned(), sum(&[(-sa, d, "1")]), sum(&[(ca, d, "1")])];
        let spin = cross(&w, &p);
        let spin = text.name(&format!("wp{i}"), &spin);
        let carried = plus(&a, &plus(&cross(&dw, &p), &cross(&w, &spin)));
        let carried = text.name(&format!("ap{i}"), &carried);
        a = text.outward(&format!("a{i}"), i, (ca, sa), &carried);
        let turned = text.outward(&format!("wo{i}"), i, (ca, sa), &w);
        let dot = ["0".to_owned(), "0".to_owned(), format!("dot(q{i})")];
        let ddot = ["0".to_owned(), "0".to_owned(), format!("ddot(q{i})")];
        let dturned = text.outward(&format!("dwo{i}"), i, (ca, sa), &dw);
        dw = text.name(&format!("dw{i}"), &plus(&plus(&dturned, &cross(&turned, &dot)), &ddot));
        w = text.name(&format!("w{i}"), &plus(&turned, &dot));
        let h = ["mx", "my", "mz"].map(|name| format!("{name}{i}"));
        let inertia = [["Ixx", "Ixy", "Ixz"], ["Ixy", "Iyy", "Iyz"], ["Ixz", "Iyz", "Izz"]];
        let times = |v: &Vector| -> Vector {
            std::array::from_fn(|r| {
                let names: Vec<String> = inertia[r].iter().map(|name| format!("{name}{i}")).collect();
                sum(&[(1, &names[0], &v[0]), (1, &names[1], &v[1]), (1, &names[2], &v[2])])
            })
        };
        let wh = text.name(&format!("wh{i}"), &cross(&w, &h));
        let mass: Vector = std::array::from_fn(|k| sum(&[(1, &format!("m{i}"), &a[k])]));
        let force = text.name(&format!("F{i}"), &plus(&mass, &plus(&cross(&dw, &h), &cross(&w, &wh))));
        let momentum = text.name(&format!("L{i}"), &times(&w));
        let moment = plus(&cross(&h, &a), &plus(&times(&dw), &cross(&w, &momentum)));
        wrenches.push((force, text.name(&format!("N{i}"), &moment)));
        offsets.push(p);
    }
    let (mut f, mut n) = (zero(), zero());
    let mut rows = Vec::new();
    for i in (1..=joints).rev() {
        let (force, moment) = &wrenches[i - 1];
        f = text.name(&format!("f{i}"), &plus(force, &f));
        n = text.name(&format!("n{i}"), &plus(moment, &n));
        rows.push(format!("{} + fv{i}*dot(q{i}) + fc{i}*sign(dot(q{i})) + fo{i} = u{i};", n[2]));
        f = text.inward(&format!("fi{i}"), i, quarters(geometry, i), &f);
        let turned = text.inward(&format!("ni{i}"), i, quarters(geometry, i), &n);
        n = text.name(&format!("nj{i}"), &plus(&turned, &cross(&offsets[i - 1], &f)));
    }
    rows.reverse();
    written(joints, &text.0, &rows)
}

fn names(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| word.starts_with(char::is_alphabetic))
}

/// The statements that the rows need, with declarations of what they mention.
fn written(joints: usize, statements: &[(String, String)], rows: &[String]) -> String {
    let mut used: BTreeSet<&str> = rows.iter().flat_map(|row| names(row)).collect();
    for (name, value) in statements.iter().rev() {
        if used.contains(name.as_str()) {
            used.extend(names(value));
        }
    }
    let list = |prefix: &str| (1..=joints).map(|i| format!("{prefix}{i}")).collect::<Vec<_>>().join(", ");
    let mut text = format!("model Arm{joints} {{\n  coordinate {};\n  input {};\n  parameter ", list("q"), list("u"));
    let kinds = ["m", "mx", "my", "mz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "fv", "fc", "fo"];
    let parameters = (1..=joints).flat_map(|i| kinds.map(|kind| format!("{kind}{i}")));
    let parameters: Vec<String> = parameters.filter(|name| used.contains(name.as_str())).collect();
    let _ = writeln!(text, "{};", parameters.join(", "));
    for (name, value) in statements.iter().filter(|(name, _)| used.contains(name.as_str())) {
        let _ = writeln!(text, "  let {name} = {value};");
    }
    rows.iter().for_each(|row| {
        let _ = writeln!(text, "  {row}");
    });
    text.push_str("}\n");
    text
}

/// The entries of a form at a rational point: the known terms of every row, then its columns.
fn entries(model: &ExactModel, form: &RegressorForm) -> Vec<Rational> {
    let mut graph = model.graph.clone();
    let mut roots: Vec<ExprId> = Vec::new();
    for row in &form.rows {
        for column in std::iter::once(None).chain((0..form.columns.len()).map(Some)) {
            let own = row.terms.iter().filter(|term| term.column == column);
            let terms: Vec<ExprId> = own
                .map(|term| {
                    let powers: Vec<ExprId> = term.atoms.factors().map(|(&atom, e)| graph.pow(atom, e)).collect();
                    let product = graph.product(&powers);
                    graph.scale(product, term.coefficient.clone())
                })
                .collect();
            roots.push(graph.sum(&terms));
        }
    }
    let points = Points::new(&graph, &roots);
    // The draws of a node do not depend on the other nodes.
    let draw = |drawn: Drawn| {
        let number = match drawn {
            Drawn::Value(id) => id.index() as u64,
            Drawn::Sign(id) => 2_000_000 + id.index() as u64,
            Drawn::HalfTangent(unit) => 1_000_000 + points.units()[unit].factors[0].index() as u64,
        };
        Some(Rationals.element(Draws::new(number).word()))
    };
    points.evaluate(&Rationals, draw).expect("no division by zero")
}

#[test]
fn structured_and_multiplied_out_forms_are_equal() {
    for joints in 1..=3 {
        let mut model = parse(&arm(&PANDA[..joints])).model;
        let structured = structured_form(&mut model).expect("linear");
        let expanded = regressor_form(&model).expect("linear");
        assert_eq!(structured.columns, expanded.columns);
        assert!(joints == 1 || !structured.is_expanded(&model.graph));
        let values = entries(&model, &structured);
        assert_eq!(values, entries(&model, &expanded));
        assert!(values.iter().filter(|value| !Rationals.is_zero(value)).count() > 3 * joints);
        let again = structured.expanded(&model.graph);
        assert!(again.is_expanded(&model.graph));
        // Terms that come from several source terms keep the first source either way.
        for (found, expected) in again.rows.iter().zip(&expanded.rows) {
            assert_eq!((&found.name, &found.inputs), (&expected.name, &expected.inputs));
            assert_eq!(found.terms, expected.terms);
        }
    }
}

#[test]
fn seven_joints_are_checked_and_generated_without_being_multiplied_out() {
    let text = arm(&PANDA);
    let started = Instant::now();
    let parsed = parse(&text);
    let read = started.elapsed();
    let prepared = prepare(parsed.model.clone()).expect("linear");
    let checked = started.elapsed();
    assert!(!prepared.form.is_expanded(&prepared.model.graph));
    let columns = prepared.form.columns.len();
    let started = Instant::now();
    let estimator = EstimatorSource::of(&parsed).expect("linear");
    let planned = started.elapsed();
    let files = generate(&estimator, &Options::new(Language::C, "tpm generate arm.tpm --lang c")).expect("in range");
    let generated = started.elapsed();
    let sizes: Vec<usize> = files.iter().map(|file| file.text.len()).collect();
    println!(
        "{columns} columns, {} nodes; read {read:?}, check {checked:?}, plans {planned:?}, generate {generated:?}; {sizes:?} bytes",
        prepared.model.graph.len()
    );
    let (regressor, forces) = (&estimator.plan.evaluation.regressor, &estimator.plan.inverse_dynamics);
    println!("regressor: {:?}, forces: {:?}", regressor.counts(), forces.counts());
    assert!(sizes.iter().sum::<usize>() < 250_000);
    assert!(estimator.plan.feed_forward_parts.is_none());
    // The forces follow the recursion, which takes fewer operations than Phi theta and gives the same numbers.
    assert!(forces.counts().multiplications < regressor.counts().multiplications);
    let value = |leaf: &Leaf| match *leaf {
        Leaf::Motion(q, order) => (1.3 + f64::from(q.0) * 0.7 + f64::from(order) * 0.31).sin(),
        Leaf::Column(column) => 0.2 + (column as f64 * 1.1).cos(),
        _ => f64::NAN,
    };
    let [phi, known, found] = [regressor, &estimator.plan.evaluation.known, forces]
        .map(|plan| outputs(plan, rational::to_f64, Function::apply, value));
    for (row, found) in found.iter().enumerate() {
        let products = (0..columns).map(|c| phi[row * columns + c] * value(&Leaf::Column(c)));
        let expected = known[row] + products.sum::<f64>();
        assert!((found - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{found} {expected}");
    }
}

/// The links of a UR5 have 36 base parameters, those of a Panda 43; friction adds three per joint. The rank does not depend on the way
/// in which the rows are written.
#[test]
fn base_parameters_of_arms() {
    for (name, geometry, links) in [("UR5", UR5.as_slice(), 36), ("Panda", PANDA.as_slice(), 43)] {
        let prepared = prepare(parse(&arm(geometry)).model).expect("linear");
        let (model, form) = (&prepared.model, &prepared.form);
        let started = Instant::now();
        let found = base_parameters(model, form, &Motions::default()).expect("no division by zero");
        let taken = started.elapsed();
        let base = found.base.as_ref().expect("every constant is a number");
        let terms: usize = base.iter().map(|base| 1 + base.others.len()).sum();
        println!("{name}: rank {} of {} in {taken:?}, {terms} terms", found.rank, form.columns.len());
        assert_eq!(found.rank, links + 3 * geometry.len());
        verify(model, form, &Motions::default(), &found.certificate, 7).expect("holds at other points");
        let mut wrong = found.certificate.clone();
        let last = wrong.directions.as_mut().and_then(|list| list.last_mut()?.last_mut()).expect("a direction");
        last.1 += Rational::new(1.into(), 1_000_000_000.into());
        assert!(verify(model, form, &Motions::default(), &wrong, 7).is_err());
    }
    for joints in 2..=3 {
        let mut model = parse(&arm(&PANDA[..joints])).model;
        let expanded = regressor_form(&model).expect("linear");
        let structured = structured_form(&mut model).expect("linear");
        let [a, b] = [&expanded, &structured]
            .map(|form| base_parameters(&model, form, &Motions::default()).expect("no division by zero"));
        assert_eq!((&a.rank, &a.base), (&b.rank, &b.base));
    }
}
