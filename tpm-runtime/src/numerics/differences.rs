//! Difference quotients.

/// Shifts in steps h and the weights of the values there: their sum over `12 h` is the derivative, exact up to the fourth
/// degree.
pub(crate) const FIVE_POINT: [(f64, f64); 4] = [(-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0)];
