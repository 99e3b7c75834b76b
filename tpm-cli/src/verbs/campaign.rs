//! `tpm campaign`: a campaign on a real machine, by files.

use crate::Outcome;
use crate::failure::Failure;
use crate::input::experiment::{SimulatedArgs, Simulation};
use crate::input::log::ColumnArgs;
use crate::output::file;
use crate::verbs::identify::{Runs, describe_campaign};
use clap::Subcommand;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use tpm_runtime::campaign::Campaign;
use tpm_runtime::campaign::{GainManifest, Manifest, Store};
use tpm_runtime::experiment::Experiment;
use tpm_runtime::log::Log;
use tpm_runtime::machine::stability::LoopStability;
use tpm_runtime::model::Model as _;
use tpm_runtime::run::smoothing::Smoothing;
use tpm_runtime::run::{Record, RunEnding, Trial, Velocity};
use tpm_runtime::session::{Machine, summary};

/// Files of a campaign's folder beside its runs.
const MODEL: &str = "model.tpm";
const EXPERIMENT: &str = "experiment.toml";

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
    /// Take in the log of the run that `next` gave, and say what comes.
    Submit {
        /// The campaign's folder.
        folder: PathBuf,
        /// The log: CSV with t_s, coordinates and applied inputs by name; measured rates, if any, in columns like dot(x).
        log: PathBuf,
        #[command(flatten)]
        columns: ColumnArgs,
    },
    /// Print what is known so far.
    Result {
        /// The campaign's folder.
        folder: PathBuf,
        /// Print the contract's JSON (tpm.identification/1).
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
        Step::Submit { folder, log, columns } => submit(folder, log, columns),
        Step::Result { folder, json, output } => result(folder, *json, output.as_deref()),
    }
}

fn input(error: &impl std::fmt::Display) -> Failure {
    Failure::Input(error.to_string())
}

/// Begins, or goes on with, the campaign of a model file and an experiment in a folder.
pub(crate) fn folder_of(
    file: &Path,
    folder: &Path,
    pattern: Option<&str>,
    experiment: &Experiment,
    machine: &Machine,
) -> Result<Store, Failure> {
    let model = std::fs::read(file).map_err(|error| Failure::read(file, error))?;
    let mut experiment = experiment.clone();
    if let Some(pattern) = pattern {
        experiment.pattern = Some(pattern.to_owned());
    }
    let text = experiment.text().map_err(|error| input(&error))?;
    let manifest = Manifest::new(machine.plant().name(), &model, text.as_bytes());
    let store = Store::open(folder, &manifest).map_err(|error| input(&error))?;
    file::write_file(&folder.join(MODEL), &model)?;
    file::write_file(&folder.join(EXPERIMENT), text.as_bytes())?;
    Ok(store)
}

/// A campaign's folder with everything in it.
struct Folder {
    simulation: Simulation,
    store: Store,
}

impl Folder {
    fn open(folder: &Path) -> Result<Self, Failure> {
        let (model, experiment) = (folder.join(MODEL), folder.join(EXPERIMENT));
        if !folder.join("campaign.json").exists() {
            return Err(Failure::Input(format!(
                "{} holds no campaign; begin one with `tpm campaign start MODEL {}`",
                folder.display(),
                folder.display()
            )));
        }
        let args = SimulatedArgs { experiment: Some(experiment), set: Vec::new(), pattern: None };
        let simulation = args.within(&model, &BTreeMap::new())?;
        let store = folder_of(&model, folder, None, &simulation.experiment, &simulation.machine)?;
        Ok(Folder { simulation, store })
    }

    /// The campaign with all finished runs, and what its loop was found to be.
    fn campaign(&self) -> Result<(Campaign<'_>, LoopStability), Failure> {
        let Simulation { machine, experiment, .. } = &self.simulation;
        let plant = machine.plant();
        // A real machine's drive holds its input between samples as the simulated one does.
        let (setup, stability) = experiment.stable_setup(plant, machine.pattern()).map_err(|error| input(&error))?;
        let mut campaign = machine.campaign(experiment, setup).map_err(|error| input(&error))?;
        for record in self.store.records(plant).map_err(|error| input(&error))? {
            campaign.submit(&record).map_err(|error| input(&error))?;
        }
        Ok((campaign, stability))
    }
}

fn start(file: &Path, folder: &Path, simulated: &SimulatedArgs) -> Outcome {
    let Simulation { machine, experiment, .. } = simulated.prepare(file)?;
    experiment.stable_setup(machine.plant(), machine.pattern()).map_err(|error| input(&error))?;
    folder_of(file, folder, simulated.pattern.as_deref(), &experiment, &machine)?;
    file::print(&format!(
        "campaign of {} in {}; what to play: tpm campaign next {} -o run.csv\n",
        machine.plant().name(),
        folder.display(),
        folder.display()
    ))
}

