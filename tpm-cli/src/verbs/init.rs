//! `tpm init`: a commented model with an experiment that run as they are, to be changed into one's own.

use crate::failure::{Failure, Outcome};
use crate::output::file;
use crate::verbs::import;
use std::path::{Path, PathBuf};
use tpm_runtime::log::model_unit;
use tpm_runtime::session::inspect;

/// Options of `tpm init`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Name of the model; NAME.tpm is written, and beside it what belongs to it.
    name: String,
    /// Begin with this log: its columns stand in the model's comments, and the command that identifies from it is printed.
    #[arg(long, value_name = "FILE", conflicts_with = "from")]
    log: Option<PathBuf>,
    /// Begin with this robot description (URDF), as `tpm import` does.
    #[arg(long, value_name = "URDF")]
    from: Option<PathBuf>,
}

const MODEL: &str = include_str!("init/model.tpm");
const EXPERIMENT: &str = include_str!("init/experiment.toml");

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
    let model = MODEL.replace("ModelName", &camel(&stem));
    match (&args.from, &args.log) {
        (Some(description), _) => {
            begin(&import::files(description, &target)?)?;
            file::print(&format!(
                "{0}: the arm of {1}\nbeside it {2}.prior.toml, the inertias of the description, and {2}.experiment.toml, its limits\n\
                 next: tpm check {0}, tpm identifiability {0}, tpm identify {0} --log LOG --prior {2}.prior.toml\n",
                target.display(),
                description.display(),
                target.with_extension("").display()
            ))
        }
        (None, Some(log)) => {
            let (columns, position, force) = columns(log)?;
            let words = [
                target.display().to_string(),
                "--log".to_owned(),
                log.display().to_string(),
                "--map".to_owned(),
                format!("x={}", position.name),
                "--map".to_owned(),
                format!("u={}", force.name),
            ];
            let command = format!("tpm identify {}", words.map(|word| shell_word(&word)).join(" "));
            let head = format!(
                "// Columns of {}: {}.\n// x is taken from `{}` and u from `{}` by this command; change it where another column is meant:\n//   {}\n",
                one_line(&log.display().to_string()),
                one_line(&columns.join(", ")),
                one_line(&position.name),
                one_line(&force.name),
                one_line(&command)
            );
            let model = model.split_once("    // A motion").map_or(model.as_str(), |(before, _)| before).trim_end();
            let model = in_units(model, position.unit, force.unit);
            begin(&[(target.clone(), format!("{head}{model}\n}}\n"))])?;
            file::print(&format!("{}: a first model for {}\nnext: {command}\n", target.display(), log.display()))
        }
        (None, None) => {
            let text = EXPERIMENT.replace("model_name", &stem);
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
fn begin(files: &[(PathBuf, String)]) -> Outcome {
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

/// A word of a command as a shell takes it.
fn shell_word(word: &str) -> String {
    let plain = |letter: char| letter.is_ascii_alphanumeric() || "_./:=@%+,-".contains(letter);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// A text for a comment, which ends with its line.
fn one_line(text: &str) -> String {
    text.replace(char::is_control, " ")
}

/// The model's text with the units of its position and its force, and of the parameters between them.
fn in_units(model: &str, position: Option<&str>, force: Option<&str>) -> String {
    let (x, u) = (position.unwrap_or("m"), force.unwrap_or("N"));
    if (x, u) == ("m", "N") {
        return model.to_owned();
    }
    model
        .replace("coordinate x [m]", &format!("coordinate x [{x}]"))
        .replace("input u [N]", &format!("input u [{u}]"))
        .replace("m [kg]", &format!("m [{u}*s^2/{x}]"))
        .replace("d [N*s/m]", &format!("d [{u}*s/{x}]"))
        .replace("k [N/m]", &format!("k [{u}/{x}]"))
}

/// A column of a log: its name, and the unit in which a model states its quantity, where it is known.
#[derive(Clone, Debug, PartialEq)]
struct Column {
    name: String,
    unit: Option<&'static str>,
}

/// Names of a log's columns of numbers, and those that are most likely a measured position and the force that moves it.
fn columns(log: &Path) -> Result<(Vec<String>, Column, Column), Failure> {
    let seen = inspect(log)?;
    let column = |name: &str, unit: Option<&str>| Column { name: name.to_owned(), unit: unit.and_then(model_unit) };
    let all: Vec<Column> = seen.channels.iter().map(|channel| column(&channel.name, channel.unit.as_deref())).collect();
    let recorded: Vec<Column> = all.iter().filter(|column| !is_asked_for(&column.name)).cloned().collect();
    let likely = if recorded.len() < 2 { &all } else { &recorded };
    let Some((position, force)) = position_and_force(likely) else {
        return Err(Failure::Input(format!(
            "{} has no two columns of numbers beside the time; type a log with a position and a force",
            log.display()
        )));
    };
    Ok((all.into_iter().map(|column| column.name).collect(), position, force))
}

/// Whether a column's name says that it holds what was asked for, which is no measurement.
fn is_asked_for(name: &str) -> bool {
    let mut words = name.split(|c: char| !c.is_ascii_alphabetic()).map(str::to_ascii_lowercase);
    words.any(|word| ["ref", "reference", "des", "desired", "cmd", "target", "setpoint", "ff"].contains(&word.as_str()))
}

/// The first column with the unit of a force, else of a voltage or a current, else the last one; and of the others the first with the
/// unit of a length or an angle, else the first one. Nothing of fewer than two columns.
fn position_and_force(columns: &[Column]) -> Option<(Column, Column)> {
    let with_unit = |units: &[&str], but: Option<usize>| {
        let of_kind =
            |(i, column): (usize, &Column)| Some(i) != but && column.unit.is_some_and(|unit| units.contains(&unit));
        columns.iter().enumerate().position(of_kind)
    };
    let kinds: [&[&str]; 3] = [&["N", "N*m"], &["V"], &["A"]];
    let force = kinds.into_iter().find_map(|units| with_unit(units, None)).or(columns.len().checked_sub(1))?;
    let first = (0..columns.len()).find(|i| *i != force);
    let position = with_unit(&["m", "rad"], Some(force)).or(first)?;
    Some((columns[position].clone(), columns[force].clone()))
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
    use super::{Column, MODEL, in_units, is_asked_for, one_line, position_and_force, shell_word};
    use tpm_runtime::log::model_unit;

    #[test]
    fn a_position_and_its_force_are_taken_by_unit_before_place() {
        let taken = |columns: &[(&str, Option<&str>)]| {
            let column = |(name, unit): &(&str, Option<&str>)| Column {
                name: (*name).to_owned(),
                unit: unit.and_then(model_unit),
            };
            let columns: Vec<Column> = columns.iter().map(column).collect();
            position_and_force(&columns).map(|(position, force)| format!("{} {}", position.name, force.name))
        };
        let units = [("q_m", Some("m")), ("u_V", Some("V")), ("force_N", Some("N")), ("spare", None)];
        assert_eq!(taken(&units).as_deref(), Some("q_m force_N"));
        assert_eq!(taken(&[("u_V", Some("V")), ("y_V", Some("V"))]).as_deref(), Some("y_V u_V"));
        assert_eq!(taken(&[("x", None), ("v", None), ("u", None)]).as_deref(), Some("x u"));
        assert_eq!(taken(&[("i", Some("mA")), ("phi", Some("°"))]).as_deref(), Some("phi i"));
        assert_eq!(taken(&[("x", Some("m"))]), None);
        assert!(
            is_asked_for("q_ref_m") && is_asked_for("tau_ff1") && !is_asked_for("refined") && !is_asked_for("offset")
        );
    }

    #[test]
    fn words_are_taken_by_a_shell_as_they_are() {
        let words = ["x=position", "x=Output angle [deg]", "it's", "a\nb", "$HOME `id`", ""];
        let quoted: Vec<String> = words.iter().map(|word| shell_word(word)).collect();
        assert_eq!(quoted[..3], ["x=position", "'x=Output angle [deg]'", "'it'\\''s'"]);
        let output =
            std::process::Command::new("sh").arg("-c").arg(format!("printf '%s|' {}", quoted.join(" "))).output();
        let shown = String::from_utf8(output.expect("a shell").stdout).expect("text");
        assert_eq!(shown, words.map(|word| format!("{word}|")).concat());
        assert_eq!(one_line("a\nb"), "a b");
    }

    #[test]
    fn the_model_has_the_units_of_its_columns() {
        let model = in_units(MODEL, Some("rad"), Some("A"));
        for text in ["x [rad]", "u [A]", "m [A*s^2/rad]", "d [A*s/rad]", "k [A/rad]"] {
            assert!(model.contains(text), "{text}");
        }
        assert_eq!(in_units(MODEL, None, None), MODEL);
    }
}
