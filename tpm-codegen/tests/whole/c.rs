//! Generated C, compiled and run, against exact rational evaluation.
//!
//! The exact side never sees a plan: it multiplies the terms of the regressor form, and the entries of the table, as
//! rationals, and powers of the phasor as complex numbers. Inputs are dyadic, so that they are exact in both precisions, but for
//! points of the circle, which are rounded to each. Every bound is a stated number of roundings times the sum of the magnitudes
//! of the terms, since cancellation is the model's, not the code's. Without a C compiler the tests are skipped; `.ci/run`
//! installs one.

use crate::random::Random;
use crate::support::exact::{Point, Sum, exact, harmonic_power, unlumped};
use crate::support::{estimator, models_in, skipped};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::generate::{File, Language, Options, Scalar, generate};
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::Kind;
use tpm_symbolic::number::rational;
use tpm_symbolic::number::rational::Rational;
use tpm_symbolic::plan::lumping::Unlumping;
use tpm_symbolic::plan::pattern::PatternPlan;
use tpm_symbolic::plan::table::TablePlan;

/// Roundings that any value of these models may gather.
const ROUNDINGS: f64 = 16.0;

/// Roundings that solutions, and sums of computed forces over the samples of a period, may gather.
const SUMMED_ROUNDINGS: f64 = 64.0;

/// Standard C without a warning.
pub(crate) const FLAGS: [&str; 6] = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror"];

/// The shipped models, then models that reach corners of the emitter which no shipped model reaches.
fn model_files() -> Vec<PathBuf> {
    models_in("models").into_iter().chain(models_in("tests/fixtures/emit")).collect()
}

fn generated(estimator: &EstimatorSource, scalar: Scalar) -> Vec<File> {
    let options = Options { scalar, prefix: Some("t"), ..Options::new(Language::C, "tpm generate --lang c") };
    generate(estimator, &options).expect("nothing stands in the way")
}

pub(crate) fn compiler() -> Option<&'static str> {
    let found = ["cc", "gcc", "clang"].into_iter().find(|name| runs(name));
    if found.is_none() {
        skipped("no C compiler (cc, gcc, clang) was found, so that generated C was not run");
    }
    found
}

/// A line that the test runner does not hold back.
pub(crate) fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

pub(crate) fn runs(name: &str) -> bool {
    Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success())
}

fn compile(compiler: &str, folder: &Path, arguments: &[&str]) {
    let output = Command::new(compiler).current_dir(folder).args(arguments).output().expect("the compiler runs");
    assert!(output.status.success(), "{compiler} {arguments:?}\n{}", String::from_utf8_lossy(&output.stderr));
}

impl Random {
    /// A number k/64 with |k| <= 192.
    fn dyadic(&mut self) -> f64 {
        f64::from(u32::try_from(self.next() % 385).expect("small")) / 64.0 - 3.0
    }

    pub(crate) fn list(&mut self, count: usize) -> Vec<f64> {
        (0..count).map(|_| self.dyadic()).collect()
    }
}

/// The numbers that a run of the driver reads.
struct Case {
    motion: Vec<f64>,
    parameters: Vec<f64>,
    constants: Vec<f64>,
    physical: Vec<f64>,
    /// The columns of `physical`, rounded, where the way back exists.
    lumped: Vec<f64>,
    patterns: Vec<PatternCase>,
}

struct PatternCase {
    values: Vec<f64>,
    phase: f64,
    cosine: f64,
    sine: f64,
    /// The sample of the forces that the harmonics are accumulated from.
    forces: Vec<f64>,
    deviations: Vec<f64>,
    effort: Vec<f64>,
}

impl Case {
    fn numbers(&self) -> Vec<f64> {
        let mut list = [&self.motion[..], &self.parameters, &self.constants, &self.physical, &self.lumped].concat();
        for pattern in &self.patterns {
            list.extend(&pattern.values);
            list.extend([pattern.phase, pattern.cosine, pattern.sine]);
            list.extend(pattern.forces.iter().chain(&pattern.deviations).chain(&pattern.effort));
        }
        list
    }
}

