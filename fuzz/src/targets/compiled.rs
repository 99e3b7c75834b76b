//! Generated C of random models, compiled and run: regressors, known terms, forces, references and strokes beside exact evaluation, with
//! constants, and parameters in which the rows are not linear, at random values.

use super::exact::{Point, Sum, exact};
use super::models::within_budget;
use super::random::Random;
use super::{Verdict, values};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::generate::{Language, Options, generate};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::Kind;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::plan::pattern::PatternPlan;

/// Roundings that a value may gather, in units of the precision times the magnitudes of its terms.
const ROUNDINGS: f64 = 64.0;

/// Where the model is evaluated.
const POINTS: usize = 2;

/// What the values are written with, in `main.c`.
const HEAD: &str = "#include <stdio.h>
#include <string.h>
#include \"t.c\"
#define FILL(x) (memcpy(&(x), at, sizeof(x)), at += sizeof(x) / sizeof(double))
#define SHOW(x) show((const double *)&(x), sizeof(x) / sizeof(double))
static void show(const double *values, size_t count)
{
    while (count-- > 0) {
        printf(\"%.17g\\n\", *values++);
    }
}
";

/// A compiler, and how a program is compiled by it and run.
struct Compiler {
    name: &'static str,
    /// Whether it runs what it has compiled, in one process.
    runs: bool,
}

/// The first compiler of this machine. The one that takes a millisecond is asked for first.
fn compiler() -> Option<&'static Compiler> {
    const ALL: [Compiler; 4] = [
        Compiler { name: "tcc", runs: true },
        Compiler { name: "cc", runs: false },
        Compiler { name: "gcc", runs: false },
        Compiler { name: "clang", runs: false },
    ];
    static FOUND: OnceLock<Option<Compiler>> = OnceLock::new();
    let is_there = |one: &Compiler| {
        let version = if one.runs { "-v" } else { "--version" };
        Command::new(one.name).arg(version).output().is_ok_and(|output| output.status.success())
    };
    FOUND.get_or_init(|| ALL.into_iter().find(is_there)).as_ref()
}

/// Whether this machine has a compiler of C.
#[allow(dead_code, reason = "the tests of the workspace ask, the program of this folder needs one")]
pub(crate) fn can_compile() -> bool {
    compiler().is_some()
}

thread_local! {
    /// A folder of this thread, which goes when the thread ends.
    static FOLDER: tempfile::TempDir = tempfile::tempdir().expect("a temporary folder");
}

/// A model by the grammar, one in two with parameters in which it is not linear, one in five changed.
pub(super) fn text(random: &mut Random) -> String {
    if random.below(2) == 0 { values::text(random) } else { values::nonlinear_text(random) }
}

/// Values at which the generated functions are called.
struct Case {
    motion: Vec<f64>,
    parameters: Vec<f64>,
    constants: Vec<f64>,
    /// Of every pattern that has a reference.
    strokes: Vec<StrokeCase>,
}

/// A pattern's values, and an instant of one of its strokes.
struct StrokeCase {
    /// The amplitudes, then the frequency.
    values: Vec<f64>,
    time: f64,
    from: f64,
    to: f64,
}

/// Numbers are dyadic, so that sums and products of few of them are exact.
fn cases(estimator: &EstimatorSource, seed: u64) -> Vec<Case> {
    let evaluation = &estimator.plan.evaluation;
    let mut random = Random(seed);
    let mut list = |count: usize| (0..count).map(|_| values::dyadic(&mut random)).collect::<Vec<f64>>();
    let motion: usize = evaluation.coordinates.iter().map(|(_, order)| *order as usize + 1).sum();
    let positive = |value: f64| value.abs() + 0.25;
    let mut case = || Case {
        motion: list(motion),
        parameters: list(estimator.form.columns.len()),
        constants: list(evaluation.constants.len()).into_iter().map(positive).collect(),
        strokes: strokes(estimator)
            .map(|(_, pattern)| {
                let values = list(pattern.amplitudes.len() + 1).into_iter().map(positive).collect();
                let [time, from, length] = [0; 3].map(|_| list(1)[0]);
                StrokeCase { values, time, from, to: from + positive(length) }
            })
            .collect(),
    };
    (0..POINTS).map(|_| case()).collect()
}

