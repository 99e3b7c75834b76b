//! Lowers a checked model to the exact model.
//!
//! Invariant: every source term of the exact model has a [`TermId`] by which [`Terms`] finds its place in the text, and
//! every statement of the text is in the result: an equation as its terms, a mechanism as the terms of its equations, a
//! `let` where it is used, a series as its Taylor polynomial, an energy as the terms of the Euler-Lagrange equations, a
//! pattern as Fourier polynomials, an expansion order in [`Lowered::taylor`]. Nothing is rounded.

mod dynamics;
mod expression;
mod mechanism;
mod motion;
mod nonlinear;

pub use expression::HIGHEST_ORDER;

use std::collections::HashMap;

use tpm_symbolic::expr::graph::{Coordinate, ExprId, Names as _, Node, Symbol};
use tpm_symbolic::expr::size::Sizes;
use tpm_symbolic::mechanics::model::{Elimination, ExactModel, Kind, Lump, Presliding, TermId};
use tpm_symbolic::mechanics::tree::mechanism::Mechanism;
use tpm_symbolic::mechanics::unit::Unit as FormalUnit;
use tpm_symbolic::number::rational::Rational;

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::language::ast::{self, Declaration, Item, PatternItem, Role, UnitExpr};
use crate::language::check::{Checked, SymbolKind};
use crate::language::lower::expression::{Environment, Lower};
use crate::source::Span;
use tpm_units::Unit;

/// Places of the source terms, by their [`TermId`]s.
#[derive(Clone, Debug, Default)]
pub struct Terms(Vec<Span>);

impl Terms {
    /// Adds a place and returns the identifier of its term.
    fn add(&mut self, span: Span) -> TermId {
        // A text has fewer terms than bytes, and its length in bytes fits 32 bits.
        let id = TermId(self.0.len() as u32);
        self.0.push(span);
        id
    }

    /// The place of a term; the beginning of the text for a term of another model.
    #[must_use]
    pub fn span(&self, term: TermId) -> Span {
        self.0.get(term.0 as usize).copied().unwrap_or_default()
    }
}

/// A declared Taylor order: terms that do not expand finitely in the coordinate become Taylor polynomials in tables.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Taylor {
    /// The coordinate.
    pub coordinate: Coordinate,
    /// The point of expansion, an expression of constants in the model's graph.
    pub point: ExprId,
    /// The highest power kept.
    pub order: u32,
    /// Where it is declared.
    pub span: Span,
}

/// The results of lowering.
pub(crate) struct Lowered {
    pub(crate) model: ExactModel,
    pub(crate) terms: Terms,
    pub(crate) taylor: Vec<Taylor>,
    /// Highest harmonic that each pattern keeps of terms with infinitely many.
    pub(crate) harmonics: Vec<Option<u32>>,
    /// The mechanism from which the equations of motion were derived.
    pub(crate) mechanism: Option<Mechanism>,
}

/// Lowers a model that passed its checks; faults that appear only now go to `diagnostics`.
pub(crate) fn lower(model: &ast::ModelDeclaration, checked: &Checked<'_>, diagnostics: &mut Diagnostics) -> Lowered {
    let mut lowering = Lowering {
        checked,
        diagnostics,
        model: ExactModel { name: model.name.name.clone(), ..ExactModel::default() },
        terms: Terms::default(),
        names: HashMap::new(),
        values: HashMap::new(),
        taylor: Vec::new(),
        harmonics: Vec::new(),
        mechanism: None,
    };
    lowering.declarations(model);
    lowering.mechanism(model);
    lowering.statements(model);
    lowering.dynamics(model);
    lowering.check_following(model);
    lowering.refuse_too_long();
    lowering.check_nonlinear(model);
    lowering.patterns(model);
    let Lowering { model, terms, taylor, harmonics, mechanism, .. } = lowering;
    Lowered { model, terms, taylor, harmonics, mechanism }
}

