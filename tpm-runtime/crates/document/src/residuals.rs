//! Errors against the motion: what a model lacks at a place or at a speed shows there, and nowhere over time.
//!
//! Samples are sorted by a coordinate or by its rate and cut into bins of as many samples. The mean error of a bin is drawn beside the band
//! within which chance alone keeps nineteen of twenty of them: errors one step ahead of a right model are independent of the motion.
//!
//! Invariant: the samples are those of the tests of the errors. Around a stop of a machine with dry friction the force is anything between its
//! two values, and errors there say nothing of the model.

use crate::forces::low;
use tpm_numerics::root_mean_square;
use tpm_numerics::tail::NORMAL_95;
use tpm_plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_session::{ChannelSimulation, Validation};

/// Bins of a panel.
const BINS: usize = 40;
/// Least number of samples in a bin, of which a mean is nearly normal.
const LEAST_PER_BIN: usize = 25;
/// Most panels in which every error is drawn against every motion: an arm of seven joints would have 98.
const MOST_PANELS: usize = 12;

/// What the figure shows.
pub(super) const CAPTION: &str = "Errors one step ahead of the tested samples against each coordinate and its rate, means of bins with equally many \
    samples. The band holds 95 % of what chance makes of a right model's; a force that the model lacks leaves a shape";

/// One motion that errors are drawn against: its name, and its value at every sample.
struct Motion {
    label: String,
    values: Vec<f64>,
}

/// Mean errors one step ahead of every coordinate against every coordinate and its rate; of many coordinates against its own. Nothing where
/// no motion was simulated, or too few samples are there.
pub(super) fn against_motion(found: &Validation) -> Option<Figure> {
    let simulation = found.simulation.as_ref()?;
    let channels = &simulation.channels;
    let all = 2 * channels.len() * channels.len() <= MOST_PANELS;
    let mut panels = Vec::new();
    for (i, channel) in channels.iter().enumerate() {
        let error = |(&regular, (y, at)): (&bool, (&f64, &f64))| if regular { y - at } else { f64::NAN };
        let pairs = channel.measured.iter().zip(&channel.predicted);
        let errors: Vec<f64> = simulation.regular.iter().zip(pairs).map(error).collect();
        for (j, other) in channels.iter().enumerate() {
            if all || i == j {
                panels.extend(
                    motions(other, simulation.sample_time, &simulation.joins)
                        .iter()
                        .filter_map(|motion| panel(channel, &errors, motion)),
                );
            }
        }
    }
    (!panels.is_empty()).then(|| low(format!("{}: errors against the motion", found.model), panels))
}

/// A coordinate and its rate, from the values predicted one step ahead, whose noise is less than that of the readings. Where a stretch joins
/// another there is no rate; `joins` are the first samples of all but the first.
fn motions(channel: &ChannelSimulation, sample_time: f64, joins: &[usize]) -> [Motion; 2] {
    let unit = |per: &str| channel.unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}{per}]"));
    let at = &channel.predicted;
    let rate = |k: usize| {
        if joins.binary_search(&k).or_else(|_| joins.binary_search(&(k + 1))).is_ok() {
            return f64::NAN;
        }
        let (before, after) =
            (k.checked_sub(1).map_or(f64::NAN, |k| at[k]), at.get(k + 1).copied().unwrap_or(f64::NAN));
        (after - before) / (2.0 * sample_time)
    };
    [
        Motion { label: format!("{}{}", channel.name, unit("")), values: at.clone() },
        Motion { label: format!("rate of {}{}", channel.name, unit("/s")), values: (0..at.len()).map(rate).collect() },
    ]
}

fn panel(channel: &ChannelSimulation, errors: &[f64], motion: &Motion) -> Option<Panel> {
    let mut pairs: Vec<(f64, f64)> = motion.values.iter().copied().zip(errors.iter().copied()).collect();
    pairs.retain(|(x, error)| x.is_finite() && error.is_finite());
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let bins = BINS.min(pairs.len() / LEAST_PER_BIN);
    let (first, last) = (pairs.first()?.0, pairs.last()?.0);
    if bins < 2 || first >= last {
        return None;
    }
    let size = pairs.len().div_ceil(bins);
    let deviation = root_mean_square(pairs.iter().map(|(_, error)| *error));
    let (mut means, mut band) = (Vec::new(), Vec::new());
    for bin in pairs.chunks(size) {
        let count = bin.len() as f64;
        let half = NORMAL_95 * deviation / count.sqrt();
        means.push((
            bin.iter().map(|(x, _)| x).sum::<f64>() / count,
            bin.iter().map(|(_, error)| error).sum::<f64>() / count,
        ));
        band.push((bin[0].0, -half, half));
        band.push((bin[bin.len() - 1].0, -half, half));
    }
    let unit = channel.unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}]"));
    let traces = vec![
        Trace::new("chance", 2, Curve::Band(band)),
        Trace::new("mean error one step ahead", 0, Curve::Points(means)),
    ];
    let x = Axis::linear(&motion.label).from_to(first, last);
    Some(Panel { x, y: Axis::linear(&format!("error of {}{unit}", channel.name)), traces })
}
