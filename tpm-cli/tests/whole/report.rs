//! Reports as pages for a browser: well-formed, without anything from outside, with every parameter, number and warning of the result.

use crate::support::{drawn, names, root, tpm_in};
use roxmltree::{Document, ParsingOptions};
use serde_json::Value;
use std::path::Path;

/// The namespace of drawings, which is a name and nothing that is fetched.
const NAMESPACE: &str = "http://www.w3.org/2000/svg";

/// The page in a folder, held against a result: what it says, and all numbers that stand in it in full.
fn checked(folder: &Path, result: &Value) -> String {
    let page = std::fs::read_to_string(folder.join("report.html")).expect("a page");
    let plain = page.replace(NAMESPACE, "");
    for outside in ["http:", "https:", "<script", "src=", "url(", "@import", "<link", "NaN"] {
        assert!(!plain.contains(outside), "`{outside}` in the page");
    }
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    let document = Document::parse_with_options(&page, options).expect("well-formed");
    let all: String =
        document.root_element().descendants().filter_map(|node| node.text().filter(|_| node.is_text())).collect();
    let numbers: Vec<f64> = (document.descendants())
        .filter(|node| node.has_tag_name("data"))
        .map(|node| node.attribute("value").expect("a value").parse().expect("a number"))
        .collect();
    for list in ["parameters", "physical", "combinations"] {
        for own in result[list].as_array().into_iter().flatten() {
            assert!(own["name"].as_str().is_none_or(|name| all.contains(name)), "{own}");
            for field in ["value", "std", "prior", "truth"] {
                if let Some(number) = own[field].as_f64() {
                    assert!(numbers.contains(&number), "{field} of {own} is not in the page");
                }
            }
        }
    }
    for warning in result["warnings"].as_array().into_iter().flatten() {
        let warning = warning.as_str().expect("a text");
        assert!(all.contains(warning), "`{warning}` is not in the page");
    }
    all
}

fn result(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("a result")).expect("JSON")
}

#[test]
fn reports_say_what_the_results_say() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let model = root().join("models/mass_spring_drag.tpm");
    let model = model.to_str().expect("plain");
    let short = ["--set", "schedule.measure_time=4", "--set", "schedule.max_runs=3"];
    let run = |arguments: &[&str]| {
        let output = tpm_in(at, arguments);
        assert!(output.status.code() < Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    let kept = ["--json", "-o", "campaign.json", "--report", "campaign", "--runs", "runs"];
    run(&[&["identify", model], &short[..], &kept[..]].concat());
    let said = checked(&at.join("campaign"), &result(&at.join("campaign.json")));
    for part in ["Measured against model", "Correlations", "What the data do not show", "Runs", "Limits", "Provenance"]
    {
        assert!(said.contains(part), "{part}");
    }
    let files =
        drawn(&["error.png", "error.svg", "force.svg", "harmonics.svg", "input.svg", "report.html", "table.md"]);
    let written = names(&at.join("campaign"));
    assert!(files.iter().all(|file| written.iter().any(|own| own == file)), "{written:?}");
    run(&["campaign", "result", "runs", "--json", "-o", "folder.json", "--report", "folder"]);
    checked(&at.join("folder"), &result(&at.join("folder.json")));
    // What comes from outside is escaped, and a warning stands beside its remedy.
    let log = "a&<b>.csv";
    run(&[&["simulate", model], &short[..], &["-o", log]].concat());
    run(&["identify", model, "--log", log, "--refine", "none", "--json", "-o", "log.json", "--report", "log"]);
    let found = result(&at.join("log.json"));
    let said = checked(&at.join("log"), &found);
    assert!(said.contains(log), "the name of the log");
    assert_eq!(said.contains("What helps: "), found["findings"].to_string().contains("\"remedy\""));
    run(&["validate", model, "--params", "log.json", "--log", log, "--hold", "zoh", "--report", "prediction"]);
    assert!(checked(&at.join("prediction"), &Value::Null).contains("nothing is fitted"));
    run(&[&["study", model, "--seeds", "2", "--json", "-o", "study.json", "--report", "study"], &short[..]].concat());
    checked(&at.join("study"), &result(&at.join("study.json")));
    // All files or none.
    std::fs::create_dir_all(at.join("blocked/table.md")).expect("a folder in the way");
    let output = tpm_in(at, &["campaign", "result", "runs", "--report", "blocked"]);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert_eq!(names(&at.join("blocked")), ["table.md"]);
}