/// The patterns that have a reference, with their places.
fn strokes(estimator: &EstimatorSource) -> impl Iterator<Item = (usize, &PatternPlan)> {
    estimator.plan.patterns.iter().enumerate().filter(|(_, pattern)| pattern.reference.is_ok())
}

/// The prefix of a pattern's names.
fn part(estimator: &EstimatorSource, pattern: &PatternPlan) -> String {
    match &pattern.name {
        Some(name) if estimator.plan.patterns.len() > 1 => format!("{name}_"),
        _ => String::new(),
    }
}

/// The program that prints all values of all cases.
fn program(estimator: &EstimatorSource, cases: &[Case]) -> String {
    let constants = if estimator.plan.evaluation.constants.is_empty() { "" } else { ", &constants" };
    let mut text = format!("{HEAD}int main(void)\n{{\n");
    for case in cases {
        let mut given = [&case.motion[..], &case.parameters, &case.constants].concat();
        let mut body = String::from("FILL(motion); FILL(parameters);\n");
        let mut declared = String::new();
        if !constants.is_empty() {
            declared.push_str("t_constants constants;\n");
            body.push_str("FILL(constants);\n");
        }
        let _ = write!(
            body,
            "t_regressor(&motion{constants}, matrix); SHOW(matrix);
t_known(&motion{constants}, &forces); SHOW(forces);
t_inverse_dynamics(&motion, &parameters{constants}, &forces); SHOW(forces);\n"
        );
        for ((index, pattern), own) in strokes(estimator).zip(&case.strokes) {
            let part = part(estimator, pattern);
            given.extend(own.values.iter().chain([&own.time, &own.from, &own.to]));
            let _ = writeln!(declared, "t_{part}pattern pattern{index}; double of{index}[3];");
            let _ = write!(
                body,
                "FILL(pattern{index}); FILL(of{index});
t_{part}reference_at(&pattern{index}{constants}, of{index}[1], &motion); SHOW(motion);
t_{part}stroke(&pattern{index}{constants}, of{index}[0], of{index}[1], of{index}[2], &motion); SHOW(motion);\n"
            );
        }
        let given: Vec<String> = given.iter().map(|value| format!("{value:?}")).collect();
        let _ = write!(
            text,
            "{{
static const double given[] = {{ {} }};
const double *at = given;
t_motion motion; t_parameters parameters; t_forces forces; double matrix[T_EQUATIONS][T_PARAMETERS];
{declared}{body}(void)at;
}}\n",
            given.join(", ")
        );
    }
    text + "return 0;\n}\n"
}

/// The output of a program, which must succeed.
fn output(command: &mut Command) -> String {
    let output = command.output().expect("a program");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {}\n{said}", output.status);
    String::from_utf8(output.stdout).expect("numbers")
}

/// Compiles and runs `main.c` of a folder.
fn run(folder: &Path, compiler: &Compiler) -> String {
    let mut command = Command::new(compiler.name);
    command.current_dir(folder);
    if compiler.runs {
        return output(command.args(["-lm", "-run", "main.c"]));
    }
    output(command.args(["-std=c99", "-O0", "main.c", "-o", "run", "-lm"]));
    output(&mut Command::new(folder.join("run")))
}

/// The motion of a pattern at a phase, at rest before and after a stroke, in the order of the generated structure. The cosine of a
/// harmonic is made from that of the first, so that each of its steps has a rounding of its own.
fn reference(
    estimator: &EstimatorSource,
    (index, case, own): (usize, &Case, &StrokeCase),
    phase: f64,
    rests: bool,
) -> Vec<Sum> {
    let pattern = &estimator.plan.patterns[index];
    let value = |symbol: Symbol| {
        let place = pattern.amplitudes.iter().chain([&pattern.frequency]).position(|present| *present == symbol);
        let constant = estimator.plan.evaluation.constants.iter().position(|present| *present == symbol);
        match &estimator.model.quantity(symbol).kind {
            Kind::Constant { value: Some(value) } => rational::to_f64(value),
            _ => place.map(|i| own.values[i]).or(constant.map(|i| case.constants[i])).expect("a known symbol"),
        }
    };
    let w = value(pattern.frequency);
    let mut sums = Vec::new();
    for &(coordinate, order) in &estimator.plan.evaluation.coordinates {
        let motion = estimator.model.patterns[index].motions[coordinate.0 as usize].as_ref().expect("it moves");
        for n in 0..=order {
            if n > 0 && rests {
                sums.push(Sum::default());
                continue;
            }
            let (mut expected, mut magnitude) = (0.0, 0.0);
            for (monomial, fourier) in motion.derivative(n).terms() {
                let factor: f64 = monomial.factors().map(|(symbol, power)| value(*symbol).powi(power)).product();
                let factor = factor * w.powi(i32::try_from(n).expect("small"));
                expected += factor * fourier.evaluate(phase);
                let sizes = fourier.terms().map(|(harmonic, _, c)| rational::to_f64(c).abs() * (1.0 + harmonic as f64));
                magnitude += factor.abs() * sizes.sum::<f64>();
            }
            let number = |value: f64| rational::from_f64(value);
            let sum = number(expected).zip(number(magnitude)).map(|(value, magnitude)| Sum { value, magnitude });
            sums.push(sum.unwrap_or_default());
        }
    }
    sums
}

