//! What a description says of inertias and losses, by the names of its model.

use crate::diagnostic::Diagnostics;
use crate::import::arrange::{Moving, Robot};
use crate::import::options::Options;
use crate::import::read::read;
use crate::source::Source;
use num_traits::Zero;
use std::collections::BTreeMap;
use tpm_symbolic::number::rational::{Rational, to_f64};

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

    /// Frictions as a URDF writes them, by the names of its joints, from those by the coordinates of the model. What brakes a joint counts
    /// at the joint that leads it: there and at all that follow, every friction changes by the same factor, so that their sum is what the
    /// coordinate has. Where the description has no friction of the kind, all of it is the leading joint's.
    #[must_use]
    pub fn frictions_of_joints(&self, losses: &BTreeMap<String, JointLosses>) -> BTreeMap<String, JointLosses> {
        let of = |(_, moving): (&str, &Moving)| {
            let leader = match &moving.follows {
                Some((leader, _)) => self.robot.bodies[*leader].moving.as_ref()?,
                None => moving,
            };
            let whole = losses.get(&leader.coordinate)?;
            let part = |value: Option<f64>, alone: &Rational, all: &Rational| {
                if all.is_zero() {
                    return value.filter(|_| moving.follows.is_none());
                }
                let share = (!alone.is_zero()).then(|| to_f64(alone) / to_f64(all));
                Some(value? * share?)
            };
            let [damping, friction] = &moving.alone;
            let own = JointLosses {
                damping: part(whole.damping, damping, &leader.damping),
                friction: part(whole.friction, friction, &leader.friction),
                rotor: None,
            };
            Some((moving.joint.clone(), own))
        };
        self.moving().filter_map(of).collect()
    }

    pub(super) fn moving(&self) -> impl Iterator<Item = (&str, &Moving)> {
        self.robot.bodies.iter().filter_map(|body| Some((body.name.as_str(), body.moving.as_ref()?)))
    }
}
