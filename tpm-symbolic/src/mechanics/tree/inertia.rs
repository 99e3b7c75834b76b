//! The ten inertia parameters of a rigid body about a frame.

use crate::expr::graph::{ExprId, Graph};
use crate::mechanics::tree::rotation::Rotation;
use crate::mechanics::tree::vector::{Vector, difference, dot, outward_in, sum_of_products};
use crate::number::rational::{Rational, integer};
use num_traits::{Signed, Zero};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The parameters of a body, in order.
pub const NAMES: [&str; 10] = ["m", "mx", "my", "mz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"];

/// Rows and columns of the moments of inertia, in the order of [`NAMES`].
pub(super) const MOMENTS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Inertia of a body.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Inertia {
    /// A frame without mass.
    None,
    /// The ten parameters have these values, in the order of [`NAMES`]: expressions that do not depend on the motion.
    Known([ExprId; 10]),
    /// The ten parameters are unknown.
    Unknown,
}

/// The ten parameters about the origin of a frame, from the mass, the centre of mass in that frame and the moments of inertia
/// (xx, xy, xz, yy, yz, zz) about the centre of mass along axes turned by `rotation` against the frame.
pub fn about_origin(
    graph: &mut Graph,
    mass: ExprId,
    centre: &Vector,
    moments: &[ExprId; 6],
    rotation: &Rotation,
) -> [ExprId; 10] {
    let zero = graph.integer(0);
    let about_centre: [ExprId; 10] = std::array::from_fn(|k| {
        if k == 0 {
            mass
        } else if k < 4 {
            zero
        } else {
            moments[k - 4]
        }
    });
    moved(graph, &about_centre, centre, rotation)
}

/// The parameters about a frame from those about another frame that is placed in it by an origin and a rotation:
/// h' = R h + m r, I' = R I R^T + 2 (r.Rh) 1 - r (Rh)^T - (Rh) r^T + m (r.r 1 - r r^T).
pub(super) fn moved(graph: &mut Graph, inertia: &[ExprId; 10], origin: &Vector, rotation: &Rotation) -> [ExprId; 10] {
    let mass = inertia[0];
    let turned = outward_in(graph, rotation, &[inertia[1], inertia[2], inertia[3]]);
    let centre: Vector = std::array::from_fn(|i| sum_of_products_with(graph, turned[i], &[(mass, origin[i])]));
    let twice = {
        let product = dot(graph, origin, &turned);
        graph.scale(product, integer(2))
    };
    let square = dot(graph, origin, origin);
    let moments = MOMENTS.map(|(i, j)| {
        let mut terms = Vec::new();
        for (k, &(a, b)) in MOMENTS.iter().enumerate() {
            let mut factor = rotation.entry(i, a) * rotation.entry(j, b);
            if a != b {
                factor += rotation.entry(i, b) * rotation.entry(j, a);
            }
            terms.push((graph.number(factor), inertia[4 + k]));
        }
        let minus = graph.neg(origin[i]);
        terms.push((minus, turned[j]));
        let minus = graph.neg(origin[j]);
        terms.push((minus, turned[i]));
        let minus = graph.product(&[minus, origin[i]]);
        terms.push((minus, mass));
        if i == j {
            let one = graph.integer(1);
            terms.push((one, twice));
            terms.push((square, mass));
        }
        sum_of_products(graph, &terms)
    });
    std::array::from_fn(|k| {
        if k == 0 {
            mass
        } else if k < 4 {
            centre[k - 1]
        } else {
            moments[k - 4]
        }
    })
}

/// A value plus a sum of products.
fn sum_of_products_with(graph: &mut Graph, value: ExprId, terms: &[(ExprId, ExprId)]) -> ExprId {
    let products = sum_of_products(graph, terms);
    graph.sum_of_wholes(&[value, products])
}

/// The sum of two bodies' parameters about one frame.
pub(super) fn together(graph: &mut Graph, a: &[ExprId; 10], b: &[ExprId; 10]) -> [ExprId; 10] {
    std::array::from_fn(|k| graph.sum_of_wholes(&[a[k], b[k]]))
}

