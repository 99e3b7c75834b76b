//! Products of the columns of a matrix with each other.

use nalgebra::DMatrix;

/// A'A: of every pair of columns one product, since the other one is the same.
#[must_use]
pub fn gram(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let n = matrix.ncols();
    let mut products = DMatrix::zeros(n, n);
    for i in 0..n {
        for k in i..n {
            let product = matrix.column(i).dot(&matrix.column(k));
            products[(i, k)] = product;
            products[(k, i)] = product;
        }
    }
    products
}

#[cfg(test)]
mod tests {
    use super::gram;
    use nalgebra::DMatrix;

    #[test]
    fn products_are_those_of_all_pairs() {
        let matrix = DMatrix::from_fn(37, 5, |r, c| (3.0 * r as f64 + c as f64).sin());
        assert!((gram(&matrix) - matrix.tr_mul(&matrix)).amax() < 1e-13);
        assert_eq!(gram(&DMatrix::zeros(4, 0)).shape(), (0, 0));
    }
}