/// Lowers an expression of a model's parameters and constants; faults go to `diagnostics`.
pub(crate) fn lower_value(expr: &ast::Expr, model: &mut ExactModel, diagnostics: &mut Diagnostics) -> Option<ExprId> {
    let known: Vec<(String, Symbol)> = model
        .symbols_where(|kind| matches!(kind, Kind::Parameter | Kind::Constant { .. }))
        .map(|symbol| (model.symbol_name(symbol), symbol))
        .collect();
    let mut names = HashMap::new();
    for (name, symbol) in &known {
        names.insert(name.as_str(), model.graph.symbol(*symbol));
    }
    let mut unknown = false;
    expr.walk(&mut |part| {
        if let ast::ExprKind::Name(name) = &part.kind
            && name != "pi"
            && !names.contains_key(name.as_str())
        {
            unknown = true;
            let message = format!("`{name}` is no parameter or constant of model {}", model.name);
            let has = known.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
            diagnostics.push(Diagnostic::error(part.span, message).help(format!("it has {has}")));
        }
    });
    if unknown {
        return None;
    }
    let lowered = Environment { model, names: &names }.lower(expr);
    lowered.map_err(|error| diagnostics.push(error)).ok()
}

struct Lowering<'a, 'c, 'd> {
    checked: &'c Checked<'a>,
    diagnostics: &'d mut Diagnostics,
    model: ExactModel,
    terms: Terms,
    /// The expression of every name of the model.
    names: HashMap<&'a str, ExprId>,
    /// The constants that are known exactly.
    values: HashMap<&'a str, Rational>,
    taylor: Vec<Taylor>,
    harmonics: Vec<Option<u32>>,
    mechanism: Option<Mechanism>,
}

impl<'a> Lowering<'a, '_, '_> {
    /// The value, or `None` after the fault has been added to the diagnostics.
    fn keep<T>(&mut self, result: Lower<T>) -> Option<T> {
        result.map_err(|error| self.diagnostics.push(error)).ok()
    }

    fn expression(&mut self, expr: &ast::Expr) -> Lower<ExprId> {
        Environment { model: &mut self.model, names: &self.names }.lower(expr)
    }

    /// Coordinates that follow from others stand behind all of these, so that equations have the numbers of their coordinates.
    fn declarations(&mut self, model: &'a ast::ModelDeclaration) {
        let mut following = Vec::new();
        for item in &model.items {
            match item {
                Item::Declaration(declaration) if declaration.presliding.is_some() => following.push(declaration),
                Item::Declaration(declaration) => self.declare(declaration),
                Item::Nonlinear(parameters) => parameters.iter().for_each(|own| self.declare_nonlinear(own)),
                Item::Series(series) if series.definition.is_none() => self.declare_coefficients(series),
                _ => {}
            }
        }
        following.into_iter().for_each(|declaration| self.declare(declaration));
    }

    fn declare(&mut self, declaration: &'a Declaration) {
        for quantity in &declaration.quantities {
            let name = quantity.name.name.as_str();
            let unit = quantity.unit.as_ref().map(formal);
            let kind = match declaration.role {
                Role::Coordinate => {
                    let coordinate = self.model.declare_coordinate(name, unit);
                    self.model.coordinates[coordinate.0 as usize].unmeasured = declaration.unmeasured;
                    if let Some(own) = &declaration.presliding {
                        let travel = self.travel(own);
                        let of = self.coordinate(&own.coordinate.name);
                        let follows = of.zip(self.keep(travel)).map(|(of, travel)| Presliding { of, travel });
                        self.model.coordinates[coordinate.0 as usize].presliding = follows;
                    }
                    let expr = self.model.graph.derivative_of(coordinate, 0);
                    self.names.insert(name, expr);
                    continue;
                }
                Role::Input => Kind::Input,
                Role::Parameter => Kind::Parameter,
                Role::Constant | Role::Amplitude | Role::Frequency => {
                    let value = quantity.value.as_ref().and_then(|value| {
                        let result = expression::exact(value, &self.values);
                        self.keep(result)
                    });
                    if let Some(value) = &value {
                        self.values.insert(name, value.clone());
                    }
                    Kind::Constant { value }
                }
            };
            let symbol = self.model.declare(name, unit, kind);
            let expr = self.model.graph.symbol(symbol);
            self.names.insert(name, expr);
        }
    }

