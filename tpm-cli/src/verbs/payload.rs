//! `tpm payload`: the load of an arm from two results.

use crate::failure::{Failure, Outcome};
use crate::input::experiment::model;
use crate::input::values::stored_result;
use crate::output::file;
use std::path::PathBuf;
use tpm_runtime::inertia::{LoadRequest, payload};

/// What stands below the options in the help.
const ENDING: &str = "The results must come from different logs: their errors are taken for independent.\n\
    Exit codes: 0 when the results show the whole load, 1 when they show a part of it, 2 on bad input";

/// Options of `tpm payload`.
#[derive(clap::Args)]
#[command(after_help = ENDING)]
pub(crate) struct Args {
    /// The model of the arm.
    file: PathBuf,
    /// The result without the load: a file of `tpm identify --json`.
    #[arg(value_name = "EMPTY.json")]
    without: PathBuf,
    /// The result with the load.
    #[arg(value_name = "LOADED.json")]
    with: PathBuf,
    /// The body that carries the load; the last one of the model when not given.
    #[arg(long, value_name = "BODY")]
    body: Option<String>,
    /// Density of the ball that stands for the load where the results do not show it, kg/m^3.
    #[arg(long, value_name = "DENSITY", default_value_t = 2700.0)]
    density: f64,
    /// Print JSON (tpm.load/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let model = model(&args.file)?;
    let (without, with) = (stored_result(&args.without)?, stored_result(&args.with)?);
    let request = LoadRequest {
        model: &model,
        without: &without,
        with: &with,
        body: args.body.as_deref(),
        density: args.density,
    };
    let found = payload(&request)
        .map_err(|fault| Failure::Input(format!("{} and {}: {fault}", args.without.display(), args.with.display())))?;
    let text = if args.json { file::json(&found)? } else { found.to_string() };
    file::emit(args.output.as_deref(), &text)?;
    match found.unobservable.len() {
        0 => Ok(()),
        missing => Err(Failure::Incomplete(format!(
            "the results show {} of the 10 parameters of the load; move more joints, and faster, in both logs",
            10 - missing
        ))),
    }
}
