//! `tpm simulate`: one run on the simulated plant, as a log.

use crate::Outcome;
use crate::failure::Failure;
use crate::input::experiment::{SimulatedArgs, Simulation};
use crate::output::file;
use crate::verbs::campaign::read_trial;
use std::path::PathBuf;
use tpm_runtime::campaign::samples_text;
use tpm_runtime::machine::simulated::simulate;
use tpm_runtime::model::Model;
use tpm_runtime::run::Ending;

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
    #[arg(short, long, value_name = "CSV")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let Simulation { machine, experiment, .. } = args.simulated.prepare(&args.file)?;
    let input = |error: &dyn std::fmt::Display| Failure::Input(error.to_string());
    let plant = machine.plant();
    let (setup, _) = experiment.stable_setup(plant, machine.pattern()).map_err(|error| input(&error))?;
    let campaign = machine.campaign(&experiment, setup).map_err(|error| input(&error))?;
    let Some(first) = campaign.next() else {
        return Err(Failure::Input("the experiment has no run to play".to_owned()));
    };
    let trial = match &args.play {
        Some(path) => read_trial(path, &machine, first)?,
        None => first.clone(),
    };
    let bench = experiment.bench_in_run(plant, trial.run).map_err(|error| input(&error))?;
    let other = experiment.other_plant(plant).map_err(|error| input(&error))?;
    let simulated = other.as_ref().map_or(plant as &dyn Model<f64>, |arm| arm as &dyn Model<f64>);
    let record = simulate(simulated, &bench, &trial).map_err(|error| input(&error))?;
    file::emit(args.output.as_deref(), &samples_text(plant, &record))?;
    match record.ending {
        Ending::Complete => {}
        Ending::TrackingBound { coordinate, sample, error } => file::remark(&format!(
            "remark: stopped at sample {sample}: the tracking error of {} passed its bound ({error})",
            plant.coordinate(coordinate).name
        )),
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
