//! Products and powers of Fourier polynomials, computed from their spectra over a common denominator.

use crate::algebra::fourier::Fourier;
use crate::algebra::spectrum::{Spectrum, Whole};
use crate::number::buffers::Rooms;
use crate::number::denominator::{Denominator, Factors};
use num_bigint::BigInt;
use num_traits::One;

impl Fourier {
    /// The product.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// let cosine = Fourier::cos(1, integer(1));
    /// assert_eq!(cosine.mul(&cosine), Fourier::constant(ratio(1, 2)).add(&Fourier::cos(2, ratio(1, 2))));
    /// ```
    #[must_use]
    pub fn mul(&self, other: &Self) -> Self {
        power_product(&[(self, 1), (other, 1)])
    }

    /// A non-negative power.
    ///
    /// ```
    /// # use tpm_symbolic::{algebra::fourier::{Fourier, Trig}, number::rational::{integer, ratio}};
    /// assert_eq!(Fourier::cos(1, integer(1)).pow(3).cos_coefficient(3), ratio(1, 4));
    /// ```
    #[must_use]
    pub fn pow(&self, exponent: u32) -> Self {
        power_product(&[(self, exponent)])
    }
}

/// The product of powers.
fn power_product(factors: &[(&Fourier, u32)]) -> Fourier {
    let mut result = Spectrum::one();
    let mut denominator = BigInt::one();
    let mut rooms = Rooms::default();
    for (fourier, exponent) in factors {
        if *exponent == 0 {
            continue;
        }
        if fourier.is_zero() {
            return Fourier::zero();
        }
        let mut known = Factors::default();
        let base = Whole::new(fourier, &mut known).base(0, u64::from(*exponent), &mut known);
        let below = known.quotient(base.denominator(), &Denominator::default()).to_big();
        for _ in 0..*exponent {
            let next = result.multiply(&base, &mut rooms);
            rooms.recycle(std::mem::replace(&mut result, next).into_values());
        }
        denominator *= below.pow(*exponent);
    }
    result.to_fourier(&denominator)
}
