//! Signs and absolute values of motions: exact harmonics in Q + Q/pi, bounds of what is left out, refusals.

use crate::common::{Build, E};
use proptest::prelude::{ProptestConfig, prop_assert, proptest};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use tpm_symbolic::algebra::fourier::{Fourier, Trig};
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{Function, Node};
use tpm_symbolic::harmonic::expand::{ExpandError, ExpandOptions, expand_with};
use tpm_symbolic::harmonic::nonsmooth::{QuadrantSign, SignError};
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::model::{ExactModel, Kind, TermId};
use tpm_symbolic::mechanics::pattern::{Motion, Pattern, rest_to_rest};
use tpm_symbolic::number::rational::{Rational, integer, ratio};
use tpm_symbolic::regressor::form::regressor_form;

/// k * term(x, x') = u, with x = lambda * shape.
fn model_of(shape: Fourier, term: impl Fn(&E, &E) -> E) -> ExactModel {
    let b = Build::new();
    let x = b.coordinate("x");
    let u = b.quantity("u", Kind::Input);
    let [k] = b.parameters(["k"]);
    b.equation(&[&k * term(&b.der(x, 0), &b.der(x, 1)), -&u]);
    b.model(|model| {
        let amplitude = model.declare("lambda", None, Kind::Amplitude);
        let frequency = model.declare("w", None, Kind::Frequency);
        let motions = vec![Some(Motion::term(Monomial::power_of(amplitude, 1), shape))];
        model.patterns.push(Pattern { name: None, amplitudes: vec![amplitude], frequency, motions });
    });
    b.take()
}

fn table_of(model: &ExactModel, harmonics: usize) -> Result<HarmonicTable, ExpandError> {
    let form = regressor_form(model).expect("linear in the parameters");
    let mut options = ExpandOptions { harmonics: Some(harmonics), ..ExpandOptions::default() };
    expand_with(model, &form, &model.patterns[0], &mut options)
}

fn coefficients(table: &HarmonicTable, function: Trig, pi: i32) -> Vec<(usize, Rational)> {
    let entries = table.entries().filter(|entry| entry.function == function && entry.pi == pi);
    entries.map(|entry| (entry.harmonic, entry.coefficient)).collect()
}

fn sign(e: &E) -> E {
    e.call(Function::Sign)
}

fn abs(e: &E) -> E {
    e.call(Function::Abs)
}

#[test]
fn coulomb_friction_and_quadratic_drag_on_the_rest_to_rest_pattern() {
    let shape = || rest_to_rest(3).expect("odd");
    let table = table_of(&model_of(shape(), |_, v| sign(v)), 7).expect("exact");
    let expected = [(1, ratio(-4, 1)), (3, ratio(-4, 3)), (5, ratio(-4, 5)), (7, ratio(-4, 7))];
    assert_eq!(coefficients(&table, Trig::Sin, -1), expected);
    assert_eq!(table.len(), 4);
    let entry = table.entries().next().expect("four entries");
    let lambda = table.symbols.iter().position(|name| name == "lambda").expect("declared");
    assert_eq!((entry.powers, entry.sign), (Monomial::one(), Monomial::power_of(lambda, 1)));

    let table = table_of(&model_of(shape(), |_, v| abs(v) * v), 7).expect("exact");
    let drag = [(1, ratio(-1024, 315)), (3, ratio(1024, 567)), (5, ratio(-1024, 2079)), (7, ratio(1024, 27027))];
    assert_eq!(coefficients(&table, Trig::Sin, -1), drag);
    let entry = table.entries().next().expect("four entries");
    assert_eq!((entry.powers.exponent(&lambda), entry.sign.exponent(&lambda)), (2, 1));

    let table = table_of(&model_of(shape(), |_, v| abs(v)), 7).expect("exact");
    let speed = [(0, ratio(16, 9)), (2, ratio(-32, 15)), (4, ratio(32, 105)), (6, ratio(32, 945))];
    assert_eq!(coefficients(&table, Trig::Cos, -1), speed);
    // |x'| = sign(x') x' and x'^2 = |x'|^2, smooth again.
    let same = table_of(&model_of(shape(), |_, v| sign(v) * v), 7).expect("exact");
    assert_eq!(coefficients(&same, Trig::Cos, -1), speed);
    let square = table_of(&model_of(shape(), |_, v| abs(v).pow(2)), 7).expect("finite");
    assert_eq!(square, table_of(&model_of(shape(), |_, v| v.pow(2)), 7).expect("finite"));
    assert!(square.tails.is_empty());
}

