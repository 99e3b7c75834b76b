//! `tpm study`: many campaigns on the simulated plant and how their results spread about the truth, or how many updates every
//! estimator needs without noise.

use crate::failure::{Failure, Outcome};
use crate::input::experiment::SimulatedArgs;
use crate::input::issue::IssueArgs;
use crate::interrupt;
use crate::output::{file, progress, report, writable};
use std::path::PathBuf;
use tpm_runtime::document::Document;
use tpm_runtime::report::{Align, TextTable, beside, cells, digits, number, or_dash};
use tpm_runtime::session::SessionError;
use tpm_runtime::study::{LIMITS, Study, Updates, study_kept, study_session, updates};

/// Most updates that are played per estimator and stage.
const MOST: usize = 10;
/// Significant digits of spread, stated deviation and bound, which are compared with each other.
const SPREAD_DIGITS: usize = 3;

/// Options of `tpm study`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    #[command(flatten)]
    simulated: SimulatedArgs,
    /// How many seeds, from the experiment's own on.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(2..))]
    seeds: u32,
    /// Without noise, count the updates of every estimator at every stage of the schedule instead.
    #[arg(long, conflicts_with = "seeds")]
    updates: bool,
    /// Keep in this folder how far the study has come, and go on from there, with the result of the unbroken study.
    #[arg(long, value_name = "DIR", conflicts_with = "updates")]
    resume: Option<PathBuf>,
    /// Write a page for a browser (report.html) into this folder.
    #[arg(long, value_name = "DIR", conflicts_with = "updates")]
    report: Option<PathBuf>,
    #[command(flatten)]
    issue: IssueArgs,
    /// Print JSON (tpm.study/1, tpm.updates/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    writable(args.output.as_deref(), args.report.as_deref())?;
    let session = args.simulated.session(&args.file)?;
    if args.updates {
        let machine = session.machine();
        let found =
            updates(machine.plant(), machine.pattern(), session.experiment(), MOST).map_err(SessionError::from)?;
        let text = if args.json { file::json(&found)? } else { describe_updates(&found) };
        return file::emit(args.output.as_deref(), &text);
    }
    let bar = progress::Bar::new("studying");
    let seeds = args.seeds as usize;
    let (result, interrupted) = interrupt::watched(|go_on| {
        let step = |ended: usize| {
            bar.set(ended as u64, seeds as u64);
            go_on()
        };
        let result = match &args.resume {
            Some(folder) => study_kept(&session, folder, seeds, &step),
            None => study_session(&session, seeds, &step),
        };
        (result, !go_on())
    });
    drop(bar);
    let result = result?;
    let text = if args.json { file::json(&result)? } else { describe(&result) };
    file::emit(args.output.as_deref(), &text)?;
    if let Some(folder) = &args.report {
        report::write(folder, &Document::from(&result).issued(args.issue.now()), &[])?;
    }
    if interrupted {
        return Err(Failure::Interrupted);
    }
    if !result.incomplete_seeds.is_empty() {
        return Err(Failure::Incomplete(format!(
            "{} of {} campaigns did not identify everything",
            result.incomplete_seeds.len(),
            result.campaigns
        )));
    }
    Ok(())
}

fn describe_updates(found: &Updates) -> String {
    let mut text =
        format!("model {} on an exact simulated plant: updates until every parameter is within\n\n", found.model);
    let limits: Vec<String> = LIMITS.iter().map(|limit| format!("{limit:e}")).collect();
    let mut head = vec![("estimator", Align::Left)];
    if let Some(first) = found.estimators.first() {
        head.extend(first.amplitudes.iter().map(|(name, _)| (name.as_str(), Align::Right)));
    }
    head.push(("frequency", Align::Right));
    head.extend(limits.iter().map(|limit| (limit.as_str(), Align::Right)));
    head.push(("runs each", Align::Right));
    let mut table = TextTable::new(&head);
    for convergence in &found.estimators {
        let mut row = vec![convergence.estimator.to_owned()];
        row.extend(convergence.amplitudes.iter().map(|(_, value)| number(*value)));
        row.push(number(convergence.frequency));
        let count = |updates: &Option<usize>| {
            updates.map_or_else(|| format!("> {}", convergence.errors.len()), |updates| updates.to_string())
        };
        row.extend(convergence.updates.iter().map(count));
        row.push(convergence.runs_per_update.to_string());
        table.row(&row);
    }
    text.push_str(&table.finish());
    let mut said = Vec::new();
    for convergence in &found.estimators {
        if let Some(reason) = convergence.reason.as_ref().map(|reason| format!("{}: {reason}", convergence.estimator))
            && !said.contains(&reason)
        {
            text.push_str(&format!("\n{reason}\n"));
            said.push(reason);
        }
    }
    text
}

fn describe(study: &Study) -> String {
    let mut text = format!(
        "model {} on a simulated plant; estimator {}; {} campaigns, seeds from {}\n\n",
        study.model, study.estimator, study.campaigns, study.first_seed
    );
    let mut table = TextTable::new(&[
        ("parameter", Align::Left),
        ("unit", Align::Left),
        ("true", Align::Decimal),
        ("mean", Align::Decimal),
        ("bias", Align::Decimal),
        ("+-", Align::Decimal),
        ("spread", Align::Decimal),
        ("stated", Align::Decimal),
        ("bound", Align::Decimal),
        ("95 % interval", Align::Right),
        ("of", Align::Right),
    ]);
    let spread = |value: Option<f64>| or_dash(value, |value| digits(value, SPREAD_DIGITS));
    for parameter in &study.parameters {
        let [mean, _] = cells(parameter.mean, parameter.bias_std);
        let [bias, bias_std] = cells(parameter.bias, parameter.bias_std);
        table.row(&[
            parameter.name.clone(),
            parameter.unit.as_deref().unwrap_or("-").to_owned(),
            beside(parameter.truth, parameter.mean, parameter.bias_std),
            mean,
            bias,
            bias_std,
            spread(parameter.spread),
            spread(parameter.stated),
            spread(parameter.bound),
            or_dash(parameter.coverage, |share| format!("{:.1} %", 100.0 * share)),
            parameter.values.to_string(),
        ]);
    }
    text.push_str(&table.finish());
    text.push_str("\nspread: standard deviation of the results; stated: what the campaigns said it is;\nbound: Cramer-Rao bound after the runs of the first campaign; 95 % interval: share of those stated that hold the true value\n");
    for warning in &study.warnings {
        text.push_str(&format!("warning: {warning}\n"));
    }
    text
}
