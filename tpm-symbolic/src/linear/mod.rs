//! Models near a point: Taylor series of terms that do not expand finitely, linearisation at rest, transfer functions.

mod branch;
pub mod jet;
pub mod linearize;
pub mod taylor;
pub mod transfer;
