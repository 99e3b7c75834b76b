//! Bodies, the joints by which they are attached to each other, and the tree that they form.

use crate::expr::graph::Coordinate;
use crate::mechanics::tree::inertia::Inertia;
use crate::mechanics::tree::rotation::Rotation;
use crate::mechanics::tree::vector::Vector;
use crate::number::rational::{Rational, integer};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Motion of a body relative to its parent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Joint {
    /// No relative motion.
    Fixed,
    /// Rotation about an axis.
    Revolute {
        /// The coordinate, of which the angle (rad) is a multiple.
        coordinate: Coordinate,
        /// The angle over the coordinate: one unless the joint follows another one.
        factor: Rational,
        /// The axis, a unit vector in the joint's frame.
        axis: [Rational; 3],
    },
    /// Translation along an axis.
    Prismatic {
        /// The coordinate, of which the displacement (m) is a multiple.
        coordinate: Coordinate,
        /// The displacement over the coordinate: one unless the joint follows another one.
        factor: Rational,
        /// The axis, a unit vector in the joint's frame.
        axis: [Rational; 3],
    },
}

impl Joint {
    /// The coordinate of a joint that moves.
    #[must_use]
    pub fn coordinate(&self) -> Option<Coordinate> {
        match self {
            Self::Fixed => None,
            Self::Revolute { coordinate, .. } | Self::Prismatic { coordinate, .. } => Some(*coordinate),
        }
    }

    /// The axis times the factor: what a unit rate of the coordinate turns or moves the body by. Zero on a fixed joint.
    #[must_use]
    pub fn direction(&self) -> [Rational; 3] {
        match self {
            Self::Fixed => std::array::from_fn(|_| integer(0)),
            Self::Revolute { axis, factor, .. } | Self::Prismatic { axis, factor, .. } => {
                axis.each_ref().map(|component| component * factor)
            }
        }
    }
}

/// A body and the joint by which it is attached to its parent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Body {
    /// Index of the parent body; `None` for the base, which does not move.
    pub parent: Option<usize>,
    /// The origin of the joint's frame in the parent's frame, m: expressions that do not depend on the motion.
    pub origin: Vector,
    /// The rotation from the parent's frame to the joint's frame.
    pub rotation: Rotation,
    /// The joint.
    pub joint: Joint,
    /// The inertia.
    pub inertia: Inertia,
}

/// Rigid bodies that are attached to each other and to a base.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tree {
    pub(super) gravity: Vector,
    pub(super) bodies: Vec<Body>,
}

/// Why bodies do not form a tree.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum TreeError {
    /// A body comes before its parent.
    #[error("body {body} stands on body {parent}, which does not come before it")]
    Order {
        /// The index of the body.
        body: usize,
        /// The index of its parent.
        parent: usize,
    },
    /// The axis of a joint is no unit vector.
    #[error("the axis of the joint of body {body} has not the length 1")]
    Axis {
        /// The index of the body.
        body: usize,
    },
}

impl Tree {
    /// A tree of bodies; `gravity` is the acceleration of gravity in the frame of the base, m/s^2.
    ///
    /// # Errors
    /// When a body does not come after its parent, or an axis is no unit vector.
    pub fn new(gravity: Vector, bodies: Vec<Body>) -> Result<Self, TreeError> {
        for (index, body) in bodies.iter().enumerate() {
            if let Some(parent) = body.parent.filter(|&parent| parent >= index) {
                return Err(TreeError::Order { body: index, parent });
            }
            match &body.joint {
                Joint::Fixed => {}
                Joint::Revolute { axis, .. } | Joint::Prismatic { axis, .. } => {
                    let square: Rational = axis.iter().map(|component| component * component).sum();
                    if square != integer(1) {
                        return Err(TreeError::Axis { body: index });
                    }
                }
            }
        }
        Ok(Self { gravity, bodies })
    }

    /// The bodies, each after its parent.
    #[must_use]
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }
}
