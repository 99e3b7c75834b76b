//! Equations, and energies by the Euler-Lagrange equations.
//!
//! With L = T - V, Rayleigh's dissipation function D and generalised forces Q,
//!
//! ```text
//! d/dt dT/dq' - dT/dq + dV/dq + dD/dq' = Q ,
//! ```
//!
//! one equation for each coordinate. The left side is linear in the energies, so it is taken term by term, and every term of an
//! equation keeps the place of the energy's term that it came from.

use tpm_symbolic::expr::{ExprId, Node};
use tpm_symbolic::model::{Equation, Kind, Model, SourceTerm};

use super::{Lower, Lowering};
use crate::language::ast::{self, EnergyKind, Expr, ExprKind, Item, Sign};
use crate::source::Span;

impl<'a> Lowering<'a, '_, '_> {
    pub(super) fn dynamics(&mut self, model: &'a ast::Model) {
        for item in &model.items {
            if let Item::Equation(equation) = item {
                let left = self.terms_of(&equation.left, Sign::Plus);
                let right = self.terms_of(&equation.right, Sign::Minus);
                if let (Some(mut terms), Some(right)) = (self.keep(left), self.keep(right)) {
                    let name = self.name(&terms, &right);
                    terms.extend(right);
                    self.model.equations.push(Equation { name, terms });
                }
            }
        }
        if model.items.iter().any(|item| matches!(item, Item::Energy(_))) {
            self.euler_lagrange(model);
        }
    }

    /// The name of the input that drives the equation, `eq1`, `eq2`, ... otherwise.
    fn name(&self, left: &[SourceTerm], right: &[SourceTerm]) -> String {
        let position = self.model.equations.len() + 1;
        let (right, left) = (inputs(&self.model, right), inputs(&self.model, left));
        match (right.as_slice(), left.as_slice()) {
            ([input], _) | ([], [input]) => input.clone(),
            _ => format!("eq{position}"),
        }
    }

    /// The terms of a side, each with its place; a side that is written as zero has none.
    fn terms_of(&mut self, expr: &Expr, side: Sign) -> Lower<Vec<SourceTerm>> {
        let mut terms = Vec::new();
        for (sign, term) in signed_terms(expr) {
            if term.is_zero() {
                continue;
            }
            let id = self.expression(term)?;
            let expr = if sign == side { id } else { self.model.graph.neg(id) };
            terms.push(SourceTerm { id: self.terms.add(term.span), expr });
        }
        Ok(terms)
    }

    fn euler_lagrange(&mut self, model: &'a ast::Model) {
        let mut energies: Vec<(EnergyKind, ExprId, Span)> = Vec::new();
        for item in &model.items {
            let Item::Energy(energy) = item else { continue };
            for (sign, term) in signed_terms(&energy.value) {
                let result = self.expression(term);
                if let Some(id) = self.keep(result) {
                    let id = if sign == Sign::Minus { self.model.graph.neg(id) } else { id };
                    energies.push((energy.kind, id, term.span));
                }
            }
        }
        for coordinate in 0..self.model.coordinates.len() {
            let name = self.model.coordinates[coordinate].name.clone();
            let mut terms = Vec::new();
            for &(kind, energy, span) in &energies {
                let expr = self.force_of(kind, energy, &name);
                if self.model.graph.as_number(expr).is_none_or(|value| !num_traits::Zero::is_zero(value)) {
                    terms.push(SourceTerm { id: self.terms.add(span), expr });
                }
            }
            let force = model.items.iter().find_map(|item| match item {
                Item::Force(force) if force.coordinate.name == name => Some(force),
                _ => None,
            });
            let result = force.map_or(Ok(Vec::new()), |force| self.terms_of(&force.value, Sign::Minus));
            if let Some(right) = self.keep(result) {
                let name = self.name(&terms, &right);
                terms.extend(right);
                self.model.equations.push(Equation { name, terms });
            }
        }
    }

    /// What an energy contributes to the left-hand side of a coordinate's equation.
    fn force_of(&mut self, kind: EnergyKind, energy: ExprId, coordinate: &str) -> ExprId {
        let Some(coordinate) = self.coordinate(coordinate) else { return energy };
        let graph = &mut self.model.graph;
        let (position, velocity) = (graph.derivative_of(coordinate, 0), graph.derivative_of(coordinate, 1));
        match kind {
            EnergyKind::Kinetic => {
                let momentum = graph.differentiate(energy, velocity);
                let inertia = graph.time_derivative(momentum);
                let slope = graph.differentiate(energy, position);
                graph.sub(inertia, slope)
            }
            EnergyKind::Potential => graph.differentiate(energy, position),
            EnergyKind::Dissipation => graph.differentiate(energy, velocity),
        }
    }
}

/// The terms of an expression with the signs they have, those of leading minus signs included.
fn signed_terms(expr: &Expr) -> Vec<(Sign, &Expr)> {
    expr.terms()
        .into_iter()
        .map(|(sign, term)| match (&term.kind, sign) {
            (ExprKind::Negative(inner), Sign::Plus) => (Sign::Minus, &**inner),
            (ExprKind::Negative(inner), Sign::Minus) => (Sign::Plus, &**inner),
            _ => (sign, term),
        })
        .collect()
}

/// The inputs in some terms, each once.
fn inputs(model: &Model, terms: &[SourceTerm]) -> Vec<String> {
    let mut names = Vec::new();
    for leaf in terms.iter().flat_map(|term| model.graph.leaves(term.expr)) {
        if let Node::Symbol(symbol) = model.graph.node(leaf) {
            let quantity = model.quantity(*symbol);
            if quantity.kind == Kind::Input && !names.contains(&quantity.name) {
                names.push(quantity.name.clone());
            }
        }
    }
    names
}
