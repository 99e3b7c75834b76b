//! Text for people: tables and numbers for a terminal, remedies as data, and files that are written whole.

mod displayed;
#[cfg(feature = "schema")]
mod fields;
mod file;
mod remedy;
mod table;
mod temporary;
mod uncertain;

pub use displayed::displayed;
#[cfg(feature = "schema")]
pub use fields::{FieldText, fields};
#[cfg(feature = "faults")]
pub use file::faults;
pub use file::{MOST_TEXT, is_special, read_input, read_text, write_output, write_whole};
pub use remedy::Remedy;
pub use table::{Align, TextTable, combination, listed, number, or_dash};
pub use temporary::TEMPORARY;
pub use uncertain::{Cut, beside, cells, digits, exact, plus_minus, probability};
