//! The page as HTML, from the little Markdown that the chapters use: headings, paragraphs, lists, tables, figures, emphasis.

use std::fmt::Write as _;

const HEAD: &str = "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>\
<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/><title>Both papers, computed again</title><style>\n\
body{margin:0 auto;padding:1.5rem 1.25rem 4rem;max-width:72rem;font:16px/1.5 system-ui,\"DejaVu Sans\",sans-serif;color:#1b1f24;background:#fff}\n\
h2{margin-top:2.5rem;border-bottom:1px solid #d8dee4}p,li{max-width:54rem}.scroll{overflow-x:auto;margin:.75rem 0}\n\
table{border-collapse:collapse;font-size:.9rem;font-variant-numeric:tabular-nums}th,td{padding:.25rem .6rem;border-bottom:1px solid #d8dee4;text-align:left;vertical-align:top}\n\
th{color:#57606a}code{font:.92em \"DejaVu Sans Mono\",monospace}figure{margin:1.25rem 0}figure svg{display:block;width:100%;max-width:60rem;height:auto}\n\
figcaption{color:#57606a;font-size:.9rem}nav a{margin-right:.9rem}\n\
@media print{body{max-width:none;font-size:10.5pt}tr,figure{break-inside:avoid}}\n</style></head><body>\n";

/// A formula in the text, whose products are no emphasis.
pub(super) fn formula(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!("`{text}`") }
}

/// The page; `figures` are the files that the text names, with their content.
pub(super) fn html(markdown: &str, figures: &[(String, String)]) -> String {
    let mut out = String::from(HEAD);
    let headings: Vec<&str> = markdown.lines().filter_map(|line| line.strip_prefix("## ")).collect();
    let blocks = markdown.split("\n\n").map(str::trim).filter(|block| !block.is_empty());
    let mut section = 0;
    for block in blocks {
        if let Some(title) = block.strip_prefix("# ") {
            let _ = writeln!(out, "<h1>{}</h1>\n<nav>", inline(title));
            for (number, heading) in headings.iter().enumerate() {
                let _ = writeln!(out, "<a href=\"#s{number}\">{}</a>", inline(heading));
            }
            out.push_str("</nav>\n");
        } else if let Some(title) = block.strip_prefix("### ") {
            let _ = writeln!(out, "<h3>{}</h3>", inline(title));
        } else if let Some(title) = block.strip_prefix("## ") {
            let _ = writeln!(out, "<h2 id=\"s{section}\">{}</h2>", inline(title));
            section += 1;
        } else if block.starts_with("| ") {
            table(&mut out, block);
        } else if block.starts_with("- ") {
            out.push_str("<ul>\n");
            for item in block.lines() {
                let _ = writeln!(out, "<li>{}</li>", inline(item.trim_start_matches("- ")));
            }
            out.push_str("</ul>\n");
        } else if let Some((caption, name)) = image(block) {
            let svg = figures.iter().find(|(file, _)| file == name).map_or("", |(_, svg)| svg.as_str());
            // What stands before the element is a file's, not a page's.
            let svg = svg.find("<svg").map_or("", |start| &svg[start..]);
            let _ = writeln!(out, "<figure>{svg}<figcaption>{}</figcaption></figure>", inline(caption));
        } else {
            let _ = writeln!(out, "<p>{}</p>", inline(block));
        }
    }
    out.push_str("</body></html>\n");
    out
}

/// The caption and the file of `![caption](file)`.
fn image(block: &str) -> Option<(&str, &str)> {
    let (caption, name) = block.strip_prefix("![")?.strip_suffix(')')?.split_once("](")?;
    Some((caption, name))
}

fn table(out: &mut String, block: &str) {
    out.push_str("<div class=\"scroll\"><table>\n");
    let cells = |line: &str| -> Vec<String> {
        line.trim().trim_matches('|').split('|').map(|cell| inline(cell.trim())).collect()
    };
    for (row, line) in block.lines().enumerate() {
        let (open, close) = if row == 0 { ("<th>", "</th>") } else { ("<td>", "</td>") };
        // The second line separates the head.
        if row != 1 {
            let cells: String = cells(line).iter().map(|cell| format!("{open}{cell}{close}")).collect();
            let _ = writeln!(out, "<tr>{cells}</tr>");
        }
    }
    out.push_str("</table></div>\n");
}

/// Text with its emphasis and code, everything else escaped.
fn inline(text: &str) -> String {
    let escaped = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let mut out = String::new();
    for (number, part) in escaped.split('`').enumerate() {
        if number % 2 == 1 {
            let _ = write!(out, "<code>{part}</code>");
            continue;
        }
        for (number, part) in part.split("**").enumerate() {
            if number % 2 == 1 {
                let _ = write!(out, "<strong>{part}</strong>");
            } else {
                out.push_str(&emphasised(part));
            }
        }
    }
    out
}

/// Stars around words as emphasis; a star of a product stands between two letters or digits and stays.
fn emphasised(text: &str) -> String {
    let mut out = String::new();
    let mut open = false;
    let letters: Vec<char> = text.chars().collect();
    for (at, &letter) in letters.iter().enumerate() {
        let before = at.checked_sub(1).and_then(|at| letters.get(at)).is_some_and(|c| c.is_alphanumeric());
        let after = letters.get(at + 1).is_some_and(|c| c.is_alphanumeric());
        match (letter, open) {
            ('*', false) if after && !before => out.push_str("<em>"),
            ('*', true) if before || !after => out.push_str("</em>"),
            _ => {
                out.push(letter);
                continue;
            }
        }
        open = !open;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::html;

    #[test]
    fn tables_figures_and_products_come_out_as_they_are_meant() {
        let text = "# T\n\nA *b c*, `x<y`, m*L*w and **d**.\n\n## S\n\n| a | b |\n|---|---|\n| 1 | |\n\n![f](f.svg)\n\n- one\n- two\n";
        let page = html(text, &[("f.svg".to_owned(), "<?xml?><svg id=\"f\"></svg>".to_owned())]);
        for part in [
            "<p>A <em>b c</em>, <code>x&lt;y</code>, m*L*w and <strong>d</strong>.</p>",
            "<h2 id=\"s0\">S</h2>",
            "<tr><td>1</td><td></td></tr>",
            "<figure><svg id=\"f\"></svg><figcaption>f</figcaption></figure>",
            "<li>two</li>",
        ] {
            assert!(page.contains(part), "{part}\n{page}");
        }
    }
}
