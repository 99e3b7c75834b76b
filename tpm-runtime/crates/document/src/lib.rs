//! Results as one page for a browser, including its figures.
//!
//! Invariant: a page is self-contained. Its figures are part of it, it needs neither a script nor the network, and text
//! from models, logs and command lines is escaped. Numbers are shown to the digits that their standard deviation
//! supports. The page also contains them with all digits, so that it holds the same values as the JSON result.

mod block;
mod campaign;
mod comparison;
mod error;
mod estimates;
mod forces;
mod headline;
mod identification;
mod junit;
mod machine;
mod marks;
mod page;
mod residuals;
mod study;
mod validation;

pub use campaign::PlayedRun;
pub use error::DocumentError;
pub use identification::Spell;
pub use junit::junit;
pub use machine::{Direct, Step};
pub use page::{Document, Issue};
