//! Random and mutated texts for everything that reads files: a few seeds of every target of the folder `fuzz`, and all kept texts. Each
//! is answered or refused, and nothing panics. Builds of tests check overflows.
//!
//! `TPM_FUZZ_SEEDS` sets how many seeds are tried, `TPM_FUZZ_FIRST` the first of them; `.ci/fuzz` tries millions.

#[path = "../../../fuzz/src/targets/mod.rs"]
mod targets;

use crate::support::skipped;
use std::panic::{AssertUnwindSafe, catch_unwind};
use targets::{TARGETS, Verdict};

/// Seeds of each target that are tried where nothing else is said.
const SEEDS: u64 = 60;

/// Seeds of the target whose executions start a compiler.
const COMPILED_SEEDS: u64 = 12;

/// Tries the kept texts and the seeds of a target, of which some must be answered and some refused.
fn try_target(name: &str) {
    let is_compiled = name == "compiled";
    if is_compiled && !targets::compiled::can_compile() {
        return skipped("no C compiler (tcc, cc, gcc, clang) was found, so that generated C was not run");
    }
    let target = TARGETS.iter().find(|target| target.name == name).expect("a target");
    let set = |name: &str, or: u64| std::env::var(name).ok().and_then(|value| value.parse().ok()).unwrap_or(or);
    let first = set("TPM_FUZZ_FIRST", 1);
    let seeds = first..first + set("TPM_FUZZ_SEEDS", if is_compiled { COMPILED_SEEDS } else { SEEDS });
    let kept = target.kept().into_iter().map(|(path, text)| (path.display().to_string(), text));
    let written = seeds.map(|seed| (format!("TPM_FUZZ_FIRST={seed}"), target.text(seed)));
    let mut verdicts = Vec::new();
    for (what, text) in kept.chain(written) {
        let verdict = catch_unwind(AssertUnwindSafe(|| (target.read)(&text)));
        verdicts.push(verdict.unwrap_or_else(|_| panic!("{name}, {what}:\n{text}")));
    }
    for one in [Verdict::Answered, Verdict::Refused] {
        assert!(verdicts.contains(&one), "{name}: none of {} texts was {one:?}", verdicts.len());
    }
}

macro_rules! targets {
    ($($name:ident),*) => {$(
        #[test]
        fn $name() {
            try_target(stringify!($name));
        }
    )*
        #[test]
        fn no_target_is_left_out() {
            assert_eq!(TARGETS.map(|target| target.name), [$(stringify!($name)),*]);
        }
    };
}
targets!(
    language,
    expansion,
    generation,
    log,
    identification,
    experiment,
    motors,
    parameters,
    manifests,
    play,
    linear,
    regulator,
    strokes,
    description,
    editor,
    machine_runs,
    machine_samples,
    results,
    valid_experiment,
    proposals,
    projection,
    path,
    stored,
    forces,
    nonlinear,
    compiled
);
