//! Bounds of rounding: never below the errors of random and corner points, and derived again from the C alone.

use num_traits::Float;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};
use tpm_codegen::emit::estimator::{EstimatorSource, Identified, Part};
use tpm_codegen::emit::number::Rounded;
use tpm_codegen::generate::{File, Language, Options, Ranges, Scalar, generate, unbounded};
use tpm_symbolic::expr::graph::Function;
use tpm_symbolic::plan::leaf::Leaf;

use crate::support::{estimator, models_in, outputs, root, skipped};

/// The ends of what a function reads: those of positions and rates, of higher derivatives, and of all else.
const ENDS: [[f64; 2]; 3] = [[-3.0, 3.0], [-9.0, 9.0], [0.75, 1.25]];

fn ends(leaf: &Leaf) -> [f64; 2] {
    match leaf {
        Leaf::Motion(_, 0 | 1) => ENDS[0],
        Leaf::Motion(..) => ENDS[1],
        _ => ENDS[2],
    }
}

/// Ranges of everything that a model's functions read.
fn ranges(source: &EstimatorSource) -> Ranges {
    let mut texts = Vec::new();
    let highest = source.plan.evaluation.coordinates.iter().map(|(_, order)| *order).max().expect("a coordinate");
    for order in 0..=highest {
        let name = match order {
            0 => "*".to_owned(),
            1 => "dot(*)".to_owned(),
            2 => "ddot(*)".to_owned(),
            _ => format!("der(*, {order})"),
        };
        let [low, high] = ENDS[usize::from(order > 1)];
        texts.push(format!("{name}={low}..{high}"));
    }
    let [low, high] = ENDS[2];
    let evaluation = &source.plan.evaluation;
    let symbols = evaluation.constants.iter().chain(&evaluation.inputs).copied().chain(source.model.parameters());
    let columns = source.form.columns.iter().map(|column| column.name.to_string());
    let mut names: Vec<String> =
        symbols.map(|symbol| source.model.quantity(symbol).name.to_string()).chain(columns).collect();
    names.sort();
    names.dedup();
    let lumped = source.plan.lumping.is_some();
    let known =
        |name: &String| lumped || !source.model.parameters().any(|own| source.model.quantity(own).name == *name);
    let columns = |name: &String| source.form.columns.iter().any(|column| column.name == *name);
    names.retain(|name| known(name) || columns(name));
    texts.extend(names.into_iter().map(|name| format!("{name}={low}..{high}")));
    Ranges::parse(&texts).expect("ranges")
}

fn files(source: &EstimatorSource, language: Language, scalar: Scalar) -> Vec<File> {
    let ranges = ranges(source);
    let options = Options { scalar, ranges: Some(&ranges), ..Options::new(language, "tpm generate") };
    generate(source, &options).unwrap_or_else(|error| panic!("{}: {error}", source.model.name))
}

fn document(files: &[File]) -> Value {
    let file = files.iter().find(|file| file.name.ends_with(".bounds.json")).expect("bounds");
    serde_json::from_str(&file.text).expect("JSON")
}

/// A function in the precision of its argument.
fn called<T: Float>(function: Function, x: T) -> T {
    match function {
        Function::Sin => x.sin(),
        Function::Cos => x.cos(),
        Function::Tanh => x.tanh(),
        Function::Sqrt => x.sqrt(),
        Function::Exp => x.exp(),
        Function::Abs => x.abs(),
        Function::Sign if x.is_zero() => x,
        Function::Sign => x.signum(),
        other => panic!("no shipped model calls {}", other.name()),
    }
}

#[test]
fn no_error_in_single_precision_is_above_its_bound() {
    let mut state = 1_u64;
    let mut share = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / f64::from(1_u32 << 24)
    };
    let (mut compared, mut largest) = (0, 0.0_f64);
    for path in models_in("models").into_iter().chain(models_in("models/robots")) {
        let source = estimator(&path);
        let document = document(&files(&source, Language::Rust, Scalar::Double));
        let bounds = document["functions"]["inverse_dynamics"]["results"].as_object().expect("results");
        let bounds: Vec<f64> = bounds.values().map(|of| of["single"]["bound"].as_f64().expect("a bound")).collect();
        let plan = &source.plan.inverse_dynamics;
        assert_eq!(
            plan.outputs.len(),
            bounds.len(),
            "{}: {}",
            path.display(),
            document["functions"]["inverse_dynamics"]
        );
        let mut worst = vec![0.0_f64; bounds.len()];
        for round in 0..1000 {
            let given: Vec<f32> = plan
                .inputs
                .iter()
                .map(|leaf| {
                    let ([low, high], mut at) = (ends(leaf), share());
                    if round % 3 == 1 || (round % 3 == 2 && share() < 0.5) {
                        at = at.round();
                    }
                    (low + (high - low) * at) as f32
                })
                .collect();
            let place = |leaf: &Leaf| plan.inputs.iter().position(|own| own == leaf).expect("a leaf of the plan");
            let single = outputs(plan, |value| Rounded::new(value).single, called, |leaf| given[place(leaf)]);
            let double =
                outputs(plan, |value| Rounded::new(value).double, called, |leaf| f64::from(given[place(leaf)]));
            for (worst, (single, double)) in worst.iter_mut().zip(single.into_iter().zip(double)) {
                *worst = worst.max((f64::from(single) - double).abs());
            }
        }
        for (worst, bound) in worst.into_iter().zip(bounds) {
            assert!(worst <= bound, "{}: {worst:e} is above {bound:e}", path.display());
            if worst > 0.0 {
                largest = largest.max(bound / worst);
                compared += 1;
            }
        }
    }
    assert!(compared >= 15 && largest < 1500.0, "{compared} {largest}");
}