    /// The travel over which friction builds up.
    fn travel(&self, own: &ast::PreslidingOf) -> Lower<Rational> {
        let travel = expression::exact(&own.travel, &self.values)?;
        if travel > Rational::from_integer(0.into()) {
            return Ok(travel);
        }
        let message = "friction builds up over a travel, which is larger than zero";
        Err(Diagnostic::error(own.travel.span, message).help("write it in the unit of the coordinate: 0.001"))
    }

    /// Friction that has built up is a force: it has no rate, and no energy.
    fn check_following(&mut self, model: &'a ast::ModelDeclaration) {
        let following: Vec<&ast::Ident> = model.following().collect();
        if following.is_empty() {
            return;
        }
        let terms: Vec<ExprId> =
            self.model.equations.iter().flat_map(|equation| &equation.terms).map(|term| term.expr).collect();
        let leaves = self.model.graph.leaves_of(terms);
        for name in following {
            let Some(own) = self.coordinate(&name.name) else { continue };
            let is_rate = |leaf: &ExprId| matches!(self.model.graph.node(*leaf), Node::Derivative(of, order) if *of == own && *order > 0);
            let in_energy = model.items.iter().any(|item| match item {
                Item::Energy(energy) => mentions(&energy.value, &name.name),
                _ => false,
            });
            if leaves.iter().any(is_rate) || in_energy {
                let message =
                    format!("`{}` is how far friction has built up, which has no rate and no energy", name.name);
                self.diagnostics.push(
                    Diagnostic::error(name.span, message).help(format!(
                        "multiply it by a force in an equation, or in `force q = ...;`: -fp*{}",
                        name.name
                    )),
                );
            }
        }
    }

    /// The coefficients of an unknown function are parameters; their units follow from the function's and the coordinate's.
    fn declare_coefficients(&mut self, series: &'a ast::SeriesDeclaration) {
        let argument =
            self.checked.symbols.model.get(series.coordinate.name.as_str()).and_then(|symbol| symbol.unit.clone());
        let index = match self.checked.symbols.model.get(series.function.name.as_str()).map(|symbol| symbol.kind) {
            Some(SymbolKind::Function(index)) => index,
            _ => return,
        };
        let function = self.checked.series_units.get(index).cloned().flatten();
        for (power, name) in (0_i64..).zip(&series.coefficients) {
            let unit = match (&series.unit, &function, &argument, power) {
                (Some(unit), _, _, 0) => Some(formal(unit)),
                (None, Some(function), _, 0) => written(function),
                (_, Some(function), Some(argument), _) => {
                    let unit = argument.power((-power).into()).and_then(|power| function.times(&power));
                    unit.as_ref().and_then(written)
                }
                _ => None,
            };
            let symbol = self.model.declare(&name.name, unit, Kind::Parameter);
            let expr = self.model.graph.symbol(symbol);
            self.names.insert(&name.name, expr);
        }
    }

