//! Lowers expressions to nodes of the graph.

use std::collections::HashMap;

use num_traits::{One, Signed, Zero};
use tpm_symbolic::expr::graph::{self, ExprId, Graph, Node};
use tpm_symbolic::expr::size::multiset;
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::number::rational::Rational;

use crate::diagnostic::Diagnostic;
use crate::language::ast::{Expr, ExprKind, Ident, Operation, Sign};
use crate::language::function::Function;
use crate::source::Span;

/// Highest order of a derivative, a series or a Taylor polynomial. It is far above any use; without a bound a text of
/// ten bytes could ask for a billion derivatives.
pub const HIGHEST_ORDER: u32 = 100;

/// Longest number, in bits, that an expression may have as its value. It is far beyond any float, and short enough that
/// `10^1000000000` is refused before it is computed.
const LONGEST_NUMBER: u64 = 1 << 17;

/// Highest exponent of a base that is not a number.
const HIGHEST_EXPONENT: u32 = 1000;

/// Most terms of a power, or of an expression that a later stage multiplies out.
pub(super) const MOST_TERMS: f64 = 100_000.0;

/// Result of lowering a part of the text; a fault removes the statement that contains the part.
pub(super) type Lower<T> = Result<T, Diagnostic>;

/// The graph with the names that an expression may use.
pub(super) struct Environment<'e, 'a> {
    pub(super) model: &'e mut ExactModel,
    pub(super) names: &'e HashMap<&'a str, ExprId>,
}

impl Environment<'_, '_> {
    pub(super) fn lower(&mut self, expr: &Expr) -> Lower<ExprId> {
        let id = match &expr.kind {
            ExprKind::Number(value) => self.model.graph.number(value.clone()),
            ExprKind::Name(name) if name == "pi" => self.model.graph.pi(),
            ExprKind::Name(name) => match self.names.get(name.as_str()) {
                Some(&id) => id,
                // The definition of the name could not be lowered, which is reported there.
                None => {
                    return Err(Diagnostic::error(expr.span, format!("`{name}` has no value here"))
                        .help("correct its definition"));
                }
            },
            ExprKind::Negative(inner) => {
                let inner = self.lower(inner)?;
                self.model.graph.neg(inner)
            }
            ExprKind::Sum(terms) => {
                let mut lowered = Vec::with_capacity(terms.len());
                for (sign, term) in terms {
                    let id = self.lower(term)?;
                    lowered.push(if *sign == Sign::Minus { self.model.graph.neg(id) } else { id });
                }
                self.model.graph.sum(&lowered)
            }
            ExprKind::Product(factors) => {
                let mut lowered = Vec::with_capacity(factors.len());
                let mut bits = 0;
                for (operation, factor) in factors {
                    let id = self.lower(factor)?;
                    bits += self.bits(id);
                    within(bits, expr.span)?;
                    lowered.push(if *operation == Operation::Over { self.inverse(id, factor.span)? } else { id });
                }
                self.model.graph.product(&lowered)
            }
            ExprKind::Power(base, exponent) => {
                let id = self.lower(base)?;
                within(self.bits(id).saturating_mul(u64::from(*exponent)), expr.span)?;
                let Ok(exponent) = i32::try_from(*exponent) else { return Err(too_large(expr.span)) };
                self.model.graph.pow(id, exponent)
            }
            ExprKind::Call(function, arguments) => self.call(function, arguments, expr.span)?,
        };
        within(self.bits(id), expr.span)?;
        // Factors that are powers of one base are collected.
        let graph = &self.model.graph;
        let powers = match graph.node(id) {
            Node::Product(factors) => factors.as_slice(),
            _ => std::slice::from_ref(&id),
        };
        if powers.iter().any(|&power| is_huge_power(graph, power)) {
            return Err(too_large(expr.span));
        }
        Ok(id)
    }

    /// The length of a node that is a number, in bits; 0 for every other node.
    fn bits(&self, id: ExprId) -> u64 {
        self.model.graph.as_number(id).map_or(0, length)
    }

    fn inverse(&mut self, id: ExprId, span: Span) -> Lower<ExprId> {
        if self.model.graph.as_number(id).is_some_and(Zero::is_zero) {
            return Err(Diagnostic::error(span, "a division by zero").help("this divisor is identically 0"));
        }
        if self.model.has_known_constants() && self.model.graph.vanishes(id, |leaf| self.model.known_value(leaf)) {
            return Err(Diagnostic::error(span, "a division by zero")
                .help("this divisor is 0 at the values of the model's constants"));
        }
        Ok(self.model.graph.pow(id, -1))
    }

