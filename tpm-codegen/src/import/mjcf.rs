//! A description's mechanism as a MuJoCo model: bodies, joints, inertias and losses, without shapes.

use crate::import::arrange::{Body, Moving, rotation_of};
use crate::import::described::{Described, JointLosses};
use crate::import::description::Spring;
use crate::import::split::{SplitError, text, written};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use tpm_symbolic::mechanics::tree::rotation::Rotation;
use tpm_symbolic::number::rational::{Rational, to_f64};

/// The text of a model for MuJoCo (MJCF) with these ten parameters by body and losses by coordinate, both by their names in the model.
/// Joints, motors and bodies have the names of the model. What is not given is that of the description.
///
/// # Errors
/// [`SplitError`] where a body has mass and its inertia is not possible.
pub fn mjcf(
    described: &Described,
    bodies: &BTreeMap<String, [Rational; 10]>,
    losses: &BTreeMap<String, JointLosses>,
) -> Result<String, SplitError> {
    let robot = &described.robot;
    let mut out = format!(
        "<mujoco model=\"{}\">\n  <compiler angle=\"radian\" autolimits=\"true\" inertiafromgeom=\"false\"/>\n  \
         <option gravity=\"{}\"/>\n  <worldbody>\n",
        robot.name,
        robot.gravity.each_ref().map(|component| to_f64(&component.value).to_string()).join(" ")
    );
    let writer = Writer { bodies: &robot.bodies, inertias: bodies, losses };
    for (index, body) in robot.bodies.iter().enumerate() {
        if body.parent.is_none() {
            writer.body(&mut out, index, "    ")?;
        }
    }
    out.push_str("  </worldbody>\n  <actuator>\n");
    for (_, moving) in described.moving().filter(|(_, moving)| moving.follows.is_none()) {
        let (coordinate, input) = (&moving.coordinate, &moving.input);
        let range = moving.limits.effort.as_ref().filter(|effort| to_f64(effort) > 0.0);
        let range = range.map_or_else(String::new, |effort| {
            let effort = to_f64(effort);
            format!(" ctrlrange=\"-{effort} {effort}\"")
        });
        let _ = writeln!(out, "    <motor name=\"{input}\" joint=\"{coordinate}\"{range}/>");
    }
    out.push_str("  </actuator>\n");
    let followers = described.moving().filter_map(|(_, moving)| {
        let (leader, factor) = moving.follows.as_ref()?;
        Some((&moving.coordinate, &robot.bodies[*leader].moving.as_ref()?.coordinate, to_f64(factor)))
    });
    let equalities: String = followers
        .map(|(own, leader, factor)| {
            format!("    <joint joint1=\"{own}\" joint2=\"{leader}\" polycoef=\"0 {factor} 0 0 0\"/>\n")
        })
        .collect();
    if !equalities.is_empty() {
        out += &format!("  <equality>\n{equalities}  </equality>\n");
    }
    out.push_str("</mujoco>\n");
    Ok(out)
}

struct Writer<'a> {
    bodies: &'a [Body],
    inertias: &'a BTreeMap<String, [Rational; 10]>,
    losses: &'a BTreeMap<String, JointLosses>,
}

impl Writer<'_> {
    fn body(&self, out: &mut String, index: usize, indent: &str) -> Result<(), SplitError> {
        let body = &self.bodies[index];
        let at = body.origin.at.each_ref().map(|component| to_f64(&component.value).to_string()).join(" ");
        let turned = quaternion(&rotation_of(&body.origin)).map(|part| part.to_string()).join(" ");
        let _ = writeln!(out, "{indent}<body name=\"{}\" pos=\"{at}\" quat=\"{turned}\">", body.name);
        if let Some(moving) = &body.moving {
            self.moving(out, &body.name, moving, indent)?;
        }
        let inner = format!("{indent}  ");
        for (child, other) in self.bodies.iter().enumerate() {
            if other.parent == Some(index) {
                self.body(out, child, &inner)?;
            }
        }
        let _ = writeln!(out, "{indent}</body>");
        Ok(())
    }

    fn moving(&self, out: &mut String, name: &str, moving: &Moving, indent: &str) -> Result<(), SplitError> {
        let parameters = self.inertias.get(name).unwrap_or(&moving.inertia);
        if to_f64(&parameters[0]) != 0.0 {
            let own = written(parameters).ok_or_else(|| SplitError::Impossible(name.to_owned()))?;
            let [xx, xy, xz, yy, yz, zz] = own.moments.each_ref().map(text);
            let _ = writeln!(
                out,
                "{indent}  <inertial pos=\"{}\" mass=\"{}\" fullinertia=\"{xx} {yy} {zz} {xy} {xz} {yz}\"/>",
                own.centre.each_ref().map(text).join(" "),
                text(&own.mass)
            );
        }
        let losses = self.losses.get(&moving.coordinate).copied().unwrap_or_default();
        let (damping, friction) = (losses.damping, losses.friction);
        let mut attributes = String::new();
        for (attribute, value) in [
            ("damping", damping.unwrap_or_else(|| to_f64(&moving.damping))),
            ("frictionloss", friction.unwrap_or_else(|| to_f64(&moving.friction))),
            ("armature", losses.rotor.unwrap_or_else(|| to_f64(&moving.armature))),
        ] {
            if value != 0.0 {
                let _ = write!(attributes, " {attribute}=\"{value}\"");
            }
        }
        if let Some(Spring { stiffness, rest }) = &moving.spring {
            let _ = write!(attributes, " stiffness=\"{}\" springref=\"{}\"", to_f64(stiffness), to_f64(rest));
        }
        if let (Some(lower), Some(upper)) = (&moving.limits.lower, &moving.limits.upper)
            && lower < upper
        {
            let _ = write!(attributes, " range=\"{} {}\"", to_f64(lower), to_f64(upper));
        }
        let kind = if moving.turns { "hinge" } else { "slide" };
        let axis = moving.direction.each_ref().map(|component| to_f64(component).to_string()).join(" ");
        let _ = writeln!(
            out,
            "{indent}  <joint name=\"{}\" type=\"{kind}\" axis=\"{axis}\"{attributes}/>",
            moving.coordinate
        );
        Ok(())
    }
}

/// The unit quaternion (w, x, y, z) of a rotation: of its four parts the largest is found first, by which the others are divided.
fn quaternion(rotation: &Rotation) -> [f64; 4] {
    let r = |i: usize, j: usize| to_f64(rotation.entry(i, j));
    let diagonal = [r(0, 0), r(1, 1), r(2, 2)];
    let trace: f64 = diagonal.iter().sum();
    let squares = [
        1.0 + trace,
        1.0 + 2.0 * diagonal[0] - trace,
        1.0 + 2.0 * diagonal[1] - trace,
        1.0 + 2.0 * diagonal[2] - trace,
    ];
    let largest = (0..4).max_by(|&i, &j| squares[i].total_cmp(&squares[j])).unwrap_or(0);
    let root = squares[largest].sqrt();
    // Four times the products of two parts stand in sums and differences of entries across the diagonal.
    let with_w = [r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)];
    let pair = |i: usize, j: usize| r(i, j) + r(j, i);
    std::array::from_fn(|part| {
        let four = match (part.min(largest), part.max(largest)) {
            (i, j) if i == j => return root / 2.0,
            (0, j) => with_w[j - 1],
            (i, j) => pair(i - 1, j - 1),
        };
        four / (2.0 * root)
    })
}
