//! A harmonic coefficient table as text: CSV for machines, Markdown for reading, LaTeX for papers.
//!
//! Invariant: every entry of the table appears exactly once in each form, with its exact coefficient.

use num_traits::{One, Signed};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::harmonic::table::{Entry, HarmonicTable, Tail};
use tpm_symbolic::number::rational::{self, Rational};

/// One line per entry, with the columns of the JSON form; `powers` and `sign` as `lambda^2 w^2`.
#[must_use]
pub fn csv(table: &HarmonicTable) -> String {
    table.announce_text();
    let mut text = String::from("equation,harmonic,function,parameter,coefficient,pi,powers,sign\n");
    for entry in table.entries() {
        let parameter = entry.column.map_or("", |column| table.parameters[column].as_str());
        let plain = |factors: Vec<(String, i32)>| {
            let power =
                |(name, exponent): (String, i32)| if exponent == 1 { name } else { format!("{name}^{exponent}") };
            factors.into_iter().map(power).collect::<Vec<_>>().join(" ")
        };
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{}",
            table.equations[entry.equation],
            entry.harmonic,
            entry.function.name(),
            parameter,
            entry.coefficient,
            entry.pi,
            plain(named(table, entry.powers.factors())),
            plain(named(table, entry.sign.factors())),
        );
    }
    text
}

fn named<'a>(table: &HarmonicTable, factors: impl Iterator<Item = (&'a usize, i32)>) -> Vec<(String, i32)> {
    factors.map(|(&symbol, exponent)| (table.symbols[symbol].to_string(), exponent)).collect()
}

/// The entries of one row, by column.
type RowEntries = BTreeMap<Option<usize>, Vec<Entry>>;

/// Rows of one equation: (harmonic, function) -> entries by column.
fn grouped(table: &HarmonicTable, equation: usize) -> BTreeMap<(usize, Trig), RowEntries> {
    let mut rows: BTreeMap<(usize, Trig), RowEntries> = BTreeMap::new();
    for entry in table.entries().filter(|entry| entry.equation == equation) {
        let row = rows.entry((entry.harmonic, entry.function)).or_default();
        row.entry(entry.column).or_default().push(entry);
    }
    rows
}

/// The columns that occur in an equation, unknown parameters first, known terms last.
fn columns(rows: &BTreeMap<(usize, Trig), RowEntries>) -> Vec<Option<usize>> {
    let mut columns: Vec<Option<usize>> = rows.values().flat_map(|row| row.keys().copied()).collect();
    columns.sort_by_key(|column| (column.is_none(), *column));
    columns.dedup();
    columns
}

/// Largest width, in characters, to which the cells of a column are padded.
const WIDEST: usize = 4096;

/// One table per equation: rows are harmonics, columns parameters, as Feng prints Eqns 3.27 and 4.44.
#[must_use]
pub fn markdown(table: &HarmonicTable) -> String {
    table.announce_text();
    let mut text = format!("# Harmonic coefficient table of {}\n", table.model);
    for (equation, name) in table.equations.iter().enumerate() {
        let rows = grouped(table, equation);
        let columns = columns(&rows);
        let _ = writeln!(text, "\n## {name}\n");
        if rows.is_empty() {
            text.push_str("No harmonic: every coefficient is zero.\n");
            continue;
        }
        let head =
            |column: &Option<usize>| column.map_or("known", |column| table.parameters[column].as_str()).to_owned();
        let mut lines =
            vec![std::iter::once("harmonic".to_owned()).chain(columns.iter().map(head)).collect::<Vec<_>>()];
        for ((harmonic, function), row) in &rows {
            let label = if *harmonic == 0 { "1".to_owned() } else { format!("{} {harmonic}", function.name()) };
            let cell = |column: &Option<usize>| {
                let entries = row.get(column).map_or(&[][..], Vec::as_slice);
                join_signed(entries.iter().map(|entry| plain_entry(table, entry)))
            };
            lines.push(std::iter::once(label).chain(columns.iter().map(cell)).collect());
        }
        write_aligned(&mut text, &lines);
    }
    if table.entries().any(|entry| !entry.sign.is_one()) {
        text.push_str("\nEntries with `sgn` hold for amplitudes of either sign; w > 0.\n");
    }
    if !table.constants.is_empty() {
        text.push_str("\n## Constants\n\n");
        for constant in &table.constants {
            let _ = writeln!(text, "- {} = {}", constant.name, constant.definition);
        }
    }
    text
}

