//! Vectors of expressions. Products with zeros and ones are simplified, and intermediate values are not flattened, so
//! that each is computed once.

use crate::expr::graph::{ExprId, Function, Graph};
use crate::mechanics::tree::rotation::{Rotation, frame_axis};
use crate::number::rational::Rational;

/// A vector in some frame.
pub type Vector = [ExprId; 3];

/// A sum of products of the two factors of each term.
pub(super) fn sum_of_products(graph: &mut Graph, terms: &[(ExprId, ExprId)]) -> ExprId {
    let products: Vec<ExprId> = terms.iter().map(|&(a, b)| graph.product_of_wholes(&[a, b])).collect();
    graph.sum_of_wholes(&products)
}

pub(super) fn zero(graph: &mut Graph) -> Vector {
    [graph.integer(0); 3]
}

pub(super) fn negated(graph: &mut Graph, value: ExprId) -> ExprId {
    let minus_one = graph.integer(-1);
    graph.product_of_wholes(&[minus_one, value])
}

pub(super) fn difference(graph: &mut Graph, a: ExprId, b: ExprId) -> ExprId {
    let minus = negated(graph, b);
    graph.sum_of_wholes(&[a, minus])
}

pub(super) fn add(graph: &mut Graph, a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|i| graph.sum_of_wholes(&[a[i], b[i]]))
}

pub(super) fn scale(graph: &mut Graph, a: &Vector, factor: ExprId) -> Vector {
    a.map(|component| graph.product_of_wholes(&[component, factor]))
}

pub(super) fn cross(graph: &mut Graph, a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let minus = negated(graph, a[k]);
        sum_of_products(graph, &[(a[j], b[k]), (minus, b[j])])
    })
}

pub(super) fn dot(graph: &mut Graph, a: &Vector, b: &Vector) -> ExprId {
    sum_of_products(graph, &[0, 1, 2].map(|i| (a[i], b[i])))
}

/// A matrix times a vector.
pub(super) fn times(graph: &mut Graph, matrix: &[Vector; 3], vector: &Vector) -> Vector {
    std::array::from_fn(|i| dot(graph, &matrix[i], vector))
}

/// A constant vector.
pub(super) fn constant(graph: &mut Graph, vector: &[Rational; 3]) -> Vector {
    std::array::from_fn(|i| graph.number(vector[i].clone()))
}

/// Components of a vector in the original frame, from those in the rotated frame.
pub(super) fn outward_in(graph: &mut Graph, rotation: &Rotation, vector: &Vector) -> Vector {
    std::array::from_fn(|i| {
        let terms = [0, 1, 2].map(|j| (graph.number(rotation.entry(i, j).clone()), vector[j]));
        sum_of_products(graph, &terms)
    })
}

/// The rotation of a revolute joint.
#[derive(Clone, Debug)]
pub(super) struct Turn {
    axis: [Rational; 3],
    cosine: ExprId,
    sine: ExprId,
}

impl Turn {
    pub(super) fn new(graph: &mut Graph, axis: &[Rational; 3], angle: ExprId) -> Self {
        let cosine = graph.function(Function::Cos, angle);
        let sine = graph.function(Function::Sin, angle);
        Self { axis: axis.clone(), cosine, sine }
    }

    /// Components in the rotated frame of a vector given in the frame before the joint.
    pub(super) fn forward(&self, graph: &mut Graph, vector: &Vector) -> Vector {
        let sine = negated(graph, self.sine);
        self.turned(graph, vector, sine)
    }

    /// Components in the frame before the joint of a vector given in the rotated frame.
    pub(super) fn backward(&self, graph: &mut Graph, vector: &Vector) -> Vector {
        self.turned(graph, vector, self.sine)
    }

    /// The ten parameters about the frame before the joint, from those about the rotated frame: R h and R I R^T.
    pub(super) fn inertia_backward(&self, graph: &mut Graph, inertia: &[ExprId; 10]) -> [ExprId; 10] {
        let [mass, x, y, z, xx, xy, xz, yy, yz, zz] = *inertia;
        let first = self.backward(graph, &[x, y, z]);
        let moments = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let turned = match frame_axis(&self.axis) {
            Some(k) => self.moments_about(graph, k, &moments),
            None => {
                // R I; its transpose is rotated in the next step.
                let columns = moments.map(|column| self.backward(graph, &column));
                let rows: [Vector; 3] = std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]));
                rows.map(|row| self.backward(graph, &row))
            }
        };
        let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = turned;
        [mass, first[0], first[1], first[2], xx, xy, xz, yy, yz, zz]
    }

    /// R I R^T for a rotation about axis k of the frame. With d = I_ii - I_jj and w = d sin q + 2 I_ij cos q, the
    /// rotated moments are I_ii - w sin q, I_jj + w sin q and w cos q - I_ij.
    fn moments_about(&self, graph: &mut Graph, k: usize, moments: &[Vector; 3]) -> [Vector; 3] {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let sign = graph.number(self.axis[k].clone());
        let sine = graph.product_of_wholes(&[sign, self.sine]);
        let two = graph.integer(2);
        let other = negated(graph, moments[j][j]);
        let difference = graph.sum_of_wholes(&[moments[i][i], other]);
        let twice = graph.product_of_wholes(&[two, moments[i][j]]);
        let spread = sum_of_products(graph, &[(difference, sine), (twice, self.cosine)]);
        let shift = graph.product_of_wholes(&[spread, sine]);
        let (minus_shift, minus_product) = (negated(graph, shift), negated(graph, moments[i][j]));
        let across = self.backward(graph, &moments[k]);
        let mut turned = *moments;
        turned[i][i] = graph.sum_of_wholes(&[moments[i][i], minus_shift]);
        turned[j][j] = graph.sum_of_wholes(&[moments[j][j], shift]);
        let cosine_part = graph.product_of_wholes(&[spread, self.cosine]);
        turned[i][j] = graph.sum_of_wholes(&[cosine_part, minus_product]);
        turned[j][i] = turned[i][j];
        for other in [i, j] {
            turned[k][other] = across[other];
            turned[other][k] = across[other];
        }
        turned
    }

    /// v cos q + (a x v) sin q + a (a.v) (1 - cos q), with a cheap form for the axes of the frame.
    fn turned(&self, graph: &mut Graph, vector: &Vector, sine: ExprId) -> Vector {
        if let Some(k) = frame_axis(&self.axis) {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let sign = graph.number(self.axis[k].clone());
            let sine = graph.product_of_wholes(&[sign, sine]);
            let minus = negated(graph, sine);
            let mut turned = *vector;
            turned[i] = sum_of_products(graph, &[(self.cosine, vector[i]), (minus, vector[j])]);
            turned[j] = sum_of_products(graph, &[(sine, vector[i]), (self.cosine, vector[j])]);
            return turned;
        }
        let axis = constant(graph, &self.axis);
        let (one, minus) = (graph.integer(1), negated(graph, self.cosine));
        let versine = graph.sum_of_wholes(&[one, minus]);
        let along = dot(graph, &axis, vector);
        let along = graph.product_of_wholes(&[along, versine]);
        let across = cross(graph, &axis, vector);
        std::array::from_fn(|i| {
            sum_of_products(graph, &[(self.cosine, vector[i]), (sine, across[i]), (axis[i], along)])
        })
    }
}
