//! The mass matrix by composite rigid bodies (Featherstone, Rigid Body Dynamics Algorithms, 6.2): column j holds the torques of a unit
//! acceleration of joint j, which moves all links outward of it as one body.

use crate::expr::graph::{Coordinate, ExprId, Graph};
use crate::mechanics::tree::bodies::{Joint, Tree};
use crate::mechanics::tree::inertia::{moved, together};
use crate::mechanics::tree::links::{Link, links};
use crate::mechanics::tree::motion::{Step, steps};
use crate::mechanics::tree::rotation::Rotation;
use crate::mechanics::tree::vector::{Vector, add, constant, cross, dot, scale, times, zero};

impl Tree {
    /// The entries of the mass matrix on and below its diagonal, by the coordinates of row and column. Coordinates that move no two
    /// joints of which one carries the other have no entry. `parameters` gives the ten parameters of every body of unknown
    /// inertia by its index.
    pub fn mass_matrix(
        &self,
        graph: &mut Graph,
        parameters: impl Fn(usize) -> [ExprId; 10],
    ) -> Vec<(Coordinate, Coordinate, ExprId)> {
        let links = links(graph, self);
        let steps = steps(graph, &links);
        let own = |graph: &mut Graph, link: &Link| match (link.known, link.unknown.map(&parameters)) {
            (Some(known), Some(unknown)) => Some(together(graph, &known, &unknown)),
            (known, unknown) => known.or(unknown),
        };
        let mut composite: Vec<Option<[ExprId; 10]>> = links.iter().map(|link| own(graph, link)).collect();
        let mut entries: Vec<(Coordinate, Coordinate, ExprId)> = Vec::new();
        for index in (0..links.len()).rev() {
            let Some(inertia) = composite[index] else { continue };
            for (row, column, entry) in column(graph, &links, &steps, index, &inertia) {
                // Joints that share a coordinate share its entries.
                let known = |known: &&mut (Coordinate, Coordinate, ExprId)| {
                    (known.0, known.1) == (row, column) || (known.1, known.0) == (row, column)
                };
                match entries.iter_mut().find(known) {
                    Some((_, _, sum)) => *sum = graph.sum_of_wholes(&[*sum, entry]),
                    None => entries.push((row, column, entry)),
                }
            }
            if let Some(parent) = links[index].parent {
                let carried = inward(graph, &links[index], &steps[index], &inertia);
                composite[parent] = Some(match composite[parent] {
                    Some(inertia) => together(graph, &inertia, &carried),
                    None => carried,
                });
            }
        }
        entries
    }
}

/// The torques of a unit acceleration of one link's joint, on that joint and on those that carry it.
fn column(
    graph: &mut Graph,
    links: &[Link],
    steps: &[Step],
    index: usize,
    inertia: &[ExprId; 10],
) -> Vec<(Coordinate, Coordinate, ExprId)> {
    let mut entries = Vec::new();
    let first: Vector = [inertia[1], inertia[2], inertia[3]];
    let axis = constant(graph, &links[index].joint.direction());
    let (moving, (mut force, mut moment)) = match &links[index].joint {
        Joint::Fixed => return entries,
        Joint::Revolute { coordinate, .. } => {
            let [_, _, _, _, xx, xy, xz, yy, yz, zz] = *inertia;
            let moment = times(graph, &[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], &axis);
            (*coordinate, (cross(graph, &axis, &first), moment))
        }
        Joint::Prismatic { coordinate, .. } => {
            (*coordinate, (scale(graph, &axis, inertia[0]), cross(graph, &first, &axis)))
        }
    };
    let mut place = index;
    loop {
        let link = &links[place];
        let axis = constant(graph, &link.joint.direction());
        let mut entry = |graph: &mut Graph, coordinate: Coordinate, along: &Vector| {
            let entry = dot(graph, &axis, along);
            // The entry of two joints stands on both sides of the diagonal, and on it where they share a coordinate.
            let once = place == index || coordinate != moving;
            let entry = if once { entry } else { graph.sum_of_wholes(&[entry, entry]) };
            entries.push((moving, coordinate, entry));
        };
        match &link.joint {
            Joint::Fixed => {}
            Joint::Revolute { coordinate, .. } => entry(graph, *coordinate, &moment),
            Joint::Prismatic { coordinate, .. } => {
                entry(graph, *coordinate, &force);
                let arm = displacement(graph, *coordinate, &axis);
                let lever = cross(graph, &arm, &force);
                moment = add(graph, &moment, &lever);
            }
        }
        let Some(parent) = link.parent else { return entries };
        force = steps[place].inward(graph, link, &force);
        moment = steps[place].inward(graph, link, &moment);
        let lever = cross(graph, &link.origin, &force);
        moment = add(graph, &moment, &lever);
        place = parent;
    }
}

fn displacement(graph: &mut Graph, coordinate: Coordinate, axis: &Vector) -> Vector {
    let position = graph.derivative_of(coordinate, 0);
    scale(graph, axis, position)
}

/// Transforms an inertia about the frame of a link to the frame of its parent.
fn inward(graph: &mut Graph, link: &Link, step: &Step, inertia: &[ExprId; 10]) -> [ExprId; 10] {
    let turned = match &link.joint {
        Joint::Prismatic { coordinate, .. } => {
            let axis = constant(graph, &link.joint.direction());
            let arm = displacement(graph, *coordinate, &axis);
            moved(graph, inertia, &arm, &Rotation::identity())
        }
        _ => step.turned_back(graph, inertia),
    };
    // The rotation between the frames comes first, then the translation, so that each entry of the rotated inertia is
    // one shared value.
    let nowhere = zero(graph);
    let turned = moved(graph, &turned, &nowhere, &link.rotation);
    moved(graph, &turned, &link.origin, &Rotation::identity())
}
