//! Writers: tables and sources, from what the exact engine computed.
//!
//! Invariant: a writer decides no mathematics; it prints what it is given, all of it, and twice the same.

pub mod table;
