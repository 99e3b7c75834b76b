//! Linear models of a machine at rest, as answers that are displayed and serialised.

mod linearised;
mod regulator;
mod roots;

pub use linearised::{Band, Linearised, LinearisedError};
pub use regulator::{AtRest, Regulated, mode_in_words};
