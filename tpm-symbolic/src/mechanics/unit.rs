//! Units as formal products of names, for display.
//!
//! Invariant: the factors are sorted by name with non-zero exponents. Whether units agree is checked where a model is
//! read; here units are only stored and multiplied.

use crate::algebra::polynomial::Monomial;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A formal product of integer powers of unit names, such as `kg*m^2/s`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Unit(Monomial<String>);

impl Unit {
    /// The dimensionless unit.
    #[must_use]
    pub fn one() -> Self {
        Self::default()
    }

    /// A named unit.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self(Monomial::power_of(name.to_owned(), 1))
    }

    /// The product.
    #[must_use]
    pub fn mul(&self, other: &Self) -> Self {
        Self(self.0.mul(&other.0))
    }

    /// An integer power.
    #[must_use]
    pub fn pow(&self, exponent: i32) -> Self {
        Self(self.0.pow(exponent))
    }

    /// The unit with `kg*m^2/s^2` written as `N*m`: a product of parameter units with this value is the torque on a
    /// rotary coordinate.
    #[must_use]
    pub fn with_torque(self) -> Self {
        let torque = Self::named("kg").mul(&Self::named("m").pow(2)).mul(&Self::named("s").pow(-2));
        if self == torque { Self::named("N").mul(&Self::named("m")) } else { self }
    }

    /// The names and exponents in increasing order of the names.
    pub fn factors(&self) -> impl Iterator<Item = (&str, i32)> {
        self.0.factors().map(|(name, exponent)| (name.as_str(), exponent))
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let write = |f: &mut fmt::Formatter<'_>, name: &str, exponent: i32| {
            if exponent == 1 { write!(f, "{name}") } else { write!(f, "{name}^{exponent}") }
        };
        let mut first = true;
        for (name, exponent) in self.0.factors().filter(|(_, e)| *e > 0) {
            if !std::mem::replace(&mut first, false) {
                write!(f, "*")?;
            }
            write(f, name, exponent)?;
        }
        if first {
            write!(f, "1")?;
        }
        for (name, exponent) in self.0.factors().filter(|(_, e)| *e < 0) {
            write!(f, "/")?;
            write(f, name, -exponent)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::Unit;

    #[test]
    fn a_product_that_comes_to_a_torque_is_written_as_one() {
        let [kg, m, s] = ["kg", "m", "s"].map(Unit::named);
        let acceleration = m.mul(&s.pow(-2));
        assert_eq!(kg.mul(&acceleration).mul(&m).with_torque().to_string(), "N*m");
        assert_eq!(kg.mul(&acceleration).with_torque().to_string(), "kg*m/s^2");
        assert_eq!(Unit::named("J").with_torque().to_string(), "J");
    }
}
