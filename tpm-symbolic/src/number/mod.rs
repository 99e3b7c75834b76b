//! Exact numbers: rationals of any size, and the bounded integers over common denominators with which tables are
//! multiplied out.
//!
//! [`rational`] has the type, its constructors and the single rounding to a float; the representation of a rational is
//! private.

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
