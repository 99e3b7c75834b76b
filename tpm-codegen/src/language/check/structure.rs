//! Checks of statements against each other: one energy of each kind, one force on each coordinate, motions of
//! coordinates only.

use std::collections::{HashMap, HashSet};

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::language::ast::{
    Declaration, EnergyKind, Ident, Item, ModelDeclaration, PatternDeclaration, PatternItem, Role,
};
use crate::language::check::symbols::{Scope, SymbolKind, Symbols};
use crate::language::parse::Syntax;
use crate::language::suggest::nearest;
use crate::source::Span;

pub(super) fn check<'a>(
    model: &'a ModelDeclaration,
    symbols: &'a Symbols<'a>,
    syntax: &Syntax,
    diagnostics: &mut Diagnostics,
) {
    let following = model.following().map(|name| name.name.as_str()).collect();
    let mut checker = Checker { symbols, syntax, diagnostics, following };
    checker.dynamics(model);
    checker.coordinates(model);
    checker.patterns(model);
}

struct Checker<'a, 'd> {
    symbols: &'a Symbols<'a>,
    syntax: &'a Syntax,
    diagnostics: &'d mut Diagnostics,
    /// Coordinates that follow from the motion of others.
    following: HashSet<&'a str>,
}

impl<'a> Checker<'a, '_> {
    fn error(&mut self, span: Span, message: impl Into<String>, help: impl Into<String>) {
        self.diagnostics.push(Diagnostic::error(span, message).help(help));
    }

    fn twice(&mut self, span: Span, first: Span, what: &str) {
        self.diagnostics.push(
            Diagnostic::error(span, format!("{what} is given twice"))
                .label(first, "the first one")
                .help("remove one of them"),
        );
    }

    /// Requires either equations, or energies, or a mechanism.
    fn dynamics(&mut self, model: &'a ModelDeclaration) {
        let mut energies: HashMap<&str, Span> = HashMap::new();
        let mut lagrangian = None;
        let mut equation = None;
        let mut mechanism = None;
        for item in &model.items {
            match item {
                Item::Equation(item) => equation = equation.or(Some(item.left.span)),
                Item::Energy(energy) => {
                    lagrangian = lagrangian.or(Some((energy.kind.keyword(), energy.keyword)));
                    if let Some(&first) = energies.get(energy.kind.keyword()) {
                        self.twice(energy.keyword, first, &format!("`{}`", energy.kind.keyword()));
                    } else {
                        energies.insert(energy.kind.keyword(), energy.keyword);
                    }
                }
                Item::Force(force) => lagrangian = lagrangian.or(Some(("force", force.coordinate.span))),
                Item::Mechanism(item) => match mechanism {
                    Some(first) => self.twice(item.keyword, first, "`mechanism`"),
                    None => mechanism = Some(item.keyword),
                },
                _ => {}
            }
        }
        if let Some(keyword) = mechanism {
            let kinds = EnergyKind::ALL.iter().filter_map(|kind| energies.get(kind.keyword()).copied());
            if let Some(span) = equation.into_iter().chain(kinds).min() {
                self.diagnostics.push(
                    Diagnostic::error(span, "a model with a mechanism has no other equations of motion")
                        .label(keyword, "the mechanism")
                        .help("write what is missing in the mechanism as forces, `force q = ...;`"),
                );
            }
            return;
        }
        if self.syntax.incomplete {
            return;
        }
        match (equation, lagrangian) {
            (None, None) => self.error(
                model.name.span,
                format!("`{}` has no equation of motion", model.name.name),
                "write equations, `m*ddot(x) + k*x = u;`, or energies, `kinetic = 1/2*m*dot(x)^2;`",
            ),
            (Some(equation), Some((_, keyword))) => self.diagnostics.push(
                Diagnostic::error(equation, "a model has either equations or energies")
                    .label(keyword, "an energy or force")
                    .help("write the terms of this equation as forces, `force q = ...;`"),
            ),
            (None, Some((word, span))) if !energies.contains_key(EnergyKind::Kinetic.keyword()) => self.error(
                span,
                format!("`{word}` without `kinetic`"),
                "the equations of motion follow from the kinetic energy: add `kinetic = ...;`",
            ),
            _ => {}
        }
    }

    /// Requires that statements about coordinates name declared ones, each once.
    fn coordinates(&mut self, model: &'a ModelDeclaration) {
        let mut forces = HashMap::new();
        let mut taylors = HashMap::new();
        let mut elimination = None;
        for item in &model.items {
            match item {
                Item::Declaration(Declaration { presliding: Some(own), .. }) => self.coordinate(&own.coordinate),
                Item::Force(force) => self.once(&force.coordinate, &mut forces, "the force on"),
                Item::Taylor(taylor) => self.once(&taylor.coordinate, &mut taylors, "a Taylor order for"),
                Item::Series(series) => {
                    self.coordinate(&series.coordinate);
                    let wanted = u64::from(series.order.value) + 1;
                    let given = series.coefficients.len() as u64;
                    let missing = given == 0 && series.definition.is_none();
                    if missing {
                        self.error(
                            series.function.span,
                            format!("`{}` has no coefficients", series.function.name),
                            "name them with `as a0, a1, ...`, or define the function, `series f(q) = ... about ...`",
                        );
                    } else if given != 0 && given != wanted {
                        self.error(
                            series.order.span,
                            format!("order {} has {wanted} coefficients, {given} are named", series.order.value),
                            "name one coefficient for each power, from 0 to the order",
                        );
                    }
                }
                Item::Eliminate(eliminate) => {
                    if let Some(first) = elimination {
                        self.twice(eliminate.stem.span, first, "an elimination");
                    }
                    elimination = Some(eliminate.stem.span);
                    let mut seen = HashMap::new();
                    for coordinate in &eliminate.coordinates {
                        self.once(coordinate, &mut seen, "the elimination of");
                    }
                    self.stem(&eliminate.stem);
                }
                _ => {}
            }
        }
    }

    /// Requires that the names c1, c2, ... are unused.
    fn stem(&mut self, stem: &Ident) {
        let clash = self.symbols.model.iter().filter(|(name, _)| {
            name.strip_prefix(stem.name.as_str()).is_some_and(|rest| {
                rest.starts_with(|c: char| ('1'..='9').contains(&c)) && rest.bytes().all(|byte| byte.is_ascii_digit())
            })
        });
        if let Some((name, symbol)) = clash.min_by_key(|(_, symbol)| symbol.span) {
            self.diagnostics.push(
                Diagnostic::error(
                    stem.span,
                    format!("`{name}` would be a lumped parameter's name, and it is {}", symbol.kind.describe()),
                )
                .label(symbol.span, "defined here")
                .help("choose another stem behind `as`"),
            );
        }
    }

    fn once(&mut self, name: &'a Ident, seen: &mut HashMap<&'a str, Span>, what: &str) {
        self.coordinate(name);
        if let Some(&first) = seen.get(name.name.as_str()) {
            self.twice(name.span, first, &format!("{what} `{}`", name.name));
        } else {
            seen.insert(&name.name, name.span);
        }
    }

    fn coordinate(&mut self, name: &Ident) {
        let text = name.name.as_str();
        match self.symbols.model.get(text) {
            Some(_) if self.following.contains(text) => self.error(
                name.span,
                format!("`{text}` follows from the motion of another coordinate, and has none of its own"),
                "name a coordinate that moves",
            ),
            Some(symbol) if symbol.kind == SymbolKind::Quantity(Role::Coordinate) => {}
            Some(symbol) => self.diagnostics.push(
                Diagnostic::error(name.span, format!("`{text}` is no coordinate"))
                    .label(symbol.span, format!("it is {}", symbol.kind.describe()))
                    .help("name a coordinate here"),
            ),
            None if self.syntax.mentioned.contains(text) => {}
            None => {
                let mut known = coordinates(&self.symbols.model);
                known.retain(|own| !self.following.contains(own));
                let help = match nearest(text, known.iter().copied()) {
                    Some(near) => format!("did you mean `{near}`?"),
                    None if known.is_empty() => format!("declare it: `coordinate {text};`"),
                    None => format!("the coordinates are {}", known.join(", ")),
                };
                self.error(name.span, format!("`{text}` is not declared as a coordinate"), help);
            }
        }
    }

    fn patterns(&mut self, model: &'a ModelDeclaration) {
        let eliminated: HashMap<&str, Span> = model
            .items
            .iter()
            .filter_map(|item| if let Item::Eliminate(eliminate) = item { Some(eliminate) } else { None })
            .flat_map(|eliminate| eliminate.coordinates.iter().map(|name| (name.name.as_str(), name.span)))
            .collect();
        let mut names: HashMap<&str, Span> = HashMap::new();
        for item in &model.items {
            let Item::Pattern(pattern) = item else { continue };
            let (name, span) =
                pattern.name.as_ref().map_or(("", pattern.keyword), |name| (name.name.as_str(), name.span));
            match names.get(name) {
                Some(&first) if name.is_empty() => self.diagnostics.push(
                    Diagnostic::error(span, "a second pattern without a name")
                        .label(first, "the first one")
                        .help("name them, `pattern slow { ... }`"),
                ),
                Some(&first) => self.twice(span, first, &format!("the pattern `{name}`")),
                None => {
                    names.insert(name, span);
                }
            }
            self.pattern(pattern, &eliminated);
        }
    }

    fn pattern(&mut self, pattern: &'a PatternDeclaration, eliminated: &HashMap<&str, Span>) {
        let mut motions = HashMap::new();
        let mut frequency: Option<Span> = None;
        let mut harmonics: Option<Span> = None;
        for item in &pattern.items {
            match item {
                PatternItem::Declaration(declaration) if declaration.role == Role::Frequency => {
                    for quantity in &declaration.quantities {
                        if let Some(first) = frequency {
                            self.diagnostics.push(
                                Diagnostic::error(quantity.name.span, "a pattern has one fundamental frequency")
                                    .label(first, "the first one")
                                    .help("write other motions with integer multiples of it, `rest_to_rest(lambda, 3*w, 3)`"),
                            );
                        }
                        frequency = frequency.or(Some(quantity.name.span));
                    }
                }
                PatternItem::Declaration(_) => {}
                PatternItem::Harmonics(count) => {
                    if let Some(first) = harmonics {
                        self.twice(count.span, first, "the number of harmonics");
                    }
                    harmonics = Some(count.span);
                }
                PatternItem::Motion(motion) => {
                    self.once(&motion.coordinate, &mut motions, "the motion of");
                    if let Some(&span) = eliminated.get(motion.coordinate.name.as_str()) {
                        self.diagnostics.push(
                            Diagnostic::error(
                                motion.coordinate.span,
                                format!("`{}` is eliminated, so it has no motion of its own", motion.coordinate.name),
                            )
                            .label(span, "eliminated here")
                            .help("remove its motion, or do not eliminate it"),
                        );
                    }
                }
            }
        }
        if frequency.is_none() && !self.syntax.incomplete {
            self.error(pattern.keyword, "this pattern has no frequency", "declare it: `frequency w [rad/s];`");
        }
    }
}

/// The coordinates of a scope, in the order of their declarations.
fn coordinates<'a>(scope: &Scope<'a>) -> Vec<&'a str> {
    let mut names: Vec<_> = scope
        .iter()
        .filter(|(_, symbol)| symbol.kind == SymbolKind::Quantity(Role::Coordinate))
        .map(|(name, symbol)| (symbol.span, *name))
        .collect();
    names.sort_unstable();
    names.into_iter().map(|(_, name)| name).collect()
}
