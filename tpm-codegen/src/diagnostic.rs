//! Faults and remarks about a model's text.
//!
//! Invariant: every [`Diagnostic`] has a place (its primary span), says what is wrong there, and, where there is something to
//! do, says it in `help`. [`Diagnostics`] keeps a bounded number of them and counts the rest, so that ten megabytes of garbage
//! give a page and not ten megabytes of messages.

use std::fmt::{self, Write as _};

use ariadne::{CharSet, Config, IndexType, Label as AriadneLabel, Report, ReportKind};

use crate::source::{Source, Span};

/// Severity of a diagnostic.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Severity {
    /// The model cannot be used.
    Error,
    /// The model can be used; something in it is likely not meant.
    Warning,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Error => "error",
            Self::Warning => "warning",
        })
    }
}

/// A second place that explains a diagnostic.
#[derive(Clone, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub struct Label {
    /// Where.
    pub span: Span,
    /// What the place holds, in words.
    pub text: String,
}

/// One fault or remark at one place.
#[derive(Clone, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub struct Diagnostic {
    /// Error or warning.
    pub severity: Severity,
    /// What is wrong, naming the thing.
    pub message: String,
    /// The place.
    pub span: Span,
    /// Text beside the caret, about what stands at the place; may be empty.
    pub note: String,
    /// Other places that explain the diagnostic.
    pub labels: Vec<Label>,
    /// What the user can do, when there is a remedy.
    pub help: Option<String>,
}

impl Diagnostic {
    /// An error at a place.
    #[must_use]
    pub fn error(span: Span, message: impl Into<String>) -> Self {
        Self {
            severity: Severity::Error,
            message: message.into(),
            span,
            note: String::new(),
            labels: Vec::new(),
            help: None,
        }
    }

    /// A warning at a place.
    #[must_use]
    pub fn warning(span: Span, message: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::error(span, message) }
    }

    /// Adds the text beside the caret.
    #[must_use]
    pub fn note(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }

    /// Adds another place.
    #[must_use]
    pub fn label(mut self, span: Span, text: impl Into<String>) -> Self {
        self.labels.push(Label { span, text: text.into() });
        self
    }

    /// Adds the remedy.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Message and help on one line, for places where no text can be shown (a compiler's message has its own caret).
    #[must_use]
    pub fn headline(&self) -> String {
        let mut line = self.message.clone();
        if !self.note.is_empty() {
            let _ = write!(line, ": {}", self.note);
        }
        if let Some(help) = &self.help {
            let _ = write!(line, "\nhelp: {help}");
        }
        line
    }
}

/// The longest number that an error shows whole, in digits.
const LONGEST_NUMBER: usize = 60;

/// Number of digits that are shown of the beginning and of the end of a longer number.
const SHOWN: usize = 20;

/// A text whose very long numbers are cut to their first and last digits and their length.
#[must_use]
pub fn with_short_numbers(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find(|letter: char| letter.is_ascii_digit()) {
        let (before, number) = rest.split_at(start);
        let end = number.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(number.len());
        let (digits, after) = number.split_at(end);
        shown.push_str(before);
        if end > LONGEST_NUMBER {
            let _ = write!(shown, "{}...{} ({end} digits)", &digits[..SHOWN], &digits[end - SHOWN..]);
        } else {
            shown.push_str(digits);
        }
        rest = after;
    }
    shown + rest
}

/// Most errors, and most warnings, that [`Diagnostics`] keeps; the rest is counted.
pub const MOST_KEPT: usize = 50;

/// The diagnostics of one source, in the order of their places once [`Diagnostics::sort`] was called.
#[derive(Clone, Default, PartialEq, Eq, Debug)]
pub struct Diagnostics {
    list: Vec<Diagnostic>,
    errors: usize,
    warnings: usize,
}

