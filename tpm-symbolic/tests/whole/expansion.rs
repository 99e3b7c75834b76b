//! Expansion of small models built by hand, against the printed equations.

use tpm_symbolic::algebra::fourier::{Fourier, Trig};
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{Coordinate, ExprId, Function, Symbol};
use tpm_symbolic::harmonic::expand::{ExpandError, expand};
use tpm_symbolic::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
use tpm_symbolic::mechanics::pattern::{Motion, Pattern, rest_to_rest};
use tpm_symbolic::number::rational::ratio;
use tpm_symbolic::regressor::form::{RegressorError, regressor_form};

struct Builder {
    model: ExactModel,
    next: u32,
}

impl Builder {
    fn new() -> Self {
        Self { model: ExactModel { name: "Test".to_owned(), ..ExactModel::default() }, next: 0 }
    }

    fn quantity(&mut self, name: &str, kind: Kind) -> ExprId {
        let symbol = self.model.declare(name, None, kind);
        self.model.graph.symbol(symbol)
    }

    fn equation(&mut self, name: &str, terms: &[ExprId]) {
        let terms = terms.iter().map(|&expr| {
            self.next += 1;
            SourceTerm { id: TermId(self.next), expr }
        });
        let terms = terms.collect();
        self.model.equations.push(Equation { name: name.to_owned(), terms });
    }

    fn pattern(&mut self, coordinate: Coordinate, order: u32) {
        let amplitude = self.model.declare("lambda", None, Kind::Amplitude);
        let frequency = self.model.declare("w", None, Kind::Frequency);
        let shape = rest_to_rest(order).expect("odd order");
        let mut motions = vec![None; self.model.coordinates.len()];
        motions[coordinate.0 as usize] = Some(Motion::term(Monomial::power_of(amplitude, 1), shape));
        self.model.patterns.push(Pattern { name: None, amplitudes: vec![amplitude], frequency, motions });
    }
}

/// Feng, Eqn 3.24: m x'' + k1 x + k2 x'^2 = u.
fn mass_spring_drag() -> ExactModel {
    let mut b = Builder::new();
    let x = b.model.declare_coordinate("x", None);
    let u = b.quantity("u", Kind::Input);
    let [m, k1, k2] = ["m", "k1", "k2"].map(|name| b.quantity(name, Kind::Parameter));
    let graph = &mut b.model.graph;
    let (x0, x1, x2) = (graph.derivative_of(x, 0), graph.derivative_of(x, 1), graph.derivative_of(x, 2));
    let drag = graph.pow(x1, 2);
    let terms = [graph.mul(m, x2), graph.mul(k1, x0), graph.mul(k2, drag), graph.neg(u)];
    b.equation("eq1", &terms);
    b.pattern(x, 3);
    b.model
}

#[test]
fn the_table_is_that_of_feng_3_26() {
    let model = mass_spring_drag();
    let form = regressor_form(&model).expect("linear in the parameters");
    assert_eq!(form.rows[0].name, "u");
    let table = expand(&model, &form, &model.patterns[0]).expect("finite");
    let found: Vec<_> = table
        .entries()
        .map(|entry| {
            let power = |name: &str| {
                let index = table.symbols.iter().position(|symbol| symbol == name).expect("declared");
                entry.powers.exponent(&index)
            };
            let parameter = table.parameters[entry.column.expect("no known term")].as_str();
            assert_eq!(entry.function, Trig::Cos);
            (entry.harmonic, parameter, entry.coefficient.clone(), power("lambda"), power("w"))
        })
        .collect();
    let expected = vec![
        (0, "k2", ratio(5, 9), 2, 2),
        (1, "m", ratio(-1, 1), 1, 2),
        (1, "k1", ratio(1, 1), 1, 0),
        (2, "k2", ratio(-5, 6), 2, 2),
        (3, "m", ratio(1, 1), 1, 2),
        (3, "k1", ratio(-1, 9), 1, 0),
        (4, "k2", ratio(1, 3), 2, 2),
        (6, "k2", ratio(-1, 18), 2, 2),
    ];
    assert_eq!(found, expected);
}

#[test]
fn tables_survive_json() {
    let model = mass_spring_drag();
    let form = regressor_form(&model).expect("linear in the parameters");
    let table = expand(&model, &form, &model.patterns[0]).expect("finite");
    let json = serde_json::to_value(&table).expect("a table is plain data");
    assert_eq!(json["entries"][0]["coefficient"], "5/9");
    let back: tpm_symbolic::harmonic::table::HarmonicTable = serde_json::from_value(json.clone()).expect("own output");
    assert_eq!(serde_json::to_value(&back).expect("a table is plain data"), json);
    let model: ExactModel =
        serde_json::from_str(&serde_json::to_string(&model).expect("plain data")).expect("own output");
    assert_eq!(regressor_form(&model).expect("linear in the parameters"), form);
}

