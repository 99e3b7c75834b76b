//! `tpm-numerics` alone names the linear-algebra crate, and only the crates that compute with its matrices together show them in their
//! public faces: a program that uses the library meets `Matrix` alone.

use crate::support::root;
use std::fs;
use std::path::{Path, PathBuf};

/// Types of the linear-algebra crate that `tpm-numerics` hands to the other parts of the runtime.
const FOREIGN: [&str; 9] =
    ["DMatrix", "DVector", "DMatrixView", "DVectorView", "RowDVector", "SMatrix", "SVector", "Cholesky", "Dyn"];

/// Crates that hand matrices to each other.
const TOGETHER: [&str; 3] = ["numerics", "motion", "estimate"];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// The sources of the runtime's parts outside `tpm-numerics`, without comments.
fn outside() -> Vec<(PathBuf, String)> {
    let root = root().join("tpm-runtime/crates");
    let mut found = Vec::new();
    sources(&root, &mut found);
    let read = |path: PathBuf| {
        let text = fs::read_to_string(&path).expect("a source");
        let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or(line)).collect();
        (path.strip_prefix(&root).expect("below the root").to_owned(), code.join("\n"))
    };
    found.into_iter().filter(|path| !path.starts_with(root.join("numerics"))).map(read).collect()
}

/// Whether a text holds a name as a whole word.
fn names(text: &str, word: &str) -> bool {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').any(|part| part == word)
}

/// Public fields, and the heads of public items up to their body.
fn public(code: &str) -> Vec<String> {
    let lines: Vec<&str> = code.lines().map(str::trim).collect();
    let items = ["fn", "struct", "enum", "trait", "type", "const", "static", "async", "unsafe"];
    let head = |at: usize| {
        let rest = lines[at].strip_prefix("pub ")?;
        let is_item = rest.split_whitespace().next().is_some_and(|word| items.contains(&word));
        let ends = |line: &&str| line.contains(['{', ';']);
        let length = if is_item { lines[at..].iter().position(ends).unwrap_or(0) } else { 0 };
        Some(lines[at..=at + length].join(" "))
    };
    (0..lines.len()).filter_map(head).collect()
}

#[test]
fn numerics_alone_names_the_linear_algebra_crate() {
    for (path, code) in outside() {
        assert!(!names(&code, "nalgebra"), "{} names nalgebra; take what it needs from tpm_numerics", path.display());
    }
}

#[test]
fn no_public_signature_has_a_type_of_the_linear_algebra_crate() {
    let shown = |path: &Path| !TOGETHER.iter().any(|part| path.starts_with(part));
    let outside = outside().into_iter().filter(|(path, _)| shown(path));
    let public: Vec<_> = outside.map(|(path, code)| (path, public(&code))).collect();
    assert!(public.iter().map(|(_, heads)| heads.len()).sum::<usize>() > 500, "the heads of public items are found");
    for (path, heads) in public {
        for head in heads {
            let foreign = FOREIGN.iter().find(|word| names(&head, word));
            assert!(foreign.is_none(), "{}: `{head}` has {foreign:?}; hand out numerics::Matrix", path.display());
        }
    }
}
