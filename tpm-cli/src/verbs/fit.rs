//! `tpm fit`: a transfer function, or the physical parameters of a model, from the frequency response of a log.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::{by_name, number_assignment};
use crate::input::linear::tell_friction;
use crate::input::load::Loaded;
use crate::input::measured::MeasuredArgs;
use crate::input::values::{ValueArgs, Values};
use crate::output::file;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_runtime::frequency::Delay;
use tpm_runtime::harmonics::Hold;
use tpm_runtime::study::{FitRequest, ModelResponse, ResponseFit, StartedParameter};
use tpm_symbolic::expr::graph::{Coordinate, Symbol};
use tpm_symbolic::linear::linearize::{OperatingPoint, linearize};
use tpm_symbolic::number::rational;

/// Options of `tpm fit`.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("what").required(true).multiple(true).args(["order", "model"])))]
#[command(group(clap::ArgGroup::new("of_model").multiple(true).args(["model", "beside"])))]
pub(crate) struct Args {
    #[command(flatten)]
    measured: MeasuredArgs,
    /// Degrees of numerator and denominator, such as 1/3; several, 1/3,2/4, are compared by predicting the other half of
    /// the log.
    #[arg(long, value_name = "M/N", value_delimiter = ',', value_parser = degrees)]
    order: Vec<(usize, usize)>,
    /// Fit to the transform of the whole record with its transient, instead of the averaged response: smaller errors where
    /// noise on the output is strong.
    #[arg(long, requires = "order", conflicts_with = "model")]
    whole: bool,
    /// A known dead time of the transfer function, s.
    #[arg(long, value_name = "SECONDS", requires = "order")]
    dead_time: Option<f64>,
    /// Fit a dead time as well, starting from --dead-time or 0.
    #[arg(long, requires = "order")]
    fit_dead_time: bool,
    /// Fit the parameters of this model, linearised at rest in 0; input and measured output are named as in it.
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Put the transfer function of this model, linearised at rest in 0, beside what is fitted, in the plot too; input and
    /// measured output are named as in it, and its values are those of --params, --start and --constant.
    #[arg(long, value_name = "FILE")]
    beside: Option<PathBuf>,
    /// Start values of the parameters, and values of the constants, of the model: NAME = VALUE lines (.toml), or a result of
    /// `tpm identify --json` (.json).
    #[arg(long, value_name = "FILE", requires = "of_model")]
    params: Option<PathBuf>,
    /// Start value of a parameter of the model; goes before that of the file.
    #[arg(long, value_name = "NAME=VALUE", requires = "of_model", value_parser = number_assignment)]
    start: Vec<(String, f64)>,
    /// A parameter of the model that is held at a value.
    #[arg(long, value_name = "NAME=VALUE", requires = "model", value_parser = number_assignment)]
    freeze: Vec<(String, f64)>,
    /// Value of a constant that is known at run time only.
    #[arg(long = "constant", value_name = "NAME=VALUE", requires = "of_model", value_parser = number_assignment)]
    constants: Vec<(String, f64)>,
    /// Print JSON (tpm.fit/1).
    #[arg(long)]
    json: bool,
}

