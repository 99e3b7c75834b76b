//! Runs of the tool, and what they print.

#[path = "../../../tests/support/skipped.rs"]
mod skipped;

pub(crate) use skipped::skipped;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// These names of figures, without those of PNG where the tool was built without it.
pub(crate) fn drawn<'a>(names: &[&'a str]) -> Vec<&'a str> {
    let png = tpm_runtime::plot::DRAWS_PNG;
    names.iter().copied().filter(|name| png || !name.ends_with(".png")).collect()
}

/// The workspace's folder.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").to_owned()
}

/// Runs the tool in a folder.
pub(crate) fn tpm_in(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_tpm")).args(arguments).current_dir(folder).output().expect("the tool runs")
}

/// Runs the tool in the workspace's folder.
pub(crate) fn tpm(arguments: &[&str]) -> Output {
    tpm_in(&root(), arguments)
}

/// What the tool prints in a folder, ending with this exit code.
pub(crate) fn printed_in(folder: &Path, arguments: &[&str], code: i32) -> String {
    let output = tpm_in(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
    String::from_utf8(output.stdout).expect("text")
}

/// What the tool prints in the workspace's folder when all is well.
pub(crate) fn printed(arguments: &[&str]) -> String {
    printed_in(&root(), arguments, 0)
}

/// The command fails with this exit code and says all of this on standard error.
pub(crate) fn fails(arguments: &[&str], code: i32, said: &[&str]) {
    let output = tpm(arguments);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
    for part in said {
        assert!(text.contains(part), "{arguments:?}: `{part}` is not in: {text}");
    }
}

/// What a folder holds, sorted.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let mut names: Vec<String> =
        entries.map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A result as JSON, without what says where its runs were played and kept. True values belong to that: only a result of runs that
/// are known to be simulated has them.
pub(crate) fn result_alone(output: &Output) -> serde_json::Value {
    let said = String::from_utf8_lossy(&output.stderr);
    let mut result: serde_json::Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {said}"));
    let fields = result.as_object_mut().expect("an object");
    assert!(fields.remove("source").is_some() && fields.remove("provenance").is_some(), "{fields:?}");
    for list in ["parameters", "physical", "combinations"] {
        for entry in fields[list].as_array_mut().expect("a list") {
            entry.as_object_mut().expect("an object").remove("truth");
        }
    }
    result
}
