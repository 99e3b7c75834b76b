//! Rows condensed to an upper triangle by orthogonal reflections.

use crate::output_error::triangularise;
use tpm_numerics::DMatrix;

/// Rows that are gathered, for every column, before they are reduced.
const GATHERED: usize = 2;
/// The same, whatever the number of columns.
const LEAST_GATHERED: usize = 32;

/// The upper triangle R of rows, `R'R` being the sum of their squares; rows that were not reduced yet stand behind it.
#[derive(Clone, Debug)]
pub(super) struct Triangle {
    width: usize,
    rows: Vec<f64>,
    factors: Vec<f64>,
}

impl Triangle {
    pub(super) const fn new(width: usize) -> Self {
        Triangle { width, rows: Vec::new(), factors: Vec::new() }
    }

    /// Takes a row in.
    pub(super) fn take(&mut self, row: &[f64]) {
        self.rows.extend_from_slice(row);
        if self.rows.len() >= (1 + GATHERED) * self.width * self.width + LEAST_GATHERED * self.width {
            self.reduce();
        }
    }

    /// Both together.
    pub(super) fn with(mut self, other: &Self) -> Self {
        self.rows.extend_from_slice(&other.rows);
        self
    }

    /// The triangle; zeros below where there were fewer rows than columns.
    pub(super) fn square(mut self) -> DMatrix<f64> {
        self.reduce();
        let mut square = DMatrix::zeros(self.width, self.width);
        for (r, row) in self.rows.chunks_exact(self.width).enumerate() {
            row.iter().enumerate().skip(r).for_each(|(c, value)| square[(r, c)] = *value);
        }
        square
    }

    fn reduce(&mut self) {
        triangularise(&mut self.rows, &mut self.factors, self.width, self.width);
        self.rows.truncate(self.width * self.width);
    }
}
