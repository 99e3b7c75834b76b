//! Checks that every name is known and used where its kind is allowed, and that every declared quantity is used.
//!
//! Invariant: a use is an edge from the using statement to the used name. The roots of the graph are the equations of
//! motion and the patterns; a parameter that only an unused `let` mentions is therefore unused.

use std::collections::{HashMap, HashSet};

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::language::ast::mechanism::MechanismDeclaration;
use crate::language::ast::{
    Declaration, Expr, ExprKind, Ident, Item, ModelDeclaration, PatternDeclaration, PatternItem, Role, Sign,
};
use crate::language::check::symbols::{Scope, SymbolKind, Symbols};
use crate::language::function::{Clause, Function};
use crate::language::lex::shorten;
use crate::language::parse::Syntax;
use crate::language::suggest::nearest;
use crate::source::Span;
use tpm_symbolic::number::rational;

/// Context of an expression, which decides which names it may use.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place<'a> {
    /// Equations, energies, forces and the `let`s for them.
    Dynamics,
    /// The value of a constant.
    Value,
    /// The point of an expansion.
    Point,
    /// The definition of a series function of this coordinate.
    Series(&'a str),
    /// A lumped parameter.
    Lump,
    /// The geometry of a mechanism, or a known inertia.
    Geometry,
    /// A motion of the pattern of this number.
    Motion(usize),
}

impl Place<'_> {
    fn admits(self, kind: SymbolKind, name: &str) -> bool {
        use Role::{Amplitude, Constant, Coordinate, Frequency, Input, Parameter};
        use SymbolKind::{Coefficient, Function, Let, Nonlinear, Quantity};
        match self {
            Self::Dynamics => matches!(
                kind,
                Quantity(Coordinate | Input | Parameter | Constant) | Nonlinear | Function(_) | Coefficient(..) | Let
            ),
            Self::Value | Self::Point | Self::Geometry => kind == Quantity(Constant),
            Self::Series(coordinate) => {
                matches!(kind, Quantity(Parameter | Constant) | Let)
                    || (kind == Quantity(Coordinate) && name == coordinate)
            }
            Self::Lump => matches!(kind, Quantity(Parameter | Constant) | Coefficient(..) | Let),
            Self::Motion(_) => matches!(kind, Quantity(Amplitude | Frequency | Constant)),
        }
    }

    fn rule(self) -> String {
        match self {
            Self::Dynamics => "equations use coordinates, inputs, parameters, constants, series and `let`s".to_owned(),
            Self::Value => "a constant's value is made of numbers and of constants with a value".to_owned(),
            Self::Point => "a point of expansion is made of numbers, `pi` and constants".to_owned(),
            Self::Series(coordinate) => {
                format!("this function may use `{coordinate}`, parameters, constants and `let`s")
            }
            Self::Lump => "a lumped parameter is made of parameters, constants and coefficients".to_owned(),
            Self::Geometry => "the geometry of a mechanism is made of numbers, `pi` and constants".to_owned(),
            Self::Motion(_) => {
                "a motion is made of the pattern's amplitudes and frequency, constants, `t` and `pi`".to_owned()
            }
        }
    }
}

/// The user in a use: the model itself, or the definition of a name, in which case the use counts only if that name is
/// used.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum User<'a> {
    Root,
    Name(&'a str),
    Nobody,
}

pub(super) fn check<'a>(
    model: &'a ModelDeclaration,
    symbols: &Symbols<'a>,
    syntax: &Syntax,
    diagnostics: &mut Diagnostics,
) {
    let mut names =
        Names { symbols, syntax, diagnostics, known: HashSet::new(), uses: HashMap::new(), pattern_uses: Vec::new() };
    names.visit_model(model);
    if !syntax.incomplete {
        names.unused(model);
    }
}

