//! Text for people: tables and numbers for a terminal, and remedies as data.

mod remedy;
mod table;

pub use remedy::Remedy;
pub use table::{Align, TextTable, combination, number};
