//! Formatting of the text of a model.
//!
//! Only blanks, line ends and empty statements change: the tokens are the lexer's, and the comments are the text
//! between them. Statements are placed one to a line, indented by the braces around them; a block that was written on
//! one line stays there where it fits. Inside a statement the author's lines are kept, since no rule knows which terms
//! of an equation belong together; only lines that are too wide are broken. Comments behind adjacent lines are aligned.
//!
//! Invariant: formatting a formatted text changes nothing.

use crate::diagnostic::Diagnostics;
use crate::language::ast::{Role, UNMEASURED};
use crate::language::keywords::clauses_of;
use crate::language::lex::lex;
use crate::language::parse;
use crate::language::token::{Token, TokenKind};
use crate::source::{Source, Span};

/// Maximal width of code, in characters.
const WIDTH: usize = 120;

/// Indentation by one brace, in characters.
const INDENT: usize = 4;

/// Column, counted from 0, of comments behind code; most declarations end before it.
const COMMENTS: usize = 53;

/// Width, in characters, beyond which a comment moves left as far as its code permits.
const WIDEST: usize = 140;

/// Formats the text of a model.
///
/// # Errors
/// Every syntax fault of the text. Names and units are not checked, so that an unfinished model can be formatted too.
pub fn format(source: &Source) -> Result<String, Diagnostics> {
    let mut diagnostics = Diagnostics::new();
    let syntax = parse::parse(source, &mut diagnostics);
    diagnostics.sort();
    if syntax.model.is_none() || diagnostics.has_errors() {
        return Err(diagnostics);
    }
    let pieces = pieces(source, &lex(source, &mut diagnostics));
    let mut page = Page { lines: Vec::new(), begun: true, comment_column: None };
    let (mut at, mut depth) = (0, 0_usize);
    while let Some(piece) = pieces.get(at) {
        match piece.kind {
            None => page.comment(piece, depth * INDENT),
            Some(TokenKind::CloseBrace) => {
                depth = depth.saturating_sub(1);
                page.push(Line::new(depth * INDENT, piece.text));
            }
            Some(_) => {
                let statement = statement(&pieces, at, depth);
                page.statement(statement, depth * INDENT);
                at += statement.len();
                if statement.last().is_some_and(|last| last.kind == Some(TokenKind::OpenBrace)) {
                    depth += 1;
                    page.begun = true;
                }
                continue;
            }
        }
        at += 1;
    }
    let end = if source.text().contains("\r\n") { "\r\n" } else { "\n" };
    Ok(page.text(end))
}

/// A token, or a comment between two tokens, with its context.
struct Piece<'a> {
    /// The token; `None` for a comment.
    kind: Option<TokenKind>,
    text: &'a str,
    /// Number of line ends between the previous piece and this one.
    breaks: usize,
    /// The column of a comment in the text, from 0.
    column: usize,
    /// Whether a blank precedes it on the same line.
    spaced: bool,
    /// Number of open parentheses and brackets before it.
    nesting: usize,
    /// Whether a line inside a statement may begin with it.
    may_begin: bool,
    /// Whether a line begins with it, if it is not the first piece of a statement.
    begins: bool,
}

/// The pieces of a text that has no faults, without its empty statements.
fn pieces<'a>(source: &'a Source, tokens: &[Token]) -> Vec<Piece<'a>> {
    let mut pieces: Vec<Piece<'a>> = Vec::new();
    let mut context = Context::default();
    let (mut end, mut breaks) = (0, 0);
    for (index, &token) in tokens.iter().enumerate() {
        let mut offset = end as usize;
        for (line_index, line) in source.slice(Span::new(end, token.span.start)).split('\n').enumerate() {
            breaks += usize::from(line_index > 0);
            if let Some(at) = line.find("//") {
                pieces.push(Piece {
                    kind: None,
                    text: line[at..].trim_end(),
                    breaks,
                    column: column(source, offset + at),
                    spaced: true,
                    nesting: 0,
                    may_begin: false,
                    begins: breaks > 0,
                });
                breaks = 0;
            }
            offset += line.len() + 1;
        }
        end = token.span.end;
        if token.kind == TokenKind::End || (token.kind == TokenKind::Semicolon && context.begins_statement()) {
            continue;
        }
        let next = tokens.get(index + 1).map_or(TokenKind::End, |next| next.kind);
        let (mut piece, may_end) = context.piece(token.kind, source.slice(token.span), next);
        piece.breaks = breaks;
        piece.begins &= breaks > 0;
        match pieces.last_mut() {
            // A comment extends to the end of its line, so the next piece begins a line.
            Some(before) if before.kind.is_none() => piece.begins = true,
            // A line may begin with an operator but not end with one.
            Some(before) if breaks > 0 && !may_end => before.begins = true,
            _ => {}
        }
        pieces.push(piece);
        breaks = 0;
    }
    pieces
}

