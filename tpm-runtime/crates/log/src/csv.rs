//! Tables of text: numbers in columns, line by line.

use crate::assumption::Assumption;
use crate::columns::{ColumnName, Columns, NotedText};
use crate::dates::Date;
use crate::dialect::{Counted, Dialect, is_comment, number, split};
use crate::error::LogError;
use crate::stamps::{Resolution, last_digit};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashSet};
use std::io::Read;
use std::ops::Range;

/// Bytes at the beginning of a file from which its dialect is found.
pub(super) const HEAD_BYTES: usize = 1 << 16;
/// Bytes that are read at a time.
const BLOCK_BYTES: usize = 1 << 18;
/// Longest line of a table, bytes.
const LONGEST_LINE_BYTES: usize = 1 << 24;
/// Fewest lines from which a dialect is found, where the file has so many.
const FEWEST_HEAD_LINES: usize = 8;
/// Most characters of a line of text that a message shows.
const LONGEST_SHOWN_TEXT: usize = 60;
/// The byte order mark of UTF-8.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Bytes of a reader, line by line.
pub(super) struct Lines<R> {
    input: R,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    ended: bool,
    /// The byte that ends a line.
    terminator: u8,
}

impl<R: Read> Lines<R> {
    /// Lines of a reader from which nothing was read yet.
    pub(super) fn new(input: R) -> Self {
        Self { input, buffer: vec![0; BLOCK_BYTES], start: 0, end: 0, ended: false, terminator: b'\n' }
    }

    /// Reads until the buffer holds so many bytes, or the input ends.
    pub(super) fn fill(&mut self, bytes: usize) -> std::io::Result<&[u8]> {
        while !self.ended && self.end - self.start < bytes {
            self.more()?;
        }
        Ok(&self.buffer[self.start..self.end])
    }

    /// The bytes in the buffer, followed by the rest of the input.
    pub(super) fn into_rest(self) -> impl Read {
        let Lines { input, mut buffer, start, end, .. } = self;
        buffer.truncate(end);
        buffer.drain(..start);
        std::io::Cursor::new(buffer).chain(input)
    }

    fn more(&mut self) -> std::io::Result<()> {
        if self.end == self.buffer.len() {
            if self.start > 0 {
                self.buffer.copy_within(self.start..self.end, 0);
                self.end -= self.start;
                self.start = 0;
            } else {
                self.buffer.resize(2 * self.buffer.len(), 0);
            }
        }
        let count = loop {
            match self.input.read(&mut self.buffer[self.end..]) {
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                other => break other?,
            }
        };
        self.ended = count == 0;
        self.end += count;
        Ok(())
    }

    /// The next line without its terminator, as a range of the buffer, and whether the input ended before a terminator.
    fn next(&mut self) -> std::io::Result<Option<(Range<usize>, bool)>> {
        let mut searched = self.start;
        loop {
            let found = self.buffer[searched..self.end].iter().position(|byte| *byte == self.terminator);
            let (line, cut) = match found {
                Some(at) => (self.start..searched + at, false),
                None if self.ended && self.start == self.end => return Ok(None),
                None if self.ended => (self.start..self.end, true),
                None => {
                    if self.end - self.start > LONGEST_LINE_BYTES {
                        return Err(std::io::Error::new(std::io::ErrorKind::InvalidData, too_long()));
                    }
                    let length = self.end - self.start;
                    self.more()?;
                    searched = self.start + length;
                    continue;
                }
            };
            self.start = (line.end + 1).min(self.end);
            let carriage = !line.is_empty() && self.buffer[line.end - 1] == b'\r';
            return Ok(Some((line.start..line.end - usize::from(carriage), cut)));
        }
    }
}

/// The fault of a line that never ends.
fn too_long() -> String {
    format!("a line is longer than {LONGEST_LINE_BYTES} bytes; this is no table of text, is it the right file?")
}

/// A table of text.
pub(super) struct Csv<R> {
    path: String,
    lines: Lines<R>,
    dialect: Dialect,
    /// Number of the last line that was taken.
    line: u64,
    /// Byte ranges of the fields in the last line.
    fields: Vec<(u32, u32)>,
    last: Range<usize>,
    wanted: Vec<usize>,
    resolution: Resolution,
    /// Number of comments, and the line of the first.
    comments: (u64, u64),
    cut: Option<u64>,
    /// Whole seconds of the first stamp, where stamps are dates.
    epoch: Option<i64>,
    /// Number of lines of text between rows, and the first of them.
    between: (u64, u64),
    /// Number of rows with fewer fields than the header, and the first of them.
    short: (u64, u64),
    /// Fields of the rows that go on so, and of the last of those rows.
    short_fields: [Option<usize>; 2],
    /// Whether the last line is text, or has lost fields.
    is_text: bool,
    /// The place among the selected columns from which on texts are noted; nothing where they are faults.
    noted_from: Option<usize>,
    /// Line and text of the first text in each selected column that has one.
    noted: BTreeMap<usize, (u64, String)>,
}

