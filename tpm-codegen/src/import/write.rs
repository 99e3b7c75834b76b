//! The texts of an imported model and its prior.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use num_traits::Zero;
use tpm_symbolic::mechanics::tree::NAMES;
use tpm_symbolic::mechanics::tree::mechanism::{Loss, parameter_name};
use tpm_symbolic::number::rational::{self, Rational};

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::import::arrange::{Body, Moving, Robot};
use crate::import::description::{Origin, Spring};
use crate::import::experiment::experiment;
use crate::import::options::Options;
use crate::import::pattern::{constants, pattern};
use crate::import::stribeck;
use crate::language::ast::mechanism::loss_word;
use crate::language::parse_model;
use crate::source::{Source, Span};

/// The texts of model, prior and experiment.
pub(super) fn write(robot: &Robot, options: &Options, from: &str) -> Result<(String, String, String), Diagnostics> {
    let model = model(robot, options, from);
    // The prior contains only parameters that occur in an equation.
    let source = Source::new("the imported model", model.clone());
    let parsed = parse_model(&source).map_err(|faults| {
        let message = format!("this description gives no model:\n{}", faults.render(&source));
        let fault = Diagnostic::error(Span::default(), message);
        Diagnostics::from_iter([fault.help("correct in the description what these faults name")])
    })?;
    let known: BTreeSet<String> =
        parsed.model.parameters().map(|symbol| parsed.model.quantity(symbol).name.to_string()).collect();
    let values = prior(robot, options, &known);
    let head = format!(
        "# From {from}: inertias about the frames of the bodies, of all links that move with them; SI units.\n"
    );
    let constants = if options.stribeck { stribeck::constants(robot) } else { String::new() };
    let experiment = experiment(robot, from, &values, &known, &constants);
    Ok((model, head + &values, experiment))
}

fn moving(robot: &Robot) -> impl Iterator<Item = (&Body, &Moving)> {
    robot.bodies.iter().filter_map(|body| Some((body, body.moving.as_ref()?)))
}

/// The joints that have coordinates of their own.
fn leading(robot: &Robot) -> impl Iterator<Item = &Moving> {
    moving(robot).map(|(_, moving)| moving).filter(|moving| moving.follows.is_none())
}

/// The unknown torques of a drive.
fn losses(moving: &Moving, options: &Options) -> Vec<Loss> {
    match &options.losses {
        Some(losses) => losses.clone(),
        None => {
            let given =
                [(Loss::Viscous, &moving.damping), (Loss::Coulomb, &moving.friction), (Loss::Rotor, &moving.armature)];
            given.into_iter().filter(|(_, value)| !value.is_zero()).map(|(loss, _)| loss).collect()
        }
    }
}

