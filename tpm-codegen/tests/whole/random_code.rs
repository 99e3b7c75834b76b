//! Generated C and Rust of random models, compiled without a warning and run, against exact rational evaluation.
//!
//! `TPM_RANDOM_MODELS` sets how many models are tried, `TPM_RANDOM_SEED` the first of them; a failure names its seed. Many models go
//! into one program, since starting a compiler takes longer than compiling a model.

use crate::c::{FLAGS, compiler, runs, say};
use crate::random::Random;
use crate::random_model::{Kind, Writer};
use crate::support::exact::{Point, Sum, exact};
use crate::support::skipped;
use std::fmt::Write as _;
use std::process::Command;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::generate::{Language, Options, Scalar, generate};
use tpm_codegen::{Source, parse_model};
use tpm_symbolic::number::rational;

/// Models that are compiled where nothing else is said.
const MODELS: u64 = 30;

/// Standard C++ without a warning.
const CPP_FLAGS: [&str; 7] = ["-xc++", "-std=c++11", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror"];

/// Points at which a model is evaluated.
const CASES: u64 = 2;

/// Roundings that any value may gather, in units of the precision times the magnitudes of its terms.
const ROUNDINGS: f64 = 64.0;

/// The functions of the crate `libm` that generated Rust calls, over those of the standard library.
pub(crate) const LIBM: &str = "#![allow(non_snake_case)]
macro_rules! of { ($($name:ident $single:ident $method:ident),*) => {$(
    pub fn $name(x: f64) -> f64 { x.$method() } pub fn $single(x: f32) -> f32 { x.$method() })*} }
macro_rules! of_two { ($($name:ident $single:ident $method:ident),*) => {$(
    pub fn $name(x: f64, y: f64) -> f64 { x.$method(y) } pub fn $single(x: f32, y: f32) -> f32 { x.$method(y) })*} }
of!(sin sinf sin, cos cosf cos, tan tanf tan, asin asinf asin, acos acosf acos, atan atanf atan, sqrt sqrtf sqrt, exp expf exp,
    log logf ln, floor floorf floor, fabs fabsf abs, tanh tanhf tanh);
of_two!(atan2 atan2f atan2, fmax fmaxf max, fmin fminf min);
";

/// A model with the points at which it is evaluated.
struct Sample {
    seed: u64,
    estimator: EstimatorSource,
    cases: Vec<Case>,
}

struct Case {
    motion: Vec<f64>,
    parameters: Vec<f64>,
    constants: Vec<f64>,
}

/// The seeds of the models that are tried.
fn tried(default: u64) -> std::ops::Range<u64> {
    let set = |name: &str, or: u64| std::env::var(name).ok().and_then(|value| value.parse().ok()).unwrap_or(or);
    let first = set("TPM_RANDOM_SEED", 1);
    first..first + set("TPM_RANDOM_MODELS", default)
}

/// The regular model of a seed; `None` when the language or the equations refuse it.
fn sample(seed: u64) -> Option<Sample> {
    let source = Source::new("random.tpm", Writer::new(seed, Kind::Regular).model());
    let estimator = EstimatorSource::of(&parse_model(&source).ok()?).ok()?;
    let evaluation = &estimator.plan.evaluation;
    let motion: usize = evaluation.coordinates.iter().map(|(_, order)| *order as usize + 1).sum();
    let mut random = Random(seed);
    let cases = (0..CASES).map(|_| Case {
        motion: random.list(motion),
        parameters: random.list(estimator.form.columns.len()),
        constants: random.list(evaluation.constants.len()).iter().map(|value| value.abs() + 0.25).collect(),
    });
    let cases = cases.collect();
    Some(Sample { seed, estimator, cases })
}

/// Regressor, known terms and forces of every case, in the order in which the programs print them.
fn expected(sample: &Sample) -> Vec<Sum> {
    let form = &sample.estimator.form;
    let mut values = Vec::new();
    for case in &sample.cases {
        let estimator = &sample.estimator;
        let point = Point { estimator, motion: &case.motion, constants: &case.constants, physical: &[] };
        let columns = 0..form.columns.len();
        values.extend(form.rows.iter().flat_map(|row| columns.clone().map(|column| point.entry(row, Some(column)))));
        values.extend(form.rows.iter().map(|row| point.entry(row, None)));
        values.extend(form.rows.iter().map(|row| point.force(row, &case.parameters)));
    }
    values
}

/// Compares what a program printed with the exact values; the largest error in roundings.
fn compare(samples: &[Sample], what: &str, epsilon: f64, printed: &str) -> f64 {
    let mut lines = printed.lines();
    let mut worst = 0.0_f64;
    for sample in samples {
        for expected in expected(sample) {
            let found: f64 = lines.next().expect("a value").parse().expect("a number");
            let error = rational::to_f64(&rational::abs(&(exact(found) - &expected.value)));
            let unit = epsilon * rational::to_f64(&expected.magnitude);
            assert!(
                error <= ROUNDINGS * unit,
                "TPM_RANDOM_SEED={}, {what}: {found} is not {}",
                sample.seed,
                rational::to_f64(&expected.value)
            );
            worst = worst.max(if error == 0.0 { 0.0 } else { error / unit });
        }
    }
    assert_eq!(lines.next(), None, "{what}: the program printed too much");
    worst
}

/// Runs a program, which must succeed and say nothing of faults; what it printed.
fn output(command: &mut Command) -> String {
    let output = command.output().expect("the program runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.is_empty(), "{command:?}: {}\n{said}", output.status);
    String::from_utf8(output.stdout).expect("numbers")
}

fn listed(values: &[f64]) -> String {
    values.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(", ")
}

/// The part of the C program that evaluates the model `r{index}`.
fn c_block(index: usize, sample: &Sample, real: &str) -> String {
    let mut text = String::new();
    let constants = if sample.estimator.plan.evaluation.constants.is_empty() { "" } else { ", &constants" };
    for case in &sample.cases {
        let given = [&case.motion[..], &case.parameters, &case.constants].concat();
        let _ = writeln!(
            text,
            "    {{
        static const {real} given[] = {{ {} }};
        const {real} *at = given;
        r{index}_motion motion; r{index}_parameters parameters; r{index}_forces forces;
        {real} matrix[R{index}_EQUATIONS][R{index}_PARAMETERS];",
            listed(&given)
        );
        if !constants.is_empty() {
            let _ = writeln!(text, "        r{index}_constants constants;");
        }
        let _ = writeln!(text, "        FILL(motion); FILL(parameters);");
        if !constants.is_empty() {
            let _ = writeln!(text, "        FILL(constants);");
        }
        let _ = writeln!(
            text,
            "        r{index}_regressor(&motion{constants}, matrix); SHOW(matrix);
        r{index}_known(&motion{constants}, &forces); SHOW(forces);
        r{index}_inverse_dynamics(&motion, &parameters{constants}, &forces); SHOW(forces);
        (void)at;
    }}"
        );
    }
    text
}