struct Names<'a, 's, 'd> {
    symbols: &'s Symbols<'a>,
    syntax: &'s Syntax,
    diagnostics: &'d mut Diagnostics,
    /// `let`s and constants with a value that are defined above the current statement.
    known: HashSet<&'a str>,
    uses: HashMap<User<'a>, HashSet<&'a str>>,
    pattern_uses: Vec<HashSet<&'a str>>,
}

impl<'a> Names<'a, '_, '_> {
    fn visit_model(&mut self, model: &'a ModelDeclaration) {
        for item in &model.items {
            match item {
                Item::Declaration(declaration) => self.values(declaration),
                Item::Nonlinear(parameters) => {
                    for parameter in parameters {
                        for end in [&parameter.from, &parameter.to] {
                            self.visit(end, Place::Value, User::Name(&parameter.name.name));
                        }
                    }
                }
                Item::Series(series) => {
                    let user = User::Name(&series.function.name);
                    self.visit(&series.point, Place::Point, user);
                    if let Some(definition) = &series.definition {
                        self.visit(definition, Place::Series(&series.coordinate.name), user);
                    }
                    for name in &series.coefficients {
                        self.uses.entry(user).or_default().insert(&name.name);
                    }
                }
                Item::Let(definition) => {
                    self.visit(&definition.value, Place::Dynamics, User::Name(&definition.name.name));
                    self.known.insert(&definition.name.name);
                }
                Item::Lump(definition) => self.visit(&definition.value, Place::Lump, User::Nobody),
                Item::Equation(equation) => {
                    self.visit(&equation.left, Place::Dynamics, User::Root);
                    self.visit(&equation.right, Place::Dynamics, User::Root);
                }
                Item::Energy(energy) => self.visit(&energy.value, Place::Dynamics, User::Root),
                Item::Force(force) => {
                    self.uses.entry(User::Root).or_default().insert(&force.coordinate.name);
                    self.visit(&force.value, Place::Dynamics, User::Root);
                }
                Item::Mechanism(mechanism) => self.mechanism(mechanism),
                Item::Eliminate(_) => {}
                Item::Taylor(taylor) => self.visit(&taylor.point, Place::Point, User::Root),
                Item::Pattern(pattern) => self.visit_pattern(pattern),
            }
        }
    }

    fn values(&mut self, declaration: &'a Declaration) {
        for quantity in &declaration.quantities {
            if let Some(value) = &quantity.value {
                self.visit(value, Place::Value, User::Name(&quantity.name.name));
                self.known.insert(&quantity.name.name);
            }
            if let Some(own) = &declaration.presliding {
                let user = User::Name(&quantity.name.name);
                self.visit(&own.travel, Place::Value, user);
                self.uses.entry(user).or_default().insert(&own.coordinate.name);
            }
        }
    }

    /// Notes the uses of a mechanism: its coordinates, its inputs and the constants of its geometry.
    fn mechanism(&mut self, mechanism: &'a MechanismDeclaration) {
        for expr in mechanism.geometry() {
            self.visit(expr, Place::Geometry, User::Root);
        }
        // A coordinate that no joint moves is reported by another check.
        let symbols = self.symbols.model.iter();
        let coordinates = symbols.filter(|(_, symbol)| symbol.kind == SymbolKind::Quantity(Role::Coordinate));
        let driving = mechanism.drives().flat_map(|drive| drive.input.as_ref().into_iter().chain([&drive.name]));
        let used = self.uses.entry(User::Root).or_default();
        used.extend(coordinates.map(|(name, _)| *name));
        used.extend(driving.map(|name| name.name.as_str()));
        for moves in mechanism.drives().filter_map(|drive| drive.moves.as_ref()) {
            self.visit(moves, Place::Dynamics, User::Root);
        }
    }

    fn visit_pattern(&mut self, pattern: &'a PatternDeclaration) {
        let index = self.pattern_uses.len();
        self.pattern_uses.push(HashSet::new());
        for item in &pattern.items {
            if let PatternItem::Motion(motion) = item {
                self.visit(&motion.value, Place::Motion(index), User::Root);
            }
        }
    }

