//! Types of the subset.

use super::library::Untranslated;

/// A type of the subset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Type {
    /// The scalar.
    Real,
    /// Double precision, whatever the scalar is.
    Double,
    /// A whole number, by its name in C.
    Whole(&'static str),
    /// A whole number that is written out, of whatever type its neighbour has.
    Literal,
    /// A size of the model: a macro, which is written out too.
    Size,
    Bool,
    Unit,
    Structure(String, Vec<String>),
    Enumeration(String),
    Array(Box<Type>, String),
    /// An array of any length, and whether it may be changed.
    Slice(Box<Type>, bool),
    /// A reference, and whether what it refers to may be changed.
    Pointer(Box<Type>, bool),
    /// The model, whose functions are those of the generated file.
    Model,
    /// A status: nothing, or a fault of an enumeration.
    Status(String),
}

impl Type {
    /// The type behind references.
    pub(super) fn inner(&self) -> &Type {
        match self {
            Self::Pointer(inner, _) => inner.inner(),
            other => other,
        }
    }

    /// The element of an array.
    pub(super) fn element(&self) -> Result<&Type, Untranslated> {
        match self.inner() {
            Self::Array(element, _) | Self::Slice(element, _) => Ok(element),
            other => Err(format!("an index of {other:?}")),
        }
    }

    pub(super) fn is_whole(&self) -> bool {
        matches!(self, Self::Whole(_) | Self::Literal | Self::Size)
    }
}
