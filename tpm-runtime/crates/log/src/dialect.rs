//! The dialect of a table of text: separator, decimal sign, header and units, found from its first lines.

use crate::assumption::{Assumption, Separator};
use crate::columns::{ColumnName, Holds, distinct};
use crate::dates::Date;
use crate::unit::unit_of;

/// Most lines of numbers from which separator and decimal sign are found.
const MOST_JUDGED_LINES: usize = 64;
/// Words for a missing reading, besides the spellings of NaN and infinity that Rust parses.
const MISSING_WORDS: [&str; 12] =
    ["", "na", "n/a", "#n/a", "null", "none", "-", "--", "1.#qnan", "-1.#ind", "1.#inf", "-1.#inf"];

/// The dialect of a table of text.
#[derive(Clone, Debug)]
pub(super) struct Dialect {
    /// Separator between fields.
    pub(super) separator: Separator,
    /// Decimal sign; nothing where the first lines hold no fraction.
    pub(super) decimal: Option<u8>,
    /// The columns.
    pub(super) header: Vec<ColumnName>,
    /// Line of the header, from 1.
    pub(super) header_line: u64,
    /// First line that may hold numbers, from 1.
    pub(super) data_line: u64,
    /// Findings that differ from the plainest format.
    pub(super) assumptions: Vec<Assumption>,
}

/// A line of text, and its number in the file.
type Line<'a> = (u64, &'a [u8]);

/// Whether a line is a comment: it begins with `#`, `%` or `//`.
pub(super) fn is_comment(line: &[u8]) -> bool {
    let start = line.trim_ascii_start();
    start.starts_with(b"#") || start.starts_with(b"%") || start.starts_with(b"//")
}

/// Writes the byte ranges of the fields of a line, without quotes around them. Separators within quotes do not
/// separate.
pub(super) fn split(line: &[u8], separator: Separator, fields: &mut Vec<(u32, u32)>) {
    fields.clear();
    let byte = match separator {
        Separator::Comma => b',',
        Separator::Semicolon => b';',
        Separator::Tab => b'\t',
        Separator::Space => return split_blanks(line, fields),
    };
    let mut start = 0;
    let mut quoted = false;
    for (at, &c) in line.iter().enumerate() {
        if c == byte && !quoted {
            fields.push(trimmed(line, start, at));
            start = at + 1;
        } else if c == b'"' {
            quoted = !quoted;
        }
    }
    fields.push(trimmed(line, start, line.len()));
}

fn split_blanks(line: &[u8], fields: &mut Vec<(u32, u32)>) {
    let mut start = None;
    let (mut quoted, mut brackets) = (false, 0_usize);
    for (at, &c) in line.iter().enumerate() {
        match c {
            b'"' => quoted = !quoted,
            b'[' | b'(' => brackets += 1,
            b']' | b')' => brackets = brackets.saturating_sub(1),
            _ => {}
        }
        let blank = c == b' ' || c == b'\t';
        if !blank || quoted || brackets > 0 && start.is_some() {
            // A unit in brackets belongs to the name before it.
            let name = (start.is_none() && (c == b'[' || c == b'(')).then(|| fields.pop()).flatten();
            start = start.or(name.map(|(from, _)| from as usize)).or(Some(at));
        } else if let Some(from) = start.take() {
            fields.push(trimmed(line, from, at));
        }
    }
    if let Some(from) = start {
        fields.push(trimmed(line, from, line.len()));
    }
}

/// A byte range of a line, without blanks and quotes around it.
fn trimmed(line: &[u8], mut from: usize, mut to: usize) -> (u32, u32) {
    while from < to && line[from].is_ascii_whitespace() {
        from += 1;
    }
    while from < to && line[to - 1].is_ascii_whitespace() {
        to -= 1;
    }
    if to - from >= 2 && line[from] == b'"' && line[to - 1] == b'"' {
        return trimmed(line, from + 1, to - 1);
    }
    (from as u32, to as u32)
}

/// The number in a field: NaN or infinite where the reading is missing, nothing for any other text.
pub(super) fn number(field: &[u8], decimal: u8) -> Option<f64> {
    let text = std::str::from_utf8(field).ok()?;
    let parsed = match field.iter().position(|byte| *byte == b',') {
        Some(at) if decimal == b',' => {
            let mut buffer = [0; 48];
            let copy = buffer.get_mut(..field.len())?;
            copy.copy_from_slice(field);
            copy[at] = b'.';
            if field.contains(&b'.') { None } else { std::str::from_utf8(copy).ok().and_then(|text| text.parse().ok()) }
        }
        _ if decimal == b',' && field.contains(&b'.') => None,
        _ => text.parse::<f64>().ok(),
    };
    parsed.or_else(|| MISSING_WORDS.iter().any(|word| word.eq_ignore_ascii_case(text)).then_some(f64::NAN))
}

/// Fields of a line, and how many of them are numbers or dates.
pub(super) struct Counted {
    pub(super) fields: usize,
    pub(super) numbers: usize,
    all: bool,
}

