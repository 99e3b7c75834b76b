//! Bodies, the joints by which they are attached to each other, and the tree that they form.

use crate::expr::graph::Coordinate;
use crate::mechanics::tree::inertia::Inertia;
use crate::mechanics::tree::rotation::Rotation;
use crate::mechanics::tree::vector::Vector;
use crate::number::rational::{Rational, integer};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use thiserror::Error;

/// Motion of a body relative to its parent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Joint {
    /// No relative motion.
    Fixed,
    /// Rotation about an axis.
    Revolute {
        /// The angle, rad.
        coordinate: Coordinate,
        /// The axis, a unit vector in the joint's frame.
        axis: [Rational; 3],
    },
    /// Translation along an axis.
    Prismatic {
        /// The displacement, m.
        coordinate: Coordinate,
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
    /// Two joints have one coordinate.
    #[error("the coordinate of the joint of body {body} is the coordinate of another joint too")]
    Coordinate {
        /// The index of the second body.
        body: usize,
    },
}

impl Tree {
    /// A tree of bodies; `gravity` is the acceleration of gravity in the frame of the base, m/s^2.
    ///
    /// # Errors
    /// When a body does not come after its parent, an axis is no unit vector, or two joints share a coordinate.
    pub fn new(gravity: Vector, bodies: Vec<Body>) -> Result<Self, TreeError> {
        let mut coordinates = BTreeSet::new();
        for (index, body) in bodies.iter().enumerate() {
            if let Some(parent) = body.parent.filter(|&parent| parent >= index) {
                return Err(TreeError::Order { body: index, parent });
            }
            match &body.joint {
                Joint::Fixed => {}
                Joint::Revolute { coordinate, axis } | Joint::Prismatic { coordinate, axis } => {
                    let square: Rational = axis.iter().map(|component| component * component).sum();
                    if square != integer(1) {
                        return Err(TreeError::Axis { body: index });
                    }
                    if !coordinates.insert(*coordinate) {
                        return Err(TreeError::Coordinate { body: index });
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
