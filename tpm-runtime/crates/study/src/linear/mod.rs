//! Linear models of a machine at rest, as answers that are displayed and serialised.

mod channel;
mod comparison;
mod linearised;
mod regulator;
mod words;

pub use comparison::{Band, LinearisedError};
pub use linearised::Linearised;
pub use regulator::{AtRest, Regulated, mode_in_words};
