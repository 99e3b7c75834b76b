//! Polynomials through a few points.

/// Value at `at` of the polynomial through so many points, in Lagrange's form; its degree is one less than their number. No two of the nodes may
/// be equal.
///
/// ```
/// let square = tpm_numerics::through([0.0, 1.0, 3.0], [0.0, 1.0, 9.0], 2.0);
/// assert_eq!(square, 4.0);
/// ```
#[must_use]
pub fn through<const N: usize>(nodes: [f64; N], values: [f64; N], at: f64) -> f64 {
    let weight = |i: usize| -> f64 {
        let others = (0..N).filter(|j| *j != i);
        others.map(|j| (at - nodes[j]) / (nodes[i] - nodes[j])).product()
    };
    (0..N).map(|i| weight(i) * values[i]).sum()
}

/// The same through values one apart, of which the first stands at zero.
#[must_use]
pub fn through_even<const N: usize>(values: [f64; N], at: f64) -> f64 {
    through(std::array::from_fn(|i| i as f64), values, at)
}