fn model(robot: &Robot, options: &Options, from: &str) -> String {
    let mut text =
        format!("// Imported from {from}. Lengths in m, angles in rad, parameters about the frames of the bodies.\n");
    let _ = writeln!(text, "model {} {{", robot.name);
    let coordinates: Vec<String> = leading(robot)
        .map(|moving| format!("{} [{}]", moving.coordinate, if moving.turns { "rad" } else { "m" }))
        .collect();
    let inputs: Vec<String> =
        leading(robot).map(|moving| format!("{} [{}]", moving.input, if moving.turns { "N*m" } else { "N" })).collect();
    let _ = writeln!(text, "    coordinate {};\n    input {};", coordinates.join(", "), inputs.join(", "));
    text += &constants(robot);
    if options.stribeck {
        text += &stribeck::declarations(robot);
    }
    let springs: Vec<String> = leading(robot)
        .filter(|moving| moving.spring.is_some())
        .map(|moving| format!("{} [{}]", spring(moving), if moving.turns { "N*m/rad" } else { "N/m" }))
        .collect();
    if !springs.is_empty() {
        let _ = writeln!(text, "    parameter {};", springs.join(", "));
    }
    text.push('\n');
    let [x, y, z] = robot.gravity.each_ref().map(|component| component.text.as_str());
    let _ = writeln!(text, "    mechanism {{\n        gravity ({x}, {y}, {z});");
    for body in &robot.bodies {
        let parent = body.parent.map_or_else(String::new, |parent| format!("on {} ", robot.bodies[parent].name));
        let _ = writeln!(text, "        body {} {parent}{{", body.name);
        let joint = match &body.moving {
            None => "fixed".to_owned(),
            Some(moving) => {
                let words = if moving.turns { ["revolute", "about"] } else { ["prismatic", "along"] };
                format!("{} {} {} {}", words[0], moved(robot, moving), words[1], moving.axis)
            }
        };
        let _ = writeln!(text, "            {joint}{};", placement(&body.origin));
        if body.moving.is_some() {
            text.push_str("            inertia parameters;\n");
        }
        text.push_str("        }\n");
    }
    for moving in leading(robot) {
        let _ = write!(text, "        drive {} by {}", moving.coordinate, moving.input);
        let losses = losses(moving, options);
        if !losses.is_empty() {
            let words: Vec<&str> = losses.into_iter().map(loss_word).collect();
            let _ = write!(text, " with {}", words.join(", "));
        }
        text.push_str(";\n");
    }
    text.push_str("    }\n");
    for moving in leading(robot) {
        if let Some(Spring { rest, .. }) = &moving.spring {
            let (own, q) = (spring(moving), &moving.coordinate);
            let away = if rest.is_zero() { q.clone() } else { format!("({q} - ({rest}))") };
            let _ = writeln!(text, "    force {q} = -{own}*{away};");
        }
    }
    if options.stribeck {
        text += &stribeck::forces(robot);
    }
    text += &pattern(robot);
    text.push_str("}\n");
    text
}

/// The parameter of the spring on a joint.
fn spring(moving: &Moving) -> String {
    parameter_name(Spring::SYMBOL, &moving.coordinate)
}

/// The position of a joint in the language.
fn moved(robot: &Robot, moving: &Moving) -> String {
    let leader =
        moving.follows.as_ref().and_then(|(leader, factor)| Some((robot.bodies[*leader].moving.as_ref()?, factor)));
    match leader {
        Some((leader, factor)) => format!("{factor}*{}", leader.coordinate),
        None => moving.coordinate.clone(),
    }
}

fn placement(origin: &Origin) -> String {
    let mut text = String::new();
    if origin.at.iter().any(|component| !component.value.is_zero()) {
        let [x, y, z] = origin.at.each_ref().map(|component| component.text.as_str());
        let _ = write!(text, " at ({x}, {y}, {z})");
    }
    if origin.turned.iter().any(|angle| !angle.is_zero()) {
        let [roll, pitch, yaw] = origin.turned.each_ref().map(|angle| angle.text.as_str());
        let _ = write!(text, " turned ({roll}, {pitch}, {yaw})");
    }
    text
}

/// `NAME = VALUE` for every parameter of the model with a value in the description. A friction of zero in a description
/// usually means that nobody measured it, and descriptions say nothing of offsets, so these parameters have no prior.
fn prior(robot: &Robot, options: &Options, known: &BTreeSet<String>) -> String {
    let mut text = String::new();
    let mut line = |name: String, value: &Rational| {
        if known.contains(&name) {
            let _ = writeln!(text, "{name} = {:?}", rational::to_f64(value));
        }
    };
    for (body, moving) in moving(robot) {
        for (name, value) in NAMES.iter().zip(&moving.inertia) {
            line(parameter_name(name, &body.name), value);
        }
    }
    for moving in leading(robot) {
        if let Some(Spring { stiffness, .. }) = &moving.spring {
            line(spring(moving), stiffness);
        }
        for loss in losses(moving, options) {
            let value = match loss {
                Loss::Viscous => &moving.damping,
                Loss::Coulomb => &moving.friction,
                Loss::Rotor => &moving.armature,
                Loss::Offset | Loss::Load => continue,
            };
            if !value.is_zero() {
                line(parameter_name(loss.symbol(), &moving.coordinate), value);
            }
        }
    }
    text
}