impl Counted {
    pub(super) fn of(line: &[u8], separator: Separator, decimal: u8, places: &mut Vec<(u32, u32)>) -> Self {
        split(line, separator, places);
        let mut fields = places.len();
        // Some programs end every line with a separator.
        if fields > 1 && places.last().is_some_and(|(from, to)| from == to) {
            fields -= 1;
        }
        let value = |&(from, to): &(u32, u32)| {
            let field = &line[from as usize..to as usize];
            number(field, decimal).or_else(|| Date::of(field).map(|date| date.fraction))
        };
        let read: Vec<Option<f64>> = places[..fields].iter().map(value).collect();
        let numbers = read.iter().flatten().filter(|value| !value.is_nan()).count();
        Counted { fields, numbers, all: read.iter().all(Option::is_some) }
    }

    /// Whether the line is one of numbers, even if some of them are missing.
    pub(super) fn is_data(&self) -> bool {
        self.numbers > 0 && 2 * self.numbers >= self.fields
    }
}

/// The separator and decimal sign with which most of the lines are rows of numbers, and the number of their columns. Nothing where
/// there are no numbers.
fn spelling(lines: &[Line<'_>]) -> Option<(Separator, u8, usize)> {
    let mut places = Vec::new();
    let mut best: Option<(usize, Separator, u8, usize)> = None;
    for (separator, decimal) in [
        (Separator::Comma, b'.'),
        (Separator::Semicolon, b'.'),
        (Separator::Semicolon, b','),
        (Separator::Tab, b'.'),
        (Separator::Tab, b','),
        (Separator::Space, b'.'),
        (Separator::Space, b','),
        (Separator::Comma, b','),
    ] {
        let counted: Vec<Counted> =
            lines.iter().map(|(_, line)| Counted::of(line, separator, decimal, &mut places)).collect();
        let data: Vec<&Counted> =
            counted.iter().filter(|line| line.is_data() && line.fields > 1).take(MOST_JUDGED_LINES).collect();
        let alike = |fields: usize| data.iter().filter(|line| line.fields == fields).count();
        let Some(fields) = data.iter().map(|line| line.fields).max_by_key(|fields| alike(*fields)) else { continue };
        // A row with a field that is no number has a low score: the field may be two numbers with another separator
        // between them.
        let score = |line: &&&Counted| if line.all { 4 * line.numbers } else { line.numbers };
        let total: usize = data.iter().filter(|line| line.fields == fields).map(|line| score(&line)).sum();
        if best.is_none_or(|(most, ..)| total > most) {
            best = Some((total, separator, decimal, fields));
        }
    }
    best.map(|(_, separator, decimal, fields)| (separator, decimal, fields))
}

/// The text of a field as UTF-8 or, failing that, as Latin-1.
fn decoded(bytes: &[u8], latin: &mut bool) -> String {
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => {
            *latin = true;
            bytes.iter().map(|&byte| char::from(byte)).collect()
        }
    };
    text.replace("\"\"", "\"")
}

