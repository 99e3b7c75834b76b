//! The one way to the terminal: texts in which nothing is left that a terminal would obey.
//!
//! Names and texts come from files, machines and the command line. In them control characters move the cursor, change the title or hide
//! what was said before, and marks of direction show a text in another order than it is read. Both are written as escapes.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::{IsTerminal as _, Write};

/// Whether a terminal does something else with a character than show it in its place. Line ends and tabs stay.
fn is_obeyed(character: char) -> bool {
    let marks_direction =
        matches!(character, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let breaks_lines = matches!(character, '\u{2028}' | '\u{2029}');
    marks_direction || breaks_lines || (character.is_control() && !matches!(character, '\n' | '\t'))
}

/// A text for people, with escapes such as `\u{1b}`.
pub(crate) fn shown(text: &str) -> Cow<'_, str> {
    replaced(text, |escaped, character| {
        escaped.extend(character.escape_unicode());
    })
}

/// A text of JSON, with the escapes of JSON: whoever reads it back finds the same strings.
pub(crate) fn shown_json(text: String) -> String {
    match replaced(&text, |escaped, character| {
        // Writing to a string cannot fail. All these characters have four digits.
        let _ = write!(escaped, "\\u{:04x}", u32::from(character));
    }) {
        Cow::Borrowed(_) => text,
        Cow::Owned(escaped) => escaped,
    }
}

fn replaced(text: &str, escape: impl Fn(&mut String, char)) -> Cow<'_, str> {
    if !text.contains(is_obeyed) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        if is_obeyed(character) { escape(&mut escaped, character) } else { escaped.push(character) }
    }
    Cow::Owned(escaped)
}

/// Writes a text for people to standard error. A closed standard error changes nothing.
pub(crate) fn tell(text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", shown(text));
}

/// Writes a text for people to standard output.
pub(crate) fn print(text: &str) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(shown(text).as_bytes()).and_then(|()| out.flush())
}

/// Writes a file's content to standard output: as it is to a program or a file, and as a text for people to a terminal.
pub(crate) fn print_content(text: &str) -> std::io::Result<()> {
    if std::io::stdout().is_terminal() {
        return print(text);
    }
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush())
}

#[cfg(test)]
mod tests {
    use super::{shown, shown_json};

    #[test]
    fn what_a_terminal_obeys_is_escaped() {
        let said = "a\u{1b}[2J\u{7}b\r\nc\td\u{202e}e\u{9b}f";
        assert_eq!(shown(said), "a\\u{1b}[2J\\u{7}b\\u{d}\nc\td\\u{202e}e\\u{9b}f");
        for plain in ["", "mass \u{3bb} = 2\n", "\u{4f60}\u{597d}"] {
            assert!(matches!(shown(plain), std::borrow::Cow::Borrowed(same) if same == plain));
        }
    }

    #[test]
    fn json_keeps_its_strings() {
        let name = "x\u{1b}\u{7f}\u{202e}\u{2028}\u{85}";
        let text = shown_json(serde_json::to_string(name).expect("a string"));
        assert!(text.is_ascii(), "{text}");
        assert_eq!(serde_json::from_str::<String>(&text).expect("JSON"), name);
    }
}
