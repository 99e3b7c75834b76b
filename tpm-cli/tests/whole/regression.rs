//! `tpm check --against`: a machine that has not changed passes, one that has does not, and programs can read why.

use crate::support::{printed_in, tpm_in};
use roxmltree::Document;
use serde_json::Value;
use std::path::Path;
use tpm_runtime::session::{SAMPLE_EXPERIMENT, SAMPLE_MODEL};

/// A slider with dry friction, and the log of a run with a change of its machine.
fn recorded(at: &Path, log: &str, changes: &[&str]) {
    let set = changes.iter().flat_map(|change| ["--set", change]);
    let arguments: Vec<&str> = ["simulate", "slide.tpm", "-o", log].into_iter().chain(set).collect();
    printed_in(at, &arguments, 0);
}

/// The exit code of a check, and its JSON.
fn checked(at: &Path, log: &str, more: &[&str]) -> (Option<i32>, Value, String) {
    let own = ["check", "slide.tpm", log, "--against", "result.json", "--hold", "zoh", "--json"];
    let output = tpm_in(at, &[&own[..], more].concat());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), serde_json::from_slice(&output.stdout).unwrap_or(Value::Null), said)
}

fn outcome(found: &Value, name: &str) -> String {
    let checks = found["checks"].as_array().unwrap_or_else(|| panic!("{found}"));
    let check = checks.iter().find(|check| check["name"] == name).unwrap_or_else(|| panic!("{name}: {found}"));
    check["outcome"].as_str().expect("an outcome").to_owned()
}

#[test]
fn a_changed_machine_fails_its_check_and_an_unchanged_one_passes() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    for (name, text) in [SAMPLE_MODEL, SAMPLE_EXPERIMENT] {
        std::fs::write(at.join(name), text).expect("writable");
    }
    recorded(at, "before.csv", &[]);
    printed_in(
        at,
        &["identify", "slide.tpm", "--log", "before.csv", "--hold", "zoh", "--json", "-o", "result.json"],
        0,
    );
    recorded(at, "same.csv", &["seed=2"]);
    let (code, found, said) = checked(at, "same.csv", &["--junit", "same.xml"]);
    assert_eq!(code, Some(0), "{said} {found}");
    for name in ["the earlier parameters predict the log", "the model explains the log", "m", "c"] {
        assert_eq!(outcome(&found, name), "passed", "{name}");
    }
    // A payload, worn grease, and a spring that nobody modelled.
    recorded(at, "loaded.csv", &["seed=3", "plant.parameters.m=8.8"]);
    let (code, found, said) = checked(at, "loaded.csv", &["--junit", "loaded.xml"]);
    assert_eq!(code, Some(1), "{found}");
    assert!(said.contains("the machine is not the one of result.json") && said.contains('m'), "{said}");
    assert_eq!((outcome(&found, "m").as_str(), outcome(&found, "c").as_str()), ("failed", "passed"));
    recorded(at, "worn.csv", &["seed=4", "plant.parameters.c=14"]);
    let (code, found, _) = checked(at, "worn.csv", &[]);
    assert_eq!((code, outcome(&found, "c").as_str()), (Some(1), "failed"));
    for (file, failures) in [("same.xml", 0), ("loaded.xml", 1)] {
        let text = std::fs::read_to_string(at.join(file)).expect("a file");
        let document = Document::parse(&text).expect("well-formed");
        let suite = document.descendants().find(|node| node.has_tag_name("testsuite")).expect("a suite");
        let number = |name: &str| suite.attribute(name).expect("an attribute").parse::<usize>().expect("a number");
        let cases = document.descendants().filter(|node| node.has_tag_name("testcase")).count();
        let failed = document.descendants().filter(|node| node.has_tag_name("failure")).count();
        assert_eq!((number("tests"), number("failures")), (cases, failed), "{text}");
        assert!(cases > 5 && (failed > 0) == (failures > 0), "{text}");
    }
    for (arguments, said) in [
        (&["check", "slide.tpm", "same.csv"][..], "--against"),
        (&["check", "slide.tpm", "--against", "result.json"], "<LOG>"),
        (&["check", "slide.tpm", "same.csv", "--against", "slide.toml"], "no result of"),
        (&["check", "slide.tpm", "none.csv", "--against", "result.json"], "none.csv"),
        (&["check", "slide.tpm", "same.csv", "--against", "result.json", "--junit", "none/a.xml"], "none/a.xml"),
    ] {
        let output = tpm_in(at, arguments);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && text.contains(said), "{arguments:?}: {text}");
    }
}
