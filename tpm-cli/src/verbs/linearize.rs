//! `tpm linearize`: state space, transfer functions, poles and zeros of a model about a point at rest.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::assignment;
use crate::input::linear::{operating_point, state_space, tell_friction};
use crate::input::load::Loaded;
use crate::input::values::{ValueArgs, Values};
use crate::output::{file, picture};
use std::path::PathBuf;
use tpm_runtime::frequency::TransferFunction;
use tpm_runtime::study::{Band, Linearised, LinearisedError};
use tpm_symbolic::linear::linearize;

/// Options of `tpm linearize`.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("banded").args(["against", "plot"]).multiple(true)))]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// Value of a coordinate or input at the point, such as th2=pi or F=m*g; what is not given is 0.
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    at: Vec<(String, String)>,
    #[command(flatten)]
    values: ValueArgs,
    /// Transfer functions of this coordinate only.
    #[arg(long, value_name = "NAME")]
    measured: Option<String>,
    /// Transfer functions from this input only.
    #[arg(long, value_name = "NAME")]
    input: Option<String>,
    /// Another transfer function to put beside that of --measured over --input: coefficients of numerator and
    /// denominator, highest power first, such as 2,1/1,3,2.
    #[arg(long, value_name = "B,../A,..", value_parser = coefficients, allow_hyphen_values = true)]
    against: Option<TransferFunction>,
    /// Draw a Bode plot of the transfer function, with that of --against, into this file, .svg or .png.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Lowest frequency in Hz of comparison and plot; a tenth of the slowest pole's when not given.
    #[arg(long, value_name = "HZ", requires = "banded")]
    low: Option<f64>,
    /// Highest frequency in Hz of comparison and plot; ten times the fastest pole's when not given.
    #[arg(long, value_name = "HZ", requires = "banded")]
    high: Option<f64>,
    /// Print JSON (tpm.linearization/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

fn coefficients(text: &str) -> Result<TransferFunction, String> {
    let list = |part: &str| -> Result<Vec<f64>, String> {
        let mut list = Vec::new();
        for coefficient in part.split(',') {
            let value = coefficient.trim().parse::<f64>().map_err(|_| format!("`{coefficient}` is not a number"))?;
            list.push(value);
        }
        list.reverse();
        Ok(list)
    };
    let (numerator, denominator) =
        text.split_once('/').ok_or("write coefficients of numerator and denominator, such as 2,1/1,3,2")?;
    TransferFunction::new(&list(numerator)?, &list(denominator)?).map_err(|error| error.to_string())
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(path) = &args.plot {
        picture::Picture::of(path)?;
    }
    let fault = |text: String| Failure::Input(format!("{}: {text}", args.file.display()));
    let loaded = Loaded::from_file(&args.file)?;
    let mut model = loaded.model().clone();
    let coordinates: Vec<String> = model.coordinates.iter().map(|c| c.name.clone()).collect();
    let inputs: Vec<String> = model.inputs().map(|symbol| model.quantity(symbol).name.to_string()).collect();
    let values = Values::load(&args.values, &model)?;
    let point = operating_point(&args.at, &mut model, &coordinates, &inputs)?;
    let linear = linearize::linearize(&mut model, &point).map_err(|error| fault(error.to_string()))?;
    tell_friction(&model, &linear);
    let outputs = chosen("--measured", args.measured.as_deref(), &coordinates)?;
    let drives = chosen("--input", args.input.as_deref(), &inputs)?;
    let space = state_space(&model, &linear, &values)?;
    let mut found = Linearised::new(&mut model, &point, &linear, space, &outputs, &drives)
        .map_err(|error| fault(error.to_string()))?;
    let band = Band { low: args.low, high: args.high };
    if let Some(other) = &args.against {
        found.put_beside(other.clone(), band).map_err(|error| spelled("--against", error))?;
    }
    if let Some(path) = &args.plot {
        picture::draw(path, &found.bode(band).map_err(|error| spelled("--plot", error))?)?;
    }
    let text = if args.json { file::json(&found)? } else { found.to_string() };
    file::emit(args.output.as_deref(), &text)
}

/// Why `flag` cannot be done, with the flags that help.
fn spelled(flag: &str, error: LinearisedError) -> Failure {
    Failure::Input(match error {
        LinearisedError::NotOne(count) => {
            format!("{flag} needs one transfer function, and there are {count}; choose with --measured and --input")
        }
        LinearisedError::NoNumbers => {
            format!("{flag} needs the model in numbers; give --params FILE or --value NAME=VALUE")
        }
        LinearisedError::NoPole => format!("{error}; give --low and --high"),
        _ => error.to_string(),
    })
}

/// The index of the name that was given, or all indices when none was given.
fn chosen(flag: &str, name: Option<&str>, known: &[String]) -> Result<Vec<usize>, Failure> {
    let Some(name) = name else { return Ok((0..known.len()).collect()) };
    match known.iter().position(|other| other == name) {
        Some(index) => Ok(vec![index]),
        None => Err(Failure::Input(format!("{flag} {name}: the model has no such name; it has {}", known.join(", ")))),
    }
}

#[cfg(test)]
mod tests {
    use super::coefficients;

    #[test]
    fn coefficients_stand_highest_first() {
        let function = coefficients("4,2/2,0,6").expect("valid");
        assert_eq!((function.numerator(), function.denominator()), (&[1.0, 2.0][..], &[3.0, 0.0, 1.0][..]));
        assert!(coefficients("1").is_err() && coefficients("1/0").is_err() && coefficients("x/1").is_err());
    }
}
