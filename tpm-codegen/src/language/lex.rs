//! Conversion of text to tokens.
//!
//! Invariant: every byte of the text is either in a token, blank, in a comment, or covered by a diagnostic; nothing is dropped
//! silently. The lexer never stops: a slip that has an obvious reading (`3w`, `**`, a typographic minus) gives its message and
//! the tokens of that reading, so that one slip is reported once.

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::language::token::{Token, TokenKind};
use crate::source::{Fault, Source, Span};
use std::collections::HashSet;

/// Splits a source into tokens. A source whose bytes are no text gives its fault and no tokens.
pub(crate) fn lex(source: &Source, diagnostics: &mut Diagnostics) -> Vec<Token> {
    if let Some(fault) = source.fault() {
        diagnostics.push(describe(fault));
        return vec![Token { kind: TokenKind::End, span: Span::default() }];
    }
    let mut lexer =
        Lexer { text: source.text(), at: 0, tokens: Vec::new(), depth: 0, foreign: HashSet::new(), diagnostics };
    lexer.run();
    lexer.tokens
}

fn describe(fault: Fault) -> Diagnostic {
    match fault {
        Fault::NotUtf8 { offset, byte } => {
            Diagnostic::error(Span::new(offset, offset), format!("the byte 0x{byte:02x} here is not UTF-8"))
                .help("save the file as UTF-8; names and units of a model are plain ASCII")
        }
        Fault::TooLong => Diagnostic::error(Span::default(), "the file is longer than 4 GiB: this is no model file"),
    }
}

struct Lexer<'a, 'd> {
    text: &'a str,
    at: usize,
    tokens: Vec<Token>,
    /// Parentheses that are open.
    depth: usize,
    /// Names with foreign letters, which are reported once.
    foreign: HashSet<&'a str>,
    diagnostics: &'d mut Diagnostics,
}

