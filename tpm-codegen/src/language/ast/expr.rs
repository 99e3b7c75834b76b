//! Names and expressions, each with its place.

use tpm_symbolic::number::rational::Rational;

use crate::source::Span;

/// A name and its place.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Ident {
    /// The name.
    pub name: String,
    /// Its place.
    pub span: Span,
}

/// An expression and its place.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Expr {
    /// What it is.
    pub kind: ExprKind,
    /// Its place.
    pub span: Span,
}

/// The forms of an expression.
#[derive(Clone, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum ExprKind {
    /// A non-negative decimal number, exact.
    Number(Rational),
    /// A quantity, a `let`, `pi` or `t`.
    Name(String),
    /// A function of arguments.
    Call(Ident, Vec<Expr>),
    /// `-e`
    Negative(Box<Expr>),
    /// Two or more terms.
    Sum(Vec<(Sign, Expr)>),
    /// Two or more factors.
    Product(Vec<(Operation, Expr)>),
    /// `e^n`
    Power(Box<Expr>, u32),
}

/// How a term enters a sum.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Sign {
    /// Added.
    Plus,
    /// Subtracted.
    Minus,
}

/// How a factor enters a product.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Operation {
    /// Multiplied.
    Times,
    /// Divided by.
    Over,
}

impl Expr {
    /// The terms that are added at the top of this expression, with their signs; one when it is no sum.
    #[must_use]
    pub fn terms(&self) -> Vec<(Sign, &Expr)> {
        match &self.kind {
            ExprKind::Sum(terms) => terms.iter().map(|(sign, term)| (*sign, term)).collect(),
            _ => vec![(Sign::Plus, self)],
        }
    }

    /// Whether this is the number zero as it is written.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        matches!(&self.kind, ExprKind::Number(value) if num_traits::Zero::is_zero(value))
    }

    /// The value of an integer literal; `None` for any other expression, and beyond 32 bits.
    #[must_use]
    pub fn integer(&self) -> Option<u32> {
        match &self.kind {
            ExprKind::Number(value) if value.is_integer() => value.to_integer().try_into().ok(),
            _ => None,
        }
    }

    /// Calls `visit` on this expression and on everything in it, from the outside in.
    pub fn walk<'a>(&'a self, visit: &mut impl FnMut(&'a Expr)) {
        visit(self);
        match &self.kind {
            ExprKind::Number(_) | ExprKind::Name(_) => {}
            ExprKind::Call(_, arguments) => arguments.iter().for_each(|argument| argument.walk(visit)),
            ExprKind::Negative(inner) | ExprKind::Power(inner, _) => inner.walk(visit),
            ExprKind::Sum(terms) => terms.iter().for_each(|(_, term)| term.walk(visit)),
            ExprKind::Product(factors) => factors.iter().for_each(|(_, factor)| factor.walk(visit)),
        }
    }
}

/// Replaces the span of a name by the empty one.
pub(super) fn forget(ident: &mut Ident) {
    ident.span = Span::default();
}

impl Expr {
    /// Replaces every span by the empty one.
    pub(super) fn forget_spans(&mut self) {
        self.span = Span::default();
        match &mut self.kind {
            ExprKind::Number(_) | ExprKind::Name(_) => {}
            ExprKind::Call(function, arguments) => {
                forget(function);
                arguments.iter_mut().for_each(Self::forget_spans);
            }
            ExprKind::Negative(inner) | ExprKind::Power(inner, _) => inner.forget_spans(),
            ExprKind::Sum(terms) => terms.iter_mut().for_each(|(_, term)| term.forget_spans()),
            ExprKind::Product(factors) => factors.iter_mut().for_each(|(_, factor)| factor.forget_spans()),
        }
    }
}
