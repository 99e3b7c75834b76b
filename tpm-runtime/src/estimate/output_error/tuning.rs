//! The noise that makes a record most likely.

use crate::estimate::output_error::chain::Chain;
use crate::estimate::output_error::signals::Signals;
use crate::estimate::output_error::smoother::{Noise, Smoothed};
use std::vec;
use std::vec::Vec;

/// Samples on which the noise is told from the motion.
const TUNING: usize = 4000;
/// Least gain of twice the logarithm of the likelihood at which a kind of noise is believed.
const BELIEVED: f64 = 10.0;

/// The noise of the inputs, and the colour of the sensors' noise, that make a stretch of the record most likely.
pub(super) fn tune(chain: &Chain, before: &Noise, signals: &Signals<'_>) -> Noise {
    let outputs = chain.outputs.len();
    let length = chain.samples.min(TUNING);
    let from = (chain.samples - length) / 2;
    let stretch = chain.stretch(from, length).undisturbed();
    let cut = |noise: &Noise| Noise {
        readings: noise.readings[from * outputs..(from + length) * outputs].to_vec(),
        colour: noise.colour.clone(),
        inputs: noise.inputs.clone(),
    };
    let cost = |noise: &Noise| -> f64 {
        let smoothed = Smoothed::new(&stretch, &cut(noise), false);
        let readings = smoothed.places.len() as f64;
        let left = smoothed.root.last().map_or(0.0, |z| z * z).max(f64::MIN_POSITIVE);
        let cost = readings * (left / readings).ln() + smoothed.determinant;
        if cost.is_finite() { cost } else { f64::INFINITY }
    };
    let sizes: Vec<f64> = (signals.inputs.iter())
        .map(|input| (input.iter().map(|u| u * u).sum::<f64>() / input.len().max(1) as f64).sqrt())
        .collect();
    let noisy = |noise: &Noise, log: f64| {
        let share = 10.0_f64.powf(log);
        Noise { inputs: sizes.iter().map(|size| share * size).collect(), ..noise.clone() }
    };
    let exact = |noise: &Noise| Noise { inputs: vec![0.0; sizes.len()], ..noise.clone() };
    let inputs = |noise: &Noise| -> (Noise, f64) {
        let none = exact(noise);
        let bare = cost(&none);
        let grid = (1..=6).map(|decade| (-f64::from(decade), cost(&noisy(noise, -f64::from(decade)))));
        let (mut log, mut least) = grid.fold((0.0, f64::INFINITY), |best, now| if now.1 < best.1 { now } else { best });
        if least > bare - BELIEVED {
            return (none, bare);
        }
        let mut width = 0.5;
        while width > 0.04 {
            for tried in [log - width, log + width] {
                let now = cost(&noisy(noise, tried));
                if now < least {
                    (log, least) = (tried, now);
                }
            }
            width *= 0.5;
        }
        (noisy(noise, log), least)
    };
    let (mut best, mut least) = inputs(&exact(before));
    let mut colours: Vec<f64> = vec![0.5, 0.8, 0.9, 0.96];
    let white = best.clone();
    let mut found = false;
    for colour in colours.drain(..) {
        for base in [exact(before), white.clone()] {
            let tried = Noise { colour: vec![colour; outputs], ..base };
            let now = cost(&tried);
            if now < least - if found { 0.0 } else { BELIEVED } {
                (best, least, found) = (tried, now, true);
            }
        }
    }
    if found {
        let mut width = 0.25;
        while width > 0.03 {
            for factor in [1.0 - width, 1.0 + width] {
                // The search is over what is new in every sample.
                let colour = best.colour.iter().map(|colour| 1.0 - (1.0 - colour) * factor).collect();
                let tried = Noise { colour, ..best.clone() };
                let now = cost(&tried);
                if now < least {
                    (best, least) = (tried, now);
                }
            }
            width *= 0.5;
        }
    }
    best
}
