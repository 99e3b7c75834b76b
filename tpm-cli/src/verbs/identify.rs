//! `tpm identify`: parameters with standard deviations, from a log or from experiments on a simulated plant.

use crate::failure::Failure;
use crate::input::assignments::{assignment, by_name, number_assignment};
use crate::input::experiment::{SimulatedArgs, Simulation};
use crate::input::load::Loaded;
use crate::input::log::LogArgs;
use crate::output::{file, progress};
use crate::render::campaign::{self, Played};
use crate::render::table::{Align, TextTable, combination, number};
use crate::verbs::campaign::folder_of;
use crate::{Outcome, interrupt};
use clap::ValueEnum;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tpm_runtime::campaign::RunReport;
use tpm_runtime::estimate::physical::{PhysicalSettings, has_inertia, is_lumped, negative_masses, physical};
use tpm_runtime::estimate::{CombinationReport, ParameterReport};
use tpm_runtime::estimate::{Estimate, Frozen, Weights};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::interpret::Interpreted;
use tpm_runtime::log::{Log, LogOptions};
use tpm_runtime::machine::stability::Stability;
use tpm_runtime::model::Model as _;
use tpm_runtime::run::{Record, Trial};
use tpm_runtime::session::CampaignIdentification;
use tpm_runtime::session::{Identification, identify_log};
use tpm_symbolic::mechanics::model::Kind;
use tpm_symbolic::regressor::prepare::Prepared;

/// Options of `tpm identify`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// Identify from this log (CSV with one header line, time in `t_s`) instead of a simulated plant.
    #[arg(long, value_name = "CSV")]
    log: Option<PathBuf>,
    #[command(flatten)]
    reading: LogArgs,
    /// Prior value of a parameter: what an unobservable direction keeps; of a physical one: where the search starts.
    #[arg(long, value_name = "NAME=VALUE", requires = "log", value_parser = number_assignment)]
    prior: Vec<(String, f64)>,
    /// Hold a parameter, or a physical one, at a value.
    #[arg(long, value_name = "NAME=VALUE", requires = "log", value_parser = number_assignment)]
    freeze: Vec<(String, f64)>,
    /// How much every harmonic counts: by its noise, or alike, for a model that leaves something out.
    #[arg(long, value_enum, requires = "log")]
    weights: Option<WeightsChoice>,
    /// Bounds of a physical parameter behind lumped ones, either side may be left out; kg and kg*m^2 are not negative unless said.
    #[arg(long, value_name = "NAME=LOW:HIGH", value_parser = bounds_assignment)]
    bound: Vec<(String, (f64, f64))>,
    #[command(flatten)]
    simulated: SimulatedArgs,
    /// Keep every run of the campaign in this folder as it ends, and go on from the runs that are there.
    #[arg(long, value_name = "DIR", conflicts_with = "log")]
    runs: Option<PathBuf>,
    /// Write a table of the runs and figures of error and inputs into this folder.
    #[arg(long, value_name = "DIR", conflicts_with = "log")]
    report: Option<PathBuf>,
    /// Print the contract's JSON (tpm.identification/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// What the harmonics of a log count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum WeightsChoice {
    /// By their noise and the model's own error: the smallest deviations (the default).
    Noise,
    /// Alike, rows by the size of their force: the nearest model over the period, whatever the noise.
    Equal,
}

impl From<WeightsChoice> for Weights {
    fn from(choice: WeightsChoice) -> Self {
        match choice {
            WeightsChoice::Noise => Weights::Noise,
            WeightsChoice::Equal => Weights::Equal,
        }
    }
}