fn degrees(text: &str) -> Result<(usize, usize), String> {
    let parsed = text.split_once('/').and_then(|(m, n)| Some((m.trim().parse().ok()?, n.trim().parse().ok()?)));
    match parsed {
        Some((m, n)) if m <= 30 && n <= 30 => Ok((m, n)),
        Some(_) => Err(format!("`{text}`: degrees above 30 are not fitted")),
        None => Err(format!("`{text}` is not of the form M/N, such as 1/3")),
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let model = args.model.as_deref().map(|path| load(args, path)).transpose()?;
    let beside = args.beside.as_deref().map(|path| load(args, path)).transpose()?;
    let measured = args.measured.read()?;
    let request = FitRequest {
        orders: &args.order,
        delay: match (args.fit_dead_time, args.dead_time) {
            (true, start) => Delay::Free(start.unwrap_or(0.0)),
            (false, Some(delay)) => Delay::Fixed(delay),
            (false, None) => Delay::None,
        },
        whole: args.whole,
        model: model.as_ref(),
        beside: beside.as_ref(),
        estimator: args.measured.estimator,
    };
    let found = ResponseFit::new(&measured, &request).map_err(|error| Failure::Input(error.to_string()))?;
    if let Some(figure) = found.figure() {
        args.measured.draw(figure)?;
    }
    let text = if args.json { file::json(&found)? } else { found.to_string() };
    file::emit(args.measured.output.as_deref(), &text)?;
    if let Some(mut faults) = found.unrecommended() {
        if measured.response.welch.hold == Hold::None {
            faults.push(
                "an input that was held from sample to sample bends the response: say so with --hold zoh".to_owned(),
            );
        }
        return Err(Failure::Incomplete(format!("none of the orders can be recommended\n{}", faults.join("\n"))));
    }
    let incomplete = found.incomplete();
    if incomplete.is_empty() { Ok(()) } else { Err(Failure::Incomplete(incomplete.join("\n"))) }
}

/// A model of a file with the start values, fixed values and constants of its parameters.
fn load(args: &Args, path: &Path) -> Result<ModelResponse, Failure> {
    let loaded = Loaded::from_file(path)?;
    let mut model = loaded.model().clone();
    let named = |symbols: Vec<Symbol>| -> Vec<String> {
        symbols.iter().map(|symbol| loaded.model().quantity(*symbol).name.to_string()).collect()
    };
    let parameters: Vec<Symbol> = model.parameters().collect();
    let run_time: Vec<Symbol> = model.run_time_constants().collect();
    let inputs: Vec<Symbol> = model.inputs().collect();
    let (names, constant_names, input_names) =
        (named(parameters.clone()), named(run_time.clone()), named(inputs.clone()));
    let starts = by_name("--start", &args.start, &names)?;
    let held = by_name("--freeze", &args.freeze, &names)?;
    let constants = by_name("--constant", &args.constants, &constant_names)?;
    let (mut from_file, mut known) = (BTreeMap::new(), BTreeMap::new());
    if let Some(file) = &args.params {
        let values = Values::load(&ValueArgs::file(file), &model)?;
        let of = |symbols: &[Symbol], names: &[String]| -> BTreeMap<String, f64> {
            let given = symbols.iter().zip(names).filter_map(|(symbol, name)| Some((name, values.get(*symbol)?)));
            given.map(|(name, value)| (name.clone(), rational::to_f64(value))).collect()
        };
        (from_file, known) = (of(&parameters, &names), of(&run_time, &constant_names));
    }
    from_file.extend(starts);
    known.extend(constants);
    let (starts, constants) = (from_file, known);
    let missing: Vec<String> = names
        .iter()
        .filter(|name| !starts.contains_key(*name) && !held.contains_key(*name))
        .map(|name| format!("--start {name}=VALUE"))
        .chain(constant_names.iter().filter(|n| !constants.contains_key(*n)).map(|n| format!("--constant {n}=VALUE")))
        .collect();
    if !missing.is_empty() {
        return Err(Failure::Input(format!(
            "a fit of {} needs values to start from; give --params FILE, or {} (or --freeze for what is known)",
            model.name,
            missing.join(" ")
        )));
    }
    let input = input_names.iter().position(|name| *name == args.measured.input).ok_or_else(|| {
        Failure::Input(format!(
            "--input {}: the model has no such input; it has {}",
            args.measured.input,
            input_names.join(", ")
        ))
    })?;
    let coordinates: Vec<&str> = model.coordinates.iter().map(|c| c.name.as_str()).collect();
    let coordinate = coordinates.iter().position(|name| *name == args.measured.measured).ok_or_else(|| {
        Failure::Input(format!(
            "--measured {}: the model has no such coordinate; it has {}",
            args.measured.measured,
            coordinates.join(", ")
        ))
    })?;
    let linear = linearize(&mut model, &OperatingPoint::default())
        .map_err(|error| Failure::Input(format!("{}: {error}", path.display())))?;
    tell_friction(&model, &linear);
    let started = |(symbol, name): (&Symbol, &String)| StartedParameter {
        symbol: *symbol,
        name: name.clone(),
        start: held.get(name).or_else(|| starts.get(name)).copied().unwrap_or(0.0),
        frozen: held.contains_key(name),
    };
    Ok(ModelResponse {
        linear,
        input: inputs[input],
        coordinate: Coordinate(coordinate as u32),
        parameters: parameters.iter().zip(&names).map(started).collect(),
        constants: run_time.iter().zip(&constant_names).map(|(symbol, name)| (*symbol, constants[name])).collect(),
        model,
    })
}

#[cfg(test)]
mod tests {
    use super::degrees;

    #[test]
    fn orders_are_two_degrees() {
        assert_eq!(degrees("1/3"), Ok((1, 3)));
        assert!(degrees("3").is_err() && degrees("a/b").is_err() && degrees("1/99").is_err());
    }
}
