//! The examples of the crates are short, and run.

use crate::support::root;
use serde_json::Value;
use std::path::PathBuf;
use std::process::Command;

/// Most lines of an example that stands in one file.
const MOST_LINES: usize = 40;

/// The examples of all packages that stand in one file.
fn examples() -> Vec<PathBuf> {
    let entries = |folder: PathBuf| std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let in_packages = entries(root()).flat_map(|package| entries(package.join("examples")));
    let mut files: Vec<PathBuf> =
        in_packages.filter(|path| path.extension().is_some_and(|extension| extension == "rs")).collect();
    files.sort();
    files
}

#[test]
fn examples_run() {
    let examples = examples();
    assert!(examples.len() >= 2, "{examples:?}");
    // Built as the tests of the workspace were, so that there is nothing left to compile.
    let mut build = Command::new(env!("CARGO"));
    build.args(["build", "--workspace", "--offline", "--locked", "--message-format", "json"]).current_dir(root());
    for example in &examples {
        build.arg("--example").arg(example.file_stem().expect("a file"));
    }
    // Programs of the release profile lie in a folder of this name.
    let tests = std::env::current_exe().expect("a program has a path");
    if tests.ancestors().nth(2).is_some_and(|folder| folder.ends_with("release")) {
        build.arg("--release");
    }
    let built = build.output().expect("cargo runs");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let messages: Vec<Value> =
        built.stdout.split(|&byte| byte == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
    for example in &examples {
        let path = example.to_str().expect("a readable path");
        let program = messages.iter().find(|message| message["target"]["src_path"] == path);
        let program = program.and_then(|message| message["executable"].as_str()).expect("cargo names what it built");
        let run = Command::new(program).output().expect("it was built");
        let (printed, said) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
        assert!(run.status.success() && !printed.is_empty(), "{path}: {printed}{said}");
        if path.ends_with("controller_loop.rs") {
            assert_eq!(printed, "m = 2.000 kg, d = 5.000 N*s/m\n");
        }
    }
}

#[test]
fn examples_are_short() {
    for path in examples() {
        let lines = std::fs::read_to_string(&path).expect("readable").lines().count();
        assert!(lines < MOST_LINES, "{} has {lines} lines", path.display());
    }
}
