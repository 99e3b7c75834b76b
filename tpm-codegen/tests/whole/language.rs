//! The language's texts: fixtures as data, round trips, and that nothing panics.
//!
//! A file dropped into `tests/fixtures/language/pass` must parse and check without errors, and its warnings, if any, stand in a
//! `.txt` file beside it. One in `fail` must not, and the `.txt` file holds what is said. `TPM_UPDATE_FIXTURES=1` writes them.

use std::fs;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use tpm_codegen::diagnostic::Diagnostics;
use tpm_codegen::language;
use tpm_codegen::parse_value;
use tpm_codegen::source::Source;
use tpm_symbolic::mechanics::model::{ExactModel, Kind};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn models_in(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = fs::read_dir(folder)
        .expect("the folder")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "tpm"))
        .collect();
    files.sort();
    assert!(!files.is_empty(), "{} has no models", folder.display());
    files
}

fn source(path: &Path) -> Source {
    Source::from_bytes(path.file_name().expect("a name").to_string_lossy(), fs::read(path).expect("a file"))
}

/// Compares messages with the text file beside a fixture; a fixture without one has no messages.
fn compare(path: &Path, said: &str, faults: &mut Vec<String>) {
    let beside = path.with_extension("txt");
    if std::env::var_os("TPM_UPDATE_FIXTURES").is_some() {
        if said.is_empty() {
            let _ = fs::remove_file(&beside);
        } else {
            fs::write(&beside, said).expect("writable");
        }
    }
    let expected = fs::read_to_string(&beside).unwrap_or_default();
    if expected != said {
        faults.push(format!("{}: expected\n{expected}\nfound\n{said}", path.display()));
    }
}

/// A model's printed text parses to the same model.
fn assert_round_trip(source: &Source) {
    let parsed = |source: &Source| {
        let mut model = language::parse(source).unwrap_or_else(|error| panic!("{}", error.render(source)));
        model.forget_spans();
        model
    };
    let model = parsed(source);
    assert_eq!(parsed(&Source::new("printed", model.to_string())), model);
}

