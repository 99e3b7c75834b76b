//! The budget of exact operations lies far above what models of machines take.

use crate::robots::{ROBOTS, imported};
use crate::support::{root, skipped};
use std::path::PathBuf;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::generate::{Language, Options, generate};
use tpm_codegen::parse_model;
use tpm_codegen::source::Source;
use tpm_symbolic::budget::{self, Budget, OPERATIONS, left};
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::identifiability::{Experiment, identifiability};
use tpm_symbolic::plan::split::split;
use tpm_symbolic::regressor::prepare::prepare;

/// How many times the work of a shipped model the budget is, at least, with all that is asked of it taken together.
const ROOM: u64 = 3;

/// The operations that everything takes that is done with a model: its tables, its code and its parts.
fn taken(name: &str, text: String) -> u64 {
    let source = Source::new(name, text);
    let whole = || {
        let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
        // What a model does not have is no matter here: some have no pattern, some no finite series.
        if let Ok((model, _)) = parsed.for_tables()
            && !model.patterns.is_empty()
            && let Ok(prepared) = prepare(model.into_owned())
        {
            for pattern in &prepared.model.patterns {
                let Ok(table) = expand(&prepared.model, &prepared.form, pattern) else { continue };
                let _ = identifiability(&[Experiment::of(name, &prepared.model, &table)]);
            }
        }
        if let Ok(estimator) = EstimatorSource::of(&parsed) {
            for language in [Language::Rust, Language::C] {
                assert!(generate(&estimator, &Options::new(language, "tpm generate")).is_ok(), "{name}");
            }
        }
        let _ = split(&parsed.model, &[]);
        OPERATIONS - left()
    };
    budget::run(Budget::default(), whole).unwrap_or_else(|halted| panic!("{name}: {halted}"))
}

fn check(models: Vec<(String, String)>) {
    for (name, text) in models {
        let operations = taken(&name, text);
        assert!(ROOM * operations <= OPERATIONS, "{name} takes {operations} operations");
    }
}

#[test]
fn shipped_models_take_a_small_part_of_the_budget() {
    let folders = ["models", "models/robots"].map(|folder| root().join(folder));
    let entries = folders.iter().flat_map(|folder| std::fs::read_dir(folder).expect("a folder"));
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("readable").path()).collect();
    files.retain(|path| path.extension().is_some_and(|kind| kind == "tpm"));
    files.sort();
    assert!(files.len() > 12, "{files:?}");
    let read = |path: PathBuf| (path.display().to_string(), std::fs::read_to_string(path).expect("a model"));
    check(files.into_iter().map(read).collect());
}

#[test]
fn imported_robots_take_a_small_part_of_the_budget() {
    let robots: Vec<(String, String)> = ROBOTS
        .iter()
        .filter_map(|(fixture, file, locked)| {
            Some(((*fixture).to_owned(), imported(fixture, file, locked)?.model.clone()))
        })
        .collect();
    if robots.is_empty() {
        skipped("TPM_DATA does not name the folder with the robot descriptions");
        return;
    }
    check(robots);
}