    fn call(&mut self, name: &Ident, arguments: &[Expr], span: Span) -> Lower<ExprId> {
        let simple = match (Function::from_name(&name.name), arguments) {
            (Some(Function::Dot), [moving]) => return self.time_derivative(moving, 1, span),
            (Some(Function::Ddot), [moving]) => return self.time_derivative(moving, 2, span),
            (Some(Function::Der), [moving, order]) => {
                let order = order.integer().filter(|&order| order <= HIGHEST_ORDER).ok_or_else(|| {
                    Diagnostic::error(order.span, format!("a derivative has an order of at most {HIGHEST_ORDER}"))
                        .help("lower it")
                })?;
                return self.time_derivative(moving, order, span);
            }
            (Some(Function::Diff), [of, by]) => {
                let (of, by) = (self.lower(of)?, self.lower(by)?);
                return Ok(self.model.graph.differentiate(of, by));
            }
            (Some(Function::Atan2), [y, x]) => {
                let (y_id, x_id) = (self.lower(y)?, self.lower(x)?);
                let zero = |id| self.model.graph.as_number(id).is_some_and(Zero::is_zero);
                if zero(y_id) && zero(x_id) {
                    return Err(Diagnostic::error(span, "the point (0, 0) has no angle")
                        .help("one of the arguments must not be 0"));
                }
                return Ok(self.model.graph.atan2(y_id, x_id));
            }
            (Some(Function::Sin), [_]) => graph::Function::Sin,
            (Some(Function::Cos), [_]) => graph::Function::Cos,
            (Some(Function::Tan), [_]) => graph::Function::Tan,
            (Some(Function::Asin), [_]) => graph::Function::Asin,
            (Some(Function::Acos), [_]) => graph::Function::Acos,
            (Some(Function::Sqrt), [_]) => graph::Function::Sqrt,
            (Some(Function::Tanh), [_]) => graph::Function::Tanh,
            (Some(Function::Exp), [_]) => graph::Function::Exp,
            (Some(Function::Log), [_]) => graph::Function::Log,
            (Some(Function::Abs), [_]) => graph::Function::Abs,
            (Some(Function::Sign), [_]) => graph::Function::Sign,
            // All other faults are reported by the checks.
            _ => {
                return Err(Diagnostic::error(span, format!("`{}` cannot stand here", name.name))
                    .help("use a function of the language"));
            }
        };
        let argument = self.lower(&arguments[0])?;
        if let Some(value) = self.model.graph.as_number(argument) {
            let outside = match simple {
                graph::Function::Sqrt => value.is_negative(),
                graph::Function::Log => !value.is_positive(),
                graph::Function::Asin | graph::Function::Acos => value.abs() > Rational::one(),
                _ => false,
            };
            if outside {
                return Err(Diagnostic::error(
                    arguments[0].span,
                    format!("`{}` of {value} is no real number", name.name),
                )
                .help("check the sign and size of this argument"));
            }
        }
        Ok(self.model.graph.function(simple, argument))
    }

    fn time_derivative(&mut self, expr: &Expr, order: u32, span: Span) -> Lower<ExprId> {
        let mut id = self.lower(expr)?;
        for leaf in self.model.graph.leaves(id) {
            if let Node::Symbol(symbol) = self.model.graph.node(leaf)
                && self.model.quantity(*symbol).kind == Kind::Input
            {
                let name = &self.model.quantity(*symbol).name;
                return Err(Diagnostic::error(expr.span, format!("the input `{name}` has no time derivative here"))
                    .help("a quantity with dynamics of its own is a coordinate: declare it with `coordinate`"));
            }
        }
        if let Some(highest) = self.highest(id)
            && highest.checked_add(order).is_none_or(|sum| sum > HIGHEST_ORDER)
        {
            return Err(Diagnostic::error(span, format!("a derivative has an order of at most {HIGHEST_ORDER}"))
                .help("lower it"));
        }
        for _ in 0..order {
            id = self.model.graph.time_derivative(id);
        }
        Ok(id)
    }

    /// The highest derivative of a coordinate in an expression.
    fn highest(&self, id: ExprId) -> Option<u32> {
        let graph = &self.model.graph;
        graph
            .leaves(id)
            .into_iter()
            .filter_map(|leaf| if let Node::Derivative(_, order) = graph.node(leaf) { Some(*order) } else { None })
            .max()
    }
}

/// Requires an expression to have a value: no division by zero, no root of a negative number, no
/// logarithm of a number that is not positive, no angle of the origin.
pub(super) fn regular(model: &ExactModel, id: ExprId, span: Span) -> Lower<()> {
    let graph = &model.graph;
    let mut open = vec![id];
    let mut seen = std::collections::HashSet::new();
    while let Some(id) = open.pop() {
        if !seen.insert(id) {
            continue;
        }
        let number = |id: ExprId| graph.as_number(id);
        let singular = match graph.node(id) {
            Node::Power(base, exponent) => *exponent < 0 && number(*base).is_some_and(Zero::is_zero),
            Node::Function(graph::Function::Sqrt, argument) => number(*argument).is_some_and(Signed::is_negative),
            Node::Function(graph::Function::Log, argument) => {
                number(*argument).is_some_and(|value| !value.is_positive())
            }
            Node::Function(graph::Function::Asin | graph::Function::Acos, argument) => {
                number(*argument).is_some_and(|value| value.abs() > Rational::one())
            }
            Node::Atan2(y, x) => [y, x].into_iter().all(|&id| number(id).is_some_and(Zero::is_zero)),
            _ => false,
        };
        if singular {
            return Err(Diagnostic::error(
                span,
                "this function, or a derivative of it, is singular at the point of expansion",
            ));
        }
        open.extend(graph.operands(id));
    }
    Ok(())
}

