//! Euler-Lagrange equations.
//!
//! With the kinetic energy T(q, q') at most quadratic in the velocities, the potential energy V(q), a dissipation
//! function R(q, q') and generalised forces Q, the equations of motion are
//!
//! ```text
//! d/dt dT/dq'_i - dT/dq_i + dV/dq_i + dR/dq'_i = Q_i
//! M(q) q'' + C(q, q') q' + G(q) + dR/dq' = Q
//! ```
//!
//! where M = d^2 T / dq' dq' is the mass matrix, C holds the Christoffel symbols of M (so that M' - 2 C is
//! antisymmetric) and the gyroscopic terms of a part of T linear in q', and G = d(V - T_0)/dq with T_0 the part of T
//! without velocities. For quadratic dissipation dR/dq' = D q', and C + D is the matrix V_m of Fong, Eqns 2 and 3.
//!
//! Every term of an equation keeps the [`TermId`] of the energy term from which it was derived.

use crate::expr::graph::{Coordinate, ExprId, Node};
use crate::expr::trigonometric;
use crate::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
use crate::number::rational::{self, Rational};
use num_traits::Zero;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use thiserror::Error;

/// A mechanical system by its energies; each is a sum of terms as written.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lagrangian {
    /// Kinetic energy.
    pub kinetic: Vec<SourceTerm>,
    /// Potential energy.
    pub potential: Vec<SourceTerm>,
    /// Rayleigh's dissipation function: its derivative by a velocity is the resisting force.
    pub dissipation: Vec<SourceTerm>,
    /// Generalised forces, each with the coordinate on which it acts.
    pub forces: Vec<(Coordinate, SourceTerm)>,
}

/// The equations of motion and their parts. Rows and columns are the model's coordinates, in order of declaration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EulerLagrange {
    /// One equation per coordinate: left minus right-hand side.
    pub equations: Vec<Equation>,
    /// The mass matrix M(q).
    pub mass: Vec<Vec<ExprId>>,
    /// The matrix C(q, q') of Coriolis, centrifugal and gyroscopic terms.
    pub coriolis: Vec<Vec<ExprId>>,
    /// The dissipative forces dR/dq'.
    pub dissipation: Vec<ExprId>,
    /// The damping matrix D(q) with dR/dq' = D q', when the dissipation is quadratic in the velocities.
    pub damping: Option<Vec<Vec<ExprId>>>,
    /// The vector G(q) = d(V - T_0)/dq.
    pub gravity: Vec<ExprId>,
    /// The generalised forces Q.
    pub forces: Vec<ExprId>,
}

/// Why energies give no equations of motion.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LagrangeError {
    /// An energy depends on a derivative that it must not depend on.
    #[error("the {energy} energy must not depend on `{found}`: it is a function of {allowed}")]
    Argument {
        /// The source term at fault.
        term: TermId,
        /// The name of the energy.
        energy: &'static str,
        /// The derivative that was found.
        found: String,
        /// The arguments that the energy may have.
        allowed: &'static str,
    },
    /// The kinetic energy is of higher than second degree in the velocities.
    #[error("the kinetic energy `{found}` is not of second degree in the velocities")]
    NotQuadratic {
        /// The source term at fault.
        term: TermId,
        /// The term as it was found.
        found: String,
    },
    /// An input stands in an energy.
    #[error("the input `{input}` stands in an energy; give it as a generalised force")]
    InputInEnergy {
        /// The source term at fault.
        term: TermId,
        /// The input.
        input: String,
    },
    /// A coordinate occurs in no energy and no force.
    #[error("no energy or force depends on the coordinate `{coordinate}`, so it has no equation of motion")]
    NoEquation {
        /// The coordinate.
        coordinate: String,
    },
}

impl LagrangeError {
    /// The source term at fault, when there is one.
    #[must_use]
    pub fn term(&self) -> Option<TermId> {
        match self {
            Self::Argument { term, .. } | Self::NotQuadratic { term, .. } | Self::InputInEnergy { term, .. } => {
                Some(*term)
            }
            Self::NoEquation { .. } => None,
        }
    }
}