fn bounds_assignment(text: &str) -> Result<(String, (f64, f64)), String> {
    let (name, interval) = assignment(text)?;
    let (low, high) = interval.split_once(':').ok_or_else(|| format!("`{interval}` is not of the form LOW:HIGH"))?;
    let side = |text: &str, open: f64| match text.trim() {
        "" => Ok(open),
        text => text.parse::<f64>().map_err(|_| format!("`{text}` is not a number")),
    };
    Ok((name, (side(low, f64::NEG_INFINITY)?, side(high, f64::INFINITY)?)))
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    match &args.log {
        Some(path) => {
            let simulated = &args.simulated;
            if simulated.experiment.is_some() || simulated.pattern.is_some() || !simulated.set.is_empty() {
                return Err(Failure::Input(
                    "--experiment, --set and --pattern are for the simulated plant and cannot be used with --log"
                        .to_owned(),
                ));
            }
            let prepared = Loaded::from_file(&args.file)?.prepared()?;
            let model = Interpreted::new(&prepared.model, &prepared.form);
            from_log(args, &prepared, &model, path)
        }
        None => simulated(args),
    }
}

fn simulated(args: &Args) -> Outcome {
    let bounds = args.bound.iter().cloned().collect();
    let Simulation { symbolic: prepared, machine, written, experiment } = args.simulated.within(&args.file, &bounds)?;
    let (prepared, experiment) = (&prepared, &experiment);
    let store = match &args.runs {
        Some(folder) => Some(folder_of(&args.file, folder, args.simulated.pattern.as_deref(), experiment, &machine)?),
        None => None,
    };
    let bar = progress::Bar::new("identifying");
    let most = experiment.schedule.max_runs as u64;
    let (mut first, mut last) = (None, None);
    let result = interrupt::watched(|go_on| {
        let mut step = |trial: &Trial, record: &Record, run: &RunReport| {
            bar.set(run.run as u64, most);
            if args.report.is_some()
                && let Some(now) = Played::of(trial, record, run)
            {
                if first.is_none() {
                    first = Some(now);
                } else {
                    last = Some(now);
                }
            }
            go_on()
        };
        let result = machine.identify_watched(experiment, store.as_ref(), &mut step);
        result.map(|result| (result, !go_on()))
    });
    drop(bar);
    let (mut result, interrupted) = result.map_err(|error| Failure::Input(error.to_string()))?;
    let sound = experiment
        .setup(machine.plant(), machine.pattern(), Hold::Zoh)
        .is_ok_and(|setup| machine.has_inertia(&result.current, &setup));
    let named = if result.physical.is_empty() { &result.parameters } else { &result.physical };
    // A coupling of inertias may well be negative in a machine whose whole matrix is not.
    let negative = if sound { Vec::new() } else { negative_masses(named) };
    result.warnings.extend(negative.iter().cloned());
    if let Some(estimate) = result.estimate.as_ref().filter(|_| machine.eliminated().is_none()) {
        let settings = settings(args, &written.prior, &written.frozen, &written.constants, &physical_names(prepared));
        result.physical = physical_part(prepared, estimate, &settings, &mut result.warnings)?;
    }
    let text =
        if args.json { file::json(&result)? } else { describe_campaign(&result, &prepared.model, Runs::Simulated) };
    file::emit(args.output.as_deref(), &text)?;
    if let Some(folder) = &args.report {
        campaign::write(folder, &machine, &result, first.as_ref(), last.as_ref())?;
    }
    if interrupted {
        return Err(Failure::Interrupted);
    }
    if let Some(negative) = negative.into_iter().next() {
        return Err(Failure::Incomplete(negative));
    }
    if !result.is_complete() {
        return Err(Failure::Incomplete(result.shortfall()));
    }
    Ok(())
}

/// Where the runs of a campaign come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Runs {
    /// Played on the plant of the experiment file, with noise from its seed.
    Simulated,
    /// Kept in a folder: logs of a machine, or of whatever played them.
    Kept,
}

