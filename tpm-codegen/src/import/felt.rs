//! The inertia that a force at a joint has to move, and the weight that the joint holds, at one pose.
//!
//! All in the frame of the base: a joint moves what it carries by the 4 x 4 matrix S of its rate, its translation beside its rotation, and
//! with the pseudo-inertia J of what the outer one of two joints carries, the integral of (p, 1) (p, 1)' over the mass, the mass matrix
//! has the entries tr(S_i J S_j').

use std::array::from_fn;

use tpm_symbolic::number::rational::to_f64;

use crate::import::arrange::{Body, Moving, Robot, rotation_of};

/// Share of an entry of the diagonal below which a pivot is rounding.
const TINY: f64 = 1e-12;

type Square = [[f64; 4]; 4];

/// Inertia and weight that act on a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Felt {
    /// Force over acceleration while all other joints are free, kg m^2 or kg; the diagonal of the mass matrix where it is singular.
    pub(super) inertia: f64,
    /// Largest change of the weight's moment with the joint's angle, N m/rad; zero where nothing turns.
    pub(super) weight: f64,
}

/// What the joints of all bodies feel at these positions, of each with the joints that follow it; `None` for a body on a fixed joint, and on
/// one that follows another joint.
pub(super) fn felt(robot: &Robot, positions: &[f64]) -> Vec<Option<Felt>> {
    let bodies = &robot.bodies;
    let mut places: Vec<Square> = Vec::with_capacity(bodies.len());
    for (index, body) in bodies.iter().enumerate() {
        let (leader, factor) = leads(bodies, index);
        let own = place(body, factor * positions[leader]);
        places.push(body.parent.map_or(own, |parent| product(&places[parent], &own)));
    }
    let mut carried: Vec<Square> = bodies.iter().zip(&places).map(|(body, place)| moved(place, &own(body))).collect();
    // Every body comes after its parent.
    for (index, body) in bodies.iter().enumerate().rev() {
        if let Some(parent) = body.parent {
            let outer = carried[index];
            carried[parent].iter_mut().flatten().zip(outer.iter().flatten()).for_each(|(sum, entry)| *sum += entry);
        }
    }
    let moving: Vec<usize> = (0..bodies.len()).filter(|&index| bodies[index].moving.is_some()).collect();
    let rates: Vec<Square> = bodies.iter().zip(&places).map(|(body, place)| rate(body, place)).collect();
    let entry = |i: usize, j: usize| if carries(bodies, j, i) { entry(&rates[i], &carried[i], &rates[j]) } else { 0.0 };
    let rotor = |i: usize| bodies[i].moving.as_ref().map_or(0.0, |moving| to_f64(&moving.armature));
    let both = |i: usize, j: usize| entry(i.max(j), i.min(j)) + if i == j { rotor(i) } else { 0.0 };
    let leading: Vec<usize> = moving.iter().copied().filter(|&index| leads(bodies, index).0 == index).collect();
    let mut mass = vec![vec![0.0; leading.len()]; leading.len()];
    let row = |index: usize| leading.iter().position(|&leader| leader == index);
    for &i in &moving {
        for &j in &moving {
            let [(of_i, factor_i), (of_j, factor_j)] = [i, j].map(|index| leads(bodies, index));
            if let (Some(row), Some(column)) = (row(of_i), row(of_j)) {
                mass[row][column] += factor_i * factor_j * both(i, j);
            }
        }
    }
    let gravity = robot.gravity.each_ref().map(|component| to_f64(&component.value));
    let gravity = gravity.iter().map(|component| component * component).sum::<f64>().sqrt();
    let inertias = apparent(&mass);
    let turns = |index: usize| bodies[index].moving.as_ref().is_some_and(|moving| moving.turns);
    let mut found = vec![None; bodies.len()];
    for (&leader, inertia) in leading.iter().zip(inertias) {
        let own: Vec<usize> = moving.iter().copied().filter(|&index| leads(bodies, index).0 == leader).collect();
        let mut bends = 0.0;
        for &i in &own {
            for &j in &own {
                let (inner, outer) = (i.min(j), i.max(j));
                if carries(bodies, inner, outer) {
                    let size = (leads(bodies, i).1 * leads(bodies, j).1).abs();
                    bends += size * bend([inner, outer].map(turns), &carried[outer], &places[outer]);
                }
            }
        }
        found[leader] = Some(Felt { inertia, weight: gravity * bends });
    }
    found
}

/// The largest change of the outer joint's weight with the inner joint's position, over gravity: a joint that turns swings the centre of what
/// the outer one carries, or the direction in which that slides.
fn bend([inner_turns, outer_turns]: [bool; 2], carried: &Square, place: &Square) -> f64 {
    match (inner_turns, outer_turns) {
        (true, true) => first_moment(carried, place),
        (true, false) => carried[3][3],
        (false, _) => 0.0,
    }
}

