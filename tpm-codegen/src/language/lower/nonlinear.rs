//! Nonlinear parameters: run-time constants with an interval, and checks of whether they can be identified.

use std::collections::BTreeSet;

use tpm_symbolic::expr::graph::{ExprId, Function, Node};
use tpm_symbolic::mechanics::model::{Kind, Nonlinear};
use tpm_symbolic::number::rational;

use super::{Lowering, expression, formal};
use crate::diagnostic::Diagnostic;
use crate::language::ast::{Item, ModelDeclaration, NonlinearParameter};

impl<'a> Lowering<'a, '_, '_> {
    pub(super) fn declare_nonlinear(&mut self, parameter: &'a NonlinearParameter) {
        let name = parameter.name.name.as_str();
        let [from, to] = [&parameter.from, &parameter.to].map(|end| {
            let result = expression::exact(end, &self.values);
            self.keep(result)
        });
        let symbol = self.model.declare(name, parameter.unit.as_ref().map(formal), Kind::Constant { value: None });
        let expr = self.model.graph.symbol(symbol);
        self.names.insert(name, expr);
        let (Some(from), Some(to)) = (from, to) else { return };
        if from < to {
            self.model.nonlinear.push(Nonlinear { symbol, from, to });
        } else {
            let ends = [&from, &to].map(rational::display);
            let error = Diagnostic::error(
                parameter.from.span.to(parameter.to.span),
                format!("the interval from {} to {} is empty", ends[0], ends[1]),
            );
            self.diagnostics.push(error.help("the first end is the smaller one"));
        }
    }

    /// Reports nonlinear parameters that cannot be identified, and remarks on those in which the equations are linear.
    pub(super) fn check_nonlinear(&mut self, model: &ModelDeclaration) {
        let written = model.items.iter().flat_map(|item| match item {
            Item::Nonlinear(parameters) => parameters.as_slice(),
            _ => &[],
        });
        for parameter in written {
            let own = |own: &&Nonlinear| self.model.quantity(own.symbol).name == parameter.name.name;
            if let Some(own) = self.model.nonlinear.iter().find(own).cloned()
                && let Some(diagnostic) = self.fault_of(&own, parameter).or_else(|| self.remark_on(&own, parameter))
            {
                self.diagnostics.push(diagnostic);
            }
        }
    }

    /// The leaf of a nonlinear parameter, and the terms of the equations that contain it.
    fn terms_with(&mut self, own: &Nonlinear) -> (ExprId, Vec<ExprId>) {
        let leaf = self.model.graph.symbol(own.symbol);
        let terms = self.model.equations.iter().flat_map(|equation| &equation.terms).map(|term| term.expr);
        (leaf, terms.filter(|&term| self.model.graph.leaves(term).contains(&leaf)).collect())
    }

    fn fault_of(&mut self, own: &Nonlinear, written: &NonlinearParameter) -> Option<Diagnostic> {
        let (leaf, terms) = self.terms_with(own);
        let graph = &self.model.graph;
        let name = &written.name.name;
        let is_input = |leaf: &ExprId| matches!(graph.node(*leaf), Node::Symbol(symbol) if self.model.quantity(*symbol).kind == Kind::Input);
        if let Some(input) = terms.iter().flat_map(|&term| graph.leaves(term)).find(is_input) {
            let message = format!("`{name}` stands beside the input `{}`", self.model.display(input));
            return Some(Diagnostic::error(written.name.span, message).help(
                "the factor of an input is known: divide the equation by it, so that its inverse is a parameter",
            ));
        }
        let ends = [rational::to_f64(&own.from), rational::to_f64(&own.to)];
        // Values at both ends of the interval of an expression that depends on this parameter alone.
        let values = |part: ExprId| -> Option<[f64; 2]> {
            let alone = graph.leaves(part) == [leaf];
            alone.then(|| ends.map(|end| graph.evaluate(part, |_| end)))
        };
        let mut waiting = terms;
        let mut seen = BTreeSet::new();
        while let Some(part) = waiting.pop() {
            if !seen.insert(part) {
                continue;
            }
            waiting.extend(graph.operands(part));
            let singular = match *graph.node(part) {
                Node::Power(base, exponent) if exponent < 0 => {
                    values(base).filter(|[a, b]| a * b <= 0.0).map(|_| (base, "which is divided by, is zero"))
                }
                Node::Function(Function::Log | Function::Sqrt, argument) => values(argument)
                    .filter(|ends| ends.iter().any(|end| *end <= 0.0))
                    .map(|_| (argument, "of which a root or a logarithm is taken, is not positive")),
                Node::Function(Function::Sign, argument) if graph.leaves(argument).contains(&leaf) => {
                    let message = format!("`{name}` stands inside `sign({})`", self.model.display_short(argument));
                    return Some(
                        Diagnostic::error(written.name.span, message)
                            .note("the place of a jump has no derivative")
                            .help("use a smooth function, such as `tanh(x/d)` with a small constant d"),
                    );
                }
                _ => None,
            };
            if let Some((part, what)) = singular {
                let interval = written.from.span.to(written.to.span);
                let message = format!("`{}`, {what} within this interval", self.model.display_short(part));
                return Some(
                    Diagnostic::error(interval, message).help("choose an interval that keeps away from there"),
                );
            }
        }
        None
    }