/// The driver: a program that calls every generated function on the numbers that it reads, and prints their results.
fn driver(estimator: &EstimatorSource, scalar: Scalar) -> String {
    let plan = &estimator.plan;
    let real = scalar.name();
    let constants = if plan.evaluation.constants.is_empty() { "" } else { ", &constants" };
    let only_constants = if plan.evaluation.constants.is_empty() { "" } else { "&constants, " };
    let mut declared = String::from("    t_motion motion, reference; t_parameters parameters; t_forces forces;\n");
    let mut body = String::from("        FILL(motion); FILL(parameters);\n");
    if !constants.is_empty() {
        declared.push_str("    t_constants constants;\n");
        body.push_str("        FILL(constants);\n");
    }
    if plan.lumping.is_some() {
        declared.push_str("    t_physical physical; t_parameters lumped;\n");
        body.push_str("        FILL(physical);\n");
    }
    if unlumping(estimator).is_some() {
        declared.push_str("    t_parameters given; t_physical back;\n");
        body.push_str("        FILL(given);\n");
    }
    declared.push_str(&format!("    {real} phi[T_EQUATIONS][T_PARAMETERS]; {real} map[T_EQUATIONS][T_INPUTS];\n"));
    body.push_str(&format!(
        "        t_regressor(&motion{constants}, phi); SHOW(phi);
        t_known(&motion{constants}, &forces); SHOW(forces);
        t_input_map({only_constants}map); SHOW(map);
        t_inverse_dynamics(&motion, &parameters{constants}, &forces); SHOW(forces);\n"
    ));
    if plan.feed_forward.is_some() {
        declared.push_str("    t_inputs inputs;\n");
        body.push_str(&format!(
            "        t_feed_forward_with_regressor(&motion, &parameters{constants}, &inputs, phi); SHOW(phi); SHOW(inputs);\n"
        ));
        let mut names = vec!["feed_forward"];
        if plan.feed_forward_parts.is_some() {
            names.extend(["feed_forward_independent", "feed_forward_dependent"]);
        }
        for name in names {
            body.push_str(&format!("        t_{name}(&motion, &parameters{constants}, &inputs); SHOW(inputs);\n"));
        }
    }
    if plan.lumping.is_some() {
        body.push_str(&format!("        t_lump(&physical{constants}, &lumped); SHOW(lumped);\n"));
    }
    if unlumping(estimator).is_some() {
        body.push_str(&format!("        t_unlump(&given{constants}, &back); SHOW(back);\n"));
    }
    for (index, pattern) in plan.patterns.iter().enumerate() {
        let part = part(estimator, pattern);
        declared.push_str(&format!(
            "    t_{part}pattern pattern{index}; {real} phase{index}, cosine{index}, sine{index};\n"
        ));
        body.push_str(&format!(
            "        FILL(pattern{index}); FILL(phase{index}); FILL(cosine{index}); FILL(sine{index});\n"
        ));
        body.push_str(&format!("        phase{index} = phase{index} + t_{part}period(&pattern{index}) * 0;\n"));
        if pattern.reference.is_ok() {
            body.push_str(&format!(
                "        t_{part}reference_at(&pattern{index}{constants}, phase{index}, &reference); SHOW(reference);
        t_{part}reference(&pattern{index}{constants}, phase{index} / 4, &reference); SHOW(reference);\n"
            ));
        }
        let Ok(table) = &pattern.table else { continue };
        let upper = part.to_uppercase();
        declared.push_str(&format!(
            "    t_{part}harmonics harmonics{index}, deviations{index}, effort{index}; t_{part}accumulator sums{index};
    t_{part}workspace work{index}; t_estimate estimate{index}; int status{index};
    {real} matrix{index}[T_{upper}HARMONICS][T_PARAMETERS];\n"
        ));
        body.push_str(&format!(
            "        FILL(forces); FILL(deviations{index}); FILL(effort{index});
        t_{part}estimator_matrix(&pattern{index}{constants}, matrix{index}); SHOW(matrix{index});\n"
        ));
        if table.places.iter().any(|(_, column)| column.is_none()) {
            body.push_str(&format!(
                "        t_{part}known_harmonics(&pattern{index}{constants}, &harmonics{index}); SHOW(harmonics{index});\n"
            ));
        }
        body.push_str(&format!(
            "        t_{part}accumulator_clear(&sums{index});
        if (t_{part}accumulated(&sums{index}, &harmonics{index}) != T_TOO_FEW) return 1;
        t_{part}accumulate_at(&sums{index}, cosine{index}, sine{index}, &forces);
        if (sums{index}.samples != 1) return 2;
        SHOW(sums{index}.sums);\n"
        ));
        if pattern.reference.is_ok() {
            body.push_str(&format!(
                "        {{
            enum {{ COUNT = 2 * T_{upper}HIGHEST_HARMONIC + 3 }};
            static t_forces samples[COUNT];
            int i;
            t_{part}accumulator_clear(&sums{index});
            for (i = 0; i < COUNT; ++i) {{
                const {real} at = ({real})6.283185307179586476925 * ({real})i / ({real})COUNT;
                t_{part}reference_at(&pattern{index}{constants}, at, &reference);
                t_inverse_dynamics(&reference, &parameters{constants}, &samples[i]);
                t_{part}accumulate(&sums{index}, at, &samples[i]);
            }}
            if (t_{part}accumulated(&sums{index}, &harmonics{index}) != T_OK) return 3;
            SHOW(harmonics{index});
            if (t_{part}transform(samples, COUNT - 3, &harmonics{index}) != T_TOO_FEW) return 4;
            if (t_{part}transform(samples, COUNT, &harmonics{index}) != T_OK) return 5;
            SHOW(harmonics{index});
            t_{part}accumulator_clear(&sums{index});
            for (i = 0; i < 3 * COUNT; ++i) {{
                const {real} at = ({real})6.283185307179586476925 * ({real})i / ({real})COUNT;
                t_{part}accumulate_hann(&sums{index}, at, 3, &samples[i % COUNT]);
            }}
            if (t_{part}accumulated(&sums{index}, &harmonics{index}) != T_OK) return 6;
            SHOW(harmonics{index});
        }}\n"
            ));
        }
        if has_direct(estimator) {
            body.push_str(&format!(
                "        t_{part}identify_direct(&pattern{index}{constants}, &effort{index}, &parameters); SHOW(parameters);\n"
            ));
        }
        for deviations in ["NULL".to_owned(), format!("&deviations{index}")] {
            body.push_str(&format!(
                "        status{index} = (int)t_{part}identify(&pattern{index}{constants}, &effort{index}, {deviations}, &work{index}, &estimate{index});
        printf(\"%d\\n%d\\n%d\\n\", status{index}, estimate{index}.rank, estimate{index}.undetermined);
        if (status{index} != T_OK) memset(&estimate{index}, 0, sizeof estimate{index});
        SHOW(estimate{index}.condition); SHOW(estimate{index}.parameters); SHOW(estimate{index}.covariance);\n"
            ));
        }
    }
    format!(
        "#include <stdio.h>
#include <string.h>
#include \"t.h\"
static void fill({real} *values, size_t count)
{{
    double x;
    while (count-- > 0) {{
        if (scanf(\"%lf\", &x) != 1) {{
            x = 0.0 / 0.0;
        }}
        *values++ = ({real})x;
    }}
}}
static void show(const {real} *values, size_t count)
{{
    while (count-- > 0) {{
        printf(\"%.17g\\n\", (double)*values++);
    }}
}}
#define FILL(x) fill(({real} *)&(x), sizeof(x) / sizeof({real}))
#define SHOW(x) show((const {real} *)&(x), sizeof(x) / sizeof({real}))
int main(void)
{{
    int cases;
{declared}
    if (scanf(\"%d\", &cases) != 1) return 9;
    while (cases-- > 0) {{
{body}    }}
    return 0;
}}
"
    )
}

/// Map from the columns back to the physical parameters, where one exists.
fn unlumping(estimator: &EstimatorSource) -> Option<&Unlumping> {
    estimator.plan.unlumping.as_ref()?.as_ref().ok()
}

/// Whether the code has the exact pseudo-inverse.
fn has_direct(estimator: &EstimatorSource) -> bool {
    generated(estimator, Scalar::Double).iter().any(|file| file.text.contains("identify_direct("))
}

/// Prefix of a pattern's names.
fn part(estimator: &EstimatorSource, pattern: &PatternPlan) -> String {
    match &pattern.name {
        // C keeps the word for itself; the prefix frees it, and the namer has marked it all the same.
        Some(name) if estimator.plan.patterns.len() > 1 => format!("{name}_"),
        _ => String::new(),
    }
}

fn epsilon(scalar: Scalar) -> f64 {
    match scalar {
        Scalar::Float => f64::from(f32::EPSILON),
        Scalar::Double => f64::EPSILON,
    }
}

fn rounded(scalar: Scalar, value: &Rational) -> f64 {
    match scalar {
        Scalar::Float => f64::from(rational::to_f32(value)),
        Scalar::Double => rational::to_f64(value),
    }
}

/// The table's entry at a place, and its magnitude.
fn entry(table: &TablePlan, row: usize, column: Option<usize>, value: &dyn Fn(Symbol) -> f64) -> Sum {
    let (equation, harmonic, function) = table.rows[row];
    let symbol = |index: usize| Symbol(u32::try_from(index).expect("small"));
    Sum::of(table.table.at(equation, harmonic, function, column).map(|entry| {
        let mut product = entry.coefficient.clone() * crate::support::exact::pi_power(entry.pi);
        for (&index, power) in entry.powers.factors() {
            product *= rational::power(&exact(value(symbol(index))), power);
        }
        for (&index, power) in entry.sign.factors() {
            if power % 2 != 0 {
                product *= exact(match value(symbol(index)) {
                    0.0 => 0.0,
                    value => value.signum(),
                });
            }
        }
        product
    }))
}

/// Reads what the driver printed, in the order in which it prints.
struct Found<'a> {
    values: std::slice::Iter<'a, f64>,
    /// Whether the code has the exact pseudo-inverse.
    direct: bool,
    what: String,
    epsilon: f64,
    /// The largest error so far, in roundings of the magnitude.
    worst: f64,
}

impl Found<'_> {
    fn next(&mut self) -> f64 {
        *self.values.next().unwrap_or_else(|| panic!("{}: the driver printed too little", self.what))
    }

    fn check(&mut self, name: &str, expected: &Sum, roundings: f64) {
        let found = self.next();
        let error = rational::to_f64(&rational::abs(&(exact(found) - &expected.value)));
        let unit = self.epsilon * rational::to_f64(&expected.magnitude);
        self.worst = self.worst.max(if error == 0.0 { 0.0 } else { error / unit });
        assert!(
            error <= roundings * unit,
            "{}: {name} is {found}, not {}, by {:.1} roundings",
            self.what,
            rational::to_f64(&expected.value),
            error / unit
        );
    }
}

