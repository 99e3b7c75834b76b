//! What a log holds, before anything is identified from it: `tpm inspect`.
//!
//! Invariant: what identification measures too is measured by the same functions: the noise and the step of a sensor, single wrong
//! readings, gaps and uneven stamps, the part that repeats, the highest frequency that stands out of the noise, the gain of a measured
//! rate. With a model, the identification itself is run, and its warnings about the log are passed on. Rest, clipping, drift and delays
//! are measured here alone: identification weighs readings at rest by their signs and looks for delays, limits and drift in what a
//! simulation leaves, which needs parameters.
//!
//! ```text
//! log::Survey -> signal -> channel (rest, plateau) | period (drift) | relation | prospect -> finding -> report -> text, figure
//! ```

mod channel;
mod figure;
mod finding;
mod outline;
mod period;
mod plateau;
mod prospect;
mod relation;
mod report;
mod rest;
mod signal;
mod survey;
#[cfg(test)]
mod tests;
mod text;

pub use channel::{ChannelReport, Lone};
pub use finding::Finding;
pub use period::Repeats;
pub use plateau::{End, Plateau};
pub use relation::{Relation, RelationKind};
pub use report::{Inspection, Sampling};
pub use rest::Rest;
pub use survey::{inspect, inspect_for};
