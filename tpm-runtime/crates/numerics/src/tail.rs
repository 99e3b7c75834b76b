//! Tail probabilities of the normal and the chi-squared distribution.

use std::f64::consts::PI;

/// Half the width of the interval that holds 95 % of a normal distribution, in standard deviations.
pub const NORMAL_95: f64 = 1.959_963_984_540_054;

/// Probability that a normal variable is at least `deviations` standard deviations from its mean, to either side.
pub fn normal_two_sided(deviations: f64) -> f64 {
    libm::erfc(deviations.abs() / 2.0_f64.sqrt())
}

/// Probability that a chi-squared variable with so many degrees of freedom is at least `x`.
///
/// The regularised incomplete gamma function Q(k/2, x/2) by its recurrence Q(a + 1, y) = Q(a, y) + y^a exp(-y)/Gamma(a + 1), from
/// Q(1/2, y) = erfc(sqrt(y)) or Q(1, y) = exp(-y); no digits cancel, since all terms are positive.
pub fn chi_squared_upper(x: f64, degrees_of_freedom: usize) -> f64 {
    if degrees_of_freedom == 0 || x <= 0.0 {
        return 1.0;
    }
    let y = 0.5 * x;
    let decay = (-y).exp();
    let (mut a, mut tail, mut term) = if degrees_of_freedom % 2 == 1 {
        (0.5, libm::erfc(y.sqrt()), 2.0 * (y / PI).sqrt() * decay)
    } else {
        (1.0, decay, y * decay)
    };
    while a + 0.5 < 0.5 * degrees_of_freedom as f64 {
        tail += term;
        a += 1.0;
        term *= y / a;
    }
    tail.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::{chi_squared_upper, normal_two_sided};

    #[test]
    fn tails_are_those_of_printed_tables() {
        for (deviations, expected) in [(0.0, 1.0), (1.959_963_985, 0.05), (2.575_829_304, 0.01), (6.0, 1.973_175e-9)] {
            assert!((normal_two_sided(-deviations) / expected - 1.0).abs() < 1e-6, "{deviations}");
        }
        // Abramowitz and Stegun, table 26.8.
        for (x, freedom, expected) in [
            (3.841_458_82, 1, 0.05),
            (5.991_464_55, 2, 0.05),
            (7.814_727_90, 3, 0.05),
            (20.090_235_0, 8, 0.01),
            (124.342_113, 100, 0.05),
            (30.0, 1, 4.320_463e-8),
        ] {
            let found = chi_squared_upper(x, freedom);
            assert!((found / expected - 1.0).abs() < 1e-6, "{x} {freedom}: {found}");
        }
        assert_eq!((chi_squared_upper(0.0, 3), chi_squared_upper(1e6, 3), chi_squared_upper(2.0, 0)), (1.0, 0.0, 1.0));
    }
}
