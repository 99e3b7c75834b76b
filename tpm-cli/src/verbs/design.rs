//! `tpm design`: experiments that would give the most information within the limits.

mod mechanism;

use crate::failure::{Failure, Outcome};
use crate::input::experiment::SimulatedArgs;
use crate::output::{file, writable};
use clap::builder::RangedU64ValueParser;
use std::path::PathBuf;
use tpm_runtime::model::Model as _;
use tpm_runtime::report::{Align, TextTable, number, or_dash};
use tpm_runtime::session::SessionError;
use tpm_runtime::study::{Candidate, Design, design};

/// Options of `tpm design`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    #[command(flatten)]
    simulated: SimulatedArgs,
    /// How many candidates to propose.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = RangedU64ValueParser::<usize>::new().range(1..))]
    best: usize,
    #[command(flatten)]
    mechanism: mechanism::MechanismArgs,
    /// Print all candidates as JSON (tpm.design/1, of a mechanism tpm.excitation/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

#[derive(serde::Serialize)]
struct Report<'a> {
    schema: &'static str,
    model: &'a str,
    #[serde(flatten)]
    design: &'a Design,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    writable(args.output.as_deref(), None)?;
    let session = args.simulated.session(&args.file)?;
    if mechanism::is_meant(&session) {
        let (best, json, output) = (args.best, args.json, args.output.as_deref());
        return mechanism::run(&args.mechanism, &mechanism::Asked { file: &args.file, best, json, output }, &session);
    }
    if let Some(option) = args.mechanism.asked() {
        return Err(Failure::Input(format!(
            "{option} is for a mechanism all of whose joints move on their own, which {} is not: leave it out, and the best \
             candidates are printed",
            args.file.display()
        )));
    }
    let (machine, experiment) = (session.machine(), session.experiment());
    let found = design(machine.plant(), machine.pattern(), experiment).map_err(SessionError::from)?;
    let text = if args.json {
        file::json(&Report { schema: "tpm.design/1", model: machine.plant().name(), design: &found })?
    } else {
        describe(&found, args.best)
    };
    file::emit(args.output.as_deref(), &text)?;
    if found.candidates.iter().all(|candidate| candidate.passed.is_some()) {
        return Err(Failure::Incomplete("no candidate keeps within the limits".to_owned()));
    }
    Ok(())
}

fn describe(found: &Design, best: usize) -> String {
    let candidates = &found.candidates;
    let Some(first) = candidates.first() else { return String::new() };
    let mut head: Vec<(&str, Align)> = first.amplitudes.iter().map(|(name, _)| (name.as_str(), Align::Right)).collect();
    head.push(("w", Align::Right));
    head.extend([("multiples", Align::Left), ("rank", Align::Right), ("condition", Align::Right)]);
    head.extend([("ln det", Align::Right), ("effort", Align::Right), ("near a mode", Align::Left)]);
    let deviations: Vec<String> = first.parameters.iter().map(|p| format!("std {}", p.name)).collect();
    head.extend(deviations.iter().map(|name| (name.as_str(), Align::Right)));
    let mut table = TextTable::new(&head);
    for candidate in candidates.iter().filter(|candidate| candidate.passed.is_none()).take(best) {
        let mut row: Vec<String> = candidate.amplitudes.iter().map(|(_, value)| number(*value)).collect();
        row.push(number(candidate.frequency));
        let multiples: Vec<String> = candidate.multiples.iter().map(|(name, m)| format!("{name} {m}")).collect();
        row.push(if multiples.is_empty() { "-".to_owned() } else { multiples.join(" ") });
        row.push(candidate.rank.to_string());
        row.push(number(candidate.condition));
        row.push(number(candidate.determinant));
        row.push(or_dash(candidate.effort_share, |share| format!("{:.1} %", 100.0 * share)));
        row.push(or_dash(candidate.near_mode.as_ref(), |mode| {
            format!("{} of {} at {} rad/s", mode.harmonic, mode.signal, number(mode.frequency))
        }));
        row.extend(candidate.parameters.iter().map(|p| or_dash(p.std, number)));
        table.row(&row);
    }
    let mut text = table.finish();
    let list = |values: &[(String, f64)]| -> String {
        values.iter().map(|(name, value)| format!("{name} {}", number(*value))).collect::<Vec<_>>().join(", ")
    };
    text.push_str(&format!(
        "\nstd: Cramer-Rao bound of one run, for noise of {}, near the estimates {}\n",
        list(&found.noise),
        list(&found.estimates)
    ));
    let beyond: Vec<&Candidate> = candidates.iter().filter(|candidate| candidate.passed.is_some()).collect();
    if let Some(passed) = beyond.first().and_then(|candidate| candidate.passed.as_ref()) {
        text.push_str(&format!(
            "{} candidates pass limits.effort_share; the best of them asks {:.0} % of {} at sample {} of its period\n",
            beyond.len(),
            100.0 * passed.share,
            passed.input,
            passed.sample
        ));
    }
    text
}
