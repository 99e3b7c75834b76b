//! The controller's loop, and the machine beside it: a campaign from the first sample to rest with the module of the library, in the precision
//! of the argument. The machine is the module's own forward dynamics with other parameters. Prints how the campaign ended, and every parameter
//! with its deviation.

use mechanism_program::slide::run::{
    Applied, Campaign, CampaignPhase, CampaignRules, Limits, Measured, PARAMETERS, Parameters, RunSampling, Sample, Stage,
};
use mechanism_program::slide::{self, Inputs, Motion, Pattern, QMotion, XMotion};
use tpm_controller::Real;

const STEP: f64 = 1e-3;
const NOISE: f64 = 1e-4;
/// m_slide, m_arm, mx_arm, mz_arm, Iyy_arm, fv_x, fv_q of the machine, and estimates before the first run.
const TRUTH: [f64; 7] = [2.0, 1.0, 0.05, -0.3, 0.2, 3.0, 0.1];
const PRIOR: [f64; 7] = [1.5, 1.5, 0.0, -0.2, 0.3, 0.0, 0.0];

/// Positions and speeds.
type State = [f64; 4];

fn slope(state: &State, applied: &[f64; 2]) -> State {
    let [x, q, dx, dq] = *state;
    let motion = Motion {
        x: XMotion { value: x, dot: dx, ddot: 0.0 },
        q: QMotion { value: q, dot: dq, ddot: 0.0 },
    };
    let inputs = Inputs { f: applied[0], tau: applied[1] };
    let found = slide::forward_dynamics(&motion, &inputs, &slide::Parameters::from_array(TRUTH)).expect("masses are positive");
    [dx, dq, found.x, found.q]
}

/// The state a sample later, the inputs held (Runge-Kutta of fourth order).
fn later(state: &State, applied: &[f64; 2]) -> State {
    let moved = |slope: &State, by: f64| -> State { std::array::from_fn(|i| state[i] + by * slope[i]) };
    let first = slope(state, applied);
    let second = slope(&moved(&first, STEP / 2.0), applied);
    let third = slope(&moved(&second, STEP / 2.0), applied);
    let fourth = slope(&moved(&third, STEP), applied);
    std::array::from_fn(|i| state[i] + STEP / 6.0 * (first[i] + 2.0 * second[i] + 2.0 * third[i] + fourth[i]))
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
        NOISE * radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

fn campaign<T: Real>() {
    let real = T::from_f64;
    let stage = |lambda: f64, phi: f64, samples_per_period: u32| Stage {
        pattern: Pattern { lambda: real(lambda), phi: real(phi), w: T::ZERO },
        samples_per_period,
    };
    let stages = [stage(0.2, 0.3, 2094), stage(0.3, 0.5, 1571)];
    let rules = CampaignRules { settle_periods: 3, periods: 10, runs_per_stage: 2, most_runs: 10, effort: real(0.9) };
    let sampling = RunSampling { sample_time: real(STEP), held: true, delay: T::ZERO };
    let limits = Limits {
        inputs: Applied { f: real(400.0), tau: real(100.0) },
        tracking: Measured { x: real(0.3), q: real(0.5) },
    };
    let prior = Parameters::from_array(PRIOR.map(real));
    let mut campaign = Campaign::new(&stages, rules, sampling, limits, prior).expect("a campaign");
    let (mut state, mut noise) = ([0.0; 4], Noise(1));
    let (mut before, mut rates, mut rested) = (None, [0.0; 2], 0);
    for number in 0_u32.. {
        let command = campaign.command();
        let read = [state[0] + noise.next(), state[1] + noise.next()];
        let errors = [read[0] - command.reference.x.to_f64(), read[1] - command.reference.q.to_f64()];
        let previous = before.unwrap_or(errors);
        for ((rate, error), previous) in rates.iter_mut().zip(errors).zip(previous) {
            *rate += 0.4 * ((error - previous) / STEP - *rate);
        }
        before = Some(errors);
        let applied = [
            command.feed_forward.f.to_f64() - 400.0 * errors[0] - 40.0 * rates[0],
            command.feed_forward.tau.to_f64() - 40.0 * errors[1] - 4.0 * rates[1],
        ];
        let sample = Sample {
            measured: Measured { x: real(read[0]), q: real(read[1]) },
            applied: Applied { f: real(applied[0]), tau: real(applied[1]) },
        };
        let phase = campaign.push(&sample);
        state = later(&state, &applied);
        if phase == CampaignPhase::Due {
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
    let estimate = campaign.estimate().expect("runs were measured");
    let values = estimate.parameters.into_array().into_iter().zip(estimate.deviations.into_array());
    for ((label, truth), (value, deviation)) in PARAMETERS.iter().zip(TRUTH).zip(values) {
        match value.zip(deviation) {
            Some((value, deviation)) => println!("{} {:e} {:e} {truth:e}", label.name, value.to_f64(), deviation.to_f64()),
            None => println!("{} not shown", label.name),
        }
    }
}

fn main() {
    match std::env::args().nth(1).as_deref() {
        Some("single") => campaign::<f32>(),
        _ => campaign::<f64>(),
    }
}
