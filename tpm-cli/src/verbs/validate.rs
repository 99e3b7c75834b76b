//! `tpm validate`: how well identified parameters predict another log.

use crate::failure::{Failure, Outcome};
use crate::input::experiment::model;
use crate::input::log::LogArgs;
use crate::input::values::identification;
use crate::output::file;
use std::path::PathBuf;
use tpm_runtime::report::{Align, TextTable, number};
use tpm_runtime::session::{Identifiable as _, Validation, validate};

/// Options of `tpm validate`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// A result of `tpm identify --json`.
    #[arg(long, value_name = "FILE")]
    params: PathBuf,
    /// The log to predict.
    #[arg(long, value_name = "FILE")]
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
    let model = model(&args.file)?;
    let text = std::fs::read_to_string(&args.params).map_err(|error| Failure::read(&args.params, error))?;
    let known = identification(&args.params, &text)?;
    let request = args.reading.request(&args.log, model.evaluated())?;
    let result = validate(&model, request, &known)?;
    file::emit(args.output.as_deref(), &if args.json { file::json(&result)? } else { describe(&result) })?;
    result.shortfall().map_or(Ok(()), |missing| Err(Failure::Incomplete(missing)))
}

fn describe(result: &Validation) -> String {
    let mut text = format!(
        "model {} on {}\n{} from sample {}; hold {}; {}; nothing is fitted\n\n",
        result.model,
        result.log,
        result.period.map_or_else(
            || "time domain".to_owned(),
            |period| format!("{} periods of {} s", result.periods, number(period))
        ),
        result.from_sample,
        result.hold,
        result.cut_off.map_or_else(
            || format!("harmonics up to {}", result.harmonics),
            |cut_off| format!("low pass at {} Hz", number(cut_off))
        ),
    );
    for remark in result.reading.remarks() {
        text.push_str(&format!("remark: {remark}\n"));
    }
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
            row.unit.as_deref().unwrap_or("-").to_owned(),
            number(row.force),
            number(row.missed),
            format!("{:.2} %", 100.0 * row.share),
        ]);
    }
    text.push_str(&table.finish());
    for row in &result.unpredicted {
        text.push_str(&format!(
            "{} is not predicted: it changes with {}, which the result leaves open\n",
            row.name, row.direction
        ));
    }
    text
}
