//! Text for people: tables and numbers for a terminal, remedies as data, and files that are written whole.

mod file;
mod remedy;
mod table;
mod uncertain;

pub use file::write_whole;
pub use remedy::Remedy;
pub use table::{Align, TextTable, combination, number};
pub use uncertain::{Cut, beside, cells, digits, exact, plus_minus};
