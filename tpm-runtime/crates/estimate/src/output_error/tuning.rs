//! The noise that makes a record most likely.
//!
//! The search begins on a stretch of the record, where many sizes of the noise cost little, and ends on the whole of it: noise of the
//! inputs moves a machine slowly, so that a stretch may not tell it from the noise of the sensors.

use crate::output_error::chain::Chain;
use crate::output_error::noise::Noise;
use crate::output_error::signals::Signals;
use crate::output_error::smoother::Smoothed;
use rayon::prelude::*;
use tpm_numerics::{alarm, patience, root_mean_square};

/// Samples on which the search for the noise begins.
const FIRST_SAMPLES: usize = 4000;
/// Decades below the size of an input in which its noise is looked for.
const INPUT_NOISE_DECADES: u32 = 6;
/// Decades on either side of what a stretch says in which the record is asked.
const DECADES_BESIDE: f64 = 1.0;
/// Correlations of successive readings from which the search for a colour begins.
const COLOURS_TRIED: [f64; 4] = [0.5, 0.8, 0.9, 0.96];
/// A search of a place where a function is least: the width of its steps is halved from the first to the last.
struct Descent {
    first_width: f64,
    last_width: f64,
    most_steps: usize,
}

/// The search for the noise of the inputs, in decades.
const INPUT_DESCENT: Descent = Descent { first_width: 0.5, last_width: 0.1, most_steps: 20 };
/// The search for what is new in every sample of coloured noise, in natural logarithms.
const COLOUR_DESCENT: Descent = Descent { first_width: 0.25, last_width: 0.05, most_steps: 20 };

/// A place with the cost that it has.
type Place = (f64, f64);

/// Part of a record, by which kinds of noise are judged.
struct Evidence<'a> {
    chain: Chain,
    readings: &'a [f64],
    /// White noise of the sensors alone.
    white: Noise,
    /// Size of every input.
    sizes: &'a [f64],
    /// Number of coordinates: sensors beyond them read rates.
    coordinates: usize,
}

impl Evidence<'_> {
    /// Twice the negative logarithm of the likelihood, but for a constant.
    fn cost(&self, noise: &Noise) -> f64 {
        let here = Noise { readings: self.readings.to_vec(), ..noise.clone() };
        Smoothed::new(&self.chain, &here, self.chain.columns, false).least_cost()
    }

    /// White noise of the sensors with noise of the inputs, by the logarithm of its share of them. Noise that is as large as the inputs lets a
    /// motion be anything; more of it says nothing else, and only makes the smoothing ill-conditioned.
    fn noisy(&self, log: f64) -> Noise {
        let share = 10.0_f64.powf(log.min(0.0));
        Noise { inputs: self.sizes.iter().map(|size| share * size).collect(), ..self.white.clone() }
    }

    /// Noise with a colour of the sensors, by the logarithm of what is new in every sample. A rate is a reading where its noise is white.
    fn coloured(&self, base: &Noise, log: f64) -> Noise {
        let of_sensor = |sensor: usize| if sensor < self.coordinates { 1.0 - log.exp() } else { 0.0 };
        Noise { colour: (0..base.colour.len()).map(of_sensor).collect(), ..base.clone() }
    }

    /// The place with the least cost.
    fn least(places: &[f64], of: impl Fn(f64) -> f64 + Sync) -> Place {
        let costs: Vec<Place> = places.par_iter().map(|&place| (place, of(place))).collect();
        let none = (0.0, f64::INFINITY);
        costs.into_iter().fold(none, |best, now| if now.1 < best.1 { now } else { best })
    }
}

