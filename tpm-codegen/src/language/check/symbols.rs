//! The names that a model defines.
//!
//! Invariant: a name has one meaning in the model. A pattern's amplitudes and frequency are local to it and shadow no
//! name.

use std::collections::HashMap;

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::language::ast::{
    Declaration, Ident, Item, ModelDeclaration, PatternDeclaration, PatternItem, Role, UnitExpr,
};
use crate::language::check::parameters::parameters;
use crate::language::function::Function;
use crate::language::suggest::nearest;
use crate::source::Span;
use tpm_units::Unit;

/// Kind of a name.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum SymbolKind {
    /// A declared quantity.
    Quantity(Role),
    /// A parameter in which the equations are not linear.
    Nonlinear,
    /// The function of a series statement, by the order of the statements.
    Function(usize),
    /// A coefficient of a series, with its power.
    Coefficient(usize, usize),
    /// A `let`.
    Let,
    /// The name that a `lump` gives.
    Lump,
}

impl SymbolKind {
    /// The kind with its article, for messages.
    pub(crate) fn describe(self) -> &'static str {
        match self {
            Self::Quantity(Role::Coordinate) => "a coordinate",
            Self::Quantity(Role::Input) => "an input",
            Self::Quantity(Role::Parameter) => "a parameter",
            Self::Quantity(Role::Constant) => "a constant",
            Self::Quantity(Role::Amplitude) => "an amplitude",
            Self::Quantity(Role::Frequency) => "a frequency",
            Self::Nonlinear => "a nonlinear parameter",
            Self::Function(_) => "a series",
            Self::Coefficient(..) => "a coefficient of a series",
            Self::Let => "a `let`",
            Self::Lump => "a lumped parameter",
        }
    }
}

/// A defined name.
#[derive(Clone, Debug)]
pub(crate) struct Symbol {
    pub(crate) kind: SymbolKind,
    /// Where it is defined.
    pub(crate) span: Span,
    /// Its unit, when one is given.
    pub(crate) unit: Option<Unit>,
}

/// Names with their meanings.
pub(crate) type Scope<'a> = HashMap<&'a str, Symbol>;

/// The names of a model and of each of its patterns, by the order of the patterns.
pub(crate) struct Symbols<'a> {
    pub(crate) model: Scope<'a>,
    pub(crate) patterns: Vec<Scope<'a>>,
}

pub(super) fn collect<'a>(model: &'a ModelDeclaration, diagnostics: &mut Diagnostics) -> Symbols<'a> {
    let mut symbols = Symbols { model: HashMap::new(), patterns: Vec::new() };
    let mut series_count = 0;
    for item in &model.items {
        match item {
            Item::Declaration(declaration) => declare(declaration, &mut symbols.model, None, diagnostics),
            Item::Nonlinear(parameters) => {
                for parameter in parameters {
                    let unit = parameter.unit.as_ref().and_then(|unit| resolve(unit, diagnostics));
                    define(&parameter.name, SymbolKind::Nonlinear, unit, &mut symbols.model, None, diagnostics);
                }
            }
            Item::Series(series) => {
                let unit = series.unit.as_ref().and_then(|unit| resolve(unit, diagnostics));
                define(
                    &series.function,
                    SymbolKind::Function(series_count),
                    unit,
                    &mut symbols.model,
                    None,
                    diagnostics,
                );
                for (power, name) in series.coefficients.iter().enumerate() {
                    let kind = SymbolKind::Coefficient(series_count, power);
                    define(name, kind, None, &mut symbols.model, None, diagnostics);
                }
                series_count += 1;
            }
            Item::Let(definition) => {
                define(&definition.name, SymbolKind::Let, None, &mut symbols.model, None, diagnostics)
            }
            Item::Lump(definition) => {
                define(&definition.name, SymbolKind::Lump, None, &mut symbols.model, None, diagnostics)
            }
            Item::Mechanism(mechanism) => {
                for (name, unit) in parameters(mechanism) {
                    let kind = SymbolKind::Quantity(Role::Parameter);
                    define(name, kind, unit, &mut symbols.model, None, diagnostics);
                }
            }
            Item::Equation(_)
            | Item::Energy(_)
            | Item::Force(_)
            | Item::Eliminate(_)
            | Item::Taylor(_)
            | Item::Pattern(_) => {}
        }
    }
    // Patterns come last, so that a name of theirs that the model defines further down is reported as defined twice.
    for item in &model.items {
        if let Item::Pattern(pattern) = item {
            symbols.patterns.push(collect_pattern(pattern, &symbols.model, diagnostics));
        }
    }
    symbols
}