    /// Statements that define names or orders of expansion, in the order of the text.
    fn statements(&mut self, model: &'a ast::ModelDeclaration) {
        for item in &model.items {
            match item {
                Item::Series(series) => {
                    let result = self.series(series);
                    self.keep(result);
                }
                Item::Let(definition) => {
                    let result = self.expression(&definition.value);
                    if let Some(expr) = self.keep(result) {
                        self.names.insert(&definition.name.name, expr);
                    }
                }
                Item::Lump(definition) => {
                    let result = self.expression(&definition.value);
                    if let Some(expr) = self.keep(result) {
                        let id = self.terms.add(definition.name.span);
                        self.model.lumps.push(Lump { name: definition.name.name.clone(), expr, id });
                    }
                }
                Item::Eliminate(eliminate) => {
                    let coordinates =
                        eliminate.coordinates.iter().filter_map(|name| self.coordinate(&name.name)).collect();
                    self.model.eliminations.push(Elimination { coordinates, prefix: eliminate.stem.name.clone() });
                }
                Item::Taylor(taylor) => {
                    let result = bounded(taylor.order).and_then(|order| Ok((order, self.expression(&taylor.point)?)));
                    if let (Some((order, point)), Some(coordinate)) =
                        (self.keep(result), self.coordinate(&taylor.coordinate.name))
                    {
                        self.taylor.push(Taylor { coordinate, point, order, span: taylor.coordinate.span });
                    }
                }
                Item::Declaration(_)
                | Item::Nonlinear(_)
                | Item::Equation(_)
                | Item::Energy(_)
                | Item::Force(_)
                | Item::Mechanism(_)
                | Item::Pattern(_) => {}
            }
        }
    }

    /// f(q) = sum_k a_k (q - q0)^k, with the a_k as new parameters (Feng, Eqns 5.5-5.7) or from the derivatives of f's
    /// definition.
    fn series(&mut self, series: &'a ast::SeriesDeclaration) -> Lower<()> {
        let order = bounded(series.order)?;
        let point = self.expression(&series.point)?;
        let Some(&coordinate) = self.names.get(series.coordinate.name.as_str()) else { return Ok(()) };
        let mut coefficients = Vec::new();
        match &series.definition {
            None => coefficients
                .extend(series.coefficients.iter().filter_map(|name| self.names.get(name.name.as_str()).copied())),
            Some(definition) => {
                let mut derivative = self.expression(definition)?;
                let at_point = HashMap::from([(coordinate, point)]);
                let mut factorial = Rational::from_integer(1.into());
                for k in 0..=order {
                    if k > 0 {
                        derivative = self.model.graph.differentiate(derivative, coordinate);
                        factorial *= Rational::from_integer(k.into());
                    }
                    let value = self.model.graph.substitute(derivative, &at_point);
                    expression::regular(&self.model, value, definition.span).map_err(|error| {
                        error.help(format!("`{}` has no Taylor series about this point", series.function.name))
                    })?;
                    coefficients.push(self.model.graph.scale(value, factorial.recip()));
                }
                for (name, &expr) in series.coefficients.iter().zip(&coefficients) {
                    self.names.insert(&name.name, expr);
                    let id = self.terms.add(name.span);
                    self.model.lumps.push(Lump { name: name.name.clone(), expr, id });
                }
            }
        }
        let graph = &mut self.model.graph;
        let distance = graph.sub(coordinate, point);
        let mut terms = Vec::new();
        for (k, coefficient) in (0_i32..).zip(coefficients) {
            let power = graph.pow(distance, k);
            terms.push(graph.mul(coefficient, power));
        }
        let sum = graph.sum(&terms);
        self.names.insert(&series.function.name, sum);
        Ok(())
    }

    /// Refuses equations that are too long for statements which require them multiplied out.
    fn refuse_too_long(&mut self) {
        if self.model.eliminations.is_empty() {
            return;
        }
        let mut sizes = Sizes::default();
        for term in self.model.equations.iter().flat_map(|equation| &equation.terms) {
            if sizes.of(&self.model.graph, term.expr) > expression::MOST_TERMS {
                let fault = too_long(self.terms.span(term.id), "eliminating coordinates");
                self.diagnostics.push(fault.help("keep the coordinates, or write the equations shorter"));
            }
        }
    }

    fn coordinate(&self, name: &str) -> Option<Coordinate> {
        let index = self.model.coordinates.iter().position(|coordinate| coordinate.name == name)?;
        u32::try_from(index).ok().map(Coordinate)
    }