    fn visit(&mut self, expr: &'a Expr, place: Place<'a>, user: User<'a>) {
        match &expr.kind {
            ExprKind::Number(_) => {}
            ExprKind::Name(name) => self.name(name, expr.span, place, user),
            ExprKind::Call(function, arguments) => self.call(function, arguments, expr.span, place, user),
            ExprKind::Negative(inner) | ExprKind::Power(inner, _) => self.visit(inner, place, user),
            ExprKind::Sum(terms) => terms.iter().for_each(|(_, term)| self.visit(term, place, user)),
            ExprKind::Product(factors) => factors.iter().for_each(|(_, factor)| self.visit(factor, place, user)),
        }
    }

    fn name(&mut self, name: &'a str, span: Span, place: Place<'a>, user: User<'a>) {
        match (name, place) {
            ("t", Place::Motion(_)) => return,
            ("t", _) => {
                self.diagnostics.push(
                    Diagnostic::error(span, "the time `t` stands in patterns only")
                        .help("a quantity that changes with time is an input: declare it with `input`"),
                );
                return;
            }
            ("pi", Place::Value) => {
                self.diagnostics.push(
                    Diagnostic::error(span, "a constant's value is a rational number, and pi is none")
                        .help("give the product a name with `let name = ...;` instead"),
                );
                return;
            }
            ("pi", _) => return,
            _ => {}
        }
        let local = if let Place::Motion(index) = place { self.symbols.patterns.get(index) } else { None };
        let Some(symbol) = local.and_then(|scope| scope.get(name)).or_else(|| self.symbols.model.get(name)) else {
            self.unknown(name, span, place, user);
            return;
        };
        if let (Place::Motion(index), SymbolKind::Quantity(Role::Amplitude | Role::Frequency)) = (place, symbol.kind) {
            self.pattern_uses[index].insert(name);
        } else {
            self.uses.entry(user).or_default().insert(name);
        }
        if !place.admits(symbol.kind, name) {
            self.diagnostics.push(
                Diagnostic::error(span, format!("`{name}` is {} and cannot stand here", symbol.kind.describe()))
                    .label(symbol.span, "defined here")
                    .help(place.rule()),
            );
            return;
        }
        let before = symbol.kind == SymbolKind::Let
            || (place == Place::Value && symbol.kind == SymbolKind::Quantity(Role::Constant));
        if before && !self.known.contains(name) {
            let error = Diagnostic::error(span, format!("`{name}` is used before it has a value"))
                .label(symbol.span, "defined here");
            self.diagnostics.push(error.help("a definition uses only what is defined above it"));
        }
    }

    fn unknown(&mut self, name: &str, span: Span, place: Place<'a>, user: User<'a>) {
        if self.syntax.mentioned.contains(name) {
            return;
        }
        let error = Diagnostic::error(span, format!("unknown name `{}`", shorten(name)));
        if let Some(symbol) = self.symbols.patterns.iter().find_map(|scope| scope.get(name)) {
            self.diagnostics.push(
                error
                    .label(symbol.span, format!("{} of a pattern", symbol.kind.describe()))
                    .help("what a pattern declares is known in that pattern only"),
            );
            return;
        }
        if Function::from_name(name).is_some() {
            self.diagnostics.push(error.note("a function without arguments").help(format!("write `{name}(...)`")));
            return;
        }
        let local: Option<&Scope<'a>> =
            if let Place::Motion(index) = place { self.symbols.patterns.get(index) } else { None };
        let mut candidates: Vec<(Span, &str)> = local
            .into_iter()
            .chain([&self.symbols.model])
            .flatten()
            .filter(|(candidate, symbol)| place.admits(symbol.kind, candidate))
            .map(|(candidate, symbol)| (symbol.span, *candidate))
            .collect();
        candidates.sort_unstable();
        let coordinates =
            self.symbols.model.iter().filter(|(_, symbol)| symbol.kind == SymbolKind::Quantity(Role::Coordinate));
        let rate = coordinates.filter_map(|(coordinate, _)| Some((derivative(name, coordinate)?, *coordinate))).min();
        if let Some((_, coordinate)) = &rate {
            self.uses.entry(user).or_default().insert(coordinate);
        }
        let near = nearest(name, candidates.iter().map(|&(_, candidate)| candidate));
        let help = match (rate, near) {
            (Some((rate, _)), _) => format!("time derivatives are written `dot(...)` and `ddot(...)`: here `{rate}`"),
            (None, Some(near)) => format!("did you mean `{near}`?"),
            (None, None) => match place {
                Place::Motion(_) => {
                    format!("declare it in the pattern, `amplitude {};`, or as a constant of the model", shorten(name))
                }
                _ => format!("declare it, for example `parameter {};`", shorten(name)),
            },
        };
        self.diagnostics.push(error.help(help));
    }

