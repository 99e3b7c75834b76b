//! `tanh`, `exp` and `log` in generated code, in both languages and precisions, beside the formula written down by hand; and friction
//! with `tanh` identified on a simulated machine.

mod compiled {
    tpm_runtime::model_file!("fixtures/emit/functions.tpm");
}

use crate::generated::functions::bearing as generated;
use crate::support::{root, skipped};
use std::fmt::Write as _;
use std::process::Command;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::generate::{File, Language, Options, Scalar, generate};
use tpm_codegen::{Source, parse_model};
use tpm_runtime::experiment::Experiment;
use tpm_runtime::interpret::Interpreted;
use tpm_runtime::model::Model;
use tpm_runtime::session::{self, DeclaredModel};

const COMMAND: &str = "tpm generate functions.tpm --lang rust";
const PARAMETERS: [f64; 4] = [0.02, 0.3, 0.2, 1.5];

fn text() -> String {
    std::fs::read_to_string(root().join("tests/fixtures/emit/functions.tpm")).expect("a file")
}

fn files(language: Language, scalar: Scalar) -> Vec<File> {
    let source = Source::from_bytes("functions.tpm", text().into_bytes());
    let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    let estimator = EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message));
    let prefix = (language == Language::C).then_some("t");
    generate(&estimator, &Options { prefix, scalar, ..Options::new(language, COMMAND) })
        .expect("nothing stands in the way")
}

/// Position, velocity, acceleration, and the constant `vs`: at rest, slow, fast, far.
fn cases() -> Vec<[f64; 4]> {
    let velocities = [0.0, 1e-9, -1e-4, 0.03, -0.11, 0.4, -3.0, 40.0];
    let case = |(n, v): (usize, &f64)| [0.25 * n as f64 - 0.8, *v, 2.0 - 0.7 * n as f64, 0.05 + 0.03 * n as f64];
    velocities.iter().enumerate().map(case).collect()
}

/// The columns of the regressor, by hand: the hyperbolic tangent as (e - 1/e)/(e + 1/e) where this does not cancel, as its series
/// elsewhere.
fn columns([q, v, a, vs]: [f64; 4]) -> [f64; 4] {
    let ratio = v / vs;
    let (grown, shrunk) = ((ratio.abs().min(300.0)).exp(), (-ratio.abs()).exp());
    let tangent = match ratio.abs() {
        small if small < 0.02 => {
            small - small.powi(3) / 3.0 + 2.0 * small.powi(5) / 15.0 - 17.0 * small.powi(7) / 315.0
        }
        _ => (grown - shrunk) / (grown + shrunk),
    };
    let tangent = tangent.copysign(ratio);
    [a, tangent, std::f64::consts::E.powf(-ratio * ratio) * tangent, (1.0 + q * q).log2() * std::f64::consts::LN_2]
}

fn torque(case: [f64; 4]) -> f64 {
    columns(case).iter().zip(PARAMETERS).map(|(column, parameter)| column * parameter).sum()
}

/// The largest share of the sum of its terms by which a torque may be off in double precision, and in single precision.
fn close(found: f64, case: [f64; 4], epsilon: f64) -> bool {
    let size: f64 = columns(case).iter().zip(PARAMETERS).map(|(column, parameter)| (column * parameter).abs()).sum();
    (found - torque(case)).abs() <= 16.0 * epsilon * size
}

#[test]
fn rust_computes_the_functions_in_both_precisions() {
    macro_rules! torque {
        ($module:path, $scalar:ident, $case:expr) => {{
            use $module as code;
            let narrow = |value: f64| value as $scalar;
            let [q, v, a, vs] = $case.map(narrow);
            let motion = code::Motion::from_array(&[q, v, a]);
            let constants = code::Constants::from_array([vs]);
            let parameters = code::Parameters::from_array(PARAMETERS.map(narrow));
            f64::from(code::feed_forward(&motion, &parameters, &constants).tau)
        }};
    }
    let single = f64::from(f32::EPSILON);
    for case in cases() {
        assert!(close(torque!(compiled::bearing, f64, case), case, f64::EPSILON), "{case:?}");
        assert!(close(torque!(generated, f64, case), case, f64::EPSILON), "{case:?}");
        // The values that are given to single precision are rounded once.
        let rounded = case.map(|value| f64::from(value as f32));
        assert!(close(torque!(compiled::bearing, f32, case), rounded, 4.0 * single), "{case:?}");
        assert!(close(torque!(generated, f32, case), rounded, 4.0 * single), "{case:?}");
        assert_eq!(torque!(generated, f64, case), torque!(compiled::bearing, f64, case));
    }
}

