//! `tpm campaign`: a campaign on a real machine, which exchanges files with it.

use crate::failure::{Failure, Outcome};
use crate::input::experiment::{BoundArgs, SimulatedArgs};
use crate::input::log::ColumnArgs;
use crate::output::file;
use crate::render::flags;
use crate::render::result::print;
use clap::Subcommand;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use tpm_runtime::report::{number, plus_minus};
use tpm_runtime::session::{CampaignFolder, NextStep, Submission};

/// Options of `tpm campaign`.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    step: Step,
}

#[derive(Subcommand)]
enum Step {
    /// Begin a campaign in a folder: model and experiment are copied there.
    Start {
        /// The model file.
        file: PathBuf,
        /// The folder; made when it is not there.
        folder: PathBuf,
        #[command(flatten)]
        simulated: SimulatedArgs,
    },
    /// Write the samples of the next run: reference with its derivatives, feed-forward; beside them (.json) feedback and
    /// limits.
    Next {
        /// The campaign's folder.
        folder: PathBuf,
        /// Write to this file (and one ending in .json) instead of standard output.
        #[arg(short, long, value_name = "CSV")]
        output: Option<PathBuf>,
    },
    /// Take in the log of the run that `next` gave, and say what comes: the next run, why a run is not pooled, what ended the campaign.
    ///
    /// A log that the campaign has already is refused. A run that contradicts the others is kept but not pooled.
    Submit {
        /// The campaign's folder.
        folder: PathBuf,
        /// The log: columns t_s, coordinates and applied inputs by name; measured rates, if any, in columns like dot(x).
        log: PathBuf,
        /// The machine, or whoever stood beside it, stopped the run: the log may end early, and amplitudes are reduced.
        #[arg(long)]
        stopped: bool,
        #[command(flatten)]
        columns: ColumnArgs,
    },
    /// Print what is known so far.
    Result {
        /// The campaign's folder.
        folder: PathBuf,
        #[command(flatten)]
        bounds: BoundArgs,
        /// Print the contract's JSON (tpm.identification/2).
        #[arg(long)]
        json: bool,
        /// Write to this file instead of standard output.
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    match &args.step {
        Step::Start { file, folder, simulated } => start(file, folder, simulated),
        Step::Next { folder, output } => next(folder, output.as_deref()),
        Step::Submit { folder, log, stopped, columns } => submit(folder, log, *stopped, columns),
        Step::Result { folder, bounds, json, output } => {
            let result = CampaignFolder::open(folder, bounds.by_name()?)?.result()?;
            print(&result, *json, output.as_deref())?;
            result.shortfall().map_or(Ok(()), |why| Err(Failure::Incomplete(why)))
        }
    }
}

fn start(file: &Path, folder: &Path, simulated: &SimulatedArgs) -> Outcome {
    let begun = CampaignFolder::begin(folder, simulated.session(file)?)?;
    file::print(&format!(
        "campaign of {} in {}; what to play: tpm campaign next {} -o run.csv\n",
        begun.session().model().prepared().model.name,
        folder.display(),
        folder.display()
    ))
}

fn next(folder: &Path, target: Option<&Path>) -> Outcome {
    let next = match CampaignFolder::open(folder, BTreeMap::new())?.next()? {
        NextStep::Play(next) => next,
        NextStep::Ended(outcome) => {
            return Err(Failure::Incomplete(format!("nothing is left to play: {}", outcome.describe())));
        }
    };
    if let Some(mode) = &next.near_mode {
        file::remark(&format!(
            "remark: harmonic {} of {} lies near a natural mode of the estimates ({} rad/s); choose another frequency of the stage, or schedule.avoid_modes = true",
            mode.harmonic,
            mode.signal,
            number(mode.frequency)
        ));
    }
    let Some(target) = target else { return file::print(&next.samples) };
    let beside = target.with_extension("json");
    let terms = file::json(&next.terms)?;
    file::write_files(&[(target, next.samples.as_bytes()), (&beside, terms.as_bytes())])?;
    file::print(&format!(
        "run {}: {} samples in {}, feedback and limits in {}\n",
        next.terms.run,
        next.trial.samples(),
        target.display(),
        beside.display()
    ))
}

fn submit(folder: &Path, log: &Path, stopped: bool, columns: &ColumnArgs) -> Outcome {
    let Submission { run, kept, outcome, result } =
        CampaignFolder::open(folder, BTreeMap::new())?.submit(columns.request(log)?, stopped)?;
    let pooled = if run.contradicts.is_some() { ", not pooled" } else { "" };
    let mut text = format!("run {}: {}{pooled}", run.run, run.ending);
    let named = if result.physical.is_empty() { &result.parameters } else { &result.physical };
    for parameter in named {
        // Writing to a string cannot fail.
        let _ = match (parameter.value, parameter.std) {
            (Some(value), Some(std)) => write!(text, "; {} = {}", parameter.name, plus_minus(value, std)),
            _ => write!(text, "; {} not shown", parameter.name),
        };
    }
    text.push('\n');
    text.push_str(&result.warnings_text(&flags::remedy));
    let folder = folder.display();
    let _ = match (kept, outcome) {
        (false, _) => {
            writeln!(text, "not kept: mend the sensor and play the run again: tpm campaign next {folder} -o run.csv")
        }
        (true, Some(outcome)) => {
            let limit = result.stop.as_ref().map(|stop| format!(": {stop}")).unwrap_or_default();
            writeln!(text, "ended: {}{limit}; tpm campaign result {folder}", outcome.describe())
        }
        (true, None) => writeln!(text, "next: tpm campaign next {folder} -o run.csv"),
    };
    file::print(&text)
}
