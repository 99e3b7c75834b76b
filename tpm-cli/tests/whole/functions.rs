//! `tanh`, `exp` and `log` through the tool: units, arguments without a value, tables, identifiability, logs.

use crate::support::{printed_in, tpm_in};
use std::path::Path;

fn model(terms: &str, more: &str) -> String {
    format!(
        "model Wheel {{ coordinate q [rad]; input tau [N*m]; parameter J [kg*m^2], d [N*m*s/rad], F [N*m];
    constant vs = 0.1 [rad/s];
    J*ddot(q) + d*dot(q) + {terms} = tau;
    pattern {{ amplitude A [rad]; frequency w [rad/s]; q = A*(cos(w*t) - 1/9*cos(3*w*t)); }} {more} }}"
    )
}

/// What a verb says on standard error of a model, ending with this exit code.
fn said(folder: &Path, verb: &str, text: &str, code: i32) -> String {
    std::fs::write(folder.join("m.tpm"), text).expect("writable");
    let output = tpm_in(folder, &[verb, "m.tpm"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{said}");
    said
}

#[test]
fn arguments_are_pure_numbers_with_a_value() {
    let folder = tempfile::tempdir().expect("a folder");
    for (terms, parts) in [
        ("F*tanh(dot(q))", &["an argument of `tanh`, which is a pure number"][..]),
        ("F*exp(F)", &["an argument of `exp`, which is a pure number"]),
        ("F*log(vs)", &["an argument of `log`, which is a pure number"]),
        ("F*log(1 - 1)", &["`log` of 0 is no real number"]),
        ("F*log(0 - 2)*q", &["`log` of -2 is no real number"]),
        ("F*ln(2)", &["unknown function `ln`", "write `log`, the natural logarithm"]),
        ("F*sinh(q)", &["unknown function `sinh`", "tanh, exp, log"]),
        ("F*tanh(q, q)", &["tanh(x)"]),
        ("F*tanh(d*dot(q)/F)", &["tanh"]),
    ] {
        let said = said(folder.path(), "check", &model(terms, ""), 2);
        parts.iter().for_each(|part| assert!(said.contains(part), "{terms}: `{part}` is not in: {said}"));
    }
}

#[test]
fn a_table_is_refused_with_a_remedy_unless_a_series_is_declared() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    for (terms, function) in
        [("F*tanh(dot(q)/vs)", "tanh(dot(q)/vs)"), ("F*exp(q)", "exp(q)"), ("F*log(2 + q)", "log(2 + q)")]
    {
        let said = said(at, "expand", &model(terms, ""), 2);
        let why = "does not expand into finitely many harmonics under the pattern; declare a Taylor series for it";
        assert!(said.contains(function) && said.contains(why), "{terms}: {said}");
        let shown = printed_in(at, &["identifiability", "m.tpm"], 0);
        assert!(shown.contains("rank 3 of 3 parameters (numerical, along the pattern)"), "{terms}: {shown}");
    }
    for (terms, table) in [
        ("F*exp(q)", "1 + 41/162 A^2 + 2957/209952 A^4"),
        ("F*log(1 + q)", "A + 37/162 A^3"),
        ("F*tanh(q)", "A - 37/162 A^3"),
    ] {
        std::fs::write(at.join("m.tpm"), model(terms, "taylor q about 0 order 4;")).expect("writable");
        let table_found = printed_in(at, &["expand", "m.tpm"], 0);
        assert!(table_found.contains(table), "{terms}: {table_found}");
    }
}

/// A log of the simulated machine, identified by harmonics and refined by output error.
#[test]
fn friction_with_tanh_is_identified_from_a_log() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("m.tpm"), model("F*tanh(dot(q)/vs)", "")).expect("writable");
    let experiment = "seed = 3\n[plant]\nparameters = { J = 0.02, d = 0.05, F = 0.3 }\nsub_steps = 4
        [plant.sensors.q]\nnoise = 1e-4\n[control]\nsample_time = 1e-3\nderivative_filter = 2e-3
        feedback = [{ input = 'tau', coordinate = 'q', kp = 20.0, kd = 1.0 }]
        [schedule]\nmeasure_time = 8.0\nstages = [{ A = 1.0, w = 6.0 }]";
    std::fs::write(at.join("m.toml"), experiment).expect("writable");
    printed_in(at, &["simulate", "m.tpm", "-o", "log.csv"], 0);
    let result = printed_in(at, &["identify", "m.tpm", "--log", "log.csv", "--hold", "zoh", "--json"], 0);
    let result: serde_json::Value = serde_json::from_str(&result).expect("JSON");
    for (parameter, truth) in result["parameters"].as_array().expect("a list").iter().zip([0.02, 0.05, 0.3]) {
        let [value, std] = ["value", "std"].map(|field| parameter[field].as_f64().expect("identified"));
        assert!((value - truth).abs() < 4.0 * std && std < 0.02 * truth, "{parameter}");
    }
}
