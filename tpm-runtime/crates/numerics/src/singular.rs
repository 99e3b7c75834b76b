//! Singular values of a real matrix, as the eigenvalues of a symmetric one.
//!
//! nalgebra's own decomposition loses digits where a singular value is small beside the largest; its symmetric
//! eigenvalues are right to rounding (`DESIGN.md`, "Why nalgebra and what does it get wrong?").
//!
//! Invariant: the eigenvalues of `[0 A; A' 0]` are plus and minus the singular values of A, and zeros (Golub and Van Loan,
//! Matrix Computations, 8.6). The eigenvalues of A' A lose half of the digits, so that they serve only for condition
//! numbers that are not large.

use crate::{DMatrix, DVector};

/// The singular values of a matrix above a tolerance, with their vectors.
#[derive(Clone, Debug)]
pub struct Singular {
    /// Singular values, descending.
    pub values: DVector<f64>,
    /// Left singular vectors, by columns.
    pub left: DMatrix<f64>,
    /// Right singular vectors, by columns.
    pub right: DMatrix<f64>,
}

impl Singular {
    /// The singular values above `tolerance` times the largest; none for a matrix with an entry that is not finite.
    pub fn new(matrix: &DMatrix<f64>, tolerance: f64) -> Self {
        let (rows, columns) = matrix.shape();
        if matrix.is_empty() || matrix.iter().any(|x| !x.is_finite()) {
            let (left, right) = (DMatrix::zeros(rows, 0), DMatrix::zeros(columns, 0));
            return Singular { values: DVector::zeros(0), left, right };
        }
        if rows > columns {
            let qr = matrix.clone().qr();
            let of_factor = Singular::new(&qr.r(), tolerance);
            return Singular { left: qr.q() * of_factor.left, ..of_factor };
        }
        let mut doubled = DMatrix::zeros(rows + columns, rows + columns);
        doubled.view_mut((0, rows), (rows, columns)).copy_from(matrix);
        doubled.view_mut((rows, 0), (columns, rows)).copy_from(&matrix.transpose());
        let eigen = doubled.symmetric_eigen();
        let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
        let mut counted: Vec<usize> =
            (0..rows + columns).filter(|&i| eigen.eigenvalues[i] > tolerance * largest).collect();
        counted.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
        // The two parts of an eigenvector are the left and the right singular vector, each with half of its squared
        // length. Where the eigenvectors of plus and minus a value mix, each part still keeps its direction.
        let part = |from: usize, count: usize| {
            let raw = DMatrix::from_fn(count, counted.len(), |r, c| eigen.eigenvectors[(from + r, counted[c])]);
            unit_columns(raw).0
        };
        let values = DVector::from_iterator(counted.len(), counted.iter().map(|&i| eigen.eigenvalues[i]));
        Singular { values, left: part(0, rows), right: part(rows, columns) }
    }

    /// Number of singular values above the tolerance.
    pub fn rank(&self) -> usize {
        self.values.len()
    }

    /// Ratio of the largest singular value to the smallest above the tolerance; infinite when there is none.
    pub fn condition(&self) -> f64 {
        match (self.values.iter().next(), self.values.iter().next_back()) {
            (Some(largest), Some(smallest)) => largest / smallest,
            _ => f64::INFINITY,
        }
    }

    /// An orthonormal basis, by columns, of the null space: what the matrix maps to zero.
    pub fn null(&self) -> DMatrix<f64> {
        let columns = self.right.nrows();
        if self.rank() == columns { DMatrix::zeros(columns, 0) } else { complement(&self.right) }
    }
}

/// The condition number over the singular values above the tolerance, without computing vectors where the square of the matrix
/// suffices.
pub fn condition(matrix: &DMatrix<f64>, tolerance: f64) -> f64 {
    if matrix.is_empty() || matrix.iter().any(|x| !x.is_finite()) {
        return f64::INFINITY;
    }
    // With a condition number below 1e4, A' A loses no more than half of the digits, and it is half as large.
    let squares = matrix.tr_mul(matrix).symmetric_eigenvalues();
    let (largest, smallest) = (squares.max(), squares.min());
    if smallest > tolerance.max(1e-4).powi(2) * largest {
        return (largest / smallest).sqrt();
    }
    Singular::new(matrix, tolerance).condition()
}

