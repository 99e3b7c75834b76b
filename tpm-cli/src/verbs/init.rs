//! `tpm init`: a commented model with an experiment that run as they are, to be changed into one's own.

use crate::failure::{Failure, Outcome};
use crate::input::log::ColumnArgs;
use crate::output::file;
use crate::render::{quoted, templates};
use crate::verbs::import;
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use tpm_runtime::session::{Inspection, Proposal, Template, inspect, proposals};

/// Options of `tpm init`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Name of the model; NAME.tpm is written, and beside it what belongs to it.
    name: String,
    /// Begin with this log: its columns stand in the model's comments, and the command that identifies from it is printed.
    #[arg(long, value_name = "FILE", conflicts_with = "from")]
    log: Option<PathBuf>,
    #[command(flatten)]
    columns: ColumnArgs,
    /// The machine. With a log the template that fits its columns best when not given (`tpm identify LOG` shows all that fit); without one
    /// the model has a motion, and an experiment on a simulated machine stands beside it.
    #[arg(long, value_enum, conflicts_with = "from")]
    template: Option<TemplateChoice>,
    /// Begin with this robot description (URDF), as `tpm import` does.
    #[arg(long, value_name = "URDF")]
    from: Option<PathBuf>,
}

/// Machines whose models one may begin with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
enum TemplateChoice {
    /// A mass on a spring.
    Spring,
    /// A slider with viscous and dry friction.
    Slider,
    /// A motor with a gear and a load.
    Motor,
    /// A driven pendulum.
    Pendulum,
    /// Two masses with a spring between them.
    TwoMasses,
    /// A driven cart with a pendulum on it.
    CartPole,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let target = Path::new(&args.name).with_extension("tpm");
    let stem = target.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let right = stem.starts_with(|first: char| first.is_ascii_alphabetic())
        && stem.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_');
    if !right {
        return Err(Failure::Input(format!(
            "`{}` is no name of a model: type letters, digits and underscores, such as `tpm init my_cart`",
            args.name
        )));
    }
    let experiment = target.with_extension("toml");
    if args.log.is_none() {
        args.columns.needs_log()?;
    }
    match (&args.from, &args.log) {
        (Some(description), _) => {
            begin(&import::files(description, &target)?)?;
            file::print(&format!(
                "{0}: the arm of {1}\nbeside it {2}.prior.toml, the inertias of the description, and {2}.experiment.toml, its limits\n\
                 next: tpm check {3}, tpm identifiability {3}, tpm identify {3} --log LOG --prior {4}\n",
                target.display(),
                description.display(),
                target.with_extension("").display(),
                quoted::quoted(&target.display().to_string()),
                quoted::quoted(&target.with_extension("prior.toml").display().to_string())
            ))
        }
        (None, Some(log)) => {
            let found = inspect(args.columns.request(log)?)?;
            let proposal = proposal(&found, args.template)?;
            let command = templates::identify(&proposal, &target, log, &args.columns.typed());
            let columns: Vec<&str> = found.channels.iter().map(|channel| channel.name.as_str()).collect();
            let head = [
                format!("Columns of {}: {}.", log.display(), columns.join(", ")),
                "Signals are taken from columns by this command; change it where another column is meant:".to_owned(),
                format!("  {command}"),
            ];
            // A name of a column may hold an end of line, behind which it would be no comment.
            let line = |line: &String| {
                format!("// {}\n", line.replace(|c: char| c.is_control() || "\u{2028}\u{2029}".contains(c), " "))
            };
            let head: String = head.iter().map(line).collect();
            begin(&[(target.clone(), format!("{head}{}", proposal.model(&camel(&stem))))])?;
            file::print(&format!(
                "{}: a first model for {}, {}\nnext: {command}\n",
                target.display(),
                log.display(),
                proposal.template.machine
            ))
        }
        (None, None) => {
            let template = named(args.template.unwrap_or(TemplateChoice::Spring));
            let (model, text) = template.without_log(&camel(&stem), &stem);
            begin(&[(target.clone(), model), (experiment.clone(), text)])?;
            file::print(&format!(
                "{0}: a model to change; {1}: an experiment on its simulated machine\nnext: tpm check {0}, tpm identify {0}; tpm explain says what a field of {1} means\n",
                target.display(),
                experiment.display()
            ))
        }
    }
}

/// Writes the files of a beginning, none over a file of the user. Where some of them are there as they would be written, an earlier
/// command was ended before the others, and this one finishes what it began.
pub(crate) fn begin(files: &[(PathBuf, String)]) -> Outcome {
    let is_own = |path: &Path, text: &str| std::fs::read(path).is_ok_and(|there| there == text.as_bytes());
    let there: Vec<&(PathBuf, String)> = files.iter().filter(|(path, _)| path.exists()).collect();
    let refused = if there.len() == files.len() { there.first() } else { None };
    if let Some((path, _)) = refused.or_else(|| there.iter().find(|(path, text)| !is_own(path, text))) {
        return Err(Failure::Input(format!(
            "{} is there already; type another name, or remove the file first",
            path.display()
        )));
    }
    let files: Vec<(&Path, &[u8])> = files.iter().map(|(path, text)| (path.as_path(), text.as_bytes())).collect();
    file::write_files(&files)
}

/// The template of a choice.
fn named(choice: TemplateChoice) -> &'static Template {
    let value = choice.to_possible_value().expect("invariant: no choice is hidden");
    Template::named(value.get_name()).expect("invariant: every template can be chosen")
}

/// The template that was chosen, else the one that fits best, with the columns of a log.
fn proposal(found: &Inspection, choice: Option<TemplateChoice>) -> Result<Proposal, Failure> {
    let chosen = choice.map(named);
    let mut fitting = proposals(found);
    let names: Vec<&str> = fitting.iter().map(|proposal| proposal.template.name).collect();
    let said = if names.is_empty() { "none does".to_owned() } else { format!("these do: {}", names.join(", ")) };
    let at = chosen.map_or(fitting.first().map(|_| 0), |template| names.iter().position(|name| *name == template.name));
    match (at, chosen) {
        (Some(at), _) => Ok(fitting.swap_remove(at)),
        (None, Some(template)) => Err(Failure::Input(format!(
            "{} has no columns for `{}`, {}; {said} (`tpm inspect` shows what the columns hold)",
            found.log, template.name, template.machine
        ))),
        (None, None) => Err(Failure::Input(format!(
            "{} has no two columns of numbers beside the time that may be a position and what moves it; type a log with a position and a \
             force, a torque, a current or a voltage",
            found.log
        ))),
    }
}

/// The name of a model from that of its file: `my_cart` is MyCart.
fn camel(stem: &str) -> String {
    let word = |word: &str| {
        let mut letters = word.chars();
        letters.next().map(|first| first.to_ascii_uppercase().to_string() + letters.as_str()).unwrap_or_default()
    };
    stem.split('_').map(word).collect()
}

#[cfg(test)]
mod tests {
    use super::TemplateChoice;
    use clap::ValueEnum as _;
    use tpm_runtime::session::TEMPLATES;

    #[test]
    fn every_template_can_be_chosen() {
        let choices = TemplateChoice::value_variants().iter().filter_map(|choice| choice.to_possible_value());
        let choices: Vec<String> = choices.map(|value| value.get_name().to_owned()).collect();
        assert_eq!(choices, TEMPLATES.map(|template| template.name.to_owned()));
    }
}
