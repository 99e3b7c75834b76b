//! The experiment of an imported model: its limits, a controller, a first stage, and a simulated machine as the description says.

use std::collections::{BTreeMap, BTreeSet};

use num_traits::Signed;
use tpm_symbolic::mechanics::tree::mechanism::{Loss, parameter_name};
use tpm_symbolic::number::rational::{self, Rational};

use crate::import::arrange::{Moving, Robot};
use crate::import::felt::{Felt, felt};
use crate::import::pattern::{FREQUENCY, Motion, motions};

/// Natural frequency of every joint's loop on its own, rad/s: well above the motion, and well below the sampling.
const BANDWIDTH: f64 = 20.0;
/// Its damping ratio.
const DAMPING: f64 = 0.7;
/// Noise of the simulated machine's sensors, rad or m: an encoder of 18 bits moves by 2.4e-5 rad.
const NOISE: f64 = 1e-5;
/// Time between samples, s.
const SAMPLE_TIME: f64 = 1e-3;
/// Largest step of the simulated machine over the time in which a motion decays; Runge and Kutta's method is stable up to 2.78.
const STEP: f64 = 2.0;
/// Steps that a machine takes in a sample when none are stated.
const USUAL_STEPS: f64 = 1.0;
/// Most steps in a sample; beyond, a description lacks the inertia of its rotors.
const MOST_STEPS: f64 = 100.0;

/// A joint with its motion and what it feels in the middle of the motion.
struct Joint<'a> {
    moving: &'a Moving,
    motion: Motion,
    felt: Felt,
}

/// The experiment as TOML; `prior` has the lines of the prior, `known` all parameters of the model, `constants` the table of what the model
/// takes as known.
pub(super) fn experiment(robot: &Robot, from: &str, prior: &str, known: &BTreeSet<String>, constants: &str) -> String {
    let motions = motions(robot);
    let centres: Vec<f64> = motions.iter().map(|motion| motion.map_or(0.0, |motion| motion.centre)).collect();
    let joints: Vec<Joint<'_>> = robot
        .bodies
        .iter()
        .zip(motions)
        .zip(felt(robot, &centres))
        .filter_map(|((body, motion), felt)| {
            Some(Joint { moving: body.moving.as_ref()?, motion: motion?, felt: felt? })
        })
        .collect();
    format!(
        "# Experiment with the limits of {from}, on a simulated machine with its inertias. Gains and the stage are to begin with: loops\n\
         # of {BANDWIDTH} rad/s about the middle of the motion, half of what positions and velocities allow.\n\n\
         [prior]\n{prior}\n{constants}{}[plant.parameters]\n{}\n{}{}{}{}",
        steps(&joints, known),
        plant(prior, known),
        sensors(&joints),
        control(&joints, known),
        limits(&joints),
        schedule(robot, &joints)
    )
}

/// Values of all parameters of the machine: those of the prior, and zero where the description says nothing.
fn plant(prior: &str, known: &BTreeSet<String>) -> String {
    let given: BTreeMap<&str, &str> = prior.lines().filter_map(|line| line.split_once(" = ")).collect();
    let silent = known.iter().filter(|name| !given.contains_key(name.as_str()));
    let mut text = prior.to_owned();
    silent.for_each(|name| text += &format!("{name} = 0.0              # the description does not say\n"));
    text
}

fn sensors(joints: &[Joint<'_>]) -> String {
    let of = |own: &Joint<'_>| {
        format!("[plant.sensors.{}]\nnoise = {NOISE:e}                    # {}\n\n", own.moving.coordinate, unit(own))
    };
    joints.iter().map(of).collect()
}