impl<R: Read> Csv<R> {
    /// Finds the dialect of a text; messages call it `path`.
    ///
    /// # Errors
    /// [`LogError`] when the text cannot be read.
    pub(super) fn new(path: &str, mut lines: Lines<R>) -> Result<Self, LogError> {
        let io = |source| LogError::Io { path: path.into(), source };
        if lines.fill(HEAD_BYTES).map_err(io)?.starts_with(BYTE_ORDER_MARK) {
            lines.start += BYTE_ORDER_MARK.len();
        }
        let mut wanted = HEAD_BYTES;
        // Wide tables have long lines, so that more bytes may be needed for enough lines.
        loop {
            let head = lines.fill(wanted).map_err(io)?;
            let ends = |end: u8| head.iter().filter(|byte| **byte == end).count();
            let (feeds, returns) = (ends(b'\n'), ends(b'\r'));
            let terminator = if feeds == 0 && returns > 0 { b'\r' } else { b'\n' };
            let (held, found) = (head.len(), feeds.max(returns));
            lines.terminator = terminator;
            if found == 0 && held > LONGEST_LINE_BYTES {
                return Err(LogError::Csv { path: path.into(), line: 1, message: too_long() });
            }
            if found >= FEWEST_HEAD_LINES || lines.ended || held > LONGEST_LINE_BYTES {
                break;
            }
            wanted *= 2;
        }
        let ended = lines.ended;
        let head = &lines.buffer[lines.start..lines.end];
        let mut numbered: Vec<(u64, &[u8])> = (1..).zip(head.split(|byte| *byte == lines.terminator)).collect();
        for (_, text) in &mut numbered {
            *text = text.strip_suffix(b"\r").unwrap_or(text);
        }
        if !ended && numbered.len() > 1 {
            numbered.pop();
        }
        let dialect = Dialect::of(&numbered);
        let mut csv = Csv {
            path: path.into(),
            lines,
            dialect,
            line: 0,
            fields: Vec::new(),
            last: 0..0,
            wanted: Vec::new(),
            resolution: Resolution::default(),
            comments: (0, 0),
            cut: None,
            epoch: None,
            between: (0, 0),
            short: (0, 0),
            short_fields: [None; 2],
            is_text: false,
            noted_from: None,
            noted: BTreeMap::new(),
        };
        // Comments above the first row of numbers are counted; the other lines there were parsed with the dialect.
        while csv.line + 1 < csv.dialect.data_line {
            let Some((line, _)) = csv.take()? else { break };
            csv.count_comment(line);
        }
        Ok(csv)
    }

    /// The next line.
    fn take(&mut self) -> Result<Option<(Range<usize>, bool)>, LogError> {
        let taken = self.lines.next().map_err(|source| match source.kind() {
            std::io::ErrorKind::InvalidData => {
                LogError::Csv { path: self.path.clone(), line: self.line + 1, message: source.to_string() }
            }
            _ => LogError::Io { path: self.path.clone(), source },
        })?;
        self.line += u64::from(taken.is_some());
        Ok(taken)
    }

    /// Counts a line as a comment if it is one.
    fn count_comment(&mut self, line: Range<usize>) -> bool {
        let comment = is_comment(&self.lines.buffer[line]);
        let names = |assumption: &Assumption| *assumption == Assumption::HeaderInComment { line: self.line };
        if comment && !self.dialect.assumptions.iter().any(names) {
            self.comments = (self.comments.0 + 1, if self.comments.0 == 0 { self.line } else { self.comments.1 });
        }
        comment
    }

    fn field(&self, field: usize) -> &[u8] {
        let (from, to) = self.fields[self.wanted[field]];
        &self.lines.buffer[self.last.start + from as usize..self.last.start + to as usize]
    }

