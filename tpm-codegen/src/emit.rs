//! Writers: tables and sources, from what the exact engine computed.
//!
//! Invariant: a writer decides no mathematics; it prints what it is given, all of it, and twice the same.

pub mod estimator;
pub mod name;
pub mod number;
pub mod rust;
pub mod table;
