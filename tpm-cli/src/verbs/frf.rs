//! `tpm frf`: the frequency response of a machine from a log.

use crate::failure::Outcome;
use crate::input::measured::MeasuredArgs;
use crate::output::file;
use clap::ValueEnum;
use tpm_runtime::study::ResponseTable;

/// How the response is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// What was averaged, and some lines, for reading.
    Text,
    /// Every line of the band.
    Csv,
    /// Everything (tpm.frf/1).
    Json,
}

/// Options of `tpm frf`.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    measured: MeasuredArgs,
    /// How to write the response.
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let measured = args.measured.read()?;
    let found = ResponseTable::new(&measured, args.measured.estimator);
    let text = match args.format {
        Format::Text => found.to_string(),
        Format::Csv => found.csv(),
        Format::Json => file::json(&found)?,
    };
    args.measured.draw(&measured.bode(&[], None))?;
    file::emit(args.measured.output.as_deref(), &text)?;
    if args.format != Format::Text {
        for gap in found.warnings() {
            file::remark(&format!("warning: {gap}"));
        }
    }
    Ok(())
}
