//! A model that is run without being compiled: its evaluation plans, executed operation by operation.
//!
//! Invariant: the operations are those of the plans of [`tpm_symbolic::plan`], in their order and each rounded once, so
//! that the numbers equal those of the emitted code.

mod derivatives;
#[cfg(test)]
mod derivatives_tests;
mod inverse;
mod leaves;
mod model;
pub mod pattern;
mod program;
mod separable;
#[cfg(test)]
mod separable_tests;

pub use derivatives::InterpretedDerivatives;
pub use inverse::InterpretedInverse;
pub use model::Interpreted;
pub use separable::Separable;
