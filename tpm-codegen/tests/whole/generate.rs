//! Emitted source files of models built by hand.

use tpm_codegen::emit::estimator::{EmitError, EstimatorSource, Identified, IdentifiedError};
use tpm_codegen::generate::{Language, Options, generate};
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::ExprId;
use tpm_symbolic::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
use tpm_symbolic::mechanics::pattern::{Motion, Pattern, rest_to_rest};
use tpm_symbolic::mechanics::unit::Unit;

/// Feng, Eqn 3.24: m x'' + k1 x + k2 x'^2 = u.
fn mass_spring_drag() -> ExactModel {
    let mut model = ExactModel { name: "MassSpringDrag".to_owned(), ..ExactModel::default() };
    let (newton, metre, second) = (Unit::named("N"), Unit::named("m"), Unit::named("s"));
    let x = model.declare_coordinate("x", Some(metre.clone()));
    let mut quantity = |name: &str, unit: Unit, kind: Kind| {
        let symbol = model.declare(name, Some(unit), kind);
        (symbol, model.graph.symbol(symbol))
    };
    let (_, u) = quantity("u", newton.clone(), Kind::Input);
    let (_, m) = quantity("m", Unit::named("kg"), Kind::Parameter);
    let (_, k1) = quantity("k1", newton.mul(&metre.pow(-1)), Kind::Parameter);
    let (_, k2) = quantity("k2", newton.mul(&second.pow(2)).mul(&metre.pow(-2)), Kind::Parameter);
    let (lambda, _) = quantity("lambda", metre, Kind::Amplitude);
    let (w, _) = quantity("w", Unit::named("rad").mul(&second.pow(-1)), Kind::Frequency);
    let graph = &mut model.graph;
    let [position, velocity, acceleration] = [0, 1, 2].map(|order| graph.derivative_of(x, order));
    let drag = graph.pow(velocity, 2);
    let terms: [ExprId; 4] = [graph.mul(m, acceleration), graph.mul(k1, position), graph.mul(k2, drag), graph.neg(u)];
    let terms = (0..).zip(terms).map(|(id, expr)| SourceTerm { id: TermId(id), expr }).collect();
    model.equations.push(Equation { name: "u".to_owned(), terms });
    let motion = Motion::term(Monomial::power_of(lambda, 1), rest_to_rest(3).expect("odd order"));
    model.patterns.push(Pattern { name: None, amplitudes: vec![lambda], frequency: w, motions: vec![Some(motion)] });
    model
}

fn options() -> Options<'static> {
    let command = "tpm generate mass_spring_drag.tpm --lang rust";
    Options::new(Language::Rust, command)
}

#[test]
fn mass_spring_drag_as_a_file() {
    let estimator = EstimatorSource::new(mass_spring_drag()).expect("linear");
    let files = generate(&estimator, &options()).expect("emits");
    assert_eq!(files.len(), 1);
    assert_eq!(files[0].name, "mass_spring_drag.rs");
    let again = generate(&EstimatorSource::new(mass_spring_drag()).expect("linear"), &options()).expect("emits");
    assert_eq!(files, again, "equal models give equal bytes");
    for formula in ["u, cos 0, k2: 5/9*lambda^2*w^2", "u, cos 1, m: -lambda*w^2", "u, cos 6, k2: -1/18*lambda^2*w^2"] {
        assert!(files[0].text.contains(formula), "{formula} is missing");
    }
    insta::assert_snapshot!(files[0].text);
}

const RESULT: &str = r#"{"schema": "tpm.identification/1", "model": "MassSpringDrag", "hold": "none", "harmonics": 6,
 "parameters": [{"name": "k1", "unit": "N/m", "prior": null, "value": 40.25, "std": 0.125, "status": "identified"},
  {"name": "m", "unit": "kg", "prior": null, "value": 2.0, "std": 0.1, "status": "identified"},
  {"name": "k2", "unit": null, "prior": -1.5, "value": null, "std": null, "status": "unobservable"}],
 "physical": [], "unobservable": [], "covariance": [], "rank": 2, "condition": 4.3, "residual": 0.033, "runs": [], "warnings": []}"#;

#[test]
fn identified_values_are_baked_in_by_name() {
    let estimator = EstimatorSource::new(mass_spring_drag()).expect("linear");
    let identified = Identified::from_json(RESULT).expect("the contract's schema");
    let files = generate(&estimator, &Options { identified: Some(&identified), ..options() }).expect("emits");
    let constant =
        "pub const IDENTIFIED: Parameters<f64> = Parameters {\n    m: 2.0,\n    k1: 40.25,\n    k2: -1.5,\n};";
    assert!(files[0].text.contains(constant), "{}", files[0].text);
    assert!(files[0].text.contains("/// | `k2` | -1.5 | unknown | unobservable |"));
}

