//! Elimination of free coordinates, lumped parameters and the map to the physical ones.

use crate::chain::{Chain, chain, cubic};
use proptest::prelude::{ProptestConfig, prop, prop_assert_eq, proptest};
use std::collections::BTreeMap;
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::algebra::generic_point;
use tpm_symbolic::algebra::polynomial::Polynomial;
use tpm_symbolic::expr::graph::{Coordinate, ExprId, Function, Node, Symbol};
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::mechanics::eliminate::{EliminateError, Reason};
use tpm_symbolic::mechanics::model::{Elimination, Equation, ExactModel, Kind, Lump, SourceTerm, TermId};
use tpm_symbolic::number::rational::{Rational, binomial, integer, parse, ratio};
use tpm_symbolic::regressor::form::canonical;
use tpm_symbolic::regressor::inverse::Constraint;
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::{PrepareError, Prepared, prepare};

/// (motion monomial, definition) of every term, in the order of the columns.
fn columns(prepared: &Prepared) -> Vec<(String, String, String)> {
    let mut found = Vec::new();
    for term in &prepared.form.rows[0].terms {
        let column = &prepared.form.columns[term.column.expect("no known terms")];
        let mut graph = prepared.model.graph.clone();
        let motion = term.atoms.factors().map(|(&atom, e)| graph.pow(atom, e)).collect::<Vec<_>>();
        let motion = graph.product(&motion);
        assert_eq!(term.coefficient, integer(1));
        let motion = graph.display(motion, &prepared.model);
        found.push((column.name.to_string(), motion, canonical(&prepared.model, &column.definition)));
    }
    found
}

#[test]
fn two_carts_lump_as_in_feng_4_34_to_4_41() {
    let prepared = prepare(cubic(2)).expect("a chain can be eliminated");
    let found = columns(&prepared);
    let expected = [
        ("c1", "der(x2, 4)", "m1*m2/g1"),
        ("c2", "ddot(x2)", "m1 + m2 + m2*k1/g1"),
        ("c3", "x2^2*ddot(x2)", "3*m2*k2/g1"),
        ("c4", "x2*ddot(x2)^2", "3*m2^2*k2/g1^2"),
        ("c5", "ddot(x2)^3", "m2^3*k2/g1^3"),
        ("c6", "x2", "k1"),
        ("c7", "x2^3", "k2"),
    ];
    for ((name, _, definition), (expected_name, _, expected_definition)) in found.iter().zip(&expected) {
        assert_eq!((name.as_str(), definition.as_str()), (*expected_name, *expected_definition));
    }
    let motions: Vec<Vec<(u32, i32)>> =
        prepared.form.rows[0].terms.iter().map(|t| orders(&prepared.model, t)).collect();
    let expected = [
        vec![(4, 1)],
        vec![(2, 1)],
        vec![(0, 2), (2, 1)],
        vec![(0, 1), (2, 2)],
        vec![(2, 3)],
        vec![(0, 1)],
        vec![(0, 3)],
    ];
    assert_eq!(motions, expected);
    let x1 = prepared.reconstruction(Coordinate(0)).expect("x1 was eliminated");
    let rebuilt = prepared.model.graph.polynomial(x1.expr);
    assert_eq!(canonical(&prepared.model, &rebuilt), "m2*(ddot(x2))/g1 + (x2)");
    assert_eq!(x1.equation, "eq2");
    assert_eq!(prepared.order(), 4);
}

/// (derivative, exponent) of a motion monomial, sorted.
fn orders(model: &ExactModel, term: &tpm_symbolic::regressor::form::Term) -> Vec<(u32, i32)> {
    let mut orders: Vec<(u32, i32)> = term
        .atoms
        .factors()
        .map(|(&atom, exponent)| match model.graph.node(atom) {
            Node::Derivative(_, order) => (*order, exponent),
            _ => unreachable!("chains have polynomial terms only"),
        })
        .collect();
    orders.sort_unstable();
    orders
}

