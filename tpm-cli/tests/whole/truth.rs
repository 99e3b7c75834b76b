//! True values beside the identified ones of a simulated machine, and nowhere else.

use crate::support::{printed_in, root, tpm};
use serde_json::Value;

/// The result of two short runs on the simulated machine of a shipped experiment.
fn result(model: &str, changes: &[&str]) -> Value {
    let model = format!("models/{model}.tpm");
    let mut arguments = vec!["identify", &model, "--json"];
    for change in ["schedule.max_runs=2", "schedule.measure_time=4"].iter().chain(changes) {
        arguments.extend(["--set", change]);
    }
    serde_json::from_slice(&tpm(&arguments).stdout).expect("JSON")
}

/// The true value of a parameter in a list.
fn truth(result: &Value, list: &str, name: &str) -> Option<f64> {
    let entries = result[list].as_array().expect("a list");
    entries.iter().find(|entry| entry["name"] == name).expect("the parameter")["truth"].as_f64()
}

#[test]
fn lumped_and_physical_parameters_have_the_values_of_their_machine() {
    let carts = result("two_carts", &[]);
    assert_eq!(truth(&carts, "physical", "m1"), Some(2.0));
    // c1 = m1 m2/k3, the coefficient of the fourth derivative, and c7 = k2.
    assert!((truth(&carts, "parameters", "c1").expect("known") - 0.01).abs() < 1e-15);
    assert_eq!(truth(&carts, "parameters", "c7"), Some(300.0));
    let pendulum = result("rotary_pendulum_down", &[]);
    assert!((truth(&pendulum, "parameters", "m2_c2").expect("known") - 0.022 * 0.08).abs() < 1e-15);
    assert_eq!(truth(&pendulum, "physical", "c2"), Some(0.08));
}

#[test]
fn what_nobody_knows_has_no_true_value() {
    // The arm does not obey the model that is identified; a mass that drifts has many values.
    let arm = result("closed_loop_arm", &["refine=none"]);
    assert!(arm["parameters"].as_array().expect("a list").iter().all(|entry| entry.get("truth").is_none()), "{arm}");
    let drifting = result("mass_spring_drag", &["plant.drift.m=0.01"]);
    assert_eq!((truth(&drifting, "parameters", "m"), truth(&drifting, "parameters", "k1")), (None, Some(40.0)));
    // Whoever recorded a log knows no more than the log.
    let folder = tempfile::tempdir().expect("a folder");
    let model = root().join("models/mass_spring_drag.tpm").display().to_string();
    printed_in(folder.path(), &["simulate", &model, "-o", "log.csv"], 0);
    let text = printed_in(folder.path(), &["identify", &model, "--log", "log.csv", "--hold", "zoh"], 0);
    assert!(!text.contains("true"), "{text}");
    let text = printed_in(folder.path(), &["identify", &model], 0);
    assert!(text.contains("  true  error/std\n") && text.contains("which only a simulation knows"), "{text}");
}
