//! `tpm split`: for every input, the part that holds its own coordinate still and the part that moves it, with the
//! harmonics of both.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::{assignment, once};
use crate::input::load::Loaded;
use crate::input::values::{ValueArgs, Values};
use crate::output::file;
use std::path::PathBuf;
use tpm_codegen::emit::table;
use tpm_runtime::study::{InputParts, numeric_parts};
use tpm_symbolic::expr::graph::{Coordinate, Symbol};
use tpm_symbolic::harmonic::expand::{ExpandOptions, expand_with};
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::split::{Split, split};
use tpm_symbolic::regressor::prepare::prepare;

/// Highest numeric harmonic of a motion when none is given.
const HARMONICS: usize = 15;

/// Options of `tpm split`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// The coordinates that an input drives, such as u=phi or F=x,y; found from the equations when not given.
    #[arg(long, value_name = "INPUT=COORDINATE,..", value_parser = assignment)]
    motion: Vec<(String, String)>,
    /// The pattern for the harmonics; the model's first when not given.
    #[arg(long, value_name = "NAME")]
    pattern: Option<String>,
    /// Highest harmonic of what has infinitely many.
    #[arg(long, value_name = "N")]
    harmonics: Option<usize>,
    #[command(flatten)]
    values: ValueArgs,
    /// Print JSON (tpm.split/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// The coordinates given with `--motion`, by input symbol.
pub(crate) fn motions(
    model: &ExactModel,
    given: &[(String, String)],
) -> Result<Vec<(Symbol, Vec<Coordinate>)>, Failure> {
    let inputs: Vec<Symbol> = model.inputs().collect();
    let mut motions = Vec::new();
    for (input, coordinates) in &once("--motion", given)? {
        let symbol = inputs.iter().copied().find(|symbol| model.quantity(*symbol).name == *input).ok_or_else(|| {
            let names: Vec<&str> = inputs.iter().map(|symbol| model.quantity(*symbol).name.as_str()).collect();
            Failure::Input(format!(
                "--motion {input}=...: the model has no input `{input}`; it has {}",
                names.join(", ")
            ))
        })?;
        let mut driven = Vec::new();
        for name in coordinates.split(',').map(str::trim) {
            let found = (0u32..).zip(&model.coordinates).find(|(_, info)| info.name == name);
            let (index, _) = found.ok_or_else(|| {
                let names: Vec<&str> = model.coordinates.iter().map(|info| info.name.as_str()).collect();
                Failure::Input(format!(
                    "--motion {input}={coordinates}: the model has no coordinate `{name}`; it has {}",
                    names.join(", ")
                ))
            })?;
            driven.push(Coordinate(index));
        }
        motions.push((symbol, driven));
    }
    Ok(motions)
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let loaded = Loaded::from_file(&args.file)?;
    let model = loaded.model();
    let motions = motions(model, &args.motion)?;
    let mut parts = split(model, &motions).map_err(|error| loaded.at_split(&error))?;
    let pattern = match (&args.pattern, model.patterns.is_empty()) {
        (None, true) => None,
        (name, _) => Some(loaded.pattern(name.as_deref())?),
    };
    let values = Values::load_with(&args.values, model, pattern)?;
    let found = match pattern {
        None => InputParts::new(&mut parts, None),
        Some(pattern) if values.is_empty() => {
            let table = exact(&loaded, &motions, pattern, args.harmonics)?;
            InputParts::new(&mut parts, table)
        }
        Some(pattern) => {
            let harmonics = args.harmonics.or_else(|| loaded.harmonics(pattern)).unwrap_or(HARMONICS);
            in_numbers(&loaded, &mut parts, pattern, &values, harmonics)?
        }
    };
    let text = if args.json { file::json(&found)? } else { found.to_string() };
    file::emit(args.output.as_deref(), &text)
}

/// The exact harmonic table of the parts; none, with a remark, where the motion has no finite table.
fn exact(
    loaded: &Loaded,
    motions: &[(Symbol, Vec<Coordinate>)],
    pattern: &Pattern,
    harmonics: Option<usize>,
) -> Result<Option<HarmonicTable>, Failure> {
    let model = loaded.model_for_tables()?;
    let parts = split(&model, motions).map_err(|error| loaded.at_split(&error))?;
    let parts = parts.parts().and_then(prepare).map_err(|error| loaded.at(&error))?;
    let harmonics = harmonics.or_else(|| loaded.harmonics(pattern));
    let mut options = ExpandOptions { harmonics, ..ExpandOptions::default() };
    match expand_with(&parts.model, &parts.form, pattern, &mut options) {
        Ok(table) => {
            for tail in &table.tails {
                file::remark(&format!("remark: {}", table::left_out(&table, tail)));
            }
            Ok(Some(table))
        }
        Err(error) => {
            file::remark(&format!("remark: there is no table of the harmonics\n{}", loaded.remark(&error)));
            Ok(None)
        }
    }
}

fn in_numbers(
    loaded: &Loaded,
    split: &mut Split,
    pattern: &Pattern,
    values: &Values,
    harmonics: usize,
) -> Result<InputParts, Failure> {
    let model = loaded.model();
    let missing = values.missing(model, Some(pattern));
    if !missing.is_empty() {
        return Err(Failure::Input(format!(
            "harmonics in numbers need a value of {}; give them with --params FILE or --value NAME=VALUE, or none at all for the exact table",
            missing.join(", ")
        )));
    }
    let parts = split.parts().and_then(prepare).map_err(|error| loaded.at(&error))?;
    let waves = |values: &Values| {
        let value = |symbol: Symbol| match &model.symbols.get(symbol.0 as usize).map(|quantity| &quantity.kind) {
            Some(Kind::Constant { value: Some(value) }) => rational::to_f64(value),
            _ => values.get(symbol).map_or(f64::NAN, rational::to_f64),
        };
        numeric_parts(&parts, pattern, harmonics, value).map_err(|error| loaded.at(&error))
    };
    let values = values.settled(|values| {
        let lines = waves(values)?.into_iter().flat_map(|part| {
            let name = format!("the part {}", parts.form.rows[part.equation].name);
            part.wave.cos.into_iter().chain(part.wave.sin).map(move |value| (name.clone(), value))
        });
        Ok(lines.collect())
    })?;
    let waves = waves(&values)?;
    Ok(InputParts::new(split, None).with_waves(&parts, &waves, harmonics))
}
