//! Checks that every term has the unit of its equation's right-hand side.
//!
//! Invariant: a [`Dimension`] is exact or unknown. A quantity declared without a unit has an unknown dimension, and
//! expressions that contain it are not checked. The unit of a series function without a stated one is an unknown that
//! the equations determine: passes without reports solve for these unknowns until nothing changes, then one pass
//! reports.

use std::collections::{BTreeMap, HashMap};

use num_rational::Ratio;
use num_traits::{CheckedAdd, CheckedMul, Zero};

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::language::ast::mechanism::{
    InertiaDeclaration, JointDeclaration, JointMotion, MechanismDeclaration, MechanismItem, Placement,
};
use crate::language::ast::{EnergyKind, Expr, ExprKind, Ident, Item, ModelDeclaration, Operation, PatternItem, Role};
use crate::language::check::parameters::turns;
use crate::language::check::symbols::{Scope, Symbol, SymbolKind, Symbols, resolve};
use crate::language::function::{Clause, Function};
use crate::language::lex::shorten;
use crate::source::{Source, Span};
use tpm_units::{Exponent, Unit};

pub(super) fn check(
    model: &ModelDeclaration,
    symbols: &Symbols<'_>,
    source: &Source,
    diagnostics: &mut Diagnostics,
) -> Vec<Option<Unit>> {
    let (bound, mut found) = checked(model, symbols, source);
    let count = |found: &Diagnostics| found.iter().count() + found.omitted();
    // Functions take angles in rad: what another unit of a coordinate does to all its terms is one fault.
    let turned = |symbol: &Symbol| {
        let angle = matches!(symbol.kind, SymbolKind::Quantity(Role::Coordinate | Role::Amplitude));
        angle && symbol.unit.as_ref().is_some_and(|unit| !unit.is_one() && unit.same_dimension(&Unit::one()))
    };
    if found.has_errors() && symbols.model.values().any(turned) {
        let mut in_radians = symbols.clone();
        for scope in std::iter::once(&mut in_radians.model).chain(&mut in_radians.patterns) {
            scope.values_mut().filter(|symbol| turned(symbol)).for_each(|symbol| symbol.unit = Some(Unit::one()));
        }
        let mut named: Vec<_> = symbols.model.iter().filter(|(_, symbol)| turned(symbol)).collect();
        named.sort_by_key(|(_, symbol)| symbol.span);
        let (_, others) = checked(model, &in_radians, source);
        if count(&others) + named.len() < count(&found) {
            found = others;
            for (name, symbol) in named {
                let factor = symbol.unit.as_ref().map_or_else(String::new, |unit| unit.factor(&Unit::one()));
                let message = format!("`{name}` is in a unit of {factor} rad, and the equations take it in rad");
                found.push(Diagnostic::error(symbol.span, message).help(format!(
                    "write `coordinate {name} [rad]`; readings of a log are converted, by the unit in the column's header or by `--scale {name}={factor}`"
                )));
            }
        }
    }
    found.iter().for_each(|fault| diagnostics.push(fault.clone()));
    bound
}

/// The units of the series functions, and what is wrong with those of the terms.
fn checked(model: &ModelDeclaration, symbols: &Symbols<'_>, source: &Source) -> (Vec<Option<Unit>>, Diagnostics) {
    let series: Vec<_> = model
        .items
        .iter()
        .filter_map(|item| if let Item::Series(series) = item { Some(series) } else { None })
        .collect();
    let mut bound: Vec<Option<Unit>> = series
        .iter()
        .map(|series| symbols.model.get(series.function.name.as_str()).and_then(|symbol| symbol.unit.clone()))
        .collect();
    let arguments: Vec<_> = series.iter().map(|series| series.coordinate.name.as_str()).collect();
    let torque = written_torque(model);
    loop {
        let before = bound.iter().flatten().count();
        let mut found = Diagnostics::new();
        Round::new(symbols, source, &arguments, &torque, &mut bound, &mut found).visit(model);
        if bound.iter().flatten().count() == before {
            return (bound, found);
        }
    }
}