    /// The text of a column in the last row, whether it is selected or not.
    pub(super) fn field_of(&self, column: usize) -> Cow<'_, str> {
        let (from, to) = self.fields[column];
        String::from_utf8_lossy(&self.lines.buffer[self.last.start + from as usize..self.last.start + to as usize])
    }

    /// The stamp of the last row where it is a date: seconds from the whole second of the first one.
    fn date(&mut self, field: usize) -> Option<f64> {
        let stamps_before = self.resolution != Resolution::default();
        if field > 0 || self.epoch.is_none() && stamps_before {
            return None;
        }
        let date = Date::of(self.field(field))?;
        let epoch = *self.epoch.get_or_insert(date.seconds);
        let stamp = (date.seconds - epoch) as f64 + date.fraction;
        self.resolution.take(stamp, date.last_digit);
        Some(stamp)
    }

    /// Takes the last line as one of text, as a console writes it between rows, if it is one: its fields are too few or too many and
    /// most of them no numbers, or none of them is a number. Names of other columns in their places are a header of another table.
    fn take_text(&mut self, values: &mut [f64]) -> bool {
        let line = &self.lines.buffer[self.last.clone()];
        let mut places = Vec::new();
        let counted = Counted::of(line, self.dialect.separator, self.dialect.decimal.unwrap_or(b'.'), &mut places);
        let columns = self.dialect.header.len();
        let is_moved = || {
            let names: HashSet<&[u8]> = self.dialect.header.iter().map(|own| own.text.as_bytes()).collect();
            let fields = places.iter().map(|&(from, to)| &line[from as usize..to as usize]);
            fields.zip(&self.dialect.header).any(|(field, own)| field != own.text.as_bytes() && names.contains(field))
        };
        // A quote that is opened and not closed has swallowed what stands behind it.
        let open_quote = line.iter().filter(|byte| **byte == b'"').count() % 2 == 1;
        let foreign = if counted.fields == columns { counted.numbers == 0 && !is_moved() } else { !counted.is_data() };
        let is_text = foreign && !open_quote;
        if is_text {
            self.is_text = true;
            self.between = (self.between.0 + 1, if self.between.0 == 0 { self.line } else { self.between.1 });
            values.fill(f64::NAN);
        }
        is_text
    }

    /// Whether no row follows the last line, whose text is given up.
    fn nothing_follows(&mut self) -> Result<bool, LogError> {
        self.last = 0..0;
        let end = self.lines.terminator;
        let rest = self.lines.fill(HEAD_BYTES).map_err(|source| LogError::Io { path: self.path.clone(), source })?;
        Ok(rest.split(|byte| *byte == end).all(|line| line.trim_ascii().is_empty() || is_comment(line)))
    }

    /// Whether a text is a number with another decimal sign than the numbers before.
    fn has_other_sign(&self, text: &str) -> bool {
        let other = match self.dialect.decimal {
            Some(b',') => b'.',
            Some(_) => b',',
            None => return false,
        };
        text.as_bytes().contains(&other) && number(text.as_bytes(), other).is_some_and(f64::is_finite)
    }

    /// A missing reading in place of a field that is neither a number nor missing, where these are noted.
    ///
    /// # Errors
    /// The fault of the field where they are not.
    fn note(&mut self, field: usize) -> Result<f64, LogError> {
        if self.noted_from.is_none_or(|from| field < from) {
            return Err(self.fault(field));
        }
        if !self.noted.contains_key(&field) {
            match self.fault(field) {
                LogError::NotANumber { line, text, .. } => self.noted.insert(field, (line, text)),
                other => return Err(other),
            };
        }
        Ok(f64::NAN)
    }

    /// The fault of a field that is neither a number nor missing.
    fn fault(&self, field: usize) -> LogError {
        let path = self.path.clone();
        match std::str::from_utf8(self.field(field)) {
            // The decimal sign must not change within a file.
            Ok(text) if self.has_other_sign(text) => LogError::Csv {
                path,
                line: self.line,
                message: format!(
                    "column `{}` holds `{text}`, while fractions begin with a {} before; write all numbers alike",
                    self.dialect.header[self.wanted[field]].text,
                    if self.dialect.decimal == Some(b',') { "comma" } else { "point" },
                ),
            },
            Ok(text) => LogError::NotANumber {
                path,
                line: self.line,
                column: self.dialect.header[self.wanted[field]].text.clone(),
                text: text.into(),
            },
            Err(_) => LogError::Csv {
                path,
                line: self.line,
                message: "the text is not UTF-8; save the log as UTF-8 text".into(),
            },
        }
    }
}

impl<R: Read> Columns for Csv<R> {
    fn header(&self) -> &[ColumnName] {
        &self.dialect.header
    }

    fn header_line(&self) -> u64 {
        self.dialect.header_line
    }

    fn kind(&self) -> String {
        format!("a table of text whose fields are separated by {}", self.dialect.separator)
    }

    fn units_line(&self) -> u64 {
        let row = self.dialect.assumptions.iter().find_map(|of| match of {
            Assumption::UnitsRow { line } => Some(*line),
            _ => None,
        });
        row.unwrap_or(self.dialect.header_line)
    }

    fn select(&mut self, wanted: &[usize]) {
        self.wanted = wanted.to_vec();
        self.noted.clear();
    }

    fn note_texts(&mut self, from: usize) {
        self.noted_from = Some(from);
    }

    fn noted_texts(&self) -> Vec<NotedText> {
        let noted = self.noted.iter();
        noted.map(|(&field, (line, text))| NotedText { field, line: *line, text: text.clone() }).collect()
    }

