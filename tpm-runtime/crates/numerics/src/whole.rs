//! Whole numbers of samples, lines and points out of quotients of times: what rounding leaves of a whole number is that number, so that no
//! choice hangs on the last bit of a stamp.

use crate::tolerance::TIME_STAMP;

/// The largest whole number that is not above `x`; zero where there is none.
///
/// ```
/// use tpm_numerics::whole;
/// assert_eq!(whole::below(2.0 / 0.010_000_000_01), 200);
/// assert_eq!(whole::below(199.9), 199);
/// ```
#[must_use]
pub fn below(x: f64) -> usize {
    (x * (1.0 + TIME_STAMP)).floor().max(0.0) as usize
}

/// The least whole number that is not below `x`; zero where that is negative.
///
/// ```
/// use tpm_numerics::whole;
/// assert_eq!(whole::above(640.000_000_001), 640);
/// assert_eq!(whole::above(640.1), 641);
/// ```
#[must_use]
pub fn above(x: f64) -> usize {
    (x * (1.0 - TIME_STAMP)).ceil().max(0.0) as usize
}
