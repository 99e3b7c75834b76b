//! `tpm validate`: how well identified parameters predict another log.

use super::identify::HoldChoice;
use crate::assignments::{assignment, by_name, number_assignment};
use crate::failure::Failure;
use crate::load::Loaded;
use crate::text_table::{Align, TextTable, number};
use crate::{Outcome, output};
use std::path::{Path, PathBuf};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::interpret::Interpreted;
use tpm_runtime::log::{Log, LogOptions, Validation, validate_log};
use tpm_runtime::model::Model as _;

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
    /// Column of a coordinate or input (or of t_s) that is named otherwise in the log.
    #[arg(long, value_name = "NAME=COLUMN", value_parser = assignment)]
    map: Vec<(String, String)>,
    /// Factor on a column: counts to radians, a gear ratio.
    #[arg(long, value_name = "NAME=FACTOR", value_parser = number_assignment)]
    scale: Vec<(String, f64)>,
    /// Added to a column after its factor.
    #[arg(long, value_name = "NAME=VALUE", value_parser = number_assignment)]
    offset: Vec<(String, f64)>,
    /// First sample to use, from 0; found when not given.
    #[arg(long, value_name = "N")]
    from_sample: Option<usize>,
    /// Period of the motion in seconds; found when not given.
    #[arg(long, value_name = "SECONDS")]
    period: Option<f64>,
    /// What the inputs do between samples.
    #[arg(long, value_enum)]
    hold: Option<HoldChoice>,
    /// Highest harmonic to compare; chosen from the spectrum when not given.
    #[arg(long, value_name = "N")]
    harmonics: Option<usize>,
    /// Value of a constant that is known at run time only.
    #[arg(long = "constant", value_name = "NAME=VALUE", value_parser = number_assignment)]
    constants: Vec<(String, f64)>,
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
    let dims = model.dims();
    let coordinates = (0..dims.coordinates).map(|i| model.coordinate(i).name.to_owned());
    let inputs = (0..dims.inputs).map(|i| model.input(i).name.to_owned());
    let mut signals: Vec<String> = coordinates.chain(inputs).collect();
    signals.push("t_s".to_owned());
    let constants: Vec<String> = (0..dims.constants).map(|i| model.constant(i).name.to_owned()).collect();
    let given = by_name("--constant", &args.constants, &constants)?;
    let value_of =
        |name: &String| given.get(name).copied().ok_or_else(|| Failure::Input(format!("give --constant {name}=VALUE")));
    let options = LogOptions {
        map: by_name("--map", &args.map, &signals)?,
        scale: by_name("--scale", &args.scale, &signals)?,
        offset: by_name("--offset", &args.offset, &signals)?,
        from_sample: args.from_sample,
        period: args.period,
        hold: match args.hold {
            Some(HoldChoice::Zoh) => Hold::Zoh,
            Some(HoldChoice::None) | None => Hold::None,
        },
        harmonics: args.harmonics,
        constants: constants.iter().map(value_of).collect::<Result<_, _>>()?,
        ..LogOptions::default()
    };
    let parameters = identified(&args.params, &model)?;
    let input = |error: &dyn std::fmt::Display| Failure::Input(error.to_string());
    let log = Log::open(&args.log, &model, &options).map_err(|error| input(&error))?;
    let result = validate_log(&model, &log, &options, &parameters).map_err(|error| input(&error))?;
    output::emit(args.output.as_deref(), &if args.json { output::json(&result)? } else { describe(&result) })
}

/// The values of a result, in the model's order.
fn identified(path: &Path, model: &Interpreted) -> Result<Vec<f64>, Failure> {
    let at = |what: String| Failure::Input(format!("{}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| Failure::read(path, error))?;
    let whole: serde_json::Value = serde_json::from_str(&text).map_err(|error| at(error.to_string()))?;
    if whole["schema"] != "tpm.identification/1" {
        return Err(at("this is no result of `tpm identify --json` (schema tpm.identification/1)".to_owned()));
    }
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
