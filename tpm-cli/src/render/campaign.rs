//! A campaign as a report: the table of its runs (the form of Feng, Table 5.1), the tracking error of the first and the
//! last run, and the inputs beside their feed-forward (Figures 5.5, 5.6), as Markdown, SVG and PNG.

use crate::failure::Failure;
use crate::output::{file, picture};
use std::collections::BTreeMap;
use std::path::Path;
use tpm_runtime::campaign::RunReport;
use tpm_runtime::estimate::ParameterReport;
use tpm_runtime::model::Model as _;
use tpm_runtime::plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_runtime::report::{cells, combination, number};
use tpm_runtime::run::{Record, Trial};
use tpm_runtime::session::{Identification, Machine};

/// Most points of a curve.
const POINTS: usize = 1000;

/// A run as it was played.
pub(crate) struct Played {
    trial: Trial,
    record: Record,
    from: usize,
}

impl Played {
    /// The run with its samples; `None` when it did not settle.
    pub(crate) fn of(trial: &Trial, record: &Record, report: &RunReport) -> Option<Self> {
        let from = report.settled_after? * trial.samples_per_period;
        Some(Played { trial: trial.clone(), record: record.clone(), from })
    }

    /// Mean of a channel less `less` over the measured periods, against the phase as a share of the period.
    fn mean(&self, channel: &[f64], less: &dyn Fn(usize) -> f64) -> Vec<(f64, f64)> {
        let period = self.trial.samples_per_period;
        let used = &channel[self.from.min(channel.len())..];
        let periods = used.len() / period.max(1);
        (0..period)
            .step_by((period / POINTS).max(1))
            .map(|n| {
                let sum: f64 = (0..periods).map(|k| used[k * period + n]).sum();
                (n as f64 / period as f64, sum / periods.max(1) as f64 - less(n))
            })
            .collect()
    }

    fn error(&self, coordinate: usize) -> Vec<(f64, f64)> {
        let width = self.trial.reference.len() / self.trial.samples_per_period.max(1);
        self.mean(&self.record.coordinates[coordinate], &|n| self.trial.reference[n * width + coordinate])
    }

    fn input(&self, input: usize) -> Vec<(f64, f64)> {
        self.mean(&self.record.inputs[input], &|_| 0.0)
    }

    fn feed_forward(&self, input: usize) -> Vec<(f64, f64)> {
        let inputs = self.record.inputs.len();
        let period = self.trial.samples_per_period;
        let at = |n: usize| (n as f64 / period as f64, self.trial.feed_forward[n * inputs + input]);
        (0..period).step_by((period / POINTS).max(1)).map(at).collect()
    }

    fn name(&self, which: &str) -> String {
        format!("{which} run, {} rad/s", number(self.trial.trajectory.frequency))
    }
}

/// Writes table and figures into a folder.
pub(crate) fn write(
    folder: &Path,
    machine: &Machine,
    result: &Identification,
    first: Option<&Played>,
    last: Option<&Played>,
) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
    file::write_file(&folder.join("table.md"), table(machine, result).as_bytes())?;
    let (Some(first), Some(last)) = (first, last) else { return Ok(()) };
    let plant = machine.plant();
    let dims = plant.dims();
    let panel = |label: String, traces: Vec<Trace>| Panel {
        x: Axis::linear("share of the period").from_to(0.0, 1.0),
        y: Axis::linear(&label),
        traces,
    };
    let errors = (0..dims.coordinates).map(|c| {
        let traces = vec![
            Trace::new(&first.name("first"), 1, Curve::Line(first.error(c))),
            Trace::new(&last.name("last"), 0, Curve::Line(last.error(c))),
        ];
        panel(format!("error of {}", plant.coordinate(c)), traces)
    });
    draw(folder, "error", &Figure::new("Tracking error, mean over the measured periods", errors.collect()))?;
    let inputs = (0..dims.inputs).map(|i| {
        let traces = vec![
            Trace::new("applied", 1, Curve::Line(last.input(i))),
            Trace::new("feed-forward", 0, Curve::Dashed(last.feed_forward(i))),
        ];
        panel(plant.input(i).to_string(), traces)
    });
    draw(folder, "input", &Figure::new(&format!("Inputs of the {}", last.name("last")), inputs.collect()))
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

fn draw(folder: &Path, name: &str, figure: &Figure) -> Result<(), Failure> {
    ["svg", "png"].into_iter().try_for_each(|kind| picture::draw(&folder.join(format!("{name}.{kind}")), figure))
}
