//! A declared dynamics model in its written form: equations that are not yet separated into regressors.
//!
//! Invariants of [`ExactModel`]: every [`Symbol`] and [`Coordinate`] in the graph indexes `symbols` and `coordinates`; each
//! equation is the list of its source terms, whose sum is zero on every motion (left minus right-hand side), and every
//! source term carries a [`TermId`] by which whoever read the model finds the place it came from.

use crate::expr::graph::{Coordinate, ExprId, Function, Graph, Names, Node, Symbol};
use crate::mechanics::pattern::Pattern;
use crate::mechanics::unit::Unit;
use crate::number::rational::Rational;
use ecow::EcoString;
use num_traits::{One as _, Zero as _};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Most leaves and operations of an expression that a message shows completely.
const LONGEST_DISPLAYED: f64 = 2000.0;

/// Role of a named quantity.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// An actuating force, torque or voltage.
    Input,
    /// An unknown quantity to be identified.
    Parameter,
    /// A known quantity; without an exact value it is given at run time.
    Constant {
        /// The exact value.
        value: Option<Rational>,
    },
    /// Amplitude of a pattern.
    Amplitude,
    /// Fundamental angular frequency of a pattern.
    Frequency,
}

/// A named quantity.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Quantity {
    /// The name in the model.
    pub name: EcoString,
    /// The unit, when declared.
    pub unit: Option<Unit>,
    /// The role of the quantity in the model.
    pub kind: Kind,
}

/// A parameter in which the equations are not linear: a run-time constant that is to be identified.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Nonlinear {
    /// Its symbol, a run-time constant.
    pub symbol: Symbol,
    /// Least value that it can have.
    pub from: Rational,
    /// Largest value that it can have.
    pub to: Rational,
}

/// A generalised coordinate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CoordinateInfo {
    /// The name in the model.
    pub name: String,
    /// The unit, when declared.
    pub unit: Option<Unit>,
    /// Whether no sensor measures it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unmeasured: bool,
    /// What it follows from, where it is how far the friction of another coordinate has built up; nothing for every other one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub presliding: Option<Presliding>,
}

/// How far dry friction has built up since a coordinate reversed, from -1 to 1: with the position q, the last reversal at q0 and what had built
/// up there D0, it is D = s - (s - D0) exp(-|q - q0| / travel), s the sign of the motion.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Presliding {
    /// The coordinate that reverses.
    pub of: Coordinate,
    /// The travel over which all but 1/e of it builds up, in the unit of that coordinate.
    pub travel: Rational,
}

/// Identifies a source term. Its meaning is known only to the reader of the source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TermId(pub u32);

/// A term of an equation as written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SourceTerm {
    /// The identifier that leads back to the place of the term in the source.
    pub id: TermId,
    /// The term, with the sign it has on the left-hand side.
    pub expr: ExprId,
}

/// An equation of motion: the sum of its terms is zero.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Equation {
    /// The input's name when exactly one input stands in the equation, otherwise `eq1`, `eq2`, ... by position.
    pub name: String,
    /// Left-hand side minus right-hand side, term by term.
    pub terms: Vec<SourceTerm>,
}

/// Coordinates to be eliminated, in order.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Elimination {
    /// The coordinates that disappear.
    pub coordinates: Vec<Coordinate>,
    /// Prefix of the lumped parameters' names: `c` gives c1, c2, ...
    pub prefix: String,
}

/// A user's name for a lumped parameter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lump {
    /// The name.
    pub name: String,
    /// Its expression in the parameters.
    pub expr: ExprId,
    /// The identifier of its declaration.
    pub id: TermId,
}

/// A dynamics model.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ExactModel {
    /// The model's name.
    pub name: String,
    /// Inputs, parameters, constants, amplitudes and frequencies, in order of declaration.
    pub symbols: Vec<Quantity>,
    /// The coordinates, in order of declaration.
    pub coordinates: Vec<CoordinateInfo>,
    /// The arena of all expressions.
    pub graph: Graph,
    /// The equations of motion.
    pub equations: Vec<Equation>,
    /// Names given to lumped parameters.
    pub lumps: Vec<Lump>,
    /// Parameters in which the equations are not linear, in order of declaration.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub nonlinear: Vec<Nonlinear>,
    /// Coordinates to eliminate before expansion.
    pub eliminations: Vec<Elimination>,
    /// The trajectory patterns; the first is the default.
    pub patterns: Vec<Pattern>,
}

