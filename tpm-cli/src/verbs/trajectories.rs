//! `tpm trajectories`: the pattern beside the usual laws of a stroke, with the harmonics and peaks of every input; or a pattern fitted
//! to a path.

use crate::failure::{Failure, Outcome};
use crate::output::{file, picture};
use crate::render::cells::Cells;
use crate::verbs::actuator::{MachineArgs, Use};
use crate::verbs::path;
use clap::ValueEnum;
use std::fmt::Write as _;
use std::path::PathBuf;
use tpm_runtime::report::{number, or_dash};
use tpm_runtime::study::{InputUse, MovedMachine, StrokeError, Trajectories, trajectories};

/// How the comparison is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Tables for a terminal.
    #[default]
    Text,
    /// Tables for a document.
    Markdown,
    /// One line per harmonic: input, harmonic, and the magnitude along every motion.
    Csv,
    /// One object (tpm.trajectories/1).
    Json,
}

/// Options of `tpm trajectories`.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    machine: MachineArgs,
    /// Phase at which the stroke of the pattern ends, rad; half a period when not given.
    #[arg(long, value_name = "RAD", allow_negative_numbers = true, default_value_t = std::f64::consts::PI)]
    end: f64,
    /// Number of harmonics in the tables.
    #[arg(long, value_name = "N", default_value_t = 15)]
    harmonics: usize,
    /// How to write the comparison.
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
    /// Print JSON (tpm.trajectories/1, tpm.path/1 with --path); the same as --format json.
    #[arg(long, conflicts_with = "format")]
    json: bool,
    #[command(flatten)]
    path: path::PathArgs,
    /// Draw the inputs over one period and their harmonics into this file, .svg or .png.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

#[derive(serde::Serialize)]
struct Report<'a> {
    schema: &'static str,
    model: &'a str,
    motion: String,
    #[serde(flatten)]
    compared: &'a Trajectories,
}

