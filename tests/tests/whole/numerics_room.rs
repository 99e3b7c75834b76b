//! `numerics/` of the runtime alone names the linear-algebra crate, and no type of that crate leaves the runtime.

use crate::support::root;
use std::fs;
use std::path::{Path, PathBuf};

/// Types of the linear-algebra crate that `numerics/` hands to the rest of the runtime.
const FOREIGN: [&str; 9] =
    ["DMatrix", "DVector", "DMatrixView", "DVectorView", "RowDVector", "SMatrix", "SVector", "Cholesky", "Dyn"];

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

/// The runtime's sources outside `numerics/`, without comments.
fn outside() -> Vec<(PathBuf, String)> {
    let root = root().join("tpm-runtime/src");
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
        assert!(
            !names(&code, "nalgebra"),
            "{} names nalgebra; take what it needs from crate::numerics",
            path.display()
        );
    }
}

#[test]
fn no_public_signature_has_a_type_of_the_linear_algebra_crate() {
    let public: Vec<_> = outside().into_iter().map(|(path, code)| (path, public(&code))).collect();
    assert!(public.iter().map(|(_, heads)| heads.len()).sum::<usize>() > 500, "the heads of public items are found");
    for (path, heads) in public {
        for head in heads {
            let foreign = FOREIGN.iter().find(|word| names(&head, word));
            assert!(foreign.is_none(), "{}: `{head}` has {foreign:?}; hand out numerics::Matrix", path.display());
        }
    }
}
