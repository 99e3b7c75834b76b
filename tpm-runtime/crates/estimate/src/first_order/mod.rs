//! Estimators that are linearised about the reference: `error`, `effort` and `hill`.

mod linearised;
mod reduce;

pub(super) use linearised::Linearised;
pub use reduce::feed_forward_lines;
pub(super) use reduce::{FirstOrder, fed_back};