#[test]
fn the_table_of_feng_4_44_is_exact() {
    // Columns c1..c7, rows harmonics 1, 3, ..., 15, with powers of lambda and w. Feng, Eqn 4.44, prints five entries
    // otherwise: (3, c3) 37393/180000, (5, c4) -1337/2400, nothing at (1, c5), "3976/30000" at (1, c7) and
    // 157/180000 at (3, c7). The values here are exact; the column sums below decide between them.
    let fixture: [(&str, i32, i32, [&str; 8]); 7] = [
        ("c1", 1, 4, ["1", "-27/2", "25/2", "0", "0", "0", "0", "0"]),
        ("c2", 1, 2, ["-1", "3/2", "-1/2", "0", "0", "0", "0", "0"]),
        (
            "c3",
            3,
            2,
            [
                "-92411/180000",
                "37393/60000",
                "7973/180000",
                "-37373/180000",
                "1273/20000",
                "-1993/180000",
                "59/60000",
                "-1/20000",
            ],
        ),
        ("c4", 3, 4, ["533/480", "-877/480", "1337/2400", "1183/2400", "-1099/2400", "113/800", "-43/2400", "1/800"]),
        ("c5", 3, 6, ["-99/32", "187/32", "-99/32", "-21/32", "57/32", "-33/32", "9/32", "-1/32"]),
        ("c6", 1, 0, ["1", "-1/6", "1/50", "0", "0", "0", "0", "0"]),
        (
            "c7",
            3,
            0,
            [
                "39761/60000",
                "1157/180000",
                "-109991/1500000",
                "1847/60000",
                "-3163/540000",
                "43/60000",
                "-1/20000",
                "1/500000",
            ],
        ),
    ];
    let prepared = prepare(cubic(2)).expect("a chain can be eliminated");
    let table = expand(&prepared.model, &prepared.form, &prepared.model.patterns[0]).expect("finite");
    let mut expected = BTreeMap::new();
    for (name, lambda, w, values) in fixture {
        for (row, value) in values.iter().enumerate().filter(|(_, value)| **value != "0") {
            expected.insert((name.to_owned(), 2 * row + 1), (parse(value).expect("a number"), lambda, w));
        }
    }
    let symbol = |name: &str| table.symbols.iter().position(|s| s == name).expect("declared");
    let (lambda, w) = (symbol("lambda"), symbol("w"));
    let found: BTreeMap<_, _> = table
        .entries()
        .map(|entry| {
            assert_eq!((entry.equation, entry.function, entry.pi), (0, Trig::Cos, 0));
            let name = table.parameters[entry.column.expect("no known terms")].to_string();
            let value = (entry.coefficient.clone(), entry.powers.exponent(&lambda), entry.powers.exponent(&w));
            ((name, entry.harmonic), value)
        })
        .collect();
    assert_eq!(found, expected);
    // At rest every derivative vanishes and x = 64/75 lambda.
    for (column, name) in table.parameters.iter().enumerate() {
        let entries = table.entries().filter(|entry| entry.column == Some(column));
        let sum: Rational = entries.map(|entry| entry.coefficient.clone()).sum();
        let expected = match name.as_str() {
            "c6" => ratio(64, 75),
            "c7" => ratio(64 * 64 * 64, 75 * 75 * 75),
            _ => integer(0),
        };
        assert_eq!(sum, expected, "{name}");
    }
}