impl Dialect {
    /// Finds how a text is written from its first lines.
    pub(super) fn of(lines: &[Line<'_>]) -> Self {
        // 1. Separator, decimal sign and number of columns.
        let text: Vec<Line<'_>> =
            lines.iter().copied().filter(|(_, line)| !line.trim_ascii().is_empty() && !is_comment(line)).collect();
        let found = spelling(&text);
        let mut places = Vec::new();
        let count = |line: &[u8], separator: Separator| {
            let mut places = Vec::new();
            split(line, separator, &mut places);
            places.len()
        };
        let by_header = || {
            let header = text.first().map_or(&[][..], |(_, line)| line);
            let all = [Separator::Comma, Separator::Semicolon, Separator::Tab, Separator::Space];
            all.into_iter().rev().max_by_key(|separator| count(header, *separator)).unwrap_or(Separator::Comma)
        };
        let (separator, sign, columns) =
            found.unwrap_or_else(|| (by_header(), b'.', text.first().map_or(0, |(_, line)| count(line, by_header()))));
        // 2. The first row of numbers, and the header above it.
        let is_data = |line: &[u8], places: &mut Vec<(u32, u32)>| {
            let counted = Counted::of(line, separator, sign, places);
            counted.is_data() && (counted.fields == columns || found.is_none())
        };
        let data_at = text.iter().position(|(_, line)| is_data(line, &mut places)).unwrap_or(text.len());
        let fits = |line: &[u8]| {
            let fields = count(line, separator);
            fields == columns || fields == columns + 1
        };
        let header_at = text[..data_at].iter().position(|(_, line)| fits(line)).or(data_at.checked_sub(1));
        let mut assumptions = Vec::new();
        if separator != Separator::Comma {
            assumptions.push(Assumption::Separator { separator });
        }
        // 3. The names of the columns: those of the header, else those in a comment, else numbers.
        let mut latin = false;
        let mut named = |line: &[u8], places: &mut Vec<(u32, u32)>| -> Vec<String> {
            split(line, separator, places);
            places.iter().map(|&(from, to)| decoded(&line[from as usize..to as usize], &mut latin)).collect()
        };
        let first_data = text.get(data_at).map_or(u64::MAX, |(line, _)| *line);
        let (mut names, header_line) = match header_at {
            Some(at) => {
                let (line, header) = text[at];
                if at > 0 {
                    assumptions.push(Assumption::Preamble { count: at as u64, header: line });
                }
                (named(header, &mut places), line)
            }
            None => {
                let comments = lines.iter().rev().filter(|(line, text)| *line < first_data && is_comment(text));
                let inner = |text: &[u8]| -> Vec<u8> {
                    let start = text.trim_ascii_start();
                    let marks = start.iter().take_while(|byte| b"#%/".contains(byte)).count();
                    start[marks..].to_vec()
                };
                let naming =
                    comments.map(|(line, text)| (*line, inner(text))).find(|(_, text)| columns > 1 && fits(text));
                match naming {
                    Some((line, header)) => {
                        assumptions.push(Assumption::HeaderInComment { line });
                        (named(&header, &mut places), line)
                    }
                    None if columns > 0 => {
                        assumptions.push(Assumption::NumberedColumns { columns });
                        ((1..=columns).map(|column| column.to_string()).collect(), first_data)
                    }
                    None => (Vec::new(), 1),
                }
            }
        };
        if names.len() > 1 && names.last().is_some_and(String::is_empty) {
            names.pop();
        }
        if latin {
            assumptions.push(Assumption::Latin1Header { line: header_line });
        }
        // 4. A row of units below the header.
        let mut header: Vec<ColumnName> = names.into_iter().map(ColumnName::new).collect();
        let mut data_line = match header_at {
            Some(at) => text.get(at + 1).map_or(u64::MAX, |(line, _)| *line),
            None => first_data,
        };
        if let Some(units) = header_at.and_then(|at| text.get(at + 1)).filter(|(line, _)| *line < first_data)
            && let Some(units) = units_row(units.1, separator, header.len(), &mut places)
        {
            for (column, unit) in header.iter_mut().zip(units) {
                column.unit = unit;
            }
            assumptions.push(Assumption::UnitsRow { line: data_line });
            data_line = header_at.and_then(|at| text.get(at + 2)).map_or(u64::MAX, |(line, _)| *line);
        }
        assumptions.extend(distinct(&mut header));
        let mut first: Vec<Vec<f64>> = vec![Vec::new(); header.len()];
        for (row, (_, line)) in text.iter().filter(|(line, _)| *line >= data_line).enumerate() {
            split(line, separator, &mut places);
            // A motion rises for a while too, so that the first column is followed further.
            let judged = if row < MOST_JUDGED_LINES { header.len() } else { 1 };
            for ((column, readings), &(from, to)) in header.iter_mut().zip(&mut first).zip(&places).take(judged) {
                let field = &line[from as usize..to as usize];
                match Date::of(field) {
                    Some(_) => column.holds = Holds::Time,
                    None => readings.push(number(field, sign).unwrap_or(f64::NAN)),
                }
            }
        }
        for (column, readings) in header.iter_mut().zip(&first).filter(|(column, _)| column.holds != Holds::Time) {
            column.holds = Holds::of(readings);
        }
        // 5. The decimal sign is decided by the first fraction; whole numbers leave it open.
        let fraction = |line: &[u8]| {
            split(line, separator, &mut places);
            places.iter().any(|&(from, to)| line[from as usize..to as usize].contains(&sign))
        };
        let decided = separator == Separator::Comma && sign == b'.'
            || text[data_at..].iter().take(MOST_JUDGED_LINES).map(|(_, line)| *line).any(fraction);
        if sign == b',' && decided {
            assumptions.push(Assumption::DecimalComma);
        }
        Dialect { separator, decimal: decided.then_some(sign), header, header_line, data_line, assumptions }
    }
}

/// The units of the columns, when a line is a row of units: no field is a number, and at least half of the fields that
/// are not empty are units.
fn units_row(
    line: &[u8],
    separator: Separator,
    columns: usize,
    places: &mut Vec<(u32, u32)>,
) -> Option<Vec<Option<String>>> {
    split(line, separator, places);
    if places.len() != columns && places.len() != columns + 1 {
        return None;
    }
    let mut latin = false;
    let mut units = vec![None; columns];
    let (mut known, mut said) = (0, 0);
    for (unit, &(from, to)) in units.iter_mut().zip(places.iter()) {
        let field = &line[from as usize..to as usize];
        if field.is_empty() {
            continue;
        }
        if number(field, b'.').is_some_and(|value| !value.is_nan()) {
            return None;
        }
        let text = decoded(field, &mut latin);
        let inner = text.trim_start_matches(['[', '(']).trim_end_matches([']', ')']).trim().to_owned();
        said += 1;
        known += usize::from(unit_of(&inner).is_some());
        *unit = Some(inner);
    }
    (known > 0 && 2 * known >= said).then_some(units)
}