/// Feedback, limits and timing of a run, beside its samples.
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Play {
    schema: String,
    model: String,
    /// From 1.
    pub(crate) run: usize,
    pub(crate) sample_time: f64,
    samples_per_period: usize,
    periods: usize,
    feedback: Vec<GainManifest>,
    derivative_filter: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    smoothing: Option<Smoothing>,
    /// Largest magnitude by input, where there is one.
    limits: BTreeMap<String, f64>,
    /// Largest tracking error by coordinate, where there is one: stop beyond it.
    tracking: BTreeMap<String, f64>,
}

fn next(folder: &Path, target: Option<&Path>) -> Outcome {
    let opened = Folder::open(folder)?;
    let (campaign, _) = opened.campaign()?;
    let Some(trial) = campaign.next() else {
        let why = campaign.outcome().map_or("it has ended", |outcome| outcome.describe());
        return Err(Failure::Incomplete(format!("nothing is left to play: {why}")));
    };
    let machine = &opened.simulation.machine;
    file::emit(target, &samples(machine, trial))?;
    if let Some(target) = target {
        let plant = machine.plant();
        let named = |values: &[f64], name: &dyn Fn(usize) -> String| {
            let finite = values.iter().enumerate().filter(|(_, value)| value.is_finite());
            finite.map(|(i, value)| (name(i), *value)).collect()
        };
        let play = Play {
            schema: "tpm.play/1".to_owned(),
            model: plant.name().to_owned(),
            run: trial.run + 1,
            sample_time: trial.control.sample_time,
            samples_per_period: trial.samples_per_period,
            periods: trial.periods,
            feedback: GainManifest::all(plant, &trial.control.gains),
            derivative_filter: trial.control.velocity.time_constant(),
            smoothing: trial.control.velocity.smoothing(),
            limits: named(&trial.input_limits, &|i| plant.input(i).name.to_owned()),
            tracking: named(&trial.tracking_bounds, &|c| plant.coordinate(c).name.to_owned()),
        };
        file::write_file(&target.with_extension("json"), file::json(&play)?.as_bytes())?;
        file::print(&format!(
            "run {}: {} samples in {}, feedback and limits in {}\n",
            trial.run + 1,
            trial.samples(),
            target.display(),
            target.with_extension("json").display()
        ))?;
    }
    Ok(())
}

/// The header of the reference's columns.
fn columns(machine: &Machine) -> Vec<String> {
    let plant = machine.plant();
    let dims = plant.dims();
    let mut names = vec!["t_s".to_owned()];
    for order in 0..=dims.order {
        for c in 0..dims.coordinates {
            let name = plant.coordinate(c).name;
            names.push(if order == 0 { format!("{name}_ref") } else { format!("{name}_ref_d{order}") });
        }
    }
    names.extend((0..dims.inputs).map(|i| format!("{}_ff", plant.input(i).name)));
    names
}

fn samples(machine: &Machine, trial: &Trial) -> String {
    let dims = machine.plant().dims();
    let mut text = columns(machine).join(",");
    text.push('\n');
    for n in 0..trial.samples() {
        let at = n % trial.samples_per_period;
        // A string takes everything.
        let _ = write!(text, "{}", n as f64 * trial.control.sample_time);
        let reference = &trial.reference[at * dims.motion_len()..(at + 1) * dims.motion_len()];
        for value in reference.iter().chain(&trial.feed_forward[at * dims.inputs..(at + 1) * dims.inputs]) {
            let _ = write!(text, ",{value}");
        }
        text.push('\n');
    }
    text
}

