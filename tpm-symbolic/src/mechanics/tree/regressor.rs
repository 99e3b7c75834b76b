//! The torque of every joint per unit of every inertia parameter.

use crate::expr::graph::{Coordinate, ExprId, Graph};
use crate::mechanics::tree::bodies::{Joint, Tree};
use crate::mechanics::tree::links::{Link, links};
use crate::mechanics::tree::motion::{Motion, Step, motions};
use crate::mechanics::tree::vector::{Vector, add, constant, cross, dot, scale, sum_of_products, zero};
use num_traits::Zero;

/// The torque of a coordinate per unit of an inertia parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// The index of the body.
    pub body: usize,
    /// The index of the parameter in [`NAMES`](crate::mechanics::tree::NAMES).
    pub parameter: usize,
    /// The entry of the regressor; never the number zero.
    pub expr: ExprId,
}

/// The torque of a coordinate: the sum of its entries times their parameters, plus the torque of the known inertias.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JointRow {
    /// The coordinate; the torque is a force where it moves a prismatic joint.
    pub coordinate: Coordinate,
    /// The entries of the unknown parameters, by body and parameter.
    pub entries: Vec<Entry>,
    /// The torque of the known inertias; the number zero where there are none.
    pub known: ExprId,
}

/// The velocity of a link's frame when one joint alone moves, at the rate that a unit rate of its coordinate gives it.
#[derive(Clone, Debug)]
struct Screw {
    /// The index of the link whose joint moves.
    joint: usize,
    angular: Vector,
    linear: Vector,
}

impl Tree {
    /// The rows of the coordinates that move joints, in the order of the bodies. Rows of joints that share a coordinate are added.
    pub fn regressor(&self, graph: &mut Graph) -> Vec<JointRow> {
        let links = links(graph, self);
        let (steps, motions) = motions(graph, self, &links);
        let screws = screws(graph, &links, &steps);
        let nothing = graph.integer(0);
        let mut rows: Vec<Option<JointRow>> = links
            .iter()
            .map(|link| {
                let coordinate = link.joint.coordinate()?;
                Some(JointRow { coordinate, entries: Vec::new(), known: nothing })
            })
            .collect();
        for ((link, motion), screws) in links.iter().zip(&motions).zip(&screws) {
            if link.unknown.is_none() && link.known.is_none() {
                continue;
            }
            let moments = motion.moments(graph);
            for screw in screws {
                let entries = entries(graph, motion, &moments, screw);
                let Some(row) = &mut rows[screw.joint] else { continue };
                if let Some(body) = link.unknown {
                    let present = (0..10).filter(|&k| !graph.as_number(entries[k]).is_some_and(Zero::is_zero));
                    row.entries.extend(present.map(|parameter| Entry { body, parameter, expr: entries[parameter] }));
                }
                if let Some(known) = &link.known {
                    let products: Vec<(ExprId, ExprId)> = known.iter().copied().zip(entries).collect();
                    let torque = sum_of_products(graph, &products);
                    row.known = graph.sum_of_wholes(&[row.known, torque]);
                }
            }
        }
        let mut found: Vec<JointRow> = Vec::new();
        for row in rows.into_iter().flatten() {
            match found.iter_mut().find(|known| known.coordinate == row.coordinate) {
                Some(sum) => sum.add(graph, row),
                None => found.push(row),
            }
        }
        found
    }
}

impl JointRow {
    /// Adds the row of another joint.
    fn add(&mut self, graph: &mut Graph, other: Self) {
        self.known = graph.sum_of_wholes(&[self.known, other.known]);
        for entry in other.entries {
            match self.entries.iter_mut().find(|own| (own.body, own.parameter) == (entry.body, entry.parameter)) {
                Some(own) => own.expr = graph.sum_of_wholes(&[own.expr, entry.expr]),
                None => self.entries.push(entry),
            }
        }
        self.entries.retain(|entry| !graph.as_number(entry.expr).is_some_and(Zero::is_zero));
        self.entries.sort_by_key(|entry| (entry.body, entry.parameter));
    }
}

/// The screws of all joints inward of each link, its own first where it moves.
fn screws(graph: &mut Graph, links: &[Link], steps: &[Step]) -> Vec<Vec<Screw>> {
    let mut all: Vec<Vec<Screw>> = Vec::with_capacity(links.len());
    for (index, (link, step)) in links.iter().zip(steps).enumerate() {
        let mut screws = Vec::new();
        let still = zero(graph);
        let direction = constant(graph, &link.joint.direction());
        match &link.joint {
            Joint::Fixed => {}
            Joint::Revolute { .. } => screws.push(Screw { joint: index, angular: direction, linear: still }),
            Joint::Prismatic { .. } => screws.push(Screw { joint: index, angular: still, linear: direction }),
        }
        let inward = link.parent.map_or(&[][..], |parent| &all[parent]);
        for screw in inward {
            let swept = cross(graph, &screw.angular, &link.origin);
            let linear = add(graph, &screw.linear, &swept);
            let angular = step.outward(graph, link, &screw.angular);
            let mut linear = step.outward(graph, link, &linear);
            if let Joint::Prismatic { coordinate, .. } = &link.joint {
                let position = graph.derivative_of(*coordinate, 0);
                let swept = cross(graph, &angular, &direction);
                let swept = scale(graph, &swept, position);
                linear = add(graph, &linear, &swept);
            }
            screws.push(Screw { joint: screw.joint, angular, linear });
        }
        all.push(screws);
    }
    all
}

/// The power of the wrench of each of the ten parameters along a screw.
fn entries(graph: &mut Graph, motion: &Motion, moments: &[Vector; 6], screw: &Screw) -> [ExprId; 10] {
    let Screw { angular, linear, .. } = screw;
    let moving = dot(graph, linear, &motion.acceleration);
    // s.(e_k x a) = (a x s)_k
    let lever = cross(graph, &motion.acceleration, angular);
    let first: Vector = std::array::from_fn(|k| {
        let pushed = sum_of_products(graph, &[0, 1, 2].map(|i| (linear[i], motion.field[i][k])));
        graph.sum_of_wholes(&[pushed, lever[k]])
    });
    let second = moments.map(|moment| dot(graph, angular, &moment));
    std::array::from_fn(|k| match k {
        0 => moving,
        1..4 => first[k - 1],
        _ => second[k - 4],
    })
}