fn unit(joint: &Joint<'_>) -> &'static str {
    if joint.moving.turns { "rad" } else { "m" }
}

/// The joint's viscous friction, where the model has it.
fn friction(moving: &Moving, known: &BTreeSet<String>) -> f64 {
    let has = known.contains(&parameter_name(Loss::Viscous.symbol(), &moving.coordinate));
    if has { rational::to_f64(&moving.damping) } else { 0.0 }
}

/// Steps of the simulated machine in a sample: light bodies behind much viscous friction settle faster than it samples. The rates of all
/// motions together are the sum of friction over inertia, since an inertia felt is the reciprocal of the inverse's diagonal.
fn steps(joints: &[Joint<'_>], known: &BTreeSet<String>) -> String {
    let felt = joints.iter().filter(|own| own.felt.inertia > 0.0);
    let rate: f64 = felt.map(|own| friction(own.moving, known) / own.felt.inertia).sum();
    let steps = (rate * SAMPLE_TIME / STEP).ceil().clamp(1.0, MOST_STEPS);
    if steps <= USUAL_STEPS { String::new() } else { format!("[plant]\nsub_steps = {steps}\n\n") }
}

/// Every joint's loop alone has the natural frequency and the damping; its stiffness holds the weight besides, and follows as fast against
/// the viscous friction that the model has.
fn control(joints: &[Joint<'_>], known: &BTreeSet<String>) -> String {
    let mut text = String::from("[control]\n");
    text += &format!("sample_time = {SAMPLE_TIME:e}              # s\nfeedback = [\n");
    for Joint { moving, felt: Felt { inertia, weight }, .. } in joints {
        let Moving { input, coordinate, .. } = moving;
        let stiffness = inertia * BANDWIDTH * BANDWIDTH + weight;
        let gains = [stiffness + friction(moving, known) * BANDWIDTH, 2.0 * DAMPING * (stiffness * inertia).sqrt()];
        let [kp, kd] = gains.map(three_digits);
        text += &format!("    {{ input = \"{input}\", coordinate = \"{coordinate}\", kp = {kp:?}, kd = {kd:?} }},\n");
    }
    text + "]\n\n"
}

fn three_digits(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

/// Inline tables of what the joints state; a table without entries is left out.
fn table(joints: &[Joint<'_>], key: &str, of: impl Fn(&Joint<'_>) -> Option<(String, String)>) -> String {
    let entries: Vec<String> = joints.iter().filter_map(of).map(|(name, value)| format!("{name} = {value}")).collect();
    if entries.is_empty() { String::new() } else { format!("{key} = {{ {} }}\n", entries.join(", ")) }
}

fn number(value: &Rational) -> String {
    format!("{:?}", rational::to_f64(value))
}

fn limits(joints: &[Joint<'_>]) -> String {
    let positive = |limit: &Option<Rational>| limit.as_ref().filter(|limit| limit.is_positive()).map(number);
    let inputs = table(joints, "inputs", |own| Some((own.moving.input.clone(), positive(&own.moving.limits.effort)?)));
    let positions = table(joints, "positions", |own| {
        let limits = &own.moving.limits;
        let (lower, upper) = (limits.lower.as_ref()?, limits.upper.as_ref()?);
        Some((own.moving.coordinate.clone(), format!("[{}, {}]", number(lower), number(upper))))
    });
    let velocity = |own: &Joint<'_>| Some((own.moving.coordinate.clone(), positive(&own.moving.limits.velocity)?));
    format!("[limits]\n{inputs}{positions}{}\n", table(joints, "velocities", velocity))
}

fn schedule(robot: &Robot, joints: &[Joint<'_>]) -> String {
    let multiples =
        table(joints, "multiples", |own| Some((own.moving.coordinate.clone(), own.motion.multiple.to_string())));
    let amplitudes: Vec<String> =
        joints.iter().map(|own| format!("{} = {:?}", own.moving.amplitude, own.motion.amplitude)).collect();
    format!(
        "[schedule]\nmeasure_time = 20.0             # s in every run\n{multiples}stages = [\n    {{ {}, {} = {FREQUENCY:?} }},\n]\n",
        amplitudes.join(", "),
        robot.frequency
    )
}