/// Cells as a format has them.
fn written(cells: &Cells, format: Format) -> String {
    match format {
        Format::Csv => cells.csv(),
        Format::Markdown => cells.markdown(),
        Format::Text | Format::Json => cells.text(),
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(path) = &args.plot {
        picture::Picture::of(path)?;
    }
    if !(args.end.is_finite() && args.end > 0.0) {
        return Err(Failure::Input(format!("--end {}: the phase at which a stroke ends is positive", args.end)));
    }
    if let Some(fitted) = args.path.fitted(&args.machine.file)? {
        let text = if args.json || args.format == Format::Json { file::json(&fitted)? } else { fitted.to_string() };
        if let Some(path) = &args.plot {
            picture::draw(path, fitted.figure())?;
        }
        return file::emit(args.output.as_deref(), &text);
    }
    let machine = args.machine.moved(Use::AnyMotion)?.machine;
    let derivatives = machine.machine.highest_derivative();
    let compared =
        trajectories(&machine.machine.demand(), &machine.trajectory(), args.end, derivatives).map_err(|error| {
            let remedy = match &error {
                StrokeError::NoTravel { .. } | StrokeError::Moving { .. } => {
                    "; state the phase of such an end with --end RAD"
                }
                _ => "",
            };
            Failure::Input(format!("{error}{remedy}"))
        })?;
    if let Some(path) = &args.plot {
        let title = format!("{}: {machine}", machine.model);
        picture::draw(path, &compared.figure(&title))?;
    }
    let format = if args.json { Format::Json } else { args.format };
    let text = match format {
        Format::Json => file::json(&Report {
            schema: "tpm.trajectories/1",
            model: &machine.model,
            motion: machine.to_string(),
            compared: &compared,
        })?,
        Format::Csv => written(&lines(&compared, usize::MAX), format),
        Format::Text | Format::Markdown => as_text(&machine, &compared, args.harmonics, format),
    };
    file::emit(args.output.as_deref(), &text)
}

fn as_text(machine: &MovedMachine, compared: &Trajectories, harmonics: usize, format: Format) -> String {
    let mut text = format!("{}: {machine}\n\n", machine.model);
    text.push_str(&written(&summary(compared), format));
    text.push('\n');
    text.push_str(&written(&speeds(compared), format));
    text.push('\n');
    text.push_str(&written(&lines(compared, harmonics), format));
    let pattern = compared.motions.first().and_then(|moved| moved.inputs.as_ref());
    for input in pattern.into_iter().flatten() {
        let beyond = |name: &str, other: &InputUse| format!("{name} {} %", number(100.0 * other.beyond / other.rms));
        let others = compared.motions.iter().skip(1).filter_map(|moved| {
            let other = moved.inputs.as_ref()?.iter().find(|other| other.input == input.input)?;
            Some(beyond(&moved.name, other))
        });
        let others: Vec<String> = others.collect();
        if !others.is_empty() {
            let _ = writeln!(
                text,
                "\n{}: the pattern needs harmonics up to {}; above it lies, of the root mean square: {}",
                input.input,
                input.highest,
                others.join(", ")
            );
        }
    }
    for moved in compared.motions.iter().filter(|moved| moved.inputs.is_none()) {
        let _ = writeln!(
            text,
            "\n{}: no finite input makes it, since the inputs depend on derivative {} of the motion",
            moved.name, compared.derivatives
        );
    }
    text
}

/// Peaks and the reach of the harmonics, by input and motion.
fn summary(compared: &Trajectories) -> Cells {
    let mut cells = Cells::new(
        &["input", "unit", "motion", "peak", "rms", "harmonics above 1 %, up to", "rms above the pattern's"],
        3,
    );
    let count = compared.motions.first().and_then(|moved| moved.inputs.as_ref()).map_or(0, Vec::len);
    for i in 0..count {
        for moved in &compared.motions {
            let Some(input) = moved.inputs.as_ref().map(|inputs| &inputs[i]) else { continue };
            cells.row(vec![
                input.input.clone(),
                or_dash(input.unit.as_ref(), ToString::to_string),
                moved.name.clone(),
                number(input.peak),
                number(input.rms),
                input.highest.to_string(),
                number(input.beyond),
            ]);
        }
    }
    cells
}

/// Peaks of velocity and acceleration, by coordinate and motion.
fn speeds(compared: &Trajectories) -> Cells {
    let mut cells =
        Cells::new(&["coordinate", "unit", "motion", "travel", "peak velocity [/s]", "peak acceleration [/s^2]"], 3);
    let count = compared.motions.first().map_or(0, |moved| moved.coordinates.len());
    for c in 0..count {
        for moved in compared.motions.iter().filter(|moved| moved.inputs.is_some()) {
            let coordinate = &moved.coordinates[c];
            cells.row(vec![
                coordinate.coordinate.clone(),
                or_dash(coordinate.unit.as_ref(), ToString::to_string),
                moved.name.clone(),
                number(coordinate.travel),
                number(coordinate.velocity),
                number(coordinate.acceleration),
            ]);
        }
    }
    cells
}

/// Magnitudes of the harmonics, the mean first, by input and motion.
fn lines(compared: &Trajectories, most: usize) -> Cells {
    /// Smallest magnitude that is no rounding, as a share of the largest.
    const ROUNDING: f64 = 1e-9;
    let played: Vec<_> =
        compared.motions.iter().filter_map(|moved| Some((&moved.name, moved.inputs.as_ref()?))).collect();
    let mut head = vec!["input", "harmonic"];
    head.extend(played.iter().map(|(name, _)| name.as_str()));
    let mut cells = Cells::new(&head, 1);
    for i in 0..played.first().map_or(0, |(_, inputs)| inputs.len()) {
        let largest = |input: &InputUse| input.harmonics.iter().copied().fold(0.0, f64::max);
        let shown = |input: &InputUse, k: usize| {
            let line = input.harmonics[k];
            if line > ROUNDING * largest(input) { number(line) } else { "0".to_owned() }
        };
        let first = &played[0].1[i];
        for k in 0..first.harmonics.len().min(most.saturating_add(1)) {
            let mut row = vec![first.input.clone(), k.to_string()];
            row.extend(played.iter().map(|(_, inputs)| shown(&inputs[i], k)));
            cells.row(row);
        }
    }
    cells
}
