//! `tpm identify`: parameters with standard deviations, from a log or from experiments on a simulated plant.

use crate::failure::{Failure, Outcome};
use crate::input::assignments::{PriorArg, number_assignment, once};
use crate::input::choice::one_of;
use crate::input::domain::domain;
use crate::input::experiment::{BoundArgs, SimulatedArgs, model};
use crate::input::issue::IssueArgs;
use crate::input::log::LogArgs;
use crate::interrupt;
use crate::output::{file, progress, recording, report, writable};
use crate::render::campaign::Watched;
use crate::render::flags;
use crate::render::method::Style;
use crate::render::result::{print, print_with_method};
use crate::render::templates;
use clap::builder::TypedValueParser;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use tpm_runtime::campaign::RunReport;
use tpm_runtime::document::{Document, Step};
use tpm_runtime::estimate::Weights;
use tpm_runtime::estimate::{Domain, Refine};
use tpm_runtime::motion::{Record, Trial};
use tpm_runtime::session::{
    CampaignFolder, DeclaredModel, EstimationSettings, Identifiable as _, Identification, LogRequest, Session,
    USUAL_TIME, completed, evidence, from_logs, inspect, proposals,
};

/// Options of `tpm identify`.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("log").args(["flagged", "behind"]).multiple(true))]
pub(crate) struct Args {
    /// The model file. Or a log, where there is no model yet: what its columns are, and models to begin with that fit them.
    file: PathBuf,
    /// Logs, as --log names them.
    #[arg(id = "behind", value_name = "LOG")]
    behind: Vec<PathBuf>,
    /// Identify from this log instead of a simulated plant: columns of text with a header, time and signals by name. Given several times,
    /// from all these logs of one machine together.
    #[arg(id = "flagged", long = "log", value_name = "FILE")]
    flagged: Vec<PathBuf>,
    #[command(flatten)]
    reading: LogArgs,
    /// Prior value of a parameter: what an unobservable direction keeps; of a physical one: where the search starts. Or a file of such
    /// values, as `tpm import` writes beside a model; values given singly stand above those of files.
    #[arg(long, value_name = "NAME=VALUE|FILE.toml", value_parser = PriorArg::parse)]
    prior: Vec<PriorArg>,
    /// Hold a parameter, or a physical one, at a value.
    #[arg(long, value_name = "NAME=VALUE", value_parser = number_assignment)]
    freeze: Vec<(String, f64)>,
    /// How well a sensor is calibrated, which enters the deviations: standard deviation of the zero of a coordinate, in its unit, or of the gain of
    /// an input, a share of it. Sensors that are not named count as exact; what a log would not show of them is a remark.
    #[arg(long, value_name = "NAME=DEVIATION", value_parser = number_assignment, requires = "log")]
    calibration: Vec<(String, f64)>,
    /// How much every harmonic counts: by its noise, or alike, for a model that leaves something out.
    #[arg(long, value_parser = weights(), requires = "log")]
    weights: Option<Weights>,
    /// How a log is used: harmonics of the part that repeats, or every sample behind a low pass; a log that repeats by its harmonics
    /// when not given.
    #[arg(long, value_parser = domain(), requires = "log")]
    domain: Option<Domain>,
    /// Whether the estimates are refined by simulating the model sample by sample; where that takes no long time when not given.
    #[arg(long, value_parser = refine())]
    refine: Option<Refine>,
    /// Processor time that a log may take, s: a simulation that has not settled by then is left out, and said so, with exit code 1; 60 when
    /// neither this nor --refine is given. Ctrl-C does so at once.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, requires = "log")]
    time: Option<f64>,
    #[command(flatten)]
    bounds: BoundArgs,
    #[command(flatten)]
    simulated: SimulatedArgs,
    /// Keep every run of the campaign in this folder as it ends, and go on from the runs that are there.
    #[arg(long, value_name = "DIR", conflicts_with = "log")]
    runs: Option<PathBuf>,
    /// Write a page for a browser (report.html) and its figures into this folder: measured against model, residual with its tests,
    /// parameters with intervals, correlations; of a campaign a table of the runs too.
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Identify the model with the forces that it lacks on the logs: what is printed is its result, and this file is its text,
    /// MODEL_completed.tpm when not given. Where the lines of the rows tell parameters, they are those with which the model is nearest to the
    /// forces, so that it predicts best.
    #[arg(long, value_name = "FILE.tpm", num_args = 0..=1, require_equals = true, requires = "log")]
    complete: Option<Option<PathBuf>>,
    /// Record measured, predicted and simulated motion of the logs in this MCAP file, for PlotJuggler, Foxglove and Rerun.
    #[arg(long, value_name = "FILE.mcap", requires = "log")]
    record: Option<PathBuf>,
    #[command(flatten)]
    issue: IssueArgs,
    /// Also show how the method came to the parameters: run by run the harmonics of error and inputs beside their prediction, the matrix
    /// T B Lambda, the update; then one row per update. JSON has all lines under `method`.
    #[arg(long, value_enum, value_name = "STYLE", num_args = 0..=1, require_equals = true, default_missing_value = "text", conflicts_with = "log")]
    method: Option<Style>,
    /// Print the contract's JSON (tpm.identification/2).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Bytes of a file in which a model is declared, comments before it included.
const MOST_HEAD_BYTES: u64 = 65536;

/// A time that may be spent.
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("a number of seconds above zero is needed".to_owned()),
    }
}

