//! Exact integer factors, stored in one machine word while they fit.
//!
//! Invariant of [`Scalar`]: `Big` holds only values that do not fit `Small`.

use num_bigint::BigInt;

/// An exact integer factor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    Small(i64),
    Big(Box<BigInt>),
}

impl Scalar {
    pub(crate) const ONE: Self = Self::Small(1);

    pub(crate) fn from_big(value: &BigInt) -> Self {
        i64::try_from(value).map_or_else(|_| Self::Big(Box::new(value.clone())), Self::Small)
    }

    pub(crate) fn to_big(&self) -> BigInt {
        match self {
            Self::Small(value) => BigInt::from(*value),
            Self::Big(value) => value.as_ref().clone(),
        }
    }

    pub(crate) fn is_zero(&self) -> bool {
        matches!(self, Self::Small(0))
    }

    pub(crate) fn is_one(&self) -> bool {
        matches!(self, Self::Small(1))
    }

    /// Bit length of the magnitude.
    pub(crate) fn bits(&self) -> u64 {
        match self {
            Self::Small(value) => u64::from(64 - value.unsigned_abs().leading_zeros()),
            Self::Big(value) => value.bits(),
        }
    }

    pub(crate) fn times(&self, other: &Self) -> Self {
        if let (Self::Small(a), Self::Small(b)) = (self, other)
            && let Some(product) = a.checked_mul(*b)
        {
            return Self::Small(product);
        }
        Self::from_big(&(self.to_big() * other.to_big()))
    }

    pub(crate) fn plus(&self, other: &Self) -> Self {
        if let (Self::Small(a), Self::Small(b)) = (self, other)
            && let Some(sum) = a.checked_add(*b)
        {
            return Self::Small(sum);
        }
        Self::from_big(&(self.to_big() + other.to_big()))
    }

    pub(crate) fn power(&self, exponent: u32) -> Self {
        match self {
            Self::Small(1) => Self::ONE,
            Self::Small(value) => match value.checked_pow(exponent) {
                Some(power) => Self::Small(power),
                None => Self::from_big(&BigInt::from(*value).pow(exponent)),
            },
            Self::Big(value) => Self::from_big(&value.pow(exponent)),
        }
    }
}