impl Diagnostics {
    /// An empty list.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a diagnostic; beyond [`MOST_KEPT`] it is only counted, and an exact repetition is dropped.
    pub fn push(&mut self, diagnostic: Diagnostic) {
        let count = match diagnostic.severity {
            Severity::Error => &mut self.errors,
            Severity::Warning => &mut self.warnings,
        };
        if *count >= MOST_KEPT {
            *count += 1;
        } else if !self.list.contains(&diagnostic) {
            *count += 1;
            self.list.push(diagnostic);
        }
    }

    /// Whether there is an error, so that the model cannot be used.
    #[must_use]
    pub fn has_errors(&self) -> bool {
        self.errors > 0
    }

    /// Whether there is nothing to say.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// The diagnostics that were kept.
    pub fn iter(&self) -> impl Iterator<Item = &Diagnostic> {
        self.list.iter()
    }

    /// How many were counted but not kept.
    #[must_use]
    pub fn omitted(&self) -> usize {
        self.errors + self.warnings - self.list.len()
    }

    /// Sorts the diagnostics by their places; equal places keep the order in which they were found.
    pub fn sort(&mut self) {
        self.list.sort_by_key(|diagnostic| diagnostic.span);
    }

    /// Removes the warnings and returns them.
    #[must_use]
    pub fn take_warnings(&mut self) -> Vec<Diagnostic> {
        let (warnings, rest) =
            std::mem::take(&mut self.list).into_iter().partition(|diagnostic| diagnostic.severity == Severity::Warning);
        self.list = rest;
        self.warnings = 0;
        warnings
    }

    /// The text that a person reads: each diagnostic with file, line, column, the line itself and a caret, without colour.
    #[must_use]
    pub fn render(&self, source: &Source) -> String {
        let mut text = String::new();
        let mut cache = Excerpts::new(source);
        for diagnostic in &self.list {
            cache.render(diagnostic, &mut text);
        }
        match self.omitted() {
            0 => {}
            more => {
                let _ = writeln!(text, "and {more} more");
            }
        }
        text
    }
}

impl FromIterator<Diagnostic> for Diagnostics {
    fn from_iter<I: IntoIterator<Item = Diagnostic>>(iter: I) -> Self {
        let mut diagnostics = Self::new();
        for diagnostic in iter {
            diagnostics.push(diagnostic);
        }
        diagnostics
    }
}

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, diagnostic) in self.list.iter().enumerate() {
            let separator = if index == 0 { "" } else { "\n" };
            write!(f, "{separator}{}: {}", diagnostic.severity, diagnostic.headline())?;
        }
        match self.omitted() {
            0 => Ok(()),
            more => write!(f, "\nand {more} more"),
        }
    }
}

impl std::error::Error for Diagnostics {}

/// One diagnostic as text, as [`Diagnostics::render`] writes it.
#[must_use]
pub fn render(source: &Source, diagnostic: &Diagnostic) -> String {
    let mut text = String::new();
    Excerpts::new(source).render(diagnostic, &mut text);
    text
}

/// Longest line, in bytes, that is shown whole; a longer one is clipped around the caret.
const WIDEST_LINE: usize = 400;

/// The source in the form that ariadne expects, built once for all diagnostics and only when it is used.
struct Excerpts<'a> {
    source: &'a Source,
    lines: Option<ariadne::Source<&'a str>>,
    /// Whether the text has characters at which ariadne ends a line and an editor does not, so that ariadne's line
    /// numbers would be wrong.
    odd_lines: bool,
}

impl<'a> Excerpts<'a> {
    fn new(source: &'a Source) -> Self {
        let text = source.text();
        let odd_lines = text.contains(['\u{b}', '\u{c}', '\u{85}', '\u{2028}', '\u{2029}'])
            || text.match_indices('\r').any(|(at, _)| text.as_bytes().get(at + 1) != Some(&b'\n'));
        Self { source, lines: None, odd_lines }
    }

