//! `tpm simulate`: one run on the simulated plant, as a log.

use crate::failure::{Failure, Outcome};
use crate::input::experiment::SimulatedArgs;
use crate::output::file;
use std::path::PathBuf;
use tpm_runtime::campaign::{read_trial, samples_text};
use tpm_runtime::model::Model as _;
use tpm_runtime::motion::Ending;
use tpm_runtime::session::SessionError;

/// Options of `tpm simulate`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    #[command(flatten)]
    simulated: SimulatedArgs,
    /// Play the run that `tpm campaign next` wrote to this file; the experiment's first run when not given.
    #[arg(long, value_name = "CSV")]
    play: Option<PathBuf>,
    /// Write the log to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let session = args.simulated.session(&args.file)?;
    let plant = session.machine().plant();
    let (campaign, _) = session.campaign()?;
    let first = campaign.next().ok_or(SessionError::NothingToPlay)?;
    let trial = match &args.play {
        Some(path) if !path.with_extension("json").exists() => {
            return Err(Failure::Input(format!(
                "{} has no {} beside it; type the file that `tpm campaign next DIR -o FILE` wrote",
                path.display(),
                path.with_extension("json").display()
            )));
        }
        Some(path) => read_trial(path, plant, first).map_err(SessionError::from)?,
        None => first.clone(),
    };
    let record = session.simulate(&trial)?;
    file::emit(args.output.as_deref(), &samples_text(plant, &record))?;
    match record.ending {
        Ending::Complete => {}
        Ending::TrackingBound { coordinate, sample, error } => file::remark(&format!(
            "remark: stopped at sample {sample}: the tracking error of {} passed its bound ({error})",
            plant.coordinate(coordinate).name
        )),
        Ending::PositionBound { coordinate, sample, position } => file::remark(&format!(
            "remark: stopped at sample {sample}: {} left its range ({position})",
            plant.coordinate(coordinate).name
        )),
        Ending::VelocityBound { coordinate, sample, velocity } => file::remark(&format!(
            "remark: stopped at sample {sample}: the velocity of {} passed its bound ({velocity})",
            plant.coordinate(coordinate).name
        )),
        Ending::Stopped { sample } => file::remark(&format!("remark: stopped at sample {sample}")),
        Ending::SensorLost { coordinate, sample } => file::remark(&format!(
            "remark: stopped at sample {sample}: the sensor of {} gave no value",
            plant.coordinate(coordinate).name
        )),
        Ending::Diverged { sample } => {
            file::remark(&format!("remark: stopped at sample {sample}: the motion diverged"))
        }
    }
    Ok(())
}
