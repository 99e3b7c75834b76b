//! A tree of named bodies with the drives of its joints: equations of motion that are linear in named parameters.

use crate::expr::graph::{Coordinate, ExprId, Function, Symbol};
use crate::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
use crate::mechanics::tree::bodies::{Joint, Tree};
use crate::mechanics::tree::inertia::{Inertia, NAMES};
use crate::mechanics::tree::regressor::JointRow;
use crate::mechanics::unit::Unit;
use crate::number::rational::Rational;
use num_rational::Ratio;
use num_traits::{One, Zero};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A torque of a drive with an unknown parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Loss {
    /// Friction proportional to the rate.
    Viscous,
    /// Dry friction, a constant torque with the sign of the rate.
    Coulomb,
    /// A constant torque, such as the zero offset of a sensor.
    Offset,
    /// The inertia of a rotor, referred to the rate of the drive.
    Rotor,
    /// Dry friction in proportion to the load: the torque that the bodies ask for with the inertias near which theirs are said to be, so that
    /// the friction is linear in its parameter.
    Load,
}

impl Loss {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Viscous, Self::Coulomb, Self::Offset, Self::Rotor, Self::Load];

    /// The parameter's name without the name of its drive.
    #[must_use]
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Viscous => "fv",
            Self::Coulomb => "fc",
            Self::Offset => "f0",
            Self::Rotor => "Ia",
            Self::Load => "fl",
        }
    }

    /// The parameter's unit, for a joint that rotates or slides.
    #[must_use]
    pub fn unit(self, turns: bool) -> Unit {
        let torque = if turns { named(&[("N", 1), ("m", 1)]) } else { Unit::named("N") };
        match self {
            Self::Viscous => torque.mul(&if turns { Unit::named("s") } else { named(&[("s", 1), ("m", -1)]) }),
            Self::Coulomb | Self::Offset => torque,
            Self::Load => Unit::one(),
            Self::Rotor => {
                if turns {
                    named(&[("kg", 1), ("m", 2)])
                } else {
                    Unit::named("kg")
                }
            }
        }
    }
}

/// The drive of a constant combination of joints, with its losses: the motor of one joint, or a motor that is coupled
/// to several.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Drive {
    /// The name, which ends the names of the drive's parameters.
    pub name: String,
    /// The position of the drive as a combination of coordinates: each with its factor.
    pub moves: Vec<(Coordinate, Rational)>,
    /// The torque of the motor, when it is an input.
    pub input: Option<Symbol>,
    /// The unknown torques.
    pub losses: Vec<Loss>,
    /// Place of the drive in the source.
    pub term: TermId,
}

/// A body's name and its place in the source.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Label {
    /// The name, which ends the names of the body's parameters.
    pub name: String,
    /// Place of the body in the source.
    pub term: TermId,
}

/// A tree with the names of its bodies, and the drives of its joints.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mechanism {
    /// The bodies.
    pub tree: Tree,
    /// The name of every body.
    pub labels: Vec<Label>,
    /// The ten parameters near which those of every body are said to be; nothing where nothing is said.
    #[serde(default)]
    pub near: Vec<Option<Vec<Rational>>>,
    /// The drives.
    pub drives: Vec<Drive>,
}

/// The name of a parameter of a body or of a drive: `m_forearm`, `fv_elbow`.
#[must_use]
pub fn parameter_name(symbol: &str, owner: &str) -> String {
    format!("{symbol}_{owner}")
}

/// The unit of an inertia parameter, by its index in [`NAMES`].
#[must_use]
pub fn inertia_unit(parameter: usize) -> Unit {
    match parameter {
        0 => Unit::named("kg"),
        1..4 => named(&[("kg", 1), ("m", 1)]),
        _ => named(&[("kg", 1), ("m", 2)]),
    }
}

fn named(factors: &[(&str, i32)]) -> Unit {
    Unit::product(factors.iter().map(|(name, power)| (*name, Ratio::from_integer(i64::from(*power)))))
}

impl Mechanism {
    /// The equations of motion, one for each coordinate that a joint moves, in the order of the coordinates. Every term but the
    /// known ones is a parameter times an expression, and no parameter has two terms in one equation. The parameters are declared
    /// in the model; a parameter of an inertia that enters no equation, such as Ixx of a body that turns about its z axis only,
    /// is not declared.
    pub fn equations(&self, model: &mut ExactModel) -> Vec<Equation> {
        let mut rows = self.tree.regressor(&mut model.graph);
        rows.sort_by_key(|row| row.coordinate);
        let inertias = self.declare_inertias(model, &rows);
        let mut terms: Vec<Vec<SourceTerm>> = Vec::with_capacity(rows.len());
        let mut inertial = Vec::with_capacity(rows.len());
        let mut loads = Vec::with_capacity(rows.len());
        for row in &rows {
            loads.push(self.load(model, row));
            let mut row_terms = Vec::new();
            for entry in &row.entries {
                let parameter = inertias[&(entry.body, entry.parameter)];
                let expr = model.graph.product_of_wholes(&[parameter, entry.expr]);
                row_terms.push(SourceTerm { id: self.labels[entry.body].term, expr });
            }
            if let Some(id) = self.known_term()
                && !model.graph.as_number(row.known).is_some_and(Zero::is_zero)
            {
                row_terms.push(SourceTerm { id, expr: row.known });
            }
            inertial.push(row_terms.len());
            terms.push(row_terms);
        }
        for drive in &self.drives {
            self.drive(model, (&rows, &loads), drive, &mut terms);
        }
        let rows = terms.into_iter().zip(inertial).enumerate();
        let named = rows.map(|(index, (terms, inertial))| {
            // The terms of the inertias contain no input.
            Equation { name: model.equation_name(&terms[inertial..], index), terms }
        });
        named.collect()
    }

