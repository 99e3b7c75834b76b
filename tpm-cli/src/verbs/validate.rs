//! `tpm validate`: how well identified parameters predict another log.

use crate::failure::{Failure, Outcome};
use crate::input::domain::domain;
use crate::input::experiment::model;
use crate::input::issue::IssueArgs;
use crate::input::log::LogArgs;
use crate::input::values::identification;
use crate::output::{file, recording, report, writable};
use crate::render::flags;
use std::path::PathBuf;
use tpm_runtime::document::Document;
use tpm_runtime::estimate::{Domain, Refine};
use tpm_runtime::report::{Align, TextTable, number, probability};
use tpm_runtime::session::{
    BetweenStamps, CorrelationTest, Fit, Identifiable as _, LAGS, SessionError, Simulation, Validation, validate,
};

/// Options of `tpm validate`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// A result of `tpm identify --json` (.json), or NAME = VALUE lines (.toml).
    #[arg(long, value_name = "FILE")]
    params: PathBuf,
    /// The log to predict.
    #[arg(long, value_name = "FILE")]
    log: PathBuf,
    #[command(flatten)]
    reading: LogArgs,
    /// How the inputs that the motion asks for are compared: harmonics of the part that repeats, or every sample behind a low pass; a log
    /// that repeats by its harmonics when not given. The motion is simulated sample by sample either way.
    #[arg(long, value_parser = domain())]
    domain: Option<Domain>,
    /// Simulate the motion from the inputs, however long it takes. Of a machine of up to two coordinates, or one with rows without an input, it is
    /// simulated without being asked for.
    #[arg(long)]
    simulate: bool,
    /// Write a page for a browser (report.html) and its figures into this folder: measured against model, residual with its tests.
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Record measured, predicted and simulated motion in this MCAP file, for PlotJuggler, Foxglove and Rerun.
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    #[command(flatten)]
    issue: IssueArgs,
    /// Print JSON (tpm.validation/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    writable(args.output.as_deref(), args.report.as_deref())?;
    recording::possible(args.record.as_deref())?;
    let model = model(&args.file)?;
    let text = tpm_runtime::report::read_text(&args.params).map_err(|error| Failure::read(&args.params, error))?;
    let known = identification(&args.params, &text, model.evaluated().name())?;
    args.reading.without_fitted_delays()?;
    let mut request = args.reading.request(&args.log, model.evaluated())?;
    request.estimation.domain = args.domain;
    request.estimation.refine = if args.simulate { Refine::OutputError } else { Refine::Auto };
    let result = validate(&model, request, &known).map_err(|error| match &error {
        SessionError::NotIdentified { .. } => Failure::Input(format!(
            "{}: {}; give a result of this model, or NAME = VALUE lines of all its parameters",
            args.params.display(),
            flags::error(&error)
        )),
        _ => error.into(),
    })?;
    file::emit(args.output.as_deref(), &if args.json { file::json(&result)? } else { describe(&result) })?;
    if let Some(folder) = &args.report {
        report::write(folder, &Document::from(&result).issued(args.issue.now()), &[])?;
    }
    if let Some(path) = &args.record {
        recording::write(path, std::slice::from_ref(&result))?;
    }
    result.shortfall().map_or(Ok(()), |missing| Err(Failure::Incomplete(missing)))
}

/// What is said where a model lacks something on its log.
pub(super) const NEAREST: &str = "the model lacked something on the log of this result: the values that come nearest to the forces there are used, \
     which predict better than those that hold beside what is missing";

fn describe(result: &Validation) -> String {
    if let Some(run) = &result.between_stamps {
        return followed(result, run);
    }
    let mut text = format!(
        "model {} on {}\n{} from sample {}; hold {}; {}; nothing is fitted\n\n",
        result.model,
        result.log,
        result.period.map_or_else(
            || "time domain".to_owned(),
            |period| format!("{} periods of {} s", result.periods, number(period))
        ),
        result.from_sample,
        result.hold,
        result.cut_off.map_or_else(
            || format!("harmonics up to {}", result.harmonics),
            |cut_off| format!("low pass at {} Hz", number(cut_off))
        ),
    );
    let repeated = result.reading.repeated.iter().map(ToString::to_string);
    let late = result.delays.iter().map(|(input, delay)| {
        format!("`{input}` acts {} s later than it is recorded, as on the log of the result", number(*delay))
    });
    let nearest = result.nearest_values.then(|| NEAREST.to_owned()).into_iter().chain(late);
    for remark in result.reading.remarks().into_iter().chain(repeated).chain(nearest) {
        text.push_str(&format!("remark: {remark}\n"));
    }
    let mut table = TextTable::new(&[
        ("row", Align::Left),
        ("unit", Align::Left),
        ("applied, rms", Align::Right),
        ("missed, rms", Align::Right),
        ("prediction error", Align::Right),
    ]);
    for row in &result.rows {
        table.row(&[
            row.name.clone(),
            row.unit.as_deref().unwrap_or("-").to_owned(),
            number(row.force),
            number(row.missed),
            format!("{:.2} %", 100.0 * row.share),
        ]);
    }
    text.push_str(&table.finish());
    for row in &result.unpredicted {
        text.push_str(&format!(
            "{} is not predicted: it changes with {}, which the result leaves open\n",
            row.name, row.direction
        ));
    }
    match (&result.simulation, &result.not_simulated) {
        (Some(simulation), _) => text.push_str(&simulated(simulation)),
        (None, Some(why)) => text.push_str(&format!("\nthe motion is not simulated: {why}\n")),
        (None, None) => {}
    }
    text
}

