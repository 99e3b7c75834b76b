//! Random and mutated models: through everything that a model goes through, and their generated C and Rust against exact rational evaluation.
//!
//! Builds of tests check overflows. `TPM_RANDOM_MODELS` sets how many models are tried, `TPM_RANDOM_SEED` the first of them; a failure
//! names its seed.

mod code;
#[path = "../../../../tests/support/mutated.rs"]
mod mutated;
mod writer;

use crate::support::{models_in, text_of};
use mutated::mutated;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::emit::table;
use tpm_codegen::generate::{Language, Options, generate};
use tpm_codegen::{Source, parse_model};
use tpm_symbolic::budget::{self, Budget, Halted};
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::identifiability::{Experiment, identifiability};
use tpm_symbolic::plan::split::split;
use tpm_symbolic::regressor::prepare::prepare;
use writer::{Kind, Writer};

/// Models of any kind that are tried where nothing else is said.
const MODELS: u64 = 100;

/// The operations that a stage of a model may take, so that many models are tried in a few seconds.
const OPERATIONS: u64 = 20_000_000;

/// How many models are tried, and the first seed.
fn tried(default: u64) -> std::ops::Range<u64> {
    let set = |name: &str, or: u64| std::env::var(name).ok().and_then(|value| value.parse().ok()).unwrap_or(or);
    let first = set("TPM_RANDOM_SEED", 1);
    first..first + set("TPM_RANDOM_MODELS", default)
}

/// How far models went.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    /// Refused by the language.
    refused_text: usize,
    /// Accepted by the language, and refused by a later stage.
    refused_later: usize,
    /// Refused because of the budget.
    halted: usize,
    /// Answered in all stages.
    answered: usize,
}

/// Everything that is done with a model, each stage within a budget of its own.
fn through(text: &str, counts: &mut Counts) {
    let mut budget = Budget::default();
    budget.operations = OPERATIONS;
    let source = Source::new("random.tpm", text);
    let parsed = match budget::run(budget, || parse_model(&source)) {
        Ok(Ok(parsed)) => parsed,
        Ok(Err(diagnostics)) => {
            assert!(!diagnostics.render(&source).is_empty());
            counts.refused_text += 1;
            return;
        }
        Err(_) => {
            counts.halted += 1;
            return;
        }
    };
    let table = || -> Option<()> {
        let (model, _) = parsed.for_tables().ok()?;
        let prepared = prepare(model.into_owned()).ok()?;
        let table = expand(&prepared.model, &prepared.form, prepared.model.patterns.first()?).ok()?;
        for text in [table::markdown(&table), table::csv(&table), table::latex(&table)] {
            assert!(!text.is_empty());
        }
        identifiability(&[Experiment::of("random", &prepared.model, &table)]).ok().map(|_| ())
    };
    let code = || -> Option<()> {
        let estimator = EstimatorSource::of(&parsed).ok()?;
        for language in [Language::Rust, Language::C] {
            let files = generate(&estimator, &Options::new(language, "tpm generate")).ok()?;
            assert!(files.iter().all(|file| !file.text.is_empty()));
        }
        Some(())
    };
    let parts = || split(&parsed.model, &[]).ok().map(|_| ());
    let stages: [Result<Option<()>, Halted>; 3] =
        [budget::run(budget, table), budget::run(budget, code), budget::run(budget, parts)];
    if stages.iter().any(Result::is_err) {
        counts.halted += 1;
    } else if stages.contains(&Ok(None)) {
        counts.refused_later += 1;
    } else {
        counts.answered += 1;
    }
}

#[test]
fn random_models_are_answered_or_refused() {
    let mut counts = Counts::default();
    for seed in tried(MODELS) {
        for kind in [Kind::Any, Kind::Regular] {
            let text = Writer::new(seed, kind).model();
            let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| through(&text, &mut counts)));
            assert!(outcome.is_ok(), "TPM_RANDOM_SEED={seed}:\n{text}");
        }
    }
    crate::c::say(&format!("random models: {counts:?}"));
    assert!(counts.answered > 0 && counts.refused_text > 0, "{counts:?}");
}

#[test]
fn mutated_models_are_answered_or_refused() {
    let names =
        models_in("models").into_iter().map(|path| path.file_stem().expect("a file").to_string_lossy().into_owned());
    let texts: Vec<String> = names.map(|name| text_of(&name)).collect();
    let mut counts = Counts::default();
    for seed in tried(MODELS) {
        let text = mutated(&texts[usize::try_from(seed).expect("small") % texts.len()], seed);
        let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| through(&text, &mut counts)));
        assert!(outcome.is_ok(), "TPM_RANDOM_SEED={seed}:\n{text}");
    }
    crate::c::say(&format!("mutated models: {counts:?}"));
}