pub(crate) fn describe_campaign(
    result: &CampaignIdentification,
    model: &tpm_symbolic::mechanics::model::Model,
    runs: Runs,
) -> String {
    let mut text = match runs {
        Runs::Simulated => format!(
            "model {} on a simulated plant; estimator {}; hold {}; seed {}\n\n",
            result.model, result.estimator, result.hold, result.seed
        ),
        Runs::Kept => format!(
            "model {} from the runs in its folder; estimator {}; hold {}\n\n",
            result.model, result.estimator, result.hold
        ),
    };
    // Stages may have patterns of their own, with other amplitudes.
    let mut amplitudes: Vec<&str> = Vec::new();
    for (name, _) in result.runs.iter().flat_map(|run| &run.amplitudes) {
        if !amplitudes.contains(&name.as_str()) {
            amplitudes.push(name);
        }
    }
    let several = result.runs.iter().any(|run| run.pattern.is_some());
    let frequency = model.patterns.first().map_or("w", |pattern| &model.quantity(pattern.frequency).name);
    let mut head = vec![("run", Align::Right)];
    head.extend(several.then_some(("pattern", Align::Left)));
    head.extend(amplitudes.iter().map(|name| (*name, Align::Right)));
    head.extend([(frequency, Align::Right), ("periods", Align::Right), ("rms error", Align::Right)]);
    head.extend([("effort", Align::Right), ("condition", Align::Right), ("ending", Align::Left)]);
    let mut table = TextTable::new(&head);
    for run in &result.runs {
        let mut row = vec![run.run.to_string()];
        row.extend(several.then(|| run.pattern.clone().unwrap_or_else(|| "-".to_owned())));
        row.extend(amplitudes.iter().map(|name| {
            let own = run.amplitudes.iter().find(|(own, _)| own == name);
            own.map_or_else(|| "-".to_owned(), |(_, value)| number(*value))
        }));
        row.push(number(run.frequency));
        row.push(run.periods.to_string());
        row.push(run.tracking_rms.iter().map(|rms| number(*rms)).collect::<Vec<_>>().join(" "));
        row.push(run.effort_share.map_or_else(|| "-".to_owned(), |share| format!("{:.1} %", 100.0 * share)));
        row.push(run.condition.map_or_else(|| "-".to_owned(), number));
        row.push(run.ending.to_string());
        table.row(&row);
    }
    text.push_str(&table.finish());
    if let Some(stability) = &result.stability {
        text.push_str(&stable(stability));
    }
    text.push('\n');
    text.push_str(&parameters(&result.parameters));
    text.push_str(&combinations(&result.combinations));
    if !result.physical.is_empty() {
        text.push_str("\nphysical parameters\n");
        text.push_str(&parameters(&result.physical));
    }
    let condition = result.condition.map_or_else(|| "-".to_owned(), number);
    let outcome = result.outcome.map_or("not finished", |outcome| outcome.describe());
    text.push_str(&format!(
        "\n{outcome}{}; rank {} of {}, condition number {condition}, residual {} % of the force\n",
        result.stop.as_ref().map(|stop| format!(": {stop}")).unwrap_or_default(),
        result.rank,
        result.parameters.len(),
        number(100.0 * result.residual),
    ));
    text.push_str(&remarks(&result.unobservable, &result.warnings));
    text
}

/// What was known of the loop before the first run; nothing when nothing could be known.
fn stable(stability: &Stability) -> String {
    let mut text = String::new();
    if let Some(slowest) = stability.poles.iter().map(|pole| pole.0).reduce(f64::max) {
        text.push_str(&format!("\nclosed loop: slowest pole {} 1/s with the prior", number(slowest)));
    }
    if let Some(sampled) = &stability.sampled {
        text.push_str(&format!(
            "{} {} 1/s over the stated ranges (sampled: {} vertices, {} points on edges, {} inside)",
            if text.is_empty() { "\nclosed loop: slowest pole" } else { "," },
            number(sampled.slowest),
            sampled.vertices,
            sampled.edges,
            sampled.interior
        ));
    }
    if !text.is_empty() {
        text.push('\n');
    }
    text
}

fn remarks(unobservable: &[BTreeMap<String, String>], warnings: &[String]) -> String {
    let mut text = String::new();
    for direction in unobservable {
        text.push_str(&format!("the data do not show the direction {}\n", combination(direction)));
    }
    for warning in warnings {
        text.push_str(&format!("warning: {warning}\n"));
    }
    text
}

