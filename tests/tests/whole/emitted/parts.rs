//! Parts that are generated on request, in C, compiled and run: mass matrix, gravity, forward dynamics, base parameters and their
//! estimator. What they must be is taken from the inverse dynamics and the regressor, which other tests hold against exact values, and
//! of robots from Pinocchio.

use crate::robots::{ROBOTS, at_rest, fixture, imported, parsed, values};
use crate::support::skipped;
use std::path::Path;
use std::process::Command;
use tpm_codegen::emit::estimator::{EstimatorSource, Part};
use tpm_codegen::generate::{Language, Options, Scalar, generate};
use tpm_symbolic::expr::graph::Node;
use tpm_symbolic::number::rational::to_f64;

const PARTS: [Part; 4] = [Part::Gravity, Part::MassMatrix, Part::ForwardDynamics, Part::Estimator];

/// Random samples that the estimator takes in.
const SAMPLES: usize = 300;

const FLAGS: [&str; 6] = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror"];

/// One case: motion, parameters, constants, inputs.
struct Case([Vec<f64>; 4]);

/// What the driver prints of a case.
struct Found {
    gravity: Vec<f64>,
    /// The inverse dynamics of the position at rest.
    still: Vec<f64>,
    mass: Vec<f64>,
    /// Forward dynamics: how it ended, the accelerations, and the forces that they take.
    status: f64,
    accelerations: Vec<f64>,
    forces: Vec<f64>,
    /// B u.
    applied: Vec<f64>,
    /// The inverse dynamics of the whole motion with the parameters, and with those of their base parameters alone.
    torques: [Vec<f64>; 2],
    /// The base regressor times the base parameters, and the known terms.
    product: Vec<f64>,
    base: Vec<f64>,
    /// The estimator before and after its samples: how the solution ended, its rank, the base parameters.
    early: [f64; 2],
    late: [f64; 2],
    estimated: Vec<f64>,
    deviations: Vec<f64>,
}

