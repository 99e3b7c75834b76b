//! The example `pendulum_study`: the whole chain on the shipped files.

// Cargo builds examples, but runs no unit tests in them: these run here.
#[allow(dead_code, reason = "the example runs as a program of its own")]
#[path = "../../examples/pendulum_study/main.rs"]
mod example;

use crate::regulate::{MOTOR, STUDY};
use crate::support::{drawn, printed};
use std::path::Path;
use std::process::{Command, Output};

/// Runs the example in a folder. `cargo test` builds the examples of a package beside its test programs.
fn study(folder: &Path, arguments: &[&str]) -> Output {
    let test = std::env::current_exe().expect("this program has a path");
    let built = test.parent().and_then(Path::parent).expect("cargo's folder `deps` stands in that of the profile");
    let example = built.join("examples").join(format!("pendulum_study{}", std::env::consts::EXE_SUFFIX));
    let run = Command::new(&example).args(arguments).current_dir(folder).output();
    run.unwrap_or_else(|error| {
        panic!("{}: {error}; `cargo build -p tpm-cli --example pendulum_study` makes it", example.display())
    })
}

#[test]
fn the_report_says_what_agrees_and_what_does_not() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let target = folder.path().join("study");
    // Far from the shipped models, which the program carries.
    let run = study(folder.path(), &["--seeds", "2", "-o", "study"]);
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    let report = std::fs::read_to_string(target.join("report.md")).expect("a report");
    for said in [
        "# The rotary inverted pendulum",
        "Eqn 24 is reproduced",
        "**Eqns 28 and 29 are not consistent**",
        "The data support order 1/3",
        "2 of 2 balance",
        "C1 + Kt Kb/Rm",
    ] {
        assert!(report.contains(said), "{said} is missing in\n{report}");
    }
    for figure in ["bode", "bode500", "eqn29", "balance"] {
        let svg = std::fs::read_to_string(target.join(format!("{figure}.svg"))).expect("an SVG");
        assert!(svg.starts_with("<svg") && svg.contains("</svg>"));
        for name in drawn(&[&format!("{figure}.png")]) {
            assert_eq!(&std::fs::read(target.join(name)).expect("a PNG")[1..4], b"PNG");
        }
        assert!(report.contains(&format!("]({figure}.svg)")), "{figure} is not shown");
    }
    assert!(String::from_utf8_lossy(&run.stdout).contains("report.md"));

    // The gains of the study are those of the command line on the same identification.
    let result = folder.path().join("result.json");
    let result = result.to_str().expect("a readable path");
    printed(&["identify", "models/rotary_pendulum_down.tpm", "--json", "-o", result]);
    let own = ["regulate", "models/rotary_pendulum.tpm", "--params", result, "--json"];
    let found: serde_json::Value = serde_json::from_str(&printed(&[&own[..], &MOTOR, &STUDY].concat())).expect("JSON");
    let row = report.lines().find(|line| line.starts_with("| identified model (first seed)")).expect("a row of gains");
    let cells: Vec<f64> = row.split('|').filter_map(|cell| cell.trim().parse().ok()).collect();
    for (cell, gain) in cells.iter().zip(found["gain"][0].as_array().expect("a row")) {
        let gain = gain.as_f64().expect("a number");
        assert!((gain / cell - 1.0).abs() < 1e-5, "{row} {found}");
    }
    assert_eq!(cells.len(), 5, "four gains and a cost: {row}");
}

#[test]
fn a_missing_value_and_a_short_record_are_said() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let table = folder.path().join("half.toml");
    std::fs::write(&table, "m2 = 0.022\n").expect("writable");
    for (arguments, said) in [
        (["--params", table.to_str().expect("UTF-8")], "no value of l1, c2, J1"),
        (["--duration", "20"], "--duration 20"),
    ] {
        let run = study(folder.path(), &arguments);
        let errors = String::from_utf8_lossy(&run.stderr);
        assert!(run.status.code() == Some(2) && errors.contains(said), "{errors}");
    }
}