#[test]
fn identified_values_that_do_not_fit_are_refused() {
    let estimator = EstimatorSource::new(mass_spring_drag()).expect("linear");
    let refused = |text: &str| {
        let identified = match Identified::from_json(text) {
            Ok(identified) => identified,
            Err(error) => return EmitError::from(error),
        };
        generate(&estimator, &Options { identified: Some(&identified), ..options() }).expect_err("does not fit")
    };
    let other = refused(&RESULT.replace("MassSpringDrag", "Emps"));
    assert!(matches!(other, EmitError::Identified(IdentifiedError::Model { .. })), "{other}");
    let missing = refused(&RESULT.replace("\"k1\"", "\"k9\""));
    assert_eq!(missing, EmitError::Identified(IdentifiedError::Missing("k1".to_owned())));
    let empty = refused(&RESULT.replace("-1.5", "null"));
    assert_eq!(empty, EmitError::Identified(IdentifiedError::Missing("k2".to_owned())));
    let schema = refused(&RESULT.replace("identification/1", "identification/9"));
    assert!(schema.to_string().contains("tpm.identification/9"), "{schema}");
    assert!(matches!(refused("[]"), EmitError::Identified(IdentifiedError::Schema(_))));
}

#[test]
fn numbers_beyond_double_precision_are_refused() {
    let mut model = mass_spring_drag();
    let large = tpm_symbolic::number::rational::power(&tpm_symbolic::number::rational::integer(10), 400);
    let first = model.equations[0].terms[0].expr;
    model.equations[0].terms[0].expr = model.graph.scale(first, large);
    let error = EstimatorSource::new(model).expect_err("1e400 is no double");
    assert!(error.to_string().contains("beyond double precision"), "{error}");
}

/// The generated C of a model in the language.
fn header_of(text: &str) -> String {
    let source = tpm_codegen::Source::from_bytes("model.tpm", text.as_bytes().to_vec());
    let parsed = tpm_codegen::parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let estimator = EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message));
    let files = generate(&estimator, &Options::new(Language::C, "tpm generate")).expect("emits");
    // Lines are broken anywhere.
    files[0].text.replace("\n * ", " ")
}

#[test]
fn the_way_back_to_physical_parameters_is_there_or_said_to_be_missing() {
    let model = |equation: &str| format!("model M {{ coordinate x; input u; parameter m, a, b; {equation} = u; }}");
    let there = header_of(&model("m*ddot(x) + a*b*x + a^2*b*dot(x)"));
    assert!(there.contains("void m_unlump(") && !there.contains("no way back"), "{there}");
    let open = header_of(&model("m*ddot(x) + a*b*x"));
    assert!(open.contains("void m_lump(") && !open.contains("unlump"), "{open}");
    assert!(open.contains("the estimated parameters do not determine `a`, `b`"), "{open}");
    let root = header_of(&model("m*ddot(x) + a^2*x + b*dot(x)"));
    assert!(!root.contains("unlump") && root.contains("no rational function of the estimated"), "{root}");
    assert!(root.contains("gives `a`."), "{root}");
    let own = header_of(&model("m*ddot(x) + a*x + b*dot(x)"));
    assert!(!own.contains("lump") && !own.contains("no way back"), "{own}");
}

/// Values of the declared parameters are enough where the equations show sums and products of them; a value of a sum itself comes first.
#[test]
fn sums_follow_from_given_values() {
    let text = "model M { coordinate x; input u; parameter m1, m2, d, l; (m1 + m2)*ddot(x) + d*l^2*dot(x) = u; }";
    let estimator =
        EstimatorSource::of(&crate::support::parse(text)).unwrap_or_else(|fault| panic!("{}", fault.message));
    let emitted = |values: &[(&str, f64)]| {
        let values = values.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        let identified = Identified::of_values("M", &values);
        generate(&estimator, &Options { identified: Some(&identified), ..options() }).map(|files| files[0].text.clone())
    };
    let all = [("m1", 1.0), ("m2", 2.5), ("d", 0.5), ("l", 3.0)];
    let text = emitted(&all).expect("every parameter has a value");
    assert!(text.contains("m1_plus_m2: 3.5") && text.contains(": 4.5,"), "{text}");
    let own = emitted(&[("m1_plus_m2", 7.25), ("d", 0.5), ("l", 3.0)]).expect("the sum has a value");
    assert!(own.contains("m1_plus_m2: 7.25"), "{own}");
    let missing = emitted(&all[..3]).expect_err("l has no value").to_string();
    assert!(missing.contains("no identified value"), "{missing}");
}

#[test]
fn a_model_without_a_pattern_is_whole_for_logs() {
    let mut model = mass_spring_drag();
    model.patterns.clear();
    let files = generate(&EstimatorSource::new(model).expect("linear"), &options()).expect("emits");
    let text = &files[0].text;
    assert!(text.contains("pub fn feed_forward") && text.contains("pub trait Real"));
    // It stands alone: the runtime's trait and solver are for those who have them.
    assert!(!text.contains("tpm_runtime") && !text.contains("least_squares"));
    assert!(!text.contains("pub struct Pattern") && text.contains("declares no pattern"));
}
