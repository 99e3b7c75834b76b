//! `tpm explain` and `tpm schema`: what the words of the model language and the fields of the files mean.

use crate::failure::{Failure, Outcome};
use crate::output::file;
use clap::ValueEnum;
use serde_json::Value;
use std::path::PathBuf;
use tpm_codegen::language::function::Function;
use tpm_codegen::language::keywords::KEYWORDS;
use tpm_codegen::language::reference::{EXAMPLES, Explained, explained};
use tpm_runtime::experiment::Experiment;
use tpm_runtime::motion::RunFile;
use tpm_runtime::plant::actuator::motor_schema;
use tpm_runtime::report::{Align, FieldText, TextTable, fields};

/// Width of a page of the book, in characters.
const WIDTH: usize = 120;

/// Options of `tpm explain`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A word or function of the model language such as `nonlinear` or `sign`; a field such as `noise` or `control.feedback.kp`, or a table
    /// with all its fields. A list of them all when not given.
    key: Option<String>,
    /// In files of this kind only.
    #[arg(long, value_enum, value_name = "KIND")]
    file: Option<FileKind>,
}

/// Options of `tpm schema`.
#[derive(clap::Args)]
pub(crate) struct SchemaArgs {
    /// The kind of file.
    #[arg(value_enum)]
    kind: FileKind,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// A kind of file with fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FileKind {
    /// An experiment (TOML).
    Experiment,
    /// Motors (TOML).
    Motors,
    /// The terms of a run that is to be played (JSON).
    Run,
}

impl FileKind {
    const ALL: [FileKind; 3] = [FileKind::Experiment, FileKind::Motors, FileKind::Run];

    const fn name(self) -> &'static str {
        match self {
            FileKind::Experiment => "experiment",
            FileKind::Motors => "motors",
            FileKind::Run => "run",
        }
    }

    fn schema(self) -> Value {
        match self {
            FileKind::Experiment => Experiment::schema(),
            FileKind::Motors => motor_schema(),
            FileKind::Run => RunFile::schema(),
        }
    }
}

/// Prints the JSON schema of a kind of file.
pub(crate) fn schema(args: &SchemaArgs) -> Outcome {
    file::emit(args.output.as_deref(), &file::json(&args.kind.schema())?)
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let kinds = FileKind::ALL.into_iter().filter(|kind| args.file.is_none_or(|asked| asked == *kind));
    let all: Vec<(FileKind, Vec<FieldText>)> = kinds.map(|kind| (kind, fields(&kind.schema()))).collect();
    let Some(key) = args.key.as_deref() else {
        let language = if args.file.is_none() { words() } else { String::new() };
        return file::print(&format!("{language}{}", list(&all)));
    };
    let word = explained(key).filter(|_| args.file.is_none());
    let mut text = word.map_or(String::new(), |found| of_language(key, &found));
    for (kind, own) in &all {
        let found: Vec<&FieldText> = own.iter().filter(|field| is_meant(key, &field.path)).collect();
        for field in &found {
            text.push_str(&describe(*kind, field));
            let inside = format!("{}.", field.path);
            for part in own.iter().filter(|other| other.path.starts_with(&inside)) {
                text.push_str(&format!("  {}: {}\n", part.path, sentence(&part.meaning)));
            }
            text.push('\n');
        }
    }
    if text.is_empty() {
        return Err(Failure::Input(unknown(key, &all)));
    }
    file::print(&format!("{}\n", text.trim_end()))
}

/// A word of the language with a model that shows it.
fn of_language(word: &str, found: &Explained) -> String {
    let example: String =
        found.example.text.lines().map(|line| format!("    {line}").trim_end().to_owned() + "\n").collect();
    format!(
        "{word} (model language): {}\n  {}\n  Example, a whole model:\n\n{example}\n",
        found.usage,
        sentence_case(found.meaning)
    )
}

/// A meaning as a sentence.
fn sentence_case(meaning: &str) -> String {
    let mut letters = meaning.chars();
    letters.next().map(|first| first.to_uppercase().to_string() + letters.as_str() + ".").unwrap_or_default()
}

/// The words and functions of the model language.
fn words() -> String {
    let mut table = TextTable::new(&[("model language", Align::Left), ("", Align::Left), ("meaning", Align::Left)]);
    for (word, usage, meaning) in KEYWORDS {
        table.row(&[word.to_owned(), usage.to_owned(), meaning.to_owned()]);
    }
    for function in Function::ALL {
        table.row(&[function.name().to_owned(), function.usage().to_owned(), function.meaning().to_owned()]);
    }
    format!("{}\n", table.finish())
}

