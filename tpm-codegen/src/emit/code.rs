//! Straight-line code independent of the language: statements, expressions, tables.
//!
//! Invariant: every operation of a plan appears exactly once, with its operands in order, so that code in every
//! language rounds as the interpreter does. Only the division into statements is chosen, once for all languages. An
//! operation that is used once is part of the expression that uses it while that expression stays readable.

use tpm_symbolic::expr::graph::{Function, Symbol};
use tpm_symbolic::number::rational::Rational;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::{Op, Slot};
use tpm_symbolic::plan::straight_line::Plan;

/// Most leaves in one expression; a larger expression becomes a named intermediate result.
const WIDEST: usize = 14;

/// Precedence of an expression's outermost operator, in Rust and in C.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Level {
    Sum,
    Product,
    Unary,
    Atom,
}

/// An operator between two operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Operator {
    Add,
    Sub,
    Mul,
    Div,
}

impl Operator {
    /// The precedence of the operator. A left operand must bind at least as tightly, a right operand at least as
    /// tightly as [`Self::right`].
    pub(super) fn level(self) -> Level {
        match self {
            Self::Add | Self::Sub => Level::Sum,
            Self::Mul | Self::Div => Level::Product,
        }
    }

    /// The least precedence of a right operand, so that the order of operations stays that of the plan.
    pub(super) fn right(self) -> Level {
        match self {
            Self::Add | Self::Sub => Level::Product,
            Self::Mul | Self::Div => Level::Unary,
        }
    }
}

/// An expression.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Expression {
    /// An exact number, rounded once where it is written.
    Number(Rational),
    Pi,
    /// A leaf of the plan.
    Leaf(Leaf),
    /// The intermediate result that a [`Statement::Let`] defines.
    Temporary(usize),
    Binary(Operator, Box<Expression>, Box<Expression>),
    Negated(Box<Expression>),
    Call(Function, Box<Expression>),
    /// atan2(y, x)
    Atan2(Box<Expression>, Box<Expression>),
}

impl Expression {
    /// The precedence of the expression; a number counts as an atom, however a language spells it.
    pub(super) fn level(&self) -> Level {
        match self {
            Self::Binary(operator, ..) => operator.level(),
            Self::Negated(_) => Level::Unary,
            _ => Level::Atom,
        }
    }
}

/// Target of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// A field of a structure, by its position.
    Value(usize),
    /// Row and column of a matrix.
    Entry(usize, usize),
}

/// A step of straight-line code.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Statement {
    /// A comment on the steps that follow.
    Comment(String),
    /// A named intermediate result.
    Let(usize, Expression),
    /// A result.
    Store(Place, Expression),
}

/// The base of a power in a [`Table`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Base {
    /// Amplitude, frequency or constant.
    Symbol(Symbol),
    Pi,
    /// The sign of an amplitude.
    Sign(Symbol),
}

/// One term of a [`Table`]: a coefficient times powers, added to a target.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Term {
    pub(super) place: Place,
    pub(super) coefficient: Rational,
    /// The exponents of the table's bases, in the order of the bases.
    pub(super) powers: Vec<i32>,
}

/// Sums of a coefficient times powers, as data for a loop.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Table {
    pub(super) bases: Vec<Base>,
    pub(super) terms: Vec<Term>,
    /// The order of the bases as text for a comment.
    pub(super) order: String,
}

/// Converts a plan to expressions, output by output.
pub(super) struct Reader<'a> {
    plan: &'a Plan,
    uses: Vec<u32>,
    /// The expression of every operation so far, and its number of leaves.
    ready: Vec<(Expression, usize)>,
    names: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(plan: &'a Plan) -> Self {
        let mut uses = vec![0; plan.ops.len()];
        for slot in plan.ops.iter().flat_map(Op::operands).chain(plan.outputs.iter().copied()) {
            uses[slot.index()] += 1;
        }
        Self { plan, uses, ready: Vec::with_capacity(plan.ops.len()), names: 0 }
    }

    /// The statements that output `index` needs in addition to those already given, and its expression.
    pub(super) fn output(&mut self, index: usize) -> (Vec<Statement>, Expression) {
        let slot = self.plan.outputs[index];
        let mut statements = Vec::new();
        while self.ready.len() <= slot.index() {
            let position = self.ready.len();
            let op = &self.plan.ops[position];
            let (value, size) = self.read(op);
            let simple = matches!(op, Op::Constant(_) | Op::Pi | Op::Load(_));
            self.ready.push(if !simple && (self.uses[position] > 1 || size > WIDEST) {
                let name = self.names;
                self.names += 1;
                statements.push(Statement::Let(name, value));
                (Expression::Temporary(name), 1)
            } else {
                (value, size)
            });
        }
        (statements, self.ready[slot.index()].0.clone())
    }

    /// All outputs at once.
    pub(super) fn outputs(mut self) -> (Vec<Statement>, Vec<Expression>) {
        let mut statements = Vec::new();
        let mut values = Vec::with_capacity(self.plan.outputs.len());
        for index in 0..self.plan.outputs.len() {
            let (more, value) = self.output(index);
            statements.extend(more);
            values.push(value);
        }
        (statements, values)
    }

    fn read(&self, op: &Op) -> (Expression, usize) {
        let at = |slot: &Slot| {
            let (value, size) = &self.ready[slot.index()];
            (Box::new(value.clone()), *size)
        };
        let binary = |operator: Operator, a: &Slot, b: &Slot| {
            let ((a, left), (b, right)) = (at(a), at(b));
            (Expression::Binary(operator, a, b), left + right)
        };
        match op {
            Op::Constant(value) => {
                let size = if num_traits::Signed::is_negative(value) { 2 } else { 1 };
                (Expression::Number(value.clone()), size)
            }
            Op::Pi => (Expression::Pi, 1),
            Op::Load(index) => (Expression::Leaf(self.plan.inputs[*index as usize]), 1),
            Op::Add(a, b) => binary(Operator::Add, a, b),
            Op::Sub(a, b) => binary(Operator::Sub, a, b),
            Op::Mul(a, b) => binary(Operator::Mul, a, b),
            Op::Div(a, b) => binary(Operator::Div, a, b),
            Op::Neg(a) => {
                let (a, size) = at(a);
                (Expression::Negated(a), size)
            }
            Op::Function(function, a) => {
                let (a, size) = at(a);
                (Expression::Call(*function, a), size + 1)
            }
            Op::Atan2(y, x) => {
                let ((y, _), (x, size)) = (at(y), at(x));
                (Expression::Atan2(y, x), size + 2)
            }
        }
    }
}
