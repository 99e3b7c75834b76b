//! Models by name, and their tables.

#[path = "../../support/skipped.rs"]
mod skipped;

use serde_json::Value;
pub(crate) use skipped::skipped;
use std::path::{Path, PathBuf};
use std::process::Command;
use tpm_codegen::source::Source;
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::regressor::prepare::prepare;

/// The workspace's folder.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").to_owned()
}

/// The workspace's packages, as `cargo metadata` describes them.
pub(crate) fn packages() -> Vec<Value> {
    let arguments = ["metadata", "--format-version", "1", "--no-deps", "--offline", "--locked"];
    let output = Command::new(env!("CARGO")).args(arguments).current_dir(root()).output().expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo writes JSON");
    metadata["packages"].as_array().expect("a list of packages").clone()
}

/// The folder of a package.
pub(crate) fn folder_of(package: &Value) -> PathBuf {
    let manifest = Path::new(package["manifest_path"].as_str().expect("a path"));
    manifest.parent().expect("in a folder").to_owned()
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
