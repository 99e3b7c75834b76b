//! Figures of measured and predicted forces, over time and harmonic by harmonic.

use num_complex::Complex;
use std::f64::consts::PI;
use tpm_plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_session::{RowCourse, RowPrediction, Validation};

/// Number of points of a curve over one period.
const POINTS: usize = 400;
/// Largest number of points of a curve over a log.
const MOST: usize = 1600;
/// Height of a panel, in pixels; the second constant is the height of the margins around all panels.
pub(super) const PANEL: u32 = 250;
pub(super) const AROUND: u32 = 30;
/// Factor by which an axis of amplitudes extends beyond the smallest and the largest amplitude, so that their points
/// are not cut.
const ROOM: f64 = 2.0;
/// Harmonics below this share of the largest are not drawn.
const SMALL: f64 = 1e-9;

/// A figure for a page, with lower panels than those of a figure in its own file.
pub(super) fn low(title: String, panels: Vec<Panel>) -> Figure {
    let height = AROUND + PANEL * panels.len() as u32;
    Figure { height, ..Figure::new(&title, panels) }
}

fn label(row: &RowPrediction) -> String {
    row.unit.as_ref().map_or_else(|| row.name.clone(), |unit| format!("{} [{unit}]", row.name))
}

type Line = (usize, Complex<f64>, Complex<f64>);

/// Force over one period, computed from its phasors at the used harmonics.
fn over_period(lines: &[Line], of: fn(&Line) -> Complex<f64>) -> Vec<(f64, f64)> {
    let at = |phase: f64| -> f64 {
        lines.iter().map(|line| (of(line) * Complex::from_polar(1.0, 2.0 * PI * line.0 as f64 * phase)).re).sum()
    };
    (0..=POINTS).map(|n| n as f64 / POINTS as f64).map(|phase| (phase, at(phase))).collect()
}

/// Values over time. Where they are more than a figure can show, the least and the largest of several successive ones.
fn over_time(values: &[f64], from: f64, apart: f64) -> Vec<(f64, f64)> {
    let time = |k: usize| from + k as f64 * apart;
    let count = (2 * values.len()).div_ceil(MOST).max(1);
    let mut points = Vec::new();
    for first in (0..values.len()).step_by(count) {
        let bucket = || (first..values.len().min(first + count)).filter(|&k| values[k].is_finite());
        let least = bucket().min_by(|&a, &b| values[a].total_cmp(&values[b]));
        let largest = bucket().max_by(|&a, &b| values[a].total_cmp(&values[b]));
        match (least, largest) {
            (Some(a), Some(b)) if a == b => points.push((time(a), values[a])),
            (Some(a), Some(b)) => points.extend([a.min(b), a.max(b)].map(|k| (time(k), values[k]))),
            _ => points.push((time(first), f64::NAN)),
        }
    }
    points
}

/// Measured and predicted force of every predicted row over time or over one period, and the prediction error below
/// each; nothing where no row is predicted.
pub(super) fn in_time(found: &Validation) -> Option<Figure> {
    let mut panels = Vec::new();
    for row in &found.rows {
        let (axis, measured, predicted) = match &row.course {
            RowCourse::Harmonics(lines) => (
                Axis::linear("share of the period").from_to(0.0, 1.0),
                over_period(lines, |line| line.1),
                over_period(lines, |line| line.2),
            ),
            RowCourse::Time(course) => (
                Axis::linear("time [s]"),
                over_time(&course.applied, course.from, course.apart),
                over_time(&course.predicted, course.from, course.apart),
            ),
        };
        let missed = match &row.course {
            RowCourse::Harmonics(lines) => {
                let residual: Vec<Line> = lines.iter().map(|line| (line.0, line.1 - line.2, line.2)).collect();
                over_period(&residual, |line| line.1)
            }
            RowCourse::Time(course) => {
                let missed: Vec<f64> = course.applied.iter().zip(&course.predicted).map(|(a, b)| a - b).collect();
                over_time(&missed, course.from, course.apart)
            }
        };
        if !drawable(&measured) || !drawable(&missed) {
            continue;
        }
        let traces = vec![
            Trace::new("applied", 0, Curve::Line(measured)),
            Trace::new("model, from the measured motion", 1, Curve::Dashed(predicted)),
        ];
        panels.push(Panel { x: axis.clone(), y: Axis::linear(&label(row)), traces });
        let traces = vec![Trace::new("applied less model", 2, Curve::Line(missed))];
        panels.push(Panel { x: axis, y: Axis::linear(&label(row)), traces });
    }
    (!panels.is_empty()).then(|| low(format!("{}: applied forces and those of the model", found.model), panels))
}

