//! Writes a model as text.
//!
//! Invariant: the text parses to the same model, and has only those parentheses that the model's structure needs.

mod mechanism;

use std::fmt::{self, Display, Formatter, Write as _};

use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{One, Signed};
use tpm_symbolic::number::rational::Rational;

use crate::language::ast::{
    Declaration, Definition, Eliminate, Energy, Equation, Expr, ExprKind, Force, Item, ModelDeclaration, Motion,
    NonlinearParameter, Operation, PatternDeclaration, PatternItem, PreslidingOf, Quantity, SeriesDeclaration, Sign,
    Taylor, UnitExpr,
};

/// Precedence of an expression; an expression of lower precedence than its place requires is put in parentheses.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Binding {
    Sum,
    Product,
    Negative,
    Power,
    Atom,
}

fn binding(expr: &Expr) -> Binding {
    match &expr.kind {
        ExprKind::Sum(_) => Binding::Sum,
        ExprKind::Product(_) => Binding::Product,
        ExprKind::Negative(_) => Binding::Negative,
        ExprKind::Power(..) => Binding::Power,
        ExprKind::Number(_) | ExprKind::Name(_) | ExprKind::Call(..) => Binding::Atom,
    }
}

/// Writes an expression, in parentheses when its precedence is below `least`.
struct At<'a>(&'a Expr, Binding);

impl Display for At<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if binding(self.0) < self.1 { write!(f, "({})", self.0) } else { self.0.fmt(f) }
    }
}

/// Writes a list with a separator.
fn join<T: Display>(f: &mut Formatter<'_>, items: impl IntoIterator<Item = T>, separator: &str) -> fmt::Result {
    for (index, item) in items.into_iter().enumerate() {
        if index > 0 {
            f.write_str(separator)?;
        }
        item.fmt(f)?;
    }
    Ok(())
}

impl Display for Expr {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match &self.kind {
            ExprKind::Number(value) => number(f, value),
            ExprKind::Name(name) => f.write_str(name),
            ExprKind::Call(function, arguments) => {
                write!(f, "{}(", function.name)?;
                join(f, arguments, ", ")?;
                f.write_char(')')
            }
            ExprKind::Negative(inner) => write!(f, "-{}", At(inner, Binding::Negative)),
            ExprKind::Sum(terms) => {
                for (index, (sign, term)) in terms.iter().enumerate() {
                    match (index, sign) {
                        (0, _) => {}
                        (_, Sign::Plus) => f.write_str(" + ")?,
                        (_, Sign::Minus) => f.write_str(" - ")?,
                    }
                    At(term, Binding::Product).fmt(f)?;
                }
                Ok(())
            }
            ExprKind::Product(factors) => {
                for (index, (operation, factor)) in factors.iter().enumerate() {
                    match (index, operation) {
                        (0, _) => {}
                        (_, Operation::Times) => f.write_char('*')?,
                        (_, Operation::Over) => f.write_char('/')?,
                    }
                    At(factor, Binding::Negative).fmt(f)?;
                }
                Ok(())
            }
            ExprKind::Power(base, exponent) => write!(f, "{}^{exponent}", At(base, Binding::Atom)),
        }
    }
}

/// A number whose denominator divides a power of ten, as an integer or a decimal fraction.
fn number(f: &mut Formatter<'_>, value: &Rational) -> fmt::Result {
    if value.is_integer() {
        return value.numer().fmt(f);
    }
    let mut places = 0_usize;
    let (mut power, ten) = (BigInt::one(), BigInt::from(10));
    let mut denominator = value.denom();
    while !denominator.is_one() {
        let shared = denominator.gcd(&ten);
        if shared.is_one() {
            // No literal has such a value, so only a program can build it; it is written as a quotient of integers.
            return write!(f, "({}/{})", value.numer(), value.denom());
        }
        denominator /= shared;
        power *= &ten;
        places += 1;
    }
    let digits = (value.numer() * power / value.denom()).to_string();
    if places > 40 {
        return write!(f, "{digits}e-{places}");
    }
    let digits = format!("{digits:0>width$}", width = places + 1);
    let (whole, fraction) = digits.split_at(digits.len() - places);
    write!(f, "{whole}.{fraction}")
}

