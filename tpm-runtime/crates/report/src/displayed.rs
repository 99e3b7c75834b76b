//! Serialisation of values as their `Display` text.

use serde::Serializer;
use std::fmt::Display;

/// Serialises a value as its text, for `serialize_with`.
///
/// # Errors
/// Those of the serialiser.
pub fn displayed<T: Display, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(value)
}
