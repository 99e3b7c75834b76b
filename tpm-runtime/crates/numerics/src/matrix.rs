//! Real matrices as results carry them.

use nalgebra::DMatrix;
use serde::ser::SerializeSeq as _;
use serde::{Serialize, Serializer};
use std::ops::Index;

/// A real matrix, read by row and column from 0. It serialises as a list of rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix(DMatrix<f64>);

impl Matrix {
    /// The matrix of these rows; nothing when they differ in length.
    #[must_use]
    pub fn from_rows(rows: &[Vec<f64>]) -> Option<Self> {
        let columns = rows.first().map_or(0, Vec::len);
        let regular = rows.iter().all(|row| row.len() == columns);
        regular.then(|| Self(DMatrix::from_fn(rows.len(), columns, |r, c| rows[r][c])))
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.0.nrows()
    }

    /// Number of columns.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.0.ncols()
    }

    /// The entry in a row and a column; nothing outside the matrix.
    #[must_use]
    pub fn get(&self, row: usize, column: usize) -> Option<f64> {
        self.0.get((row, column)).copied()
    }

    /// The entries, row by row.
    #[must_use]
    pub fn to_rows(&self) -> Vec<Vec<f64>> {
        self.0.row_iter().map(|row| row.iter().copied().collect()).collect()
    }

    /// The entries on the diagonal.
    pub fn diagonal(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.rows().min(self.columns())).map(|i| self.0[(i, i)])
    }

    /// The matrix and the outer product of a vector, of its number of rows, with itself: a covariance whose variables may besides be moved by so
    /// much together.
    #[must_use]
    pub fn moved_by(&self, moved: &[f64]) -> Self {
        Self(DMatrix::from_fn(self.rows(), self.columns(), |r, c| self.0[(r, c)] + moved[r] * moved[c]))
    }

    /// A dense matrix as it is.
    #[must_use]
    pub const fn of(matrix: DMatrix<f64>) -> Self {
        Self(matrix)
    }

    /// The matrix as the linear-algebra crate computes with it.
    pub const fn dense(&self) -> &DMatrix<f64> {
        &self.0
    }
}

impl Index<(usize, usize)> for Matrix {
    type Output = f64;

    fn index(&self, entry: (usize, usize)) -> &f64 {
        &self.0[entry]
    }
}

impl Serialize for Matrix {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut rows = serializer.serialize_seq(Some(self.rows()))?;
        for row in self.to_rows() {
            rows.serialize_element(&row)?;
        }
        rows.end()
    }
}

#[cfg(test)]
mod tests {
    use super::Matrix;
    use std::vec;

    #[test]
    fn a_matrix_reads_and_serialises_by_rows() {
        let matrix = Matrix::from_rows(&[vec![1.0, 2.0, 3.0], vec![4.0, 5.0, 6.0]]).expect("rows of one length");
        assert_eq!((matrix.rows(), matrix.columns()), (2, 3));
        assert_eq!((matrix[(1, 2)], matrix.get(2, 0)), (6.0, None));
        assert_eq!(serde_json::to_string(&matrix).expect("numbers"), "[[1.0,2.0,3.0],[4.0,5.0,6.0]]");
        assert_eq!(matrix.diagonal().collect::<vec::Vec<_>>(), [1.0, 5.0]);
        assert_eq!(Matrix::from_rows(&[vec![1.0], vec![]]), None);
    }
}
