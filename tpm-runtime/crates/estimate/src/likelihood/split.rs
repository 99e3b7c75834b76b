//! Parameters and candidates of weighted equations that were condensed to a triangle.

use tpm_numerics::{Cholesky, DMatrix, DVector, Dyn};

/// The triangle of the weighted equations, parameters first and candidates behind them.
pub(crate) struct Split {
    /// R_Y.
    pub(crate) parameters: DMatrix<f64>,
    /// R_F.
    pub(crate) mixed: DMatrix<f64>,
    /// R2, with columns that others span set to zero.
    pub(crate) candidates: DMatrix<f64>,
    /// z1.
    pub(crate) of_parameters: DVector<f64>,
    /// z2.
    pub(crate) target: DVector<f64>,
    /// Length of what the parameters leave of every candidate, also of those that are set to zero.
    pub(crate) told: Vec<f64>,
    /// Which candidates say something of their own.
    pub(crate) counts: Vec<bool>,
}

/// Values and covariance given the variances of the candidates.
pub(crate) struct Solved {
    pub(crate) values: DVector<f64>,
    pub(crate) covariance: DMatrix<f64>,
    pub(crate) missing: DVector<f64>,
    /// Variance of every candidate's coefficient given the record.
    pub(crate) of_terms: Vec<f64>,
}

impl Split {
    /// `spanned` is the share of every candidate that the parameters must leave, for it to count.
    pub(crate) fn new(factor: &DMatrix<f64>, p: usize, spanned: &[f64]) -> Self {
        let last = factor.ncols() - 1;
        let terms = last - p;
        let mixed = factor.view((0, p), (p, terms)).into_owned();
        let mut candidates = factor.view((p, p), (terms, terms)).into_owned();
        let told: Vec<f64> = candidates.column_iter().map(|column| column.norm()).collect();
        let counts: Vec<bool> =
            (0..terms).map(|i| told[i] > spanned[i] * told[i].hypot(mixed.column(i).norm()) && told[i] > 0.0).collect();
        for (mut column, counts) in candidates.column_iter_mut().zip(&counts) {
            if !counts {
                column.fill(0.0);
            }
        }
        Split {
            parameters: factor.view((0, 0), (p, p)).into_owned(),
            mixed,
            candidates,
            of_parameters: factor.view((0, last), (p, 1)).column(0).into_owned(),
            target: factor.view((p, last), (terms, 1)).column(0).into_owned(),
            told,
            counts,
        }
    }

    /// The covariance of the target where the coefficients of the candidates have these variances, as its factor.
    pub(crate) fn spread(&self, variance: &[f64]) -> Option<Cholesky<f64, Dyn>> {
        let n = self.target.len();
        let scaled = DMatrix::from_fn(n, n, |r, c| self.candidates[(r, c)] * variance[c].sqrt());
        Cholesky::new(DMatrix::identity(n, n) + &scaled * scaled.transpose())
    }

    pub(crate) fn solve(&self, variance: &[f64]) -> Option<Solved> {
        let (p, n) = (self.parameters.ncols(), self.target.len());
        let factor = self.spread(variance)?;
        // R2 Gamma.
        let through = DMatrix::from_fn(n, n, |r, c| self.candidates[(r, c)] * variance[c]);
        let missing = through.tr_mul(&factor.solve(&self.target));
        let of_terms =
            DMatrix::from_diagonal(&DVector::from_column_slice(variance)) - through.tr_mul(&factor.solve(&through));
        let mut values = &self.of_parameters - &self.mixed * &missing;
        let mut inverse = DMatrix::identity(p, p);
        let mut moved = self.mixed.clone();
        let regular = self.parameters.solve_upper_triangular_mut(&mut values)
            && self.parameters.solve_upper_triangular_mut(&mut inverse)
            && self.parameters.solve_upper_triangular_mut(&mut moved);
        let covariance = &inverse * inverse.transpose() + &moved * &of_terms * moved.transpose();
        let finite = values.iter().chain(covariance.iter()).all(|x| x.is_finite());
        (regular && finite).then(|| Solved {
            values,
            covariance,
            missing,
            of_terms: of_terms.diagonal().iter().map(|v| v.max(0.0)).collect(),
        })
    }
}
