//! Exact numbers: rationals of any size, and the bounded integers over common denominators in which tables are
//! multiplied out.
//!
//! [`rational`] has the type, its constructors and the one rounding to a float; how a rational is stored is private.

pub(crate) mod buffers;
pub(crate) mod denominator;
pub(crate) mod numerator;
pub(crate) mod prime;
pub mod rational;
mod representation;
pub(crate) mod scalar;
pub(crate) mod values;
pub(crate) mod wide;
pub(crate) mod words;
