//! Nodes of an expression, and the names of its leaves.

use crate::number::rational::Rational;
use num_traits::{One, Signed, Zero};
use serde::{Deserialize, Serialize};

/// Index of a node in its graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ExprId(pub(super) u32);

impl ExprId {
    /// The position in the arena.
    #[must_use]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// Index of a named quantity (parameter, constant, input, amplitude, frequency) in a model's symbol table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Symbol(pub u32);

/// Index of a coordinate of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Coordinate(pub u32);

/// Functions of one argument.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Function {
    /// Sine.
    Sin,
    /// Cosine.
    Cos,
    /// Tangent.
    Tan,
    /// Inverse sine, principal value.
    Asin,
    /// Inverse cosine, principal value.
    Acos,
    /// Inverse tangent, principal value.
    Atan,
    /// Non-negative square root.
    Sqrt,
    /// Hyperbolic tangent.
    Tanh,
    /// Natural exponential.
    Exp,
    /// Natural logarithm.
    Log,
    /// Absolute value.
    Abs,
    /// Sign: -1, 0 or 1.
    Sign,
}

impl Function {
    /// The name in the model language.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::Function, number::rational::integer};
    /// assert_eq!(Function::Sqrt.name(), "sqrt");
    /// ```
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sin => "sin",
            Self::Cos => "cos",
            Self::Tan => "tan",
            Self::Asin => "asin",
            Self::Acos => "acos",
            Self::Atan => "atan",
            Self::Sqrt => "sqrt",
            Self::Tanh => "tanh",
            Self::Exp => "exp",
            Self::Log => "log",
            Self::Abs => "abs",
            Self::Sign => "sign",
        }
    }

    /// The exact value, where it is known to be rational.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::Function, number::rational::integer};
    /// assert_eq!(Function::Sqrt.apply_exact(&integer(9)), Some(integer(3)));
    /// assert_eq!(Function::Sqrt.apply_exact(&integer(2)), None);
    /// ```
    #[must_use]
    pub fn apply_exact(self, x: &Rational) -> Option<Rational> {
        match self {
            Self::Sin | Self::Tan | Self::Asin | Self::Atan | Self::Tanh if x.is_zero() => Some(x.clone()),
            Self::Cos | Self::Exp if x.is_zero() => Some(Rational::one()),
            Self::Log if x.is_one() => Some(Rational::zero()),
            Self::Abs => Some(x.abs()),
            Self::Sign => Some(x.signum()),
            Self::Sqrt => exact_square_root(x),
            _ => None,
        }
    }

    /// The value in double precision.
    ///
    /// ```
    /// # use tpm_symbolic::{expr::graph::Function, number::rational::integer};
    /// assert_eq!(Function::Sign.apply(-2.0), -1.0);
    /// ```
    #[must_use]
    pub fn apply(self, x: f64) -> f64 {
        match self {
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tan => x.tan(),
            Self::Asin => x.asin(),
            Self::Acos => x.acos(),
            Self::Atan => x.atan(),
            Self::Sqrt => x.sqrt(),
            Self::Tanh => x.tanh(),
            Self::Exp => x.exp(),
            Self::Log => x.ln(),
            Self::Abs => x.abs(),
            Self::Sign => {
                if x > 0.0 {
                    1.0
                } else if x < 0.0 {
                    -1.0
                } else {
                    0.0
                }
            }
        }
    }
}

/// A node of a graph. Only the graph's own functions build nodes that go into it, since they keep the canonical form.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Node {
    /// An exact number.
    Number(Rational),
    /// The circle constant.
    Pi,
    /// A named quantity that does not depend on time, or an input.
    Symbol(Symbol),
    /// The n-th time derivative of a coordinate (0: the coordinate itself).
    Derivative(Coordinate, u32),
    /// A leaf that is no quantity of a model: an entry, by index, of a list that the builder of the expression keeps.
    Placeholder(u32),
    /// A sum.
    Sum(Vec<ExprId>),
    /// A product.
    Product(Vec<ExprId>),
    /// An integer power, not 0 or 1.
    Power(ExprId, i32),
    /// A function of one argument.
    Function(Function, ExprId),
    /// The angle of the point (second, first): `atan2(y, x)`.
    Atan2(ExprId, ExprId),
}

impl Node {
    /// The operands of this node.
    pub(crate) fn operands(&self) -> impl Iterator<Item = ExprId> + '_ {
        let (list, pair): (&[ExprId], [Option<ExprId>; 2]) = match self {
            Node::Number(_) | Node::Pi | Node::Symbol(_) | Node::Derivative(..) | Node::Placeholder(_) => {
                (&[], [None, None])
            }
            Node::Sum(list) | Node::Product(list) => (list, [None, None]),
            Node::Power(a, _) | Node::Function(_, a) => (&[], [Some(*a), None]),
            Node::Atan2(a, b) => (&[], [Some(*a), Some(*b)]),
        };
        list.iter().copied().chain(pair.into_iter().flatten())
    }
}

/// Names for the leaves of an expression.
pub trait Names {
    /// The name of a symbol.
    fn symbol_name(&self, symbol: Symbol) -> String;
    /// The name of a coordinate.
    fn coordinate_name(&self, coordinate: Coordinate) -> String;
}

/// The square root when it is rational.
fn exact_square_root(value: &Rational) -> Option<Rational> {
    if value.is_negative() {
        return None;
    }
    let (numerator, denominator) = (value.numer().sqrt(), value.denom().sqrt());
    let root = Rational::new(numerator, denominator);
    (&root * &root == *value).then_some(root)
}