#[test]
fn three_carts_have_fourteen_lumped_parameters() {
    let prepared = prepare(cubic(3)).expect("a chain can be eliminated");
    let motions: Vec<Vec<(u32, i32)>> =
        prepared.form.rows[0].terms.iter().map(|t| orders(&prepared.model, t)).collect();
    let expected: Vec<Vec<(u32, i32)>> = vec![
        vec![(6, 1)],
        vec![(4, 1)],
        vec![(2, 1), (4, 1)].into_iter().chain([(0, 1)]).collect(),
        vec![(2, 2), (4, 1)],
        vec![(0, 2), (4, 1)],
        vec![(2, 1), (4, 2)],
        vec![(0, 1), (4, 2)],
        vec![(4, 3)],
        vec![(2, 1)],
        vec![(0, 2), (2, 1)],
        vec![(0, 1), (2, 2)],
        vec![(2, 3)],
        vec![(0, 1)],
        vec![(0, 3)],
    ];
    let expected: Vec<Vec<(u32, i32)>> = expected
        .into_iter()
        .map(|mut m| {
            m.sort_unstable();
            m
        })
        .collect();
    assert_eq!(motions, expected);
    // The coefficients, as rational functions of the parameters.
    let definitions = |motion: &[(u32, i32)]| {
        let index = motions.iter().position(|m| m == motion).expect("present");
        canonical(&prepared.model, &prepared.form.columns[index].definition)
    };
    assert_eq!(definitions(&[(6, 1)]), "m1*m2*m3/g1/g2");
    assert_eq!(definitions(&[(4, 1)]), "m1*m2/g1 + m1*m3/g1 + m1*m3/g2 + m2*m3*k1/g1/g2 + m2*m3/g2");
    assert_eq!(definitions(&[(2, 1)]), "m1 + m2 + m2*k1/g1 + m3 + m3*k1/g1 + m3*k1/g2");
    assert_eq!(definitions(&[(0, 2), (4, 1)]), "3*m2*m3*k2/g1/g2");
    assert_eq!(definitions(&[(4, 3)]), "m2^3*m3^3*k2/g1^3/g2^3");
    // x1 = x3 + (g1 m3 + g2 m2 + g2 m3)/(g1 g2) x3'' + m2 m3/(g1 g2) x3''''
    let x1 = prepared.reconstruction(Coordinate(0)).expect("x1 was eliminated");
    assert_eq!(prepared.model.graph.polynomial(x1.expr).len(), 5);
    let table = expand(&prepared.model, &prepared.form, &prepared.model.patterns[0]).expect("finite");
    assert_eq!(table.highest_harmonic(0), 21);
    for (column, motion) in motions.iter().enumerate().filter(|(_, m)| m.iter().any(|(order, _)| *order > 0)) {
        let entries = table.entries().filter(|entry| entry.column == Some(column));
        let sum: Rational = entries.map(|entry| entry.coefficient.clone()).sum();
        assert_eq!(sum, integer(0), "{motion:?}");
    }
}

#[test]
fn lumped_parameters_have_the_predicted_number_and_rank() {
    // n' = (l + 1) + C(l + 2, 3) lumped parameters against 2 l + 1 physical ones.
    for l in 1..=4u32 {
        let prepared = prepare(cubic(l)).expect("a chain can be eliminated");
        let expected = u64::from(l) + 1 + u64::try_from(binomial(u64::from(l) + 2, 3)).expect("small");
        assert_eq!(prepared.form.columns.len() as u64, expected, "l = {l}");
        let map = ParameterMap::new(&prepared);
        let local = map.local_identifiability().expect("rational definitions");
        assert_eq!(local.rank, 2 * l as usize + 1, "l = {l}");
        assert!(local.determined.iter().all(|d| *d));
        // Without the cubic part of the spring the physical parameters are not identifiable.
        let linear = prepare(chain(Chain { masses: l, cubic: false, dampers: false })).expect("a chain");
        let map = ParameterMap::new(&linear);
        let local = map.local_identifiability().expect("rational definitions");
        assert_eq!((linear.form.columns.len(), local.rank), (l as usize + 1, l as usize + 1), "l = {l}");
        assert_eq!(map.parameters().len(), 2 * l as usize);
    }
    // The full sizes of the table: 7/5, 14/7 and 25/9.
    assert_eq!(prepare(cubic(4)).expect("a chain").form.columns.len(), 25);
}

#[test]
fn the_linear_two_cart_chain_is_not_identifiable() {
    let prepared = prepare(chain(Chain { masses: 2, cubic: false, dampers: false })).expect("a chain");
    let map = ParameterMap::new(&prepared);
    let local = map.local_identifiability().expect("rational definitions");
    assert_eq!((map.columns().len(), map.parameters().len(), local.rank), (3, 4, 3));
    let determined: Vec<&str> =
        map.parameters().iter().zip(&local.determined).filter(|(_, d)| **d).map(|(p, _)| map.name(*p)).collect();
    assert_eq!(determined, ["k1"]);
    let inverse = map.inverse();
    assert_eq!(inverse.solved.len(), 1);
    let unsolved: Vec<&str> = inverse.unsolved.iter().map(|p| map.name(*p)).collect();
    assert_eq!(unsolved, ["m1", "m2", "g1"]);
    assert!(inverse.constraints.is_empty());
}

