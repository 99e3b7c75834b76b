//! Files that a page hands over.

use serde::Deserialize;
use std::sync::Arc;

/// The bytes of a file.
pub type Bytes = Arc<Vec<u8>>;

/// A text with the name of its file.
#[derive(Debug, Deserialize)]
pub(crate) struct Named {
    pub(crate) name: String,
    pub(crate) text: String,
}