impl ExactModel {
    /// Declares a quantity.
    ///
    /// ```
    /// # use tpm_symbolic::mechanics::model::{ExactModel, Kind};
    /// let mut model = ExactModel::default();
    /// let mass = model.declare("m", None, Kind::Parameter);
    /// assert_eq!(model.quantity(mass).name, "m");
    /// ```
    pub fn declare(&mut self, name: &str, unit: Option<Unit>, kind: Kind) -> Symbol {
        let symbol = Symbol(u32::try_from(self.symbols.len()).expect("invariant: fewer than 2^32 symbols"));
        self.symbols.push(Quantity { name: name.into(), unit, kind });
        symbol
    }

    /// Declares a coordinate.
    ///
    /// ```
    /// # use tpm_symbolic::mechanics::model::{ExactModel, Kind};
    /// let mut model = ExactModel::default();
    /// let x = model.declare_coordinate("x", None);
    /// let velocity = model.graph.derivative_of(x, 1);
    /// assert_eq!(model.display(velocity), "dot(x)");
    /// ```
    pub fn declare_coordinate(&mut self, name: &str, unit: Option<Unit>) -> Coordinate {
        let coordinate =
            Coordinate(u32::try_from(self.coordinates.len()).expect("invariant: fewer than 2^32 coordinates"));
        self.coordinates.push(CoordinateInfo { name: name.to_owned(), unit, unmeasured: false, presliding: None });
        coordinate
    }

    /// Whether a coordinate follows from another one, and is no motion of its own.
    #[must_use]
    pub fn is_derived(&self, coordinate: Coordinate) -> bool {
        self.coordinates[coordinate.0 as usize].presliding.is_some()
    }

    /// The quantity behind a symbol.
    #[must_use]
    pub fn quantity(&self, symbol: Symbol) -> &Quantity {
        &self.symbols[symbol.0 as usize]
    }

    /// The symbol of a name.
    ///
    /// ```
    /// # use tpm_symbolic::mechanics::model::{ExactModel, Kind};
    /// let mut model = ExactModel::default();
    /// let mass = model.declare("m", None, Kind::Parameter);
    /// assert_eq!((model.find_symbol("m"), model.find_symbol("k")), (Some(mass), None));
    /// ```
    #[must_use]
    pub fn find_symbol(&self, name: &str) -> Option<Symbol> {
        let index = self.symbols.iter().position(|quantity| quantity.name == name)?;
        Some(Symbol(u32::try_from(index).expect("invariant: fewer than 2^32 symbols")))
    }

    /// The symbols whose kind satisfies `keep`, in order of declaration.
    pub fn symbols_where(&self, mut keep: impl FnMut(&Kind) -> bool) -> impl Iterator<Item = Symbol> {
        let symbols: Vec<Symbol> =
            (0u32..).zip(&self.symbols).filter(|(_, quantity)| keep(&quantity.kind)).map(|(i, _)| Symbol(i)).collect();
        symbols.into_iter()
    }

    /// The parameters, in order of declaration.
    ///
    /// ```
    /// # use tpm_symbolic::mechanics::model::{ExactModel, Kind};
    /// let mut model = ExactModel::default();
    /// let mass = model.declare("m", None, Kind::Parameter);
    /// model.declare("F", None, Kind::Input);
    /// assert!(model.parameters().eq([mass]));
    /// ```
    pub fn parameters(&self) -> impl Iterator<Item = Symbol> {
        self.symbols_where(|kind| *kind == Kind::Parameter)
    }

    /// The inputs, in order of declaration.
    pub fn inputs(&self) -> impl Iterator<Item = Symbol> {
        self.symbols_where(|kind| *kind == Kind::Input)
    }

