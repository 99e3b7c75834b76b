//! The layout of models: it changes blanks and ends of lines only, changes nothing a second time, and leaves what is shipped as it is.

use crate::random_model::{Kind, Writer};
use std::path::{Path, PathBuf};
use tpm_codegen::language::{self, ast::ModelDeclaration};
use tpm_codegen::source::Source;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// All model files below a folder, and their texts.
fn models_below(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(models_below(&path));
        } else if path.extension().is_some_and(|own| own == "tpm")
            && let Ok(text) = std::fs::read_to_string(&path)
        {
            found.push((path, text));
        }
    }
    found
}

fn parsed(text: &str) -> Option<ModelDeclaration> {
    let mut model = language::parse(&Source::new("model.tpm", text)).ok()?;
    model.forget_spans();
    Some(model)
}

fn formatted(text: &str) -> String {
    let source = Source::new("model.tpm", text);
    language::format(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)))
}

/// What stands behind `//` on the lines of a text.
fn comments(text: &str) -> Vec<&str> {
    text.lines().filter_map(|line| line.split_once("//")).map(|(_, comment)| comment.trim_end()).collect()
}

/// The text is laid out, says the same, and is not changed again. Whether it could be: a text with faults is refused.
fn is_kept(name: &str, text: &str) -> bool {
    let Some(before) = parsed(text) else {
        assert!(language::format(&Source::new("model.tpm", text)).is_err(), "{name}: a text with faults was laid out");
        return false;
    };
    let once = formatted(text);
    assert!(parsed(&once).as_ref() == Some(&before), "{name} says something else:\n{once}");
    assert_eq!(comments(text), comments(&once), "{name}: the comments");
    assert_eq!(formatted(&once), once, "{name} is changed a second time");
    assert_eq!(once.contains('\r'), text.contains("\r\n"), "{name}: the ends of its lines");
    assert!(
        once.ends_with('\n') && !once.lines().any(|line| line.ends_with(' ')),
        "{name}: blanks at the end of a line"
    );
    true
}

/// The text without its layout: every run of blanks outside comments is another one, or an end of line.
fn shaken(text: &str, seed: u64) -> String {
    let mut random = crate::random::Random(seed);
    let mut shaken = String::new();
    for line in text.lines() {
        let (code, comment) = line.split_once("//").map_or((line, None), |(code, comment)| (code, Some(comment)));
        let mut letters = code.chars().peekable();
        while let Some(letter) = letters.next() {
            // Signs are left alone: one of them may be that of an exponent.
            let between = letter == ' ' || "*/^=,;()[]{}".contains(letter);
            if letter != ' ' {
                shaken.push(letter);
            }
            if between && letters.peek() != Some(&' ') {
                shaken.push_str(random.of::<&str>(&[" ", " ", "  ", "\n", "\t", " \n\n\n", " // between\n"]));
            }
        }
        if let Some(comment) = comment {
            shaken.push_str("//");
            shaken.push_str(comment);
        }
        shaken.push_str(random.of::<&str>(&["\n", "\n\n", "\r\n"]));
    }
    shaken
}

#[test]
fn every_model_says_the_same_and_is_changed_only_once() {
    let mut laid_out = 0;
    for folder in ["models", "fuzz/corpus/models", "tests/fixtures", "tpm-cli/src", "benches"] {
        for (path, text) in models_below(&root().join(folder)) {
            let name = path.display().to_string();
            if is_kept(&name, &text) {
                laid_out += 1;
                for seed in 0..8 {
                    assert!(
                        is_kept(&format!("{name}, shaken by {seed}"), &shaken(&text, seed)),
                        "{name}, shaken by {seed}"
                    );
                }
                assert!(is_kept(&name, &text.replace('\n', "\r\n")));
            }
        }
    }
    assert!(laid_out > 30, "{laid_out} models");
}

#[test]
fn random_models_say_the_same_and_are_changed_only_once() {
    let mut laid_out = 0;
    for seed in 0..600 {
        let kind = if seed % 2 == 0 { Kind::Regular } else { Kind::Any };
        let text = Writer::new(seed, kind).model();
        let text = if seed % 3 == 0 { shaken(&text, seed) } else { text };
        laid_out += usize::from(is_kept(&format!("seed {seed}"), &text));
    }
    assert!(laid_out > 300, "{laid_out} models");
}

#[test]
fn shipped_models_are_laid_out() {
    for (path, text) in models_below(&root().join("models")) {
        assert!(formatted(&text) == text, "{}: `tpm fmt` changes it to\n{}", path.display(), formatted(&text));
    }
}

#[test]
fn layout_is_what_the_rules_say() {
    for (rough, smooth) in [
        // Words before an operand are no operands, and quantities with their names are.
        (
            "model M{mechanism{gravity(0,0,- 9.81);body\na{fixed at(0,0,1)turned(0,- pi/2,0);}}mass - 3*from -at*y+mass ^ 2* - x = u;}",
            "model M {\n    mechanism {\n        gravity (0, 0, -9.81);\n        body a { fixed at (0, 0, 1) turned (0, -pi/2, 0); }\n    }\n    mass - 3*from - at*y + mass^2*-x = u;\n}\n",
        ),
        // An operator begins a line, below the equals sign; lines in brackets begin behind the bracket.
        ("model M {\n kinetic = a +\n b*(c\n - d,\n e);\n x\n + y =\n u;;\n ;\n}", ""),
        (
            "model M {\n kinetic = a +\n b*(c\n - d);\n x\n + y =\n u;;\n ;\n}",
            "model M {\n    kinetic = a\n            + b*(c\n                 - d);\n    x\n        + y =\n        u;\n}\n",
        ),
        // Comments: one that goes on, one of its own, one inside a statement, one behind a brace.
        (
            "model M { // m\n\n  x = u; // a\n         // b\n  // c\n\n\n  y // d\n  // e\n  = u;\n\n  // f\n}\n// g",
            "model M {                                            // m\n    x = u;                                           // a\n                                                     // b\n    // c\n\n    y                                                // d\n        // e\n        = u;\n\n    // f\n}\n// g\n",
        ),
    ] {
        let source = Source::new("model.tpm", rough);
        assert_eq!(language::format(&source).unwrap_or_default(), smooth, "{rough}");
    }
    // What is too wide is broken where it is nested least.
    let long: Vec<String> = (0..30).map(|i| format!("parameter_{i}*f(x, {i})")).collect();
    let text = formatted(&format!("model M {{ {} = u; pattern {{ x = a; }} }}", long.join(" + ")));
    assert!(text.lines().all(|line| line.len() <= 120), "{text}");
    assert!(text.lines().skip(2).take(4).all(|line| line.starts_with("        + parameter_")), "{text}");
    assert!(text.ends_with("\n    pattern { x = a; }\n}\n"), "{text}");
}
