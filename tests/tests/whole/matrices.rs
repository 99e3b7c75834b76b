//! Matrices, updates and identified values of every machine of the papers, as text. Other tests compare matrices with independent
//! computations; these show where a change of the estimators moves what they make of the same experiments.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::read_to_string;
use std::path::PathBuf;
use tpm_runtime::experiment::Experiment;
use tpm_runtime::session::{DeclaredModel, Identification, MethodEntry, Session};

/// The machines: the model, and the experiment.
const MACHINES: [(&str, &str); 7] = [
    ("mass_spring_drag", "mass_spring_drag"),
    ("two_carts", "two_carts"),
    ("three_carts", "three_carts"),
    ("closed_loop_arm", "closed_loop_arm_thesis"),
    ("closed_loop_arm", "closed_loop_arm"),
    ("cart_pendulum", "cart_pendulum"),
    ("rotary_pendulum_down", "rotary_pendulum_down"),
];
/// Updates that are shown. What follows them is rounding.
const UPDATES: usize = 3;
/// Entries of a matrix below this share of the largest of their column are rounding.
const LEAST_ENTRY: f64 = 1e-4;

fn shipped(file: String) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models").join(file);
    read_to_string(path).expect("a shipped file")
}

/// The first stage of a shipped experiment without noise.
fn identified(model: &str, experiment: &str, estimator: &str) -> Identification {
    let declared = DeclaredModel::parse(model, &shipped(format!("{model}.tpm"))).expect("a shipped model");
    let text = shipped(format!("experiments/{experiment}.toml"));
    let mut experiment = Experiment::parse(&text).expect("a shipped experiment");
    experiment.apply_override("estimator", estimator).expect("an estimator");
    for sensor in experiment.plant.sensors.values_mut() {
        (sensor.noise, sensor.counts, sensor.step) = (0.0, 0.0, 0.0);
    }
    experiment.schedule.stages.truncate(1);
    experiment.schedule.updates_per_stage = UPDATES;
    experiment.schedule.max_runs = 12 * UPDATES;
    let session = Session::new(declared, experiment, None, BTreeMap::new()).expect("a session").showing_method();
    session.identify(None, &mut |_, _, _| true).expect("played")
}

/// Three digits: what differs between processors and libraries of mathematics is far below.
fn rounded(value: f64) -> String {
    if value == 0.0 { "0".into() } else { format!("{value:.2e}") }
}

fn matrix(entries: &[MethodEntry], parameters: usize) -> String {
    let largest = |j: usize| entries.iter().map(|row| row.entries[j].size).fold(0.0, f64::max);
    let largest: Vec<f64> = (0..parameters).map(largest).collect();
    let mut text = String::new();
    for row in entries {
        let shown = |(entry, largest): (&tpm_runtime::session::Phasor, &f64)| {
            if entry.size <= LEAST_ENTRY * largest {
                return "0".to_string();
            }
            // A phase of -pi is one of pi.
            let degrees = entry.phase.to_degrees().round();
            format!("{}@{}", rounded(entry.size), if degrees <= -180.0 { 180.0 } else { degrees + 0.0 })
        };
        let cells: Vec<String> = row.entries.iter().zip(&largest).map(shown).collect();
        if cells.iter().any(|cell| cell != "0") {
            writeln!(text, "  {} {}: {}", row.coordinate, row.harmonic, cells.join("  ")).expect("a string");
        }
    }
    text
}

#[test]
fn matrices_updates_and_values_of_the_papers_machines() {
    for (model, experiment) in MACHINES {
        let mut text = String::new();
        for estimator in ["error", "hill", "numerical"] {
            let found = identified(model, experiment, estimator);
            let method = found.method.as_ref().expect("asked for");
            let names = method.parameters.join("  ");
            if estimator == "error" {
                let first = method.runs.first().expect("a run");
                writeln!(text, "T B Lambda of the first run: {names}").expect("a string");
                text.push_str(&matrix(&first.matrix, method.parameters.len()));
            }
            writeln!(text, "{estimator}, updates: {names}").expect("a string");
            for update in &method.updates {
                let values: Vec<String> = update.values.iter().copied().map(rounded).collect();
                writeln!(text, "  run {}: {}", update.run, values.join("  ")).expect("a string");
            }
            for parameter in found.parameters.iter().chain(&found.physical) {
                let value = parameter.value.map_or("not shown".into(), rounded);
                writeln!(text, "  {} = {value}", parameter.name).expect("a string");
            }
        }
        insta::assert_snapshot!(format!("matrices_{experiment}"), text);
    }
}
