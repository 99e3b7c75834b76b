//! The links of a tree: groups of bodies that move as one.
//!
//! A body on a fixed joint moves with its parent. Known inertias of such bodies are transformed to the parent's frame
//! and added up, and bodies attached to them are placed in that frame. A body of unknown inertia on a fixed joint
//! remains a link, because its parameters refer to its own frame. A body that never moves is no link.

use crate::expr::graph::{ExprId, Graph};
use crate::mechanics::tree::bodies::{Joint, Tree};
use crate::mechanics::tree::inertia::{Inertia, moved, together};
use crate::mechanics::tree::rotation::{Rotation, frame_axis};
use crate::mechanics::tree::vector::{Vector, add, outward_in, zero};

/// A link with its placement on the link that carries it.
#[derive(Clone, Debug)]
pub(super) struct Link {
    /// The index of the link that carries it; `None` for the base.
    pub(super) parent: Option<usize>,
    /// The origin of the joint's frame in the frame of the parent.
    pub(super) origin: Vector,
    /// The rotation from the parent's frame to the joint's frame.
    pub(super) rotation: Rotation,
    pub(super) joint: Joint,
    /// The body of unknown inertia, by its index in the tree.
    pub(super) unknown: Option<usize>,
    /// The known inertia about the frame of the link.
    pub(super) known: Option<[ExprId; 10]>,
}

impl Link {
    /// The axis of its own frame about which a link rotates, when its joint is revolute and the axis is also one of the
    /// carrying link's frame.
    pub(super) fn shared_axis(&self) -> Option<usize> {
        match &self.joint {
            Joint::Revolute { axis, .. } => frame_axis(axis).filter(|&axis| self.rotation.keeps_axis(axis)),
            Joint::Fixed | Joint::Prismatic { .. } => None,
        }
    }
}

/// Placement of a body's frame: in the frame of a link, or of the base.
struct Place {
    link: Option<usize>,
    origin: Vector,
    rotation: Rotation,
}

pub(super) fn links(graph: &mut Graph, tree: &Tree) -> Vec<Link> {
    let mut links: Vec<Link> = Vec::new();
    let mut places: Vec<Place> = Vec::with_capacity(tree.bodies.len());
    for (index, body) in tree.bodies.iter().enumerate() {
        let (carrier, origin, rotation) = match body.parent.map(|parent| &places[parent]) {
            None => (None, body.origin, body.rotation.clone()),
            Some(place) => {
                let offset = outward_in(graph, &place.rotation, &body.origin);
                (place.link, add(graph, &place.origin, &offset), place.rotation.times(&body.rotation))
            }
        };
        let moves = body.joint != Joint::Fixed;
        let own_link = moves || (body.inertia == Inertia::Unknown && carrier.is_some());
        let unknown = (own_link && body.inertia == Inertia::Unknown).then_some(index);
        if own_link {
            links.push(Link {
                parent: carrier,
                origin,
                rotation: rotation.clone(),
                joint: body.joint.clone(),
                unknown,
                known: None,
            });
        }
        let place = if moves {
            Place { link: Some(links.len() - 1), origin: zero(graph), rotation: Rotation::identity() }
        } else {
            Place { link: carrier, origin, rotation }
        };
        if let (Inertia::Known(values), Some(link)) = (&body.inertia, place.link) {
            let values = moved(graph, values, &place.origin, &place.rotation);
            let sum = match links[link].known.take() {
                Some(known) => together(graph, &known, &values),
                None => values,
            };
            links[link].known = Some(sum);
        }
        places.push(place);
    }
    links
}