    fn render(&mut self, diagnostic: &Diagnostic, text: &mut String) {
        if let Some((file, span)) = self.source.located(diagnostic.span) {
            // Labels in other files are left out: an excerpt shows one file.
            let label = |label: &Label| {
                let (other, span) = self.source.located(label.span)?;
                std::ptr::eq(other, file).then(|| Label { span, ..label.clone() })
            };
            let labels = diagnostic.labels.iter().filter_map(label).collect();
            return Excerpts::new(file).render(&Diagnostic { span, labels, ..diagnostic.clone() }, text);
        }
        let spans = std::iter::once(diagnostic.span).chain(diagnostic.labels.iter().map(|label| label.span));
        let wide = self.odd_lines
            || spans
                .flat_map(|span| [span.start, span.end])
                .any(|offset| self.source.line_at(offset).len() > WIDEST_LINE)
            || self.source.slice(diagnostic.span).len() > 8 * WIDEST_LINE;
        let drawn = if wide { None } else { self.draw(diagnostic) };
        match drawn {
            Some(drawn) => text.push_str(&drawn),
            None => self.clip(diagnostic, text),
        }
    }

    fn draw(&mut self, diagnostic: &Diagnostic) -> Option<String> {
        let source = self.source;
        let name = source.name();
        let span = |span: Span| (name, source.visible(span));
        let kind = match diagnostic.severity {
            Severity::Error => ReportKind::Error,
            Severity::Warning => ReportKind::Warning,
        };
        let config = Config::default().with_color(false).with_char_set(CharSet::Ascii).with_index_type(IndexType::Byte);
        let mut report =
            Report::build(kind, span(diagnostic.span)).with_config(config).with_message(&diagnostic.message);
        // Labels in the order of their lines stay in one excerpt; ariadne begins a new excerpt where the line number
        // decreases.
        let line = |span: Span| i32::try_from(source.position(span.start).line).unwrap_or(i32::MAX);
        let primary = AriadneLabel::new(span(diagnostic.span)).with_order(line(diagnostic.span));
        report = report.with_label(match diagnostic.note.as_str() {
            "" => primary.with_message("here"),
            note => primary.with_message(note),
        });
        for label in &diagnostic.labels {
            report = report
                .with_label(AriadneLabel::new(span(label.span)).with_message(&label.text).with_order(line(label.span)));
        }
        if let Some(help) = &diagnostic.help {
            report = report.with_help(help);
        }
        let lines = self.lines.get_or_insert_with(|| ariadne::Source::from(source.text()));
        let mut bytes = Vec::new();
        report.finish().write((name, &*lines), &mut bytes).ok()?;
        // Trailing blanks are removed, since they would make snapshots fragile.
        let drawn = String::from_utf8_lossy(&bytes);
        Some(drawn.lines().map(str::trim_end).fold(String::new(), |text, line| text + line + "\n"))
    }

    fn clip(&self, diagnostic: &Diagnostic, text: &mut String) {
        let position = self.source.position(diagnostic.span.start);
        let line = self.source.line_at(diagnostic.span.start);
        let from = position.column.saturating_sub(40);
        let excerpt: String = line.chars().skip(from).take(80).map(|c| if c.is_control() { ' ' } else { c }).collect();
        let caret = " ".repeat(position.column - 1 - from.min(position.column - 1));
        let severity = match diagnostic.severity {
            Severity::Error => "Error",
            Severity::Warning => "Warning",
        };
        let _ = writeln!(text, "{severity}: {}", diagnostic.message);
        let _ = writeln!(text, "  at {}:{}:{}", self.source.name(), position.line, position.column);
        let _ = writeln!(
            text,
            "  ... {excerpt} ...\n      {caret}^ {}",
            if diagnostic.note.is_empty() { "here" } else { &diagnostic.note }
        );
        if let Some(help) = &diagnostic.help {
            let _ = writeln!(text, "  help: {help}");
        }
    }
}