    /// The constants that are known at run time only, in order of declaration.
    pub fn run_time_constants(&self) -> impl Iterator<Item = Symbol> {
        self.symbols_where(|kind| *kind == Kind::Constant { value: None })
    }

    /// The run-time constants that are not to be identified, in order of declaration.
    pub fn known_constants(&self) -> impl Iterator<Item = Symbol> {
        self.run_time_constants().filter(|symbol| self.nonlinear.iter().all(|own| own.symbol != *symbol))
    }

    /// The parameters that are gains of inputs: a term of some equation is the parameter times an input, perhaps times known positive numbers and
    /// the size of inputs, on the side of the forces (`... = Kt*i`). The input pushes backwards where such a parameter is negative.
    #[must_use]
    pub fn input_gains(&self) -> Vec<Symbol> {
        let terms = self.equations.iter().flat_map(|equation| &equation.terms);
        let mut gains: Vec<Symbol> = terms.filter_map(|term| self.gain_of_input(term.expr)).collect();
        gains.sort_unstable();
        gains.dedup();
        gains
    }

    fn gain_of_input(&self, term: ExprId) -> Option<Symbol> {
        let Node::Product(factors) = self.graph.node(term) else { return None };
        let (mut left, mut gains, mut inputs) = (Rational::one(), Vec::new(), 0);
        let is_input = |leaf: &ExprId| matches!(self.graph.node(*leaf), Node::Symbol(symbol) if self.quantity(*symbol).kind == Kind::Input);
        for &factor in factors {
            let node = self.graph.node(factor);
            match node {
                Node::Number(value) => left *= value,
                Node::Symbol(symbol) => match &self.quantity(*symbol).kind {
                    Kind::Parameter => gains.push(*symbol),
                    Kind::Input => inputs += 1,
                    _ => left *= self.known_value(node)?,
                },
                Node::Function(Function::Abs, of) if self.graph.leaves(*of).iter().all(is_input) => {}
                _ => return None,
            }
        }
        match gains[..] {
            [gain] if inputs == 1 && left < Rational::zero() => Some(gain),
            _ => None,
        }
    }

    /// The pattern of a name, or the first when no name is given.
    #[must_use]
    pub fn pattern(&self, name: Option<&str>) -> Option<&Pattern> {
        match name {
            None => self.patterns.first(),
            Some(_) => self.patterns.iter().find(|pattern| pattern.name.as_deref() == name),
        }
    }

    /// The highest time derivative of any coordinate in the equations.
    #[must_use]
    pub fn order(&self) -> u32 {
        let terms = self.equations.iter().flat_map(|equation| &equation.terms).map(|term| term.expr);
        let leaves = self.graph.leaves_of(terms);
        leaves
            .into_iter()
            .filter_map(|leaf| match self.graph.node(leaf) {
                Node::Derivative(_, order) => Some(*order),
                _ => None,
            })
            .max()
            .unwrap_or(0)
    }

    /// The model for sensors that read the rates of some coordinates and not their positions. Where only derivatives of such a coordinate
    /// stand in the equations, its rate takes its place, as a coordinate called `dot(x)`, and every order is one less; otherwise it stays, as
    /// one that no sensor measures. Patterns say how the coordinates themselves move, and are left out.
    #[must_use]
    pub fn with_rates_measured(mut self, coordinates: &[Coordinate]) -> Self {
        self.patterns.clear();
        let terms: Vec<ExprId> =
            self.equations.iter().flat_map(|equation| &equation.terms).map(|term| term.expr).collect();
        let leaves = self.graph.leaves_of(terms);
        let mut lowered = HashMap::new();
        for &coordinate in coordinates {
            let orders: Vec<(ExprId, u32)> = (leaves.iter())
                .filter_map(|&leaf| match self.graph.node(leaf) {
                    Node::Derivative(of, order) if *of == coordinate => Some((leaf, *order)),
                    _ => None,
                })
                .collect();
            let info = &mut self.coordinates[coordinate.0 as usize];
            if orders.iter().any(|(_, order)| *order == 0) {
                info.unmeasured = true;
                continue;
            }
            info.name = format!("dot({})", info.name);
            info.unit = info.unit.take().map(|unit| unit.mul(&Unit::named("s").pow(-1)));
            lowered.extend(
                orders.into_iter().map(|(leaf, order)| (leaf, self.graph.derivative_of(coordinate, order - 1))),
            );
        }
        for equation in &mut self.equations {
            for term in &mut equation.terms {
                term.expr = self.graph.substitute(term.expr, &lowered);
            }
        }
        self
    }

