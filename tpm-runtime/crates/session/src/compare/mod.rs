//! What changed between two results of identifications: of one machine with and without a payload, before and after wear, or of
//! two machines of one kind.
//!
//! Both results are taken for independent, so that the covariance of their difference is the sum of their covariances. Every
//! parameter that both show is tested alone, and all of them together. Invariant: the tests are corrected for their number
//! by Holm's method, so that two results of one machine are told apart wrongly in at most a share [`Comparison::LEVEL`] of all comparisons.

mod comparison;
mod decide;
mod stored;
#[cfg(test)]
mod tests;
mod text;
mod vantage;

pub use comparison::{Comparison, Difference, Direction, Family, Joint, Side, Verdict};
pub use decide::{CompareError, compare};
pub use stored::{StoredFault, StoredResult};
