//! What a description says of inertias and losses, by the names of its model.

use crate::diagnostic::Diagnostics;
use crate::import::arrange::{Moving, Robot};
use crate::import::options::Options;
use crate::import::read::read;
use crate::source::Source;
use tpm_symbolic::number::rational::Rational;

/// A description and the bodies that a model of it has.
pub struct Described {
    pub(super) robot: Robot,
}

/// A body on a moving joint: the link of this joint, and the links that are fixed to it.
#[derive(Clone, Copy, Debug)]
pub struct DescribedBody<'a> {
    /// The body's name in the model, which ends the names of its parameters.
    pub name: &'a str,
    /// The joint's coordinate in the model, which ends the names of its losses; the joint's own name where it follows another one.
    pub coordinate: &'a str,
    /// The joint's name in the description.
    pub joint: &'a str,
    /// The name of the link that carries the others.
    pub link: &'a str,
    /// Whether the joint turns; it slides otherwise.
    pub turns: bool,
    /// The ten parameters about the frame of the body, of all its links, in the order of
    /// [`NAMES`](tpm_symbolic::mechanics::tree::NAMES).
    pub inertia: &'a [Rational; 10],
    /// Viscous friction; zero where the description has none.
    pub damping: &'a Rational,
    /// Coulomb friction; zero where the description has none.
    pub friction: &'a Rational,
}

/// What a joint takes of the torque of its drive; nothing for what is not known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointLosses {
    /// Viscous friction, N m s/rad or N s/m.
    pub damping: Option<f64>,
    /// Coulomb friction, N m or N.
    pub friction: Option<f64>,
    /// Inertia of the rotor on the joint's side, kg m^2 or kg.
    pub rotor: Option<f64>,
}

impl Described {
    /// Reads a description. The options must be those with which its model was imported.
    ///
    /// # Errors
    /// Those of [`import_description`](super::import_description).
    pub fn read(source: &Source, options: &Options) -> Result<Self, Diagnostics> {
        read(source, options).map(|read| Self { robot: read.robot })
    }

    /// The bodies that move, inward ones first.
    pub fn bodies(&self) -> impl Iterator<Item = DescribedBody<'_>> {
        self.moving().map(|(name, moving)| DescribedBody {
            name,
            coordinate: &moving.coordinate,
            joint: &moving.joint,
            link: &moving.link,
            turns: moving.turns,
            inertia: &moving.inertia,
            damping: &moving.damping,
            friction: &moving.friction,
        })
    }

    pub(super) fn moving(&self) -> impl Iterator<Item = (&str, &Moving)> {
        self.robot.bodies.iter().filter_map(|body| Some((body.name.as_str(), body.moving.as_ref()?)))
    }
}
