//! Results as text and figures, and remedies of the libraries as flags.

pub(crate) mod campaign;
pub(crate) mod cells;
pub(crate) mod combination;
pub(crate) mod flags;
pub(crate) mod method;
pub(crate) mod quoted;
pub(crate) mod result;
pub(crate) mod showing;
pub(crate) mod templates;
