//! A pattern of few harmonics fitted to a path, written in the model language.

use crate::path::{FittedCoordinate, FittedPath, PathError, PathSettings, fit_path};
use serde::Serialize;
use std::fmt::{self, Write as _};
use tpm_plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_report::{Align, TextTable, number};

/// Smallest coefficient that is written, as a share of the size of the motion. Smaller ones are rounding.
const ROUNDING: f64 = 1e-12;

/// A path of a model's coordinates.
#[derive(Clone, Debug)]
pub struct SampledPath {
    /// Name of the model.
    pub model: String,
    /// Samples of the coordinates that move, by their names.
    pub signals: Vec<(String, Vec<f64>)>,
    /// Units of these coordinates.
    pub units: Vec<Option<String>>,
    /// Time between samples, s.
    pub sample_time: f64,
}

/// A pattern fitted to a path. It is displayed as a text, and serialised as `tpm.path/1`.
#[derive(Debug, Serialize)]
pub struct FittedPattern {
    schema: &'static str,
    model: String,
    #[serde(flatten)]
    found: FittedPath,
    pattern: String,
    #[serde(skip)]
    figure: Figure,
}

impl FittedPattern {
    /// Fits a pattern to a path.
    ///
    /// # Errors
    /// [`PathError`] when no pattern of these settings fits.
    pub fn new(path: &SampledPath, settings: PathSettings) -> Result<Self, PathError> {
        let found = fit_path(&path.signals, path.sample_time, settings)?;
        let units: Vec<String> =
            path.units.iter().map(|unit| unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}]"))).collect();
        Ok(Self {
            schema: "tpm.path/1",
            model: path.model.clone(),
            pattern: pattern(&found, &units),
            figure: figure(path, &found, &units, settings.harmonics),
            found,
        })
    }

    /// Every coordinate of the path and of the pattern over time.
    #[must_use]
    pub fn figure(&self) -> &Figure {
        &self.figure
    }
}

/// The pattern in the model language. Its amplitudes have the units of their coordinates, and scale the motion.
fn pattern(found: &FittedPath, units: &[String]) -> String {
    let mut text = "pattern fitted {\n".to_owned();
    let mut write = |line: String| text.push_str(&format!("    {line}\n"));
    for (coordinate, unit) in found.coordinates.iter().zip(units) {
        write(format!("amplitude {}_size{unit};", coordinate.coordinate));
    }
    write("frequency w [rad/s];".to_owned());
    for coordinate in &found.coordinates {
        write(format!("{} = {}_size*({});", coordinate.coordinate, coordinate.coordinate, sum(coordinate)));
    }
    text.push_str("}\n");
    text
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

fn figure(path: &SampledPath, found: &FittedPath, units: &[String], harmonics: u32) -> Figure {
    let panels = found.coordinates.iter().zip(&path.signals).zip(units).map(|((fitted, (name, values)), unit)| {
        let series = fitted.series();
        let time = |n: usize| n as f64 * path.sample_time;
        let given = values.iter().enumerate().map(|(n, value)| (time(n), *value)).collect();
        let played = |n: usize| series.derivative(found.frequency * time(n), 1.0, 0);
        let fitted = (0..values.len()).map(|n| (time(n), played(n))).collect();
        Panel {
            x: Axis::linear("time [s]"),
            y: Axis::linear(&format!("{name}{unit}")),
            traces: vec![Trace::new("path", 1, Curve::Dashed(given)), Trace::new("pattern", 0, Curve::Line(fitted))],
        }
    });
    Figure::new(&format!("{}: harmonics up to {harmonics}", path.model), panels.collect())
}

/// The pattern, the stage that plays the path, and how near it comes.
impl fmt::Display for FittedPattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sizes = self.found.coordinates.iter().map(|c| format!("{}_size = {}", c.coordinate, number(c.size)));
        let sizes: Vec<String> = sizes.collect();
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
        write!(
            f,
            "{}\nthe path itself: {{ pattern = \"fitted\", {}, w = {} }}\n\n{}",
            self.pattern,
            sizes.join(", "),
            number(self.found.frequency),
            table.finish()
        )
    }
}
