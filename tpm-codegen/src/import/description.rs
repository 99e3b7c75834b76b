//! Links and joints of a description as written, each with its place, whatever the format is.

use tpm_symbolic::number::rational::{self, Rational};

use crate::diagnostic::Diagnostic;
use crate::import::reading::{Exact, ExactAngle};
use crate::source::Span;

/// Help where a body is free to move in all directions.
pub(super) const FREE: &str = "take it as the base that stands still; a model has no motion of a base";

/// A robot as it is described.
#[derive(Debug)]
pub(super) struct Description {
    pub(super) name: String,
    pub(super) span: Span,
    /// Acceleration of gravity, m/s^2.
    pub(super) gravity: [Exact; 3],
    pub(super) links: Vec<Link>,
    pub(super) joints: Vec<Joint>,
}

/// A link.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) name: String,
    pub(super) span: Span,
    /// What the link consists of.
    pub(super) inertials: Vec<Inertial>,
    /// Whether it stands between several joints of one body, so that it has no mass by its nature.
    pub(super) between: bool,
    /// Why the mass of a part is not known, where one is not: a fault if the link moves.
    pub(super) unknown: Option<Diagnostic>,
}

/// Mass and moments about the centre of mass.
#[derive(Debug)]
pub(super) struct Inertial {
    pub(super) span: Span,
    pub(super) origin: Origin,
    pub(super) mass: Rational,
    /// Ixx, Ixy, Ixz, Iyy, Iyz, Izz.
    pub(super) moments: [Rational; 6],
}

/// A position, and a rotation by roll, pitch and yaw.
#[derive(Clone, Debug)]
pub(super) struct Origin {
    pub(super) at: [Exact; 3],
    pub(super) turned: [ExactAngle; 3],
}

impl Link {
    /// A link without inertia.
    pub(super) fn light(name: String, span: Span) -> Self {
        Self { name, span, inertials: Vec::new(), between: false, unknown: None }
    }
}

impl Origin {
    pub(super) fn none() -> Self {
        Self { at: std::array::from_fn(|_| Exact::zero()), turned: std::array::from_fn(|_| ExactAngle::zero()) }
    }
}

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Fixed,
    Revolute,
    Prismatic,
}

/// A joint.
#[derive(Debug)]
pub(super) struct Joint {
    pub(super) name: String,
    pub(super) span: Span,
    pub(super) kind: Kind,
    pub(super) parent: String,
    pub(super) child: String,
    pub(super) origin: Origin,
    /// The axis as written, with its place; the x axis where the description has none.
    pub(super) axis: ([Exact; 3], String, Span),
    pub(super) limits: Limits,
    pub(super) damping: Rational,
    pub(super) friction: Rational,
    /// Inertia of the rotor on the joint's side; zero where the description has none.
    pub(super) armature: Rational,
    /// The spring that draws the joint to a position, where there is one.
    pub(super) spring: Option<Spring>,
    /// By how much the joint has moved at the position zero, rad or m.
    pub(super) start: Rational,
    /// The joint that moves this one with it.
    pub(super) follows: Option<Follows>,
}

/// A spring on a joint.
#[derive(Clone, Debug)]
pub(super) struct Spring {
    /// N m/rad or N/m.
    pub(super) stiffness: Rational,
    /// The position at which it is without force.
    pub(super) rest: Rational,
}

impl Spring {
    /// The parameter of its stiffness, without the name of the joint that ends it.
    pub(super) const SYMBOL: &str = "ks";

    /// Both springs on one joint as one: their forces are a constant and a multiple of the position.
    pub(super) fn beside(self, other: Option<Self>) -> Self {
        let Some(other) = other else { return self };
        let stiffness = &self.stiffness + &other.stiffness;
        let rest = (&self.stiffness * self.rest + &other.stiffness * other.rest) / &stiffness;
        Self { stiffness, rest }
    }
}

/// Another joint; the position is the factor times that joint's position, and the offset.
#[derive(Debug)]
pub(super) struct Follows {
    pub(super) leader: String,
    pub(super) factor: Rational,
    pub(super) offset: Rational,
    pub(super) span: Span,
}

/// Limits of a joint.
#[derive(Debug, Default)]
pub(super) struct Limits {
    pub(super) lower: Option<Rational>,
    pub(super) upper: Option<Rational>,
    pub(super) velocity: Option<Rational>,
    pub(super) effort: Option<Rational>,
}

/// The gravity of a description that states none.
pub(super) fn usual_gravity() -> [Exact; 3] {
    [Exact::zero(), Exact::zero(), Exact::new(rational::ratio(-981, 100), "-9.81")]
}
