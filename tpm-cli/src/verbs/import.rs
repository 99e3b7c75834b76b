//! `tpm import`: a robot description as a model, with a prior and an experiment beside it.

use crate::failure::{Failure, Outcome};
use crate::input::description::{PartArgs, description};
use crate::output::file;
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use tpm_codegen::diagnostic::{Diagnostics, render};
use tpm_codegen::import::{Imported, Options, import_description};
use tpm_symbolic::mechanics::tree::mechanism::Loss;

/// Options of `tpm import`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The robot description (URDF, or MJCF of MuJoCo).
    file: PathBuf,
    #[command(flatten)]
    part: PartArgs,
    /// Unknown torques of every drive; those that the description has a value for when not given.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "TORQUES")]
    losses: Option<Vec<LossChoice>>,
    /// The model file to write; `arm.prior.toml` and `arm.experiment.toml` go beside `arm.tpm`; `-` prints the model alone.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

/// An unknown torque of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LossChoice {
    /// None at all.
    None,
    /// Friction that grows with the rate.
    Viscous,
    /// Dry friction.
    Coulomb,
    /// A constant.
    Offset,
    /// The inertia of the rotor.
    Rotor,
    /// What dry friction has more at rest, and the rate at which that falls.
    Stribeck,
}

impl LossChoice {
    /// The loss of the drive itself; friction that falls with the rate is a force beside it.
    fn loss(self) -> Option<Loss> {
        match self {
            Self::None | Self::Stribeck => None,
            Self::Viscous => Some(Loss::Viscous),
            Self::Coulomb => Some(Loss::Coulomb),
            Self::Offset => Some(Loss::Offset),
            Self::Rotor => Some(Loss::Rotor),
        }
    }
}

/// The model of a robot description, its prior and its experiment, as the command writes them without options.
pub(crate) fn files(description: &Path, model: &Path) -> Result<[(PathBuf, String); 3], Failure> {
    let args = Args { file: description.to_owned(), part: PartArgs::whole(), losses: None, output: model.to_owned() };
    Ok(beside(model, imported(&args)?))
}

/// What was imported, by the files that it goes into.
fn beside(model: &Path, imported: Imported) -> [(PathBuf, String); 3] {
    [
        (model.to_owned(), imported.model),
        (model.with_extension("prior.toml"), imported.prior),
        (model.with_extension("experiment.toml"), imported.experiment),
    ]
}

/// The description as a model, after what there is to say about it.
fn imported(args: &Args) -> Result<Imported, Failure> {
    let source = description(&args.file)?;
    let losses = args.losses.as_ref();
    let options = Options {
        losses: losses.map(|losses| losses.iter().filter_map(|choice| choice.loss()).collect()),
        stribeck: losses.is_some_and(|losses| losses.contains(&LossChoice::Stribeck)),
        ..args.part.options()
    };
    let imported = import_description(&source, &options)
        .map_err(|diagnostics: Diagnostics| Failure::Model(diagnostics.render(&source)))?;
    for warning in &imported.warnings {
        file::remark(render(&source, warning).trim_end());
    }
    for reading in &imported.readings {
        file::remark(&format!("remark: {reading}"));
    }
    Ok(imported)
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let imported = imported(args)?;
    if file::named(Some(&args.output)).is_none() {
        file::remark("remark: prior and experiment go beside a file: -o arm.tpm");
        return file::print_content(&imported.model);
    }
    let files = beside(&args.output, imported);
    file::write_files(&files.each_ref().map(|(path, text)| (path.as_path(), text.as_bytes())))
}
