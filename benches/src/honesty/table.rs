//! Tables in Markdown.

use std::collections::BTreeMap;
use std::fmt;

/// A table whose rows are as long as its head.
#[derive(Clone, Debug)]
pub struct Table {
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table without rows.
    #[must_use]
    pub fn new(head: &[&str]) -> Self {
        Table { head: head.iter().map(|&cell| cell.into()).collect(), rows: Vec::new() }
    }

    /// Adds a row.
    pub fn push(&mut self, row: Vec<String>) {
        self.rows.push(row);
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // A bar ends a cell.
        let line =
            |cells: &[String]| format!("| {} |", cells.join("\u{1}").replace('|', "\\|").replace('\u{1}', " | "));
        writeln!(f, "{}", line(&self.head))?;
        writeln!(f, "|{}", "---|".repeat(self.head.len()))?;
        self.rows.iter().try_for_each(|row| writeln!(f, "{}", line(row)))
    }
}

/// A share in percent, and an empty text of nothing.
#[must_use]
pub fn percent(part: usize, whole: usize) -> String {
    if whole == 0 { String::new() } else { format!("{:.1} %", 100.0 * part as f64 / whole as f64) }
}

/// The labels that occur most often with their counts, the most frequent first.
#[must_use]
pub fn most_frequent<'a>(labels: impl Iterator<Item = &'a str>, most: usize) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for label in labels {
        *counts.entry(label).or_default() += 1;
    }
    let mut counts: Vec<(&str, usize)> = counts.into_iter().collect();
    counts.sort_by_key(|&(label, count)| (std::cmp::Reverse(count), label));
    let shown = |(label, count): &(&str, usize)| {
        let short: String = label.chars().take(70).collect();
        format!("{count} x {short}")
    };
    counts.iter().take(most).map(shown).collect::<Vec<_>>().join("; ")
}

/// Yes or no.
#[must_use]
pub fn met(met: bool) -> String {
    if met { "yes" } else { "NO" }.into()
}
