//! Models and estimators that the tests of emitted code share.

pub(crate) mod exact;
#[path = "../../../../tests/support/skipped.rs"]
mod skipped;

pub(crate) use skipped::skipped;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_codegen::{Parsed, Source, parse_model};

/// The workspace's folder.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").to_owned()
}

/// The models of a folder, in the order of their names.
pub(crate) fn models_in(folder: &str) -> BTreeSet<PathBuf> {
    let entries = std::fs::read_dir(root().join(folder)).expect("a folder of the project");
    let paths = entries.map(|entry| entry.expect("readable").path());
    paths.filter(|path| path.extension().is_some_and(|kind| kind == "tpm")).collect()
}

/// The estimator of a model file, from which source code is written.
pub(crate) fn estimator(path: &Path) -> EstimatorSource {
    let name = path.file_name().expect("a file").to_string_lossy().into_owned();
    let source = Source::from_bytes(name.as_str(), std::fs::read(path).expect("a model file"));
    let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
    EstimatorSource::of(&parsed).unwrap_or_else(|fault| panic!("{}", fault.message))
}

/// Parses the text of a faultless model.
pub(crate) fn parse(text: &str) -> Parsed {
    let source = Source::new("test", text);
    parse_model(&source).unwrap_or_else(|errors| panic!("{}", errors.render(&source)))
}

/// The text of a shipped model.
pub(crate) fn text_of(name: &str) -> String {
    std::fs::read_to_string(root().join("models").join(name).with_extension("tpm")).expect("a shipped model")
}
