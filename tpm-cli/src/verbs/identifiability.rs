//! `tpm identifiability`: what a pattern can show of the parameters, and what it cannot, before anything moves.

mod any_motion;
mod sensors;

use crate::failure::{Failure, Outcome};
use crate::input::load::Loaded;
use crate::output::file;
use crate::render::combination::{common_factors, not_counted, sum};
use crate::render::showing::showing_harmonics;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::PathBuf;
use tpm_runtime::report::{Align, TextTable, or_dash};
use tpm_runtime::study::{AskedPattern, Means, Report, ReportedRow, shown};
use tpm_symbolic::harmonic::identifiability::PhysicalIdentifiability;
use tpm_symbolic::number::rational::{self, Rational};

/// Options of `tpm identifiability`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// A pattern to analyse; given several times, the experiments are taken together. The model's first when not given.
    #[arg(long, value_name = "NAME")]
    pattern: Vec<String>,
    /// Value of an amplitude, the frequency or a constant, exact (1/3, 0.25); left symbolic when not given, drawn at random for a
    /// model without a table. With several patterns, `NAME[2]=VALUE` is for the second only. Where the pattern leaves a coordinate
    /// open, parameters may be given values too: its motion depends on them.
    #[arg(long = "value", value_name = "NAME=VALUE")]
    settings: Vec<String>,
    /// Highest harmonic that counts; the pattern's own number when not given, else all of the table (31 of terms that have
    /// infinitely many, and of models without a table).
    #[arg(long, value_name = "N")]
    harmonics: Option<usize>,
    /// What any motion can show, not that of a pattern: exact base parameters. The default of a model without a pattern.
    #[arg(long, conflicts_with_all = ["pattern", "settings", "harmonics"])]
    any_motion: bool,
    /// With `--any-motion`: a coordinate that rests at a value (exact), such as a joint that is locked.
    #[arg(long, value_name = "COORDINATE=VALUE")]
    rest: Vec<String>,
    /// Print JSON (tpm.identifiability/1; tpm.base/1 for any motion, tpm.observed/1 for unmeasured coordinates).
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

impl Setting {
    /// Whether the value is for the experiment of this index.
    fn is_for(&self, experiment: usize) -> bool {
        self.experiment.is_none_or(|only| only == experiment)
    }
}

fn setting(text: &str, experiments: usize) -> Result<Setting, Failure> {
    let wrong = |what: &str| Failure::Input(format!("--value {text}: {what}"));
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
    let unmeasured = loaded.model().coordinates.iter().any(|coordinate| coordinate.unmeasured);
    let simulated = || loaded.prepared().is_ok_and(|own| own.form.is_only_simulated(&own.model));
    if (unmeasured || simulated()) && !args.any_motion && args.pattern.is_empty() && args.rest.is_empty() {
        return sensors::run(&loaded, args.json, args.output.as_deref());
    }
    if args.any_motion || loaded.model().patterns.is_empty() && args.pattern.is_empty() {
        return any_motion::run(&loaded, &args.rest, args.json, args.output.as_deref());
    }
    if let Some(rest) = args.rest.first() {
        return Err(Failure::Input(format!("--rest {rest}: a pattern says how coordinates move; use --any-motion")));
    }
    let names: Vec<Option<&str>> = if args.pattern.is_empty() {
        vec![None]
    } else {
        args.pattern.iter().map(|name| Some(name.as_str())).collect()
    };
    let settings: Vec<Setting> =
        args.settings.iter().map(|text| setting(text, names.len())).collect::<Result<_, _>>()?;
    let mut asked = Vec::with_capacity(names.len());
    for (number, name) in names.into_iter().enumerate() {
        let pattern = loaded.pattern(name)?;
        let own = settings.iter().filter(|setting| setting.is_for(number));
        let values = own.map(|setting| (setting.name.clone(), setting.value.clone())).collect();
        let name = name.unwrap_or("the pattern").to_owned();
        asked.push(AskedPattern { name, pattern, harmonics: args.harmonics, values });
    }
    let found = shown(loaded.parsed(), &asked).map_err(|error| loaded.at_shown(error))?;
    for replaced in &found.replaced {
        file::remark(&format!("remark: {replaced}"));
    }
    if let Some(refused) = &found.refused {
        file::remark(&loaded.remark(refused));
        file::remark("remark: without a table, the answer is found in floating point along the pattern");
    }
    let text = if args.json {
        file::json(&found)?
    } else {
        describe(&found.report, found.physical.as_ref()) + &not_counted(&found.nonlinear)
    };
    file::emit(args.output.as_deref(), &text)?;
    let report = &found.report;
    if report.rank < report.columns {
        return Err(Failure::Incomplete(format!(
            "the experiments show {} of {} parameters' combinations",
            report.rank, report.columns
        )));
    }
    Ok(())
}

