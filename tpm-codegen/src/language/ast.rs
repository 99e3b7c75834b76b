//! The syntax tree of a model: declarations, equations and patterns, before any check.
//!
//! Invariant: an [`Expr`] is as deep as its text is nested, never deeper: sums and products are lists, so that a sum of a
//! million terms is one node. The first member of a sum is added and the first of a product multiplied (a leading minus is
//! [`ExprKind::Negative`]). Printing a model ([`std::fmt::Display`]) and parsing it again gives the same model but for its spans.

mod expr;
pub mod mechanism;

use crate::language::ast::mechanism::MechanismDeclaration;
use crate::source::Span;
use tpm_units::Exponent;

use expr::forget;
pub use expr::{Expr, ExprKind, Ident, Operation, Sign};

/// `model NAME { ... }`
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ModelDeclaration {
    /// The model's name, in the form of a type's name.
    pub name: Ident,
    /// Statements in the order in which they are written.
    pub items: Vec<Item>,
}

/// A statement of a model.
#[derive(Clone, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Item {
    /// `coordinate x [m], y [m];` and its like.
    Declaration(Declaration),
    /// `nonlinear parameter vs [m/s] from 0.01 to 0.5;`
    Nonlinear(Vec<NonlinearParameter>),
    /// `series f(q) about c order n as a, b, c;`
    Series(SeriesDeclaration),
    /// `let name = expr;`
    Let(Definition),
    /// `lump NAME = expr;`
    Lump(Definition),
    /// `left = right;`
    Equation(Equation),
    /// `kinetic = expr;` and its like.
    Energy(Energy),
    /// `force q = expr;`
    Force(Force),
    /// `mechanism { ... }`
    Mechanism(MechanismDeclaration),
    /// `eliminate x1, x2 as c;`
    Eliminate(Eliminate),
    /// `taylor q about q0 order n;`
    Taylor(Taylor),
    /// `pattern NAME { ... }`
    Pattern(PatternDeclaration),
}

/// Role of a declared quantity.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Role {
    /// A generalised coordinate, a function of time.
    Coordinate,
    /// An actuating force, torque or voltage.
    Input,
    /// A number to be identified.
    Parameter,
    /// A number that is known, now or at run time.
    Constant,
    /// A pattern's amplitude.
    Amplitude,
    /// A pattern's fundamental angular frequency.
    Frequency,
}

impl Role {
    /// The indefinite article that the keyword takes in messages.
    #[must_use]
    pub fn article(self) -> &'static str {
        match self {
            Self::Input | Self::Amplitude => "an",
            _ => "a",
        }
    }

    /// The keyword.
    #[must_use]
    pub fn keyword(self) -> &'static str {
        match self {
            Self::Coordinate => "coordinate",
            Self::Input => "input",
            Self::Parameter => "parameter",
            Self::Constant => "constant",
            Self::Amplitude => "amplitude",
            Self::Frequency => "frequency",
        }
    }
}

/// Quantities of one role.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Declaration {
    /// Their role.
    pub role: Role,
    /// Whether these are coordinates that no sensor measures, `unmeasured y [m];`.
    pub unmeasured: bool,
    /// What the one coordinate of the declaration follows from, `presliding z of q over 0.001;`.
    pub presliding: Option<PreslidingOf>,
    /// At least one.
    pub quantities: Vec<Quantity>,
}

/// The keyword of coordinates that no sensor measures.
pub(crate) const UNMEASURED: &str = "unmeasured";
/// The keyword of friction that builds up.
pub(crate) const PRESLIDING: &str = "presliding";

/// What friction that builds up follows from.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct PreslidingOf {
    /// The coordinate that reverses.
    pub coordinate: Ident,
    /// The travel over which it builds up, an expression of constants.
    pub travel: Expr,
}

impl Declaration {
    /// The keyword.
    #[must_use]
    pub fn keyword(&self) -> &'static str {
        match (self.unmeasured, &self.presliding) {
            (true, _) => UNMEASURED,
            (false, Some(_)) => PRESLIDING,
            (false, None) => self.role.keyword(),
        }
    }
}