fn cases(estimator: &EstimatorSource, scalar: Scalar, count: u64) -> Vec<Case> {
    let plan = &estimator.plan;
    let motion: usize = plan.evaluation.coordinates.iter().map(|(_, order)| *order as usize + 1).sum();
    let physical = if plan.lumping.is_some() { estimator.model.parameters().count() } else { 0 };
    (0..count)
        .map(|seed| {
            let mut random = Random(seed);
            let mut case = Case {
                motion: random.list(motion),
                parameters: random.list(estimator.form.columns.len()),
                constants: random.list(plan.evaluation.constants.len()),
                physical: random.list(physical),
                lumped: Vec::new(),
                patterns: Vec::new(),
            };
            // Physical parameters stand in denominators too.
            case.physical.iter_mut().chain(&mut case.constants).filter(|value| **value == 0.0).for_each(|v| *v = 1.0);
            if unlumping(estimator).is_some() {
                let point = Point { estimator, motion: &[], constants: &case.constants, physical: &case.physical };
                let lumped = estimator.form.columns.iter().map(|column| point.lumped(column).value);
                case.lumped = lumped.map(|value| rounded(scalar, &value)).collect();
            }
            // Where functions of positions have exact values.
            if seed % 4 == 3 {
                let mut at = 0;
                for (_, order) in &plan.evaluation.coordinates {
                    case.motion[at] = 0.0;
                    at += *order as usize + 1;
                }
            }
            for pattern in &plan.patterns {
                let mut values = random.list(pattern.amplitudes.len() + 1);
                values.iter_mut().filter(|value| **value == 0.0).for_each(|value| *value = 0.5);
                let phase = random.dyadic();
                let angle = random.dyadic();
                let (sine, cosine) = angle.sin_cos();
                let mut own = PatternCase {
                    values,
                    phase,
                    cosine,
                    sine,
                    forces: Vec::new(),
                    deviations: Vec::new(),
                    effort: Vec::new(),
                };
                if let Ok(table) = &pattern.table {
                    own.forces = random.list(estimator.form.rows.len());
                    own.deviations = (0..table.rows.len()).map(|_| random.dyadic().abs() + 0.25).collect();
                    let value =
                        |symbol: Symbol| pattern_value(estimator, pattern, &case.constants, &own.values, symbol);
                    own.effort = (0..table.rows.len())
                        .map(|row| rounded(scalar, &forces_harmonic(table, row, &case.parameters, &value).value))
                        .collect();
                }
                case.patterns.push(own);
            }
            case
        })
        .collect()
}

