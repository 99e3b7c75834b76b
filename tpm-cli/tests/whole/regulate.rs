//! `tpm regulate`: gains on an identified machine, the code that balances it, and what cannot be regulated.

use crate::support::{fails, printed, printed_in, root, skipped};
use serde_json::Value;
use std::f64::consts::TAU;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use tpm_runtime::control::Differentiator;
use tpm_runtime::motion::Plant;
use tpm_runtime::session::{DeclaredModel, Identifiable as _};
use tpm_symbolic::regressor::parameter_map::ParameterMap;

const UPRIGHT: &str = "models/rotary_pendulum.tpm";
/// Constants of the motor, which a result of an identification does not repeat.
pub(crate) const MOTOR: [&str; 6] = ["--value", "Kt=0.01826", "--value", "Ku=10", "--value", "Rm=2.5604"];
/// The regulator of the study: weights, sample time and filter.
pub(crate) const STUDY: [&str; 14] = [
    "--sample-time",
    "1e-3",
    "--derivative-filter",
    "0.02",
    "--weight",
    "th1=1",
    "--weight",
    "th2=10",
    "--weight",
    "dot(th1)=0.1",
    "--weight",
    "dot(th2)=0.1",
    "--weight",
    "e=1",
];

fn text(path: &Path) -> &str {
    path.to_str().expect("a readable path")
}

/// Identifies the pendulum hanging down and gives the file of the result.
fn identified(folder: &Path) -> PathBuf {
    let result = folder.join("result.json");
    printed(&["identify", "models/rotary_pendulum_down.tpm", "--json", "-o", text(&result)]);
    result
}

/// The code regulates the simulated pendulum with its true parameters, through encoders of 2000 counts and a drive that ends at 2.4 V,
/// from 15 degrees at rest; positions that it saw and inputs that it gave.
fn balanced(program: &Path) -> Vec<([f64; 2], f64)> {
    let path = root().join(UPRIGHT);
    let declared = DeclaredModel::open(&path).expect("the shipped model is right");
    let values: toml::Table = std::fs::read_to_string(root().join("models/rotary_pendulum_table1.toml"))
        .expect("readable")
        .parse()
        .expect("TOML");
    let value = |name: &str| match &values[name] {
        toml::Value::Integer(value) => *value as f64,
        other => other.as_float().expect("a number"),
    };
    let model = &declared.prepared().model;
    let map = ParameterMap::new(declared.prepared());
    let parameters = map.evaluate(|symbol| value(&model.quantity(symbol).name));
    let constants: Vec<f64> = model.run_time_constants().map(|symbol| value(&model.quantity(symbol).name)).collect();
    let plant = declared.evaluated();
    let mut plant = Plant::new(plant, &parameters, &constants).expect("the numbers fit");
    plant.reset(&[0.0, 15.0_f64.to_radians(), 0.0, 0.0, 0.0, 0.0]).expect("six entries");
    let mut child =
        Command::new(program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the program starts");
    let mut to = child.stdin.take().expect("piped");
    let mut from = BufReader::new(child.stdout.take().expect("piped"));
    let step = TAU / 2000.0;
    let mut seen = Vec::new();
    for _ in 0..6000 {
        let measured = [0, 1].map(|c| (plant.motion()[c] / step).round() * step);
        writeln!(to, "{} {}", measured[0], measured[1]).expect("the program reads");
        let mut line = String::new();
        from.read_line(&mut line).expect("the program answers");
        let input: f64 = line.trim().parse().expect("a number");
        seen.push((measured, input));
        plant.advance(&[input.clamp(-2.4, 2.4)], 1e-3, 1).expect("the motion is finite");
    }
    drop(to);
    assert!(child.wait().expect("the program ends").success());
    let late = seen[4800..].iter().map(|(measured, _)| measured[1].abs()).fold(0.0, f64::max);
    assert!(late < 2.0_f64.to_radians(), "over the last fifth the pendulum leaves the vertical by {late} rad");
    seen
}

#[test]
fn generated_code_balances_the_identified_pendulum() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    let result = identified(folder);
    let regulate = |more: &[&str]| {
        let own = ["regulate", UPRIGHT, "--params", text(&result), "--json"];
        printed(&[&own[..], &MOTOR, &STUDY, more].concat())
    };
    let found: Value = serde_json::from_str(&regulate(&["--lang", "c", "--code", text(folder)])).expect("JSON");
    regulate(&["--lang", "rust", "--code", text(folder)]);
    let gain: Vec<f64> =
        found["gain"][0].as_array().expect("a row").iter().map(|k| k.as_f64().expect("number")).collect();
    assert!(found["residual"].as_f64().expect("a number") < 1e-9);
    assert!(found["continuous_residual"].as_f64().expect("a number") < 1e-9);
    let inside = |pole: &Value| pole["re"].as_f64().unwrap_or(9.0).hypot(pole["im"].as_f64().unwrap_or(9.0)) < 1.0;
    assert!(found["poles"].as_array().expect("a list").iter().all(inside));
    let margins = &found["margins"][0];
    assert!(
        margins["gain"][0].as_f64().expect("a number") < 0.8 && margins["gain"][1].as_f64().expect("a number") > 1.5
    );
    assert!(margins["phase"].as_f64().expect("a number") > 0.4);

    std::fs::write(
        folder.join("main.c"),
        "#include <stdio.h>\n#include \"rotary_pendulum_regulator.h\"\nint main(void)\n{\n    rotary_pendulum_regulator_past past;\n    \
         rotary_pendulum_regulator_positions q;\n    rotary_pendulum_regulator_clear(&past);\n    while (scanf(\"%lf %lf\", &q.th1, &q.th2) == 2) {\n        \
         printf(\"%.17g\\n\", rotary_pendulum_regulator_regulate(&past, &q).e);\n        fflush(stdout);\n    }\n    return 0;\n}\n",
    )
    .expect("writable");
    let runs = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success());
    let Some(compiler) = ["cc", "gcc", "clang"].into_iter().find(runs) else {
        skipped("there is no C compiler");
        return;
    };
    let built = Command::new(compiler)
        .args(["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror"])
        .args(["main.c", "rotary_pendulum_regulator.c", "-o", "in_c"])
        .current_dir(folder)
        .output()
        .expect("the compiler runs");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let seen = balanced(&folder.join("in_c"));
    // What the code gave is what the gains say of the same samples.
    let mut filters = [Differentiator::new(1e-3, 0.02); 2];
    for (measured, input) in &seen {
        let rates = [filters[0].push(measured[0]), filters[1].push(measured[1])];
        let wanted = -(gain[0] * measured[0] + gain[1] * measured[1] + gain[2] * rates[0] + gain[3] * rates[1]);
        assert!((input - wanted).abs() < 1e-9, "{input} {wanted}");
    }

    std::fs::write(
        folder.join("main.rs"),
        "#[allow(dead_code)]\nmod rotary_pendulum_regulator;\nuse rotary_pendulum_regulator::{Past, Positions};\nuse std::io::{BufRead, Write};\n\
         fn main() {\n    let mut past = Past::default();\n    for line in std::io::stdin().lock().lines() {\n        let line = line.unwrap();\n        \
         let q: Vec<f64> = line.split(' ').map(|q| q.parse().unwrap()).collect();\n        \
         let u = past.regulate(&Positions { th1: q[0], th2: q[1] });\n        println!(\"{}\", u.e);\n        std::io::stdout().flush().unwrap();\n    }\n}\n",
    )
    .expect("writable");
    if !runs(&"rustc") {
        skipped("there is no rustc");
        return;
    }
    let built = Command::new("rustc")
        .args(["--edition", "2024", "-D", "warnings", "main.rs", "-o", "in_rust"])
        .current_dir(folder)
        .output()
        .expect("the compiler runs");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    assert_eq!(balanced(&folder.join("in_rust")).len(), seen.len());
}

