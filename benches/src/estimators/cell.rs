//! A cell of the tables.

/// A cell of a table, and what is to be said below it.
#[derive(Clone, Debug)]
pub struct Cell {
    /// What the cell shows.
    pub text: String,
    /// Why there is no number, or not the whole of it.
    pub note: Option<String>,
}
