//! Lines and comments of C sources.
//!
//! Invariant: no text of a model ends a comment early or begins a comment inside another.

use super::super::text::filled;

/// Maximal width of a line in characters, unless a single word is wider.
const WIDTH: usize = 100;

/// A text without the character sequences that begin or end a comment.
fn harmless(text: &str) -> String {
    text.replace("*/", "* /").replace("/*", "/ *")
}

/// A text over several lines at its spaces, with `first` before it and `rest` before every further line.
fn wrapped(text: &str, first: &str, rest: &str) -> String {
    let mut lines = String::from(first);
    let mut width = first.chars().count();
    let mut fresh = true;
    for word in text.split(' ') {
        let length = word.chars().count();
        if !fresh && width + 1 + length > WIDTH {
            lines.push('\n');
            lines.push_str(rest);
            width = rest.chars().count();
            fresh = true;
        }
        if !fresh {
            lines.push(' ');
            width += 1;
        }
        lines.push_str(word);
        width += length;
        fresh = false;
    }
    lines.push('\n');
    lines
}

/// A statement at an indentation.
pub(super) fn statement(indent: usize, text: &str) -> String {
    let first = " ".repeat(4 * indent);
    wrapped(text, &first, &" ".repeat(4 * indent + 8))
}

/// The signature of a function, broken between parameters only.
pub(super) fn signature(result: &str, name: &str, parameters: &[&str]) -> String {
    let whole = |text: &str| text.replace(' ', "\u{a0}");
    let list: Vec<String> = parameters.iter().map(|parameter| whole(parameter)).collect();
    let list = if list.is_empty() { "void".to_owned() } else { list.join(", ") };
    let text = format!("{} {name}({list})", whole(result));
    wrapped(&text, "", "        ").trim_end().replace('\u{a0}', " ")
}

/// A comment on its own lines, before the code that it describes.
pub(super) fn comment(indent: usize, text: &str) -> String {
    let first = format!("{}/* ", " ".repeat(4 * indent));
    wrapped(&format!("{} */", harmless(text)), &first, &" ".repeat(4 * indent + 3))
}

/// A documentation comment: Markdown without its fences, fenced text indented.
pub(super) fn doc(indent: usize, text: &str) -> String {
    let margin = " ".repeat(4 * indent);
    if !text.contains('\n') && margin.len() + text.chars().count() + 6 <= WIDTH {
        return format!("{margin}/* {} */\n", harmless(text));
    }
    let lines = filled(text, WIDTH - margin.len() - 3);
    let mut fenced = false;
    let mut block = format!("{margin}/*\n");
    let mut lines = lines.into_iter().peekable();
    while let Some(line) = lines.next() {
        if line.starts_with("```") {
            if fenced && lines.peek().is_some_and(|next| !next.is_empty()) {
                block.push_str(&format!("{margin} *\n"));
            }
            fenced = !fenced;
            continue;
        }
        let line = harmless(&line);
        match (fenced, line.is_empty()) {
            (_, true) => block.push_str(&format!("{margin} *\n")),
            (true, false) => block.push_str(&format!("{margin} *     {line}\n")),
            (false, false) => block.push_str(&format!("{margin} * {line}\n")),
        }
    }
    block.push_str(&format!("{margin} */\n"));
    block
}

/// A string literal.
pub(super) fn string(text: &str) -> String {
    let mut literal = String::from("\"");
    for byte in text.bytes() {
        match byte {
            b'"' | b'\\' | b'?' => literal.push_str(&format!("\\{}", char::from(byte))),
            b' '..=b'~' => literal.push(char::from(byte)),
            // Three octal digits end by themselves, whereas hexadecimal ones run on.
            _ => literal.push_str(&format!("\\{byte:03o}")),
        }
    }
    literal.push('"');
    literal
}

#[cfg(test)]
mod tests {
    use super::{comment, doc, signature, statement, string};

    #[test]
    fn comments_end_where_they_should() {
        assert_eq!(comment(1, "a */ b /* c"), "    /* a * / b / * c */\n");
        assert_eq!(doc(0, "one\n\n```text\nx = 1\n```\n"), "/*\n * one\n *\n *     x = 1\n */\n");
        assert_eq!(string("N*s^2 \"Ω??/"), "\"N*s^2 \\\"\\316\\251\\?\\?/\"");
    }

    #[test]
    fn signatures_are_broken_between_parameters() {
        let parameter = "const a_long_name_of_a_model_motion *motion";
        let text = signature("void", "a_long_name_of_a_model_regressor", &[parameter, parameter, "double x"]);
        assert_eq!(text, format!("void a_long_name_of_a_model_regressor({parameter},\n        {parameter}, double x)"));
    }

    #[test]
    fn long_statements_are_broken_at_spaces() {
        let text = vec!["a"; 80].join(" + ");
        let lines = statement(1, &text);
        assert!(lines.lines().all(|line| line.len() <= 100) && lines.lines().count() > 3, "{lines}");
        assert_eq!(lines.split_whitespace().collect::<Vec<_>>().join(" "), text);
    }
}