impl Display for UnitExpr {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_char('[')?;
        if self.factors.first().is_none_or(|&(_, exponent)| exponent.is_negative()) {
            f.write_char('1')?;
        }
        for (index, (name, exponent)) in self.factors.iter().enumerate() {
            match (index, exponent.is_negative()) {
                (0, false) => {}
                (_, false) => f.write_char('*')?,
                (_, true) => f.write_char('/')?,
            }
            f.write_str(&tpm_units::power_text(&name.name, exponent.abs()))?;
        }
        f.write_char(']')
    }
}

impl Display for Quantity {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name.name)?;
        if let Some(value) = &self.value {
            write!(f, " = {value}")?;
        }
        match &self.unit {
            Some(unit) => write!(f, " {unit}"),
            None => Ok(()),
        }
    }
}

impl Display for Declaration {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{} ", self.keyword())?;
        match &self.presliding {
            Some(PreslidingOf { coordinate, travel }) => {
                join(f, self.quantities.iter().map(|own| &own.name.name), ", ")?;
                write!(f, " of {} over {travel}", coordinate.name)?;
            }
            None => join(f, &self.quantities, ", ")?,
        }
        f.write_char(';')
    }
}

impl Display for NonlinearParameter {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name.name)?;
        if let Some(unit) = &self.unit {
            write!(f, " {unit}")?;
        }
        write!(f, " from {} to {}", self.from, self.to)
    }
}

impl Display for SeriesDeclaration {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "series {}({})", self.function.name, self.coordinate.name)?;
        if let Some(unit) = &self.unit {
            write!(f, " {unit}")?;
        }
        if let Some(definition) = &self.definition {
            write!(f, " = {definition}")?;
        }
        write!(f, " about {} order {}", self.point, self.order.value)?;
        if !self.coefficients.is_empty() {
            f.write_str(" as ")?;
            join(f, self.coefficients.iter().map(|name| &name.name), ", ")?;
        }
        f.write_char(';')
    }
}

impl Display for Item {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Declaration(declaration) => declaration.fmt(f),
            Self::Nonlinear(parameters) => {
                f.write_str("nonlinear parameter ")?;
                join(f, parameters, ", ")?;
                f.write_char(';')
            }
            Self::Series(series) => series.fmt(f),
            Self::Let(Definition { name, value }) => write!(f, "let {} = {value};", name.name),
            Self::Lump(Definition { name, value }) => write!(f, "lump {} = {value};", name.name),
            Self::Equation(Equation { left, right }) => write!(f, "{left} = {right};"),
            Self::Energy(Energy { kind, value, .. }) => write!(f, "{} = {value};", kind.keyword()),
            Self::Force(Force { coordinate, value }) => write!(f, "force {} = {value};", coordinate.name),
            Self::Mechanism(mechanism) => mechanism.fmt(f),
            Self::Eliminate(Eliminate { coordinates, stem }) => {
                f.write_str("eliminate ")?;
                join(f, coordinates.iter().map(|name| &name.name), ", ")?;
                write!(f, " as {};", stem.name)
            }
            Self::Taylor(Taylor { coordinate, point, order }) => {
                write!(f, "taylor {} about {point} order {};", coordinate.name, order.value)
            }
            Self::Pattern(pattern) => pattern.fmt(f),
        }
    }
}

impl Display for PatternItem {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Declaration(declaration) => declaration.fmt(f),
            Self::Harmonics(count) => write!(f, "harmonics {};", count.value),
            Self::Motion(Motion { coordinate, value }) => write!(f, "{} = {value};", coordinate.name),
        }
    }
}

impl Display for PatternDeclaration {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str("pattern ")?;
        if let Some(name) = &self.name {
            write!(f, "{} ", name.name)?;
        }
        f.write_str("{\n")?;
        for item in &self.items {
            writeln!(f, "        {item}")?;
        }
        f.write_str("    }")
    }
}

impl Display for ModelDeclaration {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "model {} {{", self.name.name)?;
        for item in &self.items {
            writeln!(f, "    {item}")?;
        }
        f.write_str("}\n")
    }
}