/// Derives the equations of motion. The model's own `equations` are not changed; the caller replaces them.
///
/// # Errors
/// When an energy has arguments that it must not have, the kinetic energy is not quadratic in the velocities, or a
/// coordinate occurs nowhere; the source term is named.
pub fn euler_lagrange(model: &mut ExactModel, lagrangian: &Lagrangian) -> Result<EulerLagrange, LagrangeError> {
    check_arguments(model, "kinetic", &lagrangian.kinetic, 1)?;
    check_arguments(model, "potential", &lagrangian.potential, 0)?;
    check_arguments(model, "dissipation", &lagrangian.dissipation, 1)?;
    // Coordinates that follow from others have no equations, and stand behind those that have.
    let n = model.coordinates.iter().take_while(|coordinate| coordinate.presliding.is_none()).count();
    let coordinates: Vec<Coordinate> = (0u32..).take(n).map(Coordinate).collect();
    let leaves = |model: &mut ExactModel, order: u32| -> Vec<ExprId> {
        coordinates.iter().map(|&c| model.graph.derivative_of(c, order)).collect()
    };
    let (positions, velocities) = (leaves(model, 0), leaves(model, 1));

    // The terms of every equation: from the energies, then from the generalised forces.
    let mut terms: Vec<Vec<SourceTerm>> = vec![Vec::new(); n];
    for source in &lagrangian.kinetic {
        check_quadratic(model, source, &velocities)?;
        for i in 0..n {
            let momentum = model.graph.differentiate(source.expr, velocities[i]);
            let rate = model.graph.time_derivative(momentum);
            let slope = model.graph.differentiate(source.expr, positions[i]);
            let expr = model.graph.sub(rate, slope);
            push(model, &mut terms[i], source.id, expr);
        }
    }
    for (sources, leaves) in [(&lagrangian.potential, &positions), (&lagrangian.dissipation, &velocities)] {
        for source in sources {
            for i in 0..n {
                let slope = model.graph.differentiate(source.expr, leaves[i]);
                push(model, &mut terms[i], source.id, slope);
            }
        }
    }
    let mut forces = vec![model.graph.integer(0); n];
    for (coordinate, source) in &lagrangian.forces {
        let i = coordinate.0 as usize;
        forces[i] = model.graph.add(forces[i], source.expr);
        let expr = model.graph.neg(source.expr);
        push(model, &mut terms[i], source.id, expr);
    }
    let mut equations = Vec::with_capacity(n);
    for (i, terms) in terms.into_iter().enumerate() {
        if terms.is_empty() {
            return Err(LagrangeError::NoEquation { coordinate: model.coordinates[i].name.clone() });
        }
        equations.push(Equation { name: model.equation_name(&terms, i), terms });
    }

    // The matrices and vectors of the equations.
    let total = |model: &mut ExactModel, sources: &[SourceTerm]| {
        let exprs: Vec<ExprId> = sources.iter().map(|source| source.expr).collect();
        model.graph.sum(&exprs)
    };
    let kinetic = total(model, &lagrangian.kinetic);
    let potential = total(model, &lagrangian.potential);
    let resisting = total(model, &lagrangian.dissipation);
    let zero = model.graph.integer(0);
    let at_rest: HashMap<ExprId, ExprId> = velocities.iter().map(|&velocity| (velocity, zero)).collect();

    let mass = hessian(model, kinetic, &velocities);
    // T = T_2 + b(q) . q' + T_0
    let mut linear = Vec::with_capacity(n);
    for &velocity in &velocities {
        let momentum = model.graph.differentiate(kinetic, velocity);
        linear.push(model.graph.substitute(momentum, &at_rest));
    }
    let resting = model.graph.substitute(kinetic, &at_rest);
    let effective = model.graph.sub(potential, resting);
    let gravity = positions.iter().map(|&position| model.graph.differentiate(effective, position)).collect();
    let coriolis = christoffel(model, &mass, &linear, &positions, &velocities);
    let dissipation: Vec<ExprId> =
        velocities.iter().map(|&velocity| model.graph.differentiate(resisting, velocity)).collect();
    let damping = hessian(model, resisting, &velocities);
    let is_linear = depends_only_on(model, &damping, &positions)
        && dissipation.iter().zip(&damping).all(|(force, row)| {
            let products: Vec<ExprId> =
                row.iter().zip(&velocities).map(|(&entry, &velocity)| model.graph.mul(entry, velocity)).collect();
            let linear = model.graph.sum(&products);
            let difference = model.graph.sub(*force, linear);
            trigonometric::is_zero(&mut model.graph, difference)
        });
    Ok(EulerLagrange { equations, mass, coriolis, dissipation, damping: is_linear.then_some(damping), gravity, forces })
}