#[test]
fn products_of_parameters_are_lumped_and_equal_regressors_merged() {
    // (M + m) x'' + m L cos(x) x'^2 = u
    let mut b = Builder::new();
    let x = b.model.declare_coordinate("x", None);
    let u = b.quantity("u", Kind::Input);
    let [big, small, length] = ["M", "m", "L"].map(|name| b.quantity(name, Kind::Parameter));
    let graph = &mut b.model.graph;
    let (x0, x1, x2) = (graph.derivative_of(x, 0), graph.derivative_of(x, 1), graph.derivative_of(x, 2));
    let (sum, cosine, square) = (graph.add(big, small), graph.function(Function::Cos, x0), graph.pow(x1, 2));
    let terms = [graph.mul(sum, x2), graph.product(&[small, length, cosine, square]), graph.neg(u)];
    b.equation("eq1", &terms);
    b.pattern(x, 3);
    let form = regressor_form(&b.model).expect("linear in the lumped parameters");
    let names: Vec<&str> = form.columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["M_plus_m", "m_L"]);
    let error = expand(&b.model, &form, &b.model.patterns[0]).expect_err("cos(x) has no finite series");
    assert_eq!(error, ExpandError::NotFinite { term: TermId(2), atom: "cos(x)".to_owned() });
}

#[test]
fn a_parameter_inside_a_function_of_the_motion_is_refused() {
    let mut b = Builder::new();
    let x = b.model.declare_coordinate("x", None);
    let u = b.quantity("u", Kind::Input);
    let k = b.quantity("k", Kind::Parameter);
    let graph = &mut b.model.graph;
    let x0 = graph.derivative_of(x, 0);
    let argument = graph.mul(k, x0);
    let terms = [graph.function(Function::Sin, argument), graph.neg(u)];
    b.equation("eq1", &terms);
    let error = regressor_form(&b.model).expect_err("not linear");
    assert!(matches!(error, RegressorError::InsideFunction { term: TermId(1), .. }), "{error}");
}

#[test]
fn an_input_with_unknown_factor_divides_its_row() {
    // J x'' + Kt Kb / R x' = Kt / R e: estimated are J R / Kt and Kb.
    let mut b = Builder::new();
    let x = b.model.declare_coordinate("x", None);
    let e = b.quantity("e", Kind::Input);
    let [j, kt, kb, r] = ["J", "Kt", "Kb", "R"].map(|name| b.quantity(name, Kind::Parameter));
    let graph = &mut b.model.graph;
    let (x1, x2) = (graph.derivative_of(x, 1), graph.derivative_of(x, 2));
    let back = graph.product(&[kt, kb, x1]);
    let drive = graph.mul(kt, e);
    let drive = graph.div(drive, r);
    let terms = [graph.mul(j, x2), graph.div(back, r), graph.neg(drive)];
    b.equation("eq1", &terms);
    let form = regressor_form(&b.model).expect("linear in the lumped parameters");
    let names: Vec<&str> = form.columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["Kb", "J_R_per_Kt"]);
    assert_eq!(form.rows[0].name, "e");
    assert_eq!(form.rows[0].inputs[0].1.as_constant(), Some(ratio(1, 1)));
}

#[test]
fn offsets_and_two_amplitudes_stay_symbolic() {
    // k x^2 = u with x = c + a cos + b sin 2
    let mut b = Builder::new();
    let x = b.model.declare_coordinate("x", None);
    let u = b.quantity("u", Kind::Input);
    let k = b.quantity("k", Kind::Parameter);
    let graph = &mut b.model.graph;
    let x0 = graph.derivative_of(x, 0);
    let square = graph.pow(x0, 2);
    let terms = [graph.mul(k, square), graph.neg(u)];
    b.equation("eq1", &terms);
    let c = b.model.declare("c", None, Kind::Constant { value: None });
    let [a1, a2] = ["a", "b"].map(|name| b.model.declare(name, None, Kind::Amplitude));
    let w = b.model.declare("w", None, Kind::Frequency);
    let one = || ratio(1, 1);
    let part = |symbol: Symbol, fourier: Fourier| Motion::term(Monomial::power_of(symbol, 1), fourier);
    let motion =
        part(c, Fourier::constant(one())).add(&part(a1, Fourier::cos(1, one()))).add(&part(a2, Fourier::sin(2, one())));
    b.model.patterns.push(Pattern { name: None, amplitudes: vec![a1, a2], frequency: w, motions: vec![Some(motion)] });
    let form = regressor_form(&b.model).expect("linear");
    let table = expand(&b.model, &form, &b.model.patterns[0]).expect("finite");
    // c^2 + a^2/2 + b^2/2; 2ac cos 1; a^2/2 cos 2; 2bc sin 2; ab (sin 1 + sin 3); -b^2/2 cos 4
    let shape: Vec<_> = table.entries().map(|e| (e.harmonic, e.function, e.coefficient.clone())).collect();
    let expected = vec![
        (0, Trig::Cos, one()),
        (0, Trig::Cos, ratio(1, 2)),
        (0, Trig::Cos, ratio(1, 2)),
        (1, Trig::Cos, ratio(2, 1)),
        (1, Trig::Sin, one()),
        (2, Trig::Cos, ratio(1, 2)),
        (2, Trig::Sin, ratio(2, 1)),
        (3, Trig::Sin, one()),
        (4, Trig::Cos, ratio(-1, 2)),
    ];
    assert_eq!(shape, expected);
}