/// The width of a cell for padding; zero for a cell that is too wide for any screen.
fn width_of(cell: &str) -> usize {
    let width = cell.chars().count();
    if width > WIDEST { 0 } else { width }
}

/// Markdown rows padded to equal width, so that the source reads as a table too.
fn write_aligned(text: &mut String, lines: &[Vec<String>]) {
    let columns = lines.first().map_or(0, Vec::len);
    let widths: Vec<usize> =
        (0..columns).map(|c| lines.iter().map(|line| width_of(&line[c])).max().unwrap_or(0).max(3)).collect();
    for (i, line) in lines.iter().enumerate() {
        for (cell, width) in line.iter().zip(&widths) {
            // Padding by a format specification is limited to 65,535 characters.
            let padding = width.saturating_sub(cell.chars().count());
            let _ = write!(text, "| {cell}{} ", " ".repeat(padding));
        }
        text.push_str("|\n");
        if i == 0 {
            for width in &widths {
                let _ = write!(text, "|{}", "-".repeat(width + 2));
            }
            text.push_str("|\n");
        }
    }
}

/// Joins terms, turning `+ -a` into `- a`.
fn join_signed(terms: impl Iterator<Item = (bool, String)>) -> String {
    let mut text = String::new();
    for (i, (negative, term)) in terms.enumerate() {
        text.push_str(match (i, negative) {
            (0, false) => "",
            (0, true) => "-",
            (_, false) => " + ",
            (_, true) => " - ",
        });
        text.push_str(&term);
    }
    text
}

/// Sign and magnitude of an entry, as `55/27 lambda1 lambda2^2 w^2`.
fn plain_entry(table: &HarmonicTable, entry: &Entry) -> (bool, String) {
    let magnitude = rational::abs(&entry.coefficient);
    let mut factors = Vec::new();
    if entry.pi != 0 {
        factors.push(if entry.pi == 1 { "pi".to_owned() } else { format!("pi^{}", entry.pi) });
    }
    for (name, exponent) in named(table, entry.powers.factors()) {
        factors.push(if exponent == 1 { name } else { format!("{name}^{exponent}") });
    }
    for (name, _) in named(table, entry.sign.factors()) {
        factors.push(format!("sgn({name})"));
    }
    if factors.is_empty() || !magnitude.is_one() {
        factors.insert(0, magnitude.to_string());
    }
    (entry.coefficient.is_negative(), factors.join(" "))
}

