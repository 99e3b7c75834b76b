//! An open document: its text, the places in it as editors count them, and the answers about it.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::ops::Range;
use tpm_codegen::diagnostic::{Diagnostics, Severity};
use tpm_codegen::language;
use tpm_codegen::language::outline::{Meant, word_at, words};
use tpm_codegen::source::{Source, Span};

/// A place in a text: the line, from 0, and the UTF-16 units before it on that line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Position {
    line: usize,
    character: usize,
}

/// The kinds of completions that the protocol numbers.
const FUNCTION: u8 = 3;
const VARIABLE: u8 = 6;
const UNIT: u8 = 11;
const KEYWORD: u8 = 14;

pub(super) struct Document {
    source: Source,
    version: Option<i64>,
    /// The byte offsets at which lines begin.
    lines: Vec<usize>,
}

impl Document {
    pub(super) fn new(uri: &str, text: String, version: Option<i64>) -> Self {
        let source = Source::new(uri, text);
        let text = source.text().as_bytes();
        let ends = (0..text.len())
            .filter(|&at| text[at] == b'\n' || (text[at] == b'\r' && text.get(at + 1) != Some(&b'\n')))
            .map(|at| at + 1);
        let lines = std::iter::once(0).chain(ends).collect();
        Self { source, version, lines }
    }

    pub(super) fn source(&self) -> &Source {
        &self.source
    }

    pub(super) fn version(&self) -> Option<i64> {
        self.version
    }

    /// The place of a byte offset; that of the end where the text is shorter.
    fn position(&self, offset: usize) -> Position {
        let line = self.lines.partition_point(|&start| start <= offset).saturating_sub(1);
        let text = self.source.text();
        let before = text[self.lines[line]..].char_indices().map(|(at, letter)| (self.lines[line] + at, letter));
        let character = before.take_while(|(at, _)| *at < offset).map(|(_, letter)| letter.len_utf16()).sum();
        Position { line, character }
    }

    /// The byte offset of a place; the end of its line where the line is shorter, and of the text where that has fewer lines.
    fn offset(&self, position: Position) -> u32 {
        let text = self.source.text();
        let start = self.lines.get(position.line).copied().unwrap_or(text.len());
        let mut units = 0;
        let within = text[start..].char_indices().find(|&(_, letter)| {
            let found = units >= position.character || letter == '\n' || letter == '\r';
            units += letter.len_utf16();
            found
        });
        let offset = within.map_or(text.len(), |(at, _)| start + at);
        // A source is refused where an offset does not fit 32 bits.
        u32::try_from(offset).unwrap_or(u32::MAX)
    }

    fn range(&self, range: Range<usize>) -> Value {
        json!({ "start": self.position(range.start), "end": self.position(range.end) })
    }

    /// Diagnostics as the protocol has them: what is wrong, what stands there and what to do in one message, other places beside it.
    pub(super) fn diagnostics(&self, uri: &str, found: &Diagnostics) -> Value {
        let place = |span: Span| self.range(self.source.visible(span));
        let mut list: Vec<Value> = found
            .iter()
            .map(|own| {
                let labels = own.labels.iter().map(
                    |label| json!({ "location": { "uri": uri, "range": place(label.span) }, "message": label.text }),
                );
                json!({
                    "range": place(own.span),
                    "severity": if own.severity == Severity::Error { 1 } else { 2 },
                    "source": "tpm",
                    "message": own.headline(),
                    "relatedInformation": labels.collect::<Vec<Value>>(),
                })
            })
            .collect();
        if found.omitted() > 0 {
            let more = format!("and {} more", found.omitted());
            list.push(json!({ "range": self.range(0..0), "severity": 3, "source": "tpm", "message": more }));
        }
        Value::Array(list)
    }

    /// What the word at a place means; null where none is known.
    pub(super) fn hover(&self, position: Position) -> Value {
        let Some((span, word)) = word_at(&self.source, self.offset(position)) else { return Value::Null };
        let meaning = if word.meaning.is_empty() { String::new() } else { format!("\n\n{}", word.meaning) };
        let text = format!("```tpm\n{}\n```{meaning}", word.usage);
        json!({ "contents": { "kind": "markdown", "value": text }, "range": self.range(span.range()) })
    }

    /// Every word that could be written; the editor chooses by what has been typed.
    pub(super) fn completion(&self) -> Value {
        let items = words(&self.source).into_iter().map(|word| {
            let kind = match word.meant {
                Meant::Function => FUNCTION,
                Meant::Keyword => KEYWORD,
                Meant::Unit => UNIT,
                _ => VARIABLE,
            };
            json!({ "label": word.name, "kind": kind, "detail": word.usage, "documentation": word.meaning })
        });
        Value::Array(items.collect())
    }

    /// The edit that lays the text out: none where it is laid out, null where it has a fault.
    pub(super) fn formatting(&self) -> Value {
        let whole = self.source.text();
        match language::format(&self.source) {
            Ok(text) if text == whole => json!([]),
            Ok(text) => json!([{ "range": self.range(0..whole.len()), "newText": text }]),
            Err(_) => Value::Null,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Document, Position};

    #[test]
    fn places_are_counted_in_units_of_utf_16() {
        let document = Document::new("d", "a\u{1d70b}b\r\ncd\re\n".to_owned(), None);
        for (offset, line, character) in
            [(0, 0, 0), (1, 0, 1), (5, 0, 3), (6, 0, 4), (8, 1, 0), (10, 1, 2), (11, 2, 0), (13, 3, 0)]
        {
            let position = Position { line, character };
            assert_eq!(document.position(offset), position);
            assert_eq!(document.offset(position) as usize, offset);
        }
        // Inside a pair, behind a line and behind the text.
        assert_eq!(document.offset(Position { line: 0, character: 2 }), 5);
        assert_eq!(document.offset(Position { line: 1, character: 99 }), 10);
        assert_eq!(document.offset(Position { line: 99, character: 0 }), 13);
    }
}
