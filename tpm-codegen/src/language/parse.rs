//! Parses tokens into the declarations of a model.
//!
//! Invariant: a fault is reported where it is found and removes at most its own statement. The parser continues behind
//! the next semicolon, at the closing brace, or at a line that begins a new statement. Recursion is bounded by
//! [`DEEPEST_NESTING`], loops by the number of tokens. Names in a removed statement are remembered, so that later
//! checks do not report them as unknown.

mod expr;
mod mechanism;

use std::collections::HashSet;

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::language::ast::{
    Count, Declaration, Definition, Eliminate, Energy, EnergyKind, Equation, Expr, ExprKind, Force, Ident, Item,
    ModelDeclaration, Motion, NonlinearParameter, PatternDeclaration, PatternItem, PreslidingOf, Quantity, Role,
    SeriesDeclaration, Taylor, UnitExpr,
};
use crate::language::keywords::{OTHER_STATEMENTS, PATTERN_STATEMENTS, STATEMENTS, belongs};
use crate::language::lex::{lex, shorten};
use crate::language::suggest::nearest;
use crate::language::token::{Token, TokenKind};
use crate::source::{Source, Span};
use num_traits::{CheckedDiv, CheckedMul, ToPrimitive};
use tpm_units::Exponent;

/// Deepest nesting of parentheses, calls and minus signs; a stack of this depth fits the smallest usual thread.
pub const DEEPEST_NESTING: usize = 128;
/// Highest power of a unit.
const HIGHEST_UNIT_POWER: i64 = 1000;
/// Largest denominator of a power of a unit: all fractions of such have a common denominator of five digits.
const LARGEST_ROOT: i64 = 12;

/// Results of parsing.
pub(crate) struct Syntax {
    /// The model, without the statements that could not be read.
    pub(crate) model: Option<ModelDeclaration>,
    /// Whether statements are missing from the model, so that checks must not report anything as missing.
    pub(crate) incomplete: bool,
    /// Names that occur in removed statements.
    pub(crate) mentioned: HashSet<String>,
}

/// Parses a source; faults go to `diagnostics`.
pub(crate) fn parse(source: &Source, diagnostics: &mut Diagnostics) -> Syntax {
    let mut parser = Parser::new(source, diagnostics);
    let model = if source.fault().is_some() { None } else { parser.file() };
    Syntax { model, incomplete: parser.incomplete, mentioned: parser.mentioned }
}

/// Parses a text that is one expression; faults go to `diagnostics`.
pub(crate) fn parse_expression(source: &Source, diagnostics: &mut Diagnostics) -> Option<Expr> {
    let mut parser = Parser::new(source, diagnostics);
    if source.fault().is_some() {
        return None;
    }
    let expr = parser.expr().ok()?;
    if parser.kind() != TokenKind::End {
        let (span, found) = (parser.peek().span, parser.found());
        let unexpected = Diagnostic::error(span, format!("{found} is not expected here"));
        parser.report(unexpected.help("write one expression, such as -pi/2 or m*g/k"));
    }
    Some(expr)
}

/// Marks a fault that was reported; the caller recovers.
#[derive(Debug)]
struct Reported;

type Parse<T> = Result<T, Reported>;

struct Parser<'a, 'd> {
    source: &'a Source,
    tokens: Vec<Token>,
    at: usize,
    depth: usize,
    diagnostics: &'d mut Diagnostics,
    incomplete: bool,
    mentioned: HashSet<String>,
    declared: HashSet<&'a str>,
}

impl<'a, 'd> Parser<'a, 'd> {
    fn new(source: &'a Source, diagnostics: &'d mut Diagnostics) -> Self {
        let tokens = lex(source, diagnostics);
        Self {
            source,
            tokens,
            at: 0,
            depth: 0,
            diagnostics,
            incomplete: false,
            mentioned: HashSet::new(),
            declared: HashSet::new(),
        }
    }

    // Tokens.

    fn nth(&self, ahead: usize) -> Token {
        // The last token is the end of the text, which every further read returns again.
        self.tokens
            .get(self.at + ahead)
            .or(self.tokens.last())
            .copied()
            .unwrap_or(Token { kind: TokenKind::End, span: Span::default() })
    }

    fn peek(&self) -> Token {
        self.nth(0)
    }

