//! `tpm export`: a model with identified values in the format of another program.

use crate::failure::{Failure, Outcome};
use crate::input::choice::one_of;
use crate::input::load::Loaded;
use crate::output::file;
use crate::verbs::generate::{deliver, fault, identified, target_of};
use clap::builder::TypedValueParser;
use std::path::{Path, PathBuf};
use tpm_codegen::export::{Format, Request, Told, export};
use tpm_codegen::import::with_losses;
use tpm_codegen::source::Source;
use tpm_runtime::report::{MOST_TEXT, read_input};

/// What stands below the options in the help.
const ENDING: &str =
    "Exit codes: 0 done; 1 written, and the result is not trusted (0 with --anyway); 2 bad input, nothing is written";

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    Mjcf,
    Of(Format),
}

impl Target {
    fn name(self) -> &'static str {
        match self {
            Self::Of(Format::Casadi) => "casadi",
            Self::Of(Format::StructuredText) => "st",
            Self::Of(Format::Arduino) => "arduino",
            _ => "mjcf",
        }
    }
}

fn target() -> impl TypedValueParser<Value = Target> {
    let help = |target: Target| match target {
        Target::Of(Format::Casadi) => "A file in Python with functions of CasADi: inverse and forward dynamics",
        Target::Of(Format::StructuredText) => {
            "Structured text (IEC 61131-3): function blocks for the feed-forward and the friction in it"
        }
        Target::Of(Format::Arduino) => "A library for Arduino, a folder, around the code in C",
        _ => "A model for MuJoCo that is there (--into), with new numbers of its joints and every other byte as it was",
    };
    let formats = [Format::Casadi, Format::StructuredText, Format::Arduino].map(Target::Of);
    let all = [Target::Mjcf, formats[0], formats[1], formats[2]];
    one_of(all.map(|target| (target, target.name(), help(target))))
}

/// Options of `tpm export`.
#[derive(clap::Args)]
#[command(after_help = ENDING)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// The values: a result of `tpm identify --json`, or NAME = VALUE lines (.toml).
    #[arg(long, value_name = "FILE")]
    params: PathBuf,
    /// The format.
    #[arg(long, value_name = "FORMAT", value_parser = target())]
    to: Target,
    /// With --to mjcf, the model for MuJoCo whose joints get the values; joints are named as the coordinates.
    #[arg(long, value_name = "FILE.xml")]
    into: Option<PathBuf>,
    /// Write into this folder, which is made when there is none; or to this file, when there is one and the name ends as the format's files
    /// do. Standard output when not given.
    #[arg(short, long, value_name = "PATH")]
    output: Option<PathBuf>,
    /// End with 0 although the result is not trusted; the files say that it is not, all the same.
    #[arg(long)]
    anyway: bool,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let loaded = Loaded::from_file(&args.file)?;
    let output = file::named(args.output.as_deref());
    let (told, lost) = match (args.to, &args.into) {
        (Target::Mjcf, Some(into)) => mjcf(args, &loaded, into, output)?,
        (Target::Mjcf, None) => {
            return Err(Failure::Input(
                "--to mjcf changes a file that is there: name it with --into robot.xml".to_owned(),
            ));
        }
        (_, Some(_)) => {
            return Err(Failure::Input("--into is for --to mjcf; the other formats are written whole".to_owned()));
        }
        (Target::Of(format), None) => code(args, &loaded, format, output)?,
    };
    if !lost.is_empty() {
        let list: String = lost.iter().map(|own| format!("\n  {own}")).collect();
        file::remark(&format!("warning: {} does not hold all of the result:{list}", args.to.name()));
    }
    match told.note().filter(|_| !args.anyway) {
        Some(note) => Err(Failure::Incomplete(format!("{}: {note} (--anyway ends with 0)", args.params.display()))),
        None => Ok(()),
    }
}

/// The joints of a model for MuJoCo.
fn mjcf(args: &Args, loaded: &Loaded, into: &Path, output: Option<&Path>) -> Result<(Told, Vec<String>), Failure> {
    let (known, text) = identified(&args.params, loaded, &[])?;
    let bytes = read_input(into, MOST_TEXT).map_err(|error| Failure::read(into, error))?;
    let source = Source::from_bytes(into.display().to_string(), bytes);
    let told = Told::from_json(&text);
    let written = with_losses(&source, loaded.model(), &known, told.note().as_deref())
        .map_err(|faults| Failure::Model(faults.render(&source)))?;
    match output {
        Some(path) => file::write_file(path, written.text.as_bytes())?,
        None => file::print_content(&written.text)?,
    }
    let lost = told.actuators.iter().cloned().chain(written.lost).collect();
    Ok((told, lost))
}

/// Files that are written whole.
fn code(args: &Args, loaded: &Loaded, format: Format, output: Option<&Path>) -> Result<(Told, Vec<String>), Failure> {
    let estimator = loaded.estimator()?;
    let columns: Vec<&str> = estimator.form.columns.iter().map(|column| column.name.as_str()).collect();
    let (known, text) = identified(&args.params, loaded, &columns)?;
    let told = Told::from_json(&text);
    let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let command = format!("tpm export {} --params {} --to {}", name(&args.file), name(&args.params), args.to.name());
    let request = Request { identified: &known, told: &told, command: &command };
    let exported = export(&estimator, format, &request)
        .map_err(|error| fault(&error, Some(&args.params), Some(&known), loaded))?;
    deliver(target_of(output, &exported.files)?, &exported.files)?;
    Ok((told, exported.lost))
}