/// What the harmonics of a log count.
fn weights() -> impl TypedValueParser<Value = Weights> {
    one_of([
        (Weights::Noise, "noise", "By their noise and the model's own error: the smallest deviations (the default)"),
        (
            Weights::Equal,
            "equal",
            "Alike, rows by the size of their force: the nearest model over the period, whatever the noise",
        ),
    ])
}

/// How estimates are refined.
fn refine() -> impl TypedValueParser<Value = Refine> {
    one_of([
        (
            Refine::OutputError,
            "output-error",
            "By output error, where the model can be simulated, however long it takes",
        ),
        (Refine::None, "none", "Not at all"),
    ])
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    writable(args.output.as_deref(), args.report.as_deref())?;
    recording::possible(args.record.as_deref())?;
    let logs: Vec<&PathBuf> = args.flagged.iter().chain(&args.behind).collect();
    match logs.as_slice() {
        [] if is_log(&args.file) => propose(args),
        [] => {
            args.reading.columns.needs_log()?;
            simulated(args)
        }
        paths => {
            let simulated = &args.simulated;
            if simulated.experiment.is_some() || simulated.pattern.is_some() || !simulated.set.is_empty() {
                return Err(Failure::Input(
                    "--experiment, --set and --pattern are for the simulated plant and cannot be used with --log"
                        .to_owned(),
                ));
            }
            let model = model(&args.file)?;
            let requests: Result<Vec<LogRequest>, Failure> =
                paths.iter().map(|path| args.reading.request(path, model.evaluated())).collect();
            let mut requests = requests?;
            let prior = PriorArg::all(&args.prior)?;
            for request in &mut requests {
                request.estimation = EstimationSettings {
                    prior: prior.clone(),
                    frozen: once("--freeze", &args.freeze)?,
                    calibration: once("--calibration", &args.calibration)?,
                    bounds: args.bounds.by_name()?,
                    weights: args.weights.unwrap_or_default(),
                    domain: args.domain,
                    refine: args.refine.unwrap_or_default(),
                    ..std::mem::take(&mut request.estimation)
                };
            }
            let kept = (args.report.is_some() || args.record.is_some()).then(|| requests.clone());
            let limit = args.time.or(args.refine.is_none().then_some(USUAL_TIME));
            let identify = || from_logs(&model, requests.clone());
            let result = interrupt::patient(limit, "identifying", identify)?;
            let (model, result) = match &args.complete {
                Some(path) => {
                    let path = path.clone().unwrap_or_else(|| beside(&args.file));
                    let complete = || with_what_it_lacks(model, requests, result, &path);
                    interrupt::patient(limit, "identifying the completed model", complete)?
                }
                None => (model, result),
            };
            print(&result, args.json, args.output.as_deref())?;
            if args.complete.is_none() && result.completed_model.is_some() {
                file::remark(
                    "remark: --complete identifies the model with what it lacks; `tpm complete RESULT.json` writes it",
                );
            }
            if let Some(requests) = kept {
                let shown = evidence(&model, requests, &result).unwrap_or_else(|error| {
                    let why = flags::error(&error);
                    file::remark(&format!("remark: measured is not compared with the model: {why}"));
                    Vec::new()
                });
                if let Some(folder) = &args.report {
                    let document = Document::of_identification(&result, &shown, &flags::remedy).of_machine(
                        &model,
                        &result,
                        &|step| command(step, &args.file, args.output.as_deref()),
                    );
                    report::write(folder, &document.issued(args.issue.now()), &[])?;
                }
                if let Some(path) = &args.record {
                    recording::write(path, &shown)?;
                }
            }
            if interrupt::requested() {
                return Err(Failure::Interrupted);
            }
            result.shortfall().map_or(Ok(()), |why| Err(Failure::Incomplete(why)))
        }
    }
}

/// Where a completed model stands when no file is named.
fn beside(model: &Path) -> PathBuf {
    let stem = model.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy().into_owned());
    PathBuf::from(format!("{stem}_completed.tpm"))
}

