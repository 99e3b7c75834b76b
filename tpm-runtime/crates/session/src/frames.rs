//! The frames of a mechanism's bodies, for reading.

use crate::model::DeclaredModel;
use tpm_codegen::language::typeset;
use tpm_report::number;
use tpm_symbolic::expr::graph::Coordinate;
use tpm_symbolic::mechanics::tree::mechanism::{Drive, Loss};
use tpm_symbolic::mechanics::tree::{Body, Joint};
use tpm_symbolic::number::rational::{Rational, integer, to_f64};

/// How a body moves against the one on which it stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Movement {
    /// Not at all.
    Fixed,
    /// About an axis.
    Turns,
    /// Along an axis.
    Slides,
}

/// The frame of a body of a mechanism.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The body.
    pub body: String,
    /// The body on which it stands; nothing for the base, which does not move.
    pub on: Option<String>,
    /// How it moves.
    pub movement: Movement,
    /// What moves its joint: a coordinate, or a multiple of one, such as `-1*q1`; empty where it does not move.
    pub coordinate: String,
    /// The axis of its joint in its own frame, a unit vector; zeros where it does not move.
    pub axis: [f64; 3],
    /// The origin in the frame of the body on which it stands, m; nothing for a component that is known at run time only.
    pub origin: [Option<f64>; 3],
    /// How the frame is turned against the one on which it stands where the coordinate is zero: roll, pitch and yaw, rad.
    pub turned: [f64; 3],
}

/// A drive of a mechanism.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveTerms {
    /// Its input; nothing for a drive without one.
    pub input: Option<String>,
    /// What it moves with, such as `q5 + q6`.
    pub moves: String,
    /// Its torque, such as `fv_q1 v + fc_q1 sign(v) + Ia_q1 dv/dt` with the rate v of what it moves with; empty where it has no losses.
    pub losses: String,
}

impl DeclaredModel {
    /// What the model says of the motion as MathML, which browsers typeset: a list of pieces for every equation, energy, force and definition
    /// of its text.
    #[must_use]
    pub fn equations(&self) -> Vec<Vec<String>> {
        typeset(&self.parsed().ast)
    }

    /// The frames of the bodies, each behind the one on which it stands; none where the model is no mechanism.
    #[must_use]
    pub fn frames(&self) -> Vec<Frame> {
        let parsed = self.parsed();
        let Some(mechanism) = &parsed.mechanism else { return Vec::new() };
        let label = |body: usize| mechanism.labels[body].name.to_string();
        let of = |(index, body): (usize, &Body)| {
            let moved = |coordinate: &Coordinate, factor: &Rational| {
                let name = &parsed.model.coordinates[coordinate.0 as usize].name;
                if *factor == integer(1) { name.to_string() } else { format!("{factor}*{name}") }
            };
            let along = |axis: &[Rational; 3]| axis.each_ref().map(to_f64);
            let (movement, coordinate, axis) = match &body.joint {
                Joint::Fixed => (Movement::Fixed, String::new(), [0.0; 3]),
                Joint::Revolute { coordinate, factor, axis } => {
                    (Movement::Turns, moved(coordinate, factor), along(axis))
                }
                Joint::Prismatic { coordinate, factor, axis } => {
                    (Movement::Slides, moved(coordinate, factor), along(axis))
                }
            };
            let entry = |row: usize, column: usize| to_f64(body.rotation.entry(row, column));
            let pitch = (0.0 - entry(2, 0)).clamp(-1.0, 1.0).asin();
            // With a pitch of a right angle only the sum of roll and yaw counts; the yaw takes all of it.
            let turned = if entry(2, 1).hypot(entry(2, 2)) > 1e-12 {
                [entry(2, 1).atan2(entry(2, 2)), pitch, entry(1, 0).atan2(entry(0, 0))]
            } else {
                [0.0, pitch, (0.0 - entry(0, 1)).atan2(entry(1, 1))]
            };
            Frame {
                body: label(index),
                on: body.parent.map(label),
                movement,
                coordinate,
                axis,
                origin: body.origin.map(|part| parsed.model.graph.as_number(part).map(to_f64)),
                turned,
            }
        };
        mechanism.tree.bodies().iter().enumerate().map(of).collect()
    }

    /// The drives; none where the model is no mechanism.
    #[must_use]
    pub fn drives(&self) -> Vec<DriveTerms> {
        let model = &self.parsed().model;
        let of = |drive: &Drive| {
            let mut moves = String::new();
            for (coordinate, factor) in &drive.moves {
                let factor = to_f64(factor);
                moves.push_str(match (moves.is_empty(), factor < 0.0) {
                    (true, false) => "",
                    (true, true) => "-",
                    (false, false) => " + ",
                    (false, true) => " - ",
                });
                if factor.abs() != 1.0 {
                    moves.push_str(&format!("{} ", number(factor.abs())));
                }
                moves.push_str(&model.coordinates[coordinate.0 as usize].name);
            }
            let loss = |loss: &Loss| {
                let name = format!("{}_{}", loss.symbol(), drive.name);
                match loss {
                    Loss::Viscous => format!("{name} v"),
                    Loss::Coulomb => format!("{name} sign(v)"),
                    Loss::Offset => name,
                    Loss::Rotor => format!("{name} dv/dt"),
                    Loss::Load => format!("{name} |load| sign(v)"),
                }
            };
            DriveTerms {
                input: drive.input.map(|input| model.quantity(input).name.to_string()),
                moves,
                losses: drive.losses.iter().map(loss).collect::<Vec<String>>().join(" + "),
            }
        };
        self.parsed().mechanism.iter().flat_map(|mechanism| &mechanism.drives).map(of).collect()
    }
}
