//! What changed between two results, as files.

use crate::support::{fails, printed_in, root};
use std::path::Path;

/// Writes the result of the shipped campaign with other settings.
fn identify(folder: &Path, name: &str, changes: &[&str]) {
    let model = root().join("models/mass_spring_drag.tpm").display().to_string();
    let mut arguments = vec!["identify", &model, "--json", "-o", name];
    for change in changes {
        arguments.extend(["--set", change]);
    }
    printed_in(folder, &arguments, 0);
}

#[test]
fn a_payload_is_named_and_another_seed_is_not() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    identify(at, "a.json", &["seed=1"]);
    identify(at, "same.json", &["seed=2"]);
    identify(at, "load.json", &["seed=3", "plant.parameters.m=2.1"]);
    let text = printed_in(at, &["compare", "a.json", "same.json"], 0);
    assert!(text.starts_with("a.json (A) and same.json (B)\n"), "{text}");
    assert!(text.contains("\nno difference that the data show\n"), "{text}");
    // A change is no failure.
    let text = printed_in(at, &["compare", "a.json", "load.json"], 0);
    assert!(text.contains("\nchanged: m by 0."), "{text}");
    let json: serde_json::Value =
        serde_json::from_str(&printed_in(at, &["compare", "a.json", "load.json", "--json"], 0)).expect("JSON");
    assert_eq!(json["schema"], "tpm.comparison/1");
    assert_eq!((&json["verdict"], &json["changed"]), (&"changed".into(), &serde_json::json!(["m"])));
    assert_eq!(json["linear"]["joint"]["degrees_of_freedom"], 3);
    let change = json["linear"]["differences"][0]["difference"].as_f64().expect("tested");
    assert!((change - 0.1).abs() < 1e-3, "{change}");
}

#[test]
fn what_cannot_be_compared_is_bad_input() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    identify(folder.path(), "a.json", &[]);
    let text = std::fs::read_to_string(path("a.json")).expect("written");
    std::fs::write(path("grams.json"), text.replace("\"kg\"", "\"g\"")).expect("written");
    std::fs::write(path("other.json"), "{\"schema\": \"tpm.table/1\"}").expect("written");
    fails(&["compare", &path("a.json"), &path("grams.json")], 2, &["the units of m (kg and g) do not agree"]);
    fails(&["compare", &path("a.json"), &path("other.json")], 2, &["other.json: this is no result"]);
    fails(&["compare", &path("a.json"), &path("none.json")], 2, &["cannot read"]);
}
