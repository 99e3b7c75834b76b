//! `tpm demo`: from nothing to a report, by the commands that a user types.
//!
//! The sample is a model and a machine that is simulated in the place of a real one. What follows are commands of this program, printed as
//! they are run, so that whoever pastes them gets the same.

use crate::failure::{Failure, Outcome};
use crate::output::file;
use crate::render::quoted;
use std::path::{Path, PathBuf};
use tpm_runtime::session::{SAMPLE_EXPERIMENT, SAMPLE_MODEL};

/// Options of `tpm demo`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The folder for the sample, its log and the report; files that another program wrote there stay as they are.
    #[arg(default_value = "tpm_demo")]
    folder: PathBuf,
}

/// The files of the sample.
const FILES: [(&str, &str); 2] = [SAMPLE_MODEL, SAMPLE_EXPERIMENT];

/// Runs the command; `run` runs a command line of this program.
pub(crate) fn run(args: &Args, run: impl Fn(&[String]) -> Outcome) -> Outcome {
    let at = |name: &str| args.folder.join(name);
    let other = FILES.iter().map(|(name, text)| (at(name), text)).find(|(path, text)| is_other(path, text));
    let log = at("run.csv");
    // Without the sample beside it, a log of this name is somebody else's.
    let foreign = (log.exists() && !at(FILES[0].0).exists()).then_some(log.clone());
    if let Some(path) = other.map(|(path, _)| path).or(foreign) {
        return Err(Failure::Input(format!(
            "{} is there already, and is not the sample's; type another folder, such as `tpm demo {}`",
            path.display(),
            quoted::quoted(&format!("{}_2", args.folder.display()))
        )));
    }
    let files = FILES.map(|(name, text)| (at(name), text));
    let files = files.each_ref().map(|(path, text)| (path.as_path(), text.as_bytes()));
    file::write_into(&args.folder, &files)?;
    let name = |name: &str| at(name).display().to_string();
    let (model, log, report) = (name("slide.tpm"), name("run.csv"), name("report"));
    file::print(&format!(
        "{model}: a slide with friction; {}: the machine that is simulated in its place\n",
        name("slide.toml")
    ))?;
    let steps: [&[&str]; 2] = [
        &["simulate", &model, "-o", &log],
        &["identify", &model, "--log", &log, "--map", "x=x", "--map", "u=u", "--hold", "zoh", "--report", &report],
    ];
    for step in steps {
        let words: Vec<String> = ["tpm"].iter().chain(step).map(|word| (*word).to_owned()).collect();
        file::print(&format!("\n$ {}\n", quoted::command(&words)))?;
        run(&words)?;
    }
    file::print(&format!(
        "\nreport: {}, for a browser\nnext: {}, which shows models to begin with for a log, this one or yours\n",
        Path::new(&report).join("report.html").display(),
        quoted::command(&["tpm", "identify", &log].map(str::to_owned))
    ))
}

/// Whether a file is there with another content.
fn is_other(path: &Path, text: &str) -> bool {
    std::fs::read(path)
        .map_or_else(|error| error.kind() != std::io::ErrorKind::NotFound, |there| there != text.as_bytes())
}
