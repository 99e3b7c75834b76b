//! Models by name, and their tables.

#[path = "../../support/skipped.rs"]
mod skipped;

pub(crate) use skipped::skipped;
use std::path::{Path, PathBuf};
use tpm_codegen::source::Source;
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::regressor::prepare::prepare;

/// The workspace's folder.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").to_owned()
}

/// Parses the text of a faultless model.
pub(crate) fn parse(name: &str, text: &str) -> ExactModel {
    let source = Source::new(name, text);
    match tpm_codegen::parse_model(&source) {
        Ok(parsed) => parsed.model,
        Err(diagnostics) => panic!("{}", diagnostics.render(&source)),
    }
}

/// A model of the folder `models`.
pub(crate) fn model(name: &str) -> ExactModel {
    let path = root().join("models").join(format!("{name}.tpm"));
    parse(name, &std::fs::read_to_string(path).expect("a shipped model"))
}

/// The table of a model under its first pattern.
pub(crate) fn expanded(model: &ExactModel) -> HarmonicTable {
    let prepared = prepare(model.clone()).expect("linear in the parameters");
    expand(&prepared.model, &prepared.form, &model.patterns[0]).expect("expands finitely")
}

/// The table of a shipped model under its first pattern.
pub(crate) fn table_of(name: &str) -> HarmonicTable {
    expanded(&model(name))
}
