//! Emitters: tables and sources from the results of the exact engine.
//!
//! The steps, arguments and documentation of a function are decided once (`function`, over the steps of `code`). A
//! language prints them and adds what is specific to it: types, conversions, a trait, a solver.
//!
//! Invariant: an emitter decides no mathematics. It prints everything that it is given, and equal inputs give equal
//! bytes.

#[cfg(feature = "generate")]
pub mod c;
mod campaign;
#[cfg(feature = "generate")]
pub(crate) mod casadi;
mod code;
pub mod estimator;
pub mod filter;
mod formulas;
mod function;
mod header;
#[cfg(feature = "generate")]
pub(crate) mod infix;
mod jumps;
pub mod name;
mod names;
pub mod number;
pub mod part;
#[cfg(feature = "generate")]
pub mod regulator;
mod requested;
#[cfg(feature = "generate")]
pub mod rounding;
mod run;
pub mod rust;
pub mod specialise;
#[cfg(feature = "generate")]
pub(crate) mod structured_text;
pub mod table;
mod text;
