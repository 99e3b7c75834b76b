//! Simulated records against integration and filters that are written out by hand.

use crate::output_error::problem::Differentiable;
use crate::output_error::signals::{Course, Signals};
use crate::output_error::simulated::Simulated;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::sync::OnceLock;
use tpm_controller::harmonics::Hold;
use tpm_numerics::differences::white_noise;
use tpm_numerics::root_mean_square;
use tpm_test_support::models::differentiable;

const SPRING: &str = "model Spring {
    coordinate x;
    input u;
    parameter m, d, k;

    m*ddot(x) + d*dot(x) + k*x = u;
}";
const TRUTH: [f64; 3] = [2.0, 1.5, 40.0];
const H: f64 = 0.01;
const SAMPLES: usize = 1500;
const SIGMA: f64 = 1e-4;

/// Position and rate after a sample under a held force, by ten steps of the fourth order.
fn rung(state: [f64; 2], accelerate: &dyn Fn([f64; 2]) -> f64) -> [f64; 2] {
    let h = H / 10.0;
    let rate = |s: [f64; 2]| [s[1], accelerate(s)];
    let moved = |s: [f64; 2], r: [f64; 2], by: f64| [s[0] + by * r[0], s[1] + by * r[1]];
    (0..10).fold(state, |s, _| {
        let a = rate(s);
        let b = rate(moved(s, a, h / 2.0));
        let c = rate(moved(s, b, h / 2.0));
        let d = rate(moved(s, c, h));
        [0, 1].map(|i| s[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]))
    })
}

fn spring([m, d, k]: [f64; 3], state: [f64; 2], force: f64) -> [f64; 2] {
    rung(state, &|[x, v]| (force - d * v - k * x) / m)
}

/// A force that does not repeat.
fn force(k: usize) -> f64 {
    let t = k as f64 * H;
    8.0 * (2.0 * t + 0.15 * t * t).sin() + 3.0 * (7.3 * t).cos()
}

fn noise(seed: u64, count: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| Distribution::<f64>::sample(&StandardNormal, &mut rng)).collect()
}

fn signals<'a>(position: &'a [f64], force: &'a [f64], joins: &[usize], highest: f64) -> Signals<'a> {
    Signals {
        sample_time: H,
        hold: Hold::Zoh,
        coordinates: vec![position],
        rates: Vec::new(),
        inputs: vec![force],
        course: Course::Any { typical_period: 120.0, reach: 6, highest: vec![highest], copies: 1.0 },
        joins: joins.to_vec(),
        white: vec![white_noise(position)],
        steps: vec![0.0],
        denoised_inputs: OnceLock::new(),
    }
}

/// Positions without noise, their readings, and forces.
fn recorded(parameters: [f64; 3], start: [f64; 2], samples: usize) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let forces: Vec<f64> = (0..samples).map(force).collect();
    let mut state = start;
    let positions: Vec<f64> = (forces.iter())
        .map(|&force| {
            let now = state[0];
            state = spring(parameters, state, force);
            now
        })
        .collect();
    let readings = positions.iter().zip(noise(3, samples)).map(|(x, e)| x + SIGMA * e).collect();
    (positions, readings, forces)
}

/// Predictions one sample ahead by a filter for a force that is exact, with nothing known of the start.
fn filtered(readings: &[f64], forces: &[f64], parameters: [f64; 3]) -> Vec<f64> {
    let from = spring(parameters, [0.0, 0.0], 0.0);
    let columns = [[1.0, 0.0], [0.0, 1.0]].map(|unit| {
        let to = spring(parameters, unit, 0.0);
        [to[0] - from[0], to[1] - from[1]]
    });
    let (mut x, mut p) = ([0.0, 0.0], [[1.0, 0.0], [0.0, 100.0]]);
    let predict = |(&y, &force): (&f64, &f64)| {
        let predicted = x[0];
        let innovation = p[0][0] + SIGMA * SIGMA;
        let gain = [p[0][0] / innovation, p[1][0] / innovation];
        for (x, gain) in x.iter_mut().zip(gain) {
            *x += gain * (y - predicted);
        }
        let row = p[0];
        for (p, gain) in p.iter_mut().zip(gain) {
            *p = [p[0] - gain * row[0], p[1] - gain * row[1]];
        }
        x = spring(parameters, x, force);
        let a = |i: usize, j: usize| columns[j][i];
        let half: [[f64; 2]; 2] = [0, 1].map(|i| [0, 1].map(|j| a(i, 0) * p[0][j] + a(i, 1) * p[1][j]));
        p = [0, 1].map(|i| [0, 1].map(|j| half[i][0] * a(j, 0) + half[i][1] * a(j, 1)));
        predicted
    };
    readings.iter().zip(forces).map(predict).collect()
}

fn simulated(readings: &[f64], forces: &[f64], joins: &[usize], parameters: [f64; 3]) -> Simulated {
    let (model, derivatives) = differentiable(SPRING);
    let machine = Differentiable { model: &model, derivatives: &derivatives };
    let signals = signals(readings, forces, joins, 2.0);
    Simulated::of(machine, &[], &signals, &parameters).expect("a spring can be simulated")
}

