//! Meanings of the words of a text, for editors.
//!
//! Invariant: every text has an outline, even an unfinished one; statements that cannot be parsed declare nothing.

use crate::diagnostic::Diagnostics;
use crate::language::ast::mechanism::{InertiaDeclaration, MechanismDeclaration, loss_word};
use crate::language::ast::{Declaration, Ident, Item, PatternItem};
use crate::language::function::{Clause, Function};
use crate::language::keywords::KEYWORDS;
use crate::language::lex::lex;
use crate::language::parse;
use crate::language::token::{Token, TokenKind};
use crate::source::{Source, Span};
use tpm_units::Unit;

/// Kind of a word.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Meant {
    /// A quantity, an expression or a body that the text declares.
    Declared,
    /// A function, or a clause of `shape`.
    Function,
    /// A keyword.
    Keyword,
    /// A unit of measurement.
    Unit,
}

/// A word with its meaning.
#[derive(Clone, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub struct Word {
    /// The word.
    pub name: String,
    /// Kind of the word.
    pub meant: Meant,
    /// Its declaration or syntax, with its unit if it has one.
    pub usage: String,
    /// Its meaning; for a declared name, the comment behind its declaration. May be empty.
    pub meaning: String,
}

/// The word at a byte offset of the text, or right before it, with its place.
#[must_use]
pub fn word_at(source: &Source, offset: u32) -> Option<(Span, Word)> {
    let tokens = lex(source, &mut Diagnostics::new());
    let touches =
        |token: &Token| token.kind == TokenKind::Ident && token.span.start <= offset && offset <= token.span.end;
    let index = tokens.iter().position(touches)?;
    let span = tokens[index].span;
    let name = source.slice(span);
    let bracket = tokens[..index].iter().rev().map(|token| token.kind).find(|kind| {
        matches!(kind, TokenKind::OpenBracket | TokenKind::CloseBracket | TokenKind::Semicolon | TokenKind::OpenBrace)
    });
    if bracket == Some(TokenKind::OpenBracket) {
        let unit = Unit::named(name)?;
        let usage = format!("[{name}]");
        let word = Word { name: name.to_owned(), meant: Meant::Unit, usage, meaning: format!("the unit {unit}") };
        return Some((span, word));
    }
    let called = tokens.get(index + 1).is_some_and(|next| next.kind == TokenKind::OpenParen);
    let declared = declared(source);
    // Of several declarations of a name, in patterns or elsewhere, the last one before its use applies.
    let named = || declared.iter().filter(|(_, word)| word.name == name);
    let own = named().rfind(|(at, _)| at.start <= span.start).or_else(|| named().next());
    let own = own.map(|(_, word)| word.clone());
    let given = given().find(|word| word.name == name && (called || word.meant != Meant::Function));
    let word = if called { given.or(own) } else { own.or(given) };
    word.map(|word| (span, word))
}

/// Every word that may be written somewhere in the text: the names that it declares, functions, keywords.
#[must_use]
pub fn words(source: &Source) -> Vec<Word> {
    let mut words: Vec<Word> = Vec::new();
    for word in declared(source).into_iter().map(|(_, word)| word).chain(given()) {
        if !words.iter().any(|before| before.name == word.name) {
            words.push(word);
        }
    }
    words
}

/// The words of the language itself.
fn given() -> impl Iterator<Item = Word> {
    let word = |name: &str, meant, usage: &str, meaning: &str| Word {
        name: name.to_owned(),
        meant,
        usage: usage.to_owned(),
        meaning: meaning.to_owned(),
    };
    let functions = Function::ALL.iter().map(move |own| word(own.name(), Meant::Function, own.usage(), own.meaning()));
    let clauses = Clause::names().map(move |name| word(name, Meant::Function, name, "a clause of `shape`"));
    let keywords = KEYWORDS.iter().map(move |(name, usage, meaning)| word(name, Meant::Keyword, usage, meaning));
    functions.chain(clauses).chain(keywords)
}

/// The names that a text declares, at their places, in the order of the text.
fn declared(source: &Source) -> Vec<(Span, Word)> {
    let syntax = parse::parse(source, &mut Diagnostics::new());
    let mut names = Names { source, found: Vec::new() };
    for item in syntax.model.iter().flat_map(|model| &model.items) {
        names.item(item);
    }
    names.found
}

/// Longest definition that is shown, in characters.
const LONGEST: usize = 200;

struct Names<'a> {
    source: &'a Source,
    found: Vec<(Span, Word)>,
}

