//! The READMEs of the workspace and of this crate, and the pages of the book, are executed: their commands run, and what they print after
//! them is what the commands print.
//!
//! A `sh` block is a list of commands; a `text` block right after it is their standard output, where a line `...` stands
//! for any number of lines; a command may say that it ends with another exit code than 0. As in a shell, a command that ends in `< FILE`
//! reads that file, and of one that ends in `2>&1` what it says on standard error counts, too. A `tpm` block is a model file that must pass
//! `tpm check`. A block with a name behind its language, such as `xml arm.urdf`, is a file that the commands of its page
//! find in their folder. Blocks of Rust are doc tests of the `tests` crate.

use crate::support::{printed, root, skipped, tpm};
use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};

/// A fenced block of a page.
#[derive(Debug)]
struct Block {
    page: String,
    language: String,
    /// The name of the file that the block is.
    file: Option<String>,
    line: usize,
    text: String,
}

/// Pages of the book with commands that others execute: `tpm-python/check.sh`, `.ci/release`.
const ELSEWHERE: [&str; 2] = ["docs/python.md", "docs/page.md"];

/// The README's commands for the main job and for the tests.
const MAIN_JOB: &str = "cargo run --release -- identify models/mass_spring_drag.tpm";
const TESTS: &str = "cargo test --workspace";

/// The page of the book with the robot description that the README's commands read.
const ARM: &str = "docs/arm.md";

fn read(page: &str) -> String {
    std::fs::read_to_string(root().join(page)).unwrap_or_else(|error| panic!("{page}: {error}"))
}

/// The lines of a text that are in no fenced block.
fn prose(text: &str) -> impl Iterator<Item = &str> {
    let mut fenced = false;
    text.lines().filter(move |line| {
        let fence = line.starts_with("```");
        fenced ^= fence;
        !fenced && !fence
    })
}

/// The targets of a text's links and pictures.
fn links(text: &str) -> Vec<&str> {
    let parts = prose(text).flat_map(|line| line.split("](").skip(1));
    parts.filter_map(|rest| rest.split_once(')')).map(|(target, _)| target).collect()
}

/// The anchor of a heading.
fn anchor(heading: &str) -> String {
    let heading = heading.trim_start_matches('#').trim().to_lowercase().replace(' ', "-");
    heading.chars().filter(|c| c.is_alphanumeric() || "-_".contains(*c)).collect()
}

/// The anchors of a text's headings.
fn anchors(text: &str) -> BTreeSet<String> {
    prose(text).filter(|line| line.starts_with('#')).map(anchor).collect()
}

/// The pages of the book in the order of its contents.
fn pages() -> Vec<String> {
    links(&read("docs/SUMMARY.md")).into_iter().map(|page| format!("docs/{page}")).collect()
}

/// The pages of the book whose commands are executed here.
fn chapters() -> Vec<String> {
    pages().into_iter().filter(|page| !ELSEWHERE.contains(&page.as_str())).collect()
}

fn readmes() -> Vec<Block> {
    ["README.md", "tpm-cli/README.md"].into_iter().flat_map(blocks_of).collect()
}

