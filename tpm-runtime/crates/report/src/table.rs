//! Tables, numbers and linear combinations as text for a terminal.

use std::collections::BTreeMap;

/// How a column is aligned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// Text.
    Left,
    /// Numbers.
    Right,
    /// Numbers, aligned at their decimal points.
    Decimal,
}

/// Rows of cells under a head, for a terminal.
#[derive(Clone, Debug)]
pub struct TextTable {
    align: Vec<Align>,
    rows: Vec<Vec<String>>,
}

impl TextTable {
    /// A table with a head.
    #[must_use]
    pub fn new(head: &[(&str, Align)]) -> Self {
        let names = head.iter().map(|(name, _)| (*name).to_owned()).collect();
        Self { align: head.iter().map(|(_, align)| *align).collect(), rows: vec![names] }
    }

    /// Adds a row; missing cells are empty.
    pub fn row(&mut self, cells: &[String]) {
        let mut cells = cells.to_vec();
        cells.resize(self.align.len(), String::new());
        self.rows.push(cells);
    }

    /// The text, columns two spaces apart, no trailing spaces.
    #[must_use]
    pub fn finish(&self) -> String {
        let columns: Vec<Vec<String>> = (0..self.align.len()).map(|column| self.aligned(column)).collect();
        let mut text = String::new();
        for row in 0..self.rows.len() {
            let mut line = String::new();
            for column in &columns {
                line.push_str(&column[row]);
                line.push_str("  ");
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }

    /// The cells of a column with their head, all of one width.
    fn aligned(&self, column: usize) -> Vec<String> {
        let align = self.align[column];
        let mut cells: Vec<String> = self.rows.iter().map(|row| row[column].clone()).collect();
        if align == Align::Decimal {
            let behind = |cell: &String| cell.len() - cell.find(['.', 'e']).unwrap_or(cell.len());
            let most = cells.iter().skip(1).map(behind).max().unwrap_or(0);
            for cell in cells.iter_mut().skip(1) {
                let missing = most - behind(cell);
                cell.push_str(&" ".repeat(missing));
            }
        }
        let width = cells.iter().map(|cell| cell.chars().count()).max().unwrap_or(0);
        let pad = |cell: String| {
            let padding = " ".repeat(width - cell.chars().count());
            if align == Align::Left { cell + &padding } else { padding + &cell }
        };
        cells.into_iter().map(pad).collect()
    }
}

/// The text of a value; a dash where there is none.
pub fn or_dash<T>(value: Option<T>, text: impl FnOnce(T) -> String) -> String {
    value.map_or_else(|| "-".to_owned(), text)
}

/// Most names that a sentence lists, and how many it lists of more.
const MOST_NAMES: usize = 12;
const FIRST_NAMES: usize = 6;

/// Names that a person reads: of many the first ones, and how many there are more.
#[must_use]
pub fn listed(names: &[String]) -> String {
    match names.len().checked_sub(FIRST_NAMES) {
        Some(more) if names.len() > MOST_NAMES => format!("{} and {more} others", names[..FIRST_NAMES].join(", ")),
        _ => names.join(", "),
    }
}

/// A number with six significant digits, without an exponent where its magnitude is at least 1e-4 and below 1e7.
#[must_use]
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let magnitude = value.abs().log10().floor();
    if !(-4.0..7.0).contains(&magnitude) {
        return format!("{value:.5e}");
    }
    let decimals = (5.0 - magnitude).max(0.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A linear combination for reading, such as `0.40647 a10 - a20`, from the weight of every name.
#[must_use]
pub fn combination(direction: &BTreeMap<String, String>) -> String {
    let mut text = String::new();
    for (name, weight) in direction {
        let (sign, size) = weight.strip_prefix('-').map_or((" + ", weight.as_str()), |size| (" - ", size));
        text.push_str(match (text.is_empty(), sign) {
            (false, sign) => sign,
            (true, " - ") => "-",
            (true, _) => "",
        });
        let size = size.parse().map_or_else(|_| size.to_owned(), number);
        text.push_str(&if size == "1" { name.clone() } else { format!("{size} {name}") });
    }
    text
}

#[cfg(test)]
mod tests {
    use super::{Align, TextTable, number};

    #[test]
    fn numbers_have_six_significant_digits() {
        assert_eq!(number(95.108_94), "95.1089");
        assert_eq!(number(-0.001_234_567_8), "-0.00123457");
        assert_eq!(number(5.371_5e-6), "5.37150e-6");
        assert_eq!(number(0.0), "0");
        assert_eq!(number(2.0), "2");
        assert_eq!(number(1e9), "1.00000e9");
    }

    #[test]
    fn columns_line_up() {
        let mut table = TextTable::new(&[("name", Align::Left), ("value", Align::Right)]);
        table.row(&["m".to_owned(), "2".to_owned()]);
        table.row(&["long name".to_owned(), "12.5".to_owned()]);
        assert_eq!(table.finish(), "name       value\nm              2\nlong name   12.5\n");
    }

    #[test]
    fn decimal_points_stand_below_each_other() {
        let mut table = TextTable::new(&[("v", Align::Decimal), ("", Align::Left)]);
        for cell in ["2.00014", "-40.002", "-", "3.756e-5", "1500"] {
            table.row(&[cell.to_owned(), "x".to_owned()]);
        }
        let lines =
            ["          v", "   2.00014   x", " -40.002     x", "   -         x", "   3.756e-5  x", "1500         x"];
        assert_eq!(table.finish().lines().collect::<Vec<_>>(), lines);
    }
}
