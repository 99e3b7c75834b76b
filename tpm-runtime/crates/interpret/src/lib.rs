//! Interpreted models: the evaluation plans of a model file, executed operation by operation without a compiler.
//!
//! Invariant: the operations are those of the plans of [`tpm_symbolic::plan`], in the same order, each rounded once, so
//! that the results equal those of the emitted code.

mod base_rows;
#[cfg(test)]
mod base_rows_tests;
mod derivatives;
#[cfg(test)]
mod derivatives_tests;
mod interval;
mod inverse;
mod leaves;
mod model;
pub mod pattern;
mod program;
mod separable;
#[cfg(test)]
mod separable_tests;

pub use base_rows::{BaseRows, RowsAt};
pub use derivatives::InterpretedDerivatives;
pub use interval::Interval;
pub use inverse::InterpretedInverse;
pub use model::Interpreted;
pub use separable::Separable;