#[test]
fn right_parameters_predict_up_to_the_noise() {
    let (positions, readings, forces) = recorded(TRUTH, [0.1, -0.4], SAMPLES);
    let found = simulated(&readings, &forces, &[], TRUTH);
    assert_eq!((found.divergence, found.input_noise.as_slice()), (None, &[0.0][..]));
    assert!((found.sensor_noise[0] / SIGMA - 1.0).abs() < 0.1, "{:?}", found.sensor_noise);
    let apart = |run: &[f64], exact: &[f64]| run.iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    // The start is estimated from all samples, so that the run misses the truth by little of the noise.
    let free = apart(&found.free_run[0], &positions);
    assert!(free < 0.4 * SIGMA, "{free:e}");
    let by_hand = filtered(&readings, &forces, TRUTH);
    assert_eq!(found.counts.iter().position(|counts| *counts), Some(4));
    let ahead = apart(&found.one_step[0][4..], &by_hand[4..]);
    assert!(ahead < 1e-3 * SIGMA, "{ahead:e}");
    let size = root_mean_square(found.normalised[0][4..].iter().copied());
    assert!((size - 1.0).abs() < 0.1, "{size}");
}

#[test]
fn wrong_parameters_run_as_by_hand_in_every_stretch() {
    let (_, mut readings, mut forces) = recorded(TRUTH, [0.1, -0.4], SAMPLES);
    // Something is left out between the stretches.
    readings.drain(700..780);
    forces.drain(700..780);
    let wrong = [2.0, 1.5, 41.0];
    let found = simulated(&readings, &forces, &[700], wrong);
    for (from, to) in [(0, 700), (700, readings.len())] {
        let start = found.free_run[0][from];
        assert!((start - readings[from]).abs() < 0.02, "{start}");
        // The rate at the start is that with which the hand's run meets the second sample.
        let rate = |v: f64| spring(wrong, [start, v], forces[from])[0] - found.free_run[0][from + 1];
        let v = -rate(0.0) / (rate(1.0) - rate(0.0));
        let mut state = [start, v];
        for (run, force) in found.free_run[0][from..to].iter().zip(&forces[from..to]) {
            let off = (run - state[0]).abs();
            assert!(off < 1e-8, "{off:e}");
            state = spring(wrong, state, *force);
        }
    }
    assert_eq!(found.counts.iter().filter(|counts| !**counts).count(), 8);
    // What the spring lacks is no noise of the sensor: the one-step prediction follows, the free run does not.
    let missed = |run: &[f64]| root_mean_square(readings.iter().zip(run).map(|(y, x)| y - x));
    assert!(missed(&found.one_step[0]) < 0.1 * missed(&found.free_run[0]));
}

/// A pendulum held up by a loop: the record is unstable from its input alone.
#[test]
fn a_machine_that_is_unstable_without_its_loop_leaves_its_record() {
    let (model, derivatives) =
        differentiable("model Up { coordinate q; input u; parameter J, g; J*ddot(q) - g*sin(q) = u; }");
    let (j, g) = (0.01, 0.5);
    let e = noise(5, SAMPLES);
    let (mut state, mut before) = ([0.1, 0.0], 0.1);
    let (mut readings, mut torques) = (Vec::new(), Vec::new());
    for (k, e) in e.iter().enumerate() {
        let reading = state[0] + SIGMA * e;
        let wanted = 0.3 * (1.7 * k as f64 * H).sin();
        let torque = -1.5 * (reading - wanted) - 0.15 * (reading - before) / H;
        readings.push(reading);
        torques.push(torque);
        before = reading;
        state = rung(state, &|[q, _]| (torque + g * q.sin()) / j);
    }
    let signals = signals(&readings, &torques, &[], 3.0);
    let machine = Differentiable { model: &model, derivatives: &derivatives };
    let found = Simulated::of(machine, &[], &signals, &[j, g]).expect("a pendulum can be simulated");
    let divergence = found.divergence.expect("it falls");
    // The state at the start is smoothed by all that follows, which shows the part that grows the better the longer the record is: what
    // is left of its error lies between the noise and rounding, and grows to the motion with the rate sqrt(g/J) = 7.1 /s, 1e2 to 1e17
    // times, in .6 to 5.6 s.
    assert!(divergence.unstable && (0.6..5.7).contains(&divergence.time), "{divergence:?}");
    let size = root_mean_square(found.normalised[0].iter().copied());
    assert!((size - 1.0).abs() < 0.1, "{size}");
    // Parameters of a pendulum that hangs are those of a stable machine, whose motion is another one.
    let hanging = Simulated::of(machine, &[], &signals, &[j, -g]);
    assert!(hanging.is_ok_and(|found| found.divergence.is_none_or(|divergence| !divergence.unstable)));
}