fn pattern_value(
    estimator: &EstimatorSource,
    pattern: &PatternPlan,
    constants: &[f64],
    values: &[f64],
    symbol: Symbol,
) -> f64 {
    let own = pattern.amplitudes.iter().chain([&pattern.frequency]).position(|present| *present == symbol);
    let constant = estimator.plan.evaluation.constants.iter().position(|present| *present == symbol);
    match &estimator.model.quantity(symbol).kind {
        Kind::Constant { value: Some(value) } => rational::to_f64(value),
        _ => own.map(|i| values[i]).or(constant.map(|i| constants[i])).expect("a known symbol"),
    }
}

/// The harmonic of the forces that the pattern needs: known terms and every parameter's share.
fn forces_harmonic(table: &TablePlan, row: usize, theta: &[f64], value: &dyn Fn(Symbol) -> f64) -> Sum {
    let mut sum = entry(table, row, None, value);
    for (column, &theta) in theta.iter().enumerate() {
        sum.add_scaled(&entry(table, row, Some(column), value), &exact(theta));
    }
    sum
}

fn check_dynamics(estimator: &EstimatorSource, case: &Case, found: &mut Found<'_>) {
    let point = Point { estimator, motion: &case.motion, constants: &case.constants, physical: &case.physical };
    let columns: Vec<Option<usize>> = (0..estimator.form.columns.len()).map(Some).collect();
    for (name, columns) in [("regressor", columns.as_slice()), ("known", &[None])] {
        for row in &estimator.form.rows {
            for &column in columns {
                found.check(name, &point.entry(row, column), ROUNDINGS);
            }
        }
    }
    let inputs = &estimator.plan.evaluation.inputs;
    for row in &estimator.form.rows {
        for input in inputs {
            found.check("input map", &point.input_factor(row, *input), ROUNDINGS);
        }
    }
    let forces: Vec<Sum> = estimator.form.rows.iter().map(|row| point.force(row, &case.parameters)).collect();
    for force in &forces {
        found.check("inverse dynamics", force, ROUNDINGS);
    }
    if estimator.plan.feed_forward.is_some() {
        let mut whole: Vec<Sum> = Vec::new();
        for row in &estimator.form.rows {
            for &column in &columns {
                found.check("regressor beside feed-forward", &point.entry(row, column), ROUNDINGS);
            }
        }
        for input in inputs {
            let alone =
                |row: &&tpm_symbolic::regressor::form::Row| row.inputs.iter().any(|(present, _)| present == input);
            let (r, row) = estimator.form.rows.iter().enumerate().find(|(_, row)| alone(row)).expect("its row");
            let factor = point.input_factor(row, *input).value;
            let mut sum = Sum::default();
            sum.add_scaled(&forces[r], &(rational::integer(1) / factor));
            found.check("feed-forward beside regressor", &sum, ROUNDINGS);
            whole.push(sum);
        }
        for sum in &whole {
            found.check("feed-forward", sum, ROUNDINGS);
        }
        if estimator.plan.feed_forward_parts.is_some() {
            // Each part has its share of the terms; together they are the whole.
            let parts: Vec<f64> = (0..2 * inputs.len()).map(|_| found.next()).collect();
            for (i, whole) in whole.iter().enumerate() {
                let sum = parts[i] + parts[inputs.len() + i];
                let error = (sum - rational::to_f64(&whole.value)).abs();
                let bound = ROUNDINGS * found.epsilon * rational::to_f64(&whole.magnitude);
                assert!(error <= bound, "{}: the parts of input {i} add up to {sum}", found.what);
            }
        }
    }
    if estimator.plan.lumping.is_some() {
        for column in &estimator.form.columns {
            found.check("lump", &point.lumped(column), ROUNDINGS);
        }
    }
    if let Some(Unlumping { inverse, .. }) = unlumping(estimator) {
        let constant = |symbol: Symbol| {
            let place = estimator.plan.evaluation.constants.iter().position(|present| *present == symbol);
            exact(case.constants[place.expect("a constant of the model")])
        };
        // Exactly there and back, and then at what the code was given.
        let columns: Vec<Rational> = estimator.form.columns.iter().map(|column| point.lumped(column).value).collect();
        let back = unlumped(&estimator.model, inverse, &columns, constant);
        for (back, physical) in back.iter().flatten().zip(&case.physical) {
            assert_eq!(back.value, exact(*physical), "{}: the inverse is exact", found.what);
        }
        let columns: Vec<Rational> = case.lumped.iter().map(|value| exact(*value)).collect();
        match unlumped(&estimator.model, inverse, &columns, constant) {
            Some(parameters) => parameters.iter().for_each(|sum| found.check("unlump", sum, ROUNDINGS)),
            None => (0..case.physical.len()).for_each(|_| {
                found.next();
            }),
        }
    }
}