    fn call(&mut self, name: &'a Ident, arguments: &'a [Expr], span: Span, place: Place<'a>, user: User<'a>) {
        let Some(function) = Function::from_name(&name.name) else {
            self.unknown_function(name, arguments, place);
            self.uses.entry(user).or_default().insert(&name.name);
            // The time in them is told by the error above.
            arguments
                .iter()
                .filter(|argument| !of_time(std::slice::from_ref(argument)))
                .for_each(|argument| self.visit(argument, place, user));
            return;
        };
        // The number of arguments.
        if let Some(arity) = function.arity().filter(|&arity| arity != arguments.len()) {
            self.diagnostics.push(
                Diagnostic::error(
                    span,
                    format!("`{}` takes {}, here are {}", name.name, counted(arity), arguments.len()),
                )
                .help(format!("write `{}`", function.usage())),
            );
        }
        // The context of the call, then the kinds of the arguments.
        self.place_of(function, name.span, place);
        match (function, arguments) {
            (Function::Der, [moving, order]) => {
                if order.integer().is_none() {
                    self.diagnostics.push(
                        Diagnostic::error(order.span, "the order of a derivative is a non-negative integer")
                            .help("write, for example, `der(x, 4)`"),
                    );
                }
                self.moving(moving, span);
                self.visit(moving, place, user);
            }
            (Function::Dot | Function::Ddot, [moving]) => {
                self.moving(moving, span);
                self.visit(moving, place, user);
            }
            (Function::Diff, [of, by]) => {
                self.visit(of, place, user);
                self.visit(by, place, user);
                let coordinate = matches!(&by.kind, ExprKind::Name(name)
                    if self.symbols.model.get(name.as_str()).is_none_or(|symbol| symbol.kind == SymbolKind::Quantity(Role::Coordinate)));
                if !coordinate {
                    self.diagnostics.push(
                        Diagnostic::error(by.span, "a partial derivative is taken by a coordinate")
                            .help("write, for example, `diff(f1, th2)`"),
                    );
                }
            }
            (Function::RestToRest | Function::PointToPoint, [rest @ .., order]) => {
                if order.integer().is_none_or(|order| order % 2 != 1) {
                    self.diagnostics.push(
                        Diagnostic::error(
                            order.span,
                            format!("the order of `{}` is an odd positive integer", name.name),
                        )
                        .help("it is the highest harmonic and the number of derivatives that vanish: 3, 5, 7, ..."),
                    );
                }
                rest.iter().for_each(|argument| self.visit(argument, place, user));
            }
            (Function::Shape, [frequency, clauses @ ..]) => {
                self.visit(frequency, place, user);
                clauses.iter().for_each(|clause| self.clause(clause, place, user));
            }
            (Function::Shape, []) => self.diagnostics.push(
                Diagnostic::error(span, "a shape begins with its frequency")
                    .help(format!("write `{}`", function.usage())),
            ),
            _ => arguments.iter().for_each(|argument| self.visit(argument, place, user)),
        }
    }