/// The noise of the inputs, and the colour of the sensors' noise, that make a stretch of the record most likely, or the whole of it.
pub(super) fn tune(chain: &Chain, before: &Noise, signals: &Signals<'_>, whole: bool) -> Noise {
    let outputs = chain.outputs.len();
    let sizes: Vec<f64> = signals.inputs.iter().map(|input| root_mean_square(input.iter().copied())).collect();
    let white = Noise { inputs: vec![0.0; sizes.len()], colour: vec![0.0; outputs], readings: Vec::new(), ..*before };
    let evidence = |from: usize, length: usize| Evidence {
        chain: chain.stretch(from, length).undisturbed(),
        readings: &before.readings[from * outputs..(from + length) * outputs],
        white: white.clone(),
        sizes: &sizes,
        coordinates: signals.coordinates.len(),
    };
    let length = chain.samples.min(FIRST_SAMPLES);
    let stretch = evidence((chain.samples - length) / 2, length);
    let inputs: Vec<f64> = (1..=INPUT_NOISE_DECADES).map(|decade| -f64::from(decade)).collect();
    let colours = COLOURS_TRIED.map(|colour: f64| (1.0 - colour).ln());
    let rough = search(&stretch, &inputs, &colours);
    let found = if whole && length < chain.samples {
        let about = rough.input.0;
        let near = [about - DECADES_BESIDE, about, about + DECADES_BESIDE];
        search(
            &evidence(0, chain.samples),
            if rough.noise.inputs == white.inputs { &inputs } else { &near },
            &[rough.colour.0],
        )
    } else {
        rough
    };
    Noise { readings: before.readings.clone(), ..found.noise }
}

/// What a search has found.
struct Found {
    /// The most likely noise of the kinds that are believed.
    noise: Noise,
    /// The most likely noise of the inputs alone.
    input: Place,
    /// The most likely colour.
    colour: Place,
}

/// The most likely noise, from some sizes of the inputs' noise and some colours on.
fn search(evidence: &Evidence<'_>, inputs: &[f64], colours: &[f64]) -> Found {
    let (mut best, mut least) = (evidence.white.clone(), evidence.cost(&evidence.white));
    let of_input = |log: f64| evidence.cost(&evidence.noisy(log));
    let mut input = Evidence::least(inputs, of_input);
    if input.1 <= least - alarm::LIKELIHOOD_GAIN {
        input = descend(input, &INPUT_DESCENT, of_input);
        (best, least) = (evidence.noisy(input.0), input.1);
    }
    let mut bases = vec![evidence.white.clone()];
    if best != evidence.white {
        bases.push(best.clone());
    }
    let of_base = |base| (base, Evidence::least(colours, |log| evidence.cost(&evidence.coloured(base, log))));
    let tried: Vec<(&Noise, Place)> = bases.par_iter().map(of_base).collect();
    let mut colour = (0.0, f64::INFINITY);
    let mut base = &bases[0];
    for (own, found) in tried {
        if found.1 < colour.1 {
            (base, colour) = (own, found);
        }
    }
    if colour.1 < least - alarm::LIKELIHOOD_GAIN {
        colour = descend(colour, &COLOUR_DESCENT, |log| evidence.cost(&evidence.coloured(base, log)));
        best = evidence.coloured(base, colour.0);
    }
    Found { noise: best, input, colour }
}

/// The place, with its cost before the last step, where a function is least near a start: steps are halved from the first width to the
/// last, and the last one goes to the vertex of the parabola through three places.
fn descend(start: Place, descent: &Descent, of: impl Fn(f64) -> f64 + Sync) -> Place {
    let (mut best, mut width) = (start, descent.first_width);
    for _ in 0..descent.most_steps {
        if patience::is_over() {
            break;
        }
        let (below, above) = rayon::join(|| of(best.0 - width), || of(best.0 + width));
        if below.min(above) < best.1 {
            best = if below < above { (best.0 - width, below) } else { (best.0 + width, above) };
        } else if width <= descent.last_width {
            let curvature = below + above - 2.0 * best.1;
            let vertex = if curvature > 0.0 { 0.5 * width * (below - above) / curvature } else { 0.0 };
            return (best.0 + vertex, best.1);
        }
        if width > descent.last_width {
            width *= 0.5;
        }
    }
    best
}