    fn next_row(&mut self, values: &mut [f64]) -> Result<Option<u64>, LogError> {
        self.is_text = false;
        loop {
            let Some((range, cut)) = self.take()? else { return Ok(None) };
            let text = &self.lines.buffer[range.clone()];
            let Some(&first) = text.first() else { continue };
            if !(first.is_ascii_digit() || first == b'-')
                && (text.trim_ascii().is_empty() || self.count_comment(range.clone()))
            {
                continue;
            }
            let text = &self.lines.buffer[range.clone()];
            split(text, self.dialect.separator, &mut self.fields);
            self.last = range;
            let columns = self.dialect.header.len();
            // Some programs end every line with a separator.
            let empty_end = self.fields.len() == columns + 1 && self.fields.last().is_some_and(|(from, to)| from == to);
            if self.fields.len() != columns && !empty_end {
                if cut && self.fields.len() < columns {
                    self.cut = Some(self.line);
                    return Ok(None);
                }
                if self.take_text(values) {
                    return Ok(Some(self.line));
                }
                let quotes = self.lines.buffer[self.last.clone()].iter().filter(|byte| **byte == b'"').count();
                let (found, quote) = (self.fields.len(), quotes % 2 == 1);
                if found > columns || quote {
                    return Err(LogError::FieldCount {
                        quote,
                        path: self.path.clone(),
                        line: self.line,
                        found: found as u64,
                        expected: columns as u64,
                    });
                }
                if self.short_fields == [None; 2] && self.nothing_follows()? {
                    self.cut = Some(self.line);
                    return Ok(None);
                }
                // Where rows go on with fewer fields, columns have ended. One alone has lost something, nobody knows where.
                self.short = (self.short.0 + 1, if self.short.0 == 0 { self.line } else { self.short.1 });
                let [run, last] = self.short_fields;
                self.short_fields = [if run.is_none() && last == Some(found) { last } else { run }, Some(found)];
                if self.short_fields[0] != Some(found) {
                    self.is_text = true;
                    values.fill(f64::NAN);
                    return Ok(Some(self.line));
                }
                self.fields.resize(columns, (0, 0));
            } else {
                self.short_fields = [None; 2];
            }
            let mut has_numbers = false;
            for field in 0..self.wanted.len() {
                let read = number(self.field(field), self.dialect.decimal.unwrap_or(b'.'));
                values[field] = match read {
                    // Stamps are dates throughout.
                    Some(number) if field == 0 && self.epoch.is_some() && number.is_finite() => {
                        return Err(self.fault(field));
                    }
                    Some(number) => number,
                    // The first fraction of the file decides which decimal sign is used.
                    None if self.dialect.decimal.is_none() && self.field(field).contains(&b',') => {
                        let number = number(self.field(field), b',').ok_or_else(|| self.fault(field))?;
                        self.dialect.decimal = Some(b',');
                        self.dialect.assumptions.push(Assumption::DecimalComma);
                        number
                    }
                    None => match self.date(field) {
                        Some(stamp) => stamp,
                        None if !has_numbers && self.take_text(values) => return Ok(Some(self.line)),
                        None => self.note(field)?,
                    },
                };
                has_numbers |= !values[field].is_nan();
                if self.dialect.decimal.is_none() && self.field(field).contains(&b'.') {
                    self.dialect.decimal = Some(b'.');
                }
            }
            if self.epoch.is_none() && values.first().is_some_and(|stamp| stamp.is_finite()) {
                let digit = last_digit(self.field(0), self.dialect.decimal.unwrap_or(b'.'));
                self.resolution.take(values[0], digit);
            }
            return Ok(Some(self.line));
        }
    }

    fn text(&self, field: usize) -> String {
        if self.is_text {
            let line = String::from_utf8_lossy(&self.lines.buffer[self.last.clone()]);
            return line.trim().chars().take(LONGEST_SHOWN_TEXT).collect();
        }
        String::from_utf8_lossy(self.field(field)).into_owned()
    }

    fn dated(&self) -> bool {
        self.epoch.is_some()
    }

    fn resolution(&self) -> Resolution {
        self.resolution.clone()
    }

    fn assumptions(&self) -> Vec<Assumption> {
        let mut assumptions = self.dialect.assumptions.clone();
        if self.comments.0 > 0 {
            assumptions.push(Assumption::Comments { count: self.comments.0, first: self.comments.1 });
        }
        if self.between.0 > 0 {
            assumptions.push(Assumption::TextBetweenRows { count: self.between.0, first: self.between.1 });
        }
        if self.short.0 > 0 {
            assumptions.push(Assumption::ShortRows { count: self.short.0, first: self.short.1 });
        }
        assumptions.extend(self.cut.map(|line| Assumption::CutLine { line }));
        assumptions
    }
}
