//! The torque of every joint by recursion over wrenches, for given inertias.

use crate::expr::graph::{Coordinate, ExprId, Graph};
use crate::mechanics::tree::bodies::{Joint, Tree};
use crate::mechanics::tree::inertia::{moved, parted, together};
use crate::mechanics::tree::links::{Link, links};
use crate::mechanics::tree::motion::{Motion, motions};
use crate::mechanics::tree::vector::{Vector, add, constant, cross, dot, scale, times, zero};

impl Tree {
    /// The torques of the coordinates that move joints (forces, where these are prismatic), in the order of the bodies, when `parameters`
    /// gives the ten parameters of every body of unknown inertia by its index. Torques of joints that share a coordinate are added. If some derivatives of coordinates are replaced by
    /// numbers, the result is the torque of gravity, or a column of the mass matrix.
    pub fn torques(&self, graph: &mut Graph, parameters: impl Fn(usize) -> [ExprId; 10]) -> Vec<(Coordinate, ExprId)> {
        let links = links(graph, self);
        let (steps, motions) = motions(graph, self, &links);
        let inertias = passed_inward(graph, &links, parameters);
        let none = zero(graph);
        let mut wrenches = vec![(none, none); links.len()];
        let mut torques: Vec<(Coordinate, ExprId)> = Vec::new();
        for index in (0..links.len()).rev() {
            let link = &links[index];
            let (mut force, mut moment) = wrenches[index];
            if let Some(inertia) = &inertias[index] {
                let own = wrench(graph, &motions[index], inertia);
                force = add(graph, &force, &own.0);
                moment = add(graph, &moment, &own.1);
            }
            let axis = constant(graph, &link.joint.direction());
            match &link.joint {
                Joint::Fixed => {}
                Joint::Revolute { coordinate, .. } => torques.push((*coordinate, dot(graph, &axis, &moment))),
                Joint::Prismatic { coordinate, .. } => {
                    torques.push((*coordinate, dot(graph, &axis, &force)));
                    let position = graph.derivative_of(*coordinate, 0);
                    let arm = scale(graph, &axis, position);
                    let lever = cross(graph, &arm, &force);
                    moment = add(graph, &moment, &lever);
                }
            }
            if let Some(parent) = link.parent {
                let force = steps[index].inward(graph, link, &force);
                let moment = steps[index].inward(graph, link, &moment);
                let lever = cross(graph, &link.origin, &force);
                let (carried_force, carried_moment) = wrenches[parent];
                let carried_force = add(graph, &carried_force, &force);
                let moment = add(graph, &moment, &lever);
                wrenches[parent] = (carried_force, add(graph, &carried_moment, &moment));
            }
        }
        let mut found: Vec<(Coordinate, ExprId)> = Vec::with_capacity(torques.len());
        for (coordinate, torque) in torques.into_iter().rev() {
            match found.iter_mut().find(|(known, _)| *known == coordinate) {
                Some((_, sum)) => *sum = graph.sum_of_wholes(&[*sum, torque]),
                None => found.push((coordinate, torque)),
            }
        }
        found
    }
}

/// Largest number of nonzero components of a frame's origin at which moving an inertia inward saves operations.
const MOST_COMPONENTS: usize = 2;

/// The inertias of the links, after the part of each that its joint does not rotate was moved to the carrying link:
/// masses on an axis have the same motion on both links that the axis connects. In this way inertias are grouped into
/// base parameters (Gautier and Khalil 1990).
fn passed_inward(
    graph: &mut Graph,
    links: &[Link],
    parameters: impl Fn(usize) -> [ExprId; 10],
) -> Vec<Option<[ExprId; 10]>> {
    let own = |link: &Link| (link.known, link.unknown.map(&parameters));
    let mut inertias: Vec<Option<[ExprId; 10]>> = links.iter().map(|link| sum(graph, own(link))).collect();
    for index in (0..links.len()).rev() {
        let link = &links[index];
        let (Some(inertia), Some(axis)) = (inertias[index], link.shared_axis()) else { continue };
        let nothing = graph.integer(0);
        if link.origin.iter().filter(|&&component| component != nothing).count() > MOST_COMPONENTS {
            continue;
        }
        let (kept, on_axis) = parted(graph, &inertia, axis);
        inertias[index] = Some(kept);
        if let Some(parent) = link.parent {
            let passed = moved(graph, &on_axis, &link.origin, &link.rotation);
            inertias[parent] = sum(graph, (inertias[parent], Some(passed)));
        }
    }
    inertias
}

/// The sum of two bodies' parameters about one frame; either body may be missing.
fn sum(graph: &mut Graph, (a, b): (Option<[ExprId; 10]>, Option<[ExprId; 10]>)) -> Option<[ExprId; 10]> {
    match (a, b) {
        (Some(a), Some(b)) => Some(together(graph, &a, &b)),
        (a, b) => a.or(b),
    }
}

/// Force and moment about the origin that accelerate a body.
fn wrench(graph: &mut Graph, motion: &Motion, inertia: &[ExprId; 10]) -> (Vector, Vector) {
    let first: Vector = [inertia[1], inertia[2], inertia[3]];
    let pushed = scale(graph, &motion.acceleration, inertia[0]);
    let swung = times(graph, &motion.field, &first);
    let turned = motion.moment(graph, inertia);
    let lever = cross(graph, &first, &motion.acceleration);
    (add(graph, &pushed, &swung), add(graph, &turned, &lever))
}