impl Names<'_> {
    fn add(&mut self, name: &Ident, usage: &str) {
        // The language has no strings, so that `//` begins a comment wherever it stands.
        let meaning = self.source.line_at(name.span.start).split_once("//").map_or("", |(_, comment)| comment.trim());
        let usage = match usage.char_indices().nth(LONGEST) {
            Some((end, _)) => format!("{}...", &usage[..end]),
            None => usage.to_owned(),
        };
        let word = Word { name: name.name.clone(), meant: Meant::Declared, usage, meaning: meaning.to_owned() };
        self.found.push((name.span, word));
    }

    fn declaration(&mut self, declaration: &Declaration) {
        for quantity in &declaration.quantities {
            self.add(&quantity.name, &format!("{} {quantity}", declaration.keyword()));
        }
    }

    fn item(&mut self, item: &Item) {
        match item {
            Item::Declaration(declaration) => self.declaration(declaration),
            Item::Nonlinear(parameters) => {
                for parameter in parameters {
                    self.add(&parameter.name, &format!("nonlinear parameter {parameter}"));
                }
            }
            Item::Series(series) => {
                self.add(&series.function, &series.to_string());
                for name in &series.coefficients {
                    self.add(name, &format!("coefficient {} of {series}", name.name));
                }
            }
            Item::Let(own) => self.add(&own.name, &format!("let {} = {}", own.name.name, own.value)),
            Item::Lump(own) => self.add(&own.name, &format!("lump {} = {}", own.name.name, own.value)),
            Item::Mechanism(mechanism) => self.mechanism(mechanism),
            Item::Pattern(pattern) => {
                for item in &pattern.items {
                    if let PatternItem::Declaration(declaration) = item {
                        self.declaration(declaration);
                    }
                }
            }
            Item::Equation(_) | Item::Energy(_) | Item::Force(_) | Item::Eliminate(_) | Item::Taylor(_) => {}
        }
    }

    fn mechanism(&mut self, mechanism: &MechanismDeclaration) {
        for body in mechanism.bodies() {
            let own = &body.name.name;
            let usage = match &body.parent {
                Some(parent) => format!("body {own} on {}", parent.name),
                None => format!("body {own}"),
            };
            self.add(&body.name, &usage);
            if let Some(InertiaDeclaration::Parameters(names)) = &body.inertia {
                for name in names {
                    self.add(name, &format!("parameter {} of body {own}", name.name));
                }
            }
        }
        for drive in mechanism.drives() {
            if drive.moves.is_some() {
                self.add(&drive.name, &drive.to_string());
            }
            for (loss, name) in &drive.losses {
                self.add(name, &format!("parameter {}: {} of drive {}", name.name, loss_word(*loss), drive.name.name));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Meant, word_at, words};
    use crate::source::Source;

    const TEXT: &str = "model M {\n    coordinate x [m];\n    input u [N];\n    parameter k [N/m]; // of the spring\n    \
        let s = x - 1;\n    k*s + dot(x) = u;\n    pattern { amplitude a [m]; frequency w [rad/s]; x = a*cos(w*t); }\n    k +";

    #[test]
    fn words_of_a_text_that_is_not_finished_are_known() {
        let source = Source::new("t", TEXT);
        let at = |part: &str| {
            let offset = TEXT.find(part).expect("it stands there");
            word_at(&source, u32::try_from(offset).expect("small"))
                .map(|(_, word)| (word.usage, word.meaning, word.meant))
        };
        let declared = |usage: &str, meaning: &str| Some((usage.to_owned(), meaning.to_owned(), Meant::Declared));
        assert_eq!(at("k*s"), declared("parameter k [N/m]", "of the spring"));
        assert_eq!(at("s + dot"), declared("let s = x - 1", ""));
        assert_eq!(at("a*cos"), declared("amplitude a [m]", ""));
        assert_eq!(at("dot(x)").map(|(usage, ..)| usage), Some("dot(x)".to_owned()));
        assert_eq!(at("frequency").map(|(.., meant)| meant), Some(Meant::Keyword));
        assert_eq!(at("N];").map(|(usage, meaning, _)| usage + &meaning), Some("[N]the unit N".to_owned()));
        assert_eq!(at("= u"), None);
        let names: Vec<String> = words(&source).into_iter().map(|word| word.name).collect();
        for name in ["x", "u", "k", "s", "a", "w", "sin", "rest_to_rest", "start", "eliminate", "pi"] {
            assert_eq!(names.iter().filter(|own| *own == name).count(), 1, "{name}");
        }
    }

    #[test]
    fn every_beginning_of_a_text_has_words() {
        for end in 0..=TEXT.len() {
            let source = Source::new("t", &TEXT[..end]);
            assert!(words(&source).len() > 60);
            for offset in [0, end / 2, end, end + 10] {
                let _ = word_at(&source, u32::try_from(offset).expect("small"));
            }
        }
    }
}
