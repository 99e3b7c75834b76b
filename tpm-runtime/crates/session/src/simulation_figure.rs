//! The figure of a simulated log: measured and simulated motion over time, and what the simulation misses.

use crate::simulation::{ChannelSimulation, Simulation};
use tpm_plot::{Axis, Curve, Figure, Panel, Trace};

/// Points of a curve at most: of more samples the least and the largest of a few successive ones are drawn.
const MOST_POINTS: usize = 1600;
/// A free run is drawn as far as it stays within so many times the range of the measured motion around it.
const MOST_RANGES_SHOWN: f64 = 2.0;

impl Simulation {
    /// Panels per coordinate over time: measured motion with the free run, what the free run misses where it does not leave the log, and
    /// what the one-step prediction misses.
    #[must_use]
    pub fn figure(&self, title: &str) -> Figure {
        let mut panels = Vec::new();
        for channel in &self.channels {
            let unit = channel.unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}]"));
            let label = format!("{}{unit}", channel.name);
            panels.push(self.motion(channel, &label));
            if self.diverges.is_none() {
                panels.push(self.missed(channel, &channel.simulated, (1, "measured less free run"), &label));
            }
            let name = "measured less prediction one step ahead";
            panels.push(self.missed(channel, &channel.predicted, (2, name), &label));
        }
        Figure::new(title, panels)
    }

    fn motion(&self, channel: &ChannelSimulation, label: &str) -> Panel {
        let mut traces = vec![Trace::new("measured", 0, Curve::Line(self.points(&channel.measured)))];
        let shown = within(&channel.simulated, &channel.measured);
        let name = if self.diverges.is_some() { "free run, which leaves the log" } else { "free run" };
        traces.push(Trace::new(name, 1, Curve::Dashed(self.points(&shown))));
        Panel { x: self.time(), y: Axis::linear(label), traces }
    }

    fn missed(
        &self,
        channel: &ChannelSimulation,
        simulated: &[f64],
        (colour, name): (usize, &str),
        label: &str,
    ) -> Panel {
        let errors: Vec<f64> = channel.measured.iter().zip(simulated).map(|(y, simulated)| y - simulated).collect();
        let traces = vec![Trace::new(name, colour, Curve::Line(self.points(&errors)))];
        Panel { x: self.time(), y: Axis::linear(label), traces }
    }

    fn time(&self) -> Axis {
        let last = self.channels.first().map_or(0, |channel| channel.measured.len().saturating_sub(1));
        let label = if self.joins.is_empty() { "time [s]" } else { "time in the stretches, one behind the other [s]" };
        Axis::linear(label).from_to(0.0, last.max(1) as f64 * self.sample_time)
    }

    /// A signal over time; lines break between stretches.
    fn points(&self, signal: &[f64]) -> Vec<(f64, f64)> {
        drawn(signal, &self.joins, &|k| k as f64 * self.sample_time)
    }
}

/// A signal over the time of its samples, as few points as a figure needs; lines break at the joins.
pub(super) fn drawn(signal: &[f64], joins: &[usize], time: &dyn Fn(usize) -> f64) -> Vec<(f64, f64)> {
    let count = (2 * signal.len()).div_ceil(MOST_POINTS).max(1);
    let mut points = Vec::with_capacity(MOST_POINTS + 2 * joins.len());
    let mut from = 0;
    for to in joins.iter().copied().chain([signal.len()]) {
        for first in (from..to).step_by(count) {
            let bucket = || (first..to.min(first + count)).filter(|&k| signal[k].is_finite());
            let least = bucket().min_by(|&a, &b| signal[a].total_cmp(&signal[b]));
            let largest = bucket().max_by(|&a, &b| signal[a].total_cmp(&signal[b]));
            match (least, largest) {
                (Some(a), Some(b)) if a == b => points.push((time(a), signal[a])),
                (Some(a), Some(b)) => points.extend([a.min(b), a.max(b)].map(|k| (time(k), signal[k]))),
                _ => points.push((time(first), f64::NAN)),
            }
        }
        if to < signal.len() {
            points.push((time(to), f64::NAN));
        }
        from = to;
    }
    points
}

/// The samples of a run that are near the range of what was measured; not a number elsewhere.
fn within(run: &[f64], measured: &[f64]) -> Vec<f64> {
    let (low, high) =
        measured.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)));
    let beyond = MOST_RANGES_SHOWN * (high - low);
    let near = |x: &f64| if *x >= low - beyond && *x <= high + beyond { *x } else { f64::NAN };
    run.iter().map(near).collect()
}