/// Spelling of the common unit of torques and energies: that of an input, else that of any other quantity in the model;
/// `N*m` where none has it.
fn written_torque(model: &ModelDeclaration) -> String {
    let declarations = |of_inputs: bool| {
        model.items.iter().filter_map(move |item| match item {
            Item::Declaration(declaration) if (declaration.role == Role::Input) == of_inputs => Some(declaration),
            _ => None,
        })
    };
    let quantities = declarations(true).chain(declarations(false)).flat_map(|declaration| &declaration.quantities);
    let mut units = quantities.filter_map(|quantity| quantity.unit.as_ref());
    // Unknown unit names are reported when the units of quantities are resolved.
    let shared = units.find(|unit| resolve(unit, &mut Diagnostics::new()).is_some_and(|unit| unit.is_torque()));
    shared.map_or_else(|| "N*m".to_owned(), |unit| unit.to_string().trim_matches(['[', ']']).to_owned())
}

/// The unit of an expression: exact up to powers of the unknown units of series functions, or unknown.
#[derive(Clone, PartialEq, Debug)]
enum Dimension {
    Unknown,
    Known(Box<Unit>, BTreeMap<usize, Exponent>),
}

impl Dimension {
    fn of(unit: Unit) -> Self {
        Self::Known(Box::new(unit), BTreeMap::new())
    }

    fn one() -> Self {
        Self::of(Unit::one())
    }

    /// `self * other^exponent`; none when an exponent exceeds 64 bits.
    fn times_power(&self, other: &Self, exponent: Exponent) -> Option<Self> {
        let (Self::Known(left, left_unknowns), Self::Known(right, right_unknowns)) = (self, other) else {
            return Some(Self::Unknown);
        };
        let mut unknowns = left_unknowns.clone();
        for (&index, power) in right_unknowns {
            let sum = power.checked_mul(&exponent)?.checked_add(unknowns.get(&index).unwrap_or(&Exponent::zero()))?;
            if sum.is_zero() {
                unknowns.remove(&index);
            } else {
                unknowns.insert(index, sum);
            }
        }
        Some(Self::Known(Box::new(left.times(&right.power(exponent)?)?), unknowns))
    }
}

/// The unit with which terms are compared, and its origin.
struct Reference {
    dimension: Dimension,
    span: Span,
    /// The item that has this unit, for messages.
    what: String,
}

struct Round<'a, 's, 'd> {
    symbols: &'s Symbols<'a>,
    source: &'s Source,
    /// The coordinates that are the arguments of the series functions.
    arguments: &'s [&'a str],
    /// Spelling of the unit of torques and energies.
    torque: &'s str,
    bound: &'s mut [Option<Unit>],
    lets: HashMap<&'a str, Dimension>,
    /// The pattern to which the current expressions belong.
    local: Option<&'s Scope<'a>>,
    diagnostics: &'d mut Diagnostics,
}

