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
#[derive(Clone)]
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
    match text {
        "rads" | "degs" | "revs" => return error.help(format!("write `{}/s`", text.trim_end_matches('s'))),
        "rps" => return error.help("write `rev/s`"),
        "mps" => return error.help("write `m/s`"),
        "lbs" => return error.help("write `lb`"),
        "kph" | "kmh" => return error.help("write `km/h`"),
        "Ohm" | "Ohms" | "ohms" => return error.help("write `ohm`"),
        "sec" | "second" | "seconds" => return error.help("write `s`"),
        "degree" | "degrees" => return error.help("write `deg`, or better `rad`"),
        "radian" | "radians" => return error.help("write `rad`"),
        _ => {}
    }
    if let Some(product) = written_together(text) {
        let power = if product.contains('^') { ", a power with `^`" } else { "" };
        return error.help(format!("a product of units is written with `*`{power}: `{product}`"));
    }
    match nearest(text, tpm_units::names()) {
        Some(near) => error.help(format!("did you mean `{near}`?")),
        None => error
            .help("units are SI units with prefixes, such as kg, mm, s, A, N, J, W, V, ohm, mH, Pa, Hz, rad, deg, rpm"),
    }
}

/// Names of units that are written together without `*` and `^`, as products of few names. A name with a prefix is less likely than two
/// units (`Nms` is N*m*s) but for the usual ones, and more likely than a unit twice (`mNm` is mN*m).
fn written_together(text: &str) -> Option<String> {
    const PLAIN: [&str; 16] =
        ["kg", "mm", "cm", "rad", "deg", "rev", "ohm", "Pa", "Hz", "g", "m", "s", "N", "J", "V", "A"];
    const PREFIXED: [&str; 6] = ["kN", "mN", "ms", "mA", "mV", "cN"];
    /// The longest text that is split, and what a prefixed name and a repetition cost beside a plain one.
    const LONGEST: usize = 16;
    const DEARER: usize = 3;
    fn split<'a>(text: &'a str, before: &mut Vec<(&'a str, &'a str)>) -> Option<(usize, String)> {
        if text.is_empty() {
            let part = |(name, power): &(&str, &str)| {
                if power.is_empty() { (*name).to_owned() } else { format!("{name}^{power}") }
            };
            return Some((0, before.iter().map(part).collect::<Vec<_>>().join("*")));
        }
        let names = PLAIN.iter().map(|name| (*name, 1)).chain(PREFIXED.iter().map(|name| (*name, DEARER)));
        let ways = names.filter_map(|(name, cost)| {
            let rest = text.strip_prefix(name)?;
            let name = &text[..name.len()];
            let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
            let again = before.iter().any(|(own, _)| *own == name);
            before.push((name, &rest[..digits]));
            let way = split(&rest[digits..], before);
            before.pop();
            way.map(|(other, product)| (cost + other + if again { DEARER } else { 0 }, product))
        });
        ways.min_by_key(|(cost, _)| *cost)
    }
    (text.len() <= LONGEST).then(|| split(text, &mut Vec::new()))?.map(|(_, product)| product)
}

#[cfg(test)]
mod tests {
    use super::written_together;

    #[test]
    fn units_without_a_sign_between_them_are_told_apart() {
        for (text, product) in [
            ("kgm2", Some("kg*m^2")),
            ("Nms", Some("N*m*s")),
            ("Nmm", Some("N*mm")),
            ("mNm", Some("mN*m")),
            ("kNm", Some("kN*m")),
            ("m2", Some("m^2")),
            ("Nmrad", Some("N*m*rad")),
            ("frog", None),
        ] {
            assert_eq!(written_together(text).as_deref(), product, "{text}");
        }
    }
}