/// The column of an offset, from 0.
fn column(source: &Source, offset: usize) -> usize {
    let before = source.text().get(..offset).unwrap_or_default();
    before.rsplit('\n').next().unwrap_or_default().chars().count()
}

/// Context of a token: the text before it.
#[derive(Default)]
struct Context<'a> {
    /// The open parentheses and brackets.
    open: Vec<TokenKind>,
    /// The previous token.
    before: Option<TokenKind>,
    /// Whether the previous token is a unary sign, or a word before an operand.
    wants_operand: bool,
    /// The first word of a statement that begins with a keyword.
    statement: &'a str,
}

impl<'a> Context<'a> {
    fn begins_statement(&self) -> bool {
        use TokenKind::{CloseBrace, OpenBrace, Semicolon};
        self.before.is_none_or(|kind| matches!(kind, Semicolon | OpenBrace | CloseBrace))
    }

    /// The piece of the next token, and whether a line may end before it, which is not the case after an operator.
    fn piece(&mut self, kind: TokenKind, text: &'a str, next: TokenKind) -> (Piece<'a>, bool) {
        use TokenKind::{
            Caret, CloseBrace, CloseBracket, CloseParen, Comma, Ident, Minus, Number, OpenBrace, OpenBracket,
            OpenParen, Plus, Semicolon, Slash, Star, Superscript,
        };
        let first = self.begins_statement();
        if first {
            // Two successive names form no expression, so the first is a keyword; the value of `gravity` and the multiple by which a
            // joint moves follow it directly.
            let is_followed = match text {
                "gravity" => next == OpenParen,
                "revolute" | "prismatic" => matches!(next, Minus | Number | OpenParen),
                _ => false,
            };
            let is_keyword = kind == Ident && (next == Ident || is_followed);
            self.statement = if is_keyword { text } else { "" };
        }
        let (before, nesting) = (self.before, self.open.len());
        let in_unit = self.open.contains(&OpenBracket);
        let is_clause = kind == Ident && nesting == 0 && clauses_of(self.statement).contains(&text);
        let behind_operand =
            !self.wants_operand && matches!(before, Some(Number | Ident | CloseParen | CloseBracket | Superscript(_)));
        let behind_sign = self.wants_operand && matches!(before, Some(Plus | Minus));
        let is_sign = matches!(kind, Plus | Minus);
        let is_factor = |kind: Option<TokenKind>| matches!(kind, Some(Star | Slash | Caret));
        let spaced = match (before, kind) {
            _ if in_unit || behind_sign || is_factor(before) || is_factor(Some(kind)) => false,
            (None | Some(OpenParen | OpenBracket), _) | (_, Semicolon | Comma | CloseParen | CloseBracket) => false,
            (Some(OpenBrace), CloseBrace) => false,
            (Some(Ident), OpenParen) => self.wants_operand,
            _ => true,
        };
        let is_binary = is_sign && behind_operand;
        let may_begin = is_binary || before == Some(Comma) || (is_clause && !first);
        let ends_in_operator = !in_unit
            && (matches!(before, Some(Star | Slash)) || (!behind_sign && matches!(before, Some(Plus | Minus))));
        // The head of a block is short, and stays on one line.
        let opens_block = kind == OpenBrace || matches!(self.statement, "model" | "pattern" | "body");
        let begins = match kind {
            _ if opens_block => false,
            Star | Slash => !in_unit,
            _ => spaced && !ends_in_operator,
        };
        let is_joint = first && matches!(self.statement, "revolute" | "prismatic");
        self.wants_operand = (is_sign && !behind_operand) || is_clause || is_joint;
        match kind {
            OpenParen | OpenBracket => self.open.push(kind),
            CloseParen | CloseBracket => drop(self.open.pop()),
            _ => {}
        }
        self.before = Some(kind);
        let piece = Piece { kind: Some(kind), text, breaks: 0, column: 0, spaced, nesting, may_begin, begins };
        (piece, !ends_in_operator)
    }
}

