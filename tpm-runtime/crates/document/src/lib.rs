//! Results as one page for a browser, with its figures.
//!
//! Invariant: a page stands alone. Its figures are part of it, it needs neither a script nor the network, and whatever comes from models,
//! logs and command lines is escaped. Numbers are shown to the digits that their deviation supports, and stand in the page in full as
//! well, so that it says what the JSON says.

mod block;
mod campaign;
mod error;
mod forces;
mod identification;
mod marks;
mod page;
mod study;
mod validation;

pub use campaign::PlayedRun;
pub use error::DocumentError;
pub use identification::Spell;
pub use page::Document;