/// Runs the checker on files in a folder; nothing where there is no Python.
fn check(folder: &Path, name: &str) -> Option<Output> {
    let script = root().join("tests/scripts/check_bounds.py");
    let file = |kind: &str| folder.join(format!("{name}.{kind}"));
    let output = Command::new("python3").arg(script).arg(file("c")).arg(file("bounds.json")).output();
    output.ok()
}

#[test]
fn the_checker_derives_the_bounds_from_the_c_alone_and_refuses_smaller_ones() {
    let folder = tempfile::tempdir().expect("a folder");
    for (model, scalar) in [
        ("stribeck_pendulum", Scalar::Double),
        ("rotary_pendulum", Scalar::Float),
        ("robots/planar_arm", Scalar::Double),
    ] {
        let source = estimator(&root().join("models").join(model).with_extension("tpm"));
        let source = source.with(&[Part::Gravity, Part::MassMatrix]).expect("parts");
        let files = files(&source, Language::C, scalar);
        files.iter().for_each(|file| std::fs::write(folder.path().join(&file.name), &file.text).expect("written"));
        let name = files[1].name.trim_end_matches(".c");
        let Some(output) = check(folder.path(), name) else { return skipped("no python3") };
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{model}: {said}{}", String::from_utf8_lossy(&output.stderr));

        let (mut planted, precision) = (document(&files), if scalar == Scalar::Float { "single" } else { "double" });
        let results = planted["functions"]["inverse_dynamics"]["results"].as_object_mut().expect("results");
        let (result, of) = results.iter_mut().next().expect("a result");
        let (result, smaller) = (result.clone(), 0.9 * of[precision]["bound"].as_f64().expect("a bound"));
        of[precision]["bound"] = json!(smaller);
        std::fs::write(folder.path().join(format!("{name}.bounds.json")), planted.to_string()).expect("written");
        let output = check(folder.path(), name).expect("Python was there");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert_eq!(output.status.code(), Some(1), "{model}: {said}");
        assert!(said.contains(&format!("inverse_dynamics, {result}: ")) && said.contains(" 1 refused"), "{said}");
    }
}

#[test]
fn bounds_stand_beside_the_functions_in_both_languages() {
    let source = estimator(&root().join("models/mass_spring_drag.tpm"));
    let plain = generate(&source, &Options::new(Language::C, "tpm generate")).expect("emits");
    assert!(plain.iter().all(|file| !file.text.contains("Rounding")) && plain.len() == 2);
    let c = files(&source, Language::C, Scalar::Float);
    assert!(c[0].text.contains("Rounding in single precision, at most: `forces.u`"), "{}", c[0].text);
    assert!(!c[0].text.contains("double precision, at most"));
    let rust = files(&source, Language::Rust, Scalar::Double);
    for precision in ["single", "double"] {
        assert!(rust[0].text.contains(&format!("Rounding in {precision} precision, at most: `forces.u`")));
    }
    let identified =
        Identified::of_values("MassSpringDrag", &BTreeMap::from(["m", "k1", "k2"].map(|name| (name.to_owned(), 2.0))));
    let ranges = Ranges::parse(&["x=-1..1,dot(x)=-1..1,ddot(x)=-8..8"]).expect("ranges");
    let options =
        Options { ranges: Some(&ranges), identified: Some(&identified), ..Options::new(Language::C, "tpm generate") };
    let document = document(&generate(&source, &options).expect("emits"));
    assert_eq!(document["ranges"]["parameters.m"], json!([2.0, 2.0]));
    let bound =
        |document: &Value| document["functions"]["inverse_dynamics"]["results"]["forces.u"]["double"]["bound"].as_f64();
    // 2*8 + 2*1 + 2*1^2: four roundings below 32, half a unit in the last place each.
    assert!(bound(&document).is_some_and(|bound| bound > 1e-15 && bound < 8e-15), "{document}");
}

#[test]
fn what_has_no_bound_is_named_with_the_reason() {
    let source = estimator(&root().join("models/cart_pendulum.tpm")).with(&[Part::ForwardDynamics]).expect("a part");
    let told: Vec<String> = files(&source, Language::C, Scalar::Double).iter().flat_map(unbounded).collect();
    let divisor = told.iter().find(|gap| gap.contains("`forward_dynamics`")).expect("wide ranges");
    assert!(divisor.contains("the divisor `") && divisor.contains("holds zero; narrow the ranges"), "{divisor}");
    let ranges = |text: &str| Ranges::parse(&[text]).expect("ranges");
    let generated = |ranges: &Ranges| {
        generate(&source, &Options { ranges: Some(ranges), ..Options::new(Language::C, "tpm generate") })
    };
    let fault = generated(&ranges("y=0..1")).expect_err("no such name").to_string();
    assert!(fault.starts_with("there is no `y` for a range; functions read x, dot(x), ddot(x), theta"), "{fault}");
    let files = generated(&ranges("theta=-1..1,dot(*)=-1..1,ddot(*)=1..1e300,m_L=1e200..2e200")).expect("some bounds");
    let told: Vec<String> = files.iter().flat_map(unbounded).collect();
    assert!(told.iter().any(|gap| gap.contains("`M_plus_m` has no range; state one")), "{told:?}");
    assert!(told.iter().any(|gap| gap.contains("beyond the largest number")), "{told:?}");
}
