//! Results as text and figures, and the libraries' remedies as flags.

pub(crate) mod campaign;
pub(crate) mod flags;
pub(crate) mod result;
