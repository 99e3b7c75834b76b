//! Expressions in C.
//!
//! Invariant: the written operators bind as the expression is nested; every number is rounded once, to the scalar's
//! precision.

use tpm_symbolic::expr::graph::Function;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::plan::leaf::Leaf;

use super::super::code::{Expression, Level};
use super::super::infix::{self, Spelling};
use super::super::number::{Rounded, digits, digits_single};

/// The scalar of the code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scalar {
    /// Single precision.
    Float,
    /// Double precision.
    #[default]
    Double,
}

impl Scalar {
    /// The type's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Float => "float",
            Self::Double => "double",
        }
    }

    /// The precision's name in `float.h`.
    pub(super) fn epsilon(self) -> &'static str {
        match self {
            Self::Float => "FLT_EPSILON",
            Self::Double => "DBL_EPSILON",
        }
    }

    /// The largest number in `float.h`.
    pub(super) fn max(self) -> &'static str {
        match self {
            Self::Float => "FLT_MAX",
            Self::Double => "DBL_MAX",
        }
    }

    /// A function of `math.h` for this scalar.
    pub(super) fn function(self, name: &str) -> String {
        match self {
            Self::Float => format!("{name}f"),
            Self::Double => name.to_owned(),
        }
    }

    /// A literal of a finite number of this scalar.
    pub(super) fn literal(self, value: f64) -> String {
        // For single precision, the caller passes a number that is already rounded to single precision.
        #[allow(clippy::cast_possible_truncation)]
        match self {
            Self::Float => format!("{}f", digits_single(value as f32)),
            Self::Double => digits(value),
        }
    }

    /// An exact number, rounded once.
    pub(super) fn number(self, value: &Rational) -> String {
        let rounded = Rounded::new(value);
        let value = match self {
            Self::Float => f64::from(rounded.single),
            Self::Double => rounded.double,
        };
        self.literal(value)
    }

    /// Whether rounding makes a number infinite, or makes a nonzero number zero.
    pub(super) fn loses(self, value: &Rational) -> bool {
        use num_traits::Zero;
        let rounded = Rounded::new(value);
        match self {
            Self::Float => {
                !rounded.single.is_finite() || (rounded.single.abs() < f32::MIN_POSITIVE && !value.is_zero())
            }
            Self::Double => rounded.is_lost(value),
        }
    }

    /// Whether a double is finite in this scalar.
    pub(in crate::emit) fn holds(self, value: f64) -> bool {
        match self {
            Self::Float => value.abs() <= f64::from(f32::MAX),
            Self::Double => value.is_finite(),
        }
    }

    fn pi(self) -> String {
        match self {
            Self::Float => format!("{}f", digits_single(std::f32::consts::PI)),
            Self::Double => digits(std::f64::consts::PI),
        }
    }

    /// The text of a number in a message.
    pub(super) fn display(value: &Rational) -> String {
        rational::display(value)
    }
}

/// Writes expressions. `leaf` spells the leaves, each as text that binds as tightly as a name.
pub(super) struct Writer<L> {
    scalar: Scalar,
    leaf: L,
}

impl<L: Fn(&Leaf) -> String> Writer<L> {
    pub(super) fn new(scalar: Scalar, leaf: L) -> Self {
        Self { scalar, leaf }
    }

    /// The text of an expression.
    pub(super) fn expression(&self, expression: &Expression) -> String {
        infix::expression(self, expression)
    }

    /// The text of an expression, in parentheses unless it binds at least as tightly as `level`.
    pub(super) fn at(&self, expression: &Expression, level: Level) -> String {
        infix::at(self, expression, level)
    }
}

impl<L: Fn(&Leaf) -> String> Spelling for Writer<L> {
    fn number(&self, value: &Rational) -> String {
        self.scalar.number(value)
    }

    fn pi(&self) -> String {
        self.scalar.pi()
    }

    fn leaf(&self, leaf: &Leaf) -> String {
        (self.leaf)(leaf)
    }

    fn call(&self, function: Function, argument: &str) -> String {
        match function {
            Function::Sign => format!("sign_of({argument})"),
            Function::Abs => format!("{}({argument})", self.scalar.function("fabs")),
            function => format!("{}({argument})", self.scalar.function(function.name())),
        }
    }

    fn atan2(&self, y: &str, x: &str) -> String {
        format!("{}({y}, {x})", self.scalar.function("atan2"))
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::code::Reader;
    use super::{Scalar, Writer};
    use tpm_symbolic::expr::graph::{Function, Symbol};
    use tpm_symbolic::number::rational::{integer, ratio};
    use tpm_symbolic::plan::leaf::Leaf;
    use tpm_symbolic::plan::operation::Op;
    use tpm_symbolic::plan::straight_line::{Merger, Plan};

    fn write(plan: &Plan, scalar: Scalar) -> Vec<String> {
        let writer = Writer::new(scalar, |leaf: &Leaf| match leaf {
            Leaf::Symbol(Symbol(0)) => "a".to_owned(),
            _ => "b".to_owned(),
        });
        Reader::new(plan).outputs().1.iter().map(|value| writer.expression(value)).collect()
    }

    #[test]
    fn parentheses_keep_the_order_of_operations() {
        let mut merger = Merger::default();
        let a = merger.load(Leaf::Symbol(Symbol(0)));
        let b = merger.load(Leaf::Symbol(Symbol(1)));
        let difference = merger.emit(Op::Sub(a, b));
        let outer = merger.emit(Op::Sub(a, difference));
        let product = merger.emit(Op::Mul(a, b));
        let quotient = merger.emit(Op::Div(outer, product));
        let negative = merger.emit(Op::Neg(quotient));
        let twice = merger.emit(Op::Neg(negative));
        let sine = merger.emit(Op::Function(Function::Sin, twice));
        let plan = merger.finish(vec![sine]);
        assert_eq!(write(&plan, Scalar::Double), ["sin(-(-((a - (a - b)) / (a * b))))"]);
    }

    #[test]
    fn numbers_are_rounded_once_and_never_follow_an_operator_with_a_sign() {
        let mut merger = Merger::default();
        let a = merger.load(Leaf::Symbol(Symbol(0)));
        let number = merger.emit(Op::Constant(ratio(-1, 3)));
        let sum = merger.emit(Op::Sub(a, number));
        let size = merger.emit(Op::Function(Function::Abs, sum));
        let sign = merger.emit(Op::Function(Function::Sign, a));
        let plan = merger.finish(vec![size, sign, number]);
        assert_eq!(
            write(&plan, Scalar::Double),
            ["fabs(a - (-0.3333333333333333))", "sign_of(a)", "-0.3333333333333333"]
        );
        assert_eq!(write(&plan, Scalar::Float), ["fabsf(a - (-0.33333334f))", "sign_of(a)", "-0.33333334f"]);
        assert_eq!(Scalar::Float.number(&integer(3)), "3.0f");
        assert!(Scalar::Float.loses(&integer(10).pow(40)) && !Scalar::Double.loses(&integer(10).pow(40)));
    }
}