#[test]
fn the_inverse_of_two_carts_and_its_constraints() {
    let prepared = prepare(cubic(2)).expect("a chain");
    let map = ParameterMap::new(&prepared);
    let inverse = map.inverse();
    assert!(inverse.unsolved.is_empty());
    let solved: Vec<(&str, String)> =
        inverse.solved.iter().map(|(p, value)| (map.name(*p), inverse.display(&map, value))).collect();
    // rho = c3/(3 c7): k1 = c6, k2 = c7, m1 = c1/rho, m2 = c2 - m1 - k1 rho, k3 = m2/rho, where k3 is g1 here.
    let expected = [("m1", "3*c1*c7/c3"), ("m2", "c3*g1/3/c7"), ("k1", "c6"), ("k2", "c7"), ("g1", "g1")];
    let expected: Vec<(&str, String)> = expected.iter().map(|(name, value)| (*name, (*value).to_owned())).collect();
    assert_eq!(solved, expected);
    assert_eq!(inverse.intermediates.len(), 1);
    assert_eq!(inverse.display(&map, &inverse.intermediates[0].value), "(-9*c1*c7^2 + 3*c2*c3*c7 - c3^2*c6)/c3^2");
    let constraints: Vec<(Option<usize>, String)> =
        inverse.constraints.iter().map(|c| (c.column, inverse.display(&map, &c.value))).collect();
    assert_eq!(constraints, [(Some(3), "c3^2/3/c7".to_owned()), (Some(4), "c3^3/27/c7^2".to_owned())]);
    assert_eq!(inverse.holds(&map), Some(true));
    // Without intermediates: m2 = (c2 c3 c7 - 3 c1 c7^2 - c3^2 c6/3)/(c3 c7)
    let whole = inverse.over_columns(&inverse.solved[1].1).expect("short");
    assert_eq!(whole.as_polynomial().map(Polynomial::len), Some(3));
    // The formulas at numbers give the masses and springs back.
    let point = |symbol: Symbol| 1.0 + 0.3 * f64::from(symbol.0);
    for (parameter, value) in inverse.evaluate(&map.evaluate(point), point) {
        assert!((value - point(parameter)).abs() < 1e-12, "{}", map.name(parameter));
    }
}

#[test]
fn longer_chains_have_closed_inverses_too() {
    // 14 - 7 and 25 - 9 constraints among the lumped parameters.
    for (masses, physical, constraints) in [(3, 7, 7), (4, 9, 16)] {
        let prepared = prepare(cubic(masses)).expect("a chain");
        let map = ParameterMap::new(&prepared);
        let inverse = map.inverse();
        assert!(inverse.unsolved.is_empty(), "{:?}", inverse.unsolved);
        assert_eq!((inverse.solved.len(), inverse.constraints.len()), (physical, constraints));
        assert_eq!(inverse.holds(&map), Some(true));
        // All relations are between products: powers of rho_1, rho_2, ... in x1 = sum rho_i x^(2i).
        let short = |c: &Constraint| c.value.as_polynomial().is_some_and(|value| value.len() == 1);
        assert!(inverse.constraints.iter().filter(|c| short(c)).count() >= constraints - masses as usize + 2);
        let point = |symbol: Symbol| 1.0 + 0.3 * f64::from(symbol.0);
        for (parameter, value) in inverse.evaluate(&map.evaluate(point), point) {
            assert!((value - point(parameter)).abs() < 1e-7, "{} {value}", map.name(parameter));
        }
    }
}

#[test]
fn jacobian_agrees_with_differences() {
    let prepared = prepare(cubic(3)).expect("a chain");
    let map = ParameterMap::new(&prepared);
    let point = |symbol: Symbol| 1.0 + 0.3 * f64::from(symbol.0);
    let jacobian = map.jacobian_at(point);
    for (i, &parameter) in map.parameters().iter().enumerate() {
        let h = 1e-6;
        let at = |sign: f64| map.evaluate(|s| point(s) + if s == parameter { sign * h } else { 0.0 });
        let (up, down) = (at(1.0), at(-1.0));
        for j in 0..map.columns().len() {
            let difference = (up[j] - down[j]) / (2.0 * h);
            assert!((difference - jacobian[j][i]).abs() < 1e-6 * (1.0 + difference.abs()), "{j} {i}");
        }
    }
}