    /// Visits a clause of a shape.
    fn clause(&mut self, clause: &'a Expr, place: Place<'a>, user: User<'a>) {
        match &clause.kind {
            ExprKind::Call(name, values) if Clause::from_name(&name.name).is_some() => {
                values.iter().for_each(|value| self.visit(value, place, user));
            }
            _ => self.diagnostics.push(
                Diagnostic::error(clause.span, "this is no clause of `shape`")
                    .help(format!("behind the frequency stand {}", Clause::list())),
            ),
        }
    }

    /// Reports derivatives outside equations, and pattern functions outside patterns.
    fn place_of(&mut self, function: Function, span: Span, place: Place<'a>) {
        let name = function.name();
        let help = match place {
            Place::Motion(_) if function.is_derivative() => "give the motion itself; its derivatives follow from it",
            Place::Motion(_) => return,
            _ if function.is_pattern() => "a reference motion stands in `pattern { ... }`",
            Place::Dynamics => return,
            Place::Series(_) if !function.is_derivative() => return,
            Place::Lump if !function.is_derivative() => return,
            Place::Point | Place::Geometry if !function.is_derivative() => return,
            _ => "only quantities of the equations of motion have derivatives and functions",
        };
        self.diagnostics.push(Diagnostic::error(span, format!("`{name}` cannot stand here")).help(help));
    }

    /// Reports the argument of a time derivative that does not depend on time through a coordinate.
    fn moving(&mut self, expr: &'a Expr, span: Span) {
        let mut moves = false;
        let mut input = None;
        expr.walk(&mut |part| {
            if let ExprKind::Name(name) = &part.kind {
                match self.symbols.model.get(name.as_str()).map(|symbol| symbol.kind) {
                    Some(SymbolKind::Quantity(Role::Input)) => input = Some((part.span, name)),
                    Some(
                        SymbolKind::Quantity(Role::Parameter | Role::Constant)
                        | SymbolKind::Nonlinear
                        | SymbolKind::Coefficient(..)
                        | SymbolKind::Lump,
                    ) => {}
                    // An unknown name is reported elsewhere, and a `let` counts as time-dependent.
                    _ => moves = moves || name != "pi",
                }
            }
        });
        if let Some((place, name)) = input {
            self.diagnostics.push(
                Diagnostic::error(place, format!("the input `{name}` has no time derivative here"))
                    .help("a quantity with dynamics of its own is a coordinate: declare it with `coordinate`"),
            );
        } else if !moves {
            self.diagnostics.push(
                Diagnostic::error(span, "the time derivative of something that does not change is zero")
                    .help("differentiate a coordinate, or remove the term"),
            );
        }
    }

