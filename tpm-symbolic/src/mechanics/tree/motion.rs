//! Velocities and accelerations of the links, from the base outward, each in the frame of its link.

use crate::expr::graph::{ExprId, Graph};
use crate::mechanics::tree::bodies::{Joint, Tree};
use crate::mechanics::tree::links::Link;
use crate::mechanics::tree::vector::{
    Turn, Vector, add, constant, cross, difference, negated, outward_in, scale, sum_of_products, times, zero,
};
use crate::number::rational::integer;
use num_traits::One;

/// Motion of a link.
#[derive(Clone, Debug)]
pub(super) struct Motion {
    /// Angular velocity.
    pub(super) velocity: Vector,
    /// Angular acceleration.
    pub(super) turning: Vector,
    /// Acceleration of the origin, gravity subtracted.
    pub(super) acceleration: Vector,
    /// U = [e]x + [w]x [w]x: the acceleration of the point p is a + U p.
    pub(super) field: [Vector; 3],
    /// w_x^2 - w_y^2, w_y^2 - w_z^2, w_z^2 - w_x^2.
    differences: Vector,
    /// w_y w_z, w_z w_x, w_x w_y.
    products: Vector,
}

impl Motion {
    fn new(graph: &mut Graph, velocity: Vector, turning: Vector, acceleration: Vector) -> Self {
        let (squares, products) = second_powers(graph, &velocity);
        let mut field = [[velocity[0]; 3]; 3];
        // Entries symmetric about the diagonal are computed together.
        #[expect(clippy::needless_range_loop, reason = "rows i and j are written in one turn")]
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let sum = graph.sum_of_wholes(&[squares[j], squares[k]]);
            field[i][i] = negated(graph, sum);
            let minus = negated(graph, turning[k]);
            field[i][j] = graph.sum_of_wholes(&[products[k], minus]);
            field[j][i] = graph.sum_of_wholes(&[products[k], turning[k]]);
        }
        let differences = differences(graph, &squares);
        Self { velocity, turning, acceleration, field, differences, products }
    }

    /// The motion of a link that rotates about axis k of its own frame relative to the link that carries it. Points on
    /// the axis have the same motion on both links, so that U e_k, given in the link's frame, is known from the
    /// carrying link, and with it two components of the angular acceleration.
    fn about(
        graph: &mut Graph,
        k: usize,
        velocity: Vector,
        turning_about: ExprId,
        along: &Vector,
        acceleration: Vector,
    ) -> Self {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let (squares, products) = second_powers(graph, &velocity);
        let mut turning = [turning_about; 3];
        turning[i] = difference(graph, products[i], along[j]);
        turning[j] = difference(graph, along[i], products[j]);
        let mut field = [*along; 3];
        for (row, &component) in field.iter_mut().zip(along) {
            row[k] = component;
        }
        field[k][i] = difference(graph, products[j], turning[j]);
        field[k][j] = graph.sum_of_wholes(&[products[i], turning[i]]);
        field[i][j] = difference(graph, products[k], turning[k]);
        field[j][i] = graph.sum_of_wholes(&[products[k], turning[k]]);
        let sum = graph.sum_of_wholes(&[squares[i], squares[k]]);
        field[j][j] = negated(graph, sum);
        let mut differences = differences(graph, &squares);
        if [i, j].iter().all(|&other| graph.as_number(velocity[other]).is_none()) {
            // U_kk is minus the sum of the squares i and j, so that the square j is not needed.
            field[i][i] = difference(graph, along[k], differences[k]);
            differences[j] = difference(graph, field[j][j], along[k]);
            let sum = graph.sum_of_wholes(&[differences[j], differences[k]]);
            differences[i] = negated(graph, sum);
        } else {
            let sum = graph.sum_of_wholes(&[squares[j], squares[k]]);
            field[i][i] = negated(graph, sum);
        }
        Self { velocity, turning, acceleration, field, differences, products }
    }

    /// The moments per unit of the moments of inertia, columns of I e + w x I w in the order xx, xy, xz, yy, yz, zz.
    pub(super) fn moments(&self, graph: &mut Graph) -> [Vector; 6] {
        let [yz, zx, xy] = self.products;
        let [minus_yz, minus_zx, minus_xy] = self.products.map(|product| negated(graph, product));
        let [x_y, y_z, z_x] = self.differences;
        let negative = |graph: &mut Graph, i: usize, j: usize| negated(graph, self.field[i][j]);
        [
            [self.turning[0], zx, minus_xy],
            [negative(graph, 2, 0), self.field[2][1], x_y],
            [self.field[1][0], z_x, negative(graph, 1, 2)],
            [minus_yz, self.turning[1], xy],
            [y_z, negative(graph, 0, 1), self.field[0][2]],
            [yz, minus_zx, self.turning[2]],
        ]
    }

    /// The moment I e + w x I w, where the moments of inertia are the entries of `inertia` from index 4.
    pub(super) fn moment(&self, graph: &mut Graph, inertia: &[ExprId; 10]) -> Vector {
        let diagonal = [inertia[4], inertia[7], inertia[9]];
        let columns = self.moments(graph);
        std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let spread = difference(graph, diagonal[k], diagonal[j]);
            let products = [
                (self.turning[i], diagonal[i]),
                (self.products[i], spread),
                (columns[1][i], inertia[5]),
                (columns[2][i], inertia[6]),
                (columns[4][i], inertia[8]),
            ];
            sum_of_products(graph, &products)
        })
    }
}