fn collect_pattern<'a>(pattern: &'a PatternDeclaration, outer: &Scope<'a>, diagnostics: &mut Diagnostics) -> Scope<'a> {
    let mut scope = HashMap::new();
    for item in &pattern.items {
        if let PatternItem::Declaration(declaration) = item {
            declare(declaration, &mut scope, Some(outer), diagnostics);
            if declaration.role == Role::Frequency {
                refuse_hertz(declaration, diagnostics);
            }
        }
    }
    scope
}

/// Reports a frequency in Hz, which has the right dimension and is wrong by the factor 2 pi.
fn refuse_hertz(declaration: &Declaration, diagnostics: &mut Diagnostics) {
    for unit in declaration.quantities.iter().filter_map(|quantity| quantity.unit.as_ref()) {
        if let Some((name, _)) = unit.factors.iter().find(|(name, _)| name.name.ends_with("Hz")) {
            diagnostics.push(
                Diagnostic::error(name.span, "a pattern's frequency is an angular one")
                    .help("declare it in `[rad/s]`: w = 2*pi*f"),
            );
        }
    }
}

fn declare<'a>(
    declaration: &'a Declaration,
    scope: &mut Scope<'a>,
    outer: Option<&Scope<'a>>,
    diagnostics: &mut Diagnostics,
) {
    for quantity in &declaration.quantities {
        let unit = quantity.unit.as_ref().and_then(|unit| resolve(unit, diagnostics));
        define(&quantity.name, SymbolKind::Quantity(declaration.role), unit, scope, outer, diagnostics);
    }
}

fn define<'a>(
    name: &'a Ident,
    kind: SymbolKind,
    unit: Option<Unit>,
    scope: &mut Scope<'a>,
    outer: Option<&Scope<'a>>,
    diagnostics: &mut Diagnostics,
) {
    let text = name.name.as_str();
    let reserved = match text {
        "t" => Some("the time"),
        "pi" => Some("the number pi"),
        "_" => Some("no name"),
        _ => Function::from_name(text).map(|_| "a function"),
    };
    if let Some(meaning) = reserved {
        diagnostics.push(
            Diagnostic::error(name.span, format!("`{text}` is reserved: it is {meaning}")).help("choose another name"),
        );
        return;
    }
    let earlier = scope.get(text).or_else(|| outer.and_then(|outer| outer.get(text)));
    if let Some(earlier) = earlier {
        diagnostics.push(
            Diagnostic::error(name.span, format!("`{text}` is defined twice"))
                .note("the second definition")
                .label(earlier.span, format!("the first one: {}", earlier.kind.describe()))
                .help("rename or remove one of them"),
        );
        return;
    }
    scope.insert(text, Symbol { kind, span: name.span, unit });
}

/// The unit in a bracket; none when a name in it is unknown, which is reported.
pub(super) fn resolve(expr: &UnitExpr, diagnostics: &mut Diagnostics) -> Option<Unit> {
    let mut product = Some(Unit::one());
    for (name, exponent) in &expr.factors {
        let Some(unit) = Unit::named(&name.name) else {
            diagnostics.push(unknown_unit(name));
            product = None;
            continue;
        };
        product = product.and_then(|product| product.times(&unit.power(*exponent)?));
    }
    product
}

fn unknown_unit(name: &Ident) -> Diagnostic {
    let text = name.name.as_str();
    let error = Diagnostic::error(name.span, format!("`{text}` is not a unit that is known here"));
    let split = text
        .char_indices()
        .skip(1)
        .map(|(at, _)| text.split_at(at))
        .find(|(left, right)| Unit::named(left).is_some() && Unit::named(right).is_some());
    if let Some((left, right)) = split {
        return error.help(format!("a product of units is written with `*`: `{left}*{right}`"));
    }
    match text {
        "kph" | "kmh" => return error.help("write `km/h`"),
        "Ohm" | "Ohms" | "ohms" => return error.help("write `ohm`"),
        "sec" | "second" | "seconds" => return error.help("write `s`"),
        "degree" | "degrees" => return error.help("write `deg`, or better `rad`"),
        "radian" | "radians" => return error.help("write `rad`"),
        _ => {}
    }
    match nearest(text, tpm_units::names()) {
        Some(near) => error.help(format!("did you mean `{near}`?")),
        None => error
            .help("units are SI units with prefixes, such as kg, mm, s, A, N, J, W, V, ohm, mH, Pa, Hz, rad, deg, rpm"),
    }
}