/// Values of a coordinate and all its time derivatives at one instant, from the remaining coordinates' own.
struct Jet<'a> {
    model: ExactModel,
    parameters: &'a dyn Fn(Symbol) -> Rational,
    free: BTreeMap<(Coordinate, u32), Rational>,
}

impl Jet<'_> {
    fn exact(&self, expr: ExprId) -> Rational {
        let leaf = |node: &Node| match node {
            Node::Symbol(symbol) => Some((self.parameters)(*symbol)),
            Node::Derivative(coordinate, order) => self.free.get(&(*coordinate, *order)).cloned(),
            _ => None,
        };
        self.model.graph.evaluate_exact(expr, leaf).expect("polynomial expressions have rational values")
    }
}

/// Any smooth motion of the last mass, whose derivatives at an instant are arbitrary, satisfies the original equations
/// with the reconstructed coordinates, and the driven row's force is the regressor form's.
fn check_against_original(shape: Chain, values: &[i64]) {
    let model = chain(shape);
    let prepared = prepare(model.clone()).expect("a chain can be eliminated");
    let parameters = |symbol: Symbol| generic_point::value(7, symbol.0 as usize) / integer(1 << 28);
    let last = Coordinate(shape.masses - 1);
    let free: BTreeMap<(Coordinate, u32), Rational> =
        (0..).zip(values).map(|(order, value)| ((last, order), ratio(*value, 7))).collect();
    let mut jet = Jet { model: prepared.model.clone(), parameters: &parameters, free };
    let order = prepared.order();
    for reconstruction in &prepared.reconstructions {
        let mut expr = reconstruction.expr;
        for n in 0..=2 {
            let value = jet.exact(expr);
            jet.free.insert((reconstruction.coordinate, n), value);
            expr = jet.model.graph.time_derivative(expr);
        }
    }
    assert!(values.len() > order as usize);
    // The original rows: zero for the free ones; the driven one gives the force.
    let mut force = integer(0);
    for (i, equation) in model.equations.iter().enumerate() {
        let mut sum = integer(0);
        for term in &equation.terms {
            let input = model.graph.leaves(term.expr).into_iter().any(
                |leaf| matches!(model.graph.node(leaf), Node::Symbol(s) if model.quantity(*s).kind == Kind::Input),
            );
            if !input {
                sum += jet.exact(term.expr);
            }
        }
        if i == 0 { force = sum } else { assert_eq!(sum, integer(0), "row {i}") }
    }
    // The regressor form times the lumped parameters.
    let map = ParameterMap::new(&prepared);
    let lumped = map.evaluate_exact(parameters).expect("no division by zero");
    let mut sum = integer(0);
    for term in &prepared.form.rows[0].terms {
        let column = term.column.expect("no known terms");
        let mut product = &term.coefficient * &lumped[column];
        for (&atom, exponent) in term.atoms.factors() {
            product *= num_traits::pow::Pow::pow(&jet.exact(atom), exponent);
        }
        sum += product;
    }
    assert_eq!(sum, force);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    #[test]
    fn original_equations_hold_with_the_reconstructed_coordinates(
        values in prop::collection::vec(-9i64..10, 12),
        masses in 2u32..5,
        cubic in proptest::bool::ANY,
    ) {
        check_against_original(Chain { masses, cubic, dampers: false }, &values);
        prop_assert_eq!(values.len(), 12);
    }
}

#[test]
fn a_damper_between_the_masses_makes_elimination_an_integration() {
    let error =
        prepare(chain(Chain { masses: 2, cubic: true, dampers: true })).expect_err("x1' stands in the free row");
    let PrepareError::Eliminate(EliminateError::Impossible { coordinate, obstacles }) = &error else {
        panic!("{error}");
    };
    assert_eq!(coordinate, "x1");
    // The damper of the free row: m1 x1'', g1 (..), d1 (..), k1, k2, F are terms 1..=6, the free row's are 7, 8, 9.
    assert_eq!((obstacles[0].equation.as_str(), obstacles[0].term), ("eq2", TermId(9)));
    assert!(matches!(&obstacles[0].reason, Reason::Derivative(found) if found.contains("dot(x1)")), "{error}");
    assert_eq!(obstacles[1].reason, Reason::Input("F".to_owned()));
    assert_eq!(error.term(), Some(TermId(9)));
}

