//! A campaign as a report: its page, and the table of its runs (the form of Feng, Table 5.1) as Markdown.

use crate::failure::Failure;
use crate::output::{file, report};
use crate::render::flags;
use std::collections::BTreeMap;
use std::path::Path;
use tpm_runtime::campaign::RunReport;
use tpm_runtime::document::{Document, Issue, PlayedRun};
use tpm_runtime::estimate::ParameterReport;
use tpm_runtime::model::Model as _;
use tpm_runtime::motion::{Record, Trial};
use tpm_runtime::report::{cells, combination, number};
use tpm_runtime::session::{Identification, Machine, Session};

/// The first and the last run of a campaign that settled.
#[derive(Default)]
pub(crate) struct Watched {
    first: Option<PlayedRun>,
    last: Option<PlayedRun>,
}

impl Watched {
    /// Keeps a run that has just ended, where it is needed.
    pub(crate) fn see(&mut self, trial: &Trial, record: &Record, run: &RunReport) {
        if let Some(now) = PlayedRun::of(trial, record, run) {
            let place = if self.first.is_none() { &mut self.first } else { &mut self.last };
            *place = Some(now);
        }
    }

    /// Writes the report of the campaign into a folder.
    pub(crate) fn write(
        &self,
        folder: &Path,
        session: &Session,
        result: &Identification,
        issue: Issue,
    ) -> Result<(), Failure> {
        let run = self.last.as_ref().or(self.first.as_ref());
        let explained = run.map(|run| session.explained(result, run.record(), run.report())).transpose();
        let evidence = explained.map(Option::flatten).unwrap_or_else(|error| {
            file::remark(&format!("remark: the report is without measured against model: {}", flags::error(&error)));
            None
        });
        let mut document = Document::of_identification(result, evidence.as_slice(), &flags::remedy);
        if let (Some(first), Some(last)) = (&self.first, &self.last) {
            document.add_runs(session.machine().plant(), first, last);
        }
        let document = document.of_machine(session.model(), result, &|_| None);
        report::write(folder, &document.issued(issue), &[("table.md", table(session.machine(), result))])
    }
}

/// Table with one row per run and the parameters behind its feed-forward, then the identified parameters.
fn table(machine: &Machine, result: &Identification) -> String {
    let plant = machine.plant();
    let names: Vec<&str> = (0..plant.dims().parameters).map(|j| plant.parameter(j).name).collect();
    let row = |first: String, values: &[f64]| {
        format!("| {first} | {} |\n", values.iter().map(|value| number(*value)).collect::<Vec<_>>().join(" | "))
    };
    let mut text = format!("| {} | {} |\n", machine.pattern().frequency, names.join(" | "));
    text.push_str(&format!("|{}\n", " ---: |".repeat(names.len() + 1)));
    for run in &result.runs {
        text.push_str(&row(number(run.frequency), &run.played));
    }
    let own = result.parameters.iter().chain(&result.physical);
    let own: BTreeMap<&str, &ParameterReport> = own.map(|parameter| (parameter.name.as_str(), parameter)).collect();
    let identified = names.iter().map(|name| match own.get(name) {
        Some(ParameterReport { value: Some(value), .. }) => number(*value),
        Some(ParameterReport { with_prior: Some(value), .. }) => format!("{} (prior)", number(*value)),
        _ => "not shown".to_owned(),
    });
    text.push_str(&format!("| identified | {} |\n", identified.collect::<Vec<_>>().join(" | ")));
    if !result.unobservable.is_empty() {
        text.push_str("\nAlong these directions the runs show nothing; values above keep priors that were stated:\n\n");
        for direction in &result.unobservable {
            text.push_str(&format!("- {}\n", combination(direction)));
        }
    }
    if !result.combinations.is_empty() {
        text.push_str("\nWhat they do show of these parameters:\n\n");
        for shown in &result.combinations {
            let [value, std] = cells(Some(shown.value), Some(shown.std));
            text.push_str(&format!("- {} = {value}, standard deviation {std}\n", combination(&shown.terms)));
        }
    }
    text
}
