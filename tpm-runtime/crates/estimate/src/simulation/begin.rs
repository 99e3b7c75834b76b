//! The motion from which a simulation begins: that of the readings alone, each coordinate with an unknown smooth rate of its highest
//! derivative, whose size the likelihood tells. Readings may have any stamps.

use crate::simulation::chain::{Chain, Read};
use crate::simulation::filter::{smooth, whiten};
use crate::simulation::noise::{Curvature, Noise, most_likely};
use crate::simulation::problem::Problem;
use tpm_numerics::root_mean_square;

/// Sweeps of the search for the size of a motion's unknown rate.
const SWEEPS: usize = 8;
/// Deviation of a state of which nothing is known, in units of its size.
const UNKNOWN: f64 = 10.0;
/// The smoothed rate is known better than the predicted one by this factor, where a motion is sampled densely.
const SMOOTHED: f64 = 0.4;

/// A motion, as the readings alone show it.
pub(super) struct Begun {
    /// The states, instant by instant.
    pub(super) states: Vec<f64>,
    /// Deviation of the rate of every coordinate.
    pub(super) rate_deviation: Vec<f64>,
    /// The highest derivative of every coordinate, instant by instant.
    pub(super) highest: Vec<Vec<f64>>,
}

/// The motion of all coordinates; one that no sensor reads rests.
pub(super) fn begin(problem: &Problem<'_>) -> Begun {
    let model = problem.machine.model;
    let coordinates = model.dims().coordinates;
    let (n, instants) = (problem.states.len(), problem.instants.len());
    let mut begun = Begun {
        states: vec![0.0; n * instants],
        rate_deviation: vec![0.0; coordinates],
        highest: vec![vec![0.0; instants]; coordinates],
    };
    for c in 0..coordinates {
        let order = model.coordinate_order(c);
        let Some((states, deviation)) = coordinate(problem, c, order) else { continue };
        for (s, _) in problem.states.iter().enumerate().filter(|(_, state)| state.0 == c) {
            let derivative = problem.states[s].1;
            let own = states.iter().skip(derivative).step_by(order + 1);
            begun.states.iter_mut().skip(s).step_by(n).zip(own).for_each(|(to, from)| *to = *from);
        }
        begun.rate_deviation[c] = deviation;
        begun.highest[c] = states.iter().skip(order).step_by(order + 1).copied().collect();
    }
    begun
}

/// Derivatives 0 to `order` of a coordinate at every instant, and the deviation of its rate; nothing without readings.
fn coordinate(problem: &Problem<'_>, c: usize, order: usize) -> Option<(Vec<f64>, f64)> {
    let instants = &problem.instants;
    let sensors = &problem.record.sensors;
    let states = order + 1;
    let mut chain = Chain {
        order: states,
        rows: 1,
        time: instants.time.clone(),
        begins: instants.begins.clone(),
        transition: vec![0.0; instants.len() * states * states],
        forcing: vec![0.0; instants.len() * states],
        defect: vec![0.0; instants.len() * states],
        ..Chain::default()
    };
    for readings in &instants.readings {
        chain.first_read.push(chain.reads.len());
        let own = readings.iter().filter(|at| sensors[at.sensor].coordinate == c);
        chain.reads.extend(own.map(|at| {
            let state = sensors[at.sensor].derivative;
            Read { sensor: at.sensor, state, error: at.value, variance: at.variance }
        }));
    }
    chain.first_read.push(chain.reads.len());
    let first = chain.reads.iter().map(|read| read.state).min()?;
    for k in (0..instants.len()).filter(|&k| instants.goes_on(k)) {
        let after = instants.after(k);
        for i in 0..states {
            let mut power = 1.0;
            for j in i..states {
                chain.transition[(k * states + i) * states + j] = power;
                power *= after / (j - i + 1) as f64;
            }
            chain.forcing[k * states + i] = power;
        }
    }
    // Sizes of the states by that of the readings and the pace of the motion.
    let pace = 2.0 * std::f64::consts::PI / problem.typical_period.max(f64::MIN_POSITIVE);
    let own = || chain.reads.iter().filter(|read| read.state == first).map(|read| read.error);
    let mean = own().sum::<f64>() / own().count().max(1) as f64;
    let spread = root_mean_square(own().map(|x| x - mean)).max(f64::MIN_POSITIVE);
    let size = |derivative: usize| spread * pace.powi(derivative as i32 - first as i32);
    chain.unknown =
        (0..states).map(|s| (UNKNOWN * (size(s) + if s == first { mean.abs() } else { 0.0 })).powi(2)).collect();
    let density = size(states).powi(2) * instants.usual_step;
    let count = sensors.len();
    let begun =
        Noise { white: vec![1.0; count], least: vec![1.0; count], colour: None, force: vec![density], drift: None };
    let cost = |noise: &Noise| {
        let found = whiten(&chain, noise, &[]);
        let [a, b] = found.halves;
        found.logs + a.with(&b).square()[(0, 0)].powi(2)
    };
    let (noise, _) = most_likely(begun, true, SWEEPS, &mut Curvature::default(), &cost);
    let smoothed = smooth(&chain, &noise, &[]);
    let rate = smoothed.least_deviation.get(1).copied().unwrap_or(0.0);
    Some((smoothed.states, SMOOTHED * rate))
}
