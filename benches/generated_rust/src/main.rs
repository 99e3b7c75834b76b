//! Generated code and the same by hand: `generated_rust slider|arm|harmonics|step hand|generated CALLS` prints nanoseconds a call of
//! processor time and a checksum.

// `../../src/by_hand.rs`, and files as `tpm generate --lang rust` writes them: `run` puts them beside a copy of this file.
mod by_hand;
#[allow(dead_code)]
mod closed_loop_arm;
#[allow(dead_code)]
mod mass_spring_drag;
#[allow(dead_code)]
mod sixteen;

use std::hint::black_box;

/// Processor time of this program so far, as Linux counts it.
fn processor_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").expect("Linux");
    text.split(' ').next().and_then(|time| time.parse::<f64>().ok()).expect("nanoseconds") * 1e-9
}

/// Samples of a period.
const PERIOD: usize = 1000;

/// What is measured at a sample: position and velocity that lag a little behind the reference.
fn measured(phase: f64) -> [f64; 2] {
    [0.3 * (phase - 0.01).cos(), -0.9 * (phase - 0.01).sin()]
}

fn step_of_hand(samples: usize) -> (f64, f64) {
    let table: Vec<[f64; 2]> = (0..PERIOD).map(|i| measured(phase(i))).collect();
    let mut control = black_box(by_hand::Control::new());
    let start = processor_seconds();
    let mut input = 0.0;
    for i in 0..samples {
        let now = i % PERIOD;
        input += control.step(phase(now), table[now]);
    }
    (processor_seconds() - start, input + control.sums.iter().sum::<f64>())
}

fn step_generated(samples: usize) -> (f64, f64) {
    use mass_spring_drag::{Accumulator, Forces, Parameters, Pattern, feed_forward};
    let table: Vec<[f64; 2]> = (0..PERIOD).map(|i| measured(phase(i))).collect();
    let pattern = black_box(Pattern { lambda: 0.3, w: 3.0 });
    let theta = black_box(Parameters { m: 2.0, k1: 40.0, k2: 1.5 });
    let [kp, kd] = black_box([2000.0, 120.0]);
    let mut sums = Accumulator::new();
    let start = processor_seconds();
    let mut input = 0.0;
    for i in 0..samples {
        let now = i % PERIOD;
        let (sin, cos) = libm::sincos(phase(now));
        let motion = pattern.reference_from(cos, sin);
        let [x, v] = table[now];
        let u = feed_forward(&motion, &theta).u + kp * (motion.x.value - x) + kd * (motion.x.dot - v);
        sums.push_at(cos, sin, &Forces { u });
        input += u;
    }
    let elapsed = processor_seconds() - start;
    let factors = [1.0, 0.5, 0.5, 0.5, 0.5, 0.5];
    let harmonics = sums.harmonics().expect("samples").into_array();
    (elapsed, input + harmonics.iter().zip(factors).map(|(h, f)| h * f * samples as f64).sum::<f64>())
}

fn phase(i: usize) -> f64 {
    std::f64::consts::TAU * i as f64 / PERIOD as f64
}

/// A signal without structure.
fn signal() -> Vec<f64> {
    (0..PERIOD).map(|i| ((i * i * 7919) % 1009) as f64 / 504.5 - 1.0).collect()
}

fn harmonics_of_hand(samples: usize) -> (f64, f64) {
    let table = signal();
    let mut bank = black_box(by_hand::Bank::new(std::f64::consts::TAU / PERIOD as f64));
    let start = processor_seconds();
    for i in 0..samples {
        bank.push(black_box(table[i % PERIOD]));
    }
    let elapsed = processor_seconds() - start;
    (elapsed, bank.cosines.iter().sum::<f64>() + bank.sines.iter().sum::<f64>())
}

fn harmonics_generated(samples: usize) -> (f64, f64) {
    use sixteen::{Accumulator, Forces};
    let table = signal();
    let mut sums = black_box(Accumulator::new());
    // The fundamental's phasor as the bank keeps it, so that both begin with the same.
    let (turn_sin, turn_cos) = black_box((std::f64::consts::TAU / PERIOD as f64).sin_cos());
    let (mut cos, mut sin) = (1.0, 0.0);
    let start = processor_seconds();
    for i in 0..samples {
        sums.push_at(cos, sin, &Forces { u: black_box(table[i % PERIOD]) });
        (cos, sin) = (cos * turn_cos - sin * turn_sin, sin * turn_cos + cos * turn_sin);
    }
    let elapsed = processor_seconds() - start;
    let harmonics = sums.harmonics().expect("samples").into_array();
    (elapsed, harmonics.iter().sum::<f64>() * samples as f64 / 2.0)
}

/// Calls of a function of fixed arguments that the compiler knows nothing of; the checksum is that of one result.
fn calls<R>(count: usize, function: impl Fn() -> R, sum: impl Fn(&R) -> f64) -> (f64, f64) {
    let start = processor_seconds();
    for _ in 0..count {
        black_box(function());
    }
    (processor_seconds() - start, sum(&function()))
}

fn slider(kind: &str, count: usize) -> (f64, f64) {
    use mass_spring_drag::{Motion, Parameters, feed_forward_with_regressor};
    let (motion, theta) = ([0.3, -0.7, 1.1], [2.0, 40.0, 1.5]);
    if kind == "hand" {
        let function = || by_hand::slider(black_box(&motion), black_box(&theta));
        return calls(count, function, |(u, phi)| u + phi.iter().sum::<f64>());
    }
    let (motion, theta) = (Motion::from_array(&motion), Parameters::from_array(theta));
    let function = || feed_forward_with_regressor(black_box(&motion), black_box(&theta));
    calls(count, function, |(forces, phi)| forces.u + phi.as_flattened().iter().sum::<f64>())
}

fn arm(kind: &str, count: usize) -> (f64, f64) {
    use closed_loop_arm::{Constants, Motion, Parameters, feed_forward_with_regressor};
    let (motion, theta, constants) = by_hand::arm_inputs();
    if kind == "hand" {
        let function = || by_hand::arm(black_box(&motion), black_box(&theta), black_box(&constants));
        return calls(count, function, |(tau, phi)| tau[0] + tau[1] + phi.as_flattened().iter().sum::<f64>());
    }
    let motion = Motion::from_array(&motion);
    let (theta, constants) = (Parameters::from_array(theta), Constants::from_array(constants));
    let function = || feed_forward_with_regressor(black_box(&motion), black_box(&theta), black_box(&constants));
    calls(count, function, |(tau, phi)| tau.tau1 + tau.tau2 + phi.as_flattened().iter().sum::<f64>())
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let samples: usize = words[2].parse().expect("a number of samples");
    let (elapsed, sum) = match (words[0].as_str(), words[1].as_str()) {
        ("harmonics", "hand") => harmonics_of_hand(samples),
        ("harmonics", "generated") => harmonics_generated(samples),
        ("step", "hand") => step_of_hand(samples),
        ("step", "generated") => step_generated(samples),
        ("slider", kind) => slider(kind, samples),
        ("arm", kind) => arm(kind, samples),
        _ => panic!("slider|arm|harmonics|step hand|generated CALLS"),
    };
    println!("{:.3} {:.8e}", elapsed * 1e9 / samples as f64, black_box(sum));
}
