//! `tpm check --against`: whether the machine of a log is still the one that was identified.

use crate::failure::{Failure, Outcome};
use crate::input::experiment::model;
use crate::input::log::LogArgs;
use crate::input::values::{identification, stored_result};
use crate::output::{file, writable};
use std::path::{Path, PathBuf};
use tpm_runtime::document::junit;
use tpm_runtime::report::{Align, TextTable};
use tpm_runtime::session::{CheckOutcome, Identifiable as _, Regression, RegressionError, check_against};

/// Options that hold a log against an earlier result.
#[derive(clap::Args)]
pub(crate) struct MachineArgs {
    /// A new log of the machine, which --against holds against an earlier result.
    #[arg(requires = "against")]
    log: Option<PathBuf>,
    /// Say whether the machine of the log is still the one of this result of `tpm identify --json`: whether its parameters predict the
    /// log, and whether any of them has moved beyond chance. Ends with 1 where it is not.
    #[arg(long, value_name = "RESULT.json", requires = "log")]
    against: Option<PathBuf>,
    #[command(flatten)]
    reading: LogArgs,
    /// Also write the checks to this file, as programs for continuous integration read them (JUnit).
    #[arg(long, value_name = "FILE.xml", requires = "against")]
    junit: Option<PathBuf>,
    /// Print JSON (tpm.regression/1).
    #[arg(long, requires = "against")]
    json: bool,
}

/// Runs the command; nothing where no log is to be held against a result.
pub(crate) fn run(model: &Path, args: &MachineArgs) -> Option<Outcome> {
    if let (None, Err(failure)) = (&args.log, args.reading.columns.needs_log()) {
        return Some(Err(failure));
    }
    let (log, earlier) = (args.log.as_deref()?, args.against.as_deref()?);
    Some(held_against(model, args, log, earlier))
}

fn held_against(file: &Path, args: &MachineArgs, log: &Path, earlier: &Path) -> Outcome {
    writable(args.junit.as_deref(), None)?;
    let model = model(file)?;
    let stored = stored_result(earlier)?;
    let text = tpm_runtime::report::read_text(earlier).map_err(|error| Failure::read(earlier, error))?;
    let known = identification(earlier, &text, model.evaluated().name())?;
    let request = args.reading.request(log, model.evaluated())?;
    let found = check_against(&model, request, (&stored, &known)).map_err(|error| match error {
        RegressionError::Session(error) => error.into(),
        other => Failure::Input(format!("{} and {}: {other}", earlier.display(), log.display())),
    })?;
    if let Some(path) = &args.junit {
        let text = junit(&found).map_err(|error| Failure::Input(error.to_string()))?;
        file::emit(Some(path), &text)?;
    }
    let text = if args.json { file::json(&found)? } else { described(&found) };
    file::print(&text)?;
    let failed: Vec<&str> = found.failed().map(|check| check.name.as_str()).collect();
    if failed.is_empty() {
        return Ok(());
    }
    Err(Failure::Incomplete(format!("the machine is not the one of {}: {}", earlier.display(), failed.join("; "))))
}

fn described(found: &Regression) -> String {
    let mut table = TextTable::new(&[("check", Align::Left), ("", Align::Left), ("", Align::Left)]);
    for check in &found.checks {
        let (outcome, why) = match &check.outcome {
            CheckOutcome::Failed(why) => ("failed", why.as_str()),
            CheckOutcome::Skipped(why) => ("not tested", why.as_str()),
            _ => ("passed", ""),
        };
        table.row(&[check.name.clone(), outcome.to_owned(), why.to_owned()]);
    }
    let mut text = format!("model {} on {}\n\n{}", found.model, found.log, table.finish());
    for warning in found.comparison.iter().flat_map(|comparison| &comparison.warnings) {
        text.push_str(&format!("warning: {warning}\n"));
    }
    text
}
