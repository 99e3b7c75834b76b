//! Units as formal products of names, for display.
//!
//! Invariant: the factors are sorted by name with non-zero exponents. Whether units agree is checked where a model is
//! read; here units are only stored and multiplied.

use num_rational::Ratio;
use num_traits::{One, Signed, Zero};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// A formal product of rational powers of unit names, such as `kg*m^2/s` or `m^(5/2)/s`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Unit(BTreeMap<String, Ratio<i64>>);

impl Unit {
    /// The dimensionless unit.
    #[must_use]
    pub fn one() -> Self {
        Self::default()
    }

    /// A named unit.
    ///
    /// ```
    /// # use tpm_symbolic::mechanics::unit::Unit;
    /// assert_eq!(Unit::named("kg").to_string(), "kg");
    /// ```
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self::product([(name, Ratio::one())])
    }

    /// The product of powers of named units.
    #[must_use]
    pub fn product<'a>(powers: impl IntoIterator<Item = (&'a str, Ratio<i64>)>) -> Self {
        powers.into_iter().fold(Self::one(), |product, (name, exponent)| product.mul_power(name, exponent))
    }

    /// The product.
    ///
    /// ```
    /// # use tpm_symbolic::mechanics::unit::Unit;
    /// assert_eq!(Unit::named("N").mul(&Unit::named("m")).to_string(), "N*m");
    /// ```
    #[must_use]
    pub fn mul(&self, other: &Self) -> Self {
        Self::product(self.powers().chain(other.powers()))
    }

    fn powers(&self) -> impl Iterator<Item = (&str, Ratio<i64>)> {
        self.0.iter().map(|(name, exponent)| (name.as_str(), *exponent))
    }

    fn mul_power(mut self, name: &str, exponent: Ratio<i64>) -> Self {
        let sum = self.0.remove(name).unwrap_or_else(Ratio::zero) + exponent;
        if !sum.is_zero() {
            self.0.insert(name.to_owned(), sum);
        }
        self
    }

    /// An integer power.
    ///
    /// ```
    /// # use tpm_symbolic::mechanics::unit::Unit;
    /// assert_eq!(Unit::named("m").pow(2).mul(&Unit::named("m").pow(-2)), Unit::one());
    /// ```
    #[must_use]
    pub fn pow(&self, exponent: i32) -> Self {
        Self::product(self.powers().map(|(name, of)| (name, of * i64::from(exponent))))
    }

    /// The unit with `kg*m^2/s^2` written as `N*m`: a product of parameter units with this value is the torque on a
    /// rotary coordinate.
    ///
    /// ```
    /// # use tpm_symbolic::mechanics::unit::Unit;
    /// let inertia = Unit::named("kg").mul(&Unit::named("m").pow(2));
    /// assert_eq!(inertia.mul(&Unit::named("s").pow(-2)).with_torque(), Unit::named("N").mul(&Unit::named("m")));
    /// ```
    #[must_use]
    pub fn with_torque(self) -> Self {
        let torque = Self::named("kg").mul(&Self::named("m").pow(2)).mul(&Self::named("s").pow(-2));
        if self == torque { Self::named("N").mul(&Self::named("m")) } else { self }
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let write = |f: &mut fmt::Formatter<'_>, name: &str, exponent: Ratio<i64>| match exponent {
            one if one.is_one() => f.write_str(name),
            whole if whole.is_integer() => write!(f, "{name}^{whole}"),
            root => write!(f, "{name}^({root})"),
        };
        let mut first = true;
        for (name, exponent) in self.powers().filter(|(_, exponent)| exponent.is_positive()) {
            if !std::mem::replace(&mut first, false) {
                write!(f, "*")?;
            }
            write(f, name, exponent)?;
        }
        if first {
            write!(f, "1")?;
        }
        for (name, exponent) in self.powers().filter(|(_, exponent)| exponent.is_negative()) {
            write!(f, "/")?;
            write(f, name, -exponent)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::Unit;
    use num_rational::Ratio;

    #[test]
    fn a_product_that_comes_to_a_torque_is_written_as_one() {
        let [kg, m, s] = ["kg", "m", "s"].map(Unit::named);
        let acceleration = m.mul(&s.pow(-2));
        assert_eq!(kg.mul(&acceleration).mul(&m).with_torque().to_string(), "N*m");
        assert_eq!(kg.mul(&acceleration).with_torque().to_string(), "kg*m/s^2");
        assert_eq!(Unit::named("J").with_torque().to_string(), "J");
    }

    #[test]
    fn roots_are_written_in_parentheses_and_what_cancels_is_left_out() {
        let root = Unit::product([("m", Ratio::new(5, 2)), ("s", Ratio::from_integer(-1))]);
        assert_eq!(root.to_string(), "m^(5/2)/s");
        assert_eq!(root.mul(&Unit::product([("m", Ratio::new(1, 2))])).to_string(), "m^3/s");
        assert_eq!(root.mul(&root.pow(-1)), Unit::one());
    }
}
