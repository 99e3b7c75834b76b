//! Results as text.

pub(crate) mod campaign;