/// The trial that `next` wrote to files, as one period of the whole run.
pub(crate) fn read_trial(path: &Path, machine: &Machine, template: &Trial) -> Result<Trial, Failure> {
    let beside = path.with_extension("json");
    let text = std::fs::read_to_string(&beside).map_err(|error| Failure::read(&beside, error))?;
    let play: Play =
        serde_json::from_str(&text).map_err(|error| Failure::Input(format!("{}: {error}", beside.display())))?;
    let plant = machine.plant();
    let dims = plant.dims();
    let at = |what: String| Failure::Input(format!("{}: {what}", path.display()));
    if play.schema != "tpm.play/1" || play.model != plant.name() {
        return Err(at(format!("this run belongs to the model {}, not to {}", play.model, plant.name())));
    }
    let text = std::fs::read_to_string(path).map_err(|error| Failure::read(path, error))?;
    let mut lines = text.lines();
    let header = lines.next().unwrap_or_default();
    if header != columns(machine).join(",") {
        return Err(at(format!("the columns must be {}", columns(machine).join(","))));
    }
    let mut trial = template.clone();
    trial.reference.clear();
    trial.feed_forward.clear();
    for (n, line) in lines.enumerate() {
        let values = line.split(',').skip(1).map(str::parse::<f64>).collect::<Result<Vec<f64>, _>>();
        match values {
            Ok(values) if values.len() == dims.motion_len() + dims.inputs => {
                trial.reference.extend_from_slice(&values[..dims.motion_len()]);
                trial.feed_forward.extend_from_slice(&values[dims.motion_len()..]);
            }
            _ => return Err(at(format!("line {}: {} numbers are needed", n + 2, dims.motion_len() + dims.inputs + 1))),
        }
    }
    let mut gains = Vec::new();
    for gain in &play.feedback {
        let input = (0..dims.inputs).find(|&i| plant.input(i).name == gain.input);
        let coordinate = (0..dims.coordinates).find(|&c| plant.coordinate(c).name == gain.coordinate);
        let (Some(input), Some(coordinate)) = (input, coordinate) else {
            return Err(at(format!(
                "feedback of {} to {}: the model has no such signals",
                gain.coordinate, gain.input
            )));
        };
        gains.push(tpm_runtime::control::Gain { input, coordinate, proportional: gain.kp, derivative: gain.kd });
    }
    trial.run = play.run.saturating_sub(1);
    trial.samples_per_period = trial.feed_forward.len() / dims.inputs.max(1);
    trial.periods = 1;
    trial.control.sample_time = play.sample_time;
    trial.control.gains = gains;
    trial.control.velocity = match play.smoothing {
        Some(smoothing) => Velocity::Fitted(smoothing),
        None => play.derivative_filter.map_or(Velocity::Measured, Velocity::Filtered),
    };
    for (c, bound) in trial.tracking_bounds.iter_mut().enumerate() {
        *bound = play.tracking.get(plant.coordinate(c).name).copied().unwrap_or(f64::INFINITY);
    }
    Ok(trial)
}

fn submit(folder: &Path, log: &Path, columns: &ColumnArgs) -> Outcome {
    let opened = Folder::open(folder)?;
    let (mut campaign, _) = opened.campaign()?;
    let plant = opened.simulation.machine.plant();
    let Some(trial) = campaign.next().cloned() else {
        return Err(Failure::Input("the campaign has ended; no log is expected".to_owned()));
    };
    let (measured, rates) = Log::open_rated(log, plant, &columns.options(plant)?).map_err(|error| input(&error))?;
    let mut coordinates = measured.channels;
    let inputs = coordinates.split_off(plant.dims().coordinates);
    let at = |error: &dyn std::fmt::Display| Failure::Input(format!("{}: {error}", log.display()));
    let mut record =
        Record::of_samples(&trial, measured.sample_time, coordinates, inputs).map_err(|error| at(&error))?;
    record.rates = rates;
    let report = campaign.submit(&record).map_err(|error| at(&error))?;
    let mut text = format!("run {}: {}", report.run, report.ending);
    for parameter in &report.parameters {
        let _ = match (parameter.value, parameter.std) {
            (Some(value), Some(std)) => write!(text, "; {} = {value:.6} +- {std:.2e}", parameter.name),
            _ => write!(text, "; {} not shown", parameter.name),
        };
    }
    if report.ending == RunEnding::SensorLost {
        let _ = write!(
            text,
            "\nnot kept: mend the sensor and play the run again: tpm campaign next {} -o run.csv\n",
            folder.display()
        );
        return file::print(&text);
    }
    opened.store.append(plant, &trial, &record, None).map_err(|error| input(&error))?;
    match campaign.outcome() {
        Some(outcome) => {
            let _ = write!(text, "\nended: {}; tpm campaign result {}\n", outcome.describe(), folder.display());
        }
        None => {
            let _ = write!(text, "\nnext: tpm campaign next {} -o run.csv\n", folder.display());
        }
    }
    file::print(&text)
}

fn result(folder: &Path, json: bool, target: Option<&Path>) -> Outcome {
    let opened = Folder::open(folder)?;
    let (campaign, stability) = opened.campaign()?;
    let Simulation { machine, experiment, .. } = &opened.simulation;
    let mut result = summary(machine.plant(), &campaign, experiment.seed);
    result.stability = Some(stability);
    let model = &opened.simulation.symbolic.model;
    file::emit(target, &if json { file::json(&result)? } else { describe_campaign(&result, model, Runs::Kept) })?;
    if result.is_complete() { Ok(()) } else { Err(Failure::Incomplete(result.shortfall())) }
}
