//! The elements of a page as data.

use crate::marks::Interval;
use serde::Serialize;
use tpm_plot::Figure;
use tpm_report::{digits, number};

/// Significant digits of shares and of root mean squares, which themselves are known to a percent or so.
pub(super) const SHARE_DIGITS: usize = 3;

/// A cell of a table.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct Cell {
    /// The displayed text.
    text: String,
    /// The number that the text shows, with all its digits.
    value: Option<f64>,
    /// An interval that is drawn instead of text.
    interval: Option<Interval>,
}

impl Cell {
    pub(super) fn text(text: impl Into<String>) -> Self {
        Cell { text: text.into(), ..Cell::default() }
    }

    /// A number that is shown as `text`.
    pub(super) fn shown(text: impl Into<String>, value: Option<f64>) -> Self {
        Cell { text: text.into(), value: value.filter(|value| value.is_finite()), ..Cell::default() }
    }

    /// A number with six digits; a dash where there is none.
    pub(super) fn number(value: Option<f64>) -> Self {
        Cell::shown(value.map_or_else(|| "-".to_owned(), number), value)
    }

    /// A root mean square or a condition number with three digits, which suffice for comparisons.
    pub(super) fn size(value: Option<f64>) -> Self {
        Cell::shown(value.map_or_else(|| "-".to_owned(), |value| digits(value, SHARE_DIGITS)), value)
    }

    /// A share in percent.
    pub(super) fn percent(share: Option<f64>) -> Self {
        Cell::shown(
            share.map_or_else(|| "-".to_owned(), |share| format!("{} %", digits(100.0 * share, SHARE_DIGITS))),
            share,
        )
    }

    pub(super) fn interval(interval: Option<Interval>) -> Self {
        Cell { interval, ..Cell::default() }
    }
}

/// Heading of a column.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Column {
    name: String,
    /// Whether the column holds numbers.
    number: bool,
}

/// A message about a problem or an action.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Notice {
    pub(super) text: String,
    pub(super) remedy: Option<String>,
    /// Whether the problem makes numbers untrustworthy.
    pub(super) grave: bool,
}

/// One part of a section.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(super) enum Block {
    Text {
        text: String,
    },
    Facts {
        rows: Vec<(String, String)>,
    },
    Table {
        columns: Vec<Column>,
        rows: Vec<Vec<Cell>>,
        caption: String,
        /// Whether it stands for a matrix before, on screens that have no room for that.
        narrow: bool,
    },
    Notices {
        list: Vec<Notice>,
    },
    Matrix {
        names: Vec<String>,
        rows: Vec<Vec<Option<f64>>>,
        /// Whether narrow screens have no room for it, and show the table behind it instead.
        wide: bool,
    },
    /// Equations, each in pieces of MathML between which its line may be broken.
    Equations {
        lines: Vec<Vec<String>>,
    },
    Figure {
        number: usize,
        caption: String,
    },
}

impl Block {
    pub(super) fn text(text: impl ToString) -> Self {
        Block::Text { text: text.to_string() }
    }

    /// A table; columns whose names begin with `#` hold numbers.
    pub(super) fn table(columns: &[&str], rows: Vec<Vec<Cell>>, caption: &str) -> Self {
        let column =
            |name: &&str| Column { name: name.trim_start_matches('#').to_owned(), number: name.starts_with('#') };
        let columns = columns.iter().map(column).collect();
        Block::Table { columns, rows, caption: caption.to_owned(), narrow: false }
    }
}

impl Block {
    /// A table for screens that have no room for the matrix before it.
    pub(super) fn for_narrow(mut self) -> Self {
        if let Block::Table { narrow, .. } = &mut self {
            *narrow = true;
        }
        self
    }

    /// Renames the column `from`.
    pub(super) fn rename(&mut self, from: &str, to: &str) {
        if let Block::Table { columns, .. } = self {
            for column in columns.iter_mut().filter(|column| column.name == from.trim_start_matches('#')) {
                to.clone_into(&mut column.name);
            }
        }
    }
}

/// Blocks under a heading.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Section {
    /// Name of the section in links.
    pub(super) id: &'static str,
    pub(super) title: &'static str,
    pub(super) blocks: Vec<Block>,
}

/// A figure with the name of its file, without extension.
#[derive(Clone, Debug)]
pub(super) struct Named {
    pub(super) name: String,
    pub(super) figure: Figure,
}