    fn kind(&self) -> TokenKind {
        self.peek().kind
    }

    fn bump(&mut self) -> Token {
        let token = self.peek();
        self.at = (self.at + 1).min(self.tokens.len());
        token
    }

    fn eat(&mut self, kind: TokenKind) -> bool {
        let found = self.kind() == kind;
        if found {
            self.bump();
        }
        found
    }

    fn text(&self, token: Token) -> &'a str {
        self.source.slice(token.span)
    }

    fn is_word(&self, ahead: usize, word: &str) -> bool {
        let token = self.nth(ahead);
        token.kind == TokenKind::Ident && self.text(token) == word
    }

    /// The span of the token before the next one; a missing token is reported behind it.
    fn last(&self) -> Span {
        self.at.checked_sub(1).and_then(|at| self.tokens.get(at)).map_or_else(Span::default, |token| token.span)
    }

    fn on_new_line(&self) -> bool {
        self.source.slice(Span::new(self.last().end, self.peek().span.start.max(self.last().end))).contains('\n')
    }

    // Faults.

    fn report(&mut self, diagnostic: Diagnostic) -> Reported {
        // What ends at a condition was reported when the condition was read.
        if self.kind() != TokenKind::Condition {
            self.diagnostics.push(diagnostic);
        }
        Reported
    }

    fn found(&self) -> String {
        let token = self.peek();
        match token.kind {
            TokenKind::End => "the text ends here".to_owned(),
            _ => format!("found `{}`", shorten(self.text(token))),
        }
    }

    fn unexpected(&mut self, wanted: &str) -> Reported {
        let note = self.found();
        let span = self.peek().span;
        self.report(Diagnostic::error(span, format!("expected {wanted}")).note(note))
    }

    fn expect(&mut self, kind: TokenKind) -> Parse<Token> {
        if self.kind() == kind { Ok(self.bump()) } else { Err(self.unexpected(kind.describe())) }
    }

    fn name(&mut self, what: &str) -> Parse<Ident> {
        if self.kind() != TokenKind::Ident {
            return Err(self.unexpected(what));
        }
        let token = self.bump();
        Ok(Ident { name: self.text(token).to_owned(), span: token.span })
    }

    fn word(&mut self, word: &str) -> Parse<Token> {
        if self.is_word(0, word) { Ok(self.bump()) } else { Err(self.unexpected(&format!("`{word}`"))) }
    }

    /// Reads the end of a statement. A line end counts as a forgotten semicolon, in which case no token is skipped.
    fn end_of_statement(&mut self) -> Parse<()> {
        if self.eat(TokenKind::Semicolon) {
            return Ok(());
        }
        let token = self.peek();
        if self.on_new_line() || matches!(token.kind, TokenKind::End | TokenKind::CloseBrace) {
            let span = self.last();
            self.report(
                Diagnostic::error(span, "a `;` is missing")
                    .note("the statement ends here")
                    .help("every statement ends with `;`"),
            );
            return Ok(());
        }
        let error = Diagnostic::error(token.span, "expected an operator or `;`").note(self.found());
        Err(self.report(match token.kind {
            TokenKind::Ident | TokenKind::Number | TokenKind::OpenParen => error.help("a product is written with `*`"),
            TokenKind::CloseParen => error.help("this `)` has no `(`"),
            TokenKind::Equals => error.help("an equation has one `=`"),
            _ => error,
        }))
    }

    /// Skips the rest of a statement with a syntax fault.
    fn recover(&mut self, begun: usize, statements: &[&str]) {
        self.incomplete = true;
        for index in begun..self.at {
            self.mention(index);
        }
        let mut braces = 0_usize;
        loop {
            match self.kind() {
                TokenKind::End => break,
                TokenKind::Semicolon if braces == 0 => {
                    self.bump();
                    break;
                }
                TokenKind::CloseBrace if braces == 0 => break,
                TokenKind::CloseBrace => braces -= 1,
                TokenKind::OpenBrace => braces += 1,
                TokenKind::Ident
                    if braces == 0 && self.at > begun && self.on_new_line() && self.begins_statement(statements) =>
                {
                    break;
                }
                _ => {}
            }
            self.mention(self.at);
            self.bump();
        }
    }

    fn begins_statement(&self, statements: &[&str]) -> bool {
        let next = self.nth(1).kind;
        let word = self.text(self.peek());
        (statements.contains(&word)
            && (next == TokenKind::Ident || next == TokenKind::Number || next == TokenKind::OpenBrace))
            || (word == "mechanism" && next == TokenKind::OpenBrace)
            || (word == "nonlinear" && next == TokenKind::Ident)
    }

    fn mention(&mut self, index: usize) {
        if let Some(&token) = self.tokens.get(index).filter(|token| token.kind == TokenKind::Ident) {
            let text = self.text(token);
            if !self.mentioned.contains(text) {
                self.mentioned.insert(text.to_owned());
            }
        }
    }

    // The file.

    fn file(&mut self) -> Option<ModelDeclaration> {
        if !(self.is_word(0, "model") && self.nth(1).kind == TokenKind::Ident) {
            let span = self.peek().span;
            self.report(
                Diagnostic::error(span, "a model begins with `model NAME {`")
                    .note(self.found())
                    .help("see `models/mass_spring_drag.tpm` for an example"),
            );
            self.incomplete = true;
            while self.kind() != TokenKind::End && !(self.is_word(0, "model") && self.nth(1).kind == TokenKind::Ident) {
                self.bump();
            }
            if self.kind() == TokenKind::End {
                return None;
            }
        }
        self.bump();
        let name = self.name("the model's name").ok()?;
        let open = self.expect(TokenKind::OpenBrace).ok()?;
        let items = self.items(open.span);
        if self.kind() != TokenKind::End {
            let token = self.peek();
            let message = if self.is_word(0, "model") {
                "a source has one model"
            } else {
                "text behind the model's closing brace"
            };
            let note = self.found();
            self.report(
                Diagnostic::error(token.span, message).note(note).help("move it to a file of its own, or remove it"),
            );
            self.incomplete = true;
        }
        Some(ModelDeclaration { name, items })
    }

    fn items(&mut self, open: Span) -> Vec<Item> {
        let mut items = Vec::new();
        loop {
            match self.kind() {
                TokenKind::CloseBrace => {
                    self.bump();
                    return items;
                }
                TokenKind::End => {
                    self.report(
                        Diagnostic::error(open, "this `{` is not closed").help("add a `}` at the end of the model"),
                    );
                    self.incomplete = true;
                    return items;
                }
                TokenKind::Semicolon => {
                    self.bump();
                }
                _ => {
                    let begun = self.at;
                    match self.item() {
                        Ok(item) => items.push(item),
                        Err(Reported) => self.recover(begun, &STATEMENTS),
                    }
                }
            }
        }
    }

    fn item(&mut self) -> Parse<Item> {
        let first = self.peek();
        let next = self.nth(1).kind;
        if first.kind != TokenKind::Ident {
            return self.equation();
        }
        let word = self.text(first);
        match (word, next) {
            ("kinetic", TokenKind::Equals) if !self.declared.contains(word) => self.energy(EnergyKind::Kinetic),
            ("potential", TokenKind::Equals) if !self.declared.contains(word) => self.energy(EnergyKind::Potential),
            ("dissipation", TokenKind::Equals) if !self.declared.contains(word) => self.energy(EnergyKind::Dissipation),
            ("pattern", TokenKind::OpenBrace | TokenKind::Ident) => self.pattern(),
            ("mechanism", TokenKind::OpenBrace) => self.mechanism(),
            ("nonlinear", TokenKind::Ident) => self.nonlinear(),
            // Two successive names form no expression, so a word before a name is a keyword, whatever names are
            // declared.
            (_, TokenKind::Ident) if STATEMENTS.contains(&word) || !self.declared.contains(word) => {
                self.statement(word, first.span)
            }
            _ => self.equation(),
        }
    }

    fn statement(&mut self, word: &str, span: Span) -> Parse<Item> {
        let known = if STATEMENTS.contains(&word) {
            word
        } else {
            let error = Diagnostic::error(span, format!("`{}` begins no statement", shorten(word)));
            if let Some(place) = belongs(word) {
                return Err(self.report(error.help(format!("`{word}` belongs into {place}"))));
            }
            match nearest(word, STATEMENTS.into_iter().chain(OTHER_STATEMENTS)) {
                Some(near) => {
                    let reported = self.report(error.help(format!("did you mean `{near}`?")));
                    // What follows is read as that statement, so that its own faults are found too.
                    if !STATEMENTS.contains(&near) {
                        return Err(reported);
                    }
                    near
                }
                None => {
                    let names = [&STATEMENTS[..], &OTHER_STATEMENTS].concat().join(", ");
                    return Err(self.report(error.help(format!(
                        "statements are equations or begin with one of {names}; a product is written with `*`"
                    ))));
                }
            }
        };
        match known {
            "coordinate" => self.declaration(Role::Coordinate).map(Item::Declaration),
            "unmeasured" => {
                let unmeasured = true;
                // `unmeasured coordinate y` says the same as `unmeasured y`.
                if self.text(self.nth(1)) == "coordinate" && self.nth(2).kind == TokenKind::Ident {
                    self.bump();
                }
                self.declaration(Role::Coordinate).map(|own| Item::Declaration(Declaration { unmeasured, ..own }))
            }
            "presliding" => self.presliding(),
            "input" => self.declaration(Role::Input).map(Item::Declaration),
            "parameter" => self.declaration(Role::Parameter).map(Item::Declaration),
            "constant" => self.declaration(Role::Constant).map(Item::Declaration),
            "series" => self.series(),
            "let" => self.definition().map(Item::Let),
            "lump" => self.definition().map(Item::Lump),
            "force" => self.force(),
            "eliminate" => self.eliminate(),
            "taylor" => self.taylor(),
            _ => self.pattern(),
        }
    }

    // Statements; each begins at its keyword.

    fn declaration(&mut self, role: Role) -> Parse<Declaration> {
        self.bump();
        let mut quantities = Vec::new();
        loop {
            let name = self.name("a name")?;
            let token = self.tokens[self.at - 1];
            self.declared.insert(self.text(token));
            let mut unit = self.unit()?;
            let mut value = None;
            if self.kind() == TokenKind::Equals {
                let equals = self.bump().span;
                let expr = self.expr()?;
                if role == Role::Constant {
                    value = Some(expr);
                } else {
                    self.report(
                        Diagnostic::error(
                            equals.to(expr.span),
                            format!(
                                "only a constant has a value, `{}` is {} {}",
                                name.name,
                                role.article(),
                                role.keyword()
                            ),
                        )
                        .help(format!(
                            "write `constant {} = ...;` if it is known, or put its value into the experiment file",
                            name.name
                        )),
                    );
                }
                if let Some(second) = self.unit()? {
                    if let Some(first) = &unit {
                        self.report(
                            Diagnostic::error(second.span, "a second unit")
                                .label(first.span, "the first one")
                                .help("keep one of them"),
                        );
                    }
                    unit = Some(second);
                }
            }
            quantities.push(Quantity { name, value, unit });
            if !self.eat(TokenKind::Comma) {
                break;
            }
        }
        self.end_of_statement()?;
        Ok(Declaration { role, unmeasured: false, presliding: None, quantities })
    }

    /// `presliding z of q over 0.001;`
    fn presliding(&mut self) -> Parse<Item> {
        let keyword = self.bump().span;
        let name = self.name("a name")?;
        let token = self.tokens[self.at - 1];
        self.declared.insert(self.text(token));
        self.word("of")?;
        let coordinate = self.name("a coordinate")?;
        self.word("over")?;
        let travel = self.expr()?;
        self.end_of_statement()?;
        Ok(Item::Declaration(Declaration {
            role: Role::Coordinate,
            unmeasured: false,
            presliding: Some(PreslidingOf { coordinate, travel }),
            quantities: vec![Quantity {
                name,
                value: None,
                unit: Some(UnitExpr { factors: Vec::new(), span: keyword }),
            }],
        }))
    }

    /// `nonlinear parameter vs [m/s] from 0.01 to 0.5, q0 [rad] from -0.2 to 0.2;`
    fn nonlinear(&mut self) -> Parse<Item> {
        self.bump();
        self.word("parameter")?;
        let mut parameters = Vec::new();
        loop {
            let name = self.name("a name")?;
            let token = self.tokens[self.at - 1];
            self.declared.insert(self.text(token));
            let unit = self.unit()?;
            if !self.is_word(0, "from") {
                let error = Diagnostic::error(name.span, format!("`{}` has no interval", name.name)).note(self.found());
                return Err(self.report(error.help(format!(
                    "say where it is looked for, in its own unit: `nonlinear parameter {} from 0.01 to 0.5;`",
                    name.name
                ))));
            }
            self.bump();
            let from = self.expr()?;
            self.word("to")?;
            let to = self.expr()?;
            parameters.push(NonlinearParameter { name, unit, from, to });
            if !self.eat(TokenKind::Comma) {
                break;
            }
        }
        self.end_of_statement()?;
        Ok(Item::Nonlinear(parameters))
    }

    fn series(&mut self) -> Parse<Item> {
        self.bump();
        let function = self.name("the function's name")?;
        self.expect(TokenKind::OpenParen)?;
        let coordinate = self.name("a coordinate")?;
        self.expect(TokenKind::CloseParen)?;
        let unit = self.unit()?;
        let definition = if self.eat(TokenKind::Equals) { Some(self.expr()?) } else { None };
        self.word("about")?;
        let point = self.expr()?;
        self.word("order")?;
        let order = self.count()?;
        let mut coefficients = Vec::new();
        if self.is_word(0, "as") {
            self.bump();
            loop {
                coefficients.push(self.name("a coefficient's name")?);
                if !self.eat(TokenKind::Comma) {
                    break;
                }
            }
        }
        self.end_of_statement()?;
        Ok(Item::Series(SeriesDeclaration { function, coordinate, unit, definition, point, order, coefficients }))
    }

    fn definition(&mut self) -> Parse<Definition> {
        self.bump();
        let name = self.name("a name")?;
        self.expect(TokenKind::Equals)?;
        let value = self.expr()?;
        self.end_of_statement()?;
        Ok(Definition { name, value })
    }

    fn energy(&mut self, kind: EnergyKind) -> Parse<Item> {
        let keyword = self.bump().span;
        self.expect(TokenKind::Equals)?;
        let value = self.expr()?;
        self.end_of_statement()?;
        Ok(Item::Energy(Energy { kind, keyword, value }))
    }

    fn force(&mut self) -> Parse<Item> {
        self.bump();
        let coordinate = self.name("a coordinate")?;
        self.expect(TokenKind::Equals)?;
        let value = self.expr()?;
        self.end_of_statement()?;
        Ok(Item::Force(Force { coordinate, value }))
    }

    fn eliminate(&mut self) -> Parse<Item> {
        self.bump();
        let mut coordinates = vec![self.name("a coordinate")?];
        while self.eat(TokenKind::Comma) {
            coordinates.push(self.name("a coordinate")?);
        }
        self.word("as")?;
        let stem = self.name("a name for the lumped parameters")?;
        self.end_of_statement()?;
        Ok(Item::Eliminate(Eliminate { coordinates, stem }))
    }

    fn taylor(&mut self) -> Parse<Item> {
        self.bump();
        let coordinate = self.name("a coordinate")?;
        self.word("about")?;
        let point = self.expr()?;
        self.word("order")?;
        let order = self.count()?;
        self.end_of_statement()?;
        Ok(Item::Taylor(Taylor { coordinate, point, order }))
    }

    fn equation(&mut self) -> Parse<Item> {
        let left = self.expr()?;
        if self.kind() != TokenKind::Equals {
            let token = self.peek();
            let error = Diagnostic::error(token.span, "expected `=` or an operator").note(self.found());
            let help = match token.kind {
                TokenKind::Ident | TokenKind::Number | TokenKind::OpenParen if !self.on_new_line() => {
                    "a product is written with `*`"
                }
                TokenKind::OpenBracket if matches!(left.kind, ExprKind::Name(_)) && self.ends_at_unit() => {
                    "several names of one declaration are separated by commas, `coordinate x [m], y [m];`; or repeat the word before the name"
                }
                TokenKind::OpenBracket => "units stand where names are declared: `constant g = 9.81 [m/s^2];`",
                _ => "an equation of motion is `left = right;`",
            };
            return Err(self.report(error.help(help)));
        }
        self.bump();
        let right = self.expr()?;
        self.end_of_statement()?;
        Ok(Item::Equation(Equation { left, right }))
    }

    /// Whether nothing stands behind the unit that begins here.
    fn ends_at_unit(&self) -> bool {
        let close = (1..16).find(|&ahead| self.nth(ahead).kind == TokenKind::CloseBracket);
        close.is_some_and(|at| matches!(self.nth(at + 1).kind, TokenKind::Semicolon | TokenKind::Comma))
    }

    fn pattern(&mut self) -> Parse<Item> {
        let keyword = self.bump().span;
        let name = if self.kind() == TokenKind::Ident { Some(self.name("a name")?) } else { None };
        let open = self.expect(TokenKind::OpenBrace)?;
        let mut items = Vec::new();
        loop {
            match self.kind() {
                TokenKind::CloseBrace => {
                    self.bump();
                    break;
                }
                TokenKind::End => {
                    self.report(
                        Diagnostic::error(open.span, "this `{` is not closed")
                            .help("add a `}` at the end of the pattern"),
                    );
                    self.incomplete = true;
                    break;
                }
                TokenKind::Semicolon => {
                    self.bump();
                }
                _ => {
                    let begun = self.at;
                    match self.pattern_item() {
                        Ok(item) => items.push(item),
                        Err(Reported) => self.recover(begun, &PATTERN_STATEMENTS),
                    }
                }
            }
        }
        Ok(Item::Pattern(PatternDeclaration { keyword, name, items }))
    }

    fn pattern_item(&mut self) -> Parse<PatternItem> {
        let first = self.peek();
        let word = if first.kind == TokenKind::Ident { self.text(first) } else { "" };
        match (word, self.nth(1).kind) {
            ("harmonics", TokenKind::Number) => {
                self.bump();
                let count = self.count()?;
                self.end_of_statement()?;
                Ok(PatternItem::Harmonics(count))
            }
            (_, TokenKind::Ident) => {
                let role = match word {
                    "amplitude" => Role::Amplitude,
                    "frequency" => Role::Frequency,
                    _ => {
                        let error = Diagnostic::error(
                            first.span,
                            format!("`{}` begins no statement of a pattern", shorten(word)),
                        );
                        if STATEMENTS.contains(&word) {
                            return Err(
                                self.report(error.help(format!("move `{word}` out of the pattern, into the model")))
                            );
                        }
                        match nearest(word, PATTERN_STATEMENTS) {
                            Some("amplitude") => {
                                self.report(error.help("did you mean `amplitude`?"));
                                Role::Amplitude
                            }
                            Some("frequency") => {
                                self.report(error.help("did you mean `frequency`?"));
                                Role::Frequency
                            }
                            _ => {
                                return Err(self.report(error.help(
                                    "a pattern declares `amplitude` and `frequency` and gives motions, `x = lambda*cos(w*t);`",
                                )));
                            }
                        }
                    }
                };
                self.declaration(role).map(PatternItem::Declaration)
            }
            _ => {
                let coordinate = self.name("a coordinate and its motion, `x = ...;`")?;
                self.expect(TokenKind::Equals)?;
                let value = self.expr()?;
                self.end_of_statement()?;
                Ok(PatternItem::Motion(Motion { coordinate, value }))
            }
        }
    }

    // Small parts.

    fn count(&mut self) -> Parse<Count> {
        let token = self.peek();
        if token.kind != TokenKind::Number {
            return Err(self.unexpected("a non-negative integer"));
        }
        match self.text(token).parse() {
            Ok(value) => {
                self.bump();
                Ok(Count { value, span: token.span })
            }
            Err(_) => Err(self.report(
                Diagnostic::error(token.span, format!("`{}` is no order", shorten(self.text(token))))
                    .help("write a non-negative integer"),
            )),
        }
    }

    /// `[kg*m/s^2]`, or nothing.
    fn unit(&mut self) -> Parse<Option<UnitExpr>> {
        if self.kind() != TokenKind::OpenBracket {
            return Ok(None);
        }
        let open = self.bump().span;
        let mut factors = Vec::new();
        self.unit_product(&mut factors, 0)?;
        let close = match self.kind() {
            TokenKind::CloseBracket => self.bump().span,
            TokenKind::Ident | TokenKind::Number | TokenKind::OpenParen => {
                let error =
                    Diagnostic::error(self.peek().span, "expected `*`, `/`, `^` or `]` in a unit").note(self.found());
                return Err(self.report(error.help("a product of units is written with `*`, as in `[N*m]`")));
            }
            _ => return Err(self.unexpected("`]` at the end of the unit")),
        };
        Ok(Some(UnitExpr { factors, span: open.to(close) }))
    }

    fn unit_product(&mut self, factors: &mut Vec<(Ident, Exponent)>, depth: usize) -> Parse<()> {
        let mut sign = 1;
        loop {
            let first = factors.len();
            let begun = self.peek().span;
            self.unit_base(factors, depth)?;
            let exponent = self.unit_exponent()? * Exponent::from_integer(sign);
            for (_, power) in &mut factors[first..] {
                *power =
                    power.checked_mul(&exponent).filter(is_bounded).ok_or_else(|| self.report(unit_power(begun)))?;
            }
            sign = match self.kind() {
                TokenKind::Star => 1,
                TokenKind::Slash => -1,
                _ => return Ok(()),
            };
            self.bump();
        }
    }

    /// A name, `1`, or a product in parentheses.
    fn unit_base(&mut self, factors: &mut Vec<(Ident, Exponent)>, depth: usize) -> Parse<()> {
        let token = self.peek();
        match token.kind {
            TokenKind::Ident => {
                factors.push((self.name("a unit")?, Exponent::from_integer(1)));
                Ok(())
            }
            TokenKind::Number if self.text(token) == "1" => {
                self.bump();
                Ok(())
            }
            TokenKind::Number => Err(self.report(
                Diagnostic::error(token.span, "a unit has no numbers but 1")
                    .help("use a prefixed unit such as `mm`, or put the factor into the equation"),
            )),
            TokenKind::OpenParen if depth < DEEPEST_NESTING => {
                self.bump();
                self.unit_product(factors, depth + 1)?;
                self.expect(TokenKind::CloseParen)?;
                Ok(())
            }
            _ => Err(self.unexpected("a unit, such as `kg*m/s^2`, or `1`")),
        }
    }

    /// `^2`, `^-1`, `^0.5`, `^(5/2)`, or nothing, which is 1.
    fn unit_exponent(&mut self) -> Parse<Exponent> {
        if let TokenKind::Superscript(digit) = self.kind() {
            self.bump();
            return Ok(Exponent::from_integer(digit.into()));
        }
        if !self.eat(TokenKind::Caret) {
            return Ok(Exponent::from_integer(1));
        }
        let inside = self.eat(TokenKind::OpenParen);
        let sign = if self.eat(TokenKind::Minus) { -1 } else { 1 };
        let above = self.unit_number()?;
        let below = if inside && self.eat(TokenKind::Slash) { self.unit_number()? } else { Exponent::from_integer(1) };
        let end = self.peek().span;
        if inside {
            self.expect(TokenKind::CloseParen)?;
        }
        let exponent = above.checked_div(&below).map(|exponent| exponent * Exponent::from_integer(sign));
        exponent.filter(is_bounded).ok_or_else(|| self.report(unit_power(end)))
    }

    /// A number of an exponent, exactly.
    fn unit_number(&mut self) -> Parse<Exponent> {
        let token = self.peek();
        let value = match token.kind {
            TokenKind::Number => Some(self.number(self.text(token), token.span)?),
            _ => None,
        };
        let small = value.and_then(|value| Some(Exponent::new(value.numer().to_i64()?, value.denom().to_i64()?)));
        match small.filter(is_bounded) {
            Some(value) => {
                self.bump();
                Ok(value)
            }
            None => {
                let fault = unit_power(token.span).note(self.found());
                Err(self.report(fault))
            }
        }
    }
}

fn unit_power(span: Span) -> Diagnostic {
    let bounds = format!("of at most {HIGHEST_UNIT_POWER}, with a denominator of at most {LARGEST_ROOT}");
    Diagnostic::error(span, format!("a unit's exponent is a whole number or a fraction {bounds}"))
        .help("write, for example, `[m^-1]` or `[m^(5/2)/s]`")
}

/// Whether an exponent of a unit is one that is kept: far above those of any unit, and so small that sums and products stay exact.
fn is_bounded(exponent: &Exponent) -> bool {
    exponent.numer().abs() <= HIGHEST_UNIT_POWER * exponent.denom() && *exponent.denom() <= LARGEST_ROOT
}