/// Compiles and runs the C of all models in one precision, with these flags; what the program printed.
fn run_c(samples: &[Sample], compiler: &str, scalar: Scalar, flags: &[&str]) -> String {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let real = scalar.name();
    let mut main = format!(
        "#include <stdio.h>\n#include <string.h>
#define FILL(x) (memcpy(&(x), at, sizeof(x)), at += sizeof(x) / sizeof({real}))
#define SHOW(x) show((const {real} *)&(x), sizeof(x) / sizeof({real}))
static void show(const {real} *values, size_t count)
{{
    while (count-- > 0) {{
        printf(\"%.17g\\n\", (double)*values++);
    }}
}}\n"
    );
    let mut body = String::new();
    let mut arguments: Vec<String> = flags.iter().map(ToString::to_string).collect();
    for (index, sample) in samples.iter().enumerate() {
        let prefix = format!("r{index}");
        let options = Options { scalar, prefix: Some(&prefix), ..Options::new(Language::C, "tpm generate") };
        let files = generate(&sample.estimator, &options).expect("nothing stands in the way");
        for file in files {
            std::fs::write(folder.path().join(&file.name), &file.text).expect("writable");
        }
        let _ = writeln!(main, "#include \"{prefix}.h\"");
        body.push_str(&c_block(index, sample, real));
        arguments.push(format!("{prefix}.c"));
    }
    let _ = writeln!(main, "int main(void)\n{{\n{body}    return 0;\n}}");
    std::fs::write(folder.path().join("main.c"), main).expect("writable");
    arguments.extend(["main.c", "-o", "run", "-lm"].map(str::to_owned));
    output(Command::new(compiler).current_dir(folder.path()).args(arguments));
    output(&mut Command::new(folder.path().join("run")))
}

/// The flags of the sanitizers, where the compiler has them.
fn sanitizers(compiler: &str) -> &'static [&'static str] {
    const FLAGS: &[&str] = &["-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("empty.c"), "int main(void) { return 0; }\n").expect("writable");
    let compiled =
        Command::new(compiler).current_dir(folder.path()).args(FLAGS).args(["empty.c", "-o", "run"]).output();
    let works = compiled.is_ok_and(|output| output.status.success())
        && Command::new(folder.path().join("run")).output().is_ok_and(|output| output.status.success());
    if works { FLAGS } else { &[] }
}

/// The values of a motion in the order of the generated Rust: derivative n of coordinate c at n * coordinates + c.
fn interleaved(sample: &Sample, motion: &[f64]) -> Vec<f64> {
    let coordinates = &sample.estimator.plan.evaluation.coordinates;
    let orders = coordinates.iter().map(|(_, order)| *order as usize + 1).max().unwrap_or(0);
    let mut values = vec![0.0; orders * coordinates.len()];
    let mut given = motion.iter();
    for (c, (_, order)) in coordinates.iter().enumerate() {
        for n in 0..=*order as usize {
            values[n * coordinates.len() + c] = *given.next().expect("a value");
        }
    }
    values
}

/// Compiles and runs the Rust of all models; what the program printed, in double and then in single precision.
fn run_rust(samples: &[Sample], rustc: &str) -> [String; 2] {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let place = |name: &str| folder.path().join(name);
    std::fs::write(place("libm.rs"), LIBM).expect("writable");
    let mut main = String::from(
        "#![allow(dead_code)]\nfn show<T: Into<f64>>(values: impl IntoIterator<Item = T>) {
    values.into_iter().for_each(|value| println!(\"{:?}\", value.into()));\n}\n",
    );
    let mut bodies = [String::new(), String::new()];
    for (index, sample) in samples.iter().enumerate() {
        let files = generate(&sample.estimator, &Options::new(Language::Rust, "tpm generate")).expect("it is written");
        std::fs::write(place(&format!("r{index}.rs")), &files[0].text).expect("writable");
        let _ = writeln!(main, "mod r{index};");
        for (body, real) in bodies.iter_mut().zip(["f64", "f32"]) {
            for case in &sample.cases {
                let constants = if case.constants.is_empty() { "" } else { ", &constants" };
                let _ = writeln!(
                    body,
                    "    {{\n        let motion = r{index}::Motion::<{real}>::from_array(&[{}]);",
                    listed(&interleaved(sample, &case.motion))
                );
                let _ = writeln!(
                    body,
                    "        let parameters = r{index}::Parameters::<{real}>::from_array([{}]);",
                    listed(&case.parameters)
                );
                if !constants.is_empty() {
                    let list = listed(&case.constants);
                    let _ = writeln!(body, "        let constants = r{index}::Constants::from_array([{list}]);");
                }
                let _ = writeln!(
                    body,
                    "        show(r{index}::regressor(&motion{constants}).into_iter().flatten());
        show(r{index}::known(&motion{constants}).into_array());
        show(r{index}::inverse_dynamics(&motion, &parameters{constants}).into_array());\n    }}"
                );
            }
        }
    }
    let [double, single] = bodies;
    let _ = writeln!(
        main,
        "fn main() {{\n    if std::env::args().count() == 1 {{ double() }} else {{ single() }}\n}}
fn double() {{\n{double}}}\nfn single() {{\n{single}}}"
    );
    std::fs::write(place("main.rs"), main).expect("writable");
    let compile = |arguments: &[&str]| {
        let common = ["--edition=2021", "-Dwarnings", "-Coverflow-checks=on"];
        output(Command::new(rustc).current_dir(folder.path()).args(common).args(arguments));
    };
    compile(&["--crate-type=rlib", "--crate-name=libm", "libm.rs"]);
    compile(&["--extern", "libm=liblibm.rlib", "main.rs", "-o", "run"]);
    [output(&mut Command::new(place("run"))), output(Command::new(place("run")).arg("single"))]
}

/// A compiler beside the first, where it is there.
fn other(name: &'static str) -> Option<&'static str> {
    let found = Some(name).filter(|name| runs(name));
    if found.is_none() {
        skipped(&format!("no {name} was found, so that generated C of random models was not compiled by it"));
    }
    found
}

#[test]
fn generated_code_of_random_models_computes_what_the_model_says() {
    let tried = tried(MODELS);
    let count = usize::try_from(tried.end - tried.start).expect("few models");
    let samples: Vec<Sample> = tried.filter_map(sample).collect();
    assert!(2 * samples.len() > count, "{} of {count} models have an estimator", samples.len());
    let scalars = [(Scalar::Double, f64::EPSILON), (Scalar::Float, f64::from(f32::EPSILON))];
    let mut report = format!("{} of {count} random models", samples.len());
    let first = compiler();
    for compiler in first.into_iter().chain(other("clang").filter(|_| first != Some("clang"))) {
        let sanitized = sanitizers(compiler);
        for (scalar, epsilon) in scalars {
            let printed = run_c(&samples, compiler, scalar, &[&FLAGS, sanitized].concat());
            let worst = compare(&samples, &format!("C by {compiler}, {}", scalar.name()), epsilon, &printed);
            let _ = write!(report, "; C by {compiler}, {}: at most {worst:.1} roundings", scalar.name());
        }
        let _ = write!(report, "{}", if sanitized.is_empty() { "; without sanitizers" } else { "; sanitized" });
    }
    // A compiler takes a file of C for one of C++ when it is told to.
    if let Some(compiler) = other("c++") {
        let printed = run_c(&samples, compiler, Scalar::Double, &CPP_FLAGS);
        let worst = compare(&samples, "C++, double", f64::EPSILON, &printed);
        let _ = write!(report, "; C++: at most {worst:.1} roundings");
    }
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    if runs(&rustc) {
        let printed = run_rust(&samples, &rustc);
        for ((scalar, epsilon), printed) in scalars.into_iter().zip(printed) {
            let worst = compare(&samples, &format!("Rust, {}", scalar.name()), epsilon, &printed);
            let _ = write!(report, "; Rust, {}: at most {worst:.1} roundings", scalar.name());
        }
    } else {
        skipped("no rustc was found, so that generated Rust of random models was not run");
    }
    say(&report);
}