/// Whether a power has an exponent so high, or a lower bound of its number of terms so large, that it is certainly a
/// mistake.
fn is_huge_power(graph: &Graph, id: ExprId) -> bool {
    let Node::Power(base, exponent) = *graph.node(id) else { return false };
    let terms = if let Node::Sum(terms) = graph.node(base) { terms.len() } else { 1 };
    exponent.unsigned_abs() > HIGHEST_EXPONENT || multiset(terms as f64, exponent) > MOST_TERMS
}

fn length(value: &Rational) -> u64 {
    value.numer().bits().max(value.denom().bits())
}

fn within(bits: u64, span: Span) -> Lower<()> {
    if bits > LONGEST_NUMBER { Err(too_large(span)) } else { Ok(()) }
}

fn too_large(span: Span) -> Diagnostic {
    Diagnostic::error(span, "this power or product is too large to be meant").help("lower the exponents")
}

/// The value of an expression of numbers and constants with a value.
pub(super) fn exact(expr: &Expr, values: &HashMap<&str, Rational>) -> Lower<Rational> {
    let value = match &expr.kind {
        ExprKind::Number(value) => value.clone(),
        ExprKind::Name(name) => match values.get(name.as_str()) {
            Some(value) => value.clone(),
            None => {
                return Err(Diagnostic::error(expr.span, format!("`{name}` has no value"))
                    .help("give it one, `constant g = 9.8 [m/s^2];`"));
            }
        },
        ExprKind::Negative(inner) => -exact(inner, values)?,
        ExprKind::Sum(terms) => {
            let mut sum = Rational::zero();
            for (sign, term) in terms {
                let value = exact(term, values)?;
                sum = if *sign == Sign::Minus { sum - value } else { sum + value };
                within(length(&sum), expr.span)?;
            }
            sum
        }
        ExprKind::Product(factors) => {
            let mut product = Rational::one();
            for (operation, factor) in factors {
                let value = exact(factor, values)?;
                if *operation == Operation::Times {
                    product *= value;
                } else if value.is_zero() {
                    return Err(Diagnostic::error(factor.span, "a division by zero").help("this divisor is 0"));
                } else {
                    product /= value;
                }
                within(length(&product), expr.span)?;
            }
            product
        }
        ExprKind::Power(base, exponent) => {
            let base = exact(base, values)?;
            within(length(&base).saturating_mul(u64::from(*exponent)), expr.span)?;
            num_traits::Pow::pow(&base, *exponent)
        }
        ExprKind::Call(name, _) => {
            return Err(Diagnostic::error(expr.span, format!("`{}` cannot stand in a constant's value", name.name))
                .help("write a number"));
        }
    };
    Ok(value)
}

/// The factor of pi in `pi`, `pi/2`, `3/4*pi`; `None` for another expression.
pub(super) fn multiple_of_pi(expr: &Expr, values: &HashMap<&str, Rational>) -> Lower<Option<Rational>> {
    match &expr.kind {
        ExprKind::Name(name) if name == "pi" => Ok(Some(Rational::one())),
        ExprKind::Negative(inner) => Ok(multiple_of_pi(inner, values)?.map(|multiple| -multiple)),
        ExprKind::Product(factors) => {
            for (at, (operation, factor)) in factors.iter().enumerate() {
                if *operation != Operation::Times {
                    continue;
                }
                let Some(multiple) = multiple_of_pi(factor, values)? else { continue };
                let mut others = factors.clone();
                others.remove(at);
                let others = Expr { kind: ExprKind::Product(others), span: expr.span };
                return Ok(Some(multiple * exact(&others, values)?));
            }
            Ok(None)
        }
        _ => Ok(None),
    }
}

/// The arguments of `2*atan2(y, x)`, an angle whose half has a rational tangent; `None` for another expression.
pub(super) fn half_tangent(expr: &Expr, values: &HashMap<&str, Rational>) -> Lower<Option<(Rational, Rational)>> {
    if let ExprKind::Product(factors) = &expr.kind
        && let [(_, two), (Operation::Times, call)] = factors.as_slice()
        && two.integer() == Some(2)
        && let ExprKind::Call(name, arguments) = &call.kind
        && let (Some(Function::Atan2), [y, x]) = (Function::from_name(&name.name), arguments.as_slice())
    {
        return Ok(Some((exact(y, values)?, exact(x, values)?)));
    }
    Ok(None)
}
