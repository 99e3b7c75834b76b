//! `tpm campaign`: a campaign on a real machine, by files or behind a program that drives it.

use crate::failure::{Failure, Outcome};
use crate::input::experiment::{BoundArgs, SimulatedArgs, model};
use crate::input::issue::IssueArgs;
use crate::input::limits::LimitArgs;
use crate::input::log::ColumnArgs;
use crate::interrupt;
use crate::output::{file, writable};
use crate::render::campaign::Watched;
use crate::render::flags;
use crate::render::method::Style;
use crate::render::result::{print, print_with_method};
use clap::Subcommand;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tpm_runtime::campaign::RunReport;
use tpm_runtime::motion::{Record, Trial};
use tpm_runtime::report::{number, plus_minus};
use tpm_runtime::session::{CampaignFolder, ExperimentRequest, NextStep, Session, SessionError, Submission};

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
        #[command(flatten)]
        limits: LimitArgs,
    },
    /// Write the samples of the next run: reference with its derivatives, feed-forward; beside them (.json) feedback and
    /// limits.
    Next {
        /// The campaign's folder.
        folder: PathBuf,
        /// Write to this file (and one ending in .json) instead of standard output.
        #[arg(short, long, value_name = "FILE")]
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
    /// Play a whole campaign on a machine behind a program, and print the result.
    ///
    /// The program speaks tpm.machine/1, lines of JSON over standard input and output. A campaign that broke off goes on from the runs
    /// in its folder when the same command is given again.
    Run(Box<RunArgs>),
    /// Print what is known so far.
    Result {
        /// The campaign's folder.
        folder: PathBuf,
        #[command(flatten)]
        bounds: BoundArgs,
        /// Also show how the method came to the parameters: run by run the harmonics of error and inputs beside their prediction, the matrix
        /// T B Lambda, the update; then one row per update. JSON has all lines under `method`.
        #[arg(long, value_enum, value_name = "STYLE", num_args = 0..=1, require_equals = true, default_missing_value = "text")]
        method: Option<Style>,
        /// Write a page for a browser (report.html), its figures and a table of the runs into this folder.
        #[arg(long, value_name = "DIR")]
        report: Option<PathBuf>,
        #[command(flatten)]
        issue: IssueArgs,
        /// Print the contract's JSON (tpm.identification/2).
        #[arg(long)]
        json: bool,
        /// Write to this file instead of standard output.
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
}

/// Options of `tpm campaign run`.
#[derive(clap::Args)]
struct RunArgs {
    /// The model file.
    file: PathBuf,
    /// The program that drives the machine, with its arguments: words between blanks, or in quotes; no shell takes part.
    #[arg(long, value_name = "COMMAND")]
    machine: String,
    /// Longest wait for a line of the program, s; a machine that plays runs may be silent for the duration of a run beside it.
    #[arg(long, value_name = "SECONDS", default_value = "30", value_parser = seconds)]
    timeout: Duration,
    /// Keep every run in this folder as it ends, and go on from the runs that are there; a folder of the model's name ending in
    /// .campaign when not given.
    #[arg(long, value_name = "DIR")]
    runs: Option<PathBuf>,
    #[command(flatten)]
    simulated: SimulatedArgs,
    #[command(flatten)]
    limits: LimitArgs,
    #[command(flatten)]
    bounds: BoundArgs,
    /// Write a page for a browser (report.html), its figures and a table of the runs into this folder.
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    #[command(flatten)]
    issue: IssueArgs,
    /// Print the contract's JSON (tpm.identification/2).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

fn seconds(text: &str) -> Result<Duration, String> {
    let found = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    found.filter(|time| !time.is_zero()).ok_or_else(|| format!("`{text}` is no time in seconds"))
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    match &args.step {
        Step::Start { file, folder, simulated, limits } => start(file, folder, simulated, limits),
        Step::Next { folder, output } => next(folder, output.as_deref()),
        Step::Submit { folder, log, stopped, columns } => submit(folder, log, *stopped, columns),
        Step::Run(args) => play(args),
        Step::Result { folder, bounds, method, report, issue, json, output } => {
            writable(output.as_deref(), report.as_deref())?;
            let mut folder = CampaignFolder::open(folder, bounds.by_name()?)?;
            if method.is_some() {
                folder = folder.showing_method();
            }
            let mut seen = Watched::default();
            let result = folder.result_watched(&mut |trial, record, run| {
                if report.is_some() {
                    seen.see(trial, record, run);
                }
                true
            })?;
            print_with_method(&result, *json, method.unwrap_or(Style::Text), output.as_deref())?;
            if let Some(report) = report {
                seen.write(report, folder.session(), &result, issue.now())?;
            }
            result.shortfall().map_or(Ok(()), |why| Err(Failure::Incomplete(why)))
        }
    }
}

fn start(file: &Path, folder: &Path, simulated: &SimulatedArgs, limits: &LimitArgs) -> Outcome {
    let request = ExperimentRequest { by_limits: limits.request()?, ..simulated.request() };
    let begun = CampaignFolder::begin(folder, Session::open(model(file)?, file, &request)?)?;
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
    let Some(target) = file::named(target) else { return file::print_content(&next.samples) };
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

fn play(args: &RunArgs) -> Outcome {
    writable(args.output.as_deref(), args.report.as_deref())?;
    let request = ExperimentRequest {
        bounds: args.bounds.by_name()?,
        by_limits: args.limits.request()?,
        ..args.simulated.request()
    };
    let session = Session::open(model(&args.file)?, &args.file, &request)?;
    let own = || Path::new(args.file.file_name().unwrap_or_default()).with_extension("campaign");
    let place = args.runs.clone().unwrap_or_else(own);
    let folder = CampaignFolder::begin(&place, session)?;
    let kept = folder.store().fingerprints().map_err(SessionError::from)?.len();
    if kept > 0 {
        file::remark(&format!("remark: going on from {kept} runs in {}", place.display()));
    }
    let mut seen = Watched::default();
    let (played, interrupted) = interrupt::watched(|go_on| {
        let mut step = |trial: &Trial, record: &Record, run: &RunReport| {
            if args.report.is_some() {
                seen.see(trial, record, run);
            }
            if run.run > kept {
                file::remark(&progress(run));
            }
            go_on()
        };
        let machine = folder.machine(args.machine.clone(), args.timeout, &go_on);
        let played = machine.and_then(|mut machine| {
            let result = folder.play(&mut machine, &mut step);
            for stop in machine.stops() {
                file::remark(&format!("remark: run {}: the machine stopped: {}", stop.run, stop.reason));
            }
            result
        });
        (played, !go_on())
    });
    match played {
        Ok(result) => {
            print(&result, args.json, args.output.as_deref())?;
            if let Some(report) = &args.report {
                seen.write(report, folder.session(), &result, args.issue.now())?;
            }
            if interrupted {
                return Err(Failure::Interrupted);
            }
            result.shortfall().map_or(Ok(()), |why| Err(Failure::Incomplete(why)))
        }
        Err(error) => {
            let goes_on =
                format!("finished runs are kept in {}, and the same command goes on from them", place.display());
            match error {
                SessionError::Bench(_) if interrupted => {
                    file::remark(&format!("remark: the machine was told to stop; {goes_on}"));
                    Err(Failure::Interrupted)
                }
                SessionError::Bench(fault) => Err(Failure::Input(format!("the machine: {fault}; {goes_on}"))),
                other => Err(other.into()),
            }
        }
    }
}

/// A run that has just ended, with what is known after it.
fn progress(run: &RunReport) -> String {
    let mut text = format!("run {}: {}", run.run, run.ending);
    for parameter in &run.parameters {
        if let (Some(value), Some(std)) = (parameter.value, parameter.std) {
            // Writing to a string cannot fail.
            let _ = write!(text, "; {} = {}", parameter.name, plus_minus(value, std));
        }
    }
    text
}

fn submit(folder: &Path, log: &Path, stopped: bool, columns: &ColumnArgs) -> Outcome {
    let Submission { run, kept, outcome, result } =
        CampaignFolder::open(folder, BTreeMap::new())?.submit(columns.request(log)?, stopped)?;
    let folder = folder.display();
    let pooled = if run.contradicts.is_some() { ", not pooled" } else { "" };
    let mut text = format!("run {}: {}{pooled}", run.run, run.ending);
    match &result {
        Ok(result) => {
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
        }
        Err(_) => text.push('\n'),
    }
    let limit = result.as_ref().ok().and_then(|result| result.stop.as_ref()).map(|stop| format!(": {stop}"));
    // Writing to a string cannot fail.
    let _ = match (kept, outcome) {
        (false, _) => Ok(()),
        (true, Some(outcome)) => {
            let limit = limit.unwrap_or_default();
            writeln!(text, "ended: {}{limit}; tpm campaign result {folder}", outcome.describe())
        }
        (true, None) => writeln!(text, "next: tpm campaign next {folder} -o run.csv"),
    };
    // The exit code says whether the run was taken, whatever becomes of what is said about it.
    if let Err(failure) = file::print(&text) {
        file::remark(&format!("remark: {failure}"));
    }
    if let Err(fault) = result {
        file::remark(&format!("remark: the result of all runs is not known: {}", Failure::from(fault)));
    }
    if kept {
        return Ok(());
    }
    Err(Failure::Incomplete(format!(
        "the run was not kept: mend the sensor and play the run again: tpm campaign next {folder} -o run.csv"
    )))
}
