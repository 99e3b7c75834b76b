//! `tpm inertias`: possible inertias of an arm's links from its identified base parameters.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::{number_assignment, once};
use crate::input::description::{PartArgs, description};
use crate::input::experiment::model;
use crate::input::values::stored_result;
use crate::output::file;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_codegen::import::{Described, mjcf, with_inertials};
use tpm_codegen::source::Source;
use tpm_runtime::inertia::{Inertias, InertiasRequest, Origin, inertias};

/// What stands below the options in the help.
const ENDING: &str =
    "Exit codes: 0 whenever possible inertias were found; 2 when model, result and description do not go together";

/// Options of `tpm inertias`.
#[derive(clap::Args)]
#[command(after_help = ENDING)]
pub(crate) struct Args {
    /// The model of the arm, as `tpm import` made it.
    file: PathBuf,
    /// The result of its identification: a file of `tpm identify --json`.
    #[arg(value_name = "RESULT.json")]
    result: PathBuf,
    /// The description (URDF) from which the model was imported; --base, --tip, --lock and --angles must be those of the import.
    #[arg(long, value_name = "FILE")]
    description: PathBuf,
    #[command(flatten)]
    part: PartArgs,
    /// Value of a parameter in place of the description's, such as a rotor's inertia or a mass that was weighed.
    #[arg(long = "value", value_name = "NAME=VALUE", value_parser = number_assignment)]
    values: Vec<(String, f64)>,
    /// Weight of the description; 1 takes it for known within 100 %, 25 within 20 %.
    #[arg(long = "description-weight", value_name = "WEIGHT", default_value_t = 1.0)]
    weight: f64,
    /// Write the description with the new inertias, and frictions where it has them; everything else stays as it was.
    #[arg(long, value_name = "FILE")]
    urdf: Option<PathBuf>,
    /// Write a model for MuJoCo with the new inertias, frictions and rotors, without shapes.
    #[arg(long, value_name = "FILE")]
    mjcf: Option<PathBuf>,
    /// Print JSON (tpm.inertias/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output; one ending in .toml gets NAME = VALUE lines, as --params reads them.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let model = model(&args.file)?;
    let result = stored_result(&args.result)?;
    let source = description(&args.description)?;
    let described = Described::read(&source, &args.part.options())
        .map_err(|diagnostics| Failure::Model(diagnostics.render(&source)))?;
    let values: BTreeMap<String, f64> = once("--value", &args.values)?.into_iter().collect();
    let request =
        InertiasRequest { model: &model, result: &result, described: &described, values: &values, weight: args.weight };
    let found = inertias(&request).map_err(|fault| {
        Failure::Input(format!(
            "{}, {} and {}: {fault}",
            args.file.display(),
            args.result.display(),
            args.description.display()
        ))
    })?;
    let lines = args.output.as_deref().is_some_and(|path| path.extension().is_some_and(|own| own == "toml"));
    let text = match (args.json, lines) {
        (true, _) => file::json(&found)?,
        (false, true) => assignments(&found),
        (false, false) => found.to_string(),
    };
    let mut texts: Vec<(&Path, String)> = Vec::new();
    if let Some(path) = &args.urdf {
        texts.push((path, urdf(&source, &described, &found)?));
    }
    if let Some(path) = &args.mjcf {
        let text = mjcf(&described, &found.parted.bodies, &found.losses);
        texts.push((path, text.map_err(|fault| Failure::Input(format!("{}: {fault}", args.description.display())))?));
    }
    let output = file::named(args.output.as_deref());
    if let Some(path) = output {
        texts.push((path, text.clone()));
    }
    let files: Vec<(&Path, &[u8])> = texts.iter().map(|(path, text)| (*path, text.as_bytes())).collect();
    file::write_files(&files)?;
    if lines && !args.json {
        file::remark(&found.to_string());
    }
    if output.is_none() { file::print(&text) } else { Ok(()) }
}

/// The description with the inertias that were found.
fn urdf(source: &Source, described: &Described, found: &Inertias) -> Result<String, Failure> {
    if found.losses.values().any(|losses| losses.rotor.is_some_and(|rotor| rotor > 0.0)) {
        file::remark(
            "remark: a URDF has no place for the inertia of rotors: they are in the model for MuJoCo (--mjcf), and in --json",
        );
    }
    with_inertials(source, &found.parted.links, &described.frictions_of_joints(&found.losses))
        .map_err(|diagnostics| Failure::Model(diagnostics.render(source)))
}

/// `NAME = VALUE` for every parameter of which something is known.
fn assignments(found: &Inertias) -> String {
    let known = found.parameters.iter().filter(|own| own.origin != Origin::Nothing);
    known.map(|own| format!("{} = {:?}\n", own.name, own.value)).collect()
}