fn from_log(args: &Args, prepared: &Prepared, model: &Interpreted, path: &Path) -> Outcome {
    let own = physical_names(prepared);
    let options = log_options(args, model, &own)?;
    let log = Log::open(path, model, &options).map_err(|error| Failure::Input(error.to_string()))?;
    let mut result = identify_log(model, &log, &options).map_err(|error| Failure::Input(error.to_string()))?;
    let map = |list: &[(String, f64)]| list.iter().cloned().collect();
    let settings = settings(args, &map(&args.prior), &map(&args.freeze), &map(&args.reading.constants), &own);
    let coordinates = &log.channels[..model.dims().coordinates];
    let mean = |channel: &Vec<f64>| channel.iter().sum::<f64>() / channel.len().max(1) as f64;
    let position: Vec<f64> = coordinates.iter().map(mean).collect();
    // As above: the whole matrix counts, not a coupling in it.
    let sound = has_inertia(model, &result.estimate.values, &options.constants, &position);
    let negative = if sound { Vec::new() } else { negative_masses(&result.parameters) };
    result.warnings.extend(negative.iter().cloned());
    result.physical = physical_part(prepared, &result.estimate, &settings, &mut result.warnings)?;
    let text = if args.json { file::json(&result)? } else { describe(&result) };
    file::emit(args.output.as_deref(), &text)?;
    if let Some(negative) = negative.into_iter().next() {
        return Err(Failure::Incomplete(negative));
    }
    result.shortfall().map_or(Ok(()), |why| Err(Failure::Incomplete(why)))
}

/// Names of the physical parameters behind lumped ones; none when nothing was lumped.
fn physical_names(prepared: &Prepared) -> Vec<String> {
    if !is_lumped(prepared) {
        return Vec::new();
    }
    let parameters = prepared.model.symbols.iter().filter(|quantity| quantity.kind == Kind::Parameter);
    parameters.map(|quantity| quantity.name.to_string()).collect()
}

/// What was said of the physical parameters.
fn settings(
    args: &Args,
    prior: &BTreeMap<String, f64>,
    frozen: &BTreeMap<String, f64>,
    constants: &BTreeMap<String, f64>,
    own: &[String],
) -> PhysicalSettings {
    let only = |values: &BTreeMap<String, f64>| {
        values.iter().filter(|(name, _)| own.contains(name)).map(|(name, value)| (name.clone(), *value)).collect()
    };
    let mut settings = PhysicalSettings::default();
    settings.prior = only(prior);
    settings.frozen = only(frozen);
    settings.bounds = args.bound.iter().cloned().collect();
    settings.constants.clone_from(constants);
    settings
}

/// The physical parameters behind lumped ones, none when nothing was lumped; what there is to say of them goes to `warnings`.
fn physical_part(
    prepared: &Prepared,
    estimate: &Estimate,
    settings: &PhysicalSettings,
    warnings: &mut Vec<String>,
) -> Result<Vec<ParameterReport>, Failure> {
    if !is_lumped(prepared) {
        if let Some(name) = settings.bounds.keys().next() {
            return Err(Failure::Input(format!(
                "--bound {name}=...: the model is linear in its parameters as they are; bounds are for physical parameters behind lumped ones"
            )));
        }
        return Ok(Vec::new());
    }
    let found = physical(prepared, estimate, settings).map_err(|error| Failure::Input(error.to_string()))?;
    warnings.extend(found.warnings);
    Ok(found.parameters)
}