/// Squares of the components of an angular velocity, and w_y w_z, w_z w_x, w_x w_y.
fn second_powers(graph: &mut Graph, velocity: &Vector) -> (Vector, Vector) {
    let squares = velocity.map(|component| graph.product_of_wholes(&[component, component]));
    let products = std::array::from_fn(|i| graph.product_of_wholes(&[velocity[(i + 1) % 3], velocity[(i + 2) % 3]]));
    (squares, products)
}

/// The differences of the squares x and y, y and z, z and x.
fn differences(graph: &mut Graph, squares: &Vector) -> Vector {
    std::array::from_fn(|i| difference(graph, squares[i], squares[(i + 1) % 3]))
}

/// Transformation of vectors from the parent's frame by a joint.
#[derive(Clone, Debug)]
pub(super) struct Step {
    turn: Option<Turn>,
}

impl Step {
    fn new(graph: &mut Graph, link: &Link) -> Self {
        let turn = match &link.joint {
            Joint::Revolute { coordinate, axis, factor } => {
                let coordinate = graph.derivative_of(*coordinate, 0);
                let angle = if factor.is_one() { coordinate } else { graph.scale(coordinate, factor.clone()) };
                Some(Turn::new(graph, axis, angle))
            }
            _ => None,
        };
        Self { turn }
    }

    /// The ten parameters about the frame before the joint, from those about the rotated frame.
    pub(super) fn turned_back(&self, graph: &mut Graph, inertia: &[ExprId; 10]) -> [ExprId; 10] {
        match &self.turn {
            Some(turn) => turn.inertia_backward(graph, inertia),
            None => *inertia,
        }
    }

    /// Components in the frame of the link of a vector given in the parent's frame.
    pub(super) fn outward(&self, graph: &mut Graph, link: &Link, vector: &Vector) -> Vector {
        let vector = outward_in(graph, &link.rotation.transposed(), vector);
        match &self.turn {
            Some(turn) => turn.forward(graph, &vector),
            None => vector,
        }
    }

    /// Components in the parent's frame of a vector given in the frame of the link.
    pub(super) fn inward(&self, graph: &mut Graph, link: &Link, vector: &Vector) -> Vector {
        let vector = match &self.turn {
            Some(turn) => turn.backward(graph, vector),
            None => *vector,
        };
        outward_in(graph, &link.rotation, &vector)
    }
}

