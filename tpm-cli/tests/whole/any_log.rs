//! Logs that do not repeat, and several logs of one machine.

use crate::support::{fails, root, tpm_in};
use serde_json::Value;
use std::f64::consts::PI;
use std::path::Path;

/// m, k1, k2 of `models/mass_spring_drag.tpm`.
const TRUTH: [f64; 3] = [2.0, 40.0, 1.5];

/// Uniform noise of deviation one, the same at every run.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = 0x9e37_79b9_7f4a_7c15 ^ (seed << 32);
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        12.0_f64.sqrt() * ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
    }
}

/// A sweep from .3 Hz on of so many seconds, whose frequency rises by `slope` Hz a second, with noise, as a file.
fn sweep(folder: &Path, name: &str, [m, k1, k2]: [f64; 3], seconds: f64, slope: f64) {
    let mut noise = noise(name.len() as u64 + name.as_bytes()[0] as u64);
    let mut text = String::from("t_s,x,u\n");
    for k in 0..(seconds / 0.005) as usize {
        let t = 0.005 * k as f64;
        let (w, dw) = (2.0 * PI * (0.3 + slope * t), 2.0 * PI * slope);
        let (s, c) = (2.0 * PI * (0.3 * t + 0.5 * slope * t * t)).sin_cos();
        let [x, v, a] = [0.3 * s, 0.3 * w * c, 0.3 * (dw * c - w * w * s)];
        let u = m * a + k1 * x + k2 * v * v + 0.02 * noise();
        text.push_str(&format!("{t},{},{u}\n", x + 1e-4 * noise()));
    }
    std::fs::write(folder.join(name), text).expect("writable");
}

fn model() -> String {
    root().join("models/mass_spring_drag.tpm").to_str().expect("a readable path").to_owned()
}

/// Exit code, JSON and messages of `tpm identify`.
fn identify(folder: &Path, arguments: &[&str]) -> (Option<i32>, Value, String) {
    let model = model();
    let output = tpm_in(folder, &[&["identify", &model, "--json"], arguments].concat());
    let json = serde_json::from_slice(&output.stdout).unwrap_or_default();
    (output.status.code(), json, String::from_utf8_lossy(&output.stderr).into_owned())
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("a number: {value}"))
}

/// Value and deviation of every parameter.
fn parameters(json: &Value) -> Vec<(f64, f64)> {
    let all = json["parameters"].as_array().expect("parameters");
    all.iter().map(|parameter| (number(&parameter["value"]), number(&parameter["std"]))).collect()
}

#[test]
fn a_sweep_is_identified_and_predicts_another_one() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    sweep(folder.path(), "a.csv", TRUTH, 15.0, 0.06);
    sweep(folder.path(), "b.csv", TRUTH, 10.0, 0.11);
    let (code, json, messages) = identify(folder.path(), &["--log", "a.csv"]);
    assert_eq!(code, Some(0), "{messages}");
    assert_eq!(json["log"]["domain"], "spectral");
    for ((value, std), truth) in parameters(&json).into_iter().zip(TRUTH) {
        assert!((value - truth).abs() < 4.0 * std && (value / truth - 1.0).abs() < 5e-3, "{value} +- {std}: {truth}");
    }
    std::fs::write(folder.path().join("a.json"), json.to_string()).expect("writable");
    let model = model();
    let output = tpm_in(folder.path(), &["validate", &model, "--params", "a.json", "--log", "b.csv", "--json"]);
    let validation: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(number(&validation["prediction_error"]) < 0.01 && validation["period"].is_null(), "{validation}");
    let heavier = json.to_string().replace("\"value\":", "\"value\": 1.1, \"was\":");
    std::fs::write(folder.path().join("wrong.json"), heavier).expect("writable");
    let output = tpm_in(folder.path(), &["validate", &model, "--params", "wrong.json", "--log", "b.csv", "--json"]);
    let validation: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(number(&validation["prediction_error"]) > 0.2, "{validation}");
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8(output.stderr).expect("text");
    assert!(said.contains("on this log is not predicted"), "{said}");
}

#[test]
fn two_logs_together_are_better_than_each() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    sweep(folder.path(), "a.csv", TRUTH, 15.0, 0.06);
    sweep(folder.path(), "b.csv", TRUTH, 10.0, 0.11);
    let alone = ["a.csv", "b.csv"].map(|log| parameters(&identify(folder.path(), &["--log", log]).1));
    let (code, json, messages) = identify(folder.path(), &["--log", "a.csv", "--log", "b.csv"]);
    assert_eq!(code, Some(0), "{messages}");
    for (j, (value, std)) in parameters(&json).into_iter().enumerate() {
        assert!(alone.iter().all(|log| std < log[j].1), "{std} {alone:?}");
        assert!((value - TRUTH[j]).abs() < 4.0 * std, "{value} +- {std}");
    }
    let logs = json["pool"]["logs"].as_array().expect("logs");
    let shares: f64 = logs.iter().map(|log| number(&log["share"])).sum();
    assert!(logs.len() == 2 && (shares - 1.0).abs() < 1e-9, "{json}");
    assert_eq!(json["provenance"]["logs"].as_array().map(Vec::len), Some(2));
}

