//! Choice of linearly independent variables by their covariance.

use crate::DMatrix;

/// Indices, ascending, of the variables that are linearly independent of those before them: given those, more than a
/// share `tolerance` of their variance remains. Variables of variance zero are left out. The covariance of the
/// variables that are kept has a Cholesky factor.
pub fn independent(covariance: &DMatrix<f64>, tolerance: f64) -> Vec<usize> {
    let mut kept: Vec<usize> = Vec::new();
    // Rows of the Cholesky factor of the kept variables.
    let mut factor: Vec<Vec<f64>> = Vec::new();
    for i in 0..covariance.nrows() {
        let mut row = vec![0.0; kept.len() + 1];
        for (k, &other) in kept.iter().enumerate() {
            let explained: f64 = (0..k).map(|m| row[m] * factor[k][m]).sum();
            row[k] = (covariance[(i, other)] - explained) / factor[k][k];
        }
        let own = covariance[(i, i)];
        let rest = own - row.iter().map(|entry| entry * entry).sum::<f64>();
        if rest > tolerance * own && rest.is_finite() {
            row[kept.len()] = rest.sqrt();
            factor.push(row);
            kept.push(i);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::independent;
    use crate::{Cholesky, DMatrix};

    #[test]
    fn sums_and_constants_are_left_out() {
        // x, y, x + y, a constant, z; x and y are correlated.
        let rows = DMatrix::from_row_slice(
            5,
            3,
            &[1.0, 0.0, 0.0, 0.8, 0.6, 0.0, 1.8, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-6],
        );
        let covariance = &rows * rows.transpose();
        let kept = independent(&covariance, 1e-9);
        assert_eq!(kept, vec![0, 1, 4]);
        let own = DMatrix::from_fn(3, 3, |r, c| covariance[(kept[r], kept[c])]);
        assert!(Cholesky::new(own).is_some());
    }
}