/// A point that is not zero, in single precision, with measured rates: the text, and code that compiles.
#[test]
fn a_pendulum_is_held_where_its_motor_carries_it() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    std::fs::write(
        folder.join("arm.tpm"),
        "model Arm { coordinate q [rad]; input tau [N*m]; parameter J [kg*m^2], G [N*m]; J*ddot(q) + G*sin(q) = tau; }",
    )
    .expect("writable");
    let arguments = ["regulate", "arm.tpm", "--at", "q=pi/2", "--at", "tau=G", "--value", "J=0.5", "--value", "G=3"];
    let more = ["--sample-time", "0.01", "--lang", "c", "--real", "float", "--prefix", "hold", "--code", "code"];
    let said = printed_in(folder, &[&arguments[..], &more].concat(), 0);
    for part in ["rest in q = 1.5708, tau = 3", "rates are measured", "poles [rad/s] without feedback", "phase [deg]"] {
        assert!(said.contains(part), "`{part}` is not in:\n{said}");
    }
    let header = std::fs::read_to_string(folder.join("code/hold.h")).expect("written");
    assert!(header.contains("hold_feedback") && !header.contains("hold_past"), "{header}");
    let source = std::fs::read_to_string(folder.join("code/hold.c")).expect("written");
    assert!(source.contains("inputs.tau = 3.0f") && source.contains("(positions->q - 1.5707964f)"), "{source}");
}

#[test]
fn what_cannot_be_regulated_is_named() {
    let table = ["--params", "models/rotary_pendulum_table1.toml", "--sample-time", "1e-3"];
    let refused = |more: &[&str], said: &[&str]| fails(&[&["regulate", UPRIGHT], &table[..], more].concat(), 2, said);
    refused(&["--at", "th2=1"], &["the point is no equilibrium"]);
    refused(&["--weight", "e=0"], &["--weight e=0", "positive"]);
    refused(&["--weight", "th2=-1"], &["--weight th2=-1", "not negative"]);
    refused(&["--weight", "phi=1"], &["the model has no such name", "dot(th1)"]);
    refused(&["--derivative-filter", "2"], &["filtered differences", "not stable"]);
    fails(&["regulate", UPRIGHT, "--sample-time", "1e-3"], 2, &["a regulator needs numbers", "--value m2=VALUE"]);
    fails(&["regulate", UPRIGHT, table[0], table[1], "--sample-time", "0"], 2, &["a sample time of 0 s"]);

    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = folder.path().join("pair.tpm");
    // Two equal pendulums on one cart's force each: their difference swings as it likes.
    std::fs::write(
        &model,
        "model Pair { coordinate a [rad], b [rad]; input tau [N*m]; parameter J [kg*m^2], G [N*m];
            J*ddot(a) - G*sin(a) = tau; J*ddot(b) - G*sin(b) = tau; }",
    )
    .expect("writable");
    fails(
        &["regulate", text(&model), "--value", "J=1", "--value", "G=4", "--sample-time", "1e-3"],
        2,
        &["no input reaches the mode at 2 rad/s", " a ", " b"],
    );
}
