//! The operations of straight-line plans.

use crate::expr::graph::Function;
use crate::number::rational::Rational;
use serde::{Deserialize, Serialize};

/// Index of an operation, and of its result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Slot(pub u32);

impl Slot {
    /// The position in [`Plan::ops`](crate::plan::straight_line::Plan::ops).
    #[must_use]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// One operation.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Op {
    /// An exact constant, rounded once when it becomes a float.
    Constant(Rational),
    /// The circle constant.
    Pi,
    /// An input of the plan, by index into [`Plan::inputs`](crate::plan::straight_line::Plan::inputs).
    Load(u32),
    /// a + b
    Add(Slot, Slot),
    /// a - b
    Sub(Slot, Slot),
    /// a * b
    Mul(Slot, Slot),
    /// a / b
    Div(Slot, Slot),
    /// -a
    Neg(Slot),
    /// A function of one argument.
    Function(Function, Slot),
    /// atan2(y, x)
    Atan2(Slot, Slot),
}

impl Op {
    /// The slots that the operation reads.
    pub fn operands(&self) -> impl Iterator<Item = Slot> + use<> {
        let pair = match *self {
            Self::Constant(_) | Self::Pi | Self::Load(_) => [None, None],
            Self::Neg(a) | Self::Function(_, a) => [Some(a), None],
            Self::Add(a, b) | Self::Sub(a, b) | Self::Mul(a, b) | Self::Div(a, b) | Self::Atan2(a, b) => {
                [Some(a), Some(b)]
            }
        };
        pair.into_iter().flatten()
    }

    /// The operation with each operand replaced by the slot that `slot` gives for it.
    #[must_use]
    pub fn map(&self, slot: impl Fn(Slot) -> Slot) -> Self {
        match self {
            Self::Constant(_) | Self::Pi | Self::Load(_) => self.clone(),
            Self::Neg(a) => Self::Neg(slot(*a)),
            Self::Function(function, a) => Self::Function(*function, slot(*a)),
            Self::Add(a, b) => Self::Add(slot(*a), slot(*b)),
            Self::Sub(a, b) => Self::Sub(slot(*a), slot(*b)),
            Self::Mul(a, b) => Self::Mul(slot(*a), slot(*b)),
            Self::Div(a, b) => Self::Div(slot(*a), slot(*b)),
            Self::Atan2(a, b) => Self::Atan2(slot(*a), slot(*b)),
        }
    }
}

/// Numbers of operations, for headers and comparisons.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct OperationCounts {
    /// Additions, subtractions and negations.
    pub additions: usize,
    /// Multiplications.
    pub multiplications: usize,
    /// Divisions.
    pub divisions: usize,
    /// Function calls.
    pub functions: usize,
}
