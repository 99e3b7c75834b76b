//! Checks that the bodies of a mechanism are a tree, and that its joints and drives name coordinates and inputs, each once.

use std::collections::{HashMap, HashSet};

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::language::ast::mechanism::{
    BodyDeclaration, InertiaDeclaration, JointMotion, MechanismDeclaration, MechanismItem, loss_word,
};
use crate::language::ast::{Ident, Item, ModelDeclaration, Role};
use crate::language::check::symbols::{SymbolKind, Symbols};
use crate::language::parse::Syntax;
use crate::language::suggest::nearest;
use crate::source::Span;
use tpm_symbolic::mechanics::tree::mechanism::Loss;

pub(super) fn check(model: &ModelDeclaration, symbols: &Symbols<'_>, syntax: &Syntax, diagnostics: &mut Diagnostics) {
    let mechanism = model.items.iter().find_map(|item| match item {
        Item::Mechanism(mechanism) => Some(mechanism),
        _ => None,
    });
    let Some(mechanism) = mechanism else { return };
    let mut checker = Checker { symbols, syntax, diagnostics };
    checker.once(mechanism);
    checker.tree(mechanism);
    checker.joints(model, mechanism);
    checker.drives(mechanism);
}

struct Checker<'a, 'd> {
    symbols: &'a Symbols<'a>,
    syntax: &'a Syntax,
    diagnostics: &'d mut Diagnostics,
}

impl Checker<'_, '_> {
    fn error(&mut self, span: Span, message: impl Into<String>, help: impl Into<String>) {
        self.diagnostics.push(Diagnostic::error(span, message).help(help));
    }

    fn twice(&mut self, span: Span, first: Span, message: String, help: &str) {
        self.diagnostics.push(Diagnostic::error(span, message).label(first, "the first one").help(help));
    }

    /// Requires one statement of gravity at most, and at least one body.
    fn once(&mut self, mechanism: &MechanismDeclaration) {
        let gravities = mechanism.items.iter().filter_map(|item| match item {
            MechanismItem::Gravity(gravity) => Some(gravity.span),
            _ => None,
        });
        let gravities: Vec<Span> = gravities.collect();
        match gravities.as_slice() {
            [first, second, ..] => {
                self.twice(*second, *first, "gravity is given twice".to_owned(), "remove one of them");
            }
            [] if !self.syntax.incomplete => self.error(
                mechanism.keyword,
                "this mechanism has no gravity",
                "write it in the frame of the base, `gravity (0, 0, -9.81);`, or `gravity (0, 0, 0);` for none",
            ),
            _ => {}
        }
        if mechanism.bodies().next().is_none() && !self.syntax.incomplete {
            self.error(mechanism.keyword, "this mechanism has no body", "add one, `body link1 { ... }`");
        }
    }

    /// Requires unique names, known parents, and a chain of parents from every body to the base.
    fn tree(&mut self, mechanism: &MechanismDeclaration) {
        let mut bodies: HashMap<&str, &BodyDeclaration> = HashMap::new();
        for body in mechanism.bodies() {
            match bodies.get(body.name.name.as_str()) {
                Some(first) => self.twice(
                    body.name.span,
                    first.name.span,
                    format!("the body `{}` is given twice", body.name.name),
                    "rename or remove one of them",
                ),
                None => {
                    bodies.insert(&body.name.name, body);
                }
            }
        }
        for body in mechanism.bodies() {
            if let Some(parent) = &body.parent
                && !bodies.contains_key(parent.name.as_str())
                && !self.syntax.mentioned.contains(&parent.name)
            {
                let mut known: Vec<_> = bodies.values().map(|body| (body.name.span, body.name.name.as_str())).collect();
                known.sort_unstable();
                let help = match nearest(&parent.name, known.iter().map(|&(_, name)| name)) {
                    Some(near) => format!("did you mean `{near}`?"),
                    None if parent.name == "base" => "a body on the base has no `on`".to_owned(),
                    None => {
                        let names: Vec<&str> = known.iter().map(|&(_, name)| name).collect();
                        format!("the bodies are {}; a body on the base has no `on`", names.join(", "))
                    }
                };
                self.error(parent.span, format!("`{}` is no body of this mechanism", parent.name), help);
            }
        }
        self.loops(mechanism, &bodies);
    }