    /// The torque of a joint with the inertias near which those of the bodies are said to be.
    fn load(&self, model: &mut ExactModel, row: &JointRow) -> ExprId {
        let mut parts = vec![row.known];
        for entry in &row.entries {
            let near = self.near.get(entry.body).and_then(Option::as_ref).and_then(|near| near.get(entry.parameter));
            if let Some(value) = near.filter(|value| !value.is_zero()) {
                parts.push(model.graph.scale(entry.expr, value.clone()));
            }
        }
        model.graph.sum(&parts)
    }

    /// Declares the parameters that enter some equation, body by body.
    fn declare_inertias(&self, model: &mut ExactModel, rows: &[JointRow]) -> BTreeMap<(usize, usize), ExprId> {
        let mut inertias = BTreeMap::new();
        for entry in rows.iter().flat_map(|row| &row.entries) {
            inertias.insert((entry.body, entry.parameter), entry.expr);
        }
        for (&(body, parameter), expr) in &mut inertias {
            let name = parameter_name(NAMES[parameter], &self.labels[body].name);
            let symbol = model.declare(&name, Some(inertia_unit(parameter)), Kind::Parameter);
            *expr = model.graph.symbol(symbol);
        }
        inertias
    }

    /// The source term to which the torques of known inertias are assigned: the first body that has one.
    fn known_term(&self) -> Option<TermId> {
        let bodies = self.tree.bodies().iter().zip(&self.labels);
        bodies.filter(|(body, _)| matches!(body.inertia, Inertia::Known(_))).map(|(_, label)| label.term).next()
    }

    /// Adds the torques of a drive to the joints that it moves: the power of the drive equals that of the joints.
    fn drive(
        &self,
        model: &mut ExactModel,
        (rows, loads): (&[JointRow], &[ExprId]),
        drive: &Drive,
        terms: &mut [Vec<SourceTerm>],
    ) {
        let rate = |model: &mut ExactModel, order: u32| {
            let parts: Vec<ExprId> = drive
                .moves
                .iter()
                .map(|(coordinate, factor)| {
                    let derivative = model.graph.derivative_of(*coordinate, order);
                    model.graph.scale(derivative, factor.clone())
                })
                .collect();
            model.graph.sum(&parts)
        };
        let turns = drive.moves.iter().all(|(coordinate, _)| self.turns(*coordinate));
        let mut torques = Vec::new();
        for &loss in &drive.losses {
            let factor = match loss {
                Loss::Viscous => rate(model, 1),
                Loss::Coulomb => {
                    let rate = rate(model, 1);
                    model.graph.function(Function::Sign, rate)
                }
                Loss::Offset => model.graph.integer(1),
                Loss::Rotor => rate(model, 2),
                Loss::Load => {
                    let own = |(coordinate, factor): &(Coordinate, Rational)| {
                        let row = rows.iter().position(|row| row.coordinate == *coordinate)?;
                        Some((loads[row], factor.recip()))
                    };
                    let parts: Vec<(ExprId, Rational)> = drive.moves.iter().filter_map(own).collect();
                    let parts: Vec<ExprId> =
                        parts.into_iter().map(|(load, share)| model.graph.scale(load, share)).collect();
                    let load = model.graph.sum(&parts);
                    let size = model.graph.function(Function::Abs, load);
                    let rate = rate(model, 1);
                    let sign = model.graph.function(Function::Sign, rate);
                    model.graph.product_of_wholes(&[size, sign])
                }
            };
            let name = parameter_name(loss.symbol(), &drive.name);
            let symbol = model.declare(&name, Some(loss.unit(turns)), Kind::Parameter);
            let parameter = model.graph.symbol(symbol);
            torques.push(model.graph.product_of_wholes(&[parameter, factor]));
        }
        if let Some(input) = drive.input {
            let input = model.graph.symbol(input);
            torques.push(model.graph.neg(input));
        }
        for (coordinate, factor) in &drive.moves {
            let Some(row) = rows.iter().position(|row| row.coordinate == *coordinate) else { continue };
            let factor = model.graph.number(factor.clone());
            for &torque in &torques {
                let expr = model.graph.product_of_wholes(&[factor, torque]);
                terms[row].push(SourceTerm { id: drive.term, expr });
            }
        }
    }

    /// Whether a coordinate is an angle: where joints share it, the one that it moves as it is says so.
    fn turns(&self, coordinate: Coordinate) -> bool {
        let mut joints =
            self.tree.bodies().iter().map(|body| &body.joint).filter(|joint| joint.coordinate() == Some(coordinate));
        let leads = |joint: &&Joint| match joint {
            Joint::Fixed => false,
            Joint::Revolute { factor, .. } | Joint::Prismatic { factor, .. } => factor.is_one(),
        };
        let joint = joints.clone().find(leads).or_else(|| joints.next());
        !matches!(joint, Some(Joint::Prismatic { .. }))
    }
}
