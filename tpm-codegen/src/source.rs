//! Source texts and places in them.
//!
//! Invariant: a [`Span`] is a half-open byte range of the text of exactly one [`Source`], on character boundaries.
//! Spans have the same meaning for files and macros: the tokens of a macro are first written as a text (see
//! [`crate::language::stream`]), so that all stages after the lexer work on text only.

/// A half-open byte range `start..end` of a [`Source`]'s text.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default, PartialOrd, Ord)]
pub struct Span {
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
}

impl Span {
    /// The bytes `start..end`.
    #[must_use]
    pub fn new(start: u32, end: u32) -> Self {
        Self { start, end }
    }

    /// The smallest span that contains both.
    ///
    /// ```
    /// # use tpm_codegen::source::{Source, Span};
    /// assert_eq!(Span::new(5, 7).to(Span::new(1, 2)), Span::new(1, 7));
    /// ```
    #[must_use]
    pub fn to(self, other: Self) -> Self {
        Self { start: self.start.min(other.start), end: self.end.max(other.end) }
    }

    /// The empty span at the end of this one.
    ///
    /// ```
    /// # use tpm_codegen::source::{Source, Span};
    /// assert_eq!(Span::new(1, 7).after(), Span::new(7, 7));
    /// ```
    #[must_use]
    pub fn after(self) -> Self {
        Self { start: self.end, end: self.end }
    }

    /// As a range of byte offsets.
    #[must_use]
    pub fn range(self) -> std::ops::Range<usize> {
        self.start as usize..self.end as usize
    }
}

/// A line and a column, both counted from 1; columns count characters.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Position {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
}

/// Why bytes are not a text.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Fault {
    /// The byte at the end of the valid part.
    NotUtf8 { offset: u32, byte: u8 },
    /// More bytes than a span can address.
    TooLong,
}

/// A named text: a model file or the tokens of a macro call.
#[derive(Clone, Debug)]
pub struct Source {
    name: String,
    text: String,
    fault: Option<Fault>,
    /// The files of which the text is made, where it is made of several; none for a text of one file.
    files: Vec<Source>,
    pieces: Vec<Piece>,
}

/// A part of a text that is made of several files.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// Where the part begins in the whole text.
    start: u32,
    /// The file that it comes from, and where it begins there.
    file: usize,
    at: u32,
}

impl Source {
    /// A text with the name that diagnostics show (a file's path or a macro's name).
    #[must_use]
    pub fn new(name: impl Into<String>, text: impl Into<String>) -> Self {
        let (name, text) = (name.into(), text.into());
        if u32::try_from(text.len()).is_err() {
            return Self {
                name,
                text: String::new(),
                fault: Some(Fault::TooLong),
                files: Vec::new(),
                pieces: Vec::new(),
            };
        }
        Self { name, text, fault: None, files: Vec::new(), pieces: Vec::new() }
    }

    /// A text that is made of parts of files, named as the first file: each part with the index of its file. Places are shown in the file
    /// that they come from.
    #[cfg(feature = "import")]
    pub(crate) fn of_parts(files: Vec<Source>, parts: &[(usize, std::ops::Range<usize>)]) -> Self {
        let name = files.first().map_or_else(String::new, |file| file.name.clone());
        let (mut text, mut pieces) = (String::new(), Vec::new());
        for (file, range) in parts {
            // The length of the whole is tested below, those of the files were.
            pieces.push(Piece { start: text.len() as u32, file: *file, at: range.start as u32 });
            text.push_str(&files[*file].text[range.clone()]);
        }
        Self { files, pieces, ..Self::new(name, text) }
    }

    /// The file that a span comes from, and the span there; nothing for a text of one file.
    pub(crate) fn located(&self, span: Span) -> Option<(&Source, Span)> {
        let index = self.pieces.partition_point(|piece| piece.start <= span.start).checked_sub(1)?;
        let piece = self.pieces[index];
        let end = self.pieces.get(index + 1).map_or(u32::MAX, |next| next.start);
        let moved = |offset: u32| piece.at + (offset.min(end).max(piece.start) - piece.start);
        Some((self.files.get(piece.file)?, Span::new(moved(span.start), moved(span.end))))
    }

