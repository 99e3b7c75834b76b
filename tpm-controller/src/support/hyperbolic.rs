//! The hyperbolic tangent, which few models need: files that stand alone bring it along only where the model does.

use super::Real;

/// Hyperbolic functions of a [`Real`].
pub trait Hyperbolic: Real {
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;
}

impl<T: Real> Hyperbolic for T {
    #[inline]
    #[allow(clippy::cast_possible_truncation, reason = "the value is a single already")]
    fn tanh(self) -> Self {
        // The compiler knows the size, and keeps the branch of this precision, without any conversion.
        if size_of::<T>() == size_of::<f32>() {
            T::from_f64(f64::from(libm::tanhf(self.to_f64() as f32)))
        } else {
            T::from_f64(libm::tanh(self.to_f64()))
        }
    }
}
