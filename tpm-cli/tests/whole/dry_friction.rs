//! Coulomb friction on a coordinate that nothing drives: simulated with sticking, its reference found, identified.

use crate::support::tpm;
use serde_json::Value;

#[test]
fn coulomb_friction_on_both_joints_of_the_pendulum_is_identified() {
    // A campaign takes a minute in a development build; `.ci/long` plays more of them.
    let seeds = std::env::var("TPM_DRY_SEEDS").ok().and_then(|seeds| seeds.parse().ok()).unwrap_or(1_u32);
    for seed in 1..=seeds {
        let seed = format!("seed={seed}");
        let output = tpm(&["identify", "models/rotary_pendulum_dry.tpm", "--set", &seed, "--json"]);
        assert_eq!(output.status.code(), Some(0), "{seed}: {}", String::from_utf8_lossy(&output.stderr));
        let result: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        let runs = result["runs"].as_array().expect("a list");
        assert!(runs.len() == 3 && runs.iter().all(|run| run["ending"] == "complete"), "{seed}: {runs:?}");
        for (name, truth) in [("Fc1", 2e-3), ("Fc2", 2e-5)] {
            let all = result["parameters"].as_array().expect("a list");
            let entry = all.iter().find(|entry| entry["name"] == name).expect("a parameter of the model");
            let (value, std) = (entry["value"].as_f64().expect("shown"), entry["std"].as_f64().expect("shown"));
            assert!((value - truth).abs() < 3.0 * std, "{seed}: {name} = {value} +- {std}");
            assert!((value / truth - 1.0).abs() < 0.1 && std < 0.05 * truth, "{seed}: {name} = {value} +- {std}");
        }
    }
}