impl<'a> Lexer<'a, '_> {
    fn run(&mut self) {
        while let Some(c) = self.peek() {
            match c {
                ' ' | '\t' | '\r' | '\n' | '\u{c}' => self.at += 1,
                // A byte order mark is no character of the model.
                '\u{feff}' if self.at == 0 => self.at += c.len_utf8(),
                '/' if self.rest().starts_with("//") => self.skip_line(),
                '/' if self.rest().starts_with("/*") => self.block_comment(),
                '0'..='9' => self.number(),
                'a'..='z' | 'A'..='Z' | '_' => self.ident(),
                _ => self.symbol(c),
            }
        }
        let end = self.span(self.at);
        self.tokens.push(Token { kind: TokenKind::End, span: end });
    }

    fn rest(&self) -> &str {
        &self.text[self.at..]
    }

    fn peek(&self) -> Option<char> {
        self.rest().chars().next()
    }

    /// The span from `start` to here.
    fn span(&self, start: usize) -> Span {
        // `Source::new` has proven that offsets fit 32 bits.
        Span::new(start as u32, self.at as u32)
    }

    fn push(&mut self, kind: TokenKind, start: usize) {
        let span = self.span(start);
        self.tokens.push(Token { kind, span });
    }

    fn error(&mut self, start: usize, message: impl Into<String>, help: impl Into<String>) {
        let span = self.span(start);
        self.diagnostics.push(Diagnostic::error(span, message).help(help));
    }

    fn take_while(&mut self, keep: impl Fn(char) -> bool) {
        let rest = self.rest();
        self.at += rest.find(|c| !keep(c)).unwrap_or(rest.len());
    }

    fn skip_line(&mut self) {
        self.take_while(|c| c != '\n');
    }

    fn block_comment(&mut self) {
        let start = self.at;
        let rest = self.rest();
        self.at += rest.find("*/").map_or(rest.len(), |end| end + 2);
        let opening = Span::new(start as u32, start as u32 + 2);
        self.diagnostics.push(
            Diagnostic::error(opening, "comments are written with `//` only")
                .help("begin each line of the comment with `//`"),
        );
    }

    fn ident(&mut self) {
        let start = self.at;
        self.take_while(|c| c.is_ascii_alphanumeric() || c == '_');
        self.push(TokenKind::Ident, start);
    }

    /// Reads digits, an optional fraction and an optional exponent. A name that follows without a blank is a factor
    /// with its `*` missing.
    fn number(&mut self) {
        let start = self.at;
        self.take_while(|c| c.is_ascii_digit());
        if self.peek() == Some('.') {
            self.at += 1;
            self.take_while(|c| c.is_ascii_digit());
        }
        let mantissa = self.at;
        if matches!(self.peek(), Some('e' | 'E')) {
            self.at += 1;
            if matches!(self.peek(), Some('+' | '-')) {
                self.at += 1;
            }
            let digits = self.at;
            self.take_while(|c| c.is_ascii_digit());
            if self.at == digits {
                self.at = mantissa;
            }
        }
        self.push(TokenKind::Number, start);
        let behind = self.rest().strip_prefix(',').and_then(|rest| rest.chars().next());
        if self.depth == 0 && self.at == mantissa && behind.is_some_and(|c| c.is_ascii_digit()) {
            // Lists of numbers stand in parentheses.
            let comma = self.at;
            self.at += 1;
            self.take_while(|c| c.is_ascii_digit());
            let (whole, fraction) = (&self.text[start..comma], &self.text[comma + 1..self.at]);
            let help = format!("write `{whole}.{fraction}`");
            return self.error(start, "decimals are written with a point", help);
        }
        let suffix = self.at;
        self.take_while(|c| c.is_ascii_alphanumeric() || c == '_');
        if self.at > suffix {
            let (whole, name) = (&self.text[start..self.at], &self.text[suffix..self.at]);
            let number = &self.text[start..suffix];
            let message = format!("`{whole}` is neither a number nor a name: a `*` is missing");
            let help = if suffix > mantissa {
                format!(
                    "write `{number}*{name}`, or `{}*{}` for the name `{1}`",
                    &self.text[start..mantissa],
                    &self.text[mantissa..self.at]
                )
            } else {
                format!("write `{number}*{name}`")
            };
            self.error(start, message, help);
            self.tokens.push(Token { kind: TokenKind::Star, span: Span::new(suffix as u32, suffix as u32) });
            self.push(TokenKind::Ident, suffix);
        }
    }

    fn symbol(&mut self, c: char) {
        let start = self.at;
        self.at += c.len_utf8();
        let kind = match c {
            '+' => TokenKind::Plus,
            '-' => TokenKind::Minus,
            '*' if self.peek() == Some('*') => {
                self.at += 1;
                self.error(start, "`**` is no operator", "a power is written `^`, as in `x^2`");
                TokenKind::Caret
            }
            '*' => TokenKind::Star,
            '/' => TokenKind::Slash,
            '^' => TokenKind::Caret,
            '=' if self.peek() == Some('=') => {
                self.at += 1;
                self.error(start, "`==` is no operator", "an equation is written with one `=`");
                TokenKind::Equals
            }
            '=' => TokenKind::Equals,
            ',' => TokenKind::Comma,
            ';' => {
                self.depth = 0;
                TokenKind::Semicolon
            }
            '<' | '>' | '?' | '&' | '|' => return self.condition(start),
            ':' if self.in_condition() => return self.condition(start),
            '(' => {
                self.depth += 1;
                TokenKind::OpenParen
            }
            ')' => {
                self.depth = self.depth.saturating_sub(1);
                TokenKind::CloseParen
            }
            '[' => TokenKind::OpenBracket,
            ']' => TokenKind::CloseBracket,
            '{' => TokenKind::OpenBrace,
            '}' => TokenKind::CloseBrace,
            '·' | '×' | '⋅' | '∗' => return self.replaced(start, c, "*", TokenKind::Star),
            '−' | '–' | '—' => return self.replaced(start, c, "-", TokenKind::Minus),
            '÷' | '∕' => return self.replaced(start, c, "/", TokenKind::Slash),
            '\'' | '"' | '’' | '‘' | '′' | '″' | '‴' | '´' | '`' | '“' | '”' => {
                return self.prime(start);
            }
            '°' => {
                return self.error(
                    start,
                    "the degree sign is not part of the language",
                    "angles are in rad: 30 degrees are `30*pi/180`; the unit is called `deg`",
                );
            }
            '²' | '³' | '¹' | '⁰' | '⁴'..='⁹' => return self.superscript(start, c),
            '.' => {
                let help = match self.peek() {
                    Some('0'..='9') => "write a digit before the point, as in `0.5`",
                    _ => "the point only occurs inside numbers; a product is written `*`",
                };
                return self.error(start, "a number does not begin with a point", help);
            }
            '\0' => {
                self.take_while(|c| c == '\0');
                return self.error(start, "a NUL character", "this is no text file, or it is not saved as UTF-8");
            }
            c if c.is_alphabetic() => return self.foreign_name(start),
            _ => return self.unknown(start),
        };
        self.push(kind, start);
    }

    fn replaced(&mut self, start: usize, found: char, wanted: &str, kind: TokenKind) {
        self.error(
            start,
            format!("`{found}` is not the operator `{wanted}`"),
            format!("write the ASCII character `{wanted}`"),
        );
        self.push(kind, start);
    }

    /// Reads `x'`, `x''` or `x’’`, the notation of derivatives in books.
    fn prime(&mut self, start: usize) {
        self.take_while(is_prime);
        let order: usize = self.text[start..self.at]
            .chars()
            .map(|c| match c {
                '"' | '″' | '“' | '”' => 2,
                '‴' => 3,
                _ => 1,
            })
            .sum();
        let before =
            self.tokens.last().filter(|token| token.kind == TokenKind::Ident && token.span.end as usize == start);
        let (from, name) = match before {
            Some(token) => (token.span.start as usize, &self.text[token.span.range()]),
            None => (start, "x"),
        };
        let help = match order {
            1 => format!("a time derivative is written `dot({name})`"),
            2 => format!("a second time derivative is written `ddot({name})`"),
            n => format!("a time derivative of order {n} is written `der({name}, {n})`"),
        };
        self.error(from, "a prime is not part of the language", help);
    }

    fn superscript(&mut self, start: usize, c: char) {
        let digit = match c {
            '¹' => 1,
            '²' => 2,
            '³' => 3,
            '⁰' => 0,
            // The superscripts four to nine are consecutive in Unicode.
            c => (c as u32 - '⁴' as u32 + 4) as u8,
        };
        self.error(start, format!("`{c}` is not part of the language"), format!("a power is written `^{digit}`"));
        self.push(TokenKind::Superscript(digit), start);
    }

    /// Whether the statement up to here has a condition.
    fn in_condition(&self) -> bool {
        let mut statement = self.tokens.iter().rev().take_while(|token| token.kind != TokenKind::Semicolon);
        statement.any(|token| token.kind == TokenKind::Condition)
    }

    /// Reads a condition, which the language has not: the statement with it is passed over by the parser, and reported once.
    fn condition(&mut self, start: usize) {
        self.take_while(|c| "<>=?&|!:".contains(c));
        if !self.in_condition() {
            let message = format!("`{}`: there are no conditions in a model", &self.text[start..self.at]);
            self.error(
                start,
                message,
                "write what depends on a direction with `sign(...)`, as c*sign(dot(x)); what acts on one side only with `abs(...)`: \
                 (x + abs(x))/2 is x where x is positive, else 0",
            );
        }
        self.push(TokenKind::Condition, start);
    }

    /// Reads a name with letters beyond ASCII. It counts as a name, so that only its uses are reported.
    fn foreign_name(&mut self, start: usize) {
        self.take_while(|c| c.is_alphanumeric() || c == '_');
        let text: &'a str = self.text;
        let name = &text[start..self.at];
        if !self.foreign.insert(name) {
            return self.push(TokenKind::Ident, start);
        }
        let written: Option<String> = name
            .chars()
            .map(|c| if c.is_ascii() { Some(c.to_string()) } else { greek(c).map(str::to_owned) })
            .collect();
        let help = match written {
            Some(written) => format!("write `{written}`"),
            None => "write it in ASCII".to_owned(),
        };
        let message = format!("`{}`: names are made of ASCII letters, digits and `_`, here and below", shorten(name));
        self.error(start, message, help);
        self.push(TokenKind::Ident, start);
    }

    /// Skips a run of characters without a meaning, and reports it once.
    fn unknown(&mut self, start: usize) {
        self.take_while(|c| {
            !c.is_whitespace() && !c.is_alphanumeric() && !"+-*/^=,;()[]{}_'<>?&|".contains(c) && c != '\u{0}'
        });
        if self.text[start..self.at].chars().all(char::is_whitespace) {
            return self.error(start, "a blank that is not a plain space", "replace it by a space");
        }
        let message =
            format!("`{}` is not part of the language", shorten(&self.text[start..self.at].escape_debug().to_string()));
        self.error(start, message, "remove it; comments begin with `//`");
    }
}

