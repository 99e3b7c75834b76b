//! Models near a point: Taylor series of what does not expand finitely, linearisation at rest, transfer functions.

pub mod jet;
pub mod linearize;
pub mod taylor;
pub mod transfer;
