//! `tpm inspect`: what a log holds, and what that means for identification.

use crate::failure::{Failure, Outcome};
use crate::input::experiment::model;
use crate::input::log::LogArgs;
use crate::output::{file, picture, writable};
use crate::render::flags;
use std::path::{Path, PathBuf};
use tpm_runtime::session::{Identifiable as _, Inspection, inspect, inspect_for};

/// What stands above the options in the help.
const BEGINNING: &str = "Look at a log before identifying: `tpm inspect run.csv`, then `tpm inspect run.csv model.tpm` with the model.\n\n\
    Says how the log is sampled, where it has gaps, and of every channel its noise, its counts, its highest frequency, its period, how \
    long it rests and whether it is cut off; what that means for identification, and the flag of `tpm identify` that helps. With a \
    model, names, units and factors are settled as `tpm identify` settles them, and the delay between inputs and motion is told.";

/// What stands below the options in the help.
const ENDING: &str = "Without a model every column of numbers is a channel, t_s alone can be mapped, and --scale is by columns.\n\
    Exit codes: 0 whenever the log could be read, whatever it shows; 2 when it cannot be read.";

/// Options of `tpm inspect`.
#[derive(clap::Args)]
#[command(long_about = BEGINNING, after_help = ENDING)]
pub(crate) struct Args {
    /// The log.
    log: PathBuf,
    /// The model file: its coordinates, inputs and measured rates are the channels; all columns of numbers when not given.
    model: Option<PathBuf>,
    #[command(flatten)]
    reading: LogArgs,
    /// Write the figure (inspection.svg, inspection.png) and the JSON into this folder.
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Print JSON (tpm.inspection/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    writable(args.output.as_deref(), args.report.as_deref())?;
    if args.log.extension().is_some_and(|extension| extension == "tpm") {
        let (log, model) = (args.model.as_deref().unwrap_or(Path::new("LOG")), args.log.display());
        return Err(Failure::Input(format!(
            "the log comes before the model: type `tpm inspect {} {model}`",
            log.display()
        )));
    }
    let found = match &args.model {
        Some(path) => {
            let model = model(path)?;
            args.reading.without_fitted_delays()?;
            let request = args.reading.request(&args.log, model.evaluated())?;
            inspect_for(&model, request)?
        }
        None => inspect(args.reading.request_without_model(&args.log)?)?,
    };
    let text = if args.json { file::json(&found)? } else { found.text(&flags::remedy) };
    file::emit(args.output.as_deref(), &text)?;
    args.report.as_ref().map_or(Ok(()), |folder| write(folder, &found))
}

/// Writes figure and JSON into a folder.
fn write(folder: &Path, found: &Inspection) -> Result<(), Failure> {
    let mut files: Vec<(PathBuf, Vec<u8>)> = vec![(folder.join("inspection.json"), file::json(found)?.into_bytes())];
    if let Some(figure) = found.figure() {
        for kind in picture::KINDS {
            let path = folder.join(format!("inspection.{kind}"));
            let drawn = picture::bytes(&path, &figure)?;
            files.push((path, drawn));
        }
    }
    let files: Vec<(&Path, &[u8])> = files.iter().map(|(path, bytes)| (path.as_path(), bytes.as_slice())).collect();
    file::write_into(folder, &files)
}
