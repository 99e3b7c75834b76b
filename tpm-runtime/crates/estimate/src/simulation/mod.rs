//! One likelihood of a simulated record: parameters, motion, noise and what the model lacks that explain every reading together.
//!
//! The model `Phi(q, q', ...) theta + known + F c = B u + w` is simulated from each reading to the next, from a state at every reading that is
//! unknown; readings are `y = x + H c + e`. The parameters theta are integrated out, the coefficients c of terms that the model may lack are
//! normal with variances that the likelihood tells, w is white noise of the forces (or of the first order), e white noise of the sensors with
//! a colour where there is one. With much noise of the forces this is the regression of the rows, without any it is output error: how much
//! there is, the likelihood says, so that there is nothing to choose between the two. Every way to explain a record, and every start, is an
//! optimum of the same function
//!
//! ```text
//! -2 log p = sum log S + 2 log |R_theta| + left + log |V| + z2' V^-1 z2
//! ```
//!
//! and the lowest is handed out. Readings have their own times; where a record is cut, the motion begins anew.
//!
//! ```text
//! record (readings, inputs, instants) -> problem (model along it, linearised) -> chain -> filter (innovations, motion), triangle -> noise
//!   -> begin (first motion), terms (library of the lines) -> fit (one optimum) -> rule (which is handed out)
//! ```

mod begin;
mod chain;
mod filter;
mod fit;
#[cfg(test)]
mod fit_tests;
mod noise;
mod problem;
mod record;
mod rule;
mod terms;
mod triangle;

pub use record::{Evenly, Reading, Record};
pub use rule::{Asked, Explained, Outcome, Question, Simulation, Variant};