/// The model with the forces that it lacks and its result, after its text was written; the model as it stands where none make it better.
fn with_what_it_lacks(
    model: DeclaredModel,
    requests: Vec<LogRequest>,
    result: Identification,
    path: &Path,
) -> Result<(DeclaredModel, Identification), Failure> {
    let Some((whole, found)) = completed(&model, requests, &result)? else {
        file::remark(
            "remark: nothing that the model may lack makes it better on parts of the logs from which its values were not taken: it stands as it is, and no file is written",
        );
        return Ok((model, result));
    };
    file::write_file(path, whole.text().text().as_bytes())?;
    file::remark(&format!("remark: the model with what it lacked is {}", path.display()));
    Ok((whole, found))
}

/// The command of a step after an identification.
fn command(step: Step, model: &Path, result: Option<&Path>) -> Option<String> {
    let model = model.display();
    let result = result.filter(|path| path.extension().is_some_and(|own| own == "json"));
    let result = result.map_or_else(|| "RESULT.json".to_owned(), |path| path.display().to_string());
    Some(match step {
        Step::Motion => format!("tpm design {model}"),
        Step::Prediction => format!(
            "tpm validate {model} --params {result} --log OTHER.csv, with the --map, --scale and --hold of this one"
        ),
        Step::Inertias => format!("tpm inertias {model} {result} --description ARM.urdf"),
        Step::Code => format!("tpm generate {model} --lang c --params {result}"),
        _ => return None,
    })
}

/// Whether a file in the model's place is a log: neither its name nor its text is that of another kind of file.
fn is_log(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
    if extension.is_some_and(|extension| ["tpm", "toml", "urdf", "xml"].contains(&extension.as_str())) {
        return false;
    }
    // A model may have any name. What is no text, such as MAT or Parquet, is none. Pipes can be read but once.
    let mut head = Vec::new();
    let mut read = || std::fs::File::open(path).and_then(|file| file.take(MOST_HEAD_BYTES).read_to_end(&mut head));
    if !path.is_file() || read().is_err() {
        return false;
    }
    // What this program writes in JSON says so at its beginning.
    let text = String::from_utf8_lossy(&head);
    let is_own = text.trim_start().starts_with('{') && text.contains("\"schema\"") && text.contains("\"tpm.");
    !is_own && !text.lines().any(declares_model)
}

/// Whether a line of a file begins a model: `model Name`, with or without the bracket.
fn declares_model(line: &str) -> bool {
    let name = line.trim_start().strip_prefix("model ").map(|rest| rest.trim_end_matches('{').trim());
    name.is_some_and(|name| !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || c == '_'))
}

/// What the columns of a log are, and models to begin with that fit them.
fn propose(args: &Args) -> Outcome {
    if args.json || args.report.is_some() {
        return Err(Failure::Input(format!(
            "{0} is a log, and a model stands before it; `tpm identify {0}` shows models to begin with, `tpm inspect {0}` has JSON and figures",
            args.file.display()
        )));
    }
    let found = inspect(args.reading.request_without_model(&args.file)?)?;
    let fitting = proposals(&found);
    file::emit(args.output.as_deref(), &templates::shown(&found, &fitting, &args.file, &args.reading.columns.typed()))?;
    let next = if fitting.is_empty() {
        "no template fits these columns; `tpm init NAME` writes a model to change, whose signals --map takes from columns"
    } else {
        "paste the two commands of the machine that it is"
    };
    Err(Failure::Incomplete(format!("nothing is identified, since no model was given: {next}")))
}

fn simulated(args: &Args) -> Outcome {
    let mut request = args.simulated.request();
    request.frozen = once("--freeze", &args.freeze)?;
    request.prior = PriorArg::all(&args.prior)?;
    request.refine = args.refine;
    request.bounds = args.bounds.by_name()?;
    let mut session = Session::open(model(&args.file)?, &args.file, &request)?;
    if args.method.is_some() {
        session = session.showing_method();
    }
    let bar = progress::Bar::new("identifying");
    let most = session.experiment().schedule.max_runs as u64;
    let mut seen = Watched::default();
    let (result, interrupted) = interrupt::watched(|go_on| {
        let mut step = |trial: &Trial, record: &Record, run: &RunReport| {
            bar.set(run.run as u64, most);
            if args.report.is_some() {
                seen.see(trial, record, run);
            }
            go_on()
        };
        let result = match &args.runs {
            Some(folder) => CampaignFolder::identify(folder, &session, &mut step),
            None => session.identify(None, &mut step),
        };
        (result, !go_on())
    });
    drop(bar);
    let result = result?;
    print_with_method(&result, args.json, args.method.unwrap_or(Style::Text), args.output.as_deref())?;
    if let Some(folder) = &args.report {
        seen.write(folder, &session, &result, args.issue.now())?;
    }
    if interrupted {
        return Err(Failure::Interrupted);
    }
    result.shortfall().map_or(Ok(()), |why| Err(Failure::Incomplete(why)))
}