fn log_options(args: &Args, model: &Interpreted, physical: &[String]) -> Result<LogOptions, Failure> {
    let parameters: Vec<String> = (0..model.dims().parameters).map(|i| model.parameter(i).name.to_owned()).collect();
    let either: Vec<String> = parameters.iter().chain(physical).cloned().collect();
    let priors = by_name("--prior", &args.prior, &either)?;
    let frozen = by_name("--freeze", &args.freeze, &either)?;
    let index = |name: &str| parameters.iter().position(|parameter| parameter == name);
    Ok(LogOptions {
        weights: args.weights.map_or_else(Weights::default, Weights::from),
        prior: if parameters.iter().all(|name| !priors.contains_key(name)) {
            Vec::new()
        } else {
            parameters.iter().map(|name| priors.get(name).copied().unwrap_or(0.0)).collect()
        },
        frozen: frozen
            .iter()
            .filter_map(|(name, &value)| index(name).map(|parameter| Frozen { parameter, value }))
            .collect(),
        ..args.reading.options(model)?
    })
}

fn describe(result: &Identification) -> String {
    let log = &result.log;
    let mut text = format!(
        "model {} from {}\n{} samples every {} s; {} periods of {} s from sample {} (line {}); hold {}; {} window; harmonics up to {}\n\n",
        result.model,
        log.path,
        log.samples,
        number(log.sample_time),
        log.periods,
        number(log.period),
        log.from_sample,
        log.from_line,
        result.hold,
        log.window,
        result.harmonics,
    );
    for (input, known) in &log.actuators {
        let mut parts = Vec::new();
        if known.delay > 0.0 {
            parts.push(format!("a delay of {} s", number(known.delay)));
        }
        if let Some((frequency, quality)) = known.low_pass {
            parts.push(format!("a low pass of {} rad/s and quality {}", number(frequency), number(quality)));
        }
        if let Some(bandwidth) = known.bandwidth {
            parts.push(format!("a current loop of {} rad/s", number(bandwidth)));
        }
        text.push_str(&format!("corrected behind {input}: {}\n", parts.join(", ")));
    }
    if !log.actuators.is_empty() {
        text.push('\n');
    }
    text.push_str(&parameters(&result.parameters));
    text.push_str(&combinations(&result.combinations));
    if !result.physical.is_empty() {
        text.push_str("\nphysical parameters\n");
        text.push_str(&parameters(&result.physical));
    }
    text.push_str(&format!(
        "\nrank {} of {}, condition number {}, residual {} % of the force\n",
        result.rank,
        result.parameters.len(),
        number(result.condition),
        number(100.0 * result.residual),
    ));
    text.push_str(&remarks(&result.unobservable, &result.warnings));
    text
}

/// Parameter, unit, prior, identified, standard deviation, change. An unobservable parameter gets no number.
fn parameters(list: &[ParameterReport]) -> String {
    let mut table = estimates("parameter");
    for parameter in list {
        let remark = if parameter.status == "identified" { String::new() } else { parameter.status.replace('_', " ") };
        let [prior, value, std] = [parameter.prior, parameter.value, parameter.std];
        table.row(&row(parameter.name.clone(), parameter.unit.as_deref(), [prior, value, std], remark));
    }
    table.finish()
}

/// The same of what is shown of parameters that do not show alone.
fn combinations(list: &[CombinationReport]) -> String {
    if list.is_empty() {
        return String::new();
    }
    let mut table = estimates("combination");
    for shown in list {
        let values = [shown.prior, Some(shown.value), Some(shown.std)];
        table.row(&row(combination(&shown.terms), shown.unit.as_deref(), values, String::new()));
    }
    format!("\n{}", table.finish())
}

fn estimates(of: &str) -> TextTable {
    TextTable::new(&[
        (of, Align::Left),
        ("unit", Align::Left),
        ("prior", Align::Right),
        ("identified", Align::Right),
        ("std. dev.", Align::Right),
        ("change", Align::Right),
        ("", Align::Left),
    ])
}

fn row(name: String, unit: Option<&str>, [prior, value, std]: [Option<f64>; 3], remark: String) -> [String; 7] {
    let optional = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), number);
    let change = match (prior, value) {
        (Some(prior), Some(value)) if prior != 0.0 => format!("{:+.3} %", 100.0 * (value - prior) / prior),
        _ => "-".to_owned(),
    };
    [name, unit.unwrap_or("-").to_owned(), optional(prior), optional(value), optional(std), change, remark]
}