    /// Whether a sign occurs in the equations, so that a force jumps where its argument passes zero.
    #[must_use]
    pub fn has_jumps(&self) -> bool {
        let is_sign = |id| matches!(self.graph.node(id), Node::Function(Function::Sign, _));
        self.graph.ids().any(is_sign)
    }

    /// The name of an equation by its index, counted from 0: the input's name when exactly one input occurs in the
    /// terms, otherwise `eq1`, `eq2`, ...
    #[must_use]
    pub(crate) fn equation_name(&self, terms: &[SourceTerm], index: usize) -> String {
        let mut inputs: Vec<String> = terms
            .iter()
            .flat_map(|term| self.graph.leaves(term.expr))
            .filter_map(|leaf| match self.graph.node(leaf) {
                Node::Symbol(symbol) if self.quantity(*symbol).kind == Kind::Input => Some(self.display(leaf)),
                _ => None,
            })
            .collect();
        inputs.sort_unstable();
        inputs.dedup();
        match inputs.as_slice() {
            [single] => single.clone(),
            _ => format!("eq{}", index + 1),
        }
    }

    /// An expression of this model in the model language where it is short; otherwise the leaves on which it depends,
    /// as `f(q, dot(q), ...)`.
    #[must_use]
    pub fn display_short(&self, expr: ExprId) -> String {
        self.graph.display_short(expr, LONGEST_DISPLAYED, self)
    }

    /// An expression of this model for an error message; a long one is truncated.
    #[must_use]
    pub fn display_brief(&self, expr: ExprId) -> String {
        self.graph.display_brief(expr, self)
    }

    /// A source term as it occurs in its equation, truncated like [`Self::display_brief`].
    #[must_use]
    pub fn display_source(&self, id: TermId) -> String {
        let mut terms = self.equations.iter().flat_map(|equation| &equation.terms);
        terms.find(|term| term.id == id).map_or_else(String::new, |term| self.display_brief(term.expr))
    }

    /// Whether the model has a constant whose value is known.
    #[must_use]
    pub fn has_known_constants(&self) -> bool {
        self.symbols.iter().any(|quantity| matches!(quantity.kind, Kind::Constant { value: Some(_) }))
    }

    /// Whether the symbol of an index is a constant.
    pub fn is_constant(&self) -> impl Fn(usize) -> bool + '_ {
        |index| self.symbols.get(index).is_some_and(|quantity| matches!(quantity.kind, Kind::Constant { .. }))
    }

    /// The value of a leaf that is a constant of known value.
    #[must_use]
    pub fn known_value(&self, leaf: &Node) -> Option<Rational> {
        let Node::Symbol(symbol) = leaf else { return None };
        match &self.quantity(*symbol).kind {
            Kind::Constant { value } => value.clone(),
            _ => None,
        }
    }

    /// An expression of this model in the model language. Its length may be exponential in the number of nodes.
    #[must_use]
    pub fn display(&self, expr: ExprId) -> String {
        self.graph.display(expr, self)
    }

    /// The declared unit of a quantity as it stands behind its name, ` [m/s]`; nothing where none is declared.
    pub(crate) fn bracketed_unit(&self, symbol: Symbol) -> String {
        self.quantity(symbol).unit.as_ref().map_or_else(String::new, |unit| format!(" [{unit}]"))
    }
}

impl Names for ExactModel {
    fn symbol_name(&self, symbol: Symbol) -> String {
        self.quantity(symbol).name.to_string()
    }

    fn coordinate_name(&self, coordinate: Coordinate) -> String {
        self.coordinates[coordinate.0 as usize].name.clone()
    }
}