#[test]
fn a_symmetric_pattern_gives_the_absolute_position() {
    // |cos| = 2/pi (1 + 2/3 cos 2 - 2/15 cos 4 + ...)
    let table = table_of(&model_of(Fourier::cos(1, integer(1)), |x, _| abs(x)), 5).expect("exact");
    let expected = [(0, ratio(2, 1)), (2, ratio(4, 3)), (4, ratio(-4, 15))];
    assert_eq!(coefficients(&table, Trig::Cos, -1), expected);
    // A multiple of the fundamental has the same coefficients at multiples of the harmonics.
    let table = table_of(&model_of(Fourier::cos(3, integer(1)), |x, _| abs(x)), 14).expect("exact");
    assert_eq!(coefficients(&table, Trig::Cos, -1), [(0, ratio(2, 1)), (6, ratio(4, 3)), (12, ratio(-4, 15))]);
    // sign(x) sign(x') of cos is -sign(sin 2 theta).
    let table = table_of(&model_of(Fourier::cos(1, integer(1)), |x, v| sign(x) * sign(v)), 6).expect("exact");
    assert_eq!(coefficients(&table, Trig::Sin, -1), [(2, ratio(-4, 1)), (6, ratio(-4, 3))]);
    assert!(table.entries().all(|entry| entry.sign.is_one()), "the signs of lambda cancel");
    // A motion that never changes sign: |2 + cos| is itself, without pi.
    let above = Fourier::constant(integer(2)).add(&Fourier::cos(1, integer(1)));
    let table = table_of(&model_of(above, |x, _| abs(x)), 5).expect("finite");
    assert_eq!(coefficients(&table, Trig::Cos, 0), [(0, integer(2)), (1, integer(1))]);
    assert!(table.tails.is_empty());
}

#[test]
fn sign_changes_are_proven() {
    // sin (a + cos): one simple zero more just below a = 1, none just above, a touching one at a = 1.
    let shape = |a: Rational| Fourier::sin(1, a).add(&Fourier::sin(2, ratio(1, 2)));
    let hair = ratio(1, 1_000_000_000_000);
    let waves = Some([1, 1, -1, -1]);
    let quadrants = |f: &Fourier| QuadrantSign::of(f).map(|sign| sign.quadrants());
    assert_eq!(quadrants(&shape(integer(1) + &hair)), waves);
    assert_eq!(quadrants(&shape(integer(1))), waves);
    assert_eq!(quadrants(&shape(integer(1) - &hair)), None);
    // A zero at pi/2 only, of odd order, and its partner at pi: quadrants + - - -... from (1 - sin)(...) shapes.
    let sine = Fourier::sin(1, integer(1));
    let one = Fourier::constant(integer(1));
    assert_eq!(quadrants(&one.sub(&sine)), Some([1; 4]), "touches zero at pi/2");
    assert_eq!(quadrants(&Fourier::cos(1, integer(1)).sub(&sine)), None, "pi/4");
    assert_eq!(quadrants(&Fourier::zero()), Some([0; 4]));
    // x' of every rest-to-rest pattern is -K sin^(2l+1).
    for order in (1..=21).step_by(2) {
        let velocity = rest_to_rest(order).expect("odd").derivative(1);
        assert_eq!(quadrants(&velocity), Some([-1, -1, 1, 1]), "{order}");
    }
}

#[test]
fn what_has_no_exact_series_is_refused_by_name() {
    let turning = Fourier::cos(1, integer(1)).add(&Fourier::cos(2, integer(1)));
    let error = table_of(&model_of(turning, |_, v| sign(v)), 9).expect_err("turns at other phases");
    let argument = || "dot(x)".to_owned();
    assert_eq!(error, ExpandError::Sign { term: TermId(1), source: SignError::Phase { argument: argument() } });

    let b = Build::new();
    let (x, y) = (b.coordinate("x"), b.coordinate("y"));
    let u = b.quantity("u", Kind::Input);
    let [k] = b.parameters(["k"]);
    let (p, q) = (b.der(x, 1), b.der(y, 1));
    let pattern = b.model(|model| {
        let amplitudes: Vec<_> = ["a", "c"].map(|name| model.declare(name, None, Kind::Amplitude)).to_vec();
        let frequency = model.declare("w", None, Kind::Frequency);
        let shape = rest_to_rest(3).expect("odd");
        let part = |i: usize, n| Motion::term(Monomial::power_of(amplitudes[i], 1), shape.with_multiple(n));
        let motions = vec![Some(part(0, 3)), Some(part(1, 2))];
        Pattern { name: None, amplitudes: amplitudes.clone(), frequency, motions }
    });
    let fails = |term: E| {
        b.model(|model| model.equations.clear());
        b.equation(&[&k * term, -&u]);
        let mut model = b.model(|model| model.clone());
        model.patterns = vec![pattern.clone()];
        table_of(&model, 9).expect_err("refused")
    };
    let source = |error: ExpandError| match error {
        ExpandError::Sign { source, .. } => source,
        other => panic!("{other}"),
    };
    assert_eq!(source(fails(sign(&p) * sign(&q))), SignError::Multiples { argument: "dot(y)".to_owned() });
    assert_eq!(source(fails(abs(&(&p + &q)))), SignError::Ratio { argument: "dot(x) + dot(y)".to_owned() });
    assert!(matches!(source(fails(abs(&p.sin()))), SignError::Motion(_)));
    assert!(matches!(source(fails(abs(&p) * q.sin())), SignError::Motion(_)));
    let mut options = ExpandOptions { harmonics: Some(usize::MAX / 1024), ..ExpandOptions::default() };
    let model = model_of(rest_to_rest(3).expect("odd"), |_, v| sign(v));
    let form = regressor_form(&model).expect("linear");
    let error = expand_with(&model, &form, &model.patterns[0], &mut options).expect_err("too many harmonics");
    assert!(matches!(error, ExpandError::TooLarge { .. }), "{error}");
}

