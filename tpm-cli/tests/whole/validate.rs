//! Prediction of a second log: simulated, and EMPS with and without pulses where the data are at hand; its motion simulated from its
//! inputs, also where the parameters are known as combinations only, and where no model can follow.

use crate::support::{drawn, root, skipped, tpm, tpm_in};
use serde_json::{Value, json};
use std::path::Path;

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
    let channel = &result["simulation"]["channels"][0];
    let fit = |of: &str| channel[of]["fit"].as_f64().expect("a number");
    assert!(fit("one_step") > 99.0 && fit("free_run") > 97.0, "{channel}");
    assert_eq!((&result["simulation"]["start"], &channel["name"]), (&json!("smoothed state"), &json!("x")));
    // Another machine is not predicted.
    let heavier = ["--set", "plant.parameters.m=3", "--set", "seed=5", "-o", "other.csv"];
    assert!(tpm_in(at, &[&["simulate", model], &short[..], &heavier[..]].concat()).status.success());
    let result: serde_json::Value = serde_json::from_slice(&tpm_in(at, &arguments).stdout).expect("JSON");
    assert!(result["prediction_error"].as_f64().expect("a number") > 0.1, "{result}");
    let figures = [&arguments[..8], &["--domain", "time", "--report", "figures"]].concat();
    let text = String::from_utf8(tpm_in(at, &figures).stdout).expect("text");
    assert!(text.contains("nothing is fitted") && text.contains("prediction error"), "{text}");
    assert!(text.contains("free run, rms") && text.contains("low pass at"), "{text}");
    assert!(drawn(&["motion.svg", "motion.png"]).iter().all(|name| at.join("figures").join(name).exists()));
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
    let free_run = &found["simulation"]["channels"][0]["free_run"];
    println!("EMPS, second file: free run {free_run}");
    assert!(free_run["fit"].as_f64().expect("a number") > 85.0, "{found}");
    assert!(error < 0.1, "{found}");
}

/// The stiffness is 40, or that of a spring that pushes away; of the constant torques the combinations a - b and b + c are known at most,
/// since the squares of sine and cosine are one together.
const SPRING: &str = "model Spring {
    coordinate x [rad];
    input u [N*m];
    parameter J [kg*m^2], d [N*m*s/rad], k [N*m], a [N*m], b [N*m], c [N*m];

    J*ddot(x) + d*dot(x) + k*x + a*sin(x)^2 + b*cos(x)^2 + c = u;
}
";

/// Writes a log along a motion that does not repeat, with the inputs that it needs, and returns the motion.
fn log(path: &Path, k: f64) -> Vec<f64> {
    let mut text = "t_s,x,u\n".to_owned();
    let mut motion = Vec::new();
    for i in 0..1200 {
        let t = 0.01 * f64::from(i);
        let (phase, rate, more) = (2.0 * t + 0.2 * t * t, 2.0 + 0.4 * t, 0.4);
        let (x, v) = (0.5 * phase.sin(), 0.5 * rate * phase.cos());
        let acceleration = 0.5 * (more * phase.cos() - rate * rate * phase.sin());
        let u = 2.0 * acceleration + 1.5 * v + k * x + 3.0 * x.sin().powi(2) + x.cos().powi(2) + 0.5;
        text.push_str(&format!("{t:.2},{x:.7},{u:.7}\n"));
        motion.push(x);
    }
    std::fs::write(path, text).expect("written");
    motion
}

/// A result in which the torques are known as combinations only; without a stiffness, nothing is known of it either.
fn combined(k: Option<f64>) -> String {
    let parameter = |name: &str, value: Option<f64>| json!({"name": name, "value": value, "std": value.map(|_| 0.01), "status": ""});
    let mut open = vec![json!({"a": "1", "b": "1", "c": "-1"})];
    open.extend(k.is_none().then(|| json!({"k": "1"})));
    let shown = |terms: Value, value: f64| json!({"terms": terms, "value": value, "std": 0.001});
    json!({
        "schema": "tpm.identification/2",
        "model": "Spring",
        "parameters": [
            parameter("J", Some(2.0)), parameter("d", Some(1.5)), parameter("k", k),
            parameter("a", None), parameter("b", None), parameter("c", None),
        ],
        "unobservable": open,
        "combinations": [shown(json!({"a": "1", "b": "-1"}), 2.0), shown(json!({"b": "1", "c": "1"}), 1.5)],
    })
    .to_string()
}

#[test]
fn motion_is_simulated_from_combinations_of_parameters() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("spring.tpm"), SPRING).expect("written");
    let arguments = ["validate", "spring.tpm", "--params", "result.json", "--log", "log.csv", "--json"];
    let validated = |result: String| -> (Option<i32>, Value) {
        std::fs::write(at.join("result.json"), result).expect("written");
        let output = tpm_in(at, &arguments);
        let found = serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {output:?}"));
        (output.status.code(), found)
    };
    let motion = log(&at.join("log.csv"), 40.0);
    let (code, found) = validated(combined(Some(40.0)));
    let channel = &found["simulation"]["channels"][0];
    assert_eq!(code, Some(0), "{found}");
    let number = |of: &str, what: &str| channel[of][what].as_f64().expect("a number");
    // Seven digits of the readings are all that is missed.
    assert!(number("free_run", "rms") < 1e-7 && number("one_step", "rms") < 1e-7, "{channel}");
    let mean = motion.iter().sum::<f64>() / motion.len() as f64;
    let spread = (motion.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / motion.len() as f64).sqrt();
    let (_, wrong) = validated(combined(Some(41.0)));
    let free_run = &wrong["simulation"]["channels"][0]["free_run"];
    let (rms, fit) = (free_run["rms"].as_f64().expect("a number"), free_run["fit"].as_f64().expect("a number"));
    assert!((fit - 100.0 * (1.0 - rms / spread)).abs() < 1e-3 && fit < 99.0, "{fit} {rms} {spread}");
    // Nothing is known of the stiffness: neither the input nor the motion is predicted.
    let (code, found) = validated(combined(None));
    assert_eq!((code, &found["simulation"]), (Some(1), &Value::Null), "{found}");
    assert!(found["not_simulated"].as_str().is_some_and(|why| why.contains("leaves k open")), "{found}");
    // A spring that pushes away is held by a loop: no model follows the motion from the inputs alone.
    log(&at.join("log.csv"), -60.0);
    let (code, found) = validated(combined(Some(-60.0)));
    let simulation = &found["simulation"];
    assert_eq!((code, &simulation["channels"][0]["free_run"]), (Some(0), &Value::Null), "{found}");
    assert_eq!(simulation["diverges"]["unstable"], json!(true), "{simulation}");
    // It takes ln(.35/3e-8)/5.1 = 3.2 s until the rounding of a reading has grown to the size of the motion.
    assert!(simulation["diverges"]["time"].as_f64().is_some_and(|time| time > 3.2 && time < 12.0), "{simulation}");
    let text = String::from_utf8(tpm_in(at, &arguments[..6]).stdout).expect("text");
    assert!(text.contains("the free run diverges at t = "), "{text}");
}