fn check_pattern(estimator: &EstimatorSource, index: usize, case: &Case, scalar: Scalar, found: &mut Found<'_>) {
    let pattern = &estimator.plan.patterns[index];
    let own = &case.patterns[index];
    let value = |symbol: Symbol| pattern_value(estimator, pattern, &case.constants, &own.values, symbol);
    if pattern.reference.is_ok() {
        let w = value(pattern.frequency);
        // The phase of the second call is computed in the scalar: w and time / 4 are dyadic, so that it is exact.
        for phase in [own.phase, w * own.phase / 4.0] {
            for &(coordinate, order) in &estimator.plan.evaluation.coordinates {
                let motion = estimator.model.patterns[index].motions[coordinate.0 as usize].as_ref().expect("it moves");
                for n in 0..=order {
                    let scale = w.powi(i32::try_from(n).expect("small"));
                    let (mut expected, mut magnitude) = (0.0, 0.0);
                    for (monomial, fourier) in motion.derivative(n).terms() {
                        let factors = monomial.factors();
                        let factor: f64 = factors.map(|(symbol, power)| value(*symbol).powi(power)).product();
                        expected += scale * factor * fourier.evaluate(phase);
                        let size: f64 = fourier.terms().map(|(_, _, c)| rational::to_f64(c).abs()).sum();
                        magnitude += (scale * factor).abs() * size;
                    }
                    let sum = Sum { value: exact(expected), magnitude: exact(magnitude) };
                    found.check("reference", &sum, ROUNDINGS);
                }
            }
        }
    }
    let Ok(table) = &pattern.table else { return };
    let (rows, columns) = (table.rows.len(), estimator.form.columns.len());
    let mut matrix = vec![vec![rational::integer(0); columns]; rows];
    for (row, exact_row) in matrix.iter_mut().enumerate() {
        for (column, exact_entry) in exact_row.iter_mut().enumerate() {
            let sum = entry(table, row, Some(column), &value);
            found.check("estimator matrix", &sum, ROUNDINGS);
            *exact_entry = sum.value;
        }
    }
    if table.places.iter().any(|(_, column)| column.is_none()) {
        for row in 0..rows {
            found.check("known harmonics", &entry(table, row, None, &value), ROUNDINGS);
        }
    }
    // One sample: the signal times the real or imaginary part of (cosine + j sine)^k, at a point that is a rounding off the circle.
    let [cosine, sine] = [own.cosine, own.sine].map(|value| match scalar {
        Scalar::Float => f64::from(value as f32),
        Scalar::Double => value,
    });
    let of = |function: Trig| table.rows.iter().filter(move |row| row.2 == function);
    for &(equation, harmonic, function) in of(Trig::Cos).chain(of(Trig::Sin)) {
        let power = harmonic_power(cosine, sine, harmonic, function);
        let mut sum = Sum::default();
        sum.add_scaled(&power, &exact(own.forces[equation]));
        found.check("accumulate_at", &sum, ROUNDINGS);
    }
    if pattern.reference.is_ok() {
        // The forces of the reference have the harmonics that the matrix says (Feng, Eqn 3.16); a table that leaves out the
        // rest of a series, or replaces terms by Taylor polynomials, says so only about.
        let finite = table.table.tails.is_empty() && estimator.replaced.is_empty();
        let harmonics: Vec<Sum> = (0..rows).map(|row| forces_harmonic(table, row, &case.parameters, &value)).collect();
        let largest = harmonics.iter().map(|sum| sum.magnitude.clone()).max().expect("rows");
        // Sample by sample, at once, and three periods under a Hann window, where the phase has fewer digits left.
        for roundings in [SUMMED_ROUNDINGS, SUMMED_ROUNDINGS, 4.0 * SUMMED_ROUNDINGS] {
            for harmonic in &harmonics {
                if finite {
                    let sum = Sum { value: harmonic.value.clone(), magnitude: largest.clone() };
                    found.check("harmonics of samples", &sum, roundings);
                } else {
                    assert!(found.next().is_finite());
                }
            }
        }
    }
    let direct = if found.direct { (0..columns).map(|_| found.next()).collect() } else { Vec::new() };
    for weighted in [false, true] {
        let direct = if weighted { &[][..] } else { &direct };
        let weight = |row: usize| if weighted { 1.0 / own.deviations[row] } else { 1.0 };
        check_solution(&matrix, &weight, (case, own), direct, scalar, found);
    }
}

