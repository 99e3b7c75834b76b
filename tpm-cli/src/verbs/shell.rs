//! `tpm completions`, `tpm man` and `tpm flags`: what the command line says of itself, in the forms that others read.

use crate::failure::{Failure, Outcome};
use crate::output::file;
use clap::Command;
use clap_complete::Shell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Options of `tpm completions`.
#[derive(clap::Args)]
pub(crate) struct CompletionArgs {
    /// The shell that completes.
    #[arg(value_enum)]
    shell: Shell,
}

/// Options of `tpm man`.
#[derive(clap::Args)]
pub(crate) struct ManArgs {
    /// The folder to write the pages into; made when it is not there.
    folder: PathBuf,
}

/// Prints the completions for a shell.
pub(crate) fn completions(args: &CompletionArgs, mut command: Command) -> Outcome {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut command, "tpm", &mut text);
    file::print_content(&String::from_utf8_lossy(&text))
}

/// Writes a manual page for the program and one for every verb.
pub(crate) fn man(args: &ManArgs, mut command: Command) -> Outcome {
    command.build();
    let mut pages: Vec<(PathBuf, Vec<u8>)> = Vec::new();
    render(&command, "tpm", &args.folder, &mut pages)?;
    let files: Vec<(&Path, &[u8])> = pages.iter().map(|(path, bytes)| (path.as_path(), bytes.as_slice())).collect();
    file::write_into(&args.folder, &files)?;
    file::remark(&format!("{}: {} pages, from tpm.1 on", args.folder.display(), files.len()));
    Ok(())
}

fn render(command: &Command, name: &str, folder: &Path, pages: &mut Vec<(PathBuf, Vec<u8>)>) -> Result<(), Failure> {
    let path = folder.join(format!("{name}.1"));
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone()).render(&mut page).map_err(|error| Failure::write(&path, error))?;
    pages.push((path, page));
    for verb in shown(command) {
        render(verb, &format!("{name}-{}", verb.get_name()), folder, pages)?;
    }
    Ok(())
}

fn shown(command: &Command) -> impl Iterator<Item = &Command> {
    command.get_subcommands().filter(|verb| verb.get_name() != "help" && !verb.is_hide_set())
}

/// Prints the flags verb by verb as Markdown: `docs/flags.md`.
pub(crate) fn flags(command: &Command) -> Outcome {
    let mut verbs: Vec<(String, &Command)> = Vec::new();
    gather(command, "", &mut verbs);
    let mut flags: BTreeMap<String, BTreeMap<String, Vec<String>>> = BTreeMap::new();
    for (name, verb) in &verbs {
        for argument in verb.get_arguments() {
            let Some(long) = argument.get_long().filter(|long| !["help", "version"].contains(long)) else { continue };
            let takes = argument.get_action().takes_values();
            let names: Vec<String> =
                argument.get_value_names().unwrap_or_default().iter().map(ToString::to_string).collect();
            let value = if takes { names.join(" ") } else { String::new() };
            flags.entry(long.to_owned()).or_default().entry(value).or_default().push(name.clone());
        }
    }
    let mut text = String::from(
        "# Flags\n\nWritten by `tpm flags`; a test compares this page with what the program says. `tpm VERB --help` says what a flag does.\n\n| flag | value | verbs |\n|---|---|---|\n",
    );
    for (flag, values) in &flags {
        for (value, own) in values {
            let value = if value.is_empty() { String::new() } else { format!("`{}`", value.replace('|', "\\|")) };
            text.push_str(&format!("| `--{flag}` | {value} | {} |\n", own.join(", ")));
        }
    }
    file::print(&text)
}

fn gather<'a>(command: &'a Command, before: &str, verbs: &mut Vec<(String, &'a Command)>) {
    for verb in shown(command) {
        let name = if before.is_empty() { verb.get_name().to_owned() } else { format!("{before} {}", verb.get_name()) };
        gather(verb, &name, verbs);
        verbs.push((name, verb));
    }
}