/// The harmonics of rows, each once.
fn harmonics(rows: &[ReportedRow]) -> String {
    let harmonics: BTreeSet<usize> = rows.iter().map(|row| row.harmonic).collect();
    harmonics.iter().map(usize::to_string).collect::<Vec<_>>().join(" ")
}

fn describe(report: &Report, physical: Option<&PhysicalIdentifiability>) -> String {
    let certainty = match (report.method, report.proven) {
        (Means::Numerical, _) => "numerical, along the pattern",
        (Means::Exact, true) => "exact, proven",
        (Means::Exact, false) => "exact at random rational points",
    };
    let mut text =
        format!("rank {} of {} parameters ({certainty}), {} rows\n", report.rank, report.columns, report.rows);
    if report.method == Means::Numerical && !report.at.is_empty() {
        let values = report.at.iter().map(|(name, value)| format!("{name} = {value}")).collect::<Vec<_>>();
        let _ = writeln!(text, "at {}; other settings drawn at random show no more", values.join(", "));
    } else if !report.indeterminates.is_empty() {
        let _ = writeln!(text, "left symbolic: {}", report.indeterminates.join(", "));
    }
    let mut table = TextTable::new(&[
        ("parameter", Align::Left),
        ("observable", Align::Left),
        ("harmonics up to", Align::Right),
        ("seen in harmonics", Align::Left),
        ("unchecked in", Align::Left),
    ]);
    for parameter in &report.parameters {
        table.row(&[
            parameter.name.clone(),
            if parameter.observable { "yes" } else { "no" }.to_owned(),
            or_dash(parameter.harmonics_up_to, |harmonic| harmonic.to_string()),
            harmonics(&parameter.visible_in),
            or_dash(Some(harmonics(&parameter.unchecked_in)).filter(|list| !list.is_empty()), |list| list),
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
    text.push_str(&common_factors(&report.common_factors));
    if let Some(base) = report.base.as_ref().filter(|base| base.iter().any(|b| !b.plus.is_empty())) {
        text.push_str("\nbase parameters\n");
        for one in base {
            let rest = if one.plus.is_empty() { String::new() } else { format!(" + {}", sum(&one.plus)) };
            let band = one.harmonics_up_to.map(|harmonic| format!("   harmonics up to {harmonic}")).unwrap_or_default();
            let unchecked = match harmonics(&one.unchecked_in) {
                list if list.is_empty() => list,
                list => format!("   unchecked in {list}"),
            };
            let _ = writeln!(text, "  {}{rest}{band}{unchecked}", one.parameter);
        }
    }
    let parameters = report.parameters.iter().flat_map(|parameter| &parameter.unchecked_in);
    if parameters.chain(report.base.iter().flatten().flat_map(|one| &one.unchecked_in)).next().is_some() {
        text.push_str(
            "\nunchecked: a force that the model lacks at such a harmonic is taken for the parameter, whatever its size, and leaves no\n\
             residual; another frequency checks it, or a pattern with more harmonics\n",
        );
    }
    let base = report.base.iter().flatten();
    text.push_str(&showing_harmonics(base.map(|one| (one.parameter.as_str(), one.shown_by.as_slice()))));
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