#[test]
fn an_actuated_joint_with_friction_has_smooth_and_infinite_columns() {
    // M q'' + Fv q' + Fc sign(q') + OF = force, and its JSON.
    let b = Build::new();
    let x = b.coordinate("q");
    let [_, v, a] = b.motion(x);
    let u = b.quantity("force", Kind::Input);
    let [m, fv, fc, offset] = b.parameters(["M", "Fv", "Fc", "OF"]);
    b.equation(&[&m * &a, &fv * &v, &fc * sign(&v), offset, -&u]);
    b.model(|model| {
        let amplitude = model.declare("lambda", None, Kind::Amplitude);
        let frequency = model.declare("w", None, Kind::Frequency);
        let motion = Motion::term(Monomial::power_of(amplitude, 1), rest_to_rest(3).expect("odd"));
        let motions = vec![Some(motion)];
        model.patterns.push(Pattern { name: None, amplitudes: vec![amplitude], frequency, motions });
    });
    let model = b.take();
    let table = table_of(&model, 5).expect("exact");
    let shape: Vec<(usize, &str, &str, i32)> = table
        .entries()
        .map(|e| (e.harmonic, e.function.name(), e.column.map_or("", |c| ["M", "Fv", "Fc", "OF"][c]), e.pi))
        .collect();
    let expected = [
        (0, "cos", "OF", 0),
        (1, "cos", "M", 0),
        (1, "sin", "Fv", 0),
        (1, "sin", "Fc", -1),
        (3, "cos", "M", 0),
        (3, "sin", "Fv", 0),
        (3, "sin", "Fc", -1),
        (5, "sin", "Fc", -1),
    ];
    assert_eq!(shape, expected);
    assert_eq!(table.tails.len(), 1);
    let tail = &table.tails[0];
    assert_eq!((tail.column, tail.harmonics, tail.maximum), (Some(2), 5, None));
    // 1 - 8/pi^2 (1 + 1/9 + 1/25), by Parseval.
    let rms = (1.0 - 8.0 / (PI * PI) * (1.0 + 1.0 / 9.0 + 1.0 / 25.0)).sqrt();
    assert!((tail.rms - rms).abs() < 1e-12 && tail.rms >= rms - 1e-16, "{} {rms}", tail.rms);
    let json = serde_json::to_value(&table).expect("plain data");
    assert_eq!(json["entries"][3]["sign"]["lambda"], 1);
    assert_eq!(json["entries"][3]["pi"], -1);
    assert_eq!(json["tails"][0]["parameter"], "Fc");
    let back: HarmonicTable = serde_json::from_value(json.clone()).expect("own output");
    assert_eq!(serde_json::to_value(&back).expect("plain data"), json);
}

