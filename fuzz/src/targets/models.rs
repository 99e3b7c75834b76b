//! Models: the language, the tables, the generated code.

use super::mutated::{mutated, varied};
use super::random::Random;
use super::random_model::{Kind, Writer};
use super::{MODELS, Verdict, refused, texts};
use std::sync::OnceLock;
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::emit::table;
use tpm_codegen::generate::{Language, Options, Scalar, generate};
use tpm_codegen::{Parsed, Source, parse_model};
use tpm_symbolic::budget::{self, Budget};
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::identifiability::{Experiment, identifiability};
use tpm_symbolic::plan::split::split;
use tpm_symbolic::regressor::prepare::prepare;

/// The longest model whose changes are tried: what is wrong with a long one is wrong with a short one, a thousand times as often.
const LONGEST: usize = 3000;

/// One in so many models gets the budget of the command line, whose end takes a second.
const WHOLE_BUDGETS: usize = 16;

/// The operations of all other models.
const OPERATIONS: u64 = budget::OPERATIONS / 50;

/// Models of the repository.
fn bases() -> &'static [String] {
    static BASES: OnceLock<Vec<String>> = OnceLock::new();
    BASES.get_or_init(|| {
        let all = MODELS.iter().flat_map(|folder| texts(folder, ".tpm"));
        all.map(|(_, text)| text).filter(|text| text.len() < LONGEST).collect()
    })
}

/// A model by the grammar, most of which are right, or one of the repository with other numbers; one in four changed.
pub(super) fn text(random: &mut Random) -> String {
    let seed = random.next();
    match random.below(8) {
        0..=3 => Writer::new(seed, Kind::Regular).model(),
        4 => Writer::new(seed, Kind::Any).model(),
        5 => varied(random.of::<String>(bases()), seed),
        6 => mutated(&Writer::new(seed, Kind::Any).model(), seed),
        _ => mutated(random.of::<String>(bases()), seed),
    }
}

/// Reads a model, and asks something of it, within the budget that the command line gives, or a smaller one.
pub(super) fn within_budget(text: &str, ask: impl FnOnce(&Parsed) -> Result<(), String>) -> Verdict {
    let source = Source::new("random.tpm", text);
    let all = || match parse_model(&source) {
        Ok(parsed) => ask(&parsed),
        Err(diagnostics) => Err(diagnostics.render(&source)),
    };
    let mut budget = Budget::default();
    if !text.len().is_multiple_of(WHOLE_BUDGETS) {
        budget.operations = OPERATIONS;
    }
    match budget::run(budget, all) {
        Ok(Ok(())) => Verdict::Answered,
        Ok(Err(reason)) => refused_model(&reason),
        Err(halted) => {
            refused(&halted);
            Verdict::TooLarge
        }
    }
}

/// Diagnostics quote lines of the model.
fn refused_model(reason: &str) -> Verdict {
    assert!(!reason.trim().is_empty(), "a refusal without a reason");
    Verdict::Refused
}

/// The language alone: text to exact model.
pub(super) fn language(text: &str) -> Verdict {
    within_budget(text, |_| Ok(()))
}

/// The tables of all patterns, what they show, and the parts of the inputs.
pub(super) fn expansion(text: &str) -> Verdict {
    within_budget(text, |parsed| {
        let (model, _) = parsed.for_tables().map_err(|fault| fault.to_string())?;
        let prepared = prepare(model.into_owned()).map_err(|fault| fault.to_string())?;
        for pattern in &prepared.model.patterns {
            let table = expand(&prepared.model, &prepared.form, pattern).map_err(|fault| fault.to_string())?;
            for text in [table::markdown(&table), table::csv(&table), table::latex(&table)] {
                assert!(!text.is_empty(), "a table without a line");
            }
            let experiment = Experiment::of("random", &prepared.model, &table);
            identifiability(&[experiment]).map_err(|fault| fault.to_string())?;
        }
        split(&parsed.model, &[]).map(|_| ()).map_err(|fault| fault.to_string())
    })
}

/// Estimators in Rust and C.
pub(super) fn generation(text: &str) -> Verdict {
    within_budget(text, |parsed| {
        let estimator = EstimatorSource::of(parsed).map_err(|fault| fault.headline())?;
        let options = [
            Options::new(Language::Rust, "tpm generate"),
            Options::new(Language::C, "tpm generate"),
            Options { scalar: Scalar::Float, prefix: Some("own"), ..Options::new(Language::C, "tpm generate") },
        ];
        for options in options {
            let files = generate(&estimator, &options).map_err(|fault| fault.to_string())?;
            assert!(files.iter().all(|file| !file.text.is_empty()), "an empty file");
        }
        Ok(())
    })
}
