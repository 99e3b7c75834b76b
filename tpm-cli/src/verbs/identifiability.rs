//! `tpm identifiability`: what a pattern can show of the parameters, and what it cannot, before anything moves.

use crate::failure::{Failure, Outcome};
use crate::input::load::Loaded;
use crate::output::file;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use tpm_runtime::report::{Align, TextTable};
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::identifiability::{Experiment, Identifiability, PhysicalIdentifiability, identifiability};
use tpm_symbolic::harmonic::report::Report;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::regressor::parameter_map::ParameterMap;

/// Options of `tpm identifiability`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// A pattern to analyse; given several times, the experiments are taken together. The model's first when not given.
    #[arg(long, value_name = "NAME")]
    pattern: Vec<String>,
    /// Value of an amplitude, the frequency or a constant, exact (1/3, 0.25); left symbolic when not given. With several
    /// patterns, `NAME[2]=VALUE` is for the second only.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    settings: Vec<String>,
    /// Print JSON (tpm.identifiability/1).
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// A value for all experiments, or for one of them.
struct Setting {
    name: String,
    experiment: Option<usize>,
    value: Rational,
}

fn setting(text: &str, experiments: usize) -> Result<Setting, Failure> {
    let wrong = |what: &str| Failure::Input(format!("--set {text}: {what}"));
    let (name, value) = text.split_once('=').ok_or_else(|| wrong("write NAME=VALUE"))?;
    let value =
        rational::parse(value.trim()).ok_or_else(|| wrong("the value is not a number such as 2, 1/3 or 0.25"))?;
    let (name, experiment) = match name.trim().strip_suffix(']').and_then(|name| name.split_once('[')) {
        Some((name, number)) => {
            let number: usize =
                number.parse().map_err(|_| wrong("the number in brackets is that of an experiment, from 1"))?;
            if number == 0 || number > experiments {
                return Err(wrong(&format!("there are {experiments} experiments")));
            }
            (name, Some(number - 1))
        }
        None => (name.trim(), None),
    };
    Ok(Setting { name: name.to_owned(), experiment, value })
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let loaded = Loaded::from_file(&args.file)?;
    let names: Vec<Option<&str>> = if args.pattern.is_empty() {
        vec![None]
    } else {
        args.pattern.iter().map(|name| Some(name.as_str())).collect()
    };
    let prepared = loaded.prepared()?;
    let mut tables = Vec::with_capacity(names.len());
    for name in &names {
        let pattern = loaded.pattern(*name)?;
        tables.push(expand(&prepared.model, &prepared.form, pattern).map_err(|error| loaded.at(&error))?);
    }
    let mut experiments: Vec<Experiment<'_>> = names
        .iter()
        .zip(&tables)
        .map(|(name, table)| Experiment::of(name.unwrap_or("the pattern"), &prepared.model, table))
        .collect();
    for text in &args.settings {
        let Setting { name, experiment, value } = setting(text, experiments.len())?;
        for (number, slot) in experiments.iter_mut().enumerate() {
            if experiment.is_none_or(|only| only == number) {
                *slot = slot.clone().with(&name, value.clone());
            }
        }
    }
    let found = identifiability(&experiments).map_err(|error| Failure::Input(error.to_string()))?;
    let physical = found.physical(&ParameterMap::new(&prepared));
    let report = found.report();
    let text = if args.json { json(&report, physical.as_ref())? } else { describe(&found, &report, physical.as_ref()) };
    file::emit(args.output.as_deref(), &text)?;
    if report.rank < report.columns {
        return Err(Failure::Incomplete(format!(
            "the experiments show {} of {} parameters' combinations",
            report.rank, report.columns
        )));
    }
    Ok(())
}

fn json(report: &Report, physical: Option<&PhysicalIdentifiability>) -> Result<String, Failure> {
    /// The report, and the physical parameters behind the lumped ones.
    #[derive(serde::Serialize)]
    struct Whole<'a> {
        #[serde(flatten)]
        report: &'a Report,
        physical: Option<&'a PhysicalIdentifiability>,
    }
    file::json(&Whole { report, physical })
}

/// `factor name`, without the factor when it is one.
fn multiple(name: &str, factor: &str) -> String {
    match factor {
        "1" => name.to_owned(),
        "-1" => format!("-{name}"),
        factor => format!("({factor}) {name}"),
    }
}

fn sum(terms: &BTreeMap<String, String>) -> String {
    terms.iter().map(|(name, factor)| multiple(name, factor)).collect::<Vec<_>>().join(" + ")
}

fn describe(found: &Identifiability, report: &Report, physical: Option<&PhysicalIdentifiability>) -> String {
    let certainty = if report.proven { "exact, proven" } else { "exact at random rational points" };
    let mut text =
        format!("rank {} of {} parameters ({certainty}), {} rows\n", report.rank, report.columns, report.rows);
    if !report.indeterminates.is_empty() {
        let _ = writeln!(text, "left symbolic: {}", report.indeterminates.join(", "));
    }
    let mut table = TextTable::new(&[
        ("parameter", Align::Left),
        ("observable", Align::Left),
        ("harmonics up to", Align::Right),
        ("seen in harmonics", Align::Left),
    ]);
    for (parameter, observed) in report.parameters.iter().zip(&found.observability) {
        let mut harmonics: Vec<usize> = observed.visible.iter().map(|&row| found.rows[row].harmonic).collect();
        harmonics.sort_unstable();
        harmonics.dedup();
        table.row(&[
            parameter.name.clone(),
            if parameter.observable { "yes" } else { "no" }.to_owned(),
            parameter.harmonics_up_to.map_or_else(|| "-".to_owned(), |harmonic| harmonic.to_string()),
            harmonics.iter().map(usize::to_string).collect::<Vec<_>>().join(" "),
        ]);
    }
    let _ = write!(text, "\n{}", table.finish());
    match &report.unobservable {
        Some(directions) if directions.is_empty() => {}
        Some(directions) => {
            text.push_str("\nnothing is observed along\n");
            for direction in directions {
                let _ = writeln!(text, "  {}", sum(direction));
            }
        }
        None => text.push_str("\nthe unobservable directions are too long to print\n"),
    }
    if let Some(base) = report.base.as_ref().filter(|base| base.iter().any(|b| !b.plus.is_empty())) {
        text.push_str("\nbase parameters\n");
        for one in base {
            let rest = if one.plus.is_empty() { String::new() } else { format!(" + {}", sum(&one.plus)) };
            let _ = writeln!(text, "  {}{rest}", one.parameter);
        }
    }
    if let Some(physical) =
        physical.filter(|p| p.parameters != report.parameters.iter().map(|r| r.name.clone()).collect::<Vec<_>>())
    {
        let _ = writeln!(text, "\nphysical parameters: rank {} of {}", physical.rank, physical.parameters.len());
        for (name, determined) in physical.parameters.iter().zip(&physical.determined) {
            let _ = writeln!(text, "  {name}: {}", if *determined { "determined" } else { "not determined" });
        }
    }
    text
}