fn driver(estimator: &EstimatorSource, scalar: Scalar) -> String {
    let real = scalar.name();
    let with_constants = !estimator.plan.evaluation.constants.is_empty();
    let (constants, only, declared, read) = match with_constants {
        true => (", &constants", "&constants, ", "t_constants constants;", "FILL(constants);"),
        false => ("", "", "", ""),
    };
    // Positions of the derivatives in the motion, which is a list of scalars.
    let (mut rates, mut highest, mut length) = (Vec::new(), Vec::new(), 0);
    for &(_, order) in &estimator.plan.evaluation.coordinates {
        let order = order as usize;
        rates.extend((length + 1..=length + order).map(|place| place.to_string()));
        highest.push((length + order).to_string());
        length += order + 1;
    }
    // Without its parameters a machine has no mass, but for bodies of known inertia.
    let singular = if estimator.plan.evaluation.known.inputs.is_empty() { "T_SINGULAR" } else { "T_OK" };
    format!(
        "#include <stdio.h>
#include <string.h>
#include \"t.h\"
static void fill({real} *values, size_t count)
{{
    double x;
    while (count-- > 0) {{
        if (scanf(\"%lf\", &x) != 1) x = 0.0 / 0.0;
        *values++ = ({real})x;
    }}
}}
static void show(const {real} *values, size_t count)
{{
    while (count-- > 0) printf(\"%.17g\\n\", (double)*values++);
}}
#define FILL(x) fill(({real} *)&(x), sizeof(x) / sizeof({real}))
#define SHOW(x) show((const {real} *)&(x), sizeof(x) / sizeof({real}))
static const int rates[] = {{{rates}}};
static const int highest[] = {{{highest}}};
static unsigned long state = 1;
static {real} uniform(void)
{{
    state = (state * 1103515245UL + 12345UL) & 0x7fffffffUL;
    return ({real})((double)state / 1073741824.0 - 1.0);
}}
int main(void)
{{
    static t_motion motion, other;
    static t_parameters parameters, representative;
    static t_inputs inputs;
    static t_forces forces;
    static t_accelerations accelerations;
    static t_base_parameters base;
    static t_base_estimator estimator;
    static t_base_workspace workspace;
    static t_base_estimate estimate;
    static {real} mass[T_EQUATIONS][T_COORDINATES], phi[T_EQUATIONS][T_BASE_PARAMETERS], map[T_EQUATIONS][T_INPUTS];
    static {real} sums[T_EQUATIONS];
    {declared}
    int cases, i, j;
    if (scanf(\"%d\", &cases) != 1) return 9;
    while (cases-- > 0) {{
        {real} status;
        FILL(motion); FILL(parameters); {read} FILL(inputs);
        t_gravity(&motion, &parameters{constants}, &forces); SHOW(forces);
        other = motion;
        for (i = 0; i < (int)(sizeof rates / sizeof *rates); ++i) (({real} *)&other)[rates[i]] = 0;
        t_inverse_dynamics(&other, &parameters{constants}, &forces); SHOW(forces);
        t_mass_matrix(&motion, &parameters{constants}, mass); SHOW(mass);
        memset(&accelerations, 0, sizeof accelerations);
        status = ({real})t_forward_dynamics(&motion, &inputs, &parameters{constants}, &accelerations);
        SHOW(status); SHOW(accelerations);
        other = motion;
        for (i = 0; i < T_COORDINATES; ++i) (({real} *)&other)[highest[i]] = (({real} *)&accelerations)[i];
        t_inverse_dynamics(&other, &parameters{constants}, &forces); SHOW(forces);
        t_input_map({only}map);
        for (i = 0; i < T_EQUATIONS; ++i) {{
            sums[i] = 0;
            for (j = 0; j < T_INPUTS; ++j) sums[i] += map[i][j] * (({real} *)&inputs)[j];
        }}
        SHOW(sums);
        t_base(&parameters, &base);
        t_representative(&base, &representative);
        t_inverse_dynamics(&motion, &parameters{constants}, &forces); SHOW(forces);
        t_inverse_dynamics(&motion, &representative{constants}, &forces); SHOW(forces);
        t_base_regressor(&motion{constants}, phi);
        t_known(&motion{constants}, &forces);
        for (i = 0; i < T_EQUATIONS; ++i) {{
            sums[i] = (({real} *)&forces)[i];
            for (j = 0; j < T_BASE_PARAMETERS; ++j) sums[i] += phi[i][j] * (({real} *)&base)[j];
        }}
        SHOW(sums); SHOW(base);
        t_base_estimator_clear(&estimator);
        for (i = 0; i < {SAMPLES}; ++i) {{
            for (j = 0; j < {length}; ++j) (({real} *)&other)[j] = 3 * uniform();
            t_inverse_dynamics(&other, &parameters{constants}, &forces);
            if (i == 1) {{
                status = ({real})t_base_solve(&estimator, &workspace, &estimate); SHOW(status);
                status = ({real})estimate.rank; SHOW(status);
            }}
            if (t_base_accumulate(&estimator, &other{constants}, &forces, i % 2 == 0 ? NULL : &forces) == T_OK) continue;
            /* A force of zero is no deviation. */
            if (t_base_accumulate(&estimator, &other{constants}, &forces, NULL) != T_OK) return 8;
        }}
        (({real} *)&forces)[0] = ({real})(0.0 / 0.0);
        if (t_base_accumulate(&estimator, &other{constants}, &forces, NULL) != T_NOT_FINITE) return 5;
        status = ({real})t_base_solve(&estimator, &workspace, &estimate); SHOW(status);
        status = ({real})estimate.rank; SHOW(status);
        SHOW(estimate.parameters); SHOW(estimate.deviations);
        memset(&representative, 0, sizeof representative);
        status = ({real})t_forward_dynamics(&motion, &inputs, &representative{constants}, &accelerations);
        if ((int)status != (int){singular}) return 7;
        (({real} *)&inputs)[0] = ({real})(0.0 / 0.0);
        status = ({real})t_forward_dynamics(&motion, &inputs, &parameters{constants}, &accelerations);
        if ((int)status != (int)T_NOT_FINITE) return 6;
    }}
    return 0;
}}
",
        rates = rates.join(", "),
        highest = highest.join(", "),
    )
}

/// Compiles the code of a model and runs it; nothing without a compiler.
fn run(estimator: &EstimatorSource, scalar: Scalar, cases: &[Case]) -> Option<Vec<Found>> {
    let compiler = ["cc", "gcc", "clang"]
        .into_iter()
        .find(|name| Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success()));
    let Some(compiler) = compiler else {
        skipped("no C compiler (cc, gcc, clang) was found, so that generated C was not run");
        return None;
    };
    let options = Options { scalar, prefix: Some("t"), ..Options::new(Language::C, "tpm generate --lang c") };
    let files = generate(estimator, &options).expect("nothing stands in the way");
    let folder = tempfile::tempdir().expect("a folder");
    for file in &files {
        std::fs::write(folder.path().join(&file.name), &file.text).expect("written");
    }
    std::fs::write(folder.path().join("main.c"), driver(estimator, scalar)).expect("written");
    compile(folder.path(), compiler, &[&FLAGS[..], &["-c", "t.c"]].concat());
    compile(folder.path(), compiler, &["-std=c99", "main.c", "t.o", "-o", "run", "-lm"]);
    if Command::new("c++").arg("--version").output().is_ok_and(|output| output.status.success()) {
        compile(folder.path(), "c++", &["-x", "c++", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "t.c"]);
    }
    let mut text = format!("{}\n", cases.len());
    for Case(lists) in cases {
        lists.iter().flatten().for_each(|value| text.push_str(&format!("{value:?}\n")));
    }
    let input = folder.path().join("input");
    std::fs::write(&input, text).expect("written");
    let input = std::fs::File::open(input).expect("there");
    let output = Command::new(folder.path().join("run")).stdin(input).output().expect("it runs");
    assert!(output.status.success(), "{}: {:?}", estimator.model.name, output.status);
    let text = String::from_utf8(output.stdout).expect("numbers");
    let mut printed = text.lines().map(|line| line.parse::<f64>().expect("a number"));
    let mut take = |count: usize| -> Vec<f64> { printed.by_ref().take(count).collect() };
    let rows = estimator.form.rows.len();
    let columns = estimator.plan.evaluation.coordinates.len();
    let base = base_count(&files[0].text);
    let found = cases
        .iter()
        .map(|_| Found {
            gravity: take(rows),
            still: take(rows),
            mass: take(rows * columns),
            status: take(1)[0],
            accelerations: take(columns),
            forces: take(rows),
            applied: take(rows),
            torques: [take(rows), take(rows)],
            product: take(rows),
            base: take(base),
            early: take(2).try_into().expect("two numbers"),
            late: take(2).try_into().expect("two numbers"),
            estimated: take(base),
            deviations: take(base),
        })
        .collect();
    assert_eq!(printed.count(), 0);
    Some(found)
}

fn base_count(header: &str) -> usize {
    let line = header.lines().find_map(|line| line.strip_prefix("#define T_BASE_PARAMETERS "));
    line.and_then(|count| count.parse().ok()).expect("the number of base parameters")
}

fn compile(folder: &Path, compiler: &str, arguments: &[&str]) {
    let output = Command::new(compiler).current_dir(folder).args(arguments).output().expect("the compiler runs");
    assert!(output.status.success(), "{compiler} {arguments:?}\n{}", String::from_utf8_lossy(&output.stderr));
}

/// The largest difference, relative to the largest of the wanted numbers.
fn difference(found: &[f64], wanted: &[f64]) -> f64 {
    assert_eq!(found.len(), wanted.len());
    let scale = wanted.iter().fold(f64::MIN_POSITIVE, |most, value| most.max(value.abs()));
    found.iter().zip(wanted).fold(0.0, |worst, (found, wanted)| {
        let off = (found - wanted).abs() / scale;
        if off.is_nan() { f64::INFINITY } else { worst.max(off) }
    })
}

/// What holds of the code of any model, to so much of the largest number.
fn check(estimator: &EstimatorSource, found: &Found, [bound, estimated]: [f64; 2]) {
    let name = &estimator.model.name;
    let check = |what: &str, found: &[f64], wanted: &[f64], bound: f64| {
        let off = difference(found, wanted);
        assert!(off <= bound, "{name}, {what}: off by {off:e}: {found:?} {wanted:?}");
    };
    check("gravity", &found.gravity, &found.still, bound);
    assert_eq!(found.status, 0.0, "{name}: forward dynamics");
    // Forces are differences of larger ones: of what gravity and speed take.
    let size = found.torques[0].iter().chain(&found.applied).fold(0.0_f64, |most, value| most.max(value.abs()));
    for (forces, applied) in found.forces.iter().zip(&found.applied) {
        assert!((forces - applied).abs() <= bound * size, "{name}, inverse(forward): {forces} {applied}");
    }
    check("forces by base parameters", &found.torques[1], &found.torques[0], bound);
    check("regressor times base parameters", &found.product, &found.torques[0], bound);
    let whole = found.base.len() as f64;
    assert!(found.early[0] == 2.0 && found.early[1] < whole, "{name}, one sample: {:?}", found.early);
    assert_eq!(found.late, [0.0, whole], "{name}, estimator");
    check("estimator", &found.estimated, &found.base, estimated);
    assert!(found.deviations.iter().all(|deviation| *deviation > 0.0), "{name}: {:?}", found.deviations);
}

fn of_file(path: &str) -> EstimatorSource {
    super::estimator(path).with(&PARTS).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Numbers between -1 and 1, the same at every run.
fn numbers(count: usize, seed: usize) -> Vec<f64> {
    (0..count).map(|i| ((1 + i + 31 * seed) as f64 * 0.7377).sin()).collect()
}

#[test]
fn parts_of_models_are_consistent() {
    let files = [
        "cart_pendulum.tpm",
        "closed_loop_arm.tpm",
        "../models/robots/planar_arm.tpm",
        "fixtures/arms/coupled.tpm",
        "fixtures/arms/three_joints.tpm",
    ];
    for file in files {
        let estimator = of_file(file);
        let plan = &estimator.plan.evaluation;
        let motion: usize = plan.coordinates.iter().map(|(_, order)| *order as usize + 1).sum();
        let cases: Vec<Case> = (0..3)
            .map(|seed| {
                // Positive parameters, the first ones large: a mass matrix that is not singular.
                let columns = estimator.form.columns.len();
                let parameters = numbers(columns, seed).into_iter().enumerate();
                let parameters = parameters.map(|(i, value)| value.abs() + if i == 0 { 9.0 } else { 0.5 });
                let constants = numbers(plan.constants.len(), seed).iter().map(|value| value.abs() + 0.5).collect();
                Case([numbers(motion, seed), parameters.collect(), constants, numbers(plan.inputs.len(), seed + 5)])
            })
            .collect();
        let Some(found) = run(&estimator, Scalar::Double, &cases) else { return };
        found.iter().for_each(|found| check(&estimator, found, [1e-9, 1e-7]));
    }
}

#[test]
fn parts_of_robots_are_pinocchios() {
    let mut worst = [0.0_f64; 4];
    for (name, file, locked) in ROBOTS {
        let Some(imported) = imported(name, file, locked) else {
            skipped("TPM_DATA has no robots");
            return;
        };
        let parsed = parsed(&imported);
        let estimator = EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message));
        let estimator = estimator.with(&PARTS).unwrap_or_else(|error| panic!("{name}: {error}"));
        let prior = values(&imported.prior);
        let model = &estimator.model;
        let value = |node: &Node| match node {
            Node::Symbol(symbol) => prior.get(model.quantity(*symbol).name.as_str()).copied().unwrap_or_default(),
            other => panic!("{other:?} is no parameter"),
        };
        let parameters: Vec<f64> = estimator
            .form
            .columns
            .iter()
            .map(|column| {
                let terms = column.definition.terms().map(|(monomial, factor)| {
                    let product = monomial.factors().map(|(&atom, power)| value(model.graph.node(atom)).powi(power));
                    to_f64(factor) * product.product::<f64>()
                });
                terms.sum()
            })
            .collect();
        let states = fixture(name, &parsed);
        let cases: Vec<Case> = states
            .iter()
            .map(|state| {
                let orders = &estimator.plan.evaluation.coordinates;
                let derivatives = [&state.q, &state.v, &state.a];
                let motion = orders.iter().enumerate().flat_map(|(joint, (_, order))| {
                    derivatives[..=*order as usize].iter().map(move |derivative| derivative[joint])
                });
                Case([motion.collect(), parameters.clone(), Vec::new(), state.torque.clone()])
            })
            .collect();
        let Some(found) = run(&estimator, Scalar::Double, &cases) else { return };
        for (found, state) in found.iter().zip(&states) {
            check(&estimator, found, [1e-9, 1e-6]);
            let compared = [
                (&found.torques[0], &state.torque),
                (&found.mass, &state.mass),
                (&found.gravity, &at_rest(&imported, &state.q)),
                (&found.accelerations, &state.a),
            ];
            for ((found, wanted), worst) in compared.into_iter().zip(&mut worst) {
                let off = difference(found, wanted);
                assert!(off <= 1e-9, "{name}: off by {off:e}: {found:?} {wanted:?}");
                *worst = worst.max(off);
            }
        }
    }
    println!("torques, mass matrix, gravity, forward dynamics: largest relative differences {worst:?}");
}

#[test]
fn code_in_single_precision_compiles() {
    let estimator = of_file("fixtures/arms/three_joints.tpm");
    run(&estimator, Scalar::Float, &[]);
}

#[test]
fn the_code_of_a_panda_is_short() {
    let Some(imported) = imported("panda", "panda", ROBOTS[5].2) else {
        skipped("TPM_DATA has no robots");
        return;
    };
    let estimator = EstimatorSource::of(&parsed(&imported)).unwrap_or_else(|fault| panic!("{}", fault.message));
    let size = |estimator: &EstimatorSource| -> usize {
        let files = generate(estimator, &Options::new(Language::C, "tpm generate")).expect("nothing stands in the way");
        files.iter().map(|file| file.text.len()).sum()
    };
    let plain = size(&estimator);
    let whole = size(&estimator.with(&PARTS).expect("an arm"));
    println!("{plain} bytes, {whole} with all parts");
    assert!(plain < 200_000 && whole < 350_000, "{plain} {whole}");
}

#[test]
fn what_the_equations_do_not_give_is_refused() {
    let text = "model M { coordinate x; input u; parameter m, c; constant g; m*ddot(x)^2 + g*c*x + c = u; }";
    let source = tpm_codegen::Source::new("m.tpm", text);
    let parsed = tpm_codegen::parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let estimator = EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message));
    for part in [Part::MassMatrix, Part::ForwardDynamics] {
        let error = estimator.clone().with(&[part]).expect_err("quadratic in the acceleration");
        assert!(error.to_string().contains("affine in the highest derivatives"), "{error}");
    }
    estimator.with(&[Part::Gravity]).expect("there is a position at rest");
    let error = super::estimator("rotary_pendulum.tpm").with(&[Part::Estimator]).expect_err("constants at run time");
    assert!(error.to_string().contains("depend on constants without a value"), "{error}");
}