/// A complete document for pdflatex: each equation as a sum over harmonics, as Feng prints Eqns 3.26, B.1 and B.2.
#[must_use]
pub fn latex(table: &HarmonicTable) -> String {
    table.announce_text();
    let mut text = String::from(
        "\\documentclass{article}\n\\usepackage{amsmath}\n\\usepackage[margin=2cm]{geometry}\n\\allowdisplaybreaks\n\\begin{document}\n",
    );
    let _ = writeln!(text, "\\section*{{Harmonic coefficient table of {}}}", escape(&table.model));
    let frequency = table.symbols.iter().position(|symbol| symbol == "w");
    for (equation, name) in table.equations.iter().enumerate() {
        let rows = grouped(table, equation);
        let _ = writeln!(text, "\\begin{{align*}}\n{} ={{}}&", symbol(name));
        if rows.is_empty() {
            text.push('0');
        }
        for (i, ((harmonic, function), row)) in rows.iter().enumerate() {
            let mut terms: Vec<(bool, String)> = Vec::new();
            for column in columns(&BTreeMap::from([((*harmonic, *function), row.clone())])) {
                terms.extend(row[&column].iter().map(|entry| latex_entry(table, entry)));
            }
            if i > 0 {
                text.push_str("\\\\\n&+");
            }
            // Long sums are broken after every few terms; \Bigl and \Bigr may stand on different lines.
            text.push_str("\\Bigl[");
            for (j, chunk) in terms.chunks(4).enumerate() {
                if j > 0 {
                    text.push_str("\\\\\n&\\qquad{}");
                    text.push_str(if chunk[0].0 { "" } else { "+" });
                }
                text.push_str(&join_signed(chunk.iter().cloned()));
            }
            text.push_str("\\Bigr]");
            if *harmonic > 0 {
                let phase = frequency.map_or_else(|| "\\omega".to_owned(), |index| symbol(&table.symbols[index]));
                let multiple = if *harmonic == 1 { String::new() } else { harmonic.to_string() };
                let _ = write!(text, "\\{} {multiple}{phase} t", function.name());
            }
        }
        text.push_str("\n\\end{align*}\n");
    }
    for constant in &table.constants {
        let _ =
            writeln!(text, "\\par\\noindent\\texttt{{{} = {}}}", escape(&constant.name), escape(&constant.definition));
    }
    text.push_str("\\end{document}\n");
    text
}

fn latex_entry(table: &HarmonicTable, entry: &Entry) -> (bool, String) {
    let magnitude = rational::abs(&entry.coefficient);
    let mut text = latex_number(&magnitude, entry.pi);
    if let Some(column) = entry.column {
        text.push_str(&symbol(&table.parameters[column]));
    }
    for (name, exponent) in named(table, entry.powers.factors()) {
        let base = symbol(&name);
        text.push_str("\\,");
        text.push_str(&if exponent == 1 { base } else { format!("{{{base}}}^{{{exponent}}}") });
    }
    for (name, _) in named(table, entry.sign.factors()) {
        let _ = write!(text, "\\,\\operatorname{{sgn}}{}", symbol(&name));
    }
    if text.is_empty() {
        text.push('1');
    }
    (entry.coefficient.is_negative(), text)
}

fn latex_number(magnitude: &Rational, pi: i32) -> String {
    let power = |exponent: i32| if exponent == 1 { "\\pi".to_owned() } else { format!("\\pi^{{{exponent}}}") };
    let mut above = if magnitude.numer().is_one() { String::new() } else { magnitude.numer().to_string() };
    let mut below = if magnitude.denom().is_one() { String::new() } else { magnitude.denom().to_string() };
    match pi {
        0 => {}
        n if n > 0 => above.push_str(&power(n)),
        n => below.push_str(&power(-n)),
    }
    if below.is_empty() {
        return above;
    }
    format!("\\tfrac{{{}}}{{{below}}}", if above.is_empty() { "1" } else { &above })
}

/// A name in mathematics: Greek names become Greek, a trailing number becomes a subscript, `w` is the frequency.
fn symbol(name: &str) -> String {
    const GREEK: [&str; 22] = [
        "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu",
        "xi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega", "pi",
    ];
    let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
    let digits = &name[stem.len()..];
    let base = match stem {
        "w" => "\\omega".to_owned(),
        "th" => "\\theta".to_owned(),
        stem if GREEK.contains(&stem) => format!("\\{stem}"),
        stem if stem.chars().count() == 1 => stem.to_owned(),
        _ => return format!("\\mathit{{{}}}", escape(name)),
    };
    if digits.is_empty() { base } else { format!("{base}_{{{digits}}}") }
}

