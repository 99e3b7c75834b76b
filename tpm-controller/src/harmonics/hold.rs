//! Behaviour of an input between two samples.

use crate::support::Real;
use core::fmt;

/// Relation between the recorded values of an input and the force over time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Hold {
    /// The input itself was measured and is band-limited, or its timing is not known: harmonics are not corrected.
    #[default]
    None,
    /// Each recorded value was applied until the next sample (zero-order hold).
    Zoh,
}

impl Hold {
    /// The other hold. A log whose hold is not known is evaluated with both, and the results are compared.
    ///
    /// ```
    /// # use tpm_controller::harmonics::{Hold, hold_factor};
    /// assert_eq!(Hold::Zoh.other(), Hold::None);
    /// ```
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Hold::None => Hold::Zoh,
            Hold::Zoh => Hold::None,
        }
    }

    /// The factor by which the hold multiplies a harmonic at the angle `W T` (rad), as (real, imaginary) part: [`hold_factor`]
    /// of a zero-order hold, otherwise 1.
    #[must_use]
    pub fn factor<T: Real>(self, angle: T) -> (T, T) {
        match self {
            Hold::None => (T::ONE, T::ZERO),
            Hold::Zoh => hold_factor(angle),
        }
    }
}

impl fmt::Display for Hold {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Hold::None => "none",
            Hold::Zoh => "zoh",
        })
    }
}

/// `(1 - e^{-j W T})/(j W T)` at the angle `W T` (rad), as (real, imaginary) part: the factor by which a hold of T
/// seconds multiplies a harmonic of angular frequency W. It is 1 at the angle zero.
///
/// Computed as `sinc(W T / 2) e^{-j W T / 2}`, which does not cancel at small angles.
///
/// ```
/// # use tpm_controller::harmonics::{Hold, hold_factor};
/// assert_eq!(hold_factor(0.0), (1.0, 0.0));
/// ```
#[must_use]
pub fn hold_factor<T: Real>(angle: T) -> (T, T) {
    let half = angle / T::from_f64(2.0);
    let sinc = if half.abs() > T::ZERO { half.sin() / half } else { T::ONE };
    (sinc * half.cos(), -sinc * half.sin())
}

#[cfg(test)]
mod tests {
    use super::hold_factor;

    #[test]
    fn agrees_with_the_integral_over_one_interval() {
        // (1/T) integral_0^T e^{-j W t} dt by the midpoint rule, W T = 0.7.
        let angle = 0.7_f64;
        let steps = 20_000;
        let (mut re, mut im) = (0.0, 0.0);
        for i in 0..steps {
            let phase = angle * (f64::from(i) + 0.5) / f64::from(steps);
            re += phase.cos() / f64::from(steps);
            im -= phase.sin() / f64::from(steps);
        }
        let (c, s) = hold_factor(angle);
        assert!((c - re).abs() < 1e-9 && (s - im).abs() < 1e-9);
        assert_eq!(hold_factor(0.0_f64), (1.0, 0.0));
        assert_eq!(hold_factor(0.0_f32), (1.0, 0.0));
    }
}
