//! The figure of a pattern compared with the usual laws of a stroke: the inputs over one period, and their harmonics.

use crate::trajectories::{InputUse, SAMPLES, Trajectories};
use std::f64::consts::PI;
use tpm_plot::{Axis, Curve, Figure, Panel, Spacing, Trace};

/// Smallest amplitude on the axis of the harmonics, as a share of the largest amplitude.
const SHOWN: f64 = 1e-4;
/// Number of harmonics that are drawn.
const HARMONICS: usize = 20;

impl Trajectories {
    /// The inputs over one period, and their harmonics, for every input.
    #[must_use]
    pub fn figure(&self, title: &str) -> Figure {
        let played: Vec<(&str, &Vec<InputUse>)> =
            self.motions.iter().filter_map(|moved| Some((moved.name.as_str(), moved.inputs.as_ref()?))).collect();
        let count = played.first().map_or(0, |(_, inputs)| inputs.len());
        let mut panels = Vec::new();
        for i in 0..count {
            let inputs: Vec<(&str, &InputUse)> = played.iter().map(|(name, all)| (*name, &all[i])).collect();
            let first = inputs[0].1;
            let unit = first.unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}]"));
            panels.push(over_time(&inputs, self.frequency, &format!("{}{unit}", first.input)));
            panels.push(over_harmonics(&inputs, &format!("harmonics of {}{unit}", first.input)));
        }
        Figure::new(title, panels)
    }
}

fn over_time(inputs: &[(&str, &InputUse)], frequency: f64, label: &str) -> Panel {
    /// Number of samples from one point of a curve to the next.
    const STRIDE: usize = 12;
    let traces = inputs.iter().enumerate().map(|(colour, (name, input))| {
        let time = |n: usize| (n as f64 + 0.5) / SAMPLES as f64 * 2.0 * PI / frequency;
        let points = input.samples.iter().enumerate().step_by(STRIDE).map(|(n, value)| (time(n), *value)).collect();
        Trace::new(name, colour, if colour == 0 { Curve::Line(points) } else { Curve::Dashed(points) })
    });
    Panel {
        x: Axis::linear("time [s]").from_to(0.0, 2.0 * PI / frequency),
        y: Axis::linear(label),
        traces: traces.collect(),
    }
}

fn over_harmonics(inputs: &[(&str, &InputUse)], label: &str) -> Panel {
    /// Distance between the stems of the motions at one harmonic, in harmonics.
    const APART: f64 = 0.17;
    let lines = inputs.iter().flat_map(|(_, input)| input.harmonics.iter().take(HARMONICS + 1).skip(1).copied());
    let largest = lines.fold(f64::MIN_POSITIVE, f64::max);
    let floor = SHOWN * largest;
    let mut traces = Vec::new();
    for (colour, (name, input)) in inputs.iter().enumerate() {
        let offset = APART * (colour as f64 - (inputs.len() as f64 - 1.0) / 2.0);
        let mut stems = Vec::new();
        for (k, line) in
            input.harmonics.iter().enumerate().take(HARMONICS + 1).skip(1).filter(|(_, line)| **line > floor)
        {
            let x = k as f64 + offset;
            // A point that is not a number ends the line of the stem.
            stems.extend([(x, floor), (x, *line), (x, f64::NAN)]);
        }
        traces.push(Trace::new(name, colour, Curve::Line(stems.clone())));
        let heads = stems.into_iter().skip(1).step_by(3).collect();
        traces.push(Trace::new("", colour, Curve::Points(heads)));
    }
    Panel {
        x: Axis::linear("harmonic of the strokes forth and back").from_to(0.5, HARMONICS as f64 + 0.4),
        y: Axis { spacing: Spacing::Logarithmic, ..Axis::linear(label).from_to(floor, 2.0 * largest) },
        traces,
    }
}