    /// The bytes of a file. Bytes that are not UTF-8 cause no error here: the first of them becomes the single
    /// diagnostic of parsing this source, so that callers handle all faults in one way.
    #[must_use]
    pub fn from_bytes(name: impl Into<String>, bytes: Vec<u8>) -> Self {
        match String::from_utf8(bytes) {
            Ok(text) => Self::new(name, text),
            Err(error) => {
                let offset = error.utf8_error().valid_up_to();
                let bytes = error.into_bytes();
                let byte = bytes.get(offset).copied().unwrap_or_default();
                let mut source = Self::new(name, String::from_utf8_lossy(&bytes).into_owned());
                if source.fault.is_none() {
                    // The replaced text agrees with the bytes up to `offset`, and `new` has proven that it fits.
                    source.fault = Some(Fault::NotUtf8 { offset: offset as u32, byte });
                }
                source
            }
        }
    }

    /// The name that diagnostics show.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The whole text.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    pub(crate) fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// The text of a span; empty when the span is not of this source.
    ///
    /// ```
    /// # use tpm_codegen::source::{Source, Span};
    /// let source = Source::new("cart.tpm", "model Cart { }");
    /// assert_eq!((source.slice(Span::new(6, 10)), source.slice(Span::new(6, 100))), ("Cart", ""));
    /// ```
    #[must_use]
    pub fn slice(&self, span: Span) -> &str {
        self.text.get(span.range()).unwrap_or_default()
    }

    /// Line and column of a byte offset.
    ///
    /// ```
    /// # use tpm_codegen::source::{Source, Span};
    /// let place = Source::new("cart.tpm", "model Cart {\n    x").position(17);
    /// assert_eq!((place.line, place.column), (2, 5));
    /// ```
    #[must_use]
    pub fn position(&self, offset: u32) -> Position {
        if let Some((file, span)) = self.located(Span::new(offset, offset)) {
            return file.position(span.start);
        }
        let before = self.before(offset);
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        Position {
            line: before.bytes().filter(|&byte| byte == b'\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
        }
    }

    /// The whole line around a byte offset, without its end.
    ///
    /// ```
    /// # use tpm_codegen::source::{Source, Span};
    /// assert_eq!(Source::new("cart.tpm", "one\ntwo\nthree").line_at(5), "two");
    /// ```
    #[must_use]
    pub fn line_at(&self, offset: u32) -> &str {
        let at = self.before(offset).len();
        let start = self.text[..at].rfind('\n').map_or(0, |at| at + 1);
        let end = self.text[at..].find('\n').map_or(self.text.len(), |to| at + to);
        self.text[start..end].trim_end_matches('\r')
    }

    /// A span that can be underlined: at least one character where the text has one.
    #[must_use]
    pub fn visible(&self, span: Span) -> std::ops::Range<usize> {
        let range = span.range();
        if !range.is_empty() {
            return range;
        }
        match self.text.get(range.start..).and_then(|rest| rest.chars().next()) {
            Some(c) if c != '\n' && c != '\r' => range.start..range.start + c.len_utf8(),
            _ => range,
        }
    }

    fn before(&self, offset: u32) -> &str {
        let mut at = (offset as usize).min(self.text.len());
        while !self.text.is_char_boundary(at) {
            at -= 1;
        }
        &self.text[..at]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_lines_and_characters_from_one() {
        let source = Source::new("a.tpm", "ab\nλc\r\nd");
        assert_eq!(source.position(0), Position { line: 1, column: 1 });
        assert_eq!(source.position(3), Position { line: 2, column: 1 });
        assert_eq!(source.position(5), Position { line: 2, column: 2 });
        assert_eq!(source.line_at(5), "λc");
        assert_eq!(source.position(99), Position { line: 3, column: 2 });
    }

    #[test]
    fn the_first_bad_byte_is_remembered() {
        let source = Source::from_bytes("a.tpm", b"ab\nc\xffd\xfe".to_vec());
        assert_eq!(source.fault(), Some(Fault::NotUtf8 { offset: 4, byte: 0xff }));
    }
}
