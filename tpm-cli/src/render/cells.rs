//! Tables that are written in several ways.

use tpm_runtime::report::{Align, TextTable};

/// Cells under a head, the first columns of text.
pub(crate) struct Cells {
    head: Vec<String>,
    text_columns: usize,
    rows: Vec<Vec<String>>,
}

impl Cells {
    /// A table without rows.
    pub(crate) fn new(head: &[&str], text_columns: usize) -> Self {
        Self { head: head.iter().map(|name| (*name).to_owned()).collect(), text_columns, rows: Vec::new() }
    }

    /// Adds a row.
    pub(crate) fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }

    /// The table for a terminal.
    pub(crate) fn text(&self) -> String {
        let align = |i: usize| if i < self.text_columns { Align::Left } else { Align::Right };
        let head: Vec<_> = self.head.iter().enumerate().map(|(i, name)| (name.as_str(), align(i))).collect();
        let mut table = TextTable::new(&head);
        self.rows.iter().for_each(|row| table.row(row));
        table.finish()
    }

    /// The table for a document.
    pub(crate) fn markdown(&self) -> String {
        let mark = |i: usize| if i < self.text_columns { "---" } else { "--:" }.to_owned();
        let marks: Vec<String> = (0..self.head.len()).map(mark).collect();
        let rows = [&self.head, &marks].into_iter().chain(&self.rows);
        rows.fold(String::new(), |text, row| text + "| " + &row.join(" | ") + " |\n")
    }

    /// The table for a spreadsheet.
    pub(crate) fn csv(&self) -> String {
        std::iter::once(&self.head).chain(&self.rows).fold(String::new(), |text, row| text + &row.join(",") + "\n")
    }
}