    fn unknown_function(&mut self, name: &Ident, arguments: &[Expr], place: Place<'a>) {
        let text = name.name.as_str();
        let local: Option<&Scope<'a>> =
            if let Place::Motion(index) = place { self.symbols.patterns.get(index) } else { None };
        let symbol = local.and_then(|scope| scope.get(text)).or_else(|| self.symbols.model.get(text));
        let error = match symbol.map(|symbol| symbol.kind) {
            Some(SymbolKind::Function(_)) => {
                Diagnostic::error(name.span, format!("`{text}` is written without its argument"))
                    .help(format!("write `{text}`"))
            }
            Some(SymbolKind::Quantity(role @ (Role::Input | Role::Coordinate))) if of_time(arguments) => {
                let error = Diagnostic::error(name.span, format!("`{text}` is written without its time"));
                let delay = delay(arguments);
                match (role, delay) {
                    (Role::Input, Some(delay)) => error.help(format!(
                        "write `{text}`; a delay belongs to the machine's drive, and the commands that read logs take it: `--delay {text}={delay}`"
                    )),
                    (_, Some(_)) => error.help(format!(
                        "write `{text}`; equations of motion have no delayed coordinates, and the delay of an input is given as `--delay INPUT=SECONDS`"
                    )),
                    (_, None) => error.help(format!("write `{text}`")),
                }
            }
            Some(_) => Diagnostic::error(name.span, format!("`{text}` is no function"))
                .help(format!("a product is written with `*`: `{text}*(...)`")),
            None => {
                let error = Diagnostic::error(name.span, format!("unknown function `{}`", shorten(text)));
                let names: Vec<&str> = Function::ALL.iter().map(|function| function.name()).collect();
                match text {
                    "ln" => error.help("write `log`, the natural logarithm"),
                    "pow" | "sinh" | "cosh" => {
                        error.help(format!("the functions are {}; a power is written `^`", names.join(", ")))
                    }
                    "atan" | "arctan" => error.help("write `atan2(y, x)`, the angle of the point (x, y)"),
                    "arcsin" => error.help("write `asin`"),
                    "arccos" => error.help("write `acos`"),
                    "sgn" | "signum" => error.help("write `sign`"),
                    "max" => error.help(
                        "write `(a + b + abs(a - b))/2` for the larger of a and b: `(a + abs(a))/2` where b is 0",
                    ),
                    "min" => error.help("write `(a + b - abs(a - b))/2` for the smaller of a and b"),
                    "step" | "heaviside" => {
                        error.help("write `(1 + sign(a))/2`, which is 1 where a is positive, else 0")
                    }
                    _ => match nearest(text, names.iter().copied()) {
                        Some(near) => error.help(format!("did you mean `{near}`?")),
                        None => error.help(format!("the functions are {}", names.join(", "))),
                    },
                }
            }
        };
        self.diagnostics.push(error);
    }

    // Uses.

    fn reachable(&self) -> HashSet<&'a str> {
        let mut reached = HashSet::new();
        let mut open = vec![User::Root];
        while let Some(user) = open.pop() {
            for &name in self.uses.get(&user).into_iter().flatten() {
                if reached.insert(name) {
                    open.push(User::Name(name));
                }
            }
        }
        reached
    }

    fn unused(&mut self, model: &'a ModelDeclaration) {
        let used = self.reachable();
        let inputs: Vec<_> = quantities(model, Role::Input).collect();
        let driven = inputs.iter().any(|(name, _)| used.contains(name));
        // Inputs that are declared have to stand in some equation; free motions have none.
        let dynamics =
            |item: &Item| matches!(item, Item::Equation(_) | Item::Force(_) | Item::Energy(_) | Item::Mechanism(_));
        if let (false, Some(&(name, span)), true) = (driven, inputs.first(), model.items.iter().any(dynamics)) {
            let help = format!("`{name}` must stand in an equation, as in `... = {name};`");
            let fault = Diagnostic::error(span, "no equation has an input".to_owned());
            self.diagnostics.push(fault.note("nothing drives this model").help(help));
        }
        // Names of the model.
        for item in &model.items {
            match item {
                Item::Declaration(declaration) => {
                    for quantity in &declaration.quantities {
                        let name = quantity.name.name.as_str();
                        // A reserved name and the second definition of a name define nothing, and are already reported.
                        if !defines(&self.symbols.model, &quantity.name) {
                            continue;
                        }
                        if !used.contains(name) && (declaration.role != Role::Input || driven) {
                            self.unused_name(
                                name,
                                quantity.name.span,
                                declaration.role.keyword(),
                                declaration.role == Role::Constant,
                            );
                        }
                    }
                }
                Item::Nonlinear(parameters) => {
                    for name in parameters.iter().map(|parameter| &parameter.name) {
                        if defines(&self.symbols.model, name) && !used.contains(name.name.as_str()) {
                            self.unused_name(&name.name, name.span, "nonlinear parameter", false);
                        }
                    }
                }
                Item::Series(series) if !used.contains(series.function.name.as_str()) => {
                    self.unused_name(&series.function.name, series.function.span, "series", false);
                }
                Item::Let(definition) if !used.contains(definition.name.name.as_str()) => {
                    self.unused_name(&definition.name.name, definition.name.span, "`let`", true);
                }
                _ => {}
            }
        }
        // Names of the patterns.
        let patterns =
            model.items.iter().filter_map(|item| if let Item::Pattern(pattern) = item { Some(pattern) } else { None });
        for (index, pattern) in patterns.enumerate() {
            for item in &pattern.items {
                let PatternItem::Declaration(declaration) = item else { continue };
                for quantity in &declaration.quantities {
                    let scope = &self.symbols.patterns[index];
                    if defines(scope, &quantity.name) && !self.pattern_uses[index].contains(quantity.name.name.as_str())
                    {
                        self.unused_name(&quantity.name.name, quantity.name.span, declaration.role.keyword(), false);
                    }
                }
            }
        }
    }

    fn unused_name(&mut self, name: &'a str, span: Span, what: &str, harmless: bool) {
        let message = format!("{what} `{name}` is never used");
        let user = self.uses.iter().find_map(|(user, names)| match user {
            User::Name(user) if names.contains(name) => Some(*user),
            _ => None,
        });
        let help = match user {
            Some(user) => format!("only `{user}` mentions it, and that is not used either; remove both, or use them"),
            None => "remove it, or use it in an equation".to_owned(),
        };
        let diagnostic = if harmless { Diagnostic::warning(span, message) } else { Diagnostic::error(span, message) };
        self.diagnostics.push(diagnostic.help(help));
    }
}

