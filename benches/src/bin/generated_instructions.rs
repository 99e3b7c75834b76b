//! One of four functions, many times, for instruction counts: `generated_instructions slider|arm hand|generated CALLS`.
//!
//! `benches/instructions.sh` runs it under callgrind and takes the difference between two numbers of calls.

use std::hint::black_box;
use std::process::ExitCode;
use tpm_benches::by_hand;
use tpm_models::{closed_loop_arm, mass_spring_drag};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let calls = arguments.get(2).and_then(|calls| calls.parse::<u64>().ok());
    let names: Vec<&str> = arguments.iter().take(2).map(String::as_str).collect();
    let (Some(calls), [model, kind]) = (calls, names.as_slice()) else { return ExitCode::from(2) };
    let (slider_motion, slider_theta) = ([0.3, -0.7, 1.1], [2.0, 40.0, 1.5]);
    let (arm_motion, arm_theta, arm_constants) = by_hand::arm_inputs();
    let motion = mass_spring_drag::Motion::from_array(&slider_motion);
    let theta = mass_spring_drag::Parameters::from_array(slider_theta);
    let motion_of_arm = closed_loop_arm::Motion::from_array(&arm_motion);
    let theta_of_arm = closed_loop_arm::Parameters::from_array(arm_theta);
    let constants = closed_loop_arm::Constants::from_array(arm_constants);
    match (*model, *kind) {
        ("slider", "hand") => (0..calls).for_each(|_| {
            black_box(by_hand::slider(black_box(&slider_motion), black_box(&slider_theta)));
        }),
        ("slider", "generated") => (0..calls).for_each(|_| {
            let (motion, theta) = (black_box(&motion), black_box(&theta));
            black_box((mass_spring_drag::feed_forward(motion, theta), mass_spring_drag::regressor(motion)));
        }),
        ("arm", "hand") => (0..calls).for_each(|_| {
            black_box(by_hand::arm(black_box(&arm_motion), black_box(&arm_theta), black_box(&arm_constants)));
        }),
        ("arm", "generated") => (0..calls).for_each(|_| {
            let (motion, theta, constants) =
                (black_box(&motion_of_arm), black_box(&theta_of_arm), black_box(&constants));
            black_box((
                closed_loop_arm::feed_forward(motion, theta, constants),
                closed_loop_arm::regressor(motion, constants),
            ));
        }),
        _ => return ExitCode::from(2),
    }
    ExitCode::SUCCESS
}