/// Parameters and covariance of a solution, and the parameters by the exact pseudo-inverse where there are any, with the
/// condition number that comes with them in the bound.
fn check_solution(
    matrix: &[Vec<Rational>],
    weight: &dyn Fn(usize) -> f64,
    (case, own): (&Case, &PatternCase),
    direct: &[f64],
    scalar: Scalar,
    found: &mut Found<'_>,
) {
    let columns = case.parameters.len();
    let weighted: Vec<Vec<f64>> = matrix
        .iter()
        .enumerate()
        .map(|(row, entries)| entries.iter().map(|entry| rational::to_f64(entry) * weight(row)).collect())
        .collect();
    let scales: Vec<f64> =
        (0..columns).map(|c| weighted.iter().map(|row| row[c] * row[c]).sum::<f64>().sqrt()).collect();
    let (status, rank, undetermined) = (found.next(), found.next(), found.next());
    let condition = found.next();
    let parameters: Vec<f64> = (0..columns).map(|_| found.next()).collect();
    let covariance: Vec<f64> = (0..columns * columns).map(|_| found.next()).collect();
    if status != 0.0 {
        // T_UNDETERMINED: a parameter is named, and the rank falls short.
        assert!(status == 2.0 && rank < columns as f64 && undetermined >= 0.0, "{}: status {status}", found.what);
        return;
    }
    assert!(rank == columns as f64 && undetermined == -1.0 && condition >= 0.99);
    let right = own.effort.iter().enumerate().map(|(row, effort)| (effort * weight(row)).powi(2)).sum::<f64>().sqrt();
    for ((parameter, truth), scale) in parameters.iter().zip(&case.parameters).zip(&scales) {
        let bound = SUMMED_ROUNDINGS * condition * epsilon(scalar) * right / scale;
        assert!((parameter - truth).abs() <= bound, "{}: {parameter} is not {truth}, bound {bound}", found.what);
    }
    for ((parameter, truth), scale) in direct.iter().zip(&case.parameters).zip(&scales) {
        let bound = SUMMED_ROUNDINGS * condition * epsilon(scalar) * right / scale;
        assert!((parameter - truth).abs() <= bound, "{}: directly {parameter}, not {truth}, {bound}", found.what);
    }
    // Covariance times information is the identity, in columns of length 1.
    let bound = SUMMED_ROUNDINGS * condition.powi(3) * epsilon(scalar);
    if bound > 0.1 {
        return;
    }
    for i in 0..columns {
        for j in 0..columns {
            let sum: f64 = (0..columns)
                .map(|k| {
                    let information: f64 = weighted.iter().map(|row| row[k] * row[j]).sum();
                    covariance[i * columns + k] * scales[i] / scales[j] * information
                })
                .sum();
            let identity = if i == j { 1.0 } else { 0.0 };
            assert!((sum - identity).abs() <= bound, "{}: covariance ({i}, {j}): {sum}, bound {bound}", found.what);
        }
    }
}

