//! `tpm feedforward`: the common and the split feed-forward side by side, on the simulated machine, with filters and motors.

use crate::failure::{Failure, Outcome};
use crate::output::{file, picture};
use crate::verbs::actuator::{MachineArgs, Use};
use std::path::PathBuf;
use tpm_runtime::plant::actuator::{FileFault, LoopFile};
use tpm_runtime::study::FeedForwards;

/// Options of `tpm feedforward`.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    machine: MachineArgs,
    /// The loop file: feedback and filters.
    #[arg(long = "loop", value_name = "FILE")]
    control: PathBuf,
    /// A motor file; forces are exact and unlimited where no motor is given.
    #[arg(long, value_name = "FILE")]
    motor: Option<PathBuf>,
    /// Draw the tracking errors of both schemes into this file, .svg or .png.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print JSON (tpm.feedforward/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(path) = &args.plot {
        picture::Picture::of(path)?;
    }
    // The simulated machine leaves its reference.
    let moved = args.machine.moved(Use::AnyMotion)?;
    let motors = args.motor.as_deref().map_or_else(|| Ok(Vec::new()), |path| moved.motors(path))?;
    let text = tpm_runtime::report::read_text(&args.control).map_err(|error| Failure::read(&args.control, error))?;
    let at = |fault: FileFault| Failure::Input(format!("{}: {fault}", args.control.display()));
    let file = LoopFile::parse(&text).map_err(at)?;
    let settle = file.settle_periods().map_err(at)?;
    let changed = file.plant().map_err(at)?;
    let plant =
        moved.with_parameters(changed.into_iter()).map_err(|(name, message)| at(file.refuse_plant(&name, message)))?;
    let scheme = |split: bool| file.scheme(moved.machine.machine.model(), split).map_err(at);
    let schemes = [scheme(false)?, scheme(true)?];
    let found = FeedForwards::new(&moved.machine, &plant, &motors, &schemes, settle)
        .map_err(|error| Failure::Input(error.to_string()))?;
    if let Some(path) = &args.plot {
        picture::draw(path, found.figure())?;
    }
    let text = if args.json { file::json(&found)? } else { found.to_string() };
    file::emit(args.output.as_deref(), &text)
}
