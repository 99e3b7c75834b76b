//! The noise that makes a record most likely.

use crate::estimate::output_error::chain::Chain;
use crate::estimate::output_error::noise::Noise;
use crate::estimate::output_error::signals::Signals;
use crate::estimate::output_error::smoother::Smoothed;
use crate::numerics::root_mean_square;
use std::vec;
use std::vec::Vec;

/// Samples on which the noise is told from the motion.
const TUNING: usize = 4000;
/// Least gain of twice the logarithm of the likelihood at which a kind of noise is believed.
pub(super) const BELIEVED: f64 = 10.0;
/// Decades below the size of an input in which its noise is looked for.
const DECADES: u32 = 6;
/// Correlations of successive readings from which the search for a colour begins.
const COLOURS: [f64; 4] = [0.5, 0.8, 0.9, 0.96];

/// The noise of the inputs, and the colour of the sensors' noise, that make a stretch of the record most likely.
pub(super) fn tune(chain: &Chain, before: &Noise, signals: &Signals<'_>) -> Noise {
    let outputs = chain.outputs.len();
    let length = chain.samples.min(TUNING);
    let from = (chain.samples - length) / 2;
    let stretch = chain.stretch(from, length).undisturbed();
    let readings = &before.readings[from * outputs..(from + length) * outputs];
    let cost = |noise: &Noise| -> f64 {
        let here = Noise { readings: readings.to_vec(), ..noise.clone() };
        let smoothed = Smoothed::new(&stretch, &here, stretch.columns, false);
        smoothed.least_cost()
    };
    let sizes: Vec<f64> = signals.inputs.iter().map(|input| root_mean_square(input.iter().copied())).collect();
    let white = Noise { inputs: vec![0.0; sizes.len()], colour: vec![0.0; outputs], readings: Vec::new(), ..*before };
    // The noise of the inputs, by the logarithm of its share of them.
    let noisy =
        |log: f64| Noise { inputs: sizes.iter().map(|size| 10.0_f64.powf(log) * size).collect(), ..white.clone() };
    let (mut best, mut least) = (white.clone(), cost(&white));
    let grid = (1..=DECADES).map(|decade| -f64::from(decade)).map(|log| (log, cost(&noisy(log))));
    let start = grid.fold((0.0, f64::INFINITY), |best, now| if now.1 < best.1 { now } else { best });
    if start.1 <= least - BELIEVED {
        let (log, found) = descend(start, 0.5, 0.04, |log| cost(&noisy(log)));
        (best, least) = (noisy(log), found);
    }
    let mut bases = vec![white.clone()];
    if best != white {
        bases.push(best.clone());
    }
    // A rate is a reading where its noise is white.
    let of_sensor = |sensor: usize, colour: f64| if sensor < signals.coordinates.len() { colour } else { 0.0 };
    let coloured = |base: &Noise, colour: f64| Noise {
        colour: (0..outputs).map(|sensor| of_sensor(sensor, colour)).collect(),
        ..base.clone()
    };
    let mut start: Option<(&Noise, (f64, f64))> = None;
    for base in &bases {
        for colour in COLOURS {
            let now = cost(&coloured(base, colour));
            if start.is_none_or(|(_, best)| now < best.1) {
                start = Some((base, (colour, now)));
            }
        }
    }
    if let Some((base, (colour, now))) = start
        && now < least - BELIEVED
    {
        // The search is over what is new in every sample.
        let of = |log: f64| coloured(base, 1.0 - log.exp());
        let (log, _) = descend(((1.0 - colour).ln(), now), 0.25, 0.03, |log| cost(&of(log)));
        best = of(log);
    }
    Noise { readings: before.readings.clone(), ..best }
}

/// A place, with its value, where a function has no lower value within `until` on either side, by steps from `width` on that are
/// halved.
fn descend(start: (f64, f64), mut width: f64, until: f64, of: impl Fn(f64) -> f64) -> (f64, f64) {
    let mut best = start;
    while width > until {
        for tried in [best.0 - width, best.0 + width] {
            let now = of(tried);
            if now < best.1 {
                best = (tried, now);
            }
        }
        width *= 0.5;
    }
    best
}