/// The pieces of the statement that begins at `at`: up to its semicolon, to the brace that it opens, or to the end of
/// its block where the block is written on one line.
fn statement<'p, 'a>(pieces: &'p [Piece<'a>], at: usize, depth: usize) -> &'p [Piece<'a>] {
    let rest = &pieces[at..];
    let ends = |piece: &Piece<'_>| matches!(piece.kind, Some(TokenKind::Semicolon | TokenKind::OpenBrace));
    let end = rest.iter().position(ends).map_or(rest.len(), |last| last + 1);
    // A whole model is never kept on one line.
    if depth == 0 || rest[end - 1].kind != Some(TokenKind::OpenBrace) {
        return &rest[..end];
    }
    let closes = |piece: &Piece<'_>| piece.kind == Some(TokenKind::CloseBrace);
    let Some(close) = rest[end..].iter().position(closes).map(|inside| end + inside) else { return &rest[..end] };
    let is_plain = |piece: &Piece<'_>| piece.breaks == 0 && !matches!(piece.kind, None | Some(TokenKind::OpenBrace));
    let width: usize = rest[..=close].iter().map(|piece| usize::from(piece.spaced) + piece.text.len()).sum();
    let on_one_line = rest[end..=close].iter().all(is_plain)
        && rest[1..end].iter().all(|piece| !piece.begins)
        && depth * INDENT + width <= WIDTH + 1;
    &rest[..if on_one_line { close + 1 } else { end }]
}

/// A formatted line.
struct Line<'a> {
    /// Whether an empty line precedes it.
    blank: bool,
    indent: usize,
    code: String,
    /// The comment behind the code; without code, it continues the comment of the previous line.
    comment: Option<&'a str>,
}

impl Line<'_> {
    fn new(indent: usize, code: &str) -> Self {
        Self { blank: false, indent, code: code.to_owned(), comment: None }
    }

    /// Width in characters.
    fn width(&self) -> usize {
        if self.code.is_empty() { 0 } else { self.indent + self.code.chars().count() }
    }
}

/// The formatted lines so far.
struct Page<'a> {
    lines: Vec<Line<'a>>,
    /// Whether the current block is still empty, so that no empty line is kept at its beginning.
    begun: bool,
    /// Column in the source text of the comment behind the last line's code, if there is one.
    comment_column: Option<usize>,
}

impl<'a> Page<'a> {
    fn push(&mut self, line: Line<'a>) {
        self.lines.push(line);
        self.begun = false;
        self.comment_column = None;
    }

    /// Whether an empty line before a piece is kept.
    fn blank(&self, piece: &Piece<'_>) -> bool {
        piece.breaks > 1 && !self.begun
    }

    /// Adds a comment between statements.
    fn comment(&mut self, piece: &Piece<'a>, indent: usize) {
        let blank = self.blank(piece);
        let goes_on = piece.breaks == 1 && self.comment_column == Some(piece.column);
        match self.lines.last_mut() {
            Some(last) if piece.breaks == 0 && last.comment.is_none() => {
                last.comment = Some(piece.text);
                self.comment_column = Some(piece.column);
            }
            Some(_) if goes_on => {
                self.lines.push(Line { blank: false, indent: 0, code: String::new(), comment: Some(piece.text) });
            }
            _ => self.push(Line { blank, ..Line::new(indent, piece.text) }),
        }
    }

