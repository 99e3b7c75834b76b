//! The torque of every joint by the recursion over wrenches, with the inertias in it.

use crate::expr::graph::{Coordinate, ExprId, Graph};
use crate::mechanics::tree::bodies::{Joint, Tree};
use crate::mechanics::tree::inertia::together;
use crate::mechanics::tree::links::links;
use crate::mechanics::tree::motion::{Motion, motions};
use crate::mechanics::tree::vector::{Vector, add, constant, cross, dot, scale, times, zero};

impl Tree {
    /// The torques of the moving joints (forces, where they are prismatic), in the order of the bodies, when `parameters` gives the
    /// ten parameters of every body of unknown inertia by its index. With numbers in the place of some derivatives of coordinates
    /// this is the torque of gravity, or a column of the mass matrix.
    pub fn torques(&self, graph: &mut Graph, parameters: impl Fn(usize) -> [ExprId; 10]) -> Vec<(Coordinate, ExprId)> {
        let links = links(graph, self);
        let (steps, motions) = motions(graph, self, &links);
        let none = zero(graph);
        let mut wrenches = vec![(none, none); links.len()];
        let mut torques = Vec::new();
        for index in (0..links.len()).rev() {
            let link = &links[index];
            let unknown = link.unknown.map(&parameters);
            let inertia = match (link.known, unknown) {
                (Some(known), Some(unknown)) => Some(together(graph, &known, &unknown)),
                (known, unknown) => known.or(unknown),
            };
            let (mut force, mut moment) = wrenches[index];
            if let Some(inertia) = inertia {
                let own = wrench(graph, &motions[index], &inertia);
                force = add(graph, &force, &own.0);
                moment = add(graph, &moment, &own.1);
            }
            match &link.joint {
                Joint::Fixed => {}
                Joint::Revolute { coordinate, axis } => {
                    let axis = constant(graph, axis);
                    torques.push((*coordinate, dot(graph, &axis, &moment)));
                }
                Joint::Prismatic { coordinate, axis } => {
                    let axis = constant(graph, axis);
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
        torques.reverse();
        torques
    }
}

/// Force and moment about the origin that move a body.
fn wrench(graph: &mut Graph, motion: &Motion, inertia: &[ExprId; 10]) -> (Vector, Vector) {
    let first: Vector = [inertia[1], inertia[2], inertia[3]];
    let pushed = scale(graph, &motion.acceleration, inertia[0]);
    let swung = times(graph, &motion.field, &first);
    let columns = motion.moments(graph);
    let turned: Vector = std::array::from_fn(|i| {
        let products: Vec<ExprId> = columns
            .iter()
            .zip(&inertia[4..])
            .map(|(column, &value)| graph.product_of_wholes(&[column[i], value]))
            .collect();
        graph.sum_of_wholes(&products)
    });
    let lever = cross(graph, &first, &motion.acceleration);
    (add(graph, &pushed, &swung), add(graph, &turned, &lever))
}
