//! Significance of sums of squared normal variables.

/// How far a sum of `freedom` squared normal variables lies above its mean, in standard deviations of a normal variable
/// (Wilson and Hilferty's cube root).
pub fn deviation(sum: f64, freedom: usize) -> f64 {
    if freedom == 0 {
        return 0.0;
    }
    let width = 2.0 / (9.0 * freedom as f64);
    ((sum / freedom as f64).cbrt() - (1.0 - width)) / width.sqrt()
}

/// How far a sum of `freedom` squared normal variables lies above its mean when their variance was read from `residuals` others
/// (the F distribution), in standard deviations of a normal variable (Paulson's approximation by cube roots). Nothing where there are
/// no residuals to read the variance from.
pub fn deviation_by_residuals(sum: f64, freedom: usize, residuals: usize) -> Option<f64> {
    if freedom == 0 || residuals == 0 {
        return None;
    }
    let width = |count: usize| 2.0 / (9.0 * count as f64);
    let (own, other) = (width(freedom), width(residuals));
    let root = (sum / freedom as f64).cbrt();
    Some(((1.0 - other) * root - (1.0 - own)) / (own + root * root * other).sqrt())
}

#[cfg(test)]
mod tests {
    use super::{deviation, deviation_by_residuals};

    /// Tables of chi-squared and F: the values that are passed once in a thousand times.
    #[test]
    fn one_in_a_thousand_is_three_deviations() {
        for (freedom, sum) in [(1, 10.83), (3, 16.27), (10, 29.59)] {
            assert!((deviation(sum, freedom) - 3.09).abs() < 0.06, "{freedom}");
            let many = deviation_by_residuals(sum, freedom, 1_000_000).expect("residuals");
            assert!((deviation(sum, freedom) - many).abs() < 1e-3);
        }
        for (freedom, residuals, ratio) in [(1, 10, 21.04), (3, 10, 12.55), (3, 20, 8.10), (5, 30, 5.53)] {
            let found =
                deviation_by_residuals(ratio * f64::from(freedom), freedom as usize, residuals).expect("residuals");
            assert!((found - 3.09).abs() < 0.1, "{freedom} {residuals}: {found}");
        }
        assert_eq!(deviation_by_residuals(1.0, 3, 0), None);
    }
}