#[test]
fn logs_of_different_machines_and_a_log_twice_are_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    sweep(folder.path(), "a.csv", TRUTH, 15.0, 0.06);
    sweep(folder.path(), "b.csv", TRUTH, 10.0, 0.11);
    sweep(folder.path(), "loaded.csv", [2.2, 40.0, 1.5], 12.0, 0.09);
    let (code, json, messages) = identify(folder.path(), &["--log", "a.csv", "--log", "loaded.csv"]);
    assert_eq!(code, Some(1), "{json}");
    assert!(messages.contains("contradicts the other logs: m differs most"), "{messages}");
    let (value, std) = parameters(&json)[0];
    assert!((value - TRUTH[0]).abs() < 4.0 * std, "deviations grow with what differs: {value} +- {std}");
    // Two logs that agree are more than one.
    let (code, json, messages) = identify(folder.path(), &["--log", "a.csv", "--log", "loaded.csv", "--log", "b.csv"]);
    assert_eq!(code, Some(0), "{messages}");
    let odd = json["findings"].as_array().expect("findings").iter().find(|own| own["kind"] == "odd_log").expect("said");
    assert!(odd["path"].as_str().is_some_and(|path| path.ends_with("loaded.csv")) && odd["parameter"] == "m", "{odd}");
    assert!(odd["factor"].is_null(), "only m differs: {odd}");
    let left_out: Vec<bool> =
        json["pool"]["logs"].as_array().expect("logs").iter().map(|log| log["left_out"] == true).collect();
    assert_eq!(left_out, [false, true, false]);
    for ((value, std), truth) in parameters(&json).into_iter().zip(TRUTH) {
        assert!((value - truth).abs() < 4.0 * std, "{value} +- {std}: {truth}");
    }
    let (code, _, messages) = identify(folder.path(), &["--log", "a.csv", "--log", "a.csv"]);
    assert_eq!(code, Some(2));
    assert!(messages.contains("the same log"), "{messages}");
    fails(&["identify", "models/mass_spring_drag.tpm", "--log", "none.csv", "--log", "none.csv"], 2, &["none.csv"]);
}

#[test]
fn recordings_in_one_file_without_a_gap_are_told_apart() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    sweep(folder.path(), "a.csv", TRUTH, 15.0, 0.06);
    sweep(folder.path(), "b.csv", TRUTH, 10.0, 0.11);
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("written");
    let mut joined: String = read("a.csv").lines().take(2_991).map(|line| format!("{line}\n")).collect();
    for (k, line) in read("b.csv").lines().skip(40).enumerate() {
        let (_, rest) = line.split_once(',').expect("columns");
        joined.push_str(&format!("{},{rest}\n", 0.005 * (2_990 + k) as f64));
    }
    std::fs::write(folder.path().join("joined.csv"), joined).expect("writable");
    let (code, json, messages) = identify(folder.path(), &["--log", "joined.csv"]);
    assert_eq!(code, Some(0), "{messages}");
    let cut = &json["log"]["reading"]["segments"][1];
    assert_eq!((cut["cut"]["kind"].as_str(), cut["from_line"].as_u64()), (Some("joined"), Some(2_992)), "{json}");
    for ((value, std), truth) in parameters(&json).into_iter().zip(TRUTH) {
        assert!((value - truth).abs() < 4.0 * std && (value / truth - 1.0).abs() < 5e-3, "{value} +- {std}: {truth}");
    }
    let model = model();
    // A period that the two need not share is not taken for one of both.
    let (_, json, _) = identify(folder.path(), &["--log", "joined.csv", "--period", "2"]);
    assert!(json["warnings"].to_string().contains("the record has 2 stretches"), "{json}");
    let text = crate::support::printed_in(folder.path(), &["inspect", "joined.csv", &model], 0);
    assert!(text.contains("x jumps by") && text.contains("line 2992"), "{text}");
}

/// A search that nobody waits for ends: the numbers are those of the lines, and the result says what was left out.
#[test]
fn a_simulation_that_takes_too_long_is_left_out_and_said() {
    let folder = tempfile::tempdir().expect("a folder");
    sweep(folder.path(), "sweep.csv", TRUTH, 20.0, 0.1);
    let (code, json, _) = identify(folder.path(), &["--log", "sweep.csv", "--hold", "none", "--time", "1e-6"]);
    let (plain_code, plain, _) = identify(folder.path(), &["--log", "sweep.csv", "--hold", "none", "--refine", "none"]);
    assert_eq!(parameters(&json), parameters(&plain));
    // What was to explain the rest of the record did not come to its end: that is no result like one that nobody wanted refined.
    assert_eq!((code, plain_code), (Some(1), Some(0)));
    let note = json["log"]["refinement"]["note"].as_str().unwrap_or_default();
    assert!(note.contains("the time that it was given was over"), "{note}");
    fails(&["identify", &model(), "--log", "sweep.csv", "--time", "0"], 2, &["above zero"]);
}
