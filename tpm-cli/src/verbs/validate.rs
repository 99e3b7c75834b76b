//! `tpm validate`: how well identified parameters predict another log.

use crate::Outcome;
use crate::failure::Failure;
use crate::input::load::Loaded;
use crate::input::log::LogArgs;
use crate::input::values::identification;
use crate::output::file;
use crate::render::table::{Align, TextTable, number};
use std::path::{Path, PathBuf};
use tpm_runtime::interpret::Interpreted;
use tpm_runtime::log::Log;
use tpm_runtime::model::Model as _;
use tpm_runtime::session::{Validation, validate_log};

/// Options of `tpm validate`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// A result of `tpm identify --json`.
    #[arg(long, value_name = "FILE")]
    params: PathBuf,
    /// The log to predict (CSV with one header line, time in `t_s`).
    #[arg(long, value_name = "CSV")]
    log: PathBuf,
    #[command(flatten)]
    reading: LogArgs,
    /// Print JSON (tpm.validation/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let prepared = Loaded::from_file(&args.file)?.prepared()?;
    let model = Interpreted::new(&prepared.model, &prepared.form);
    let options = args.reading.options(&model)?;
    let parameters = identified(&args.params, &model)?;
    let input = |error: &dyn std::fmt::Display| Failure::Input(error.to_string());
    let log = Log::open(&args.log, &model, &options).map_err(|error| input(&error))?;
    let result = validate_log(&model, &log, &options, &parameters).map_err(|error| input(&error))?;
    file::emit(args.output.as_deref(), &if args.json { file::json(&result)? } else { describe(&result) })
}

/// The values of a result, in the model's order.
fn identified(path: &Path, model: &Interpreted) -> Result<Vec<f64>, Failure> {
    let at = |what: String| Failure::Input(format!("{}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| Failure::read(path, error))?;
    let whole = identification(path, &text)?;
    let value = |j: usize| {
        let name = model.parameter(j).name;
        let entry = whole["parameters"].as_array().and_then(|list| list.iter().find(|entry| entry["name"] == name));
        let value = entry.and_then(|entry| entry["value"].as_f64());
        value.ok_or_else(|| at(format!("`{name}` was not identified, so there is nothing to predict with")))
    };
    (0..model.dims().parameters).map(value).collect()
}

fn describe(result: &Validation) -> String {
    let mut text = format!(
        "model {} on {}\n{} periods of {} s from sample {}; hold {}; harmonics up to {}; nothing is fitted\n\n",
        result.model,
        result.log,
        result.periods,
        number(result.period),
        result.from_sample,
        result.hold,
        result.harmonics
    );
    let mut table = TextTable::new(&[
        ("row", Align::Left),
        ("unit", Align::Left),
        ("applied, rms", Align::Right),
        ("missed, rms", Align::Right),
        ("prediction error", Align::Right),
    ]);
    for row in &result.rows {
        table.row(&[
            row.name.clone(),
            row.unit.clone().unwrap_or_else(|| "-".to_owned()),
            number(row.force),
            number(row.missed),
            format!("{:.2} %", 100.0 * row.share),
        ]);
    }
    text.push_str(&table.finish());
    text
}
