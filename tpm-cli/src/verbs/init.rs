//! `tpm init`: a commented model with an experiment that run as they are, to be changed into one's own.

use crate::failure::{Failure, Outcome};
use crate::output::file;
use crate::verbs::import;
use std::path::{Path, PathBuf};
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
            let (columns, first, last) = columns(log)?;
            let command =
                format!("tpm identify {} --log {} --map x={first} --map u={last}", target.display(), log.display());
            let head = format!(
                "// Columns of {}: {}.\n// x is taken from `{first}` and u from `{last}` by this command; change it where another column is meant:\n//   {command}\n",
                log.display(),
                columns.join(", ")
            );
            let model = model.split_once("    // A motion").map_or(model.as_str(), |(before, _)| before).trim_end();
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

/// Names of a log's columns of numbers, and those that are most likely a measured position and the force that moves it.
fn columns(log: &Path) -> Result<(Vec<String>, String, String), Failure> {
    let seen = inspect(log)?;
    let all: Vec<(&str, Option<&str>)> =
        seen.channels.iter().map(|channel| (channel.name.as_str(), channel.unit.as_deref())).collect();
    let recorded: Vec<(&str, Option<&str>)> = all.iter().copied().filter(|(name, _)| !is_asked_for(name)).collect();
    let likely = if recorded.len() < 2 { &all } else { &recorded };
    let Some((position, force)) = position_and_force(likely) else {
        return Err(Failure::Input(format!(
            "{} has no two columns of numbers beside the time; type a log with a position and a force",
            log.display()
        )));
    };
    Ok((all.iter().map(|(name, _)| (*name).to_owned()).collect(), position, force))
}

/// Whether a column's name says that it holds what was asked for, which is no measurement.
fn is_asked_for(name: &str) -> bool {
    let mut words = name.split(|c: char| !c.is_ascii_alphabetic()).map(str::to_ascii_lowercase);
    words.any(|word| ["ref", "reference", "des", "desired", "cmd", "target", "setpoint", "ff"].contains(&word.as_str()))
}

/// The first column with the unit of a force, else of a voltage or a current, else the last one; and of the others the first with the
/// unit of a length or an angle, else the first one. Nothing of fewer than two columns.
fn position_and_force(columns: &[(&str, Option<&str>)]) -> Option<(String, String)> {
    let with_unit = |units: &[&str], but: Option<usize>| {
        columns
            .iter()
            .enumerate()
            .position(|(i, (_, unit))| Some(i) != but && unit.is_some_and(|unit| units.contains(&unit)))
    };
    let kinds: [&[&str]; 3] = [&["N", "kN", "mN", "N*m", "Nm", "mNm", "kNm"], &["V", "mV"], &["A", "mA"]];
    let force = kinds.into_iter().find_map(|units| with_unit(units, None)).or(columns.len().checked_sub(1))?;
    let first = (0..columns.len()).find(|i| *i != force);
    let position = with_unit(&["m", "mm", "cm", "um", "rad", "mrad", "deg", "rev"], Some(force)).or(first)?;
    Some((columns[position].0.to_owned(), columns[force].0.to_owned()))
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
    use super::{is_asked_for, position_and_force};

    #[test]
    fn a_position_and_its_force_are_taken_by_unit_before_place() {
        let taken = |columns: &[(&str, Option<&str>)]| {
            position_and_force(columns).map(|(position, force)| format!("{position} {force}"))
        };
        let units = [("q_m", Some("m")), ("u_V", Some("V")), ("force_N", Some("N")), ("spare", None)];
        assert_eq!(taken(&units).as_deref(), Some("q_m force_N"));
        assert_eq!(taken(&[("u_V", Some("V")), ("y_V", Some("V"))]).as_deref(), Some("y_V u_V"));
        assert_eq!(taken(&[("x", None), ("v", None), ("u", None)]).as_deref(), Some("x u"));
        assert_eq!(taken(&[("x", Some("m"))]), None);
        assert!(
            is_asked_for("q_ref_m") && is_asked_for("tau_ff1") && !is_asked_for("refined") && !is_asked_for("offset")
        );
    }
}
