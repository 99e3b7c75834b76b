//! A campaign of the generated code with a simulated machine in the same program: two carts, integrated between samples, with noise in
//! both sensors and a proportional-derivative feedback of the driven cart. Arguments: seed, precision (double or single) and what goes wrong.
//! Prints how the campaign ended, the number of runs, and every parameter with its deviation.

#[allow(dead_code, unused_imports)]
mod two_carts;

use two_carts::run::{
    Applied, Campaign, CampaignPhase, CampaignRules, Limits, Measured, Parameters, RunSampling, Sample, Stage,
};
use two_carts::Pattern;
use two_carts::support::Real;

const STEP: f64 = 1e-3;
const NOISE: f64 = 1e-4;

/// The machine: m1 = 2, m2 = 1, k1 = 40, k2 = 300, k3 = 200.
fn slope(state: &[f64; 4], force: f64) -> [f64; 4] {
    let [x1, x2, v1, v2] = *state;
    let spring = 200.0 * (x1 - x2);
    [v1, v2, (force - 40.0 * x1 - 300.0 * x1 * x1 * x1 - spring) / 2.0, spring]
}

/// The state a sample later, the force held (Runge-Kutta of fourth order, four steps).
fn later(mut state: [f64; 4], force: f64) -> [f64; 4] {
    let step = STEP / 4.0;
    for _ in 0..4 {
        let moved = |slope: &[f64; 4], by: f64| -> [f64; 4] { std::array::from_fn(|i| state[i] + by * slope[i]) };
        let first = slope(&state, force);
        let second = slope(&moved(&first, step / 2.0), force);
        let third = slope(&moved(&second, step / 2.0), force);
        let fourth = slope(&moved(&third, step), force);
        state = std::array::from_fn(|i| state[i] + step / 6.0 * (first[i] + 2.0 * second[i] + 2.0 * third[i] + fourth[i]));
    }
    state
}

/// Normal numbers of a linear congruential generator.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

fn campaign<T: Real>(seed: u64, wrong: &str) {
    let real = T::from_f64;
    let stage = |lambda: f64, samples_per_period: u32| Stage {
        pattern: Pattern { lambda: real(lambda), w: T::ZERO },
        samples_per_period,
    };
    let stages = [stage(0.2, 2094), stage(0.4, 1571)];
    let rules = CampaignRules { settle_periods: 3, periods: 10, runs_per_stage: 2, most_runs: 10, effort: real(0.9) };
    let sampling = RunSampling { sample_time: real(STEP), held: true, delay: T::ZERO };
    let force = if wrong == "weak" { 20.0 } else { 400.0 };
    let limits = Limits {
        inputs: Applied { F: real(force) },
        tracking: Measured { x1: real(0.5), x2: real(0.5) },
    };
    let prior = Parameters::from_array([3.0, 0.5, 60.0, 150.0, 300.0].map(real));
    let mut campaign = Campaign::new(&stages, rules, sampling, limits, prior).expect("a campaign");
    let (mut state, mut noise) = ([0.0; 4], Noise(seed));
    let (mut before, mut rate, mut rested, mut due) = (None, 0.0, 0, 0);
    for number in 0_u32.. {
        let command = campaign.command();
        let mut read = [state[0] + NOISE * noise.next(), state[1] + NOISE * noise.next()];
        if wrong == "nan" && number == 60_000 {
            read[1] = f64::NAN;
        }
        let error = read[0] - command.reference.x1.to_f64();
        rate += (1.0 - (-STEP / 2e-3_f64).exp()) * ((error - before.unwrap_or(error)) / STEP - rate);
        before = Some(error);
        let applied = command.feed_forward.F.to_f64() - 400.0 * error - 40.0 * rate;
        let sample = Sample {
            measured: Measured { x1: real(read[0]), x2: real(read[1]) },
            applied: Applied { F: real(applied) },
        };
        let phase = campaign.push(&sample);
        state = later(state, applied);
        // An update takes a while, here a third of a second.
        due = if phase == CampaignPhase::Due { due + 1 } else { 0 };
        if due == 333 {
            campaign.update();
        }
        if let CampaignPhase::Ended(_) = phase {
            rested += 1;
            if rested == 8000 {
                break;
            }
        }
        assert!(number < 2_000_000, "the campaign ends");
    }
    println!("{:?} after {} runs", campaign.phase(), campaign.runs());
    println!("{:e} {:e}", state[0].abs().max(state[1].abs()), campaign.command().reference.x1.to_f64());
    if let Some(estimate) = campaign.estimate() {
        let values = estimate.parameters.into_array().into_iter().zip(estimate.deviations.into_array());
        for (value, deviation) in values {
            let of = |number: Option<T>| number.map_or(f64::NAN, Real::to_f64);
            println!("{:?} {:?}", of(value), of(deviation));
        }
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let seed = arguments[1].parse().expect("a seed");
    let wrong = arguments.get(3).map_or("", String::as_str);
    match arguments[2].as_str() {
        "single" => campaign::<f32>(seed, wrong),
        _ => campaign::<f64>(seed, wrong),
    }
}