    /// Reports every cycle of parents once, at its first body in the text.
    fn loops(&mut self, mechanism: &MechanismDeclaration, bodies: &HashMap<&str, &BodyDeclaration>) {
        let mut cleared: HashSet<&str> = HashSet::new();
        for body in mechanism.bodies() {
            let mut path: Vec<&str> = Vec::new();
            let mut current = Some(body);
            while let Some(at) = current {
                let name = at.name.name.as_str();
                if cleared.contains(name) {
                    break;
                }
                if let Some(start) = path.iter().position(|&visited| visited == name) {
                    let mut members = path[start..].to_vec();
                    members.push(name);
                    self.error(
                        body.name.span,
                        format!("the bodies stand on each other in a loop: {}", members.join(" on ")),
                        "a mechanism is a tree; cut the loop at one joint, and close it in equations of your own",
                    );
                    break;
                }
                path.push(name);
                current = at.parent.as_ref().and_then(|parent| bodies.get(parent.name.as_str()).copied());
            }
            cleared.extend(path);
        }
    }

    /// Requires a joint for every body, and for every coordinate exactly one joint that moves by it without a factor.
    fn joints(&mut self, model: &ModelDeclaration, mechanism: &MechanismDeclaration) {
        let mut moved: HashMap<&str, Span> = HashMap::new();
        for body in mechanism.bodies() {
            let Some(joint) = &body.joint else {
                if !self.syntax.incomplete {
                    self.error(
                        body.name.span,
                        format!("the body `{}` has no joint", body.name.name),
                        "write `revolute q about z at (x, y, z);`, `prismatic q along z at ...;` or `fixed at ...;`",
                    );
                }
                continue;
            };
            let Some((coordinate, _)) = joint.motion.moving() else { continue };
            self.coordinate(coordinate);
            if joint.factor.is_some() {
                continue;
            }
            match moved.get(coordinate.name.as_str()) {
                Some(&first) => self.twice(
                    coordinate.span,
                    first,
                    format!("`{}` moves two joints", coordinate.name),
                    "give each joint a coordinate of its own, or write a joint that follows with a factor, `-1*q`",
                ),
                None => {
                    moved.insert(&coordinate.name, coordinate.span);
                }
            }
        }
        self.standing(mechanism);
        if self.syntax.incomplete {
            return;
        }
        for item in &model.items {
            let Item::Declaration(declaration) = item else { continue };
            if declaration.role != Role::Coordinate || declaration.presliding.is_some() {
                continue;
            }
            for quantity in &declaration.quantities {
                if !moved.contains_key(quantity.name.name.as_str()) {
                    self.error(
                        quantity.name.span,
                        format!("no joint moves the coordinate `{}`", quantity.name.name),
                        "remove it, or give it a joint in the mechanism, one that moves by it without a factor",
                    );
                }
            }
        }
    }

    /// Reports parameters of a body that never moves, since they occur in no equation.
    fn standing(&mut self, mechanism: &MechanismDeclaration) {
        let bodies: HashMap<&str, &BodyDeclaration> =
            mechanism.bodies().map(|body| (body.name.name.as_str(), body)).collect();
        for body in mechanism.bodies() {
            let Some(InertiaDeclaration::Parameters(names)) = &body.inertia else { continue };
            let mut current = Some(body);
            let mut steps = 0;
            let stands = loop {
                let Some(at) = current else { break true };
                // A cycle and an unknown parent are reported by other checks.
                if steps > bodies.len() || at.joint.as_ref().is_none_or(|joint| joint.motion != JointMotion::Fixed) {
                    break false;
                }
                steps += 1;
                current = match &at.parent {
                    None => None,
                    Some(parent) => match bodies.get(parent.name.as_str()) {
                        Some(parent) => Some(*parent),
                        None => break false,
                    },
                };
            };
            if let (true, Some(place)) = (stands, names.first()) {
                self.error(
                    place.span,
                    format!("the body `{}` never moves, so that its inertia is in no equation", body.name.name),
                    "remove the statement",
                );
            }
        }
    }

