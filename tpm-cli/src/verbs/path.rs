//! `tpm trajectories --path`: a pattern of few harmonics fitted to a path, written in the model language.

use crate::failure::Failure;
use crate::input::load::Loaded;
use crate::output::file;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use tpm_runtime::log::Log;
use tpm_runtime::log::ReadingSettings;
use tpm_runtime::plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_runtime::report::{Align, TextTable, number};
use tpm_runtime::study::{FittedCoordinate, FittedPath, PathSettings, fit_path};

/// Smallest coefficient that is written, as a share of the size of the motion. Smaller ones are rounding.
const ROUNDING: f64 = 1e-12;

/// Options of a path.
#[derive(clap::Args)]
pub(crate) struct PathArgs {
    /// Fit a pattern to this path in place of the comparison: a CSV file with the time in `t_s` and a column for every coordinate
    /// that moves, from the start of a stroke to its end.
    #[arg(long, value_name = "FILE")]
    path: Option<PathBuf>,
    /// Highest harmonic of the pattern that is fitted.
    #[arg(long, value_name = "N", default_value_t = 5, requires = "path")]
    highest: u32,
    /// Number of derivatives that vanish at both ends of the path.
    #[arg(long, value_name = "N", default_value_t = 3, requires = "path")]
    rest_order: u32,
    /// The path ends where it begins, and is repeated instead of played back.
    #[arg(long, requires = "path")]
    closed: bool,
}

/// A fitted path with what is written of it.
pub(crate) struct Fitted {
    model: String,
    settings: PathSettings,
    /// Unit of every coordinate as it is written behind a name.
    units: Vec<String>,
    path: Vec<(String, Vec<f64>)>,
    sample_time: f64,
    found: FittedPath,
}

#[derive(serde::Serialize)]
struct Report<'a> {
    schema: &'static str,
    model: &'a str,
    #[serde(flatten)]
    found: &'a FittedPath,
    pattern: String,
}

impl PathArgs {
    /// The pattern fitted to the path; nothing where there is no path.
    pub(crate) fn fitted(&self, model: &Path) -> Result<Option<Fitted>, Failure> {
        let Some(path) = &self.path else { return Ok(None) };
        let loaded = Loaded::from_file(model)?;
        let model = loaded.model();
        // The coordinates that the first pattern moves; all where there is no pattern.
        let moves = |c: usize| model.patterns.first().is_none_or(|pattern| pattern.motions[c].is_some());
        let moved: Vec<usize> = (0..model.coordinates.len()).filter(|&c| moves(c)).collect();
        let names: Vec<String> = moved.iter().map(|&c| model.coordinates[c].name.to_string()).collect();
        let log = Log::open_signals(path, &names, &ReadingSettings::default())
            .map_err(|error| Failure::Input(error.to_string()))?;
        let settings = PathSettings { harmonics: self.highest, rest: self.rest_order, closed: self.closed };
        let signals: Vec<(String, Vec<f64>)> = names.into_iter().zip(log.channels).collect();
        let found = fit_path(&signals, log.sample_time, settings).map_err(|error| {
            Failure::Input(format!("{}: {error} (--highest, --rest-order, --closed)", path.display()))
        })?;
        let unit = |&c: &usize| model.coordinates[c].unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}]"));
        Ok(Some(Fitted {
            model: model.name.clone(),
            settings,
            units: moved.iter().map(unit).collect(),
            path: signals,
            sample_time: log.sample_time,
            found,
        }))
    }
}

impl Fitted {
    /// The pattern in the model language. Its amplitudes have the units of their coordinates, and scale the motion.
    fn pattern(&self) -> String {
        let mut text = "pattern fitted {\n".to_owned();
        let mut write = |line: String| text.push_str(&format!("    {line}\n"));
        for (coordinate, unit) in self.found.coordinates.iter().zip(&self.units) {
            write(format!("amplitude {}_size{unit};", coordinate.coordinate));
        }
        write("frequency w [rad/s];".to_owned());
        for coordinate in &self.found.coordinates {
            write(format!("{} = {}_size*({});", coordinate.coordinate, coordinate.coordinate, sum(coordinate)));
        }
        text.push_str("}\n");
        text
    }

    /// The pattern, the stage that plays the path, and how near it comes.
    pub(crate) fn text(&self) -> String {
        let mut text = self.pattern();
        let sizes = self.found.coordinates.iter().map(|c| format!("{}_size = {}", c.coordinate, number(c.size)));
        let sizes: Vec<String> = sizes.collect();
        let _ = writeln!(
            text,
            "\nthe path itself: {{ pattern = \"fitted\", {}, w = {} }}\n",
            sizes.join(", "),
            number(self.found.frequency)
        );
        let mut table = TextTable::new(&[
            ("coordinate", Align::Left),
            ("rms distance", Align::Right),
            ("largest distance", Align::Right),
            ("of its size [%]", Align::Right),
        ]);
        for coordinate in &self.found.coordinates {
            table.row(&[
                coordinate.coordinate.clone(),
                number(coordinate.rms),
                number(coordinate.largest),
                number(100.0 * coordinate.largest / coordinate.size),
            ]);
        }
        text.push_str(&table.finish());
        text
    }

    /// The series, the pattern and the distances as JSON (tpm.path/1).
    pub(crate) fn json(&self) -> Result<String, Failure> {
        file::json(&Report { schema: "tpm.path/1", model: &self.model, found: &self.found, pattern: self.pattern() })
    }

    /// Every coordinate of the path and of the pattern over time.
    pub(crate) fn figure(&self) -> Figure {
        let panels =
            self.found.coordinates.iter().zip(&self.path).zip(&self.units).map(|((fitted, (name, values)), unit)| {
                let series = fitted.series();
                let time = |n: usize| n as f64 * self.sample_time;
                let given = values.iter().enumerate().map(|(n, value)| (time(n), *value)).collect();
                let played = |n: usize| series.derivative(self.found.frequency * time(n), 1.0, 0);
                let found = (0..values.len()).map(|n| (time(n), played(n))).collect();
                Panel {
                    x: Axis::linear("time [s]"),
                    y: Axis::linear(&format!("{name}{unit}")),
                    traces: vec![
                        Trace::new("path", 1, Curve::Dashed(given)),
                        Trace::new("pattern", 0, Curve::Line(found)),
                    ],
                }
            });
        let title = format!("{}: harmonics up to {}", self.model, self.settings.harmonics);
        Figure::new(&title, panels.collect())
    }
}

/// The series in units of its size.
fn sum(coordinate: &FittedCoordinate) -> String {
    let mut text = String::new();
    let mut add = |value: f64, function: String| {
        let value = value / coordinate.size;
        if value.abs() > ROUNDING {
            let sign = match (text.is_empty(), value < 0.0) {
                (true, false) => "",
                (true, true) => "-",
                (false, false) => " + ",
                (false, true) => " - ",
            };
            let _ = write!(text, "{sign}{}{function}", value.abs());
        }
    };
    add(coordinate.mean, String::new());
    for &(harmonic, cos, sin) in &coordinate.lines {
        let argument = if harmonic == 1 { "w*t".to_owned() } else { format!("{harmonic}*w*t") };
        add(cos, format!("*cos({argument})"));
        add(sin, format!("*sin({argument})"));
    }
    text
}