/// One declared quantity.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Quantity {
    /// Its name.
    pub name: Ident,
    /// The value of a constant; `None` for every other role.
    pub value: Option<Expr>,
    /// Its unit; a quantity without one is not checked.
    pub unit: Option<UnitExpr>,
}

/// One declared parameter in which the equations are not linear.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct NonlinearParameter {
    /// Its name.
    pub name: Ident,
    /// Its unit; a parameter without one is not checked.
    pub unit: Option<UnitExpr>,
    /// Least value that it can have, an expression of constants.
    pub from: Expr,
    /// Largest value that it can have, an expression of constants.
    pub to: Expr,
}

/// `[kg*m/s^2]`: a product of powers of named units; no factors is the unit 1.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct UnitExpr {
    /// Names with their exponents, in the order in which they are written.
    pub factors: Vec<(Ident, Exponent)>,
    /// The place of the bracket.
    pub span: Span,
}

/// `series f(q) [unit] about POINT order n as a0, a1, ...;`: an unknown function, known by its Taylor coefficients at a point.
/// With `= expr` the function is known, and its coefficients follow from the expression.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SeriesDeclaration {
    /// The function's name.
    pub function: Ident,
    /// The coordinate that it is a function of.
    pub coordinate: Ident,
    /// Its unit; found from the equations when not given.
    pub unit: Option<UnitExpr>,
    /// The expression of a known function.
    pub definition: Option<Expr>,
    /// The point of expansion.
    pub point: Expr,
    /// The highest power kept.
    pub order: Count,
    /// `order + 1` names of new parameters; none when the function is known and its coefficients stay expressions.
    pub coefficients: Vec<Ident>,
}

/// A non-negative integer of the text, such as an order.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Count {
    /// Its value.
    pub value: u32,
    /// Its place.
    pub span: Span,
}

/// `let name = expr;` or `lump NAME = expr;`
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Definition {
    /// The name.
    pub name: Ident,
    /// What it stands for.
    pub value: Expr,
}

/// `left = right;`
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Equation {
    /// Left-hand side.
    pub left: Expr,
    /// Right-hand side.
    pub right: Expr,
}

/// The functions of a Lagrangian model.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum EnergyKind {
    /// The kinetic energy T of L = T - V.
    Kinetic,
    /// The potential energy V of L = T - V.
    Potential,
    /// Rayleigh's dissipation function D: its derivative by a velocity is the damping force on that coordinate.
    Dissipation,
}

impl EnergyKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Kinetic, Self::Potential, Self::Dissipation];

    /// The keyword.
    #[must_use]
    pub fn keyword(self) -> &'static str {
        match self {
            Self::Kinetic => "kinetic",
            Self::Potential => "potential",
            Self::Dissipation => "dissipation",
        }
    }
}

/// `kinetic = expr;`, `potential = expr;` or `dissipation = expr;`
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Energy {
    /// Kinetic, potential or dissipation.
    pub kind: EnergyKind,
    /// The place of the keyword.
    pub keyword: Span,
    /// The function.
    pub value: Expr,
}

/// `force q = expr;`: a generalised force on a coordinate, the right-hand side of its Euler-Lagrange equation; with a mechanism, a
/// force beside those of the drives.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Force {
    /// The coordinate.
    pub coordinate: Ident,
    /// The force.
    pub value: Expr,
}

/// `eliminate x1, x2 as c;`: free coordinates are eliminated, and the coefficients of what remains are called c1, c2, ...
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Eliminate {
    /// The coordinates to be eliminated.
    pub coordinates: Vec<Ident>,
    /// The stem of the lumped parameters' names.
    pub stem: Ident,
}

/// `taylor q about q0 order n;`: terms that do not expand finitely in `q` are replaced by their Taylor polynomial.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Taylor {
    /// The coordinate.
    pub coordinate: Ident,
    /// The point of expansion.
    pub point: Expr,
    /// The highest power kept.
    pub order: Count,
}

/// `pattern NAME { ... }`
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct PatternDeclaration {
    /// The place of the keyword.
    pub keyword: Span,
    /// Its name; a pattern without one is the model's default.
    pub name: Option<Ident>,
    /// Its statements.
    pub items: Vec<PatternItem>,
}