impl<'a, 's, 'd> Round<'a, 's, 'd> {
    fn new(
        symbols: &'s Symbols<'a>,
        source: &'s Source,
        arguments: &'s [&'a str],
        torque: &'s str,
        bound: &'s mut [Option<Unit>],
        diagnostics: &'d mut Diagnostics,
    ) -> Self {
        Self { symbols, source, arguments, torque, bound, lets: HashMap::new(), local: None, diagnostics }
    }

    fn visit(&mut self, model: &'a ModelDeclaration) {
        let mut series_index = 0;
        let mut pattern_index = 0;
        let kinetic = model.items.iter().find_map(|item| match item {
            Item::Energy(energy) if energy.kind == EnergyKind::Kinetic => Some(energy),
            _ => None,
        });
        // Energies are compared once the `let`s that they use are known.
        let mut later = Vec::new();
        let mut mechanism = None;
        // Statements in the order of the text.
        for item in &model.items {
            match item {
                Item::Declaration(declaration) => {
                    let travel = declaration.presliding.as_ref().map(|own| &own.travel);
                    let values = declaration.quantities.iter().filter_map(|quantity| quantity.value.as_ref());
                    for value in values.chain(travel) {
                        self.dimension(value);
                    }
                }
                Item::Nonlinear(parameters) => {
                    // Interval bounds are numbers in the parameter's own unit, as the values of constants are.
                    for end in parameters.iter().flat_map(|parameter| [&parameter.from, &parameter.to]) {
                        self.dimension(end);
                    }
                }
                Item::Series(series) => {
                    self.expect(
                        &series.point,
                        self.quantity(&series.coordinate),
                        series.coordinate.span,
                        &format!("`{}`", series.coordinate.name),
                    );
                    if let Some(definition) = &series.definition {
                        let function = self.series(series_index);
                        self.expect(definition, function, series.function.span, &format!("`{}`", series.function.name));
                    }
                    series_index += 1;
                }
                Item::Let(definition) => {
                    let dimension = self.dimension(&definition.value);
                    self.lets.insert(&definition.name.name, dimension);
                }
                Item::Lump(definition) => {
                    self.dimension(&definition.value);
                }
                Item::Taylor(taylor) => {
                    self.expect(
                        &taylor.point,
                        self.quantity(&taylor.coordinate),
                        taylor.coordinate.span,
                        &format!("`{}`", taylor.coordinate.name),
                    );
                }
                Item::Equation(equation) => self.equation(&equation.left, &equation.right),
                Item::Mechanism(item) => {
                    self.mechanism(item);
                    mechanism = Some(item);
                }
                Item::Energy(_) | Item::Force(_) => later.push(item),
                Item::Eliminate(_) => {}
                Item::Pattern(pattern) => {
                    self.local = self.symbols.patterns.get(pattern_index);
                    pattern_index += 1;
                    for item in &pattern.items {
                        if let PatternItem::Motion(motion) = item {
                            let coordinate = self.quantity(&motion.coordinate);
                            self.expect(
                                &motion.value,
                                coordinate,
                                motion.coordinate.span,
                                &format!("`{}`", motion.coordinate.name),
                            );
                        }
                    }
                    self.local = None;
                }
            }
        }
        // Energies and forces are compared with the unit of the kinetic energy.
        let energy = kinetic.map(|kinetic| (self.terms(&kinetic.value, None), kinetic.keyword));
        for item in later {
            match (item, &energy) {
                (Item::Energy(item), Some((energy, span))) if item.kind == EnergyKind::Potential => {
                    self.expect(&item.value, energy.clone(), *span, "the kinetic energy");
                }
                (Item::Energy(item), Some((energy, span))) if item.kind == EnergyKind::Dissipation => {
                    let power = self.combine(energy, &Dimension::of(Unit::second()), -1, item.keyword);
                    self.expect(&item.value, power, *span, "the kinetic energy per second");
                }
                (Item::Force(item), Some((energy, span))) => {
                    let coordinate = self.quantity(&item.coordinate);
                    let force = self.combine(energy, &coordinate, -1, item.coordinate.span);
                    self.expect(
                        &item.value,
                        force,
                        *span,
                        &format!("the kinetic energy per `{}`", item.coordinate.name),
                    );
                }
                (Item::Energy(item), _) if item.kind != EnergyKind::Kinetic => {
                    self.terms(&item.value, None);
                }
                (Item::Force(item), _) => match mechanism.and_then(|mechanism| joint_of(mechanism, &item.coordinate)) {
                    Some((joint, turns)) => {
                        let what = format!("the torque on `{}`", item.coordinate.name);
                        self.expect(&item.value, torque(turns), joint, &what);
                    }
                    None => {
                        self.terms(&item.value, None);
                    }
                },
                _ => {}
            }
        }
    }

    /// Rotating joints have coordinates in rad and torques, sliding joints have coordinates in m and forces. Named
    /// quantities in the geometry are in m.
    fn mechanism(&mut self, mechanism: &'a MechanismDeclaration) {
        for item in &mechanism.items {
            match item {
                MechanismItem::Gravity(gravity) => {
                    self.geometry(&gravity.components, "m/s^2", gravity.span, "an acceleration");
                }
                MechanismItem::Body(body) => {
                    if let Some(joint) = &body.joint {
                        self.placement(&joint.placement);
                        self.joint(joint);
                    }
                    if let Some(InertiaDeclaration::Known(inertia)) = &body.inertia {
                        self.placement(&inertia.placement);
                        self.geometry([&inertia.mass], "kg", inertia.keyword, "a mass");
                        let moments = inertia.moments.iter().flatten();
                        self.geometry(moments, "kg*m^2", inertia.keyword, "a moment of inertia");
                    }
                }
                MechanismItem::Drive(drive) => {
                    let Some(input) = &drive.input else { continue };
                    if self.symbol(&input.name).is_none_or(|symbol| symbol.kind != SymbolKind::Quantity(Role::Input)) {
                        continue;
                    }
                    let found = self.quantity(input);
                    let turns = turns(mechanism, drive);
                    let what = if turns { "the torque of this drive" } else { "the force of this drive" };
                    let reference =
                        Reference { dimension: torque(turns), span: drive.name.span, what: what.to_owned() };
                    self.compare(input.span, &found, &reference);
                }
            }
        }
    }

    fn joint(&mut self, joint: &JointDeclaration) {
        let (coordinate, unit, what) = match &joint.motion {
            JointMotion::Fixed => return,
            JointMotion::Revolute(name, _) => (name, "rad", "the coordinate of a joint that turns"),
            JointMotion::Prismatic(name, _) => (name, "m", "the coordinate of a joint that slides"),
        };
        let found = self.quantity(coordinate);
        match &joint.factor {
            Some(factor) => {
                let ratio = self.combine(&known(unit), &found, -1, factor.span);
                self.with_names(factor, ratio, joint.keyword, "the position of the joint per coordinate");
            }
            None => {
                let reference = Reference { dimension: known(unit), span: joint.keyword, what: what.to_owned() };
                self.compare(coordinate.span, &found, &reference);
            }
        }
    }

    fn placement(&mut self, placement: &'a Placement) {
        if let Some(at) = &placement.at {
            self.geometry(&at.components, "m", at.span, "a length");
        }
    }

    /// Compares named quantities with a unit; a plain number has that unit.
    fn geometry<'e>(&mut self, exprs: impl IntoIterator<Item = &'e Expr>, unit: &str, span: Span, what: &str) {
        for expr in exprs {
            self.with_names(expr, known(unit), span, what);
        }
    }

    /// Compares an expression in which names occur with a dimension.
    fn with_names(&mut self, expr: &Expr, dimension: Dimension, span: Span, what: &str) {
        let mut names = false;
        expr.walk(&mut |part| names |= matches!(part.kind, ExprKind::Name(_)));
        if names {
            self.expect(expr, dimension, span, what);
        }
    }

    fn equation(&mut self, left: &Expr, right: &Expr) {
        if right.is_zero() {
            self.terms(left, None);
            return;
        }
        let dimension = self.terms(right, None);
        match dimension {
            Dimension::Unknown => {
                self.terms(left, None);
            }
            dimension => {
                let what = match &right.kind {
                    ExprKind::Name(name) => format!("`{name}` on the right-hand side"),
                    _ => "the right-hand side".to_owned(),
                };
                self.terms(left, Some(Reference { dimension, span: right.span, what }));
            }
        }
    }

    /// Requires that every term of an expression has this unit, when it is known.
    fn expect(&mut self, expr: &Expr, dimension: Dimension, span: Span, what: &str) {
        let reference = match dimension {
            Dimension::Unknown => None,
            dimension => Some(Reference { dimension, span, what: what.to_owned() }),
        };
        self.terms(expr, reference);
    }

    /// Compares the terms of an expression with a reference, or with the first of them whose unit is known; returns their unit.
    fn terms(&mut self, expr: &Expr, reference: Option<Reference>) -> Dimension {
        let terms = expr.terms();
        let dimensions: Vec<_> = terms
            .iter()
            .map(|(_, term)| if term.is_zero() { Dimension::Unknown } else { self.dimension(term) })
            .collect();
        let reference = reference.or_else(|| {
            let complete =
                |dimension: &Dimension| matches!(dimension, Dimension::Known(_, unknowns) if unknowns.is_empty());
            let known = |dimension: &Dimension| *dimension != Dimension::Unknown;
            let index = dimensions.iter().position(complete).or_else(|| dimensions.iter().position(known))?;
            let span = terms[index].1.span;
            let what = format!("`{}`", shorten(self.source.slice(span)));
            Some(Reference { dimension: dimensions[index].clone(), span, what })
        });
        let Some(reference) = reference else { return Dimension::Unknown };
        for ((_, term), dimension) in terms.iter().zip(&dimensions) {
            self.compare(term.span, dimension, &reference);
        }
        reference.dimension
    }

    fn compare(&mut self, span: Span, dimension: &Dimension, reference: &Reference) {
        let (dimension, wanted) = (self.settle(dimension), self.settle(&reference.dimension));
        let Some(Dimension::Known(ratio, unknowns)) = dimension.times_power(&wanted, Exponent::from_integer(-1)) else {
            return;
        };
        let mut iter = unknowns.iter();
        match (iter.next(), iter.next()) {
            (None, _) if ratio.is_one() => {}
            (None, _) => {
                if let (Dimension::Known(found, _), Dimension::Known(wanted, _)) = (&dimension, &wanted) {
                    let diagnostic = mismatch(span, found, wanted, reference, self.torque);
                    self.diagnostics.push(diagnostic);
                }
            }
            // With one unknown, this comparison determines it.
            (Some((&index, exponent)), None) => self.bound[index] = ratio.power(-exponent.recip()),
            _ => {}
        }
    }

    /// The dimension in which the unknowns that were determined so far are replaced by their units.
    fn settle(&self, dimension: &Dimension) -> Dimension {
        let Dimension::Known(unit, unknowns) = dimension else { return Dimension::Unknown };
        let mut settled = Some(Dimension::of(unit.as_ref().clone()));
        for (&index, &exponent) in unknowns {
            let factor = self.series(index);
            settled = settled.and_then(|settled| settled.times_power(&factor, exponent));
        }
        settled.unwrap_or(Dimension::Unknown)
    }

    fn series(&self, index: usize) -> Dimension {
        match self.bound.get(index) {
            Some(Some(unit)) => Dimension::of(unit.clone()),
            Some(None) => Dimension::Known(Box::new(Unit::one()), BTreeMap::from([(index, Exponent::from_integer(1))])),
            None => Dimension::Unknown,
        }
    }

    fn symbol(&self, name: &str) -> Option<&'s Symbol> {
        self.local.and_then(|scope| scope.get(name)).or_else(|| self.symbols.model.get(name))
    }

    fn quantity(&self, name: &Ident) -> Dimension {
        self.named(&name.name)
    }

    fn named(&self, name: &str) -> Dimension {
        match name {
            "pi" => return Dimension::one(),
            "t" => return Dimension::of(Unit::second()),
            _ => {}
        }
        match self.symbol(name).map(|symbol| (symbol.kind, &symbol.unit)) {
            Some((SymbolKind::Quantity(_) | SymbolKind::Nonlinear, Some(unit))) => Dimension::of(unit.clone()),
            Some((SymbolKind::Function(index), _)) => self.series(index),
            Some((SymbolKind::Coefficient(index, power), _)) => {
                // Other names than coordinates are refused elsewhere; a coefficient of the series itself would be a
                // circular definition.
                let is_quantity = |name: &&&str| {
                    self.symbol(name).is_some_and(|symbol| matches!(symbol.kind, SymbolKind::Quantity(_)))
                };
                let argument =
                    self.arguments.get(index).filter(is_quantity).map_or(Dimension::Unknown, |name| self.named(name));
                // The power is an index in a list of names, so it fits.
                let exponent = Exponent::from_integer(-(power as i64));
                let argument = if power == 0 { Dimension::one() } else { argument };
                self.series(index).times_power(&argument, exponent).unwrap_or(Dimension::Unknown)
            }
            Some((SymbolKind::Let, _)) => self.lets.get(name).cloned().unwrap_or(Dimension::Unknown),
            _ => Dimension::Unknown,
        }
    }

    /// `left * right^exponent`, with a report when an exponent exceeds 64 bits.
    fn combine(&mut self, left: &Dimension, right: &Dimension, exponent: i64, span: Span) -> Dimension {
        left.times_power(right, Ratio::from_integer(exponent)).unwrap_or_else(|| {
            self.diagnostics.push(
                Diagnostic::error(span, "this power is too high for its unit to be written").help("lower the exponent"),
            );
            Dimension::Unknown
        })
    }

    fn dimension(&mut self, expr: &Expr) -> Dimension {
        match &expr.kind {
            ExprKind::Number(_) => Dimension::one(),
            ExprKind::Name(name) => self.named(name),
            ExprKind::Negative(inner) => self.dimension(inner),
            ExprKind::Sum(_) => self.terms(expr, None),
            ExprKind::Product(factors) => {
                let mut product = Dimension::one();
                for (operation, factor) in factors {
                    let dimension = self.dimension(factor);
                    let exponent = if *operation == Operation::Times { 1 } else { -1 };
                    product = self.combine(&product, &dimension, exponent, expr.span);
                }
                product
            }
            ExprKind::Power(base, exponent) => {
                let dimension = self.dimension(base);
                self.combine(&Dimension::one(), &dimension, i64::from(*exponent), expr.span)
            }
            ExprKind::Call(name, arguments) => self.call(name, arguments, expr.span),
        }
    }

    fn call(&mut self, name: &Ident, arguments: &[Expr], span: Span) -> Dimension {
        if Function::from_name(&name.name) == Some(Function::Shape) {
            return self.shape(name, arguments);
        }
        if Function::from_name(&name.name).is_none() {
            // It is reported as no function; what stands in it may be no term either.
            return Dimension::Unknown;
        }
        let dimensions: Vec<_> = arguments.iter().map(|argument| self.terms(argument, None)).collect();
        let second = Dimension::of(Unit::second());
        match (Function::from_name(&name.name), arguments, dimensions.as_slice()) {
            (Some(Function::Dot), _, [moving]) => self.combine(moving, &second, -1, span),
            (Some(Function::Ddot), _, [moving]) => self.combine(moving, &second, -2, span),
            (Some(Function::Der), [_, order], [moving, _]) => {
                self.combine(moving, &second, -i64::from(order.integer().unwrap_or_default()), span)
            }
            (Some(Function::Diff), _, [of, by]) => self.combine(of, by, -1, span),
            (
                Some(
                    Function::Sin
                    | Function::Cos
                    | Function::Tan
                    | Function::Asin
                    | Function::Acos
                    | Function::Tanh
                    | Function::Exp
                    | Function::Log,
                ),
                [argument],
                [dimension],
            ) => {
                let what = format!("an argument of `{}`, which is a pure number,", name.name);
                self.compare(
                    argument.span,
                    dimension,
                    &Reference { dimension: Dimension::one(), span: name.span, what },
                );
                Dimension::one()
            }
            (Some(Function::Atan2), [y, x], [above, below]) => {
                let what = format!("`{}`", shorten(self.source.slice(x.span)));
                self.compare(y.span, above, &Reference { dimension: below.clone(), span: x.span, what });
                Dimension::one()
            }
            (Some(Function::Sqrt), _, [inner]) => {
                Dimension::one().times_power(inner, Ratio::new(1, 2)).unwrap_or(Dimension::Unknown)
            }
            (Some(Function::Abs), _, [inner]) => inner.clone(),
            (Some(Function::Sign), _, [_]) => Dimension::one(),
            (Some(Function::RestToRest), [_, rate, _], [amplitude, frequency, _]) => {
                self.rate(rate, frequency, name);
                amplitude.clone()
            }
            (Some(Function::PointToPoint), [_, to, rate, _], [start, end, frequency, _]) => {
                self.rate(rate, frequency, name);
                let what = "the first point".to_owned();
                self.compare(to.span, end, &Reference { dimension: start.clone(), span: arguments[0].span, what });
                start.clone()
            }
            _ => Dimension::Unknown,
        }
    }

    /// The unit of a shape: that of the first value in its clauses, times seconds to the order of the derivative.
    fn shape(&mut self, name: &Ident, arguments: &[Expr]) -> Dimension {
        let Some((frequency, clauses)) = arguments.split_first() else { return Dimension::Unknown };
        let dimension = self.terms(frequency, None);
        self.rate(frequency, &dimension, name);
        let mut found: Option<Reference> = None;
        for clause in clauses {
            let ExprKind::Call(clause, values) = &clause.kind else { continue };
            let values = match (Clause::from_name(&clause.name), values.as_slice()) {
                (Some(Clause::Start | Clause::Amplitude), values) => values,
                (Some(Clause::End), [_, values @ ..]) => values,
                _ => continue,
            };
            for (order, value) in (0_i64..).zip(values).filter(|(_, value)| !value.is_zero()) {
                let dimension = self.terms(value, None);
                let second = Dimension::of(Unit::second());
                match &found {
                    Some(position) => {
                        let wanted = self.combine(&position.dimension, &second, -order, value.span);
                        let what = match order {
                            0 => position.what.clone(),
                            _ => format!("derivative {order} of {}", position.what),
                        };
                        self.compare(
                            value.span,
                            &dimension,
                            &Reference { dimension: wanted, span: position.span, what },
                        );
                    }
                    None if dimension != Dimension::Unknown => {
                        let dimension = self.combine(&dimension, &second, order, value.span);
                        let what = format!("`{}`", shorten(self.source.slice(value.span)));
                        found = Some(Reference { dimension, span: value.span, what });
                    }
                    None => {}
                }
            }
        }
        found.map_or(Dimension::Unknown, |found| found.dimension)
    }

    fn rate(&mut self, expr: &Expr, dimension: &Dimension, function: &Ident) {
        let wanted = self.combine(&Dimension::one(), &Dimension::of(Unit::second()), -1, expr.span);
        let what = format!("the frequency of `{}`", function.name);
        self.compare(expr.span, dimension, &Reference { dimension: wanted, span: function.span, what });
    }
}