fn check_model(path: &Path, compiler: &str) -> String {
    let estimator = estimator(path);
    let name = path.file_stem().expect("a file").to_string_lossy().into_owned();
    let mut report = name.clone();
    for scalar in [Scalar::Double, Scalar::Float] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let files = generated(&estimator, scalar);
        assert_eq!(files, generated(&crate::support::estimator(path), scalar), "{name}: equal models give equal bytes");
        for file in &files {
            let doubles = ["const double ", "\n    double ", "(double)a"].iter().any(|form| file.text.contains(form));
            assert!(scalar == Scalar::Double || !doubles, "{}: a double among floats", file.name);
            std::fs::write(folder.path().join(&file.name), &file.text).expect("writable");
        }
        std::fs::write(folder.path().join("main.c"), driver(&estimator, scalar)).expect("writable");
        compile(compiler, folder.path(), &[&FLAGS[..], &["-O1", "-c", "t.c"]].concat());
        if runs("clang") && compiler != "clang" {
            compile("clang", folder.path(), &[&FLAGS[..], &["-fsyntax-only", "t.c"]].concat());
        }
        compile(compiler, folder.path(), &["-std=c99", "-O1", "main.c", "t.o", "-o", "run", "-lm"]);
        let largest = estimator.plan.patterns.iter().filter_map(|pattern| pattern.table.as_ref().ok());
        let largest = largest.map(|table| table.places.len()).max().unwrap_or(0);
        let cases = cases(&estimator, scalar, if largest > 200 { 2 } else { 8 });
        let numbers = cases.iter().flat_map(Case::numbers).map(|number| format!("{number:e}\n"));
        let input = format!("{}\n{}", cases.len(), numbers.collect::<String>());
        std::fs::write(folder.path().join("input"), input).expect("writable");
        let output = Command::new(folder.path().join("run"))
            .stdin(std::fs::File::open(folder.path().join("input")).expect("readable"))
            .output()
            .expect("it runs");
        assert!(output.status.success(), "{name}: {:?}", output.status);
        let text = String::from_utf8(output.stdout).expect("numbers");
        let values: Vec<f64> = text.lines().map(|line| line.parse().expect("a number")).collect();
        let what = format!("{name}, {}", scalar.name());
        let direct = has_direct(&estimator);
        let mut found = Found { values: values.iter(), direct, what, epsilon: epsilon(scalar), worst: 0.0 };
        for case in &cases {
            check_dynamics(&estimator, case, &mut found);
            for index in 0..case.patterns.len() {
                check_pattern(&estimator, index, case, scalar, &mut found);
            }
        }
        assert_eq!(found.values.len(), 0, "{name}: the driver printed too much");
        report.push_str(&format!("; {}: {} values, at most {:.1} roundings", scalar.name(), values.len(), found.worst));
    }
    report
}

/// Every function of every shipped model, and of the emitter's corners, in both precisions.
#[test]
fn every_function_computes_what_the_model_says() {
    let Some(compiler) = compiler() else { return };
    for path in model_files() {
        say(&check_model(&path, compiler));
    }
}