/// Splits the parameters of a body into those of two bodies about the same frame: the part that depends on rotation
/// about an axis of the frame, and masses on that axis. With the other axes i and j, the second part consists of the
/// mass, the first moment along the axis, and I_jj as the moment about both i and j; I_ii - I_jj remains in the first.
/// Where I_ii or I_jj is zero the moments of inertia are not split.
pub(super) fn parted(graph: &mut Graph, inertia: &[ExprId; 10], axis: usize) -> ([ExprId; 10], [ExprId; 10]) {
    let zero = graph.integer(0);
    let (i, j) = [(7, 9), (4, 9), (4, 7)][axis];
    let (mut kept, mut on_axis) = (*inertia, [zero; 10]);
    for place in [0, 1 + axis] {
        on_axis[place] = inertia[place];
        kept[place] = zero;
    }
    if inertia[i] != zero && inertia[j] != zero {
        on_axis[i] = inertia[j];
        on_axis[j] = inertia[j];
        kept[i] = difference(graph, inertia[i], inertia[j]);
        kept[j] = zero;
    }
    (kept, on_axis)
}

/// Why no body can have an inertia.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum InertiaFault {
    /// The mass is negative.
    #[error("the mass is negative")]
    Mass,
    /// There is a moment of inertia without mass.
    #[error("there are moments of inertia without mass")]
    Massless,
    /// A moment of inertia about some axis is negative.
    #[error("the moment of inertia about some axis is negative")]
    Moment,
    /// A principal moment of inertia exceeds the sum of the two others.
    #[error("a principal moment of inertia exceeds the sum of the two others")]
    Triangle,
}

/// Why no body has this mass and these moments of inertia (xx, xy, xz, yy, yz, zz) about its centre of mass; `None` when some
/// distribution of mass has them. The integral of p p^T over the mass is tr(I)/2 1 - I, which must have no negative eigenvalue.
#[must_use]
pub fn fault(mass: &Rational, moments: &[Rational; 6]) -> Option<InertiaFault> {
    if mass.is_negative() {
        return Some(InertiaFault::Mass);
    }
    if mass.is_zero() {
        return moments.iter().any(|moment| !moment.is_zero()).then_some(InertiaFault::Massless);
    }
    if !is_semidefinite(moments) {
        return Some(InertiaFault::Moment);
    }
    let [xx, xy, xz, yy, yz, zz] = moments;
    let half = (xx + yy + zz) / integer(2);
    let spread = [&half - xx, -xy.clone(), -xz.clone(), &half - yy, -yz.clone(), &half - zz];
    (!is_semidefinite(&spread)).then_some(InertiaFault::Triangle)
}

/// Whether a symmetric matrix (xx, xy, xz, yy, yz, zz) has no negative eigenvalue: no principal minor is negative.
fn is_semidefinite(matrix: &[Rational; 6]) -> bool {
    let [xx, xy, xz, yy, yz, zz] = matrix;
    let minors = [xx * yy - xy * xy, xx * zz - xz * xz, yy * zz - yz * yz];
    let determinant = xx * &minors[2] - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    [xx, yy, zz, &determinant].into_iter().chain(&minors).all(|minor| !minor.is_negative())
}

#[cfg(test)]
mod tests {
    use super::{InertiaFault, fault};
    use crate::number::rational::integer;

    #[test]
    fn only_inertias_of_bodies_are_possible() {
        let of = |mass: i64, moments: [i64; 6]| fault(&integer(mass), &moments.map(integer));
        assert_eq!(of(1, [2, 0, 0, 2, 0, 3]), None);
        // A thin plate and a point mass are limiting cases.
        assert_eq!(of(1, [1, 0, 0, 1, 0, 2]), None);
        assert_eq!(of(1, [0; 6]), None);
        assert_eq!(of(1, [1, 0, 0, 1, 0, 3]), Some(InertiaFault::Triangle));
        assert_eq!(of(1, [2, 3, 0, 2, 0, 2]), Some(InertiaFault::Moment));
        assert_eq!(of(-1, [2, 0, 0, 2, 0, 2]), Some(InertiaFault::Mass));
        assert_eq!(of(0, [2, 0, 0, 2, 0, 2]), Some(InertiaFault::Massless));
    }
}