#[test]
fn fixtures_that_pass_warn_of_what_stands_beside_them() {
    let mut faults = Vec::new();
    for path in models_in(&root().join("tests/fixtures/language/pass")) {
        let source = source(&path);
        match language::parse_model(&source) {
            Ok(parsed) => {
                compare(&path, &parsed.warnings.render(&source), &mut faults);
                assert_round_trip(&source);
            }
            Err(errors) => faults.push(errors.render(&source)),
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn fixtures_that_fail_say_what_stands_beside_them() {
    let mut faults = Vec::new();
    for path in models_in(&root().join("tests/fixtures/language/fail")) {
        let source = source(&path);
        match language::parse_model(&source) {
            Ok(_) => faults.push(format!("{} is accepted", path.display())),
            Err(errors) => compare(&path, &errors.render(&source), &mut faults),
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn shipped_models_are_clean() {
    for path in models_in(&root().join("models")) {
        let source = source(&path);
        let parsed = language::parse_model(&source).unwrap_or_else(|errors| panic!("{}", errors.render(&source)));
        assert!(parsed.warnings.is_empty(), "{}", parsed.warnings.render(&source));
        assert_round_trip(&source);
    }
}

fn judge(text: &[u8]) -> Result<(), Box<(Source, Diagnostics)>> {
    let source = Source::from_bytes("garbage", text.to_vec());
    language::parse_model(&source).map(|_| ()).map_err(|errors| Box::new((source, errors)))
}

#[test]
fn ten_megabytes_of_garbage_are_refused_on_one_page() {
    let mut state = 1_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    };
    let texts: [Vec<u8>; 7] = [
        (0..10_000_000).map(|_| random()).collect(),
        (0..10_000_000).map(|_| b' ' + random() % 95).collect(),
        (0..10_000_000).map(|_| b"model A{}()[];=+-*/^x1, \n\0'"[usize::from(random()) % 27]).collect(),
        b"model A { ".iter().copied().chain(b"x = (".iter().copied().cycle().take(10_000_000)).collect(),
        b"model A { ".iter().copied().chain(b"x+".iter().copied().cycle().take(10_000_000)).collect(),
        b"model A { x = ".iter().copied().chain(b"7".iter().copied().cycle().take(10_000_000)).collect(),
        vec![0; 10_000_000],
    ];
    for text in texts {
        let (source, errors) = *judge(&text).unwrap_err();
        let page = errors.render(&source);
        assert!(page.len() < 60_000, "{}", page.len());
        assert!(page.contains("garbage:1:") || page.contains("garbage:"), "{page}");
    }
}

/// Models as a program would build them, with spans that mean nothing.
mod built {
    use proptest::prelude::*;
    use tpm_codegen::language::ast::{
        Count, Declaration, Definition, Eliminate, Energy, EnergyKind, Equation, Expr, ExprKind, Force, Ident, Item,
        ModelDeclaration, Motion, Operation, PatternDeclaration, PatternItem, PreslidingOf, Quantity, Role,
        SeriesDeclaration, Sign, Taylor, UnitExpr,
    };
    use tpm_codegen::source::Span;
    use tpm_symbolic::number::rational::Rational;
    use tpm_units::Exponent;

    const NOWHERE: Span = Span { start: 0, end: 0 };

    fn ident() -> impl Strategy<Value = Ident> {
        prop_oneof![
            "[a-zA-Z_][a-zA-Z0-9_]{0,3}",
            Just("as".to_owned()),
            Just("model".to_owned()),
            Just("pattern".to_owned())
        ]
        // A declared name decides whether `kinetic = ...` is an energy, and these models declare at random.
        .prop_map(|name| Ident { name, span: NOWHERE })
    }

    fn expr(kind: ExprKind) -> Expr {
        Expr { kind, span: NOWHERE }
    }

    fn number() -> impl Strategy<Value = Rational> {
        (0_u64.., 0_u32..60)
            .prop_map(|(digits, places)| Rational::new(digits.into(), num_traits::pow(10.into(), places as usize)))
    }

    pub(super) fn expression() -> impl Strategy<Value = Expr> {
        let leaf =
            prop_oneof![number().prop_map(ExprKind::Number), ident().prop_map(|ident| ExprKind::Name(ident.name))]
                .prop_map(expr);
        leaf.prop_recursive(5, 40, 4, |inner| {
            let sign = prop_oneof![Just(Sign::Plus), Just(Sign::Minus)];
            let operation = prop_oneof![Just(Operation::Times), Just(Operation::Over)];
            prop_oneof![
                (ident(), prop::collection::vec(inner.clone(), 0..3))
                    .prop_map(|(name, arguments)| ExprKind::Call(name, arguments)),
                inner.clone().prop_map(|inner| ExprKind::Negative(Box::new(inner))),
                (inner.clone(), any::<u32>()).prop_map(|(base, exponent)| ExprKind::Power(Box::new(base), exponent)),
                (inner.clone(), prop::collection::vec((sign, inner.clone()), 1..4)).prop_map(|(first, mut rest)| {
                    rest.insert(0, (Sign::Plus, first));
                    ExprKind::Sum(rest)
                }),
                (inner.clone(), prop::collection::vec((operation, inner), 1..4)).prop_map(|(first, mut rest)| {
                    rest.insert(0, (Operation::Times, first));
                    ExprKind::Product(rest)
                }),
            ]
            .prop_map(expr)
        })
    }

    fn power() -> impl Strategy<Value = Exponent> {
        (-9_i64..10, 1_i64..13).prop_map(|(above, below)| Exponent::new(above, below))
    }

    fn unit() -> impl Strategy<Value = Option<UnitExpr>> {
        prop::option::of(
            prop::collection::vec((ident(), power()), 0..4).prop_map(|factors| UnitExpr { factors, span: NOWHERE }),
        )
    }

    fn count() -> impl Strategy<Value = Count> {
        any::<u32>().prop_map(|value| Count { value, span: NOWHERE })
    }

    fn declaration(role: Role) -> impl Strategy<Value = Declaration> {
        let value = prop::option::of(expression());
        let quantities = prop::collection::vec((ident(), value, unit()), 1..4);
        (quantities, any::<bool>()).prop_map(move |(quantities, unmeasured)| Declaration {
            role,
            unmeasured: unmeasured && role == Role::Coordinate,
            presliding: None,
            quantities: quantities
                .into_iter()
                .map(|(name, value, unit)| Quantity { name, value: value.filter(|_| role == Role::Constant), unit })
                .collect(),
        })
    }

    /// `presliding z of q over 0.001;`
    fn presliding() -> impl Strategy<Value = Declaration> {
        (ident(), ident(), expression()).prop_map(|(name, coordinate, travel)| Declaration {
            role: Role::Coordinate,
            unmeasured: false,
            presliding: Some(PreslidingOf { coordinate, travel }),
            quantities: vec![Quantity {
                name,
                value: None,
                unit: Some(UnitExpr { factors: Vec::new(), span: NOWHERE }),
            }],
        })
    }

    fn definition() -> impl Strategy<Value = Definition> {
        (ident(), expression()).prop_map(|(name, value)| Definition { name, value })
    }

    fn item() -> impl Strategy<Value = Item> {
        prop_oneof![
            prop_oneof![Just(Role::Coordinate), Just(Role::Input), Just(Role::Parameter), Just(Role::Constant)]
                .prop_flat_map(declaration)
                .prop_map(Item::Declaration),
            presliding().prop_map(Item::Declaration),
            (
                ident(),
                ident(),
                unit(),
                prop::option::of(expression()),
                expression(),
                count(),
                prop::collection::vec(ident(), 0..3)
            )
                .prop_map(|(function, coordinate, unit, definition, point, order, coefficients)| {
                    Item::Series(SeriesDeclaration {
                        function,
                        coordinate,
                        unit,
                        definition,
                        point,
                        order,
                        coefficients,
                    })
                }),
            definition().prop_map(Item::Let),
            definition().prop_map(Item::Lump),
            (expression(), expression()).prop_map(|(left, right)| Item::Equation(Equation { left, right })),
            (
                prop_oneof![Just(EnergyKind::Kinetic), Just(EnergyKind::Potential), Just(EnergyKind::Dissipation)],
                expression()
            )
                .prop_map(|(kind, value)| Item::Energy(Energy { kind, keyword: NOWHERE, value })),
            (ident(), expression()).prop_map(|(coordinate, value)| Item::Force(Force { coordinate, value })),
            (prop::collection::vec(ident(), 1..4), ident())
                .prop_map(|(coordinates, stem)| Item::Eliminate(Eliminate { coordinates, stem })),
            (ident(), expression(), count()).prop_map(|(coordinate, point, order)| Item::Taylor(Taylor {
                coordinate,
                point,
                order
            })),
            (prop::option::of(ident()), prop::collection::vec(pattern_item(), 0..5))
                .prop_map(|(name, items)| Item::Pattern(PatternDeclaration { keyword: NOWHERE, name, items })),
        ]
    }

    fn pattern_item() -> impl Strategy<Value = PatternItem> {
        prop_oneof![
            prop_oneof![Just(Role::Amplitude), Just(Role::Frequency)]
                .prop_flat_map(declaration)
                .prop_map(PatternItem::Declaration),
            count().prop_map(PatternItem::Harmonics),
            (ident(), expression()).prop_map(|(coordinate, value)| PatternItem::Motion(Motion { coordinate, value })),
        ]
    }

    pub(super) fn model() -> impl Strategy<Value = ModelDeclaration> {
        (ident(), prop::collection::vec(item(), 0..8)).prop_map(|(name, items)| ModelDeclaration { name, items })
    }
}

proptest! {
    #[test]
    fn a_printed_model_parses_to_the_same_model(model in built::model()) {
        let source = Source::new("printed", model.to_string());
        match language::parse(&source) {
            Ok(mut parsed) => {
                parsed.forget_spans();
                prop_assert_eq!(parsed, model);
            }
            Err(errors) => prop_assert!(false, "{}\n{}", errors.render(&source), source.text()),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_bytes_are_judged(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        if let Err(fault) = judge(&bytes) {
            let (source, errors) = *fault;
            prop_assert!(!errors.render(&source).is_empty());
        }
    }

    #[test]
    fn any_words_are_judged(words in proptest::collection::vec(prop_oneof![
        Just("model"), Just("A"), Just("{"), Just("}"), Just("("), Just(")"), Just("["), Just("]"), Just(";"), Just(","), Just("="),
        Just("+"), Just("-"), Just("*"), Just("/"), Just("^"), Just("x"), Just("dot"), Just("2"), Just("0.5"), Just("\n"), Just("coordinate"),
        Just("input"), Just("parameter"), Just("series"), Just("about"), Just("order"), Just("as"), Just("pattern"), Just("kg"), Just("x''"),
        Just("3w"), Just("\u{2028}"), Just("\u{85}"), Just("\u{b}"), Just("\r"), Just("\u{0}"), Just("²"), Just("let"), Just("kinetic"), Just("force"), Just("eliminate"), Just("rest_to_rest"), Just("sin"), Just("t"),
    ], 0..80)) {
        let text = format!("model A {{ coordinate x; input u; {}", words.join(" "));
        if let Err(fault) = judge(text.as_bytes()) {
            let (source, errors) = *fault;
            prop_assert!(!errors.render(&source).is_empty());
        }
    }

    #[test]
    fn a_damaged_model_is_judged(at in 0_usize..900, with in "[-a-z0-9 (){}\\[\\];=^'²λ]{0,3}", gone in 0_usize..4) {
        let text = fs::read_to_string(root().join("models/rotary_pendulum.tpm")).expect("a model");
        let mut characters: Vec<char> = text.chars().collect();
        let end = (at + gone).min(characters.len());
        characters.splice(at..end, with.chars());
        let text: String = characters.into_iter().collect();
        if let Err(fault) = judge(text.as_bytes()) {
            let (source, errors) = *fault;
            prop_assert!(!errors.render(&source).is_empty());
        }
    }
}

#[test]
fn values_are_exact_expressions_of_parameters_and_constants() {
    let mut model = ExactModel::default();
    for name in ["m", "g", "k"] {
        model.declare(name, None, Kind::Parameter);
    }
    model.declare("F", None, Kind::Input);
    let mut shown = |text: &str| {
        let source = Source::new("value", text);
        parse_value(&source, &mut model).map(|value| model.display(value)).map_err(|faults| faults.render(&source))
    };
    assert_eq!(shown("0.1").as_deref(), Ok("1/10"));
    assert_eq!(shown(" - pi / 2 ").as_deref(), Ok("-pi/2"));
    assert_eq!(shown("m*g/k"), shown("(g/k)*m"));
    assert_eq!(shown("1e-3+2").as_deref(), Ok("2001/1000"));
    let deep = ["-".repeat(1000), "(".repeat(100_000)];
    let wrong = [
        ("", "value:1:1"),
        ("2 pi", "`pi` is not expected here"),
        ("F", "`F` is no parameter or constant"),
        ("1/0", "a division by zero"),
        ("(1", "value:1:3"),
        ("1+", "value:1:3"),
        ("^", "value:1:1"),
        ("sin(m, g)", "cannot stand here"),
        (&deep[0], "levels deep"),
        (&deep[1], "levels deep"),
    ];
    for (text, expected) in wrong {
        let message = shown(text).expect_err(text);
        assert!(message.contains(expected), "{message}");
    }
}
