//! Friction that falls with the rate (Stribeck), as forces beside the losses of the drives: the rate of its fall stands inside a function,
//! so that it is a nonlinear parameter, and needs an interval.

use std::fmt::Write as _;

use num_traits::Zero;
use tpm_symbolic::mechanics::tree::mechanism::{Loss, parameter_name};
use tpm_symbolic::number::rational::to_f64;

use crate::import::arrange::{Moving, Robot};
use crate::import::options::STRIBECK;
use crate::import::pattern::{Motion, moving};

/// Ends of the interval in which the rate of the fall is looked for, as shares of the largest rate of the joint. Faster than the first, the
/// fall lasts a few samples; slower than the last, viscous friction looks nearly like it.
const ENDS: [f64; 2] = [0.002, 0.5];
/// What an experiment takes for that rate, a share of the largest rate of the joint: the middle of the interval by its logarithm.
const ASSUMED: f64 = 0.03;

/// The largest rate of a joint, rad/s or m/s; where nobody states it, twice that of the motion to begin with.
fn fastest(own: &Moving, motion: Motion) -> f64 {
    let stated = own.limits.velocity.as_ref().filter(|velocity| !velocity.is_zero());
    stated.map_or_else(|| 2.0 * motion.fastest(), to_f64)
}

/// The number with two digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

/// The parameters in the language.
pub(super) fn declarations(robot: &Robot) -> String {
    let (mut amplitudes, mut rates) = (Vec::new(), Vec::new());
    for (own, motion) in moving(robot) {
        let [amplitude, rate] = names(own);
        let [from, to] = ENDS.map(|share| rounded(share * fastest(own, motion)));
        amplitudes.push(format!("{amplitude} [{}]", Loss::Coulomb.unit(own.turns)));
        rates.push(format!("{rate} [{}] from {from} to {to}", if own.turns { "rad/s" } else { "m/s" }));
    }
    format!("    parameter {};\n    nonlinear parameter {};\n", amplitudes.join(", "), rates.join(", "))
}

/// The forces in the language.
pub(super) fn forces(robot: &Robot) -> String {
    let mut text = format!(
        "\n    // Dry friction falls with the rate (Stribeck): {} is what it has more at rest, {} the rate at which that has fallen to 1/e.\n",
        STRIBECK[0], STRIBECK[1]
    );
    for (own, _) in moving(robot) {
        let ([amplitude, rate], q) = (names(own), &own.coordinate);
        let _ = writeln!(text, "    force {q} = -{amplitude}*exp(-(dot({q})/{rate})^2)*sign(dot({q}));");
    }
    text
}

/// The rates that an experiment takes as known, as TOML.
pub(super) fn constants(robot: &Robot) -> String {
    let mut text = String::from("[constants]\n");
    for (own, motion) in moving(robot) {
        let [_, rate] = names(own);
        let unit = if own.turns { "rad/s" } else { "m/s" };
        let value = rounded(ASSUMED * fastest(own, motion));
        let _ =
            writeln!(text, "{rate} = {value:?}              # {unit}; the description does not say, logs identify it");
    }
    text + "\n"
}

fn names(own: &Moving) -> [String; 2] {
    STRIBECK.map(|symbol| parameter_name(symbol, &own.coordinate))
}
