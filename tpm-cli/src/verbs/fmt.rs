//! `tpm fmt`: models laid out alike.

use crate::failure::{Failure, Outcome};
use crate::output::file;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use tpm_codegen::language;
use tpm_codegen::source::Source;
use tpm_runtime::report::{MOST_TEXT, read_input};
use tpm_runtime::session::other_kind;

/// Options of `tpm fmt`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model files to lay out, each in its place; `-` reads standard input and writes standard output.
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Change nothing; name the files that are laid out otherwise, and end with 1 if there are any.
    #[arg(long)]
    check: bool,
}

/// Runs the command. No file is changed where one of them has a fault.
pub(crate) fn run(args: &Args) -> Outcome {
    if args.files.is_empty() {
        let said = "no file is named; type `tpm fmt MODEL.tpm` for files, `tpm fmt -` for standard input";
        return Err(Failure::Input(said.to_owned()));
    }
    let is_input = |path: &PathBuf| path == Path::new("-");
    if args.files.iter().any(is_input) && args.files.len() > 1 {
        let example =
            args.files.iter().find(|path| !is_input(path)).map_or("FILE".into(), |path| path.display().to_string());
        return Err(Failure::Input(format!(
            "`-` stands for standard input and goes alone; type `tpm fmt {example}` for files"
        )));
    }
    let (mut changed, mut faults) = (Vec::new(), String::new());
    for path in &args.files {
        let source = read(path)?;
        match language::format(&source) {
            Ok(text) if is_input(path) && !args.check => return file::print_content(&text),
            Ok(text) if text == source.text() => {}
            Ok(text) => changed.push((path.as_path(), text)),
            Err(diagnostics) => faults.push_str(&other_kind(&source).unwrap_or_else(|| diagnostics.render(&source))),
        }
    }
    if !faults.is_empty() {
        return Err(Failure::Model(format!(
            "{}\nno file was changed; mend what is named above first",
            faults.trim_end()
        )));
    }
    if args.check {
        return answer(&changed.iter().map(|(path, _)| *path).collect::<Vec<&Path>>());
    }
    file::write_files(&changed.iter().map(|(path, text)| (*path, text.as_bytes())).collect::<Vec<(&Path, &[u8])>>())
}

/// Names the files that would be changed.
fn answer(changed: &[&Path]) -> Outcome {
    let names: Vec<String> = changed.iter().map(|path| path.display().to_string()).collect();
    if names.is_empty() {
        return Ok(());
    }
    file::print(&format!("{}\n", names.join("\n")))?;
    let say = if names.len() == 1 { "it is" } else { "they are" };
    Err(Failure::Incomplete(format!(
        "laid out otherwise than `tpm fmt` does; {say} changed by `tpm fmt {}`",
        names.join(" ")
    )))
}

fn read(path: &Path) -> Result<Source, Failure> {
    let (name, bytes) = if path == Path::new("-") {
        let mut bytes = Vec::new();
        let read = std::io::stdin().lock().take(MOST_TEXT + 1).read_to_end(&mut bytes);
        let name = Path::new("standard input");
        read.map_err(|error| Failure::read(name, error))?;
        if bytes.len() as u64 > MOST_TEXT {
            return Err(Failure::Input(format!("standard input is longer than {} MiB", MOST_TEXT >> 20)));
        }
        (name, bytes)
    } else {
        (path, read_input(path, MOST_TEXT).map_err(|error| Failure::read(path, error))?)
    };
    Ok(Source::from_bytes(name.display().to_string(), bytes))
}
