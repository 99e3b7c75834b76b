//! Expressions that are shown to be other than zero by their value at a point.
//!
//! Every value carries a bound of its error, from the rounding of doubles and from the errors of its operands:
//!
//! ```text
//! |computed - exact| <= error .
//! ```
//!
//! A value that is larger than its error proves that the expression is not identically zero, where a normal form would
//! have to multiply it out. Nothing is proven by a value that is not.

use crate::algebra::generic_point;
use crate::expr::graph::{ExprId, Function, Graph, Node};
use crate::number::rational;

/// Points that are tried. An expression may have no value at some of them, such as a root of a negative number.
const POINTS: u64 = 24;
/// Highest power that is computed.
const HIGHEST_POWER: u32 = 64;
/// Relative error of one operation or elementary function, with a margin: a double is rounded by 1.1e-16, and mathematics
/// libraries are right to a few units in the last place.
const ROUNDING: f64 = 1e-15;

/// A value with a bound of its error; the bound is not finite where nothing is known.
#[derive(Clone, Copy, Debug)]
struct Enclosed {
    value: f64,
    error: f64,
}

impl Enclosed {
    const UNKNOWN: Self = Self { value: 0.0, error: f64::INFINITY };

    /// A computed value, rounded once more.
    fn rounded(value: f64, error: f64) -> Self {
        let error = error + ROUNDING * value.abs() + f64::MIN_POSITIVE;
        if value.is_finite() && error.is_finite() { Self { value, error } } else { Self::UNKNOWN }
    }

    fn plus(self, other: Self) -> Self {
        Self::rounded(self.value + other.value, self.error + other.error)
    }

    fn times(self, other: Self) -> Self {
        let error = self.value.abs() * other.error + other.value.abs() * self.error + self.error * other.error;
        Self::rounded(self.value * other.value, error)
    }

    fn inverse(self) -> Self {
        let least = self.value.abs() - self.error;
        if least > 0.0 {
            Self::rounded(1.0 / self.value, self.error / (self.value.abs() * least))
        } else {
            Self::UNKNOWN
        }
    }

    fn power(self, exponent: i32) -> Self {
        if exponent.unsigned_abs() > HIGHEST_POWER {
            return Self::UNKNOWN;
        }
        let one = Self { value: 1.0, error: 0.0 };
        let power = (0..exponent.unsigned_abs()).fold(one, |power, _| power.times(self));
        if exponent < 0 { power.inverse() } else { power }
    }

    fn function(self, function: Function) -> Self {
        let (value, least) = (function.apply(self.value), self.value - self.error);
        match function {
            Function::Sin | Function::Cos | Function::Atan | Function::Tanh | Function::Abs => {
                Self::rounded(value, self.error)
            }
            Function::Sqrt if least > 0.0 => Self::rounded(value, self.error / least.sqrt()),
            Function::Log if least > 0.0 => Self::rounded(value, self.error / least),
            Function::Exp => Self::rounded(value, self.error * (self.value + self.error).exp()),
            Function::Sign if self.value.abs() > self.error => Self::rounded(value, 0.0),
            _ => Self::UNKNOWN,
        }
    }
}

impl Graph {
    /// Whether a value of the expression shows that it is not identically zero; otherwise nothing is known.
    #[must_use]
    pub(crate) fn is_shown_nonzero(&self, expr: ExprId) -> bool {
        let mut needed = vec![false; expr.index() + 1];
        let mut stack = vec![expr];
        while let Some(id) = stack.pop() {
            if !std::mem::replace(&mut needed[id.index()], true) {
                stack.extend(self.operands(id));
            }
        }
        let order: Vec<usize> = (0..needed.len()).filter(|&index| needed[index]).collect();
        let mut values = vec![Enclosed::UNKNOWN; needed.len()];
        (0..POINTS).any(|point| {
            for &index in &order {
                values[index] = self.enclosed(index, point, &values);
            }
            let Enclosed { value, error } = values[expr.index()];
            value.abs() > error
        })
    }

    fn enclosed(&self, index: usize, point: u64, values: &[Enclosed]) -> Enclosed {
        let at = |operand: &ExprId| values[operand.index()];
        match self.node(ExprId(u32::try_from(index).expect("invariant: ids fit in u32"))) {
            Node::Number(value) => Enclosed::rounded(rational::to_f64(value), 0.0),
            Node::Pi => Enclosed::rounded(std::f64::consts::PI, 0.0),
            Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_) => {
                // Between 0.2 and 1.7, exactly a double.
                let drawn = rational::to_f64(&generic_point::value(point, index)) / f64::from(1_u32 << 31);
                Enclosed { value: 0.2 + 1.5 * drawn, error: 0.0 }
            }
            Node::Sum(terms) => {
                terms.iter().map(at).fold(Enclosed { value: 0.0, error: 0.0 }, |sum, term| sum.plus(term))
            }
            Node::Product(factors) => factors
                .iter()
                .map(at)
                .fold(Enclosed { value: 1.0, error: 0.0 }, |product, factor| product.times(factor)),
            Node::Power(base, exponent) => at(base).power(*exponent),
            Node::Function(function, argument) => at(argument).function(*function),
            Node::Atan2(..) => Enclosed::UNKNOWN,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::expr::graph::{Function, Graph, Symbol};

    #[test]
    fn a_value_beyond_its_error_is_a_proof_and_rounding_is_none() {
        let mut g = Graph::new();
        let [a, b] = [0, 1].map(|i| g.symbol(Symbol(i)));
        let one = g.integer(1);
        let (sine, cosine) = (g.function(Function::Sin, a), g.function(Function::Cos, a));
        let (square, other) = (g.pow(sine, 2), g.pow(cosine, 2));
        let unit = g.sum(&[square, other]);
        let nothing = g.sub(unit, one);
        assert!(!g.is_shown_nonzero(nothing), "rounding alone");
        assert!(g.is_shown_nonzero(unit));
        // sqrt((a + b)^2) - a - b at positive values, through a root and a quotient.
        let sum = g.add(a, b);
        let power = g.pow(sum, 2);
        let root = g.function(Function::Sqrt, power);
        let quotient = g.div(root, sum);
        let nothing = g.sub(quotient, one);
        assert!(!g.is_shown_nonzero(nothing));
        // A difference far below the values, but above their rounding.
        let small = g.number(crate::number::rational::ratio(1, 1_000_000_000));
        let little = g.add(nothing, small);
        assert!(g.is_shown_nonzero(little));
    }
}