/// Faulty models, and models that are no chains.
struct Small {
    model: ExactModel,
    x: Vec<Coordinate>,
    next: u32,
}

impl Small {
    fn new(coordinates: &[&str], eliminated: &[usize]) -> Self {
        let mut model = ExactModel { name: "Small".to_owned(), ..ExactModel::default() };
        let x: Vec<Coordinate> = coordinates.iter().map(|name| model.declare_coordinate(name, None)).collect();
        let coordinates = eliminated.iter().map(|&i| x[i]).collect();
        model.eliminations.push(Elimination { coordinates, prefix: "c".to_owned() });
        Self { model, x, next: 0 }
    }

    fn q(&mut self, name: &str, kind: Kind) -> ExprId {
        let symbol = self.model.declare(name, None, kind);
        self.model.graph.symbol(symbol)
    }

    fn p(&mut self, name: &str) -> ExprId {
        self.q(name, Kind::Parameter)
    }

    fn d(&mut self, coordinate: usize, order: u32) -> ExprId {
        self.model.graph.derivative_of(self.x[coordinate], order)
    }

    fn product(&mut self, factors: &[ExprId]) -> ExprId {
        self.model.graph.product(factors)
    }

    fn row(&mut self, name: &str, terms: &[ExprId]) {
        let terms = terms.iter().map(|&expr| {
            self.next += 1;
            SourceTerm { id: TermId(self.next), expr }
        });
        let terms = terms.collect();
        self.model.equations.push(Equation { name: name.to_owned(), terms });
    }

    fn reason(self) -> Reason {
        match prepare(self.model).expect_err("not possible") {
            PrepareError::Eliminate(EliminateError::Impossible { mut obstacles, .. }) => {
                obstacles.swap_remove(0).reason
            }
            other => panic!("{other}"),
        }
    }
}

#[test]
fn a_sum_as_pivot_stays_an_explicit_denominator() {
    // m x1'' + k x1 = u, (a + b) x1 - a x2 = 0 without inertia: x1 = a/(a + b) x2.
    let mut s = Small::new(&["x1", "x2"], &[0]);
    let u = s.q("u", Kind::Input);
    let [m, k, a, b] = ["m", "k", "a", "b"].map(|name| s.p(name));
    let [x1, x1dd, x2] = [s.d(0, 0), s.d(0, 2), s.d(1, 0)];
    let minus = s.model.graph.neg(u);
    let driven = [s.product(&[m, x1dd]), s.product(&[k, x1]), minus];
    s.row("u", &driven);
    let pull = s.product(&[a, x2]);
    let pull = s.model.graph.neg(pull);
    let free = [s.product(&[a, x1]), s.product(&[b, x1]), pull];
    s.row("eq2", &free);
    let prepared = prepare(s.model).expect("a + b cannot vanish for positive parameters");
    let found: Vec<String> = prepared.form.columns.iter().map(|c| canonical(&prepared.model, &c.definition)).collect();
    assert_eq!(found, ["m*a/(a + b)", "k*a/(a + b)"]);
    let map = ParameterMap::new(&prepared);
    assert_eq!(map.local_identifiability().expect("rational").rank, 2);
    let definitions = map.rational_definitions().expect("sums are rational");
    assert_eq!(definitions[0].denominator().len(), 1);
    let point = |symbol: Symbol| integer(i64::from(symbol.0) + 1);
    // u is symbol 0, so m = 2, k = 3, a = 4, b = 5.
    assert_eq!(map.evaluate_exact(point), Some(vec![ratio(8, 9), ratio(12, 9)]));
    assert_eq!(definitions[0].evaluate(|s| point(*s)), Some(ratio(8, 9)));
}