/// The joint transformations of all links.
pub(super) fn steps(graph: &mut Graph, links: &[Link]) -> Vec<Step> {
    links.iter().map(|link| Step::new(graph, link)).collect()
}

/// The joint transformations and the motions of all links.
pub(super) fn motions(graph: &mut Graph, tree: &Tree, links: &[Link]) -> (Vec<Step>, Vec<Motion>) {
    let rest = {
        let still = zero(graph);
        let minus_one = graph.integer(-1);
        let acceleration = scale(graph, &tree.gravity, minus_one);
        Motion::new(graph, still, still, acceleration)
    };
    let mut steps: Vec<Step> = Vec::with_capacity(links.len());
    let mut motions: Vec<Motion> = Vec::with_capacity(links.len());
    for link in links {
        let step = Step::new(graph, link);
        let parent = link.parent.map_or(&rest, |parent| &motions[parent]);
        let motion = carried(graph, link, &step, parent);
        steps.push(step);
        motions.push(motion);
    }
    (steps, motions)
}

/// The motion of a link from that of the link that carries it.
fn carried(graph: &mut Graph, link: &Link, step: &Step, parent: &Motion) -> Motion {
    let velocity = step.outward(graph, link, &parent.velocity);
    let lever = times(graph, &parent.field, &link.origin);
    let acceleration = add(graph, &parent.acceleration, &lever);
    let acceleration = step.outward(graph, link, &acceleration);
    let rates = |graph: &mut Graph, coordinate| -> [ExprId; 3] {
        [0, 1, 2].map(|order| graph.derivative_of(coordinate, order))
    };
    match &link.joint {
        Joint::Fixed => {
            let turning = step.outward(graph, link, &parent.turning);
            Motion::new(graph, velocity, turning, acceleration)
        }
        Joint::Revolute { coordinate, .. } => {
            let direction = link.joint.direction();
            let [_, rate, second] = rates(graph, *coordinate);
            let turning = step.outward(graph, link, &parent.turning);
            if let Some(k) = link.shared_axis() {
                let per_rate = graph.number(direction[k].clone());
                let [own, own_turning] = [rate, second].map(|rate| graph.product_of_wholes(&[per_rate, rate]));
                let shared = constant(graph, &[0, 1, 2].map(|row| link.rotation.entry(row, k).clone()));
                let along = times(graph, &parent.field, &shared);
                let along = step.outward(graph, link, &along);
                let turning = graph.sum_of_wholes(&[turning[k], own_turning]);
                let mut velocity = velocity;
                velocity[k] = graph.sum_of_wholes(&[velocity[k], own]);
                return Motion::about(graph, k, velocity, turning, &along, acceleration);
            }
            let direction = constant(graph, &direction);
            let [own, own_turning] = [rate, second].map(|rate| scale(graph, &direction, rate));
            let gyration = cross(graph, &velocity, &own);
            let turning = std::array::from_fn(|i| graph.sum_of_wholes(&[turning[i], own_turning[i], gyration[i]]));
            let velocity = add(graph, &velocity, &own);
            Motion::new(graph, velocity, turning, acceleration)
        }
        Joint::Prismatic { coordinate, .. } => {
            let [position, rate, second] = rates(graph, *coordinate);
            let turning = step.outward(graph, link, &parent.turning);
            let axis = constant(graph, &link.joint.direction());
            let mut motion = Motion::new(graph, velocity, turning, acceleration);
            let lever = times(graph, &motion.field, &axis);
            let swept = cross(graph, &velocity, &axis);
            let twice = graph.scale(rate, integer(2));
            motion.acceleration = std::array::from_fn(|i| {
                let own = sum_of_products(graph, &[(lever[i], position), (swept[i], twice), (axis[i], second)]);
                graph.sum_of_wholes(&[acceleration[i], own])
            });
            motion
        }
    }
}