/// After ten million samples the phasor is as good as after one: the harmonics of a signal that is zero but for one sample say
/// what cosine and sine that sample met. Errors at most 1e-12 in double precision, 4 units in the last place of 1 in single.
#[test]
fn ten_million_samples_without_drift() {
    let Some(compiler) = compiler() else { return };
    let estimator = estimator(&crate::support::root().join("models/emps.tpm"));
    for (scalar, bound) in [(Scalar::Double, 1e-12), (Scalar::Float, 4.0 * f64::from(f32::EPSILON))] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for file in generated(&estimator, scalar) {
            std::fs::write(folder.path().join(&file.name), &file.text).expect("writable");
        }
        let main = "#include <math.h>
#include <stdio.h>
#include \"t.h\"
#define COUNT 10000000
static t_forces samples[COUNT];
int main(void)
{
    static const size_t places[] = {1, 2500000, 3333333, 4999999, 6666667, 9999999};
    size_t i;
    for (i = 0; i < sizeof places / sizeof places[0]; ++i) {
        const double phase = 6.283185307179586476925 * (double)places[i] / COUNT;
        t_harmonics harmonics;
        samples[places[i]].force = COUNT / 2;
        if (t_transform(samples, COUNT, &harmonics) != T_OK) {
            return 1;
        }
        samples[places[i]].force = 0;
        printf(\"%.17g\\n%.17g\\n\", (double)harmonics.force.cos1 - cos(phase), (double)harmonics.force.sin1 - sin(phase));
    }
    return 0;
}
";
        std::fs::write(folder.path().join("main.c"), main).expect("writable");
        compile(compiler, folder.path(), &["-std=c99", "-O2", "main.c", "t.c", "-o", "run", "-lm"]);
        let output = Command::new(folder.path().join("run")).output().expect("it runs");
        let text = String::from_utf8(output.stdout).expect("numbers");
        let errors: Vec<f64> = text.lines().map(|line| line.parse().expect("a number")).collect();
        assert!(output.status.success() && errors.len() == 12, "{text}");
        let worst = errors.iter().fold(0.0_f64, |worst, error| worst.max(error.abs()));
        say(&format!("{}: at most {worst:.2e} after 1e7 samples", scalar.name()));
        assert!(worst <= bound, "{worst:e}");
    }
}

/// A stroke rests before and after its motion. Constants of the model are handed on, and two patterns have a function each.
#[test]
fn strokes_rest_at_both_ends() {
    let Some(compiler) = compiler() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = crate::support::root().join("models/closed_loop_arm.tpm");
    for file in [model, crate::support::root().join("models/mass_spring_drag.tpm")] {
        let options =
            Options { strokes: true, prefix: Some("t"), ..Options::new(Language::C, "tpm generate --strokes") };
        for file in generate(&estimator(&file), &options).expect("nothing stands in the way") {
            std::fs::write(folder.path().join(&file.name), &file.text).expect("writable");
        }
        let flags = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-O2"];
        compile(compiler, folder.path(), &[&flags[..], &["-c", "t.c"]].concat());
    }
    // The header and the source of the second model, a pattern lambda (cos w t - 1/9 cos 3 w t), are in place now.
    let driver = r#"
#include <stdio.h>
#include "t.h"
int main(void) {
    const t_pattern pattern = {.lambda = 0.9, .w = 2.0};
    const double pi = 3.14159265358979323846;
    for (int i = -1; i <= 4; i++) {
        t_motion motion;
        t_stroke(&pattern, (double)i * pi / 8.0, pi, 2.0 * pi, &motion);
        printf("%.17g %.17g %.17g\n", motion.x.value, motion.x.dot, motion.x.ddot);
    }
    return 0;
}
"#;
    std::fs::write(folder.path().join("main.c"), driver).expect("writable");
    compile(compiler, folder.path(), &["-std=c99", "-Wall", "-Werror", "-O2", "-o", "run", "main.c", "t.c", "-lm"]);
    let output = Command::new(folder.path().join("run")).output().expect("the program runs");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let rows: Vec<Vec<f64>> =
        text.lines().map(|line| line.split(' ').map(|value| value.parse().expect("a number")).collect()).collect();
    // The back stroke from -8/9 lambda to 8/9 lambda takes pi/2 s.
    for (row, position) in [(0, -0.8), (1, -0.8), (5, 0.8)] {
        assert!((rows[row][0] - position).abs() < 1e-15 && rows[row][1..] == [0.0, 0.0], "{rows:?}");
    }
    assert!(rows[3][0].abs() < 1e-15, "{rows:?}");
    // x' = -4/3 lambda w sin^3 th, at 3/2 pi.
    assert!((rows[3][1] - 4.0 / 3.0 * 0.9 * 2.0).abs() < 1e-12, "{rows:?}");
}
