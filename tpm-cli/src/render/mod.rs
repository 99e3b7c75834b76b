//! Results as text.

pub(crate) mod campaign;
pub(crate) mod table;
