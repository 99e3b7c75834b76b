//! Mutated logs and experiments: each is read or refused, and nothing panics. Builds of tests check overflows.
//!
//! `TPM_RANDOM_FILES` sets how many files of each kind are tried, `TPM_RANDOM_SEED` the first of them; a failure names its seed.

#[path = "../../support/mutated.rs"]
mod changed;

use crate::support::root;
use changed::mutated;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use tpm_models::MassSpringDrag;
use tpm_runtime::experiment::Experiment;
use tpm_runtime::log::{Log, LogOptions, Recording};
use tpm_runtime::session::{DeclaredModel, Session};

/// Files of each kind that are tried where nothing else is said.
const FILES: u64 = 60;

/// Calls `read` with every seed. It says whether the file was accepted; the number of those that were.
fn accepted(read: impl Fn(u64) -> (String, Box<dyn FnOnce(&str) -> bool>)) -> usize {
    let set = |name: &str, or: u64| std::env::var(name).ok().and_then(|value| value.parse().ok()).unwrap_or(or);
    let first = set("TPM_RANDOM_SEED", 1);
    let seeds = first..first + set("TPM_RANDOM_FILES", FILES);
    let one = |seed: u64| {
        let (text, answer) = read(seed);
        catch_unwind(AssertUnwindSafe(|| answer(&text))).unwrap_or_else(|_| panic!("TPM_RANDOM_SEED={seed}:\n{text}"))
    };
    seeds.filter(|&seed| one(seed)).count()
}

#[test]
fn mutated_logs_are_read_or_refused() {
    let heads = ["t_s,x,u", "t_ms;x;u", "time x u", "t_s,x,dot(x),u"];
    let row = |i: u32, columns: usize| {
        let t = f64::from(i) * 2e-3;
        let values = [t, 0.125 * (7.0 * t).sin(), 3.0 * (2.0 * t).cos(), 0.5];
        values[..columns].iter().map(|value| format!("{value:.6}")).collect::<Vec<_>>()
    };
    let text = |seed: u64| {
        let head = heads[usize::try_from(seed % 4).expect("small")];
        let separator = [",", ";", " ", ","][usize::try_from(seed % 4).expect("small")];
        let columns = head.split(separator).count();
        let rows: Vec<String> = (0..40).map(|i| row(i, columns).join(separator)).collect();
        mutated(&format!("{head}\n{}\n", rows.join("\n")), seed)
    };
    let read = |text: &str| {
        let options = LogOptions::default();
        let whole = Log::read(text.as_bytes(), "log.csv", &MassSpringDrag, &options);
        let segments = Recording::read(text.as_bytes(), "log.csv", &MassSpringDrag, &options);
        for said in [whole.as_ref().err(), segments.as_ref().err()].into_iter().flatten() {
            let said = said.to_string();
            assert!(!said.is_empty() && said.chars().count() < 2000, "{said}");
        }
        whole.is_ok()
    };
    assert!(accepted(|seed| (text(seed), Box::new(read))) > 0);
}

#[test]
fn mutated_experiments_are_accepted_or_refused() {
    let models = ["mass_spring_drag", "rotary_pendulum_down", "two_carts"];
    let of = |seed: u64| models[usize::try_from(seed % 3).expect("small")];
    let text = |seed: u64| {
        let path = root().join("models").join(of(seed)).with_extension("toml");
        mutated(&std::fs::read_to_string(path).expect("a shipped experiment"), seed)
    };
    let read = |seed: u64| -> Box<dyn FnOnce(&str) -> bool> {
        let path = root().join("models").join(of(seed)).with_extension("tpm");
        Box::new(move |text: &str| {
            let Ok(experiment) = Experiment::parse(text) else { return false };
            let model = DeclaredModel::open(path).expect("a shipped model");
            let session = Session::new(model, experiment, None, BTreeMap::new());
            session.is_ok_and(|session| session.campaign().is_ok())
        })
    };
    assert!(accepted(|seed| (text(seed), read(seed))) > 0);
}
