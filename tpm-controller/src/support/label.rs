//! Names of a model's quantities.

use core::fmt;

/// A name with its unit, as declared in the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Label<'a> {
    /// Name as declared.
    pub name: &'a str,
    /// Unit as declared, without brackets; `None` when the model declares none.
    pub unit: Option<&'a str>,
}

impl<'a> Label<'a> {
    /// A name with a unit.
    #[must_use]
    pub const fn new(name: &'a str, unit: &'a str) -> Self {
        Label { name, unit: Some(unit) }
    }

    /// A name without a unit.
    #[must_use]
    pub const fn bare(name: &'a str) -> Self {
        Label { name, unit: None }
    }
}

impl fmt::Display for Label<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.unit {
            Some(unit) => write!(f, "{} [{unit}]", self.name),
            None => f.write_str(self.name),
        }
    }
}