/// The dimension of a unit in the table of units.
fn known(unit: &str) -> Dimension {
    Unit::parse(unit).map_or(Dimension::Unknown, Dimension::of)
}

/// The dimension of the torque or force of a joint.
fn torque(turns: bool) -> Dimension {
    known(if turns { "N*m" } else { "N" })
}

/// The span of the joint that a coordinate moves as it is, and whether it rotates.
fn joint_of(mechanism: &MechanismDeclaration, coordinate: &Ident) -> Option<(Span, bool)> {
    let mut joints = mechanism.bodies().filter_map(|body| body.joint.as_ref()).filter(|joint| joint.factor.is_none());
    joints.find_map(|joint| match &joint.motion {
        JointMotion::Revolute(name, _) if name.name == coordinate.name => Some((joint.keyword, true)),
        JointMotion::Prismatic(name, _) if name.name == coordinate.name => Some((joint.keyword, false)),
        _ => None,
    })
}

fn mismatch(span: Span, found: &Unit, wanted: &Unit, reference: &Reference, torque: &str) -> Diagnostic {
    let what = &reference.what;
    let same_place = reference.span == span;
    let scaled = found.same_dimension(wanted).then(|| found.factor(wanted));
    let lacking = wanted
        .over(found)
        .map_or_else(String::new, |ratio| format!("a factor with the unit {ratio} is missing here; "));
    let written = |unit: &Unit| if unit.is_torque() { torque.to_owned() } else { unit.to_string() };
    let (found, wanted) = (written(found), written(wanted));
    let labelled =
        |error: Diagnostic| if same_place { error } else { error.label(reference.span, format!("in {wanted}")) };
    if let Some(factor) = scaled {
        return labelled(
            Diagnostic::error(span, format!("scale mismatch: this is in {found}, {what} in {wanted}"))
                .note(format!("1 here is {factor} there"))
                .help(format!(
                    "declare both in the same unit, or multiply this by {factor}; scales are never converted silently"
                )),
        );
    }
    labelled(
        Diagnostic::error(span, format!("unit mismatch: this is in {found}, {what} in {wanted}"))
            .note(format!("in {found}"))
            .help(format!("{lacking}check this term and the units of what is in it")),
    )
}