    fn remark_on(&mut self, own: &Nonlinear, written: &NonlinearParameter) -> Option<Diagnostic> {
        let (leaf, terms) = self.terms_with(own);
        if terms.is_empty() {
            return None;
        }
        for term in terms {
            let slope = self.model.graph.differentiate(term, leaf);
            let unknown = |leaf: ExprId| match self.model.graph.node(leaf) {
                Node::Symbol(symbol) => {
                    self.model.quantity(*symbol).kind == Kind::Parameter
                        || self.model.nonlinear.iter().any(|own| own.symbol == *symbol)
                }
                _ => false,
            };
            if self.model.graph.leaves(slope).into_iter().any(unknown) {
                return None;
            }
        }
        let name = &written.name.name;
        let remark = Diagnostic::warning(written.name.span, format!("the equations are linear in `{name}`"));
        Some(remark.help(format!("declare it `parameter {name}`: it needs no interval and is found exactly")))
    }
}

#[cfg(test)]
mod tests {
    use crate::{Source, parse_model};

    /// The faults, or else the remarks, on a model with these declarations and this force.
    fn said(declaration: &str, force: &str) -> String {
        let text = format!(
            "model M {{ coordinate q [rad]; input u [N*m]; parameter J [kg*m^2], k [N*m]; {declaration} J*ddot(q) + {force} = u; }}"
        );
        let source = Source::new("m.tpm", text.as_str());
        match parse_model(&source) {
            Ok(parsed) => parsed.warnings.render(&source),
            Err(faults) => faults.render(&source),
        }
    }

    #[test]
    fn a_nonlinear_parameter_is_a_constant_with_an_interval() {
        let friction = "k*tanh(dot(q)/vs)";
        let text = "nonlinear parameter vs [rad/s] from 1/100 to 2*0.25;";
        assert_eq!(said(text, friction), "");
        let source = Source::new(
            "m.tpm",
            format!("model M {{ coordinate q; input u; parameter k; {text} k*tanh(dot(q)/vs) = u; }}"),
        );
        let parsed = parse_model(&source).expect("a model");
        assert_eq!(parsed.model.nonlinear.len(), 1);
        assert_eq!(parsed.model.known_constants().count(), 0);
        assert!(parsed.ast.to_string().contains("nonlinear parameter vs [rad/s] from 1/100 to 2*0.25;"));
    }

    #[test]
    fn faults_are_said_with_their_remedy() {
        let cases = [
            ("nonlinear parameter vs [rad/s];", "k*tanh(dot(q)/vs)", "`vs` has no interval"),
            ("nonlinear parameter vs [rad/s] from 2 to 1;", "k*tanh(dot(q)/vs)", "the interval from 2 to 1 is empty"),
            ("nonlinear parameter vs [rad/s] from -1 to 1;", "k*tanh(dot(q)/vs)", "`vs`, which is divided by, is zero"),
            ("nonlinear parameter z from -1 to 1;", "k*log(z)*q", "is not positive within this interval"),
            ("nonlinear parameter vs [m] from 1 to 2;", "k*tanh(dot(q)/vs)", "unit mismatch"),
            (
                "nonlinear parameter v0 [rad/s] from 1 to 2;",
                "k*sign(dot(q) - v0)",
                "the place of a jump has no derivative",
            ),
            ("nonlinear parameter z [N*m] from 1 to 2;", "z*sin(q) + k*cos(q)", "the equations are linear in `z`"),
            ("nonlinear parameter z from 1 to 2;", "k*sin(q) + u*z", "`z` stands beside the input `u`"),
            ("nonlinear parameter z from 1 to 2;", "k*sin(q)", "nonlinear parameter `z` is never used"),
        ];
        for (declaration, force, expected) in cases {
            let said = said(declaration, force);
            assert!(said.contains(expected), "{declaration} {force}: {said}");
        }
        assert_eq!(said("nonlinear parameter z from 1 to 2;", "k*sin(z*q)"), "");
        assert_eq!(said("nonlinear parameter z from 1 to 2;", "k*z*sin(q)"), "");
    }
}