impl EulerLagrange {
    /// M q'' + C q' + dR/dq' + G - Q, row by row; equal to the equations as functions.
    pub fn residual(&self, model: &mut ExactModel) -> Vec<ExprId> {
        let mut rows = Vec::with_capacity(self.mass.len());
        for i in 0..self.mass.len() {
            let mut parts = vec![self.dissipation[i], self.gravity[i], model.graph.neg(self.forces[i])];
            for (c, (&mass, &coriolis)) in (0u32..).zip(self.mass[i].iter().zip(&self.coriolis[i])) {
                let velocity = model.graph.derivative_of(Coordinate(c), 1);
                let acceleration = model.graph.derivative_of(Coordinate(c), 2);
                parts.push(model.graph.mul(mass, acceleration));
                parts.push(model.graph.mul(coriolis, velocity));
            }
            rows.push(model.graph.sum(&parts));
        }
        rows
    }
}

fn push(model: &ExactModel, terms: &mut Vec<SourceTerm>, id: TermId, expr: ExprId) {
    if !model.graph.as_number(expr).is_some_and(Zero::is_zero) {
        terms.push(SourceTerm { id, expr });
    }
}

fn check_arguments(
    model: &ExactModel,
    energy: &'static str,
    terms: &[SourceTerm],
    highest: u32,
) -> Result<(), LagrangeError> {
    for source in terms {
        for leaf in model.graph.leaves(source.expr) {
            match *model.graph.node(leaf) {
                Node::Derivative(_, order) if order > highest => {
                    let allowed = if highest == 0 { "the coordinates" } else { "coordinates and velocities" };
                    let found = model.display_brief(leaf);
                    return Err(LagrangeError::Argument { term: source.id, energy, found, allowed });
                }
                Node::Symbol(symbol) if model.quantity(symbol).kind == Kind::Input => {
                    return Err(LagrangeError::InputInEnergy { term: source.id, input: model.display_brief(leaf) });
                }
                _ => {}
            }
        }
    }
    Ok(())
}

/// The second derivatives by the velocities must not depend on the velocities.
fn check_quadratic(model: &mut ExactModel, source: &SourceTerm, velocities: &[ExprId]) -> Result<(), LagrangeError> {
    for (i, &left) in velocities.iter().enumerate() {
        let first = model.graph.differentiate(source.expr, left);
        for (j, &middle) in velocities.iter().enumerate().skip(i) {
            let second = model.graph.differentiate(first, middle);
            for &right in &velocities[j..] {
                let third = model.graph.differentiate(second, right);
                if !trigonometric::is_zero(&mut model.graph, third) {
                    return Err(LagrangeError::NotQuadratic {
                        term: source.id,
                        found: model.display_brief(source.expr),
                    });
                }
            }
        }
    }
    Ok(())
}

fn hessian(model: &mut ExactModel, expr: ExprId, variables: &[ExprId]) -> Vec<Vec<ExprId>> {
    let mut rows = Vec::with_capacity(variables.len());
    for &left in variables {
        let slope = model.graph.differentiate(expr, left);
        rows.push(variables.iter().map(|&right| model.graph.differentiate(slope, right)).collect());
    }
    rows
}

fn depends_only_on(model: &ExactModel, matrix: &[Vec<ExprId>], positions: &[ExprId]) -> bool {
    matrix
        .iter()
        .flatten()
        .flat_map(|&entry| model.graph.leaves(entry))
        .all(|leaf| positions.contains(&leaf) || !matches!(model.graph.node(leaf), Node::Derivative(..)))
}

/// C_ij = 1/2 sum_k (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) q'_k + db_i/dq_j - db_j/dq_i.
fn christoffel(
    model: &mut ExactModel,
    mass: &[Vec<ExprId>],
    linear: &[ExprId],
    positions: &[ExprId],
    velocities: &[ExprId],
) -> Vec<Vec<ExprId>> {
    let n = mass.len();
    let graph = &mut model.graph;
    let half: Rational = rational::ratio(1, 2);
    let mut rows = Vec::with_capacity(n);
    for i in 0..n {
        let mut row = Vec::with_capacity(n);
        for j in 0..n {
            let mut parts = Vec::with_capacity(n + 2);
            for k in 0..n {
                let plus = graph.differentiate(mass[i][j], positions[k]);
                let also = graph.differentiate(mass[i][k], positions[j]);
                let minus = graph.differentiate(mass[j][k], positions[i]);
                let minus = graph.neg(minus);
                let sum = graph.sum(&[plus, also, minus]);
                let product = graph.mul(sum, velocities[k]);
                parts.push(graph.scale(product, half.clone()));
            }
            let plus = graph.differentiate(linear[i], positions[j]);
            let minus = graph.differentiate(linear[j], positions[i]);
            parts.push(plus);
            parts.push(graph.neg(minus));
            row.push(graph.sum(&parts));
        }
        rows.push(row);
    }
    rows
}
