//! Writers: tables and sources, from what the exact engine computed.
//!
//! What a function computes, reads and is documented with stands once (`function`, over the steps of `code`); a language only prints
//! it and adds what is its own: types, conversions, a trait, a solver.
//!
//! Invariant: a writer decides no mathematics; it prints what it is given, all of it, and twice the same.

#[cfg(feature = "generate")]
pub mod c;
mod code;
pub mod estimator;
pub mod filter;
mod formulas;
mod function;
mod header;
pub mod name;
mod names;
pub mod number;
pub mod part;
#[cfg(feature = "generate")]
pub mod regulator;
mod requested;
pub mod rust;
pub mod table;
mod text;