/// The body whose joint moves the joint of a body, and the factor.
fn leads(bodies: &[Body], index: usize) -> (usize, f64) {
    let follows = bodies[index].moving.as_ref().and_then(|moving| moving.follows.as_ref());
    follows.map_or((index, 1.0), |(leader, factor)| (*leader, to_f64(factor)))
}

/// Whether a body is another one or carries it.
fn carries(bodies: &[Body], carrier: usize, mut index: usize) -> bool {
    while index > carrier {
        let Some(parent) = bodies[index].parent else { return false };
        index = parent;
    }
    index == carrier
}

/// The reciprocal diagonal of the inverse, by the Cholesky factor; the diagonal where there is none.
fn apparent(mass: &[Vec<f64>]) -> Vec<f64> {
    let n = mass.len();
    let diagonal = || (0..n).map(|i| mass[i][i]).collect();
    let mut root = vec![vec![0.0; n]; n];
    for i in 0..n {
        for j in 0..=i {
            let left = mass[i][j] - (0..j).map(|k| root[i][k] * root[j][k]).sum::<f64>();
            if i != j {
                root[i][j] = left / root[j][j];
            } else if left > TINY * mass[i][i] {
                root[i][i] = left.sqrt();
            } else {
                return diagonal();
            }
        }
    }
    let of = |column: usize| {
        let mut solved = vec![0.0; n];
        for i in column..n {
            let right = f64::from(u8::from(i == column));
            solved[i] = (right - (column..i).map(|k| root[i][k] * solved[k]).sum::<f64>()) / root[i][i];
        }
        1.0 / solved.iter().map(|entry| entry * entry).sum::<f64>()
    };
    (0..n).map(of).collect()
}

fn product(a: &Square, b: &Square) -> Square {
    from_fn(|i| from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

/// T J T'.
fn moved(place: &Square, pseudo: &Square) -> Square {
    product(&product(place, pseudo), &from_fn(|i| from_fn(|j| place[j][i])))
}

/// tr(A J B').
fn entry(a: &Square, pseudo: &Square, b: &Square) -> f64 {
    let left = product(a, pseudo);
    left.iter().flatten().zip(b.iter().flatten()).map(|(left, right)| left * right).sum()
}

/// The distance of the centre from the joint, times the mass.
fn first_moment(pseudo: &Square, place: &Square) -> f64 {
    (0..3).map(|i| (pseudo[i][3] - pseudo[3][3] * place[i][3]).powi(2)).sum::<f64>().sqrt()
}

/// The pseudo-inertia of a body about its frame.
fn own(body: &Body) -> Square {
    let Some(moving) = &body.moving else { return [[0.0; 4]; 4] };
    let [m, x, y, z, xx, xy, xz, yy, yz, zz] = moving.inertia.each_ref().map(to_f64);
    let half = (xx + yy + zz) / 2.0;
    [[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y], [-xz, -yz, half - zz, z], [x, y, z, m]]
}

/// The frame of a body in that of its parent.
fn place(body: &Body, position: f64) -> Square {
    let turned = rotation_of(&body.origin);
    let fixed: Square = from_fn(|i| {
        from_fn(|j| match (i, j) {
            (0..3, 0..3) => to_f64(turned.entry(i, j)),
            (0..3, _) => to_f64(&body.origin.at[i].value),
            _ => f64::from(u8::from(i == j)),
        })
    });
    body.moving.as_ref().map_or(fixed, |moving| product(&fixed, &displaced(moving, position)))
}

/// The frame behind a joint in the one before it.
fn displaced(moving: &Moving, position: f64) -> Square {
    let a = moving.direction.each_ref().map(to_f64);
    let (sine, cosine) = if moving.turns { position.sin_cos() } else { (0.0, 1.0) };
    let (cross, slide) = (cross(a), if moving.turns { 0.0 } else { position });
    from_fn(|i| {
        from_fn(|j| match (i, j) {
            // Rodrigues' formula.
            (0..3, 0..3) => f64::from(u8::from(i == j)) * cosine + cross[i][j] * sine + a[i] * a[j] * (1.0 - cosine),
            (0..3, _) => slide * a[i],
            _ => f64::from(u8::from(i == j)),
        })
    })
}

/// The matrix that gives the velocities of points from the rate of a body's joint; zero on a fixed joint.
fn rate(body: &Body, place: &Square) -> Square {
    let Some(moving) = &body.moving else { return [[0.0; 4]; 4] };
    let direction = moving.direction.each_ref().map(to_f64);
    let axis: [f64; 3] = from_fn(|i| (0..3).map(|k| place[i][k] * direction[k]).sum());
    let cross = cross(axis);
    from_fn(|i| {
        from_fn(|j| match (i, j, moving.turns) {
            (0..3, 0..3, true) => cross[i][j],
            (0..3, 3, true) => -(0..3).map(|k| cross[i][k] * place[k][3]).sum::<f64>(),
            (0..3, 3, false) => axis[i],
            _ => 0.0,
        })
    })
}

/// The matrix of the cross product with a vector.
fn cross([x, y, z]: [f64; 3]) -> [[f64; 3]; 3] {
    [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
}
