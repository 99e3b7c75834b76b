//! The tokens of a macro call as a source.
//!
//! Invariant: the text holds every leaf token of the stream once, in order, and `places` holds for each of them its
//! first byte in the text and the compiler's span. One lexer and one parser thus serve files and macros, and the byte
//! range of a diagnostic is converted to the user's tokens. Line ends follow the user's where the compiler gives them,
//! because a missing semicolon is recognised by the line end.

use proc_macro2::{Delimiter, Group, Ident, Literal, Punct, Spacing, TokenStream, TokenTree};

use crate::diagnostic::{Diagnostic, Diagnostics, Severity};
use crate::source::{Source, Span};

/// A source that was written from tokens, with the span of each token.
#[derive(Clone, Debug)]
pub struct TokenSource {
    source: Source,
    places: Vec<(u32, proc_macro2::Span)>,
    call_site: proc_macro2::Span,
}

impl TokenSource {
    /// Writes the tokens of a macro's input as a text; `name` is the macro's name in messages. Doc comments, which the
    /// compiler passes as attributes, become comments again.
    #[must_use]
    pub fn new(name: &str, stream: TokenStream) -> Self {
        let mut writer = Writer { text: String::new(), places: Vec::new(), line: 0, joint: true };
        writer.stream(stream);
        Self {
            source: Source::new(name, writer.text),
            places: writer.places,
            call_site: proc_macro2::Span::call_site(),
        }
    }

    /// The text of the tokens.
    #[must_use]
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// The compiler's spans of the first and the last token of a place.
    #[must_use]
    pub fn tokens_at(&self, span: Span) -> (proc_macro2::Span, proc_macro2::Span) {
        let at = |offset: u32| {
            let index = self.places.partition_point(|&(start, _)| start <= offset);
            self.places.get(index.saturating_sub(1)).map_or(self.call_site, |&(_, span)| span)
        };
        (at(span.start), at(span.end.max(span.start + 1) - 1))
    }

    /// The diagnostics as `compile_error!` items on the user's tokens. Warnings are left out: stable Rust gives a macro no way
    /// to warn.
    #[must_use]
    pub fn compile_errors(&self, diagnostics: &Diagnostics) -> TokenStream {
        let mut stream: TokenStream = diagnostics
            .iter()
            .filter(|diagnostic| diagnostic.severity == Severity::Error)
            .map(|diagnostic| self.compile_error(diagnostic))
            .collect();
        if diagnostics.omitted() > 0 {
            let message = format!("and {} more", diagnostics.omitted());
            stream.extend(compile_error(self.call_site, self.call_site, &message));
        }
        stream
    }

    fn compile_error(&self, diagnostic: &Diagnostic) -> TokenStream {
        let (first, last) = self.tokens_at(diagnostic.span);
        compile_error(first, last, &diagnostic.headline())
    }
}

/// A `compile_error!` item whose message the compiler shows from the token `first` to the token `last`.
#[must_use]
pub fn compile_error(first: proc_macro2::Span, last: proc_macro2::Span, message: &str) -> TokenStream {
    let mut literal = Literal::string(message);
    literal.set_span(last);
    let mut group = Group::new(Delimiter::Brace, TokenTree::from(literal).into());
    group.set_span(last);
    let punct = |c: char, spacing: Spacing| {
        let mut punct = Punct::new(c, spacing);
        punct.set_span(first);
        TokenTree::from(punct)
    };
    [
        punct(':', Spacing::Joint),
        punct(':', Spacing::Alone),
        Ident::new("core", first).into(),
        punct(':', Spacing::Joint),
        punct(':', Spacing::Alone),
        Ident::new("compile_error", first).into(),
        punct('!', Spacing::Alone),
        group.into(),
    ]
    .into_iter()
    .collect()
}

struct Writer {
    text: String,
    places: Vec<(u32, proc_macro2::Span)>,
    line: usize,
    joint: bool,
}

impl Writer {
    fn stream(&mut self, stream: TokenStream) {
        let mut tokens = stream.into_iter().peekable();
        while let Some(token) = tokens.next() {
            match token {
                TokenTree::Punct(punct) if punct.as_char() == '#' => {
                    match tokens.next_if(|next| matches!(next, TokenTree::Group(group) if is_doc(group))) {
                        Some(_) => {}
                        None => self.leaf(&punct.to_string(), punct.span(), false),
                    }
                }
                TokenTree::Punct(punct) => {
                    let joint = punct.spacing() == Spacing::Joint;
                    self.leaf(punct.as_char().encode_utf8(&mut [0; 4]), punct.span(), joint);
                }
                TokenTree::Ident(ident) => {
                    let name = ident.to_string();
                    self.leaf(name.strip_prefix("r#").unwrap_or(&name), ident.span(), false);
                }
                TokenTree::Literal(literal) => self.leaf(&literal.to_string(), literal.span(), false),
                TokenTree::Group(group) => self.group(&group),
            }
        }
    }

    fn group(&mut self, group: &Group) {
        let (open, close) = match group.delimiter() {
            Delimiter::Parenthesis => ("(", ")"),
            Delimiter::Bracket => ("[", "]"),
            Delimiter::Brace => ("{", "}"),
            // A `macro_rules` fragment is passed in an invisible group, which needs parentheses unless it has a single
            // leaf.
            Delimiter::None if group.stream().into_iter().nth(1).is_none() => ("", ""),
            Delimiter::None => ("(", ")"),
        };
        if !open.is_empty() {
            self.leaf(open, group.span_open(), false);
        }
        self.stream(group.stream());
        if !close.is_empty() {
            self.leaf(close, group.span_close(), false);
        }
    }

    fn leaf(&mut self, text: &str, span: proc_macro2::Span, joint: bool) {
        let line = span.start().line;
        if !self.joint {
            self.text.push(if line > self.line && self.line > 0 { '\n' } else { ' ' });
        }
        self.line = line.max(self.line);
        self.joint = joint;
        // `Source::new` refuses a text beyond 4 GiB, so no place in such a text is ever requested.
        self.places.push((self.text.len() as u32, span));
        self.text.push_str(text);
    }
}

fn is_doc(group: &Group) -> bool {
    group.delimiter() == Delimiter::Bracket
        && matches!(group.stream().into_iter().next(), Some(TokenTree::Ident(ident)) if ident == "doc")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_leads_back_to_its_tokens() {
        let stream: TokenStream = "model A {\n  /// words\n  k**2 == r#type*ddot(x);\n}".parse().expect("tokens");
        let tokens = TokenSource::new("model!", stream);
        assert_eq!(tokens.source().text(), "model A {\nk ** 2 == type * ddot ( x ) ;\n}");
        let start = tokens.source().text().find("type").expect("type") as u32;
        let (first, last) = tokens.tokens_at(Span::new(start, start + 8));
        assert_eq!((first.start().line, first.start().column), (3, 10));
        assert_eq!((last.start().line, last.start().column), (3, 17));
    }
}
