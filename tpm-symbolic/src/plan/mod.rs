//! Straight-line plans: what interpreter and writers execute, operation by operation, with exact constants.

pub mod dynamics;
pub mod estimator;
pub mod evaluation;
mod factored;
mod sharing;
pub mod split;
pub mod straight_line;