fn escape(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '_' | '%' | '&' | '#' | '$' | '{' | '}' => {
                out.push('\\');
                out.push(c);
            }
            '\\' => out.push_str("\\textbackslash{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '^' => out.push_str("\\textasciicircum{}"),
            c => out.push(c),
        }
    }
    out
}

/// Sentence on the harmonics that a table leaves out of an infinite series.
#[must_use]
pub fn left_out(table: &HarmonicTable, tail: &Tail) -> String {
    let factors: Vec<String> = tail
        .powers
        .factors()
        .map(|(&symbol, power)| match power {
            1 => format!("*|{}|", table.symbols[symbol]),
            _ => format!("*|{}|^{power}", table.symbols[symbol]),
        })
        .collect();
    let factors = factors.concat();
    let term =
        tail.column.map_or_else(|| "the known terms".to_owned(), |column| format!("`{}`", table.parameters[column]));
    let maximum = match tail.maximum {
        Some(maximum) => format!("at most {maximum:.3e}{factors}"),
        None => "a jump, which no number of harmonics makes small everywhere".to_owned(),
    };
    format!(
        "{term} in {} has infinitely many harmonics, of which those above {} are left out: rms {:.3e}{factors}, {maximum}",
        table.equations[tail.equation], tail.harmonics, tail.rms
    )
}

#[cfg(test)]
mod tests {
    use super::{csv, latex, markdown, symbol};
    use tpm_symbolic::harmonic::table::HarmonicTable;

    /// Two entries of Feng, Eqn 3.26, one of a dry friction, in the contract's JSON.
    fn table() -> HarmonicTable {
        let json = r#"{"schema": "tpm.table/1", "model": "Drag_1", "parameters": ["m", "k2", "m_L"], "entries": [
            {"equation": "u", "harmonic": 0, "function": "cos", "parameter": "k2", "coefficient": "5/9", "powers": {"lambda": 2, "w": 2}},
            {"equation": "u", "harmonic": 1, "function": "cos", "parameter": "m", "coefficient": "-1", "powers": {"lambda": 1, "w": 2}},
            {"equation": "u", "harmonic": 1, "function": "cos", "parameter": "m_L", "coefficient": "3", "powers": {}},
            {"equation": "u", "harmonic": 1, "function": "sin", "parameter": null, "coefficient": "-4/3", "pi": -1, "sign": {"lambda": 1}}]}"#;
        serde_json::from_str(json).expect("a table in the contract's form")
    }

    #[test]
    fn csv_has_a_line_for_every_entry() {
        let expected = "equation,harmonic,function,parameter,coefficient,pi,powers,sign\n\
            u,0,cos,k2,5/9,0,lambda^2 w^2,\n\
            u,1,cos,m,-1,0,lambda w^2,\n\
            u,1,cos,m_L,3,0,,\n\
            u,1,sin,,-4/3,-1,,lambda\n";
        assert_eq!(csv(&table()), expected);
    }

    #[test]
    fn markdown_is_a_matrix_of_harmonics_and_parameters() {
        let text = markdown(&table());
        assert!(text.contains("| cos 1    | -lambda w^2 |"), "{text}");
        assert!(text.contains("-4/3 pi^-1 sgn(lambda)"), "{text}");
        assert!(text.contains("known"), "{text}");
    }

    #[test]
    fn latex_escapes_names_and_breaks_nothing() {
        let text = latex(&table());
        assert!(text.contains("\\tfrac{5}{9}k_{2}\\,{\\lambda}^{2}\\,{\\omega}^{2}"), "{text}");
        assert!(text.contains("-\\tfrac{4}{3\\pi}\\,\\operatorname{sgn}\\lambda"), "{text}");
        assert_eq!(
            text.matches('{').count() - text.matches("\\{").count(),
            text.matches('}').count() - text.matches("\\}").count()
        );
        assert_eq!(symbol("m_L"), "\\mathit{m\\_L}");
        assert_eq!(symbol("th20"), "\\theta_{20}");
    }
}