    fn drives(&mut self, mechanism: &MechanismDeclaration) {
        let mut names: HashMap<&str, Span> = HashMap::new();
        for drive in mechanism.drives() {
            if drive.moves.is_none() {
                self.coordinate(&drive.name);
            } else if let Some(symbol) = self.symbols.model.get(drive.name.name.as_str()) {
                self.diagnostics.push(
                    Diagnostic::error(drive.name.span, format!("`{}` is {}", drive.name.name, symbol.kind.describe()))
                        .label(symbol.span, "defined here")
                        .help("a drive of a combination of joints has a name of its own"),
                );
            }
            match names.get(drive.name.name.as_str()) {
                Some(&first) => self.twice(
                    drive.name.span,
                    first,
                    format!("the drive `{}` is given twice", drive.name.name),
                    "put both into one statement",
                ),
                None => {
                    names.insert(&drive.name.name, drive.name.span);
                }
            }
            if let Some(input) = &drive.input {
                self.input(input);
            }
            let load = drive.losses.iter().find(|(loss, _)| *loss == Loss::Load);
            if let Some((_, place)) = load.filter(|_| drive.moves.is_some()) {
                self.error(
                    place.span,
                    "what part of their load a drive of several joints has is not known".to_owned(),
                    "remove `load`, or write the friction as a force on every joint",
                );
            } else if let Some((_, place)) = load.filter(|_| mechanism.bodies().all(|body| body.near.is_none())) {
                self.error(
                    place.span,
                    "the load of a drive is computed from inertias that the model states, and no body states any".to_owned(),
                    "write `inertia parameters near (m, mx, my, mz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz);` with the values of an identification",
                );
            }
            for (index, (loss, name)) in drive.losses.iter().enumerate() {
                if let Some((_, first)) = drive.losses[..index].iter().find(|(earlier, _)| earlier == loss) {
                    let word = loss_word(*loss);
                    self.twice(name.span, first.span, format!("`{word}` is given twice"), "remove one of them");
                }
            }
        }
    }

    fn input(&mut self, name: &Ident) {
        let symbol = self.symbols.model.get(name.name.as_str());
        if symbol.is_some_and(|symbol| symbol.kind == SymbolKind::Quantity(Role::Input))
            || (symbol.is_none() && self.syntax.mentioned.contains(&name.name))
        {
            return;
        }
        self.named(name, Role::Input);
    }

    fn coordinate(&mut self, name: &Ident) {
        let symbol = self.symbols.model.get(name.name.as_str());
        if symbol.is_some_and(|symbol| symbol.kind == SymbolKind::Quantity(Role::Coordinate))
            || (symbol.is_none() && self.syntax.mentioned.contains(&name.name))
        {
            return;
        }
        self.named(name, Role::Coordinate);
    }

    /// Reports a name that is not a quantity of the given role.
    fn named(&mut self, name: &Ident, role: Role) {
        let text = name.name.as_str();
        let mut known: Vec<(Span, &str)> = self
            .symbols
            .model
            .iter()
            .filter(|(_, symbol)| symbol.kind == SymbolKind::Quantity(role))
            .map(|(name, symbol)| (symbol.span, *name))
            .collect();
        known.sort_unstable();
        let word = role.keyword();
        let error = Diagnostic::error(name.span, format!("`{text}` is not declared as {} {word}", role.article()));
        let error = match self.symbols.model.get(text) {
            Some(symbol) => error.label(symbol.span, format!("it is {}", symbol.kind.describe())),
            None => error,
        };
        let error = match nearest(text, known.iter().map(|&(_, known)| known)) {
            Some(near) => error.help(format!("did you mean `{near}`?")),
            None => error.help(format!("declare it: `{word} {text};`")),
        };
        self.diagnostics.push(error);
    }
}
