//! Lowers equations, and energies by the Euler-Lagrange equations.
//!
//! Invariant: every term of an equation has the place of the term of the text that it came from, also when it was derived from
//! an energy ([`tpm_symbolic::mechanics::lagrange`]).

use std::collections::BTreeSet;

use tpm_symbolic::expr::graph::Node;
use tpm_symbolic::expr::size::Sizes;
use tpm_symbolic::mechanics::lagrange::{self, Lagrangian};
use tpm_symbolic::mechanics::model::{Equation, ExactModel, Kind, SourceTerm};

use super::expression::{Lower, MOST_TERMS};
use super::{Lowering, too_long};
use crate::diagnostic::Diagnostic;
use crate::language::ast::{self, EnergyKind, Expr, ExprKind, Item, Sign};

impl<'a> Lowering<'a, '_, '_> {
    pub(super) fn dynamics(&mut self, model: &'a ast::ModelDeclaration) {
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
        } else if self.mechanism.is_some() {
            self.forces_on_joints(model);
        }
    }

    /// Adds the forces of the model to the equations of its mechanism.
    fn forces_on_joints(&mut self, model: &'a ast::ModelDeclaration) {
        for item in &model.items {
            let Item::Force(force) = item else { continue };
            let result = self.terms_of(&force.value, Sign::Minus);
            let (Some(forces), Some(coordinate)) = (self.keep(result), self.coordinate(&force.coordinate.name)) else {
                continue;
            };
            let row = coordinate.0 as usize;
            let driven = inputs(&self.model, &self.model.equations[row].terms);
            let names: Vec<String> =
                driven.into_iter().chain(inputs(&self.model, &forces)).collect::<BTreeSet<_>>().into_iter().collect();
            let equation = &mut self.model.equations[row];
            equation.terms.extend(forces);
            equation.name = match names.as_slice() {
                [input] => input.clone(),
                _ => format!("eq{}", row + 1),
            };
        }
    }

    /// The name of the single input that drives the equation; `eq1`, `eq2`, ... when there is no input, or several.
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

    /// The equations of motion that follow from the energies and forces.
    fn euler_lagrange(&mut self, model: &'a ast::ModelDeclaration) {
        let mut lagrangian = Lagrangian::default();
        for item in &model.items {
            match item {
                Item::Energy(energy) => {
                    let result = self.terms_of(&energy.value, Sign::Plus);
                    let terms = self.keep(result).unwrap_or_default();
                    let mut sizes = Sizes::default();
                    for term in &terms {
                        if sizes.of(&self.model.graph, term.expr) > MOST_TERMS {
                            let fault = too_long(self.terms.span(term.id), "the equations of motion of this energy");
                            let help = "write the equations themselves, with `let` for what they share";
                            self.diagnostics.push(fault.help(help));
                        }
                    }
                    match energy.kind {
                        EnergyKind::Kinetic => lagrangian.kinetic = terms,
                        EnergyKind::Potential => lagrangian.potential = terms,
                        EnergyKind::Dissipation => lagrangian.dissipation = terms,
                    }
                }
                Item::Force(force) => {
                    let result = self.terms_of(&force.value, Sign::Plus);
                    if let (Some(terms), Some(coordinate)) =
                        (self.keep(result), self.coordinate(&force.coordinate.name))
                    {
                        lagrangian.forces.extend(terms.into_iter().map(|term| (coordinate, term)));
                    }
                }
                _ => {}
            }
        }
        if self.diagnostics.has_errors() {
            return;
        }
        match lagrange::euler_lagrange(&mut self.model, &lagrangian) {
            Ok(derived) => self.model.equations = derived.equations,
            Err(error) => {
                let span = error.term().map_or(model.name.span, |term| self.terms.span(term));
                self.diagnostics.push(Diagnostic::error(span, error.to_string()));
            }
        }
    }
}

/// The terms of an expression with their signs, leading minus signs included.
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
fn inputs(model: &ExactModel, terms: &[SourceTerm]) -> Vec<String> {
    let mut names = Vec::new();
    for leaf in terms.iter().flat_map(|term| model.graph.leaves(term.expr)) {
        if let Node::Symbol(symbol) = model.graph.node(leaf) {
            let quantity = model.quantity(*symbol);
            if quantity.kind == Kind::Input && !names.iter().any(|name| *name == quantity.name) {
                names.push(quantity.name.to_string());
            }
        }
    }
    names
}