    /// An amplitude or frequency; patterns that declare the same one in the same unit share it.
    fn pattern_symbol(&mut self, name: &str, unit: Option<FormalUnit>, kind: Kind) -> Symbol {
        let same =
            self.model.symbols.iter().position(|other| other.name == name && other.unit == unit && other.kind == kind);
        match same.and_then(|index| u32::try_from(index).ok()) {
            Some(index) => Symbol(index),
            None => self.model.declare(name, unit, kind),
        }
    }

    fn patterns(&mut self, model: &'a ast::ModelDeclaration) {
        for item in &model.items {
            if let Item::Pattern(pattern) = item {
                self.pattern(pattern);
            }
        }
    }

    fn pattern(&mut self, pattern: &'a ast::PatternDeclaration) {
        let mut scope = motion::Scope { symbols: HashMap::new(), values: self.values.clone(), frequency: None };
        for constant in self.model.known_constants().collect::<Vec<_>>() {
            scope.symbols.insert(self.model.quantity(constant).name.to_string(), constant);
        }
        let (mut amplitudes, mut frequency, mut harmonics) = (Vec::new(), None, None);
        for item in &pattern.items {
            match item {
                PatternItem::Declaration(declaration) => {
                    for quantity in &declaration.quantities {
                        let unit = quantity.unit.as_ref().map(formal);
                        let kind = if declaration.role == Role::Frequency { Kind::Frequency } else { Kind::Amplitude };
                        let symbol = self.pattern_symbol(&quantity.name.name, unit, kind);
                        scope.symbols.insert(quantity.name.name.clone(), symbol);
                        if declaration.role == Role::Frequency {
                            frequency = Some(symbol);
                            scope.frequency = Some(quantity.name.name.clone());
                        } else {
                            amplitudes.push(symbol);
                        }
                    }
                }
                PatternItem::Harmonics(count) => harmonics = Some(count.value),
                PatternItem::Motion(_) => {}
            }
        }
        // A pattern without a frequency is reported by the checks.
        let Some(frequency) = frequency else { return };
        let mut motions = vec![None; self.model.coordinates.len()];
        for item in &pattern.items {
            let PatternItem::Motion(motion) = item else { continue };
            let result = scope.motion(&motion.value);
            if let (Some(value), Some(Coordinate(index))) =
                (self.keep(result), self.coordinate(&motion.coordinate.name))
            {
                motions[index as usize] = Some(value);
            }
        }
        let name = pattern.name.as_ref().map(|name| name.name.clone());
        self.model.patterns.push(tpm_symbolic::mechanics::pattern::Pattern { name, amplitudes, frequency, motions });
        self.harmonics.push(harmonics);
    }
}

/// A unit as written, for display.
fn formal(unit: &UnitExpr) -> FormalUnit {
    FormalUnit::product(unit.factors.iter().map(|(name, exponent)| (name.name.as_str(), *exponent)))
}

/// A derived unit as a product of base units; `None` when it has a scale factor, which has no name.
fn written(unit: &Unit) -> Option<FormalUnit> {
    Some(FormalUnit::product(unit.base_powers()?).with_torque())
}

/// Whether a name stands in an expression.
fn mentions(expr: &ast::Expr, name: &str) -> bool {
    let mut found = false;
    expr.walk(&mut |part| found |= matches!(&part.kind, ast::ExprKind::Name(own) if own == name));
    found
}

/// The fault that a term is too long to be multiplied out, as `what` requires.
fn too_long(span: Span, what: &str) -> Diagnostic {
    let most = expression::MOST_TERMS;
    Diagnostic::error(span, format!("{what} would multiply this out to more than {most} terms, which is too large"))
}

fn bounded(order: ast::Count) -> Lower<u32> {
    if order.value > HIGHEST_ORDER {
        return Err(Diagnostic::error(order.span, format!("order {} is higher than {HIGHEST_ORDER}", order.value))
            .help("Taylor polynomials of such an order say nothing more; lower it"));
    }
    Ok(order.value)
}
