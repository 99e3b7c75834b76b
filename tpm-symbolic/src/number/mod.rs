//! Exact numbers: rationals of any size, and the bounded integers over common denominators that tables are multiplied out in.

pub(crate) mod denominator;
pub(crate) mod numerator;
pub mod rational;
mod representation;
