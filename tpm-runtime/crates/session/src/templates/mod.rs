//! A log without a model: which quantities its columns hold, and which models to begin with fit them.
//!
//! A column's quantity is that of its unit, else that of its name. A template fits a log where its coordinates and its input find columns of
//! their quantities. Invariant: the text of a proposal is a model that parses, with units in which the columns can be read.

mod catalogue;
mod proposal;
mod quantity;
mod simulated;
mod start;

pub use catalogue::{TEMPLATES, Template};
pub use proposal::{Placed, Proposal, proposals};
pub use quantity::Quantity;
