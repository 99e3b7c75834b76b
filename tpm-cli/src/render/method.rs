//! How the method came to its parameters, as tables.

use crate::render::cells::Cells;
use clap::ValueEnum;
use tpm_runtime::report::{number, or_dash};
use tpm_runtime::session::{MethodReport, MethodRun, MethodSignal, Phasor};

/// A line stands out of its noise when it is so many times as large.
const STANDS_OUT: f64 = 3.0;
/// Smallest share of the largest entry of a matrix that is no rounding.
const ROUNDING: f64 = 1e-9;

/// How the tables are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Style {
    /// For a terminal.
    Text,
    /// For a document.
    Markdown,
}

impl Style {
    fn table(self, cells: &Cells) -> String {
        match self {
            Style::Text => cells.text(),
            Style::Markdown => cells.markdown(),
        }
    }

    fn heading(self, level: usize, text: &str) -> String {
        match self {
            Style::Text => format!("\n{text}\n\n"),
            Style::Markdown => format!("\n{} {text}\n\n", "#".repeat(level)),
        }
    }
}

/// The tables of all runs, and the one of the updates.
pub(crate) fn tables(report: &MethodReport, style: Style) -> String {
    let mut text = style.heading(2, "How the method came to these parameters");
    text.push_str(
        "Predicted is what the parameters before and after a run say of its error, T B Lambda (before - after), to first order. A line is size*cos(k*w*t + phase), phases in rad; lines that do not stand out of their noise are left out.\n",
    );
    for run in &report.runs {
        text.push_str(&one_run(report, run, style));
    }
    text.push_str(&style.heading(3, "Updates"));
    text.push_str(&style.table(&updates(report)));
    text
}

fn one_run(report: &MethodReport, run: &MethodRun, style: Style) -> String {
    let mut played: Vec<String> =
        run.amplitudes.iter().map(|(name, value)| format!("{name} = {}", number(*value))).collect();
    played.push(format!("{} rad/s", number(run.frequency)));
    let mut text = style.heading(3, &format!("Run {}: {}", run.run, played.join(", ")));
    for signal in &run.signals {
        let unit = signal.unit.as_ref().map(|unit| format!(" [{unit}]")).unwrap_or_default();
        let what = if signal.error { "Error of " } else { "Input " };
        text.push_str(&style.heading(4, &format!("{what}{}{unit}", signal.signal)));
        text.push_str(&style.table(&lines(signal)));
    }
    text.push_str(&style.heading(4, "T B Lambda: error per unit of a parameter, size and phase"));
    text.push_str(&style.table(&matrix(report, run)));
    text.push_str(&style.heading(4, "Update"));
    let mut cells = Cells::new(&["parameter", "before", "after", "change", "std. dev."], 1);
    for (name, update) in report.parameters.iter().zip(&run.update) {
        cells.row(vec![
            name.clone(),
            number(update.before),
            number(update.after),
            number(update.after - update.before),
            or_dash(update.std, number),
        ]);
    }
    text.push_str(&style.table(&cells));
    text
}

fn lines(signal: &MethodSignal) -> Cells {
    let mut cells = Cells::new(&["harmonic", "measured", "phase", "noise", "predicted", "phase"], 0);
    for line in &signal.lines {
        let foreseen = line.predicted.is_some_and(|predicted| predicted.size > line.noise);
        if line.measured.size <= STANDS_OUT * line.noise && !foreseen {
            continue;
        }
        cells.row(vec![
            line.harmonic.to_string(),
            number(line.measured.size),
            phase(line.measured),
            number(line.noise),
            or_dash(line.predicted, |predicted| number(predicted.size)),
            or_dash(line.predicted, phase),
        ]);
    }
    cells
}

fn phase(phasor: Phasor) -> String {
    format!("{:.3}", phasor.phase)
}

fn matrix(report: &MethodReport, run: &MethodRun) -> Cells {
    let mut head = vec!["error of", "harmonic"];
    head.extend(report.parameters.iter().map(String::as_str));
    let mut cells = Cells::new(&head, 1);
    let peak = |j: usize| run.matrix.iter().map(|row| row.entries[j].size).fold(0.0, f64::max);
    let peaks: Vec<f64> = (0..report.parameters.len()).map(peak).collect();
    let felt = |(entry, peak): (&Phasor, &f64)| entry.size > ROUNDING * peak;
    for row in run.matrix.iter().filter(|row| row.entries.iter().zip(&peaks).any(felt)) {
        let mut line = vec![row.coordinate.clone(), row.harmonic.to_string()];
        line.extend(row.entries.iter().zip(&peaks).map(|(entry, peak)| {
            if felt((entry, peak)) { format!("{} at {}", number(entry.size), phase(*entry)) } else { "0".to_owned() }
        }));
        cells.row(line);
    }
    cells
}

/// One row per update (the form of Feng, Table 5.1).
fn updates(report: &MethodReport) -> Cells {
    let mut head = vec!["run", "w [rad/s]", "rms error"];
    head.extend(report.parameters.iter().map(String::as_str));
    let mut cells = Cells::new(&head, 0);
    for update in &report.updates {
        let mut row = match update.run {
            0 => vec!["before".to_owned(), "-".to_owned(), "-".to_owned()],
            run => {
                let error: Vec<String> = update.tracking_rms.iter().map(|rms| number(*rms)).collect();
                vec![run.to_string(), or_dash(update.frequency, number), error.join(" ")]
            }
        };
        row.extend(update.values.iter().map(|value| number(*value)));
        cells.row(row);
    }
    cells
}