/// Whether the name is defined here, and not by an earlier statement.
fn defines(scope: &Scope<'_>, name: &Ident) -> bool {
    scope.get(name.name.as_str()).is_some_and(|symbol| symbol.span == name.span)
}

/// The time derivative of a coordinate that a name means where it is written as elsewhere: `xdot`, `dx`, `x_ddot`, `d2x_dt2`, `xpp`.
fn derivative(name: &str, coordinate: &str) -> Option<String> {
    let plain = name.replace('_', "");
    let spelled = |form: &str| plain == form.replace('x', &coordinate.replace('_', ""));
    let is = |forms: &[&str]| forms.iter().any(|form| spelled(form));
    if is(&["xdot", "dotx", "dx", "dxdt", "xd", "xp"]) {
        return Some(format!("dot({coordinate})"));
    }
    let second = ["xddot", "ddotx", "xdotdot", "ddx", "d2x", "d2xdt2", "xdd", "xpp"];
    is(&second).then(|| format!("ddot({coordinate})"))
}

/// Whether the time is in the arguments of what is written as its function.
fn of_time(arguments: &[Expr]) -> bool {
    let mut found = false;
    for argument in arguments {
        argument.walk(&mut |part| found |= matches!(&part.kind, ExprKind::Name(name) if name == "t"));
    }
    found
}

/// By how much the time in an argument is earlier, in the words of the text or as a decimal.
fn delay(arguments: &[Expr]) -> Option<String> {
    let [argument] = arguments else { return None };
    match argument.terms()[..] {
        [(Sign::Plus, time), (Sign::Minus, by)] if matches!(&time.kind, ExprKind::Name(name) if name == "t") => {
            Some(match &by.kind {
                ExprKind::Number(value) => rational::to_f64(value).to_string(),
                _ => "SECONDS".to_owned(),
            })
        }
        _ => None,
    }
}

fn counted(arguments: usize) -> String {
    match arguments {
        1 => "one argument".to_owned(),
        n => format!("{n} arguments"),
    }
}

fn quantities(model: &ModelDeclaration, role: Role) -> impl Iterator<Item = (&str, Span)> {
    model
        .items
        .iter()
        .filter_map(move |item| {
            if let Item::Declaration(declaration) = item { Some(declaration).filter(|d| d.role == role) } else { None }
        })
        .flat_map(|declaration| &declaration.quantities)
        .map(|quantity| (quantity.name.name.as_str(), quantity.name.span))
}
