//! `tpm complete`: the model with the forces that a result says it lacks.

use crate::failure::{Failure, Outcome};
use crate::input::values::stored_result;
use crate::output::file;
use std::path::PathBuf;

/// Options of `tpm complete`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A result of `tpm identify MODEL --log LOG --json`.
    result: PathBuf,
    /// Write the model to this file instead of standard output.
    #[arg(short, long, value_name = "FILE.tpm")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let stored = stored_result(&args.result)?;
    let name = args.result.display();
    let model = stored.completed_model().ok_or_else(|| {
        Failure::Incomplete(format!(
            "{name}: nothing that the model may lack makes it better on parts of the logs from which its values were not taken"
        ))
    })?;
    file::emit(args.output.as_deref(), model)
}