#[test]
fn the_interpreter_computes_what_compiled_code_computes() {
    let declared = DeclaredModel::parse("functions.tpm", &text()).expect("right");
    let prepared = declared.prepared();
    let interpreted = Interpreted::new(&prepared.model, &prepared.form);
    for case in cases() {
        let [own, code] = [&interpreted as &dyn Model<f64>, &compiled::Bearing].map(|model| {
            let (mut scratch, mut force) = (vec![0.0; model.inverse_workspace_len()], [0.0]);
            model.inverse_dynamics(&case[..3], &PARAMETERS, &case[3..], &mut scratch, &mut force).expect("one of each");
            force[0]
        });
        assert_eq!(own.to_bits(), code.to_bits(), "{case:?}");
    }
}

#[test]
fn c_computes_the_functions_in_both_precisions() {
    let runs = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success());
    let Some(compiler) = ["cc", "gcc", "clang"].into_iter().find(runs) else {
        return skipped("there is no C compiler");
    };
    for (scalar, real, epsilon) in
        [(Scalar::Double, "double", f64::EPSILON), (Scalar::Float, "float", 4.0 * f64::from(f32::EPSILON))]
    {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for file in files(Language::C, scalar) {
            std::fs::write(folder.path().join(&file.name), &file.text).expect("writable");
        }
        let mut rows = String::new();
        for [q, v, a, vs] in cases() {
            let _ = writeln!(rows, "        {{{q:e}, {v:e}, {a:e}, {vs:e}}},");
        }
        let [j, fc, fs, k] = PARAMETERS;
        let main = format!(
            "#include <stdio.h>\n#include \"t.h\"\nint main(void)\n{{\n    static const double cases[][4] = {{\n{rows}    }};\n    \
             const t_parameters parameters = {{({real}){j}, ({real}){fc}, ({real}){fs}, ({real}){k}}};\n    size_t n;\n    \
             for (n = 0; n < sizeof cases / sizeof *cases; ++n) {{\n        t_motion motion;\n        t_constants constants;\n        \
             t_inputs inputs;\n        motion.q.value = ({real})cases[n][0];\n        motion.q.dot = ({real})cases[n][1];\n        \
             motion.q.ddot = ({real})cases[n][2];\n        constants.vs = ({real})cases[n][3];\n        \
             t_feed_forward(&motion, &parameters, &constants, &inputs);\n        printf(\"%.17g\\n\", (double)inputs.tau);\n    \
             }}\n    return 0;\n}}\n"
        );
        std::fs::write(folder.path().join("main.c"), main).expect("writable");
        let built = Command::new(compiler)
            .args([
                "-std=c99",
                "-Wall",
                "-Wextra",
                "-Werror",
                "-Wconversion",
                "-pedantic",
                "main.c",
                "t.c",
                "-lm",
                "-o",
                "run",
            ])
            .current_dir(folder.path())
            .output()
            .expect("the compiler runs");
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        let output = Command::new(folder.path().join("run")).output().expect("the program runs");
        let printed = String::from_utf8(output.stdout).expect("text");
        let found: Vec<f64> = printed.lines().map(|line| line.parse().expect("a number")).collect();
        assert_eq!(found.len(), cases().len());
        for (found, case) in found.into_iter().zip(cases()) {
            let given = if real == "float" { case.map(|value| f64::from(value as f32)) } else { case };
            assert!(close(found, given, epsilon), "{real} {case:?}: {found} {}", torque(given));
        }
    }
}

/// Friction that a bearing's preload makes, smooth around rest: the parameters come out of a campaign with their deviations.
#[test]
fn friction_with_tanh_is_identified_on_a_simulated_machine() {
    let model = "model Wheel { coordinate q [rad]; input tau [N*m];
        parameter J [kg*m^2], d [N*m*s/rad], Fc [N*m]; constant vs = 0.1 [rad/s];
        J*ddot(q) + d*dot(q) + Fc*tanh(dot(q)/vs) = tau;
        pattern { amplitude A [rad]; frequency w [rad/s]; q = rest_to_rest(A, w, 3); } }";
    let experiment = "seed = 3\n[plant]\nparameters = { J = 0.02, d = 0.05, Fc = 0.3 }\nsub_steps = 4
        [plant.sensors.q]\nnoise = 1e-4\n[control]\nsample_time = 1e-3\nderivative_filter = 2e-3
        feedback = [{ input = 'tau', coordinate = 'q', kp = 20.0, kd = 1.0 }]
        [schedule]\nmeasure_time = 8.0\nstages = [{ A = 0.5, w = 3.0 }, { A = 1.0, w = 6.0 }]";
    let model = DeclaredModel::parse("wheel.tpm", model).expect("right");
    let experiment = Experiment::parse(experiment).expect("right");
    let result = session::on_simulated_plant(&model, experiment).expect("runs");
    assert!(result.is_complete(), "{:?} {:?}", result.outcome, result.warnings);
    for (parameter, truth) in result.parameters.iter().zip([0.02, 0.05, 0.3]) {
        let (value, std) = (parameter.value.expect("identified"), parameter.std.expect("identified"));
        assert!((value - truth).abs() < 4.0 * std && std < 0.01 * truth, "{parameter:?}");
    }
}
