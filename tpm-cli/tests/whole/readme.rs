//! The READMEs of the workspace and of this crate, and the chapters of the book, are executed: their commands run, and what they print after them is what the
//! commands print.
//!
//! A `sh` block is a list of commands; a `text` block right after it is their standard output, where a line `...` stands
//! for any number of lines; a command may say that it ends with another exit code than 0. A `tpm` block is a model file
//! that must pass `tpm check`. Blocks of Rust are doc tests of the `tests` crate.

use crate::support::{root, skipped, tpm, tpm_in};
use std::path::Path;

#[derive(Debug)]
struct Block {
    readme: &'static str,
    language: String,
    line: usize,
    text: String,
}

fn blocks() -> Vec<Block> {
    ["README.md", "tpm-cli/README.md"].into_iter().flat_map(blocks_of).collect()
}

fn blocks_of(readme: &'static str) -> Vec<Block> {
    let text = std::fs::read_to_string(root().join(readme)).expect("the README");
    let mut blocks = Vec::new();
    let mut open: Option<Block> = None;
    for (i, line) in text.lines().enumerate() {
        match (&mut open, line.strip_prefix("```")) {
            (None, Some(language)) => {
                open = Some(Block { readme, language: language.to_owned(), line: i + 1, text: String::new() });
            }
            (Some(_), Some(_)) => blocks.extend(open.take()),
            (Some(block), None) => {
                block.text.push_str(line);
                block.text.push('\n');
            }
            (None, None) => {}
        }
    }
    blocks
}

/// Whether `actual` is `expected`, with `...` lines standing for any lines.
fn matches(expected: &[&str], actual: &[&str]) -> bool {
    match expected.split_first() {
        None => actual.is_empty(),
        Some((&"...", rest)) => (0..=actual.len()).any(|skip| matches(rest, &actual[skip..])),
        Some((line, rest)) => {
            actual.split_first().is_some_and(|(a, others)| a.trim_end() == line.trim_end() && matches(rest, others))
        }
    }
}

/// Chapters of the book whose commands are executed, each in a folder of its own with the shipped models.
const CHAPTERS: [&str; 9] = [
    "docs/first.md",
    "docs/own_machine.md",
    "docs/log.md",
    "docs/arm.md",
    "docs/controller.md",
    "docs/report.md",
    "docs/what_can_go_wrong.md",
    "docs/editors.md",
    "docs/exit_codes.md",
];

/// Runs the commands of blocks in a folder, and compares what they print with the texts behind them. Returns how many commands ran, and
/// how many did not because they need data that are not here.
fn execute(blocks: &[Block], at: &Path) -> (usize, usize) {
    let (mut commands, mut not_run) = (0, 0);
    for (i, block) in blocks.iter().enumerate().filter(|(_, block)| block.language == "sh") {
        let mut printed = String::new();
        for line in block.text.lines().filter(|line| !line.trim().is_empty()) {
            // This command runs the present test.
            if line == "cargo test --workspace" {
                continue;
            }
            let (command, code) = line.split_once("  # ends with ").unwrap_or((line, "0"));
            let arguments = command
                .strip_prefix("cargo run --release -q -- ")
                .or_else(|| command.strip_prefix("cargo run --release -- "))
                .or_else(|| command.strip_prefix("tpm "))
                .unwrap_or_else(|| panic!("{} line {}: `{line}` is no command of the tool", block.readme, block.line));
            if arguments.contains("$TPM_DATA") && std::env::var_os("TPM_DATA").is_none() {
                not_run += 1;
                continue;
            }
            let data = std::env::var("TPM_DATA").unwrap_or_default();
            let arguments: Vec<String> = arguments.split_whitespace().map(|a| a.replace("$TPM_DATA", &data)).collect();
            let output = tpm_in(at, &arguments.iter().map(String::as_str).collect::<Vec<_>>());
            assert!(
                output.status.code().is_some_and(|ended| ended.to_string() == code.trim()),
                "{} line {}: `{line}` ended otherwise:\n{}",
                block.readme,
                block.line,
                String::from_utf8_lossy(&output.stderr)
            );
            printed.push_str(&String::from_utf8_lossy(&output.stdout));
            commands += 1;
        }
        if let Some(expected) = blocks.get(i + 1).filter(|next| next.language == "text")
            && !printed.is_empty()
        {
            let (expected_lines, actual): (Vec<&str>, Vec<&str>) =
                (expected.text.lines().collect(), printed.lines().collect());
            let (readme, line) = (expected.readme, expected.line);
            assert!(matches(&expected_lines, &actual), "{readme} line {line}: the output is now\n{printed}");
        }
    }
    (commands, not_run)
}

fn note(not_run: usize) {
    if not_run > 0 {
        skipped(&format!("TPM_DATA does not name the folder of the published logs; commands not run: {not_run}"));
    }
}

#[test]
fn commands_print_what_the_readme_says() {
    let (commands, not_run) = execute(&blocks(), &root());
    assert!(commands > 0, "the README has commands");
    note(not_run);
}

#[cfg(unix)]
#[test]
fn commands_of_the_book_print_what_it_says() {
    let summary = std::fs::read_to_string(root().join("docs/SUMMARY.md")).expect("the book's contents");
    let mut missing = 0;
    for chapter in CHAPTERS {
        let name = chapter.trim_start_matches("docs/");
        assert!(summary.contains(&format!("({name})")), "{chapter} is not in the contents");
        let folder = tempfile::tempdir().expect("a folder");
        std::os::unix::fs::symlink(root().join("models"), folder.path().join("models")).expect("the models");
        missing += execute(&blocks_of(chapter), folder.path()).1;
    }
    for file in summary.split(&['(', ')'][..]).filter(|part| Path::new(part).extension().is_some_and(|own| own == "md"))
    {
        assert!(root().join("docs").join(file).exists(), "{file} of the contents is not there");
    }
    note(missing);
}

#[test]
fn models_pass_the_check() {
    let all: Vec<Block> = blocks().into_iter().chain(CHAPTERS.into_iter().flat_map(blocks_of)).collect();
    for block in all.iter().filter(|block| block.language == "tpm") {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("model.tpm");
        std::fs::write(&path, &block.text).expect("writable");
        let output = tpm(&["check", path.to_str().expect("a readable path")]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{} line {}:\n{said}", block.readme, block.line);
    }
}