/// The free run between stamps.
fn followed(result: &Validation, run: &BetweenStamps) -> String {
    let stretches = match run.stretches {
        1 => "one stretch".to_owned(),
        count => format!("{count} stretches"),
    };
    let mut text = format!(
        "model {} on {}\nsimulated between the stamps of {stretches}, {} s at most, from the state at its beginning that leaves least; hold {}; \
         nothing else is fitted\n\n",
        result.model,
        result.log,
        number(run.duration),
        result.hold
    );
    for remark in result.reading.remarks().into_iter().chain(result.reading.repeated.iter().map(ToString::to_string)) {
        text.push_str(&format!("remark: {remark}\n"));
    }
    let mut table = TextTable::new(&[
        ("sensor", Align::Left),
        ("unit", Align::Left),
        ("readings", Align::Right),
        ("free run, rms", Align::Right),
        ("fit", Align::Right),
    ]);
    for own in &run.sensors {
        table.row(&[
            own.signal.clone(),
            own.unit.as_deref().unwrap_or("-").to_owned(),
            own.readings.to_string(),
            number(own.free_run.rms),
            own.free_run.fit.map_or_else(|| "-".to_owned(), |fit| format!("{fit:.2} %")),
        ]);
    }
    text + &table.finish()
}

fn simulated(simulation: &Simulation) -> String {
    let stretches = match simulation.stretches {
        1 => "one stretch".to_owned(),
        count => format!("{count} stretches"),
    };
    let mut text = format!(
        "\nmotion simulated from the recorded inputs: {} of {} samples in {stretches}, each from its smoothed state\n\n",
        simulation.samples, simulation.of
    );
    let mut table = TextTable::new(&[
        ("coordinate", Align::Left),
        ("unit", Align::Left),
        ("one step, rms", Align::Right),
        ("fit", Align::Right),
        ("free run, rms", Align::Right),
        ("fit", Align::Right),
    ]);
    let percent = |fit: &Fit| fit.fit.map_or_else(|| "-".to_owned(), |fit| format!("{fit:.2} %"));
    for channel in &simulation.channels {
        let (rms, fit) = channel.free_run.as_ref().map_or_else(
            || ("diverges".to_owned(), "-".to_owned()),
            |free_run| (number(free_run.rms), percent(free_run)),
        );
        table.row(&[
            channel.name.clone(),
            channel.unit.as_deref().unwrap_or("-").to_owned(),
            number(channel.one_step.rms),
            percent(&channel.one_step),
            rms,
            fit,
        ]);
    }
    text.push_str(&table.finish());
    if let Some(leaving) = &simulation.diverges {
        let place =
            if simulation.stretches > 1 { format!(" of stretch {}", leaving.stretch + 1) } else { String::new() };
        text.push_str(&format!("the free run diverges at t = {} s{place}: {}\n", number(leaving.time), if leaving.unstable {
            "the motion is unstable without its loop, and the smallest error of the starting state grows to the size of the motion"
        } else {
            "the simulated motion leaves the measured one"
        }));
    }
    let noisy: Vec<String> = (simulation.channels.iter())
        .map(|channel| (&channel.name, &channel.unit, channel.noise))
        .chain(simulation.inputs.iter().map(|input| (&input.name, &input.unit, input.noise)))
        .map(|(name, unit, noise)| {
            format!("{name} {}", [number(noise), unit.clone().unwrap_or_default()].join(" ").trim())
        })
        .collect();
    text.push_str(&format!("noise found on this log, standard deviations: {}\n", noisy.join(", ")));
    text.push_str(&tests(simulation));
    text
}

fn tests(simulation: &Simulation) -> String {
    let mut table = TextTable::new(&[
        ("one-step errors", Align::Left),
        ("largest correlation", Align::Right),
        ("at lag", Align::Right),
        ("band", Align::Right),
        ("beyond", Align::Right),
        ("chance", Align::Right),
        ("", Align::Left),
    ]);
    let mut row = |what: String, test: &CorrelationTest| {
        let (largest, lag) = test.largest();
        let verdict = if test.passed { "passed" } else { "failed" };
        table.row(&[
            what,
            format!("{largest:.4}"),
            lag.to_string(),
            format!("{:.4}", test.band),
            format!("{} of {LAGS}", test.outside()),
            probability(test.chance, number),
            verdict.to_owned(),
        ]);
    };
    let mut none = true;
    for channel in &simulation.channels {
        if let Some(white) = &channel.whiteness {
            none = false;
            row(format!("{}: white", channel.name), white);
        }
        for independence in &channel.independence {
            row(format!("{}: independent of {}", channel.name, independence.input), &independence.test);
        }
    }
    if none {
        return String::new();
    }
    let rate = 100.0 * simulation.false_alarm;
    format!(
        "\n{}tested: {} samples, none around stops with dry friction; a right model fails each test with a chance of {rate} %, and a long log \
         shows the smallest misfit\n",
        table.finish(),
        simulation.tested
    )
}