fn blocks_of(page: &str) -> Vec<Block> {
    let text = read(page);
    let mut blocks = Vec::new();
    let mut open: Option<Block> = None;
    for (i, line) in text.lines().enumerate() {
        match (&mut open, line.strip_prefix("```")) {
            (None, Some(said)) => {
                let (language, file) = match said.split_once(' ') {
                    Some((language, file)) => (language, Some(file.to_owned())),
                    None => (said, None),
                };
                open = Some(Block {
                    page: page.to_owned(),
                    language: language.to_owned(),
                    file,
                    line: i + 1,
                    text: String::new(),
                });
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

/// A folder with the shipped models, examples and generated sources, in which commands may write.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for shared in ["models", "examples", "tests/generated"] {
        copy(&root().join(shared), &folder.path().join(shared));
    }
    folder
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("a folder") {
        let entry = entry.expect("readable");
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if from.is_dir() {
            copy(&from, &to);
        } else {
            std::fs::copy(&from, &to).expect("writable");
        }
    }
}

/// Writes the blocks that are files into a folder.
fn write_files(blocks: &[Block], at: &Path) {
    for block in blocks {
        if let Some(file) = &block.file {
            std::fs::write(at.join(file), &block.text).expect("writable");
        }
    }
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

/// The words of a command, which stand between blanks or in double quotes.
fn words(command: &str) -> Vec<String> {
    let mut words = Vec::new();
    for (i, part) in command.split('"').enumerate() {
        if i % 2 == 1 {
            words.push(part.to_owned());
        } else {
            words.extend(part.split_whitespace().map(str::to_owned));
        }
    }
    words
}

/// Whether the data or the programs that a command needs are here.
fn can_run(command: &str) -> bool {
    let python = || Command::new("python3").arg("--version").output().is_ok_and(|output| output.status.success());
    (!command.contains("$TPM_DATA") || std::env::var_os("TPM_DATA").is_some())
        && (!command.contains("python3") || python())
}

/// Runs the tool in a folder, with a file as its standard input where one is named.
fn run(at: &Path, arguments: &[String], input: Option<&str>) -> Output {
    let input = input.map_or_else(Stdio::null, |file| std::fs::File::open(at.join(file)).expect("a file").into());
    let mut tool = Command::new(env!("CARGO_BIN_EXE_tpm"));
    tool.args(arguments).current_dir(at).stdin(input).output().expect("the tool runs")
}

/// Runs the commands of blocks in a folder, and compares what they print with the texts behind them. Returns how many commands ran, and
/// how many did not because they need data or programs that are not here.
fn execute(blocks: &[Block], at: &Path) -> (usize, usize) {
    write_files(blocks, at);
    let (mut commands, mut not_run) = (0, 0);
    for (i, block) in blocks.iter().enumerate().filter(|(_, block)| block.language == "sh") {
        let mut printed = String::new();
        let mut complete = true;
        for line in block.text.lines().filter(|line| !line.trim().is_empty()) {
            // The program that is tested is built already, by the command that runs this test.
            if ["cargo install --path tpm-cli", TESTS].contains(&line) {
                continue;
            }
            let (command, code) = line.split_once("  # ends with ").unwrap_or((line, "0"));
            let arguments = command
                .strip_prefix("cargo run --release -q -- ")
                .or_else(|| command.strip_prefix("cargo run --release -- "))
                .or_else(|| command.strip_prefix("tpm "))
                .unwrap_or_else(|| panic!("{} line {}: `{line}` is no command of the tool", block.page, block.line));
            if !can_run(arguments) {
                (complete, not_run) = (false, not_run + 1);
                continue;
            }
            let (arguments, both) = arguments.split_once(" 2>&1").map_or((arguments, false), |(own, _)| (own, true));
            let (arguments, input) =
                arguments.split_once(" < ").map_or((arguments, None), |(own, file)| (own, Some(file)));
            let data = std::env::var("TPM_DATA").unwrap_or_default();
            let arguments: Vec<String> = words(arguments).iter().map(|word| word.replace("$TPM_DATA", &data)).collect();
            let output = run(at, &arguments, input);
            assert!(
                output.status.code().is_some_and(|ended| ended.to_string() == code.trim()),
                "{} line {}: `{line}` ended otherwise:\n{}",
                block.page,
                block.line,
                String::from_utf8_lossy(&output.stderr)
            );
            printed.push_str(&String::from_utf8_lossy(&output.stdout));
            printed.push_str(&String::from_utf8_lossy(if both { &output.stderr } else { &[] }));
            commands += 1;
        }
        if let Some(expected) = blocks.get(i + 1).filter(|next| next.language == "text")
            && complete
        {
            let (expected_lines, actual): (Vec<&str>, Vec<&str>) =
                (expected.text.lines().collect(), printed.lines().collect());
            let (page, line) = (&expected.page, expected.line);
            assert!(matches(&expected_lines, &actual), "{page} line {line}: the output is now\n{printed}");
        }
    }
    (commands, not_run)
}

fn note(not_run: usize) {
    if not_run > 0 {
        skipped(&format!("no published logs in TPM_DATA, or no python3; commands not run: {not_run}"));
    }
}

#[test]
fn commands_print_what_the_readme_says() {
    let folder = folder();
    write_files(&blocks_of(ARM), folder.path());
    let (commands, not_run) = execute(&readmes(), folder.path());
    assert!(commands > 0, "the README has commands");
    note(not_run);
}

/// Whoever opens the README is told how to do the main job and how to test it before anything else, and how long both take.
#[test]
fn the_readme_begins_with_the_main_job_and_the_tests() {
    let blocks = blocks_of("README.md");
    let first = blocks.iter().filter(|block| block.language == "sh").map(|block| block.text.trim()).take(2);
    assert_eq!(first.collect::<Vec<_>>(), [MAIN_JOB, TESTS]);
    let readme = read("README.md");
    let before = |command: &str| readme.split_once(&format!("```sh\n{command}\n```")).expect("a block of its own").0;
    for command in [MAIN_JOB, TESTS] {
        let said = before(command).trim_end().rsplit("\n\n").next().expect("a paragraph");
        assert!(said.contains("minutes"), "`{command}` is said to take no time: {said}");
    }
}

#[test]
fn commands_of_the_book_print_what_it_says() {
    // Chapters share nothing, and take long one after the other.
    let (chapters, next) = (chapters(), AtomicUsize::new(0));
    let some = || {
        let mine = std::iter::from_fn(|| chapters.get(next.fetch_add(1, Ordering::Relaxed)));
        mine.map(|chapter| execute(&blocks_of(chapter), folder().path()).1).sum::<usize>()
    };
    note(std::thread::scope(|scope| {
        let others: Vec<_> = (0..2).map(|_| scope.spawn(some)).collect();
        others.into_iter().map(|other| other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))).sum()
    }));
}

#[test]
fn models_pass_the_check() {
    let all: Vec<Block> =
        readmes().into_iter().chain(chapters().iter().flat_map(|chapter| blocks_of(chapter))).collect();
    for block in all.iter().filter(|block| block.language == "tpm") {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("model.tpm");
        std::fs::write(&path, &block.text).expect("writable");
        let output = tpm(&["check", path.to_str().expect("a readable path")]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{} line {}:\n{said}", block.page, block.line);
    }
}

#[test]
fn rust_of_the_readme_and_the_book_is_tested() {
    let tested = read("tests/src/lib.rs");
    for page in pages().into_iter().chain(["README.md".to_owned()]) {
        if let Some(block) = blocks_of(&page).iter().find(|block| block.language.starts_with("rust")) {
            let included = format!("include_str!(\"../../{page}\")");
            assert!(tested.contains(&included), "{page} line {}: tests/src/lib.rs has no {included}", block.line);
        }
    }
}

#[test]
fn the_contents_of_the_book_list_every_page_once() {
    let mut listed = pages();
    listed.sort();
    let entries = std::fs::read_dir(root().join("docs")).expect("the book");
    let names = entries.map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned());
    let mut there: Vec<String> = names
        .filter(|name| name != "SUMMARY.md" && Path::new(name).extension().is_some_and(|own| own == "md"))
        .map(|name| format!("docs/{name}"))
        .collect();
    there.sort();
    assert_eq!(listed, there);
}

#[test]
fn every_verb_has_one_section_in_the_book_with_a_command_and_its_output() {
    let help = printed(&["--help"]);
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let verbs: Vec<&str> = listed.filter_map(|line| line.split_whitespace().next()).collect();
    assert!(verbs.contains(&"identify"), "{help}");
    let texts: Vec<(String, String)> = pages().into_iter().map(|page| (read(&page), page)).collect();
    for verb in verbs.into_iter().filter(|verb| *verb != "help") {
        let heading = format!("## tpm {verb}");
        let having = texts.iter().filter(|(text, _)| prose(text).any(|line| line == heading));
        let having: Vec<&str> = having.map(|(_, page)| page.as_str()).collect();
        let [page] = having[..] else { panic!("pages with the heading `{heading}`: {having:?}") };
        let text = read(page);
        let at = |line: usize| text.lines().take(line).filter(|line| line.starts_with("## ")).last();
        let blocks = blocks_of(page);
        let shown = blocks.windows(2).any(|pair| {
            let called = pair[0].text.lines().any(|line| line.starts_with(&format!("tpm {verb}")));
            at(pair[0].line) == Some(heading.as_str())
                && pair[0].language == "sh"
                && called
                && pair[1].language == "text"
        });
        assert!(shown, "{page}: the section `{heading}` has no command `tpm {verb}` with its output");
    }
}

#[test]
fn links_lead_to_files_and_headings() {
    let others = ["README.md", "ARCHITECTURE.md", "docs/SUMMARY.md", "models/README.md", "benches/README.md"];
    for page in pages().into_iter().chain(others.map(str::to_owned)) {
        let text = read(&page);
        for link in links(&text).into_iter().filter(|link| !link.contains("://")) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let from = root().join(&page);
            let target = if file.is_empty() { from } else { from.parent().expect("a folder").join(file) };
            assert!(target.exists(), "{page}: {link} is not there");
            if !anchor.is_empty() {
                let text = std::fs::read_to_string(&target).unwrap_or_else(|error| panic!("{page}: {link}: {error}"));
                assert!(anchors(&text).contains(anchor), "{page}: {link} has no such heading");
            }
        }
    }
}

#[test]
fn the_readme_is_short_and_its_figures_are_those_of_the_book() {
    let readme = read("README.md");
    assert!(readme.lines().count() < 200, "what is longer belongs to the book");
    let honesty = read("docs/honesty.md");
    let measured: BTreeSet<&str> = honesty.split(|c: char| c.is_whitespace() || "|:();,".contains(c)).collect();
    let heading = "## Why its numbers can be believed";
    let section = prose(&readme).skip_while(|line| *line != heading).skip(1).take_while(|line| !line.starts_with('#'));
    let rows: Vec<&str> = section.filter(|line| line.starts_with('|')).collect();
    assert!(rows.len() > 3, "{heading}: {rows:?}");
    for figure in rows.iter().flat_map(|row| row.split(|c: char| c.is_whitespace() || "|:();,".contains(c))) {
        if figure.parse::<f64>().is_ok() {
            assert!(measured.contains(figure), "{heading}: {figure} is not in docs/honesty.md");
        }
    }
}
