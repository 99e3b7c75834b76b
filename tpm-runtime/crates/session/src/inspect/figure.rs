//! The figure of an inspection: every channel over time, and what it holds by frequency.

use crate::inspect::channel::ChannelReport;
use crate::inspect::report::Inspection;
use tpm_plot::{Axis, Curve, Figure, Panel, Trace};

/// Most channels that are drawn.
const MOST_CHANNELS: usize = 8;
/// Height of a panel, pixels.
const PANEL_HEIGHT_PIXELS: u32 = 250;
/// Decades below the strongest frequency that are drawn.
const SPECTRUM_DECADES: i32 = 8;

impl Inspection {
    /// The channels over time, with rests, levels at which they are cut off and the beginning of the part that repeats; then the power of
    /// each by frequency, with its noise. Nothing where no channel can be drawn.
    #[must_use]
    pub fn figure(&self) -> Option<Figure> {
        let shown: Vec<&ChannelReport> =
            self.channels.iter().filter(|channel| !channel.constant).take(MOST_CHANNELS).collect();
        if shown.is_empty() {
            return None;
        }
        let mut panels: Vec<Panel> = shown.iter().map(|channel| self.over_time(channel)).collect();
        panels.extend(by_frequency(&shown));
        let left_out = self.channels.len() - shown.len();
        let more = if left_out > 0 { format!(", {left_out} more channels are not drawn") } else { String::new() };
        let height = 60 + PANEL_HEIGHT_PIXELS * panels.len() as u32;
        let name = self.log.rsplit(['/', '\\']).next().unwrap_or_default();
        Some(Figure { title: format!("{name}{more}"), width: 1100, height, panels })
    }

    fn over_time(&self, channel: &ChannelReport) -> Panel {
        let outline = &channel.outline;
        let last = outline.line.iter().map(|point| point.0).filter(|t| t.is_finite()).fold(0.0, f64::max);
        let mut traces = Vec::new();
        if !outline.rests.is_empty() {
            let mut band = Vec::new();
            for (from, to) in &outline.rests {
                let (low, high) = (channel.least, channel.largest);
                band.extend([(*from, low, high), (*to, low, high), (f64::NAN, low, high)]);
            }
            traces.push(Trace::new("at rest", 4, Curve::Band(band)));
        }
        traces.push(Trace::new("", 0, Curve::Line(outline.line.clone())));
        for (i, plateau) in channel.plateaus.iter().enumerate() {
            let name = if i == 0 { "cut off" } else { "" };
            traces.push(Trace::new(name, 1, Curve::Dashed(vec![(0.0, plateau.level), (last, plateau.level)])));
        }
        if let Some(repeats) = &self.repeats {
            let ends = (0..=repeats.periods.min(1)).map(|period| repeats.from + period as f64 * repeats.period);
            let marks = ends.flat_map(|t| [(t, channel.least), (t, channel.largest), (f64::NAN, 0.0)]).collect();
            traces.push(Trace::new("first period", 2, Curve::Dashed(marks)));
        }
        Panel {
            x: Axis::linear("time [s]").from_to(0.0, last.max(f64::MIN_POSITIVE)),
            y: Axis::linear(&labelled(&channel.name, channel.unit.as_deref())),
            traces,
        }
    }
}

/// The power of channels by frequency, each relative to its deviation; nothing where there is none.
fn by_frequency(shown: &[&ChannelReport]) -> Option<Panel> {
    let mut traces = Vec::new();
    let mut strongest = 0.0_f64;
    for (colour, channel) in shown.iter().enumerate() {
        let relative: Vec<(f64, f64)> =
            channel.outline.spectrum.iter().map(|(f, level)| (*f, level / channel.deviation)).collect();
        let (Some(first), Some(last)) = (relative.first(), relative.last()) else { continue };
        strongest = relative.iter().map(|point| point.1).filter(|level| level.is_finite()).fold(strongest, f64::max);
        if let Some(noise) = channel.noise {
            let level = noise / channel.deviation;
            traces.push(Trace::new("", colour, Curve::Dashed(vec![(first.0, level), (last.0, level)])));
        }
        traces.push(Trace::new(&channel.name, colour, Curve::Line(relative)));
    }
    let floor = strongest * 10.0_f64.powi(-SPECTRUM_DECADES);
    (strongest > 0.0).then(|| Panel {
        x: Axis::logarithmic("frequency [Hz] (dashed: noise)"),
        y: Axis::logarithmic("level over deviation").from_to(floor, 2.0 * strongest),
        traces,
    })
}

/// A name with its unit.
fn labelled(name: &str, unit: Option<&str>) -> String {
    match unit {
        Some(unit) if !name.ends_with([']', ')']) => format!("{name} [{unit}]"),
        _ => name.into(),
    }
}