fn is_prime(c: char) -> bool {
    matches!(c, '\'' | '"' | '’' | '‘' | '′' | '″' | '‴' | '´' | '`' | '“' | '”')
}

/// At most forty characters of a text, for messages.
pub(crate) fn shorten(text: &str) -> String {
    match text.char_indices().nth(40) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

/// The usual ASCII spelling of a Greek letter.
fn greek(c: char) -> Option<&'static str> {
    Some(match c {
        'α' => "alpha",
        'β' => "beta",
        'γ' => "gamma",
        'δ' => "delta",
        'ε' => "epsilon",
        'ζ' => "zeta",
        'η' => "eta",
        'θ' | 'ϑ' => "theta",
        'κ' => "kappa",
        'λ' => "lambda",
        'μ' | 'µ' => "mu",
        'ν' => "nu",
        'ξ' => "xi",
        'π' => "pi",
        'ρ' => "rho",
        'σ' => "sigma",
        'τ' => "tau",
        'φ' | 'ϕ' => "phi",
        'χ' => "chi",
        'ψ' => "psi",
        'ω' => "w",
        'Ω' => "ohm",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(text: &str) -> (Vec<TokenKind>, Vec<String>) {
        let mut diagnostics = Diagnostics::new();
        let tokens = lex(&Source::new("t", text), &mut diagnostics);
        (tokens.iter().map(|token| token.kind).collect(), diagnostics.iter().map(Diagnostic::headline).collect())
    }

    #[test]
    fn a_slip_gives_one_message_and_the_tokens_that_were_meant() {
        use TokenKind::{Caret, End, Equals, Ident, Minus, Number, Star, Superscript};
        for (text, tokens, part) in [
            ("3w", vec![Number, Star, Ident, End], "write `3*w`"),
            ("2f1", vec![Number, Star, Ident, End], "write `2*f1`"),
            ("2e", vec![Number, Star, Ident, End], "write `2*e`"),
            ("2e3x", vec![Number, Star, Ident, End], "write `2e3*x`, or `2*e3x` for the name `e3x`"),
            ("x**2", vec![Ident, Caret, Number, End], "`^`"),
            ("x==2", vec![Ident, Equals, Number, End], "one `=`"),
            ("x''", vec![Ident, End], "`ddot(x)`"),
            ("x’", vec![Ident, End], "`dot(x)`"),
            ("x″′", vec![Ident, End], "`der(x, 3)`"),
            ("x²", vec![Ident, Superscript(2), End], "`^2`"),
            ("x⁷", vec![Ident, Superscript(7), End], "`^7`"),
            ("a−b", vec![Ident, Minus, Ident, End], "ASCII"),
            ("30°", vec![Number, End], "30*pi/180"),
            ("λ", vec![Ident, End], "`lambda`"),
            (".5", vec![Number, End], "`0.5`"),
            ("/* a */ x", vec![Ident, End], "`//`"),
        ] {
            let (found, messages) = kinds(text);
            assert_eq!(found, tokens, "{text}");
            assert_eq!(messages.len(), 1, "{text}: {messages:?}");
            assert!(messages[0].contains(part), "{text}: {messages:?}");
        }
    }

    #[test]
    fn numbers_names_and_comments_are_silent() {
        use TokenKind::{End, Ident, Number, Star};
        let (found, messages) = kinds("\u{feff}1 0.5 1e-3 2.5E+4 // λ ' \" ²\n x_1*type");
        assert_eq!(found, vec![Number, Number, Number, Number, Ident, Star, Ident, End]);
        assert!(messages.is_empty());
    }

    #[test]
    fn garbage_is_reported_up_to_a_bound() {
        let text: String = (0..200_000_u32).map(|i| char::from((i.wrapping_mul(2_654_435_761) >> 24) as u8)).collect();
        let mut diagnostics = Diagnostics::new();
        let _ = lex(&Source::new("t", text), &mut diagnostics);
        assert!(diagnostics.omitted() > 0);
        assert_eq!(diagnostics.iter().count(), crate::diagnostic::MOST_KEPT);
    }
}