/// All values that the program prints for a case, in their order.
fn expected(estimator: &EstimatorSource, case: &Case) -> Vec<Sum> {
    let point = Point { estimator, motion: &case.motion, constants: &case.constants, physical: &[] };
    let form = &estimator.form;
    let columns = 0..form.columns.len();
    let mut all: Vec<Sum> =
        form.rows.iter().flat_map(|row| columns.clone().map(|column| point.entry(row, Some(column)))).collect();
    all.extend(form.rows.iter().map(|row| point.entry(row, None)));
    all.extend(form.rows.iter().map(|row| point.force(row, &case.parameters)));
    for ((index, _), own) in strokes(estimator).zip(&case.strokes) {
        let at = (index, case, own);
        all.extend(reference(estimator, at, own.from, false));
        let phase = own.from + own.values.last().expect("a frequency") * own.time;
        let within = phase > own.from && phase < own.to;
        let phase = if within {
            phase
        } else if phase > own.from {
            own.to
        } else {
            own.from
        };
        all.extend(reference(estimator, at, phase, !within));
    }
    all
}

/// The largest magnitude of which a sum of roundings is still a number.
fn is_in_range(sum: &Sum) -> bool {
    let limit = |size: &Rational| rational::to_f64(size) < 1e300;
    limit(&sum.magnitude)
}

/// What the generated C of a model computes, which must be what the model says.
pub(super) fn beside_exact(text: &str) -> Verdict {
    within_budget(text, |parsed| {
        let estimator = EstimatorSource::of(parsed).map_err(|fault| fault.headline())?;
        let strokes = estimator.check_strokes().is_ok();
        let options = Options { prefix: Some("t"), strokes, ..Options::new(Language::C, "tpm generate") };
        let files = generate(&estimator, &options).map_err(|fault| fault.to_string())?;
        let compiler = compiler().ok_or("no compiler of C")?;
        let cases = cases(&estimator, text.len() as u64);
        let printed = FOLDER.with(|folder| {
            let place = |name: &str| -> PathBuf { folder.path().join(name) };
            for file in files {
                std::fs::write(place(&file.name), &file.text).expect("writable");
            }
            std::fs::write(place("main.c"), program(&estimator, &cases)).expect("writable");
            run(folder.path(), compiler)
        });
        let found: Vec<f64> = printed.lines().map(|line| line.parse().expect("a number")).collect();
        if found.iter().any(|value| !value.is_finite()) {
            return Err("a value beyond the range of numbers, or none".to_owned());
        }
        let expected: Vec<Sum> = cases.iter().flat_map(|case| expected(&estimator, case)).collect();
        assert_eq!(found.len(), expected.len(), "values that were printed");
        for (at, (found, expected)) in found.into_iter().zip(&expected).enumerate() {
            if !is_in_range(expected) {
                return Err("a value beyond the range of numbers".to_owned());
            }
            let error = rational::to_f64(&rational::abs(&(exact(found) - &expected.value)));
            let most = ROUNDINGS * f64::EPSILON * rational::to_f64(&expected.magnitude);
            let value = rational::to_f64(&expected.value);
            assert!(
                error <= most,
                "value {at}: {found} is not {value}: off by {error:e}, and {most:e} is allowed\n{text}"
            );
        }
        Ok(())
    })
}