/// The matrix with columns of length one, and the divisors of its columns: their lengths, and one for a column of zeros.
pub fn unit_columns(mut matrix: DMatrix<f64>) -> (DMatrix<f64>, Vec<f64>) {
    let divided = matrix.column_iter_mut().map(|mut column| {
        let length = column.norm();
        let scale = if length > 0.0 { length } else { 1.0 };
        column /= scale;
        scale
    });
    let scale = divided.collect();
    (matrix, scale)
}

/// The direction scaled so that its component of largest magnitude is one.
pub fn largest_one(direction: &[f64]) -> Vec<f64> {
    let largest =
        direction.iter().copied().fold(0.0, |largest: f64, d| if d.abs() > largest.abs() { d } else { largest });
    direction.iter().map(|d| d / largest).collect()
}

/// An orthonormal basis, by columns, of the orthogonal complement of the columns given.
pub fn complement(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let n = columns.nrows();
    let mut basis: Vec<DVector<f64>> = Vec::with_capacity(n);
    // The part of a vector that is orthogonal to the basis. The Gram-Schmidt process is run twice, which is enough
    // against rounding.
    let rest = |basis: &[DVector<f64>], mut vector: DVector<f64>| {
        for _ in 0..2 {
            for known in basis {
                vector.axpy(-known.dot(&vector), known, 1.0);
            }
        }
        vector
    };
    for column in columns.column_iter() {
        let left = rest(&basis, column.normalize());
        if left.norm() > 1e-6 {
            basis.push(left.normalize());
        }
    }
    let given = basis.len();
    while basis.len() < n {
        // The unit vector with the smallest projection on the basis.
        let spanned = |i: usize| basis.iter().map(|known| known[i] * known[i]).sum::<f64>();
        let next = (0..n).min_by(|&i, &j| spanned(i).total_cmp(&spanned(j))).unwrap_or(0);
        let unit = DVector::from_fn(n, |i, _| if i == next { 1.0 } else { 0.0 });
        let left = rest(&basis, unit);
        basis.push(left.normalize());
    }
    let kept = &basis[given..];
    if kept.is_empty() { DMatrix::zeros(n, 0) } else { DMatrix::from_columns(kept) }
}

#[cfg(test)]
mod tests {
    use super::{Singular, condition};
    use crate::DMatrix;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn dependent_columns_are_decomposed_to_rounding() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for case in 0..4000 {
            let (columns, rank) = (2 + case % 8, 1 + (case / 8) % (2 + case % 8));
            let rows = columns + case % 3;
            let mut random = |r: usize, c: usize| DMatrix::from_fn(r, c, |_, _| rng.random_range(-1.0..1.0));
            let mut matrix = random(rows, rank) * random(rank, columns);
            // Perturbations from the size of noise down to that of rounding make the columns nearly dependent.
            matrix += random(rows, columns) * 10.0_f64.powi(-((case % 20) as i32));
            for mut column in matrix.column_iter_mut() {
                column.normalize_mut();
            }
            let found = Singular::new(&matrix, 0.0);
            let whole = Singular::new(&matrix, 1e-10);
            for (found, tolerance) in [(&found, 1e-12), (&whole, 1e-9)] {
                let again = &found.left * DMatrix::from_diagonal(&found.values) * found.right.transpose();
                assert!((again - &matrix).norm() < tolerance, "{case}");
            }
            assert!((condition(&matrix, 1e-10) / whole.condition() - 1.0).abs() < 1e-5, "{case}");
            let null = whole.null();
            assert_eq!(null.ncols() + whole.rank(), columns);
            for (vectors, wanted) in [(&whole.left, whole.rank()), (&whole.right, whole.rank()), (&null, null.ncols())]
            {
                let error = (vectors.tr_mul(vectors) - DMatrix::identity(wanted, wanted)).norm();
                // The error of a singular vector is rounding divided by the distance to the next singular value.
                assert!(error < 1e-4, "{case}: {error:e}");
            }
            assert!((&matrix * &null).norm() < 1e-8, "{case}");
        }
    }

    #[test]
    fn nothing_counts_in_a_matrix_of_zeros_or_of_what_is_no_number() {
        for (rows, entry) in [(3, 0.0), (3, f64::NAN), (1, f64::INFINITY), (0, 0.0)] {
            let matrix = DMatrix::from_element(rows, 2, entry);
            let found = Singular::new(&matrix, 1e-10);
            assert_eq!((found.rank(), found.null().ncols()), (0, 2));
            assert!(found.condition().is_infinite() && condition(&matrix, 1e-10).is_infinite());
        }
    }
}