#[test]
fn what_cancels_against_a_denominator_disappears() {
    // u = (a + b) x1 - a x2 + x3'' with (a + b) x1 = a x2: only x3'' m is left.
    let mut s = Small::new(&["x1", "x2", "x3"], &[0]);
    let u = s.q("u", Kind::Input);
    let [m, a, b] = ["m", "a", "b"].map(|name| s.p(name));
    let [x1, x2, x3dd] = [s.d(0, 0), s.d(1, 0), s.d(2, 2)];
    let pull = s.product(&[a, x2]);
    let pull = s.model.graph.neg(pull);
    let minus = s.model.graph.neg(u);
    let sum = s.model.graph.add(a, b);
    let push = s.product(&[sum, x1]);
    let driven = [push, pull, s.product(&[m, x3dd]), minus];
    s.row("u", &driven);
    s.row("eq2", &[push, pull]);
    let prepared = prepare(s.model).expect("possible");
    assert_eq!(prepared.form.columns.len(), 1);
    assert_eq!(prepared.form.rows[0].terms.len(), 1);
    assert_eq!(prepared.form.rows[0].terms[0].source, TermId(3));
}

#[test]
fn non_linear_free_rows_are_differentiated_with_the_chain_rule() {
    // m x1'' = u, k x1 - k x2 - q x2^3 - r sin(x2) = 0
    let mut s = Small::new(&["x1", "x2"], &[0]);
    let u = s.q("u", Kind::Input);
    let m = s.p("m");
    let [k, q, r] = ["k", "q", "r"].map(|name| s.q(name, Kind::Constant { value: None }));
    let [x1, x1dd, x2] = [s.d(0, 0), s.d(0, 2), s.d(1, 0)];
    let (cube, sine) = (s.model.graph.pow(x2, 3), s.model.graph.function(Function::Sin, x2));
    let minus = s.model.graph.neg(u);
    let driven = [s.product(&[m, x1dd]), minus];
    s.row("u", &driven);
    let free = [s.product(&[k, x1]), s.product(&[k, x2]), s.product(&[q, cube]), s.product(&[r, sine])];
    let free = [free[0], s.model.graph.neg(free[1]), s.model.graph.neg(free[2]), s.model.graph.neg(free[3])];
    s.row("eq2", &free);
    let prepared = prepare(s.model).expect("possible");
    // x1'' = x2'' + q/k (3 x2^2 x2'' + 6 x2 x2'^2) + r/k (cos(x2) x2'' - sin(x2) x2'^2): one parameter.
    assert_eq!(prepared.form.columns.len(), 1);
    assert_eq!(prepared.form.columns[0].name, "c1");
    assert_eq!(prepared.form.rows[0].terms.len(), 5);
    let mut coefficients: Vec<Rational> =
        prepared.form.rows[0].terms.iter().map(|term| term.coefficient.clone()).collect();
    coefficients.sort();
    assert_eq!(coefficients, [-1, 1, 1, 3, 6].map(integer));
}

#[test]
fn every_reason_names_its_term() {
    let build = |terms: fn(&mut Small) -> Vec<ExprId>| {
        let mut s = Small::new(&["x1", "x2"], &[0]);
        let u = s.q("u", Kind::Input);
        let m = s.p("m");
        let [x1, x2dd] = [s.d(0, 0), s.d(1, 2)];
        let minus = s.model.graph.neg(u);
        let driven = [s.product(&[m, x2dd]), x1, minus];
        s.row("u", &driven);
        let free = terms(&mut s);
        s.row("eq2", &free);
        s.reason()
    };
    let square = build(|s| {
        let (k, x1, x2) = (s.p("k"), s.d(0, 0), s.d(1, 0));
        let square = s.model.graph.pow(x1, 2);
        vec![s.product(&[k, square]), x2]
    });
    assert_eq!(square, Reason::NonLinear("k*x1^2".to_owned()));
    let sine = build(|s| {
        let (x1, x2) = (s.d(0, 0), s.d(1, 0));
        vec![s.model.graph.function(Function::Sin, x1), x2]
    });
    assert_eq!(sine, Reason::NonLinear("sin(x1)".to_owned()));
    let moving = build(|s| {
        let (k, x1, x2) = (s.p("k"), s.d(0, 0), s.d(1, 0));
        vec![s.product(&[k, x1, x2]), x2]
    });
    assert_eq!(moving, Reason::MovingFactor("k*x2".to_owned()));
    let zero = build(|s| {
        let (k, x1, x2) = (s.p("k"), s.d(0, 0), s.d(1, 0));
        let push = s.product(&[k, x1]);
        let pull = s.model.graph.neg(push);
        vec![push, x2, pull]
    });
    assert_eq!(zero, Reason::ZeroFactor);
    let constant = build(|s| {
        let zero = s.q("z", Kind::Constant { value: Some(integer(0)) });
        let (x1, x2) = (s.d(0, 0), s.d(1, 0));
        vec![s.product(&[zero, x1]), x2]
    });
    assert_eq!(constant, Reason::ZeroFactor);
}

