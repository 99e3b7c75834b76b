//! Tokens of the model language.
//!
//! Invariant: the sequence ends with exactly one [`TokenKind::End`], its spans do not overlap and are in order. Tokens carry no
//! text: it is read from the source by the span, so a token is twelve bytes and lexing allocates nothing per token.

use crate::source::Span;

/// Kind of a token.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum TokenKind {
    /// A name or a keyword; which of them is the parser's choice, because keywords are contextual.
    Ident,
    /// An unsigned decimal number, `12`, `0.5`, `1e-3`.
    Number,
    /// `^2` written as a superscript digit. It is already reported, and read as the exponent so that no further fault
    /// follows.
    Superscript(u8),
    /// `+`
    Plus,
    /// `-`
    Minus,
    /// `*`
    Star,
    /// `/`
    Slash,
    /// `^`
    Caret,
    /// `=`
    Equals,
    /// `,`
    Comma,
    /// `;`
    Semicolon,
    /// `(`
    OpenParen,
    /// `)`
    CloseParen,
    /// `[`
    OpenBracket,
    /// `]`
    CloseBracket,
    /// `{`
    OpenBrace,
    /// `}`
    CloseBrace,
    /// `<`, `?` and others of conditions, which are reported and have no meaning.
    Condition,
    /// The end of the text.
    End,
}

impl TokenKind {
    /// The name of this token in a message that expects it.
    pub(crate) fn describe(self) -> &'static str {
        match self {
            Self::Ident => "a name",
            Self::Number => "a number",
            Self::Superscript(_) => "an exponent",
            Self::Plus => "`+`",
            Self::Minus => "`-`",
            Self::Star => "`*`",
            Self::Slash => "`/`",
            Self::Caret => "`^`",
            Self::Equals => "`=`",
            Self::Comma => "`,`",
            Self::Semicolon => "`;`",
            Self::OpenParen => "`(`",
            Self::CloseParen => "`)`",
            Self::OpenBracket => "`[`",
            Self::CloseBracket => "`]`",
            Self::OpenBrace => "`{`",
            Self::CloseBrace => "`}`",
            Self::Condition => "a condition",
            Self::End => "the end of the text",
        }
    }
}

/// A token and its place.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Token {
    pub(crate) kind: TokenKind,
    pub(crate) span: Span,
}
