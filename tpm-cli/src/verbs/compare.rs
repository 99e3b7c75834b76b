//! `tpm compare`: what changed between two results.

use crate::failure::{Failure, Outcome};
use crate::input::issue::IssueArgs;
use crate::input::values::stored_result;
use crate::output::{file, report, writable};
use std::path::PathBuf;
use tpm_runtime::document::Document;
use tpm_runtime::session::compare;

/// What stands below the options in the help.
const ENDING: &str = "The results must come from different data: their errors are taken for independent.\n\
    Exit codes: 0 whenever the comparison could be made, whatever it shows; 2 when a file is no result, units do not agree, or \
    nothing is shown by both.";

/// Options of `tpm compare`.
#[derive(clap::Args)]
#[command(after_help = ENDING)]
pub(crate) struct Args {
    /// The result before, or of the first machine: a file of `tpm identify --json` or `tpm campaign result --json`.
    #[arg(value_name = "A.json")]
    a: PathBuf,
    /// The result after, or of the second machine.
    #[arg(value_name = "B.json")]
    b: PathBuf,
    /// Write a page for a browser (report.html) into this folder.
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    #[command(flatten)]
    issue: IssueArgs,
    /// Print JSON (tpm.comparison/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    writable(args.output.as_deref(), args.report.as_deref())?;
    let [a, b] = [stored_result(&args.a)?, stored_result(&args.b)?];
    let result = compare(&a, &b)
        .map_err(|fault| Failure::Input(format!("{} (A) and {} (B): {fault}", args.a.display(), args.b.display())))?;
    let text = if args.json {
        file::json(&result)?
    } else {
        format!("{} (A) and {} (B)\n{result}", args.a.display(), args.b.display())
    };
    file::emit(args.output.as_deref(), &text)?;
    let Some(folder) = &args.report else { return Ok(()) };
    let names = [&args.a, &args.b].map(|path| path.display().to_string());
    let document = Document::of_comparison(&result, [&names[0], &names[1]]);
    report::write(folder, &document.issued(args.issue.now()), &[])
}
