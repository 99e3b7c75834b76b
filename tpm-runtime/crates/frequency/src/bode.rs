//! Bode plots: magnitude and phase of measured responses and models (Fong, Figure 6).
//!
//! Invariant: phases are continuous along the frequency and all curves lie on the branch of the first one; measured phases lie
//! within half a turn of the first model's, where there is one.

use crate::response::{FrequencyResponse, ResponseLine};
use num_complex::Complex;
use std::f64::consts::PI;
use tpm_plot::{Axis, Curve, Figure, Panel, Trace};

/// Number of points of a model's curve.
const CURVE_POINTS: usize = 600;
/// Probability that the band around a measured response covers.
const BAND_COVERAGE: f64 = 0.95;

/// Title, unit and band of a Bode plot.
#[derive(Clone, Debug, PartialEq)]
pub struct BodeSettings {
    /// Title.
    pub title: String,
    /// Unit of output over input, for the label; may be empty.
    pub unit: String,
    /// Lowest frequency, Hz.
    pub low: f64,
    /// Highest frequency, Hz.
    pub high: f64,
}

/// A model to be drawn: its name, and its response at an angular frequency in rad/s.
pub type NamedModel<'a> = (&'a str, &'a dyn Fn(f64) -> Complex<f64>);

/// Magnitude, phase and coherence of a measured response with its confidence band (95 %), and models beside it.
#[must_use]
pub fn bode(response: &FrequencyResponse, models: &[NamedModel<'_>], settings: &BodeSettings) -> Figure {
    // 1. Phases of the measured response, on the branch of the first model.
    let (low, high) = (settings.low, settings.high);
    let usable: Vec<&ResponseLine> = response.band(low, high).filter(|line| line.usable).collect();
    let measured: Vec<f64> = match models.first() {
        // Where noise changes a phase by more than half a turn only a model shows on which branch the phase lies.
        Some((_, model)) => {
            let mut expected = unwrapped(usable.iter().map(|line| model(line.frequency)));
            let own: Vec<f64> = usable.iter().map(|line| line.h1.arg()).collect();
            if let (Some(own), Some(&first)) = (own.first(), expected.first()) {
                let turns = turns(own - first);
                expected.iter_mut().for_each(|angle| *angle += turns);
            }
            own.iter().zip(&expected).map(|(own, expected)| own + turns(expected - own)).collect()
        }
        None => unwrapped(usable.iter().map(|line| line.h1)),
    };
    // 2. Measured magnitudes and phases with their confidence bands.
    let branch = measured.first().copied();
    let hertz = |line: &&ResponseLine| line.hertz();
    let radius: Vec<f64> = usable.iter().map(|line| response.radius(line, BAND_COVERAGE)).collect();
    let mut magnitude = Vec::new();
    let mut phase = Vec::new();
    let band = usable.iter().zip(&radius).map(|(line, r)| {
        // A logarithmic axis cannot show a band that reaches zero; the band is cut a decade below the response.
        let size = line.h1.norm();
        (line.hertz(), (size - r).max(0.1 * size), size + r)
    });
    magnitude.push(Trace::new("95 % confidence", 0, Curve::Band(band.collect())));
    let points = usable.iter().map(|line| (line.hertz(), line.h1.norm()));
    magnitude.push(Trace::new("measured (H1)", 0, Curve::Points(points.collect())));
    let band = usable.iter().zip(&measured).zip(&radius).map(|((line, angle), r)| {
        let half = if *r < line.h1.norm() { (r / line.h1.norm()).asin() } else { PI };
        (line.hertz(), degrees(angle - half), degrees(angle + half))
    });
    phase.push(Trace::new("", 0, Curve::Band(band.collect())));
    let points = usable.iter().zip(&measured).map(|(line, angle)| (hertz(line), degrees(*angle)));
    phase.push(Trace::new("", 0, Curve::Points(points.collect())));
    // 3. The models, on the branch of the measured phases.
    let (sizes, angles) = curves(models, settings, branch);
    magnitude.extend(sizes);
    phase.extend(angles);
    // 4. The panels of magnitude, phase and coherence.
    let coherence = response.band(low, high).map(|line| (line.hertz(), line.coherence)).collect();
    let mut figure = panels(magnitude, phase, settings);
    figure.panels.push(Panel {
        x: abscissa(settings),
        y: Axis::linear("Coherence").from_to(0.0, 1.05),
        traces: vec![Trace::new("", 0, Curve::Line(coherence))],
    });
    Figure::new(&settings.title, figure.panels)
}

/// Magnitude and phase of models alone.
#[must_use]
pub fn bode_of_models(models: &[NamedModel<'_>], settings: &BodeSettings) -> Figure {
    let (magnitude, phase) = curves(models, settings, None);
    panels(magnitude, phase, settings)
}

/// The lowest frequency that is drawn, Hz: a logarithmic axis has no place for zero.
fn first(settings: &BodeSettings) -> f64 {
    if settings.low > 0.0 { settings.low } else { settings.high * 1e-3 }
}

fn abscissa(settings: &BodeSettings) -> Axis {
    Axis::logarithmic("Frequency [Hz]").from_to(first(settings), settings.high)
}

/// Magnitudes and phases of the models, at frequencies that are evenly spaced on the logarithmic axis; phases begin within half a turn of
/// `branch`, or of the first model's.
fn curves(models: &[NamedModel<'_>], settings: &BodeSettings, branch: Option<f64>) -> (Vec<Trace>, Vec<Trace>) {
    let (mut magnitude, mut phase) = (Vec::new(), Vec::new());
    let (mut branch, first, high) = (branch, first(settings), settings.high);
    let frequencies: Vec<f64> =
        (0..=CURVE_POINTS).map(|i| first * (high / first).powf(i as f64 / CURVE_POINTS as f64)).collect();
    for (at, (name, model)) in models.iter().enumerate() {
        let values: Vec<Complex<f64>> = frequencies.iter().map(|f| model(2.0 * PI * f)).collect();
        let mut angles = unwrapped(values.iter().copied());
        if let Some(&own) = angles.first() {
            let turns = turns(*branch.get_or_insert(own) - own);
            angles.iter_mut().for_each(|angle| *angle += turns);
        }
        let sizes = frequencies.iter().zip(&values).map(|(f, h)| (*f, h.norm())).collect();
        let angles = frequencies.iter().zip(&angles).map(|(f, angle)| (*f, degrees(*angle))).collect();
        // The first model as a line, the others dashed above it, so that models that agree can all be seen.
        let curve = |points| if at == 0 { Curve::Line(points) } else { Curve::Dashed(points) };
        let colour = [1, 6, 2, 3][at % 4];
        magnitude.push(Trace::new(name, colour, curve(sizes)));
        phase.push(Trace::new("", colour, curve(angles)));
    }
    (magnitude, phase)
}

/// The panels of magnitude and phase.
fn panels(magnitude: Vec<Trace>, phase: Vec<Trace>, settings: &BodeSettings) -> Figure {
    let size = match settings.unit.as_str() {
        "" => String::from("Magnitude"),
        unit => format!("Magnitude [{unit}]"),
    };
    // The range of the phase axis is that of points and curves: a band of half a turn would squeeze them.
    let angles: Vec<f64> = phase.iter().filter(|s| !matches!(s.curve, Curve::Band(_))).flat_map(angles_of).collect();
    let mut ordinate = Axis::degrees("Phase [deg]");
    if let (Some(low), Some(high)) = (angles.iter().copied().reduce(f64::min), angles.iter().copied().reduce(f64::max))
    {
        ordinate = ordinate.from_to((low / 45.0).floor() * 45.0 - 15.0, (high / 45.0).ceil() * 45.0 + 15.0);
    }
    let panels = vec![
        Panel { x: abscissa(settings), y: Axis::logarithmic(&size), traces: magnitude },
        Panel { x: abscissa(settings), y: ordinate, traces: phase },
    ];
    Figure::new(&settings.title, panels)
}

fn angles_of(trace: &Trace) -> Vec<f64> {
    match &trace.curve {
        Curve::Line(points) | Curve::Dashed(points) | Curve::Points(points) => points.iter().map(|p| p.1).collect(),
        Curve::Band(_) => Vec::new(),
    }
}

/// The multiple of a whole turn that is nearest to an angle, rad.
fn turns(angle: f64) -> f64 {
    (angle / (2.0 * PI)).round() * 2.0 * PI
}

fn degrees(angle: f64) -> f64 {
    angle * 180.0 / PI
}

/// Arguments without jumps of a turn, rad.
fn unwrapped(values: impl Iterator<Item = Complex<f64>>) -> Vec<f64> {
    let mut last: Option<f64> = None;
    values
        .map(|value| {
            let own = value.arg();
            let angle = last.map_or(own, |last| own + turns(last - own));
            last = Some(angle);
            angle
        })
        .collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn models_alone_lie_on_one_branch() {
        // The same response, once with the opposite sign twice: half a turn less and half a turn more.
        let lag = |w: f64| Complex::new(1.0, 0.0) / Complex::new(1.0, w);
        let turned = |w: f64| lag(w) * Complex::from_polar(1.0, 3.0);
        let settings = BodeSettings { title: "lags".into(), unit: "m/N".into(), low: 0.01, high: 10.0 };
        let figure = bode_of_models(&[("lag", &lag), ("turned", &turned)], &settings);
        assert_eq!(figure.panels.len(), 2);
        assert_eq!(figure.panels[0].y.label, "Magnitude [m/N]");
        let starts: Vec<f64> = figure.panels[1].traces.iter().map(|trace| super::angles_of(trace)[0]).collect();
        assert!((starts[1] - starts[0]).abs() <= 180.0, "{starts:?}");
    }

    use super::{BodeSettings, bode_of_models, unwrapped};
    use num_complex::Complex;

    #[test]
    fn phases_do_not_jump() {
        let angles = unwrapped((0..100).map(|i| Complex::from_polar(2.0, 3.0 - 0.3 * f64::from(i))));
        for (i, angle) in angles.iter().enumerate() {
            assert!((angle - 3.0 + 0.3 * i as f64).abs() < 1e-12);
        }
    }
}
