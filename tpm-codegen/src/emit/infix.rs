//! Expressions in languages with infix operators: C, Python, structured text.
//!
//! Invariant: the written operators bind as the expression is nested, so that the order of operations stays that of the plan.

use tpm_symbolic::expr::graph::Function;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::plan::leaf::Leaf;

use super::code::{Expression, Level, Operator};

/// The words of a language.
pub(super) trait Spelling {
    /// An exact number, rounded once.
    fn number(&self, value: &Rational) -> String;
    /// The circle constant.
    fn pi(&self) -> String;
    /// A leaf, as text that binds as tightly as a name.
    fn leaf(&self, leaf: &Leaf) -> String;
    /// A function of one argument.
    fn call(&self, function: Function, argument: &str) -> String;
    /// atan2(y, x)
    fn atan2(&self, y: &str, x: &str) -> String;
}

/// The text of an expression.
pub(super) fn expression(spelling: &impl Spelling, of: &Expression) -> String {
    match of {
        Expression::Number(value) => spelling.number(value),
        Expression::Pi => spelling.pi(),
        Expression::Leaf(leaf) => spelling.leaf(leaf),
        Expression::Temporary(index) => format!("t{index}"),
        Expression::Binary(operator, left, right) => {
            let (left, right) = (at(spelling, left, operator.level()), at(spelling, right, operator.right()));
            let sign = match operator {
                Operator::Add => '+',
                Operator::Sub => '-',
                Operator::Mul => '*',
                Operator::Div => '/',
            };
            format!("{left} {sign} {right}")
        }
        Expression::Negated(value) => format!("-{}", at(spelling, value, Level::Atom)),
        Expression::Call(function, value) => spelling.call(*function, &expression(spelling, value)),
        Expression::Atan2(y, x) => spelling.atan2(&expression(spelling, y), &expression(spelling, x)),
    }
}

/// The text of an expression, in parentheses unless it binds at least as tightly as `level`. A negative number is always in parentheses,
/// so that no operator precedes its sign.
pub(super) fn at(spelling: &impl Spelling, of: &Expression, level: Level) -> String {
    let text = expression(spelling, of);
    if of.level() >= level && !(text.starts_with('-') && of.level() == Level::Atom) {
        text
    } else {
        format!("({text})")
    }
}

/// A language in which functions have plain names.
pub(super) struct Words<'a> {
    /// A leaf.
    pub(super) leaf: &'a dyn Fn(&Leaf) -> String,
    /// A finite number.
    pub(super) digits: fn(f64) -> String,
    /// The name of a function; that of atan2(y, x) where none is given.
    pub(super) name: &'a dyn Fn(Option<Function>) -> String,
}

impl Spelling for Words<'_> {
    fn number(&self, value: &Rational) -> String {
        (self.digits)(rational::to_f64(value))
    }

    fn pi(&self) -> String {
        (self.digits)(std::f64::consts::PI)
    }

    fn leaf(&self, leaf: &Leaf) -> String {
        (self.leaf)(leaf)
    }

    fn call(&self, function: Function, argument: &str) -> String {
        format!("{}({argument})", (self.name)(Some(function)))
    }

    fn atan2(&self, y: &str, x: &str) -> String {
        format!("{}({y}, {x})", (self.name)(None))
    }
}

/// What a file of such a language says beside the model.
pub(crate) struct Given<'a> {
    /// What the file is and where it comes from, as Markdown.
    pub(crate) about: &'a str,
    /// The values of the parameters, in the order of the columns.
    pub(crate) values: &'a [f64],
    /// The values of the constants known at run time, where the result has them.
    pub(crate) constants: &'a [Option<f64>],
}