    /// Adds a statement, or the head of one that has a block.
    fn statement(&mut self, pieces: &[Piece<'a>], indent: usize) {
        let Some(first) = pieces.first() else { return };
        let mut line = Line { blank: self.blank(first), ..Line::new(indent, "") };
        // Columns at which lines inside the open brackets begin, and those of lines behind the equals sign of the first
        // line.
        let mut brackets: Vec<usize> = Vec::new();
        let mut equals: Option<usize> = None;
        // The names of a declaration are aligned.
        let below = match pieces {
            [word, name, ..] if name.kind == Some(TokenKind::Ident) && declares(word.text) => word.text.len() + 1,
            _ => INDENT,
        };
        let mut is_first_line = true;
        let mut next_break = wide(pieces, 0, indent);
        for (index, piece) in pieces.iter().enumerate() {
            let is_operator = matches!(piece.kind, Some(TokenKind::Plus | TokenKind::Minus));
            let inside = match (brackets.last(), equals) {
                (Some(&column), _) if column <= WIDTH / 2 => column,
                (Some(_), _) => indent + 2 * INDENT,
                (None, Some(column)) if is_operator => column,
                (None, Some(column)) => column + 2,
                (None, None) => indent + below,
            };
            let Some(kind) = piece.kind else {
                if piece.begins {
                    if !line.code.is_empty() {
                        self.push(std::mem::replace(&mut line, Line::new(inside, "")));
                    }
                    self.push(Line::new(inside, piece.text));
                } else {
                    line.comment = Some(piece.text);
                    self.push(std::mem::replace(&mut line, Line::new(inside, "")));
                    self.comment_column = Some(piece.column);
                }
                is_first_line = false;
                continue;
            };
            if index > 0 && (piece.begins || next_break == Some(index)) {
                if !line.code.is_empty() {
                    self.push(std::mem::replace(&mut line, Line::new(inside, "")));
                }
                line.indent = inside;
                is_first_line = false;
                next_break = wide(pieces, index, inside);
            } else if index > 0 && piece.spaced {
                line.code.push(' ');
            }
            let column = line.width().max(line.indent);
            line.code.push_str(piece.text);
            match kind {
                TokenKind::OpenParen | TokenKind::OpenBracket => brackets.push(column + 1),
                TokenKind::CloseParen | TokenKind::CloseBracket => drop(brackets.pop()),
                TokenKind::Equals if is_first_line && column <= WIDTH / 2 => equals = Some(column),
                TokenKind::Comma if brackets.is_empty() => equals = None,
                _ => {}
            }
        }
        self.push(line);
    }

    fn text(&self, end: &str) -> String {
        let mut text = String::new();
        let mut at = 0;
        while at < self.lines.len() {
            let group = self.lines[at..]
                .iter()
                .enumerate()
                .take_while(|(index, line)| line.comment.is_some() && (*index == 0 || !line.blank))
                .count();
            let lines = &self.lines[at..at + group.max(1)];
            let code = lines.iter().map(Line::width).max().unwrap_or_default() + 2;
            let widest = lines.iter().filter_map(|line| line.comment).map(|own| own.chars().count()).max();
            let column =
                if COMMENTS.max(code) + widest.unwrap_or_default() > WIDEST { code } else { COMMENTS.max(code) };
            for line in lines {
                if line.blank {
                    text.push_str(end);
                }
                if !line.code.is_empty() {
                    text.extend(std::iter::repeat_n(' ', line.indent));
                    text.push_str(&line.code);
                }
                if let Some(comment) = line.comment {
                    text.extend(std::iter::repeat_n(' ', column - line.width()));
                    text.push_str(comment);
                }
                text.push_str(end);
            }
            at += lines.len();
        }
        text
    }
}

/// Whether a word before a name declares a list of quantities.
fn declares(word: &str) -> bool {
    let roles = [Role::Coordinate, Role::Input, Role::Parameter, Role::Constant, Role::Amplitude, Role::Frequency];
    roles.iter().any(|role| role.keyword() == word) || word == UNMEASURED
}

/// The piece at which to break a line that begins with piece `from` at a column and is too wide: of the pieces that fit
/// before it the one of least nesting, and among these the last; nothing when the line fits.
fn wide(pieces: &[Piece<'_>], from: usize, column: usize) -> Option<usize> {
    let mut width = column;
    let mut best: Option<(usize, usize)> = None;
    for (index, piece) in pieces.iter().enumerate().skip(from) {
        if index > from {
            if piece.begins || piece.kind.is_none() {
                return None;
            }
            if piece.may_begin && (width <= WIDTH || best.is_none()) {
                best = match best {
                    Some((nesting, found)) if nesting < piece.nesting => Some((nesting, found)),
                    _ => Some((piece.nesting, index)),
                };
            }
            width += usize::from(piece.spaced);
        }
        width += piece.text.len();
        if width > WIDTH && best.is_some() {
            return best.map(|(_, found)| found);
        }
    }
    None
}