#[test]
fn an_absent_coordinate_and_one_equation_for_two_are_refused() {
    let mut s = Small::new(&["x1", "x2", "y"], &[2]);
    let u = s.q("u", Kind::Input);
    let m = s.p("m");
    let x = s.d(0, 2);
    let minus = s.model.graph.neg(u);
    let driven = [s.product(&[m, x]), minus];
    s.row("u", &driven);
    let error = prepare(s.model).expect_err("y is nowhere");
    assert_eq!(error, PrepareError::Eliminate(EliminateError::Absent { coordinate: "y".to_owned() }));

    // x1 and x2 both only in one free row.
    let mut s = Small::new(&["x1", "x2", "y"], &[0, 1]);
    let u = s.q("u", Kind::Input);
    let m = s.p("m");
    let [x1, x2, y, ydd] = [s.d(0, 0), s.d(1, 0), s.d(2, 0), s.d(2, 2)];
    let minus = s.model.graph.neg(u);
    let driven = [s.product(&[m, ydd]), x1, x2, minus];
    s.row("u", &driven);
    s.row("eq2", &[x1, x2, y]);
    let error = prepare(s.model).expect_err("one row for two coordinates");
    let PrepareError::Eliminate(EliminateError::Impossible { obstacles, .. }) = &error else { panic!("{error}") };
    assert!(obstacles.iter().any(|o| matches!(o.reason, Reason::Taken(_))), "{error}");
}

#[test]
fn a_chain_eliminated_to_its_driven_cart_is_refused() {
    let mut model = cubic(3);
    model.eliminations[0].coordinates = vec![Coordinate(1), Coordinate(2)];
    let error = prepare(model).expect_err("x3 has its inertia in its only row");
    assert!(error.to_string().contains("x3"), "{error}");
    assert!(error.to_string().contains("derivative"), "{error}");
}

#[test]
fn the_middle_of_a_chain_can_be_kept_when_the_order_of_solving_is_free() {
    // Masses 1, 2, 3 with mass 2 and 3 swapped in the equations: the search finds its order all the same.
    let mut model = cubic(3);
    model.equations.swap(1, 2);
    model.eliminations[0].coordinates.reverse();
    let swapped = prepare(model).expect("a chain can be eliminated");
    let straight = prepare(cubic(3)).expect("a chain can be eliminated");
    let definitions =
        |p: &Prepared| -> Vec<String> { p.form.columns.iter().map(|c| canonical(&p.model, &c.definition)).collect() };
    assert_eq!(definitions(&swapped), definitions(&straight));
}

#[test]
fn lumps_rename_and_names_do_not_clash() {
    let mut model = cubic(2);
    let (m1, m2, g1) = ("m1", "m2", "g1");
    let [m1, m2, g1] = [m1, m2, g1].map(|name| {
        let symbol = model.find_symbol(name).expect("declared");
        model.graph.symbol(symbol)
    });
    let product = model.graph.mul(m1, m2);
    let expr = model.graph.div(product, g1);
    model.lumps.push(Lump { name: "stiff".to_owned(), expr, id: TermId(99) });
    model.declare("c2", None, Kind::Constant { value: None });
    let prepared = prepare(model).expect("a chain can be eliminated");
    let names: Vec<&str> = prepared.form.columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["stiff", "c2_", "c3", "c4", "c5", "c6", "c7"]);
}

#[test]
fn without_eliminations_the_form_is_the_plain_one() {
    let mut model = cubic(2);
    model.eliminations.clear();
    let prepared = prepare(model.clone()).expect("linear in the parameters");
    assert_eq!(prepared.form, tpm_symbolic::regressor::form::regressor_form(&model).expect("linear in the parameters"));
    assert!(prepared.reconstructions.is_empty());
}