/// A statement of a pattern.
#[derive(Clone, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum PatternItem {
    /// `amplitude lambda [m];` or `frequency w [rad/s];`
    Declaration(Declaration),
    /// `harmonics n;`: how many harmonics are kept of terms with infinitely many.
    Harmonics(Count),
    /// `x = expr;`
    Motion(Motion),
}

/// `x = expr;`: the reference motion of a coordinate.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Motion {
    /// The coordinate.
    pub coordinate: Ident,
    /// Its motion, a finite Fourier series in the time.
    pub value: Expr,
}

impl ModelDeclaration {
    /// Replaces every span by the empty one, so that models can be compared by content.
    pub fn forget_spans(&mut self) {
        forget(&mut self.name);
        for item in &mut self.items {
            item.forget_spans();
        }
    }
}

impl ModelDeclaration {
    /// The coordinates that follow from the motion of others.
    pub(crate) fn following(&self) -> impl Iterator<Item = &Ident> {
        let declared =
            self.items.iter().filter_map(|item| if let Item::Declaration(own) = item { Some(own) } else { None });
        let following = declared.filter(|own| own.presliding.is_some());
        following.flat_map(|own| own.quantities.iter().map(|quantity| &quantity.name))
    }
}

impl Item {
    fn forget_spans(&mut self) {
        match self {
            Self::Declaration(declaration) => declaration.forget_spans(),
            Self::Nonlinear(parameters) => parameters.iter_mut().for_each(NonlinearParameter::forget_spans),
            Self::Series(series) => {
                forget(&mut series.function);
                forget(&mut series.coordinate);
                series.unit.iter_mut().for_each(UnitExpr::forget_spans);
                series.definition.iter_mut().for_each(Expr::forget_spans);
                series.point.forget_spans();
                series.order.span = Span::default();
                series.coefficients.iter_mut().for_each(forget);
            }
            Self::Let(definition) | Self::Lump(definition) => {
                forget(&mut definition.name);
                definition.value.forget_spans();
            }
            Self::Equation(equation) => {
                equation.left.forget_spans();
                equation.right.forget_spans();
            }
            Self::Energy(energy) => {
                energy.keyword = Span::default();
                energy.value.forget_spans();
            }
            Self::Force(Force { coordinate, value }) => {
                forget(coordinate);
                value.forget_spans();
            }
            Self::Mechanism(mechanism) => mechanism.forget_spans(),
            Self::Eliminate(eliminate) => {
                eliminate.coordinates.iter_mut().for_each(forget);
                forget(&mut eliminate.stem);
            }
            Self::Taylor(taylor) => {
                forget(&mut taylor.coordinate);
                taylor.point.forget_spans();
                taylor.order.span = Span::default();
            }
            Self::Pattern(pattern) => {
                pattern.keyword = Span::default();
                pattern.name.iter_mut().for_each(forget);
                for item in &mut pattern.items {
                    match item {
                        PatternItem::Declaration(declaration) => declaration.forget_spans(),
                        PatternItem::Harmonics(count) => count.span = Span::default(),
                        PatternItem::Motion(Motion { coordinate, value }) => {
                            forget(coordinate);
                            value.forget_spans();
                        }
                    }
                }
            }
        }
    }
}

impl Declaration {
    fn forget_spans(&mut self) {
        if let Some(own) = &mut self.presliding {
            forget(&mut own.coordinate);
            own.travel.forget_spans();
        }
        for quantity in &mut self.quantities {
            forget(&mut quantity.name);
            quantity.value.iter_mut().for_each(Expr::forget_spans);
            quantity.unit.iter_mut().for_each(UnitExpr::forget_spans);
        }
    }
}

impl NonlinearParameter {
    fn forget_spans(&mut self) {
        forget(&mut self.name);
        self.unit.iter_mut().for_each(UnitExpr::forget_spans);
        self.from.forget_spans();
        self.to.forget_spans();
    }
}

impl UnitExpr {
    fn forget_spans(&mut self) {
        self.factors.iter_mut().for_each(|(name, _)| forget(name));
        self.span = Span::default();
    }
}