/// Prints the reference of the model language, a page of the book.
pub(crate) fn language() -> Outcome {
    let mut page = String::from(
        "# The language\n\nWritten by `tpm language`; a test compares this page with what the program says, and every model on it passes \
         `tpm check`.\n`tpm explain WORD` says what a word means, with a model that shows it.\n",
    );
    for example in &EXAMPLES {
        page.push_str(&format!("\n## {}\n\n```tpm\n{}```\n", example.title, example.text));
    }
    page.push_str("\n## All words\n\n| word | written | meaning |\n|---|---|---|\n");
    for (word, usage, meaning) in KEYWORDS {
        page.push_str(&format!("| `{word}` | `{usage}` | {meaning} |\n"));
    }
    page.push_str("\n## All functions\n\n| function | meaning |\n|---|---|\n");
    for function in Function::ALL {
        page.push_str(&format!("| `{}` | {} |\n", function.usage(), function.meaning()));
    }
    page.push_str(
        "\n## Units\n\nIn brackets behind a name, as products of powers: `[kg*m^2/s]`, `[N/(m/s)^2]`, and `[m^(5/2)/s]` where a root is taken, \
         as of the level of a\ntank or the pressure across a valve. Values are never converted silently; sums of different quantities are \
         faults. These names are known,\nthose of the SI with its prefixes too:\n\n",
    );
    let mut line = String::new();
    for name in tpm_units::names() {
        let word = format!("`{name}` ");
        if line.chars().count() + word.chars().count() > WIDTH {
            page.push_str(&format!("{}\n", line.trim_end()));
            line.clear();
        }
        line.push_str(&word);
    }
    page.push_str(&format!("{}\n", line.trim_end()));
    file::print(&page)
}

/// Whether a key is the path of a field or its last parts; names that the user chooses fit any name.
fn is_meant(key: &str, path: &str) -> bool {
    let (key, path): (Vec<&str>, Vec<&str>) = (key.split('.').collect(), path.split('.').collect());
    let end = path.len().checked_sub(key.len()).map(|from| &path[from..]);
    end.is_some_and(|end| {
        let fits = |(own, part): (&&str, &&str)| own == part || *part == "NAME";
        key.iter().zip(end).all(fits) && key.last() == end.last()
    })
}

/// The first sentence of a meaning.
fn sentence(meaning: &str) -> &str {
    meaning.split_once(". ").map_or(meaning, |(first, _)| first).trim_end_matches('.')
}

fn describe(kind: FileKind, field: &FieldText) -> String {
    let need = match (&field.default, field.required) {
        (_, true) => "; must be given".to_owned(),
        (Some(default), false) => format!("; {default} when not given"),
        (None, false) => String::new(),
    };
    let mut text = format!("{} ({} file): {}{need}\n  {}\n", field.path, kind.name(), field.kind, field.meaning);
    for (word, meaning) in &field.choices {
        text.push_str(&format!("  {word}: {}\n", sentence(meaning)));
    }
    text
}

fn list(all: &[(FileKind, Vec<FieldText>)]) -> String {
    let mut text = String::new();
    for (kind, own) in all {
        let mut table = TextTable::new(&[(kind.name(), Align::Left), ("", Align::Left), ("meaning", Align::Left)]);
        for field in own {
            table.row(&[field.path.clone(), field.kind.clone(), sentence(&field.meaning).to_owned()]);
        }
        text.push_str(&format!("{}\n", table.finish()));
    }
    text.push_str("NAME stands for a name of your model. `tpm explain FIELD` says all of a field\n");
    text
}

/// The sentence for a key that no file has, with the fields that are spelled most alike.
fn unknown(key: &str, all: &[(FileKind, Vec<FieldText>)]) -> String {
    let last = key.rsplit('.').next().unwrap_or(key);
    let alike = |field: &&FieldText| {
        let own = field.path.rsplit('.').next().unwrap_or_default();
        own.contains(last) || (!own.is_empty() && last.contains(own)) || own.chars().take(4).eq(last.chars().take(4))
    };
    let near: Vec<&str> =
        all.iter().flat_map(|(_, own)| own).filter(alike).map(|field| field.path.as_str()).take(5).collect();
    let hint = if near.is_empty() {
        "`tpm explain` lists all fields".to_owned()
    } else {
        format!("try `tpm explain {}`", near.join("`, `tpm explain "))
    };
    format!("no file has a field `{key}`, and the model language no such word; {hint}")
}