/// Whether a curve can be drawn: it has at least two finite points.
fn drawable(points: &[(f64, f64)]) -> bool {
    points.iter().filter(|(_, y)| y.is_finite()).count() > 1
}

/// Amplitudes of the applied force by harmonic, and of its prediction error; nothing where no harmonics were compared.
pub(super) fn by_harmonic(found: &Validation) -> Option<Figure> {
    let mut panels = Vec::new();
    for row in &found.rows {
        let RowCourse::Harmonics(lines) = &row.course else { continue };
        let largest = lines.iter().map(|line| line.1.norm()).fold(0.0, f64::max);
        let points = |of: fn(&Line) -> f64| -> Vec<(f64, f64)> {
            let all = lines.iter().filter(|line| line.0 > 0).map(|line| (line.0 as f64, of(line)));
            all.filter(|(_, size)| *size > SMALL * largest).collect()
        };
        let (applied, missed) = (points(|line| line.1.norm()), points(|line| (line.1 - line.2).norm()));
        if applied.is_empty() {
            continue;
        }
        let last = lines.iter().map(|line| line.0).max().unwrap_or(1) as f64;
        let sizes = || applied.iter().chain(&missed).map(|point| point.1);
        let (low, high) = (sizes().fold(f64::INFINITY, f64::min), sizes().fold(0.0, f64::max));
        let traces = vec![
            Trace::new("applied", 0, Curve::Points(applied)),
            Trace::new("applied less model", 2, Curve::Points(missed)),
        ];
        let x = Axis::whole("harmonic").from_to(0.0, last + 1.0);
        panels.push(Panel { x, y: Axis::logarithmic(&label(row)).from_to(low / ROOM, high * ROOM), traces });
    }
    (!panels.is_empty()).then(|| low(format!("{}: amplitude of every harmonic that is used", found.model), panels))
}

/// Correlations of the one-step errors at the tested lags, with the band that the errors of a correct model keep
/// within; nothing where nothing is tested.
pub(super) fn correlations(found: &Validation) -> Option<Figure> {
    let simulation = found.simulation.as_ref()?;
    let mut panels = Vec::new();
    for channel in &simulation.channels {
        let Some(white) = &channel.whiteness else { continue };
        let at = |values: &[f64]| values.iter().zip(1..).map(|(r, lag)| (f64::from(lag), *r)).collect::<Vec<_>>();
        let last = white.correlations.len() as f64;
        let mut traces = vec![
            Trace::new(
                "band",
                2,
                Curve::Band(vec![(0.5, -white.band, white.band), (last + 0.5, -white.band, white.band)]),
            ),
            Trace::new("with itself", 0, Curve::Points(at(&white.correlations))),
        ];
        for (i, own) in channel.independence.iter().enumerate() {
            let name = format!("with {} before it", own.input);
            traces.push(Trace::new(&name, i + 3, Curve::Points(at(&own.test.correlations))));
        }
        let x = Axis::whole("lag, samples").from_to(0.0, last + 1.0);
        panels.push(Panel { x, y: Axis::linear(&format!("errors of {}", channel.name)), traces });
    }
    (!panels.is_empty()).then(|| low(format!("{}: correlations of the one-step errors", found.model), panels))
}