/// Five-point Gauss-Legendre over many pieces of every quadrant.
fn integral(f: impl Fn(f64) -> f64) -> f64 {
    const NODES: [(f64, f64); 3] = [
        (0.0, 0.568_888_888_888_888_9),
        (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
        (0.906_179_845_938_664, 0.236_926_885_056_189_08),
    ];
    let pieces = 4 * 40;
    let half = TAU / f64::from(pieces) / 2.0;
    let piece = |i: i32| -> f64 {
        let middle = half * f64::from(2 * i + 1);
        let pair = |(x, w): (f64, f64)| {
            let sum = f(middle + half * x) + if x == 0.0 { 0.0 } else { f(middle - half * x) };
            w * sum
        };
        NODES.iter().map(|&node| pair(node)).sum()
    };
    (0..pieces).map(piece).sum::<f64>() * half
}

/// The regressor and its table at numbers: (value at a phase, symbols).
fn check_against_quadrature(model: &ExactModel, lambda: f64, w: f64, harmonics: usize) -> Result<(), String> {
    let table = table_of(model, harmonics).map_err(|error| error.to_string())?;
    let symbols: Vec<f64> = model
        .symbols
        .iter()
        .map(|quantity| match quantity.name.as_str() {
            "lambda" => lambda,
            "w" => w,
            _ => 1.0,
        })
        .collect();
    let motion = model.patterns[0].motions[0].as_ref().expect("given");
    let shapes: Vec<Fourier> =
        (0..2).map(|n| motion.derivative(n).terms().next().expect("one part").1.clone()).collect();
    // The sum of sines would lose the sign of sin^(2l+1) near the turns to rounding.
    let order = i32::try_from(shapes[1].highest_harmonic()).expect("small");
    let speed = shapes[1].evaluate(FRAC_PI_2);
    let value = |theta: f64| {
        model.graph.evaluate(model.equations[0].terms[0].expr, |node| match node {
            Node::Derivative(_, 0) => lambda * shapes[0].evaluate(theta),
            Node::Derivative(..) => lambda * w * speed * theta.sin().powi(order),
            _ => 1.0,
        })
    };
    let mut kept = (vec![0.0; harmonics + 60], vec![0.0; harmonics + 60]);
    for entry in table.entries() {
        let list = if entry.function == Trig::Cos { &mut kept.0 } else { &mut kept.1 };
        list[entry.harmonic] += table.evaluate(&entry, &symbols);
    }
    let scale = integral(|theta| value(theta).abs()) / TAU + 1e-3;
    for k in 0..=harmonics {
        let norm = if k == 0 { TAU } else { PI };
        let cos = integral(|theta| value(theta) * (k as f64 * theta).cos()) / norm;
        let sin = integral(|theta| value(theta) * (k as f64 * theta).sin()) / norm;
        if (cos - kept.0[k]).abs() > 1e-11 * scale || (sin - kept.1[k]).abs() > 1e-11 * scale {
            return Err(format!("harmonic {k}: {cos} {} {sin} {}", kept.0[k], kept.1[k]));
        }
    }
    for tail in &table.tails {
        let rest = |theta: f64| {
            let series: f64 = (0..kept.0.len())
                .map(|k| kept.0[k] * (k as f64 * theta).cos() + kept.1[k] * (k as f64 * theta).sin())
                .sum();
            value(theta) - series
        };
        let factor: f64 = tail.powers.factors().map(|(&s, e)| symbols[s].abs().powi(e)).product();
        let rms = (integral(|theta| rest(theta).powi(2)) / TAU).sqrt();
        if (rms - tail.rms * factor).abs() > 1e-9 * scale {
            return Err(format!("rms {rms} {}", tail.rms * factor));
        }
        let worst = (0..400).map(|i| rest(f64::from(i) * TAU / 400.0 + 1e-3).abs()).fold(0.0, f64::max);
        if tail.maximum.is_some_and(|bound| worst > bound * factor * (1.0 + 1e-9) + 1e-12 * scale) {
            return Err(format!("maximum {worst} {:?}", tail.maximum));
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn harmonics_and_tails_agree_with_quadrature(
        half_order in 0u32..4, p in 0i32..4, r in 0i32..4, which in 0u8..4, lambda in -1.5f64..1.5, harmonics in 3usize..16,
    ) {
        let shape = rest_to_rest(2 * half_order + 1).expect("odd");
        let model = model_of(shape, |x, v| {
            let smooth = x.pow(p) * v.pow(r);
            match which {
                0 => sign(v) * smooth,
                1 => sign(x) * smooth,
                2 => abs(x) * sign(v) * smooth,
                _ => abs(&(3 * v)).pow(3) * sign(&(x * v)) * smooth,
            }
        });
        let lambda = if lambda.abs() < 0.05 { 0.4 } else { lambda };
        let result = check_against_quadrature(&model, lambda, 1.3, harmonics);
        prop_assert!(result.is_ok(), "{result:?}");
    }
}

#[test]
fn the_maximum_of_what_is_left_out_falls_with_the_harmonics() {
    // |x'| x' on the pattern of order 3 is six times differentiable between the turns' jumps.
    let model = model_of(rest_to_rest(3).expect("odd"), |_, v| abs(v) * v);
    let bound = |harmonics| table_of(&model, harmonics).expect("exact").tails[0].maximum.expect("smooth");
    let (short, long) = (bound(9), bound(19));
    assert!(short < 0.1 && long < short * (10.0f64 / 19.0).powi(5), "{short} {long}");
}
