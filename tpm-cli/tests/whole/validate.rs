//! Prediction of a second log: simulated, and EMPS with and without pulses where the data are at hand.

use crate::support::{root, skipped, tpm, tpm_in};

#[test]
fn a_second_run_is_predicted() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    let short = ["--set", "schedule.measure_time=8", "--set", "schedule.max_runs=4"];
    let identified = tpm_in(at, &[&["identify", model, "--json", "-o", "result.json"], &short[..]].concat());
    assert!(identified.status.code() < Some(2), "{identified:?}");
    let other = ["--set", "schedule.stages.0.lambda=0.5", "--set", "seed=5", "-o", "other.csv"];
    assert!(tpm_in(at, &[&["simulate", model], &short[..], &other[..]].concat()).status.success());
    let arguments = ["validate", model, "--params", "result.json", "--log", "other.csv", "--hold", "zoh", "--json"];
    let output = tpm_in(at, &arguments);
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let error = result["prediction_error"].as_f64().expect("a number");
    assert!(error < 0.01, "{result}");
    // Another machine is not predicted.
    let heavier = ["--set", "plant.parameters.m=3", "--set", "seed=5", "-o", "other.csv"];
    assert!(tpm_in(at, &[&["simulate", model], &short[..], &heavier[..]].concat()).status.success());
    let result: serde_json::Value = serde_json::from_slice(&tpm_in(at, &arguments).stdout).expect("JSON");
    assert!(result["prediction_error"].as_f64().expect("a number") > 0.1, "{result}");
    let text = String::from_utf8(tpm_in(at, &arguments[..8]).stdout).expect("text");
    assert!(text.contains("nothing is fitted") && text.contains("prediction error"), "{text}");
}

#[test]
fn emps_is_predicted_on_its_second_file() {
    let Some(data) = std::env::var_os("TPM_DATA") else {
        skipped("TPM_DATA does not name the folder of the published logs");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let result = folder.path().join("emps.json");
    let file = |name: &str| std::path::Path::new(&data).join("emps").join(name).to_str().expect("plain").to_owned();
    let maps = ["--map", "q=q_m", "--map", "force=force_N"];
    let model = "models/emps.tpm";
    let (first, second) = (file("emps_estimation.csv"), file("emps_validation_pulses.csv"));
    let result = result.to_str().expect("plain");
    let identified = tpm(&[&["identify", model, "--log", &first, "--json", "-o", result], &maps[..]].concat());
    assert!(identified.status.success(), "{identified:?}");
    let output = tpm(&[&["validate", model, "--params", result, "--log", &second, "--json"], &maps[..]].concat());
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let error = found["prediction_error"].as_f64().expect("a number");
    println!("EMPS, second file: prediction error {:.2} %", 100.0 * error);
    assert!(error < 0.1, "{found}");
}
